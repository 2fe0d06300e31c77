"""N-buffer culling on the CPU with one step broken."""

from __future__ import annotations

from typing import Any

import numpy as np

from tests.mutants.harness import mutant
from tests.mutants.n_buffer.methods import ACROSS, CPU, FOUR, LEANING, ONE, PIERCED, TREE
from visref_culling.boxes.rectangles import screen_rectangles
from visref_culling.lazy_grid.nodes import corners_of
from visref_culling.n_buffer.cover import Cover
from visref_culling.n_buffer.depth_map import DepthMapQueries
from visref_culling.n_buffer.levels import build_levels, look_up


def of_the_map(step: type) -> type:
    """A culler's step that puts a broken step of its map in place."""

    def map_queries(self: Any, squares: int) -> DepthMapQueries:
        return type(step.__name__, (step, DepthMapQueries), {})(squares)

    return type(step.__name__, (), {"__doc__": step.__doc__, "map_queries": map_queries})


@mutant("G1", of=CPU, caught_by=ACROSS)
class CornersBehindTheEye:
    """Corners are projected whatever their sign, and depth is taken from those in front."""

    def needs_no_query(self, view, boxes):
        return np.zeros(len(boxes), bool)

    def nearest(self, frame, boxes):
        depth = corners_of(boxes) @ frame.view.depth_row
        return np.where(depth > frame.view.camera.near, depth, np.inf).min(axis=1)

    def map_queries(self, squares):
        class Map(DepthMapQueries):
            def rectangles(self, boxes):
                corners = np.insert(corners_of(boxes), 3, 1.0, axis=2)
                clip = corners @ self.view.clip_from_relative.T
                size = np.array([self.view.camera.width, self.view.camera.height])
                at = 0.5 * size * (1.0 + clip[:, :, :2] / clip[:, :, 3:] * (1.0, -1.0))
                low = np.floor(np.clip(at.min(axis=1), 0.0, size))
                high = np.floor(np.clip(at.max(axis=1), -1.0, size - 1.0))
                return np.concatenate([low, high], axis=1).astype(np.int32)

        return Map(squares)


@mutant("G4", of=CPU, caught_by=PIERCED)
@of_the_map
class LastColumnLeftOut:
    """The rectangle ends before its last column and row, if it has more than one."""

    def rectangles(self, boxes):
        result = super().rectangles(boxes)
        result[:, 2:] = np.maximum(result[:, 2:] - 1, np.minimum(result[:, :2], result[:, 2:]))
        return result


@mutant("G5", of=CPU, caught_by=PIERCED)
class EuclideanDistance:
    """The distance of the nearest corner is compared with depths."""

    def nearest(self, frame, boxes):
        return np.linalg.norm(corners_of(boxes), axis=2).min(axis=1)


@mutant("G6", of=CPU, caught_by=LEANING)
class DepthOfTheCentre:
    """The box's centre stands for its nearest point."""

    def nearest(self, frame, boxes):
        return boxes.mean(axis=1) @ frame.view.depth_row


@mutant("G7", of=CPU, caught_by=PIERCED)
@of_the_map
class DepthReadBackInSixteenBits:
    """The depth is read back in 16 bits, rounded to nearest."""

    steps = 65535

    def read_back(self, target):
        return (np.rint(super().read_back(target) * self.steps) / self.steps).astype(np.float32)


@mutant("G7", of=CPU, caught_by=PIERCED)
@of_the_map
class DepthReadBackInBytes:
    """The depth is read back in bytes, rounded to nearest."""

    def read_back(self, target):
        return (np.rint(super().read_back(target) * 255.0) / 255.0).astype(np.float32)


@mutant("G8", of=CPU, caught_by="huge_depth_range")
@of_the_map
class StrictAndUnshifted:
    """A box at its own object's depth is hidden, and nothing is kept for rounding."""

    def depths(self, nearest):
        view = self.view
        stored = view.window_depth(nearest) + 0.5 * view.depth_shift_ndc
        return np.nextafter(stored.astype(np.float32), np.float32(2.0))


