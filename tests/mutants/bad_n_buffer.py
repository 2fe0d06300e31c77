"""Deliberately broken N-buffer cullers, one step each.

`caught_by` names a scene of `visref.conformance` on which the verdict convicts the mutant;
`contract` says that only `tests.mutants.n_buffer_contract` can see it. A mutant of the GPU is an
edit of its shaders.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tests.mutants.bad_cullers import (
    GlassOccludes,
    Method,
    MirroredCornersUnsorted,
    Mutant,
    QueryWithTheEyeInside,
    ResolvedMultisamples,
    ThresholdAboveOneSample,
    TwoCornersTransformed,
    UnfinishedQueryReadAsZero,
    registrar,
)
from tests.support.shader_edits import edited
from visref_culling.n_buffer import NBufferCulling
from visref_culling.n_buffer.cover import Cover
from visref_culling.n_buffer.depth_map import DepthMapQueries
from visref_culling.n_buffer.gpu import NBufferTexture
from visref_culling.n_buffer.gpu_cull import SHADER, GpuCull
from visref_culling.n_buffer.levels import build_levels, look_up


def method(name: str, **options: Any) -> Method:
    return Method(f"n-buffer-{name}", NBufferCulling, options)


FOUR = method("four")
ONE = method("one", squares=1)
TREE = method("tree", hierarchy=True)
GPU = method("gpu", where="gpu")
GPU_ONE = method("gpu-one", where="gpu", squares=1)
QUERY = method("query", test="query")

CPU = (FOUR, ONE, TREE)
GPUS = (GPU, GPU_ONE)
LOOKUPS = (*CPU, *GPUS)
ALL = (*LOOKUPS, QUERY)

MUTANTS: list[Mutant] = []
# (id, method's name) -> the reason.
EQUIVALENT: dict[tuple[str, str], str] = {}
NOT_HERE: dict[tuple[str, str], str] = {}

OF_THE_METHOD = {
    "U1": "min for max, or reversed depth",
    "U2": "d for d + 1 pixels",
    "U3": "offset 2^(i±1)",
    "U4": "the second square one pixel short",
    "U5": "level rounded down",
    "U6": "bottom and top origin mixed",
    "U7": "unclipped query",
    "U8": "linear filtering, or half a texel off",
    "U9": "top level missing at 640",
    "U10": "last frame's depth",
    "U11": "half-float level",
    "W12": "border 1",
    "W13": "repeat wrap",
}

mutant = registrar(MUTANTS)

PIERCED = "revealed_by_a_pierced_wall"
LEANING = "revealed_leaning_panels"
ACROSS = "revealed_across_the_near_plane"


def of_the_map(step: type) -> type:
    """A culler's step that puts a broken step of its map in place."""

    def map_queries(self: Any, squares: int) -> DepthMapQueries:
        return type(step.__name__, (step, DepthMapQueries), {})(squares)

    return type(step.__name__, (), {"__doc__": step.__doc__, "map_queries": map_queries})


def on_the_gpu(name: str, about: str, *edits: tuple[str, str], build: str = "") -> type:
    """A culler's step that edits the GPU's shader, or with `build` the one that builds levels."""

    class Built(NBufferTexture):
        def shader(self, name: str) -> Any:
            if name != build:
                return super().shader(name)
            return self.device.context.compute_shader(edited(build, *edits))

    class Edited(GpuCull):
        def load(self) -> Any:
            if build:
                return super().load()
            return self.device.context.compute_shader(edited(SHADER, *edits))

        texture = Built

    return type(name, (), {"__doc__": about, "gpu_cull": Edited})


def not_here(ids: str, of: tuple[Method, ...], reason: str) -> None:
    NOT_HERE.update({(id, one.name): reason for id in ids.split() for one in of})


# Steps of the method.


for id_, step, caught in (
    ("G10", TwoCornersTransformed, "walk_through_a_city"),
    ("G10", MirroredCornersUnsorted, "walk_through_a_city"),
    ("G13", GlassOccludes, "revealed_behind_glass"),
):
    mutant(id_, of=ALL, caught_by=caught)(step)
for id_, step, caught in (
    ("G2", QueryWithTheEyeInside, "eye_inside_an_object"),
    ("G9", ThresholdAboveOneSample, PIERCED),
    ("G12", ResolvedMultisamples, "crowd"),
    ("G14", UnfinishedQueryReadAsZero, "stacks_of_sheets"),
):
    mutant(id_, of=(QUERY,), caught_by=caught)(step)


