"""Lazy grids with one step broken, on the scenes of `tests.mutants.lazy_grid.scenes` beside the
conformance suite's.

Hey, Tobler, Purgathofer 2001: with depths, a cell's z_far is never nearer than the true farthest
depth; with the occlusion buffer, also, every object drawn lies wholly before the box tested.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.mutants.common import RemovedObjectsDrawn, common
from tests.mutants.harness import breaks, equivalent, mutant, not_here
from tests.mutants.lazy_grid.contract import SUITE
from visref_culling.lazy_grid import LazyGridCulling
from visref_culling.lazy_grid.grid import FULL, OUTDATED, UNKNOWN, OcclusionGrid
from visref_culling.lazy_grid.nodes import corners_of, pixel_bounds
from visref_culling.queries.software_depth import SoftwareBuffer

OCCLUSION = SUITE.method("lazy-grid-occlusion", LazyGridCulling, cell=8)
Z = SUITE.method("lazy-grid-z", LazyGridCulling, cell=8, buffer="z")
SOFTWARE = SUITE.method("lazy-grid-software", LazyGridCulling, cell=8, query="software")
SOFTWARE_Z = SUITE.method(
    "lazy-grid-software-z", LazyGridCulling, cell=8, query="software", buffer="z"
)
GL = SUITE.method("lazy-grid-gl", LazyGridCulling, cell=8, query="gl")
GL_Z = SUITE.method("lazy-grid-gl-z", LazyGridCulling, cell=8, query="gl", buffer="z")

OCCLUSIONS = (OCCLUSION, SOFTWARE, GL)
DEPTHS = (Z, SOFTWARE_Z, GL_Z)
ALL = (*OCCLUSIONS, *DEPTHS)
READBACKS = (OCCLUSION, Z)
SOFTWARES = (SOFTWARE, SOFTWARE_Z)
PIXELS = (OCCLUSION, Z, SOFTWARE, SOFTWARE_Z)


# The method's own mutants.


@mutant("U1", of=OCCLUSIONS, caught_by="poster_before_a_slanted_wall")
class DrawListByNearest:
    """A visible leaf is drawn when its nearest point is in front of every waiting test."""

    def draw_key(self, walk, node):
        return walk.near[node]


@mutant("U2", of=PIXELS, caught_by="behind_a_sieve")
class FullOnAnyCoveredPixel:
    """A cell with one covered pixel is full."""

    def area_queries(self):
        made = super().area_queries()
        made.free = lambda depths: bool(depths.min() >= made.z_max)
        made.farthest = lambda depths: float(depths[depths < made.z_max].max(initial=-1.0))
        return made


@mutant("U3", of=ALL, caught_by="wall_that_goes_away")
class GridOfTheLastFrame:
    """A grid is made once per size of the image and kept: one of another size would have cells
    beside the image, which the compiled scans would read."""

    kept = None

    def new_grid(self, width, height):
        if self.kept is None or (self.kept.width, self.kept.height) != (width, height):
            self.kept = super().new_grid(width, height)
        return self.kept


@mutant("U4", of=(Z, SOFTWARE_Z), caught_by="behind_a_sieve")
class FarthestIsNearest:
    """A cell's z_far is its pixels' least depth."""

    def area_queries(self):
        made = super().area_queries()
        made.farthest = lambda depths: float(depths.min())
        return made


@mutant("U5", of=ALL, caught_by="two_corners_of_a_cell")
class FullFromABorderQuery:
    """What a query of the shared part says is taken for the whole cell."""

    def ask_border(self, walk, cell, node):
        shows = super().ask_border(walk, cell, node)
        if not shows and isinstance(walk.grid, OcclusionGrid):
            walk.grid.set(cell, full=True)
        elif not shows:
            walk.grid.farthest[cell[1], cell[0]] = np.nextafter(walk.depth[node], -np.inf)
        return shows


@mutant("U6", of=ALL, caught_by="peeking_by_a_pixel")
class SharedPartRoundedInward:
    """The part that a cell and a box share loses a pixel on each side."""

    def shared(self, cell, area):
        x0, y0, x1, y1 = super().shared(cell, area)
        if x1 - x0 > 2 and y1 - y0 > 2:
            return x0 + 1, y0 + 1, x1 - 1, y1 - 1
        return x0, y0, x1, y1


@mutant("U7", of=(GL_Z,), caught_by="box_hidden_by_its_far_end")
class SectionFiveWithLess:
    """The box is drawn in the cell's area, its z_near stored, and `<` compares them."""

    def scan(self, walk, node):
        self.node = node
        return super().scan(walk, node)

    def reach(self, walk, cell, area, depth, kind):
        self.flush(walk)
        framebuffer, view = walk.frame.target.framebuffer, walk.frame.view
        x0, y0, x1, y1 = area
        framebuffer.scissor = (x0, view.camera.height - y1, x1 - x0, y1 - y0)
        self.device.begin_frame()
        boxes = walk.nodes.boxes[[self.node]].astype(np.float32)
        samples = self.queries.ask(
            view, walk.frame.target, boxes, walk.frame.stats, way="sync", cull_back_faces=True
        )
        framebuffer.scissor = None
        self.device.begin_frame()
        # z_near < z_far shows: the box that has just failed is hidden, and any farther one.
        return (depth, np.inf) if samples[0] else (-np.inf, float(np.nextafter(depth, -np.inf)))