@mutant("U1", of=CPU, caught_by=PIERCED)
@of_the_map
class NearestForFarthest:
    """A level holds the nearest depth of its square."""

    def build(self, depth):
        return build_levels(depth, farthest=False)

    def farthest(self, cover):
        return look_up(self.levels, cover, farthest=False)


@mutant("U1", of=CPU, caught_by=PIERCED)
@of_the_map
class DepthReversed:
    """Depth is taken to grow towards the eye."""

    def read_back(self, target):
        return 1.0 - super().read_back(target)


@mutant("U2", of=CPU, caught_by=PIERCED)
@of_the_map
class DifferenceForCount:
    """The squares are chosen for x1 - x0 pixels, not one more."""

    def __init__(self, squares):
        super().__init__(squares)
        cover = self.cover

        def short(rectangles):
            less = rectangles.copy()
            less[:, 2:] = np.maximum(less[:, 2:] - 1, less[:, :2])
            return cover(less)

        self.cover = short


def wrong_offset(shift: int):
    def build(self, depth):
        levels = build_levels(depth)
        height, width = depth.shape
        for level in range(1, len(levels)):
            at = 1 << max(level - 1 + shift, 0)
            made = levels[level - 1].copy()
            for dy, dx in ((0, at), (at, 0), (at, at)):
                if dy < height and dx < width:
                    part = made[: height - dy, : width - dx]
                    np.maximum(part, levels[level - 1][dy:, dx:], out=part)
            levels[level] = made
        return levels

    return build


@mutant("U3", of=CPU, caught_by=PIERCED)
@of_the_map
class OffsetTooFar:
    """A level is joined from pixels a whole square apart."""

    build = wrong_offset(1)


@mutant("U3", of=CPU, caught_by=PIERCED)
@of_the_map
class OffsetTooNear:
    """A level is joined from pixels a quarter of a square apart."""

    build = wrong_offset(-1)


@mutant("U4", of=(FOUR, TREE), caught_by=PIERCED)
@of_the_map
class SecondSquareShort:
    """The squares that end at the rectangle's last column start one pixel too early."""

    def __init__(self, squares):
        super().__init__(squares)
        cover = self.cover

        def short(rectangles):
            level, x, y = cover(rectangles)
            return Cover(level, np.where(x > x[:, :1], x - 1, x), y)

        self.cover = short


@mutant("U5", of=CPU, caught_by=PIERCED)
@of_the_map
class LevelRoundedDown:
    """The level is the largest whose square is no larger than needed."""

    def __init__(self, squares):
        super().__init__(squares)
        cover = self.cover
        self.cover = lambda rectangles: cover(rectangles)._replace(
            level=np.maximum(cover(rectangles).level - 1, 0)
        )


@mutant("U6", of=CPU, caught_by=PIERCED)
@of_the_map
class BottomForTop:
    """The depth's first row is taken for the image's last."""

    def read_back(self, target):
        return super().read_back(target)[::-1]


@mutant("U7", of=CPU, caught_by=PIERCED)
@of_the_map
class UnclippedQuery:
    """Squares start where the unclipped rectangle does; before the image, the border is 0."""

    def rectangles(self, boxes):
        self.unclipped = screen_rectangles(self.view, boxes, clip_to_window=False)
        return self.unclipped

    def farthest(self, cover):
        height, width = self.levels.shape[1:]
        inside = (cover.x >= 0) & (cover.y >= 0) & (cover.x < width) & (cover.y < height)
        level = np.minimum(cover.level, len(self.levels) - 1)
        x, y = cover.x.clip(0, width - 1), cover.y.clip(0, height - 1)
        found = self.levels[level[:, None], y, x]
        return np.where(inside, found, 0.0).max(axis=1)