@mutant("G1", of=CPU, caught_by=ACROSS)
class CornersBehindTheEye:
    """Corners are projected whatever their sign, and depth is taken from those in front."""

    def needs_no_query(self, view, boxes):
        return np.zeros(len(boxes), bool)

    def nearest(self, frame, boxes):
        x, y, z = np.indices((2, 2, 2)).reshape(3, -1)
        corners = np.stack([boxes[:, x, 0], boxes[:, y, 1], boxes[:, z, 2]], axis=2)
        depth = corners @ frame.view.depth_row
        return np.where(depth > frame.view.camera.near, depth, np.inf).min(axis=1)

    def map_queries(self, squares):
        class Map(DepthMapQueries):
            def rectangles(self, boxes):
                x, y, z = np.indices((2, 2, 2)).reshape(3, -1)
                corners = [boxes[:, x, 0], boxes[:, y, 1], boxes[:, z, 2], np.ones((len(boxes), 8))]
                clip = np.stack(corners, axis=2) @ self.view.clip_from_relative.T
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
        x, y, z = np.indices((2, 2, 2)).reshape(3, -1)
        corners = np.stack([boxes[:, x, 0], boxes[:, y, 1], boxes[:, z, 2]], axis=2)
        return np.linalg.norm(corners, axis=2).min(axis=1)


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
        from visref_culling.boxes.rectangles import screen_rectangles

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


# The same on the GPU, as edits of its shaders.

_LOOK = "texelFetch(n_buffer, ivec3(start, level), 0).x"
_EDITS: dict[str, tuple[str, str, str, list[tuple[str, str]], str]] = {
    "G1": ("CornersBehindTheEyeOnTheGPU",
           "Corners are projected whatever their sign, and depth is taken from the farthest.",
           ACROSS,
           [("if (nearest <= growth.w) {\n        return true;\n    }", ""),
            ("double nearest = least(depth_row.xyz);",
             "double nearest = least(depth_row.xyz);\n"
             "    nearest = nearest > growth.w ? nearest : most(depth_row.xyz);")], ""),
    "G4": ("LastColumnLeftOutOnTheGPU", "The rectangle ends before its last column and row.",
           PIERCED,
           [("return ivec4(ivec2(first), ivec2(last));",
             "return ivec4(ivec2(first), max(ivec2(last) - 1, min(ivec2(first), ivec2(last))));")],
           ""),
    "G5": ("EuclideanDistanceOnTheGPU", "The distance of the nearest point is compared.", PIERCED,
           [("double ndc = to_window.x * nearest + to_window.y;",
             "nearest = length(max(max(low, -high), dvec3(0.0lf)));\n"
             "    double ndc = to_window.x * nearest + to_window.y;")], ""),
    "G6": ("DepthOfTheCentreOnTheGPU", "The box's centre stands for its nearest point.", LEANING,
           [("double ndc = to_window.x * nearest + to_window.y;",
             "nearest = 0.5lf * dot(depth_row.xyz, low + high);\n"
             "    double ndc = to_window.x * nearest + to_window.y;")], ""),
    "G7": ("SixteenBitsOnTheGPU", "Depth enters the levels in 16 bits, rounded to nearest.",
           PIERCED,
           [("vec4(depth)", "vec4(round(depth * 65535.0) / 65535.0)")], "n_buffer_base.comp"),
    "G8": ("StrictAndUnshiftedOnTheGPU", "A box at its own object's depth is hidden.",
           "huge_depth_range",
           [("0.5lf * (ndc - to_window.z) + 0.5lf", "0.5lf * ndc + 0.5lf"),
            ("return depth <= double(farthest);", "return float(depth) < farthest;")], ""),
    "U1": ("NearestForFarthestOnTheGPU", "A level holds the nearest depth.", PIERCED,
           [("farthest ? max(depth, other)", "!farthest ? max(depth, other)")],
           "n_buffer_level.comp"),
    "U2": ("DifferenceForCountOnTheGPU", "Squares for x1 - x0 pixels, not one more.", PIERCED,
           [("ivec2 size = r.zw - r.xy + 1;", "ivec2 size = max(r.zw - r.xy, 1);")], ""),
    "U3": ("OffsetTooFarOnTheGPU", "A level is joined from pixels a whole square apart.", PIERCED,
           [("1 << (level - 1)", "1 << level")], "n_buffer_level.comp"),
    "U5": ("LevelRoundedDownOnTheGPU", "The level is rounded down.", PIERCED,
           [("findMSB(n - 1) + 1", "findMSB(n - 1)")], ""),
    "U6": ("BottomForTopOnTheGPU", "Level 0 is copied with the first row at the bottom.", PIERCED,
           [("size.y - 1 - at.y", "at.y")], "n_buffer_base.comp"),
    "U7": ("UnclippedQueryOnTheGPU", "The rectangle is not clipped; outside is 0.", PIERCED,
           [("floor(min(max(first, dvec2(0.0lf)), size))", "floor(first)"),
            ("floor(max(min(last, size - 1.0lf), dvec2(-1.0lf)))", "floor(last)"),
            (_LOOK, "(any(lessThan(start, ivec2(0))) ? 0.0 : " + _LOOK + ")")], ""),
    "U8": ("OneTexelOffOnTheGPU", "The pixel before is looked up.", PIERCED,
           [(_LOOK, "texelFetch(n_buffer, ivec3(max(start - 1, 0), level), 0).x")], ""),
    "U11": ("HalfFloatLevelsOnTheGPU", "Levels are kept in 16-bit floating point.", PIERCED,
            [("vec4(depth)", "vec4(unpackHalf2x16(packHalf2x16(vec2(depth))).x)")],
            "n_buffer_base.comp"),
}  # fmt: skip
for id_, (name_, about_, caught_, edits_, build_) in _EDITS.items():
    mutant(id_, of=GPUS, caught_by=caught_)(on_the_gpu(name_, about_, *edits_, build=build_))