@mutant("U8", of=READBACKS, caught_by="peeking_by_a_pixel")
class ReadbackUpsideDown:
    """The area is read as if y went up."""

    def area_queries(self):
        made = super().area_queries()
        made.bottom = lambda area: area[1]
        return made


@mutant("U9", of=ALL, caught_by="image_ends_within_a_cell")
class EdgeCellsLeftOut:
    """An image that is no multiple of the cell has no cell for its last pixels."""

    def new_grid(self, width, height):
        grid = super().new_grid(width, height)
        grid.columns, grid.rows = max(1, width // self.cell), max(1, height // self.cell)
        return grid


@mutant("U10", of=OCCLUSIONS, caught_by="posters_on_a_wall")
class ParentsWaitForTheirCentres:
    """A box with boxes in it waits by its middle, so that objects are drawn before the boxes in
    it that are in front of them were tested."""

    def test_key(self, walk, node):
        if walk.unit[node] >= 0:
            return super().test_key(walk, node)
        return 0.5 * (walk.near[node] + walk.far[node])


equivalent(
    "U11",
    ALL,
    "the depths compared are those of inflated boxes: where they are equal the objects are apart "
    "by both inflations, so either order is right",
)


@mutant("W12", of=ALL, contract="each_answer_follows_from_what_is_known")
class NeverOutdated:
    """What is drawn leaves the cells as they are."""

    def mark(self, walk, node):
        pass


KNOWING = (*OCCLUSIONS, Z, SOFTWARE_Z)
equivalent(
    "W13 W15",
    (GL_Z,),
    "a query that only compares knows a cell up to the depth that was asked, and boxes come from "
    "front to back: what shows the one before says nothing of the next, and every cell that does "
    "not hide a box is asked anyhow",
)


# With depths, the cell asked in vain and the one that knew are seldom the same.
@mutant("W13", of=OCCLUSIONS, contract="a_cell_is_asked_whole_only_where_it_may_not_know")
@mutant("W13", of=(Z, SOFTWARE_Z), contract="cells_that_know_are_looked_up_first")
class AlwaysOutdated:
    """Every cell is asked again for every box."""

    def scan(self, walk, node):
        if isinstance(walk.grid, OcclusionGrid):
            walk.grid.state[walk.grid.state != FULL] = OUTDATED
        else:
            walk.grid.reached[~walk.grid.untouched] = UNKNOWN
        return super().scan(walk, node)


@mutant("W14", of=DEPTHS, contract="each_answer_follows_from_what_is_known")
class BorderOfBackgroundShows:
    """As Fig. 3 prints it: a border cell at z_max shows the box, stale or partly covered."""

    def scan(self, walk, node):
        free, internal, border = super().scan(walk, node)
        z_max = self.areas.z_max
        free = free or any(walk.grid.farthest[row, column] == z_max for column, row in border)
        return free, internal if not free else [], border if not free else []


@mutant("W15", of=KNOWING, contract="cells_that_know_are_looked_up_first")
class CellsAskedAsTheyCome:
    """Outdated cells are asked before those that know the answer."""

    def scan(self, walk, node):
        free, internal, border = super().scan(walk, node)
        if not free:
            return free, internal, border
        rows, columns = walk.grid.cells(walk.area[node])
        cells = [
            (column, row)
            for row in range(rows.start, rows.stop)
            for column in range(columns.start, columns.stop)
        ]
        outdated = [cell for cell in cells if not walk.grid.is_current(cell)]
        # The last one is the cell that knew.
        return False, [*outdated, next(c for c in cells if c not in outdated)], []


# Mutants common to all methods.


@mutant("G1", of=ALL, caught_by="object_crossing_the_near_plane")
class CornersBehindTheEye:
    """Corners are projected whatever their sign, and depth is taken from those in front."""

    def needs_no_query(self, view, boxes):
        return np.zeros(len(boxes), bool)

    def nearest(self, view, boxes):
        depth = corners_of(boxes) @ view.depth_row
        return np.where(depth > 0.0, depth, np.inf).min(axis=1)


@mutant("G3", of=ALL, caught_by="peeking_by_a_pixel")
class SizeRoundedToNearest:
    """The rectangle's corner and its size are rounded, each to nearest."""

    def rectangles(self, view, corners):
        low, high = pixel_bounds(view, corners)
        size = (view.camera.width, view.camera.height)
        first = np.rint(low + 0.5)
        after = first + np.rint(high - low)
        found = np.concatenate([np.clip(first, 0, size), np.clip(after, 0, size)], axis=1)
        return found.astype(np.int64)


@mutant("G4", of=ALL, caught_by="rows_and_columns_at_the_border")
class LastRowAndColumnLeftOut:
    """The rectangle ends before its last row and column."""

    def rectangles(self, view, corners):
        found = super().rectangles(view, corners)
        found[:, 2:] -= 1
        return found


@mutant("G4", of=ALL, caught_by="peeking_by_a_pixel")
class RectangleUpsideDown:
    """y counts from the bottom in rectangles."""

    def rectangles(self, view, corners):
        found = super().rectangles(view, corners)
        found[:, [1, 3]] = view.camera.height - found[:, [3, 1]]
        return found


@mutant("G5", of=ALL, caught_by="large_object_at_the_edge")
class EuclideanDistance:
    """The nearest corner's distance from the eye is compared with view depths."""

    def nearest(self, view, boxes):
        return np.linalg.norm(corners_of(boxes), axis=2).min(axis=1)


@mutant("G6", of=OCCLUSIONS, caught_by="posters_on_a_wall")
@mutant("G6", of=DEPTHS, caught_by="interpenetrating_objects")
class DepthOfTheCentre:
    """The box's centre stands for its nearest point."""

    def nearest(self, view, boxes):
        return boxes.mean(axis=1) @ view.depth_row


@mutant("G7", of=(Z,), caught_by="posters_on_a_wall")
class DepthReadBackInBytes:
    """Depth is read back as bytes, rounded to nearest."""

    steps = 255

    def area_queries(self):
        made = super().area_queries()
        made.decoded = lambda depths: np.rint(depths * self.steps) / self.steps
        return made


@mutant("G7", of=(Z,), caught_by="posters_on_a_wall")
class DepthReadBackInSixteenBits(DepthReadBackInBytes):
    """Depth is read back in 16 bits, rounded to nearest."""

    steps = 65535


@mutant("G9", of=(GL, GL_Z), caught_by="objects_of_one_sample")
class ThresholdAboveOneSample:
    """An area of a single passing sample counts as hidden."""

    def passes(self, samples):
        return samples > 1


@mutant("G10", of=ALL, caught_by="rolled_and_pitched_camera")
class TwoCornersProjected:
    """The rectangle is spanned by the projections of two opposite corners."""

    def corners(self, boxes):
        return super().corners(boxes)[:, [0, 7]]


@mutant("G11", of=(OCCLUSION, Z, GL, GL_Z), caught_by="fast_turn")
class DepthOfTheLastFrame:
    """The depth buffer of the frame before is tested with this frame's camera."""

    cleared = False

    def clear(self, target, stats):
        if not self.cleared:
            super().clear(target, stats)
        self.cleared = True


@mutant("G11", of=SOFTWARES, caught_by="fast_turn")
class SoftwareDepthOfTheLastFrame:
    """The same of the software buffer."""

    def area_queries(self):
        class Kept(SoftwareBuffer):
            def begin(self, view, target, stats):
                before = self.depth.copy()
                super().begin(view, target, stats)
                if before.shape == self.depth.shape:
                    self.depth[:] = before

        made = super().area_queries()
        made.__class__ = Kept
        return made


common("G13", of=ALL, caught_by="behind_glass")
common("G15 M1 M2 M5 M6", of=ALL)
common("M3 M4", of=(OCCLUSION, Z, GL, GL_Z))


@mutant("M3", of=SOFTWARES, caught_by="sliding_door")
class SoftwareDepthAtItsOldPlace:
    """The software buffer's triangles are moved a change late."""

    def area_queries(self):
        class Late(SoftwareBuffer):
            def update(self, scene):
                last, self.coming = vars(self).get("coming", self.scene), scene
                super().update(last)

        made = super().area_queries()
        made.__class__ = Late
        return made


@mutant("M4", of=SOFTWARES, caught_by="appearing_and_vanishing")
class RemovedObjectsInTheSoftwareBuffer(RemovedObjectsDrawn):
    """What is absent keeps its triangles in the software buffer, and its box."""

    def prepare(self, scene):
        self.kept_triangles = scene.triangles.copy()
        return super().prepare(scene)

    def area_queries(self):
        owner = self

        class Kept(SoftwareBuffer):
            def update(self, scene):
                owner.kept_triangles[scene.present] = scene.triangles[scene.present]
                super().update(replace(scene, triangles=owner.kept_triangles.copy(), absent=None))

        made = super().area_queries()
        made.__class__ = Kept
        return made


@mutant("G14", of=(GL, GL_Z), caught_by="peeking_by_a_pixel")
class UnfinishedQueryReadAsZero:
    """A query's answer is read before it is there, and taken to say zero."""

    def passes(self, samples):
        return np.zeros(len(samples), bool)


# Where a variant has no such step.

not_here("G2", ALL, "no box is rasterised, so no face of one is culled")
not_here("G8", ALL, "an object's own depth is not there when its box is tested")
not_here("G12", ALL, "the depth read or queried has one sample per pixel; no step makes another")
not_here("G7 U8", (*SOFTWARES, GL, GL_Z), "nothing is read back")
equivalent(
    "G7",
    (OCCLUSION,),
    "the one question is whether a pixel is as far as the background; rounding takes some covered "
    "pixels for free and no free one for covered",
)
not_here("G9 G14", PIXELS, "no query counts samples")
not_here("U1", DEPTHS, "what is visible is drawn at once: there is no list to order")
not_here("U2", (GL, GL_Z), "GL counts the pixels; what is made of the count is G9's")
not_here("U4 W14", OCCLUSIONS, "a cell keeps no depth")
not_here("U4", (GL_Z,), "a query compares and reads no depth")
not_here("U7", (*PIXELS, GL), "only a query of GL's that compares depths can be asked so")
equivalent("U10", DEPTHS, "depths are compared, so the order of tests costs queries and no object")


# What the other contracts see.


@breaks("nothing_is_asked_but_for_a_test", of=(OCCLUSION, Z))
class UpdatesAtOnce:
    """Each draw brings its cells up to date."""

    def draw_leaf(self, walk, node):
        super().draw_leaf(walk, node)
        self.update_all(walk, node)


@breaks("border_cells_come_last_and_only_their_share_is_asked", of=(OCCLUSION, Z))
class BorderCellsFirst:
    """The cells that a box only touches are asked before those that it covers."""

    def scan(self, walk, node):
        self.node = node
        return super().scan(walk, node)

    def ask_internal(self, walk, cell, depth):
        for other in self.scan(walk, self.node)[2]:
            self.ask_border(walk, other, self.node)
        return super().ask_internal(walk, cell, depth)


@breaks("border_cells_come_last_and_only_their_share_is_asked", of=(OCCLUSION, Z))
class AsksAllOfABorderCell:
    """A border cell's query covers all of it."""

    def shared(self, cell, area):
        return cell


SUITE.kept_by(*ALL)
SUITE.kept_by(*ALL, update="busy")
