"""Masked software occlusion culling with one step broken."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from tests.mutants.common import RemovedObjectsDrawn, common
from tests.mutants.harness import Suite, Trace, equivalent, mutant, not_here
from tests.support.kernel_edits import edited
from visref.conformance.scenes import Case, case, pixel_panel
from visref.conformance.scenes import camera as camera_at
from visref_culling.boxes.conservative import nearest_depth
from visref_culling.masked import MaskedOcclusion, buffer
from visref_culling.queries.software_depth import mesh_of

SUITE = Suite(
    {
        "U1": "the second layer holds the depth of the last triangle",
        "U2": "a tile is full with one pixel",
        "U3": "a layer is let go and its mask is kept",
        "U4": "the second layer stands for the whole tile",
        "U5": "a triangle covers the tiles that it touches",
        "U6": "a triangle's nearest depth in a tile",
        "W7": "a full layer never becomes the first, which alone is asked",
        "W8": "back to front",
    },
    watched=("hidden_in_pieces", "crowd", "walk_through_a_city"),
)
MASKED = (SUITE.method("masked-occlusion", MaskedOcclusion),)
LARGE = (SUITE.method("masked-occlusion-large", MaskedOcclusion, least=200),)
ALL = (*MASKED, *LARGE)
PEEKING = "peeking_by_a_pixel"
PIERCED = "revealed_by_a_pierced_wall"

SUITE.kept_by(*MASKED)


@SUITE.contract
def what_a_wall_of_pieces_hides_is_not_drawn(trace: Trace) -> Iterator[str]:
    """Objects named `hidden` lie behind others that cover them tile by tile."""
    names = trace.scene.names
    yield from (f"{names[unit]} is drawn" for unit in trace.drawn if names[unit] == "hidden")


@SUITE.contract
def nearer_units_are_drawn_first(trace: Trace) -> Iterator[str]:
    """By the least depth of their boxes."""
    nearest = []
    for unit in trace.drawn:
        corners = np.array(list(itertools.product(*trace.scene.object_bounds[unit].T)))
        nearest.append(trace.camera.pixel_of(corners)[1].min())
    for k in np.flatnonzero(np.diff(nearest) < -1e-3 * np.abs(nearest[1:])):
        yield f"unit {trace.drawn[k + 1]} is drawn after unit {trace.drawn[k]}"


def loops(name: str, about: str, *edits: tuple[str, str]) -> type:
    """A culler's step whose compiled loops are edited."""

    class Step:
        def kernel(self):
            return edited(buffer, *edits).decide

    return type(name, (Step,), {"__doc__": about})


def corners_of(boxes):
    pick = np.array(list(itertools.product((0, 1), repeat=3)))
    return boxes[:, pick, np.arange(3)]


@mutant("G1", of=ALL, caught_by="revealed_across_the_near_plane")
class CornersBehindTheEye:
    """Corners are projected whatever their sign, and depth is taken from the farthest."""

    def needs_no_query(self, view, boxes):
        return np.zeros(len(boxes), bool)

    def rectangles(self, frame):
        clip, camera = frame.view.clip_from_relative, frame.view.camera
        points = np.append(corners_of(frame.boxes), np.ones((len(frame.boxes), 8, 1)), axis=2)
        at = points @ clip.T
        window = np.array([camera.width, camera.height])
        places = 0.5 * window * (1.0 + at[..., :2] / at[..., 3:] * [1.0, -1.0])
        low = np.clip(np.floor(places.min(axis=1)), 0, window - 1)
        high = np.clip(np.floor(places.max(axis=1)), 0, window - 1)
        return np.concatenate([low, high], axis=1).astype(np.int32)

    def nearest(self, frame):
        depth = corners_of(frame.boxes) @ frame.view.depth_row
        return np.where(frame.nearest > frame.view.camera.near, frame.nearest, depth.max(axis=1))