mutant("U4", of=(GPU,), caught_by=PIERCED)(
    on_the_gpu(
        "SecondSquareShortOnTheGPU",
        "The squares that end at the rectangle's last column start one pixel too early.",
        ("ivec2 last = max(r.zw - side + 1, r.xy);", "ivec2 last = max(r.zw - side, r.xy);"),
    )
)
mutant("U9", of=(GPU_ONE,), caught_by=PIERCED)(
    on_the_gpu(
        "TopLevelMissingOnTheGPU",
        "Levels end with the largest square that fits the image's longer side.",
        ("n_buffer_square(r.xy, n_buffer_level(max(size.x, size.y)))",
         "n_buffer_square(r.xy, min(n_buffer_level(max(size.x, size.y)), 6))"),
    )
)  # fmt: skip


@mutant("U10", of=GPUS, caught_by="jump_cuts")
@mutant("G11", of=GPUS, caught_by="jump_cuts")
class DepthOfTheLastFrameOnTheGPU:
    """The levels of the frame before are looked up with this frame's camera."""

    class gpu_cull(GpuCull):
        class texture(NBufferTexture):
            before = None

            def build(self, target, *, levels=None):
                super().build(target, levels=levels)
                made = self.read().tobytes()
                if self.before is not None:
                    self.texture.write(self.before)
                self.before = made


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


@mutant("W12", of=CPU, contract="hidden")
@of_the_map
class BorderOfOne:
    """Outside the image lies the farthest depth."""

    build = bordered(1.0)


@mutant("W13", of=CPU, contract="hidden")
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


# The wasteful edits: what leaves the image joins the farthest depth, or the other edge.
mutant("W12", of=GPUS, contract="hidden")(
    on_the_gpu(
        "BorderOfOneOnTheGPU",
        "Outside the image lies the farthest depth.",
        ("return depth;\n    }", "return 1.0;\n    }"),
        build="n_buffer_level.comp",
    )
)
mutant("W13", of=GPUS, contract="hidden")(
    on_the_gpu(
        "RepeatWrapOnTheGPU",
        "Beyond the image's edge the other edge follows.",
        ("return depth;\n    }", "at = at % size;\n    }"),
        build="n_buffer_level.comp",
    )
)


@mutant("nothing forgotten", of=CPU, contract="hidden")
class StaleOccludersKept:
    """What was drawn is remembered, not what was tested visible: occluders never go."""

    def decide(self, frame):
        super().decide(frame)
        self.seen[np.concatenate([np.zeros(0, np.int64), *frame.drawn])] = True


@mutant("occluders not tested", of=(FOUR, ONE), contract="tested")
class OccludersNotTested:
    """What was drawn as an occluder is taken to be visible."""

    def test_all(self, frame):
        old = self.remembered(frame)
        shown = old.copy()
        rest = ~old
        shown[rest] = self.visible(frame, frame.boxes[rest], frame.sure[rest])
        return shown


# Reasons.

not_here("G1 G3 G4 G5 G6 G7 G8", (QUERY,), "the rasteriser projects, rounds and compares the box")
not_here("U1 U2 U3 U4 U5 U6 U7 U8 U9 U11 W12 W13", (QUERY,), "nothing is looked up")
not_here("U10 G11", (QUERY,), "the depth is the target's, cleared and drawn in this frame")
not_here("G2", LOOKUPS, "no box is rasterised, so no face of one is culled")
not_here("G9", LOOKUPS, "no samples are counted")
not_here("G12", LOOKUPS, "the depth that is looked up is the one of a single-sampled target")
not_here("G14", LOOKUPS, "nothing is asked that could be unfinished")
not_here("U4", (ONE, GPU_ONE), "there is no second square")
for one_ in LOOKUPS:
    EQUIVALENT["G3", one_.name] = (
        "in whole pixels, sides rounded to nearest hold exactly the pixels whose centres lie in "
        "the unrounded rectangle, and the box is inflated by more than a centre can be off"
    )
for one_ in (FOUR, TREE, GPU):
    EQUIVALENT["U9", one_.name] = (
        "four squares of half the side never need the top level, for any rectangle in the image"
    )