@mutant("U8", of=CPU, caught_by=PIERCED)
@of_the_map
class LinearFilter:
    """Lookups fall between four pixels and are filtered."""

    def farthest(self, cover):
        height, width = self.levels.shape[1:]
        looked_up = [
            self.levels[
                cover.level[:, None],
                (cover.y + dy).clip(0, height - 1),
                (cover.x + dx).clip(0, width - 1),
            ]
            for dy in (-1, 0)
            for dx in (-1, 0)
        ]
        return np.mean(looked_up, axis=0).max(axis=1)


@mutant("U8", of=CPU, caught_by=PIERCED)
@of_the_map
class OneTexelOff:
    """Half a texel off, and rounded: the pixel before is looked up."""

    def farthest(self, cover):
        return look_up(self.levels, cover._replace(x=np.maximum(cover.x - 1, 0)))


@mutant("U9", of=(ONE,), caught_by=PIERCED)
@of_the_map
class TopLevelMissing:
    """Levels end with the largest square that fits the image's longer side."""

    def farthest(self, cover):
        top = max(self.levels.shape[1:]).bit_length() - 1
        return look_up(self.levels, cover._replace(level=np.minimum(cover.level, top)))


@mutant("U10", of=CPU, caught_by="jump_cuts")
@mutant("G11", of=CPU, caught_by="jump_cuts")
@of_the_map
class DepthOfTheLastFrame:
    """The map of the frame before is looked up with this frame's camera."""

    last = None

    def build(self, depth):
        made = super().build(depth)
        last, self.last = self.last, made
        return made if last is None or last.shape != made.shape else last


@mutant("U11", of=CPU, caught_by=PIERCED)
@of_the_map
class HalfFloatLevels:
    """Levels are kept in 16-bit floating point."""

    def build(self, depth):
        return super().build(depth).astype(np.float16).astype(np.float32)


# Wasteful ones.


def bordered(border: float):
    def build(self, depth):
        levels = build_levels(depth)
        height, width = depth.shape
        for level in range(1, len(levels)):
            at, below = 1 << (level - 1), levels[level - 1]
            around = np.pad(below, ((0, at), (0, at)), constant_values=border)
            shifted = (
                around[dy : dy + height, dx : dx + width] for dy in (0, at) for dx in (0, at)
            )
            levels[level] = np.maximum.reduce(list(shifted))
        return levels

    return build


@mutant("W12", of=CPU, contract="what_one_square_hides_is_not_drawn")
@of_the_map
class BorderOfOne:
    """Outside the image lies the farthest depth."""

    build = bordered(1.0)


@mutant("W13", of=CPU, contract="what_one_square_hides_is_not_drawn")
@of_the_map
class RepeatWrap:
    """Beyond the image's edge the other edge follows."""

    def build(self, depth):
        levels = build_levels(depth)
        for level in range(1, len(levels)):
            at, below = 1 << (level - 1), levels[level - 1]
            rolled = (np.roll(below, (-dy, -dx), (0, 1)) for dy in (0, at) for dx in (0, at))
            levels[level] = np.maximum.reduce(list(rolled))
        return levels


@mutant("nothing forgotten", of=CPU, contract="what_one_square_hides_is_not_drawn")
class StaleOccludersKept:
    """What was drawn is remembered, not what was tested visible: occluders never go."""

    def decide(self, frame):
        super().decide(frame)
        seen = self.seen_by(frame.view.camera)
        seen[np.concatenate([np.zeros(0, np.int64), *frame.drawn])] = True


@mutant("occluders not tested", of=(FOUR, ONE), contract="every_unit_in_view_is_tested")
class OccludersNotTested:
    """What was drawn as an occluder is taken to be visible."""

    def test_all(self, frame):
        old = self.remembered(frame)
        shown = old.copy()
        rest = ~old
        shown[rest] = self.visible(frame, frame.boxes[rest], frame.sure[rest])
        return shown