@mutant("G4", of=ALL, caught_by=PEEKING)
class LastColumnLeftOut:
    """The rectangle ends before its last column and row."""

    def rectangles(self, frame):
        found = super().rectangles(frame)
        return np.concatenate([found[:, :2], np.maximum(found[:, 2:] - 1, found[:, :2])], axis=1)


@mutant("G5", of=MASKED, caught_by=PIERCED)
class EuclideanDistance:
    """The distance of the nearest point is compared with depths."""

    def nearest(self, frame):
        low, high = frame.boxes[:, 0], frame.boxes[:, 1]
        return np.linalg.norm(np.maximum(np.maximum(low, -high), 0.0), axis=1)


@mutant("G6", of=ALL, caught_by="interpenetrating_objects")
class DepthOfTheCentre:
    """The box's centre stands for its nearest point."""

    def nearest(self, frame):
        centres = frame.boxes.mean(axis=1, keepdims=True).repeat(2, axis=1)
        return nearest_depth(frame.view, centres)


@mutant("G11", of=ALL, caught_by="jump_cuts")
class BufferOfTheLastFrame:
    """The buffer is not emptied."""

    def empty(self, masked):
        pass


_JOINED = "working = depth if mask == 0 else max(working, depth)"
mutant("G7", of=MASKED, caught_by=PIERCED)(
    loops(
        "DepthInHalfFloats",
        "The layers keep eleven bits of a depth, rounded down.",
        ("rounded_up(farthest), rays)",
         "np.float32(np.floor(farthest * 16.0) / 16.0), rays)"),
    )
)  # fmt: skip
mutant("U1", of=MASKED, caught_by="before_the_farther_half_of_a_tile")(
    loops("DepthOfTheLast", "The second layer takes each new depth.", (_JOINED, "working = depth"))
)
mutant("U2", of=MASKED, caught_by=PEEKING)(
    loops(
        "FullWithOnePixel",
        "A layer becomes the first whatever its mask.",
        ("if mask == buffer.full[row, column]:", "if mask != 0:"),
    )
)
mutant("U3", of=MASKED, caught_by="before_a_wall_of_three_depths")(
    loops(
        "MaskKept",
        "When the second layer is let go its pixels stay in the mask.",
        ("            mask = np.uint32(0)\n    working =",
         "            working = depth\n    working ="),
    )
)  # fmt: skip
mutant("U4", of=MASKED, caught_by=PEEKING)(
    loops(
        "SecondLayerForAll",
        "What lies behind the second layer is hidden, in the mask or not.",
        ("if asked & ~mask != 0 or nearest", "if nearest"),
    )
)
mutant("U5", of=MASKED, caught_by=PEEKING)(
    loops(
        "WholeTilesCovered",
        "A triangle that covers a pixel of a tile covers it all.",
        (
            "if covered != 0:",
            "if covered != 0:\n                covered = buffer.full[row, column]",
        ),
    )
)
mutant("U6", of=MASKED, caught_by=PIERCED)(
    loops(
        "NearestInATile",
        "A triangle's least depth in a tile stands for it.",
        ("covered, farthest = np.uint32(0), 0.0", "covered, farthest = np.uint32(0), np.inf"),
        ("farthest = max(farthest, depth)", "farthest = min(farthest, depth)"),
    )
)
mutant("W7", of=MASKED, contract="what_a_wall_of_pieces_hides_is_not_drawn")(
    loops(
        "NeverFull",
        "A full second layer stays one, and lookups are by the first.",
        ("if mask == buffer.full[row, column]:", "if False:"),
        ("if mask == 0:\n", "if True:\n"),
    )
)


@mutant("W8", of=MASKED, contract="nearer_units_are_drawn_first")
class BackToFront:
    """The farthest are asked first."""

    def order(self, ids, nearest):
        return super().order(ids, nearest)[::-1]


@SUITE.scene("shows what lies before one of an object's three depths")
def before_a_wall_of_three_depths(rng: np.random.Generator) -> Case:
    """One object is a far wall, a panel some way before it and another close by, beside each other
    in one tile; before the former lies what is seen."""
    view = camera_at()
    parts = [
        pixel_panel(view, (-1.5, 65.5), (-1.5, 49.5), 40.0),
        pixel_panel(view, (15.5, 19.5), (19.5, 23.5), 30.0),
        pixel_panel(view, (19.5, 21.5), (19.5, 23.5), 5.0),
    ]
    points = np.concatenate([points for points, _ in parts])
    faces = np.concatenate([faces + 4 * k for k, (_, faces) in enumerate(parts)])
    seen = pixel_panel(view, (16.6, 18.4), (20.6, 22.4), 10.0)
    return case([("three depths", (points, faces)), ("seen", seen)], [view, view])


@SUITE.scene("shows what lies before the farther of an object's two depths")
def before_the_farther_half_of_a_tile(rng: np.random.Generator) -> Case:
    """One object is two panels beside each other in a tile, at about one depth; what is seen lies
    between the two, before the farther."""
    view = camera_at()
    far = pixel_panel(view, (15.5, 19.5), (19.5, 23.5), 12.0)
    near = pixel_panel(view, (19.5, 23.5), (19.5, 23.5), 11.0)
    both = np.concatenate([far[0], near[0]]), np.concatenate([far[1], near[1] + 4])
    seen = pixel_panel(view, (16.6, 18.4), (20.6, 22.4), 11.5)
    return case([("two depths", both), ("seen", seen)], [view, view])


@SUITE.scene("does not draw what pieces hide together")
def hidden_in_pieces(rng: np.random.Generator) -> Case:
    """A far wall and a near one, of panels whose seams do not meet the tiles', and what is behind
    both; and something before them."""
    view = camera_at()
    objects = []
    for depth in (40.0, 6.0):
        edges = [-1.5, 19.5, 42.5, 65.5]
        for k in range(3):
            sides = edges[k] - 0.5, edges[k + 1] + 0.5
            objects.append((f"wall{k}", pixel_panel(view, sides, (-1.5, 49.5), depth - 0.1 * k)))
    objects.append(("before", pixel_panel(view, (4.5, 9.5), (4.5, 9.5), 3.0)))
    for k in range(6):
        x, y = rng.uniform(2.0, 50.0), rng.uniform(2.0, 40.0)
        objects.append(("hidden", pixel_panel(view, (x, x + 6.0), (y, y + 5.0), 60.0 + k)))
    return case(objects, [view, view])


common("G10", of=ALL, caught_by="walk_through_a_city")
common("G13 G15 M1 M2 M5 M6", of=ALL)


@mutant("M3", of=MASKED, caught_by="sliding_door")
class BufferAtItsOldPlace:
    """What is rasterised is moved a frame late."""

    def mesh(self):
        last, self.coming = vars(self).get("coming", self.scene), self.scene
        return mesh_of(last, self.occluders(last))


@mutant("M4", of=MASKED, caught_by="appearing_and_vanishing")
class RemovedObjectsInTheBuffer(RemovedObjectsDrawn):
    """What is absent keeps its triangles in the buffer, and its box."""

    def prepare(self, scene):
        self.kept_triangles = scene.triangles.copy()
        return super().prepare(scene)

    def mesh(self):
        present = self.scene.present
        self.kept_triangles[present] = self.scene.triangles[present]
        kept = replace(self.scene, triangles=self.kept_triangles.copy(), absent=None)
        return mesh_of(kept, self.occluders(kept))


not_here("G2", ALL, "no box is rasterised, so no face of one is culled")
not_here("G9 G12 G14", ALL, "no query is asked: depths are compared on the processor")
equivalent(
    "G3",
    ALL,
    "in whole pixels, sides rounded to nearest hold exactly the pixels whose centres lie in the "
    "unrounded rectangle, and the box is inflated by more than a centre can be off",
)
equivalent("G8", ALL, "a unit's own depth is joined after it was asked")
not_here(
    "G5 G7 M3 M4 U1 U2 U3 U4 U5 U6 W7 W8", LARGE, "the loops and the order are masked-occlusion's"
)
