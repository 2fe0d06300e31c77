"""Deliberately broken lazy grids, one step each, and the small scenes that convict them.

`caught_by` names a scene, of `visref.conformance` or of `OWN` below, on which the verdict
convicts the mutant of each variant it belongs to; `contract` says that only
`tests.mutants.lazy_grid_contract` can see it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from tests.mutants.bad_cullers import Method, Mutant, registrar
from visref.camera import Camera
from visref.conformance.scenes import Case, SceneMaker, box, camera, case, panel, pixel_panel
from visref.conformance.scenes import together as merged
from visref.scene import Alpha
from visref_culling.lazy_grid import LazyGridCulling
from visref_culling.lazy_grid.grid import FULL, OUTDATED, UNKNOWN, OcclusionGrid
from visref_culling.lazy_grid.nodes import corners_of, pixel_bounds


def method(name: str, **options: Any) -> Method:
    return Method(f"lazy-grid-{name}", LazyGridCulling, {"cell": 8, **options})


OCCLUSION = method("occlusion")
Z = method("z", buffer="z")
SOFTWARE = method("software", query="software")
SOFTWARE_Z = method("software-z", query="software", buffer="z")
GL = method("gl", query="gl")
GL_Z = method("gl-z", query="gl", buffer="z")

OCCLUSIONS = (OCCLUSION, SOFTWARE, GL)
DEPTHS = (Z, SOFTWARE_Z, GL_Z)
ALL = (*OCCLUSIONS, *DEPTHS)
READBACKS = (OCCLUSION, Z)
PIXELS = (OCCLUSION, Z, SOFTWARE, SOFTWARE_Z)

MUTANTS: list[Mutant] = []
EQUIVALENT: dict[str, str] = {}
NOT_HERE: dict[str, str] = {}

OF_THE_METHOD = {
    "U1": "draw list keyed by z_near",
    "U2": "full on any covered pixel",
    "U3": "full kept from the last frame",
    "U4": "z_far = min",
    "U5": "full set from a border intersection's query",
    "U6": "intersection rounded inward",
    "U7": "section 5 with <",
    "U8": "readback y flipped",
    "U9": "viewport no multiple of the cell: edge cell cut short",
    "U10": "a child hidden in a parent that was never tested",
    "U11": "ties of z_near in the wrong order",
    "W12": "outdated never set",
    "W13": "always outdated (busy)",
    "W14": "the zmax shortcut",
    "W15": "up-to-date cells not asked first",
}


mutant = registrar(MUTANTS)


# Scenes. Orthographic ones have a world unit a pixel and the image's middle at the origin.

OWN: dict[str, SceneMaker] = {}


def own(claim: str) -> Callable[[Callable[..., Case]], Callable[..., Case]]:
    def register(build: Callable[..., Case]) -> Callable[..., Case]:
        OWN[build.__name__] = SceneMaker(build.__name__, claim, "", build)
        return build

    return register


def flat(width: int = 64, height: int = 48, **changes: Any) -> Camera:
    values: dict[str, Any] = {"near": 1.0, "far": 100.0, "ymag": height / 2, **changes}
    return camera(width=width, height=height, **values)


@own("draws the poster before a slanted wall whose near end is nearer than the poster")
def poster_before_a_slanted_wall(rng: np.random.Generator) -> Case:
    wall = (
        np.array([[-30, -20, -4], [30, -20, -60], [30, 20, -60], [-30, 20, -4]], float),
        np.array([[0, 1, 2], [0, 2, 3]]),
    )
    return case([("wall", wall), ("poster", panel((10, 20), (-5, 5), -20.0))], [flat()])


@own("draws what shows through a hole in a cell that is otherwise covered")
def behind_a_sieve(rng: np.random.Generator) -> Case:
    strips = [panel((-32 + 4 * k, -30 + 4 * k), (-24, 24), -5.0) for k in range(16)]
    return case([("sieve", merged(*strips)), ("wall", panel((-32, 32), (-24, 24), -9))], [flat()])


@own("forgets a wall that the next frame has turned away from")
def wall_that_goes_away(rng: np.random.Generator) -> Case:
    wall, poster = panel((-32, 32), (-24, 24), -5.0), panel((100, 110), (-5, 5), -9.0)
    return case(
        [("wall", wall), ("behind", panel((-9, 9), (-9, 9), -9)), ("poster", poster)],
        [flat(), camera((105.0, 0.0, 0.0), near=1.0, far=100.0, ymag=24.0)],
    )


@own("draws what shows in a corner of a cell after a box in its other corner was hidden")
def two_corners_of_a_cell(rng: np.random.Generator) -> Case:
    cells = [(x, y) for x in range(-32, 32, 8) for y in range(-24, 24, 8)]
    covers = [panel((x, x + 4), (y, y + 8), -5.0) for x, y in cells]
    hidden = [(f"hidden{x},{y}", panel((x + 1, x + 3), (y + 1, y + 7), -10.0)) for x, y in cells]
    seen = [(f"seen{x},{y}", panel((x + 5, x + 7), (y + 1, y + 7), -20.0)) for x, y in cells]
    return case([("covers", merged(*covers)), *hidden, *seen], [flat()])


@own("draws what shows in the last columns and rows of an image that ends within a cell")
def image_ends_within_a_cell(rng: np.random.Generator) -> Case:
    view = flat(61, 45)
    wall = pixel_panel(view, (-1.0, 55.5), (-1.0, 39.5), 5.0)
    right = pixel_panel(view, (57.0, 60.0), (3.0, 30.0), 9.0)
    low = pixel_panel(view, (3.0, 30.0), (41.0, 44.0), 9.0)
    behind = pixel_panel(view, (3.0, 50.0), (3.0, 30.0), 9.0)
    return case([("wall", wall), ("right", right), ("low", low), ("behind", behind)], [view])


@own("does not take glass for a wall")
def behind_glass(rng: np.random.Generator) -> Case:
    objects = [
        ("glass", panel((-32, 32), (-24, 24), -5.0)),
        ("poster", panel((-9, 9), (-9, 9), -9.0)),
    ]
    return case(objects, [flat()], alpha={"glass": Alpha.BLEND})


@own("draws a poster before a wall, in a cell where a box from nearer on was hidden")
def box_hidden_by_its_far_end(rng: np.random.Generator) -> Case:
    view = camera()
    # The wall goes first by its near corner. The box's side runs away from the eye: in the cell
    # from (40, 16) to (47, 23) it lies behind the wall, two cells on before it.
    wall = merged(panel((-7, 7), (-6, 6), -8.0), panel((-1.0, -0.9), (-0.9, -0.8), -2.0))
    side = box((3.0, -1.0, -40.0), (3.5, 1.0, -5.0))
    poster = pixel_panel(view, (41.0, 46.5), (17.0, 22.5), 6.0)
    return case([("wall", wall), ("side", side), ("poster", poster)], [view])


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
    """The grid is made once and kept."""

    kept = None

    def new_grid(self, width, height):
        if self.kept is None:
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


EQUIVALENT["U11"] = (
    "the depths compared are those of inflated boxes: where they are equal the objects are apart "
    "by both inflations, so either order is right"
)


@mutant("W12", of=ALL, contract="proof")
class NeverOutdated:
    """What is drawn leaves the cells as they are."""

    def mark(self, walk, node):
        pass


# A query that only compares knows a cell up to the depth that was asked, and boxes come from
# front to back: what shows the one before says nothing of the next. So for `gl-z` every cell
# that does not hide a box is asked, and W13 and W15 change nothing there.
KNOWING = (*OCCLUSIONS, Z, SOFTWARE_Z)


# With depths, the cell asked in vain and the one that knew are seldom the same.
@mutant("W13", of=OCCLUSIONS, contract="outdated")
@mutant("W13", of=(Z, SOFTWARE_Z), contract="first")
class AlwaysOutdated:
    """Every cell is asked again for every box."""

    def scan(self, walk, node):
        if isinstance(walk.grid, OcclusionGrid):
            walk.grid.state[walk.grid.state != FULL] = OUTDATED
        else:
            walk.grid.reached[~walk.grid.untouched] = UNKNOWN
        return super().scan(walk, node)


@mutant("W14", of=DEPTHS, contract="proof")
class BorderOfBackgroundShows:
    """As Fig. 3 prints it: a border cell at z_max shows the box, stale or partly covered."""

    def scan(self, walk, node):
        free, internal, border = super().scan(walk, node)
        z_max = self.areas.z_max
        free = free or any(walk.grid.farthest[row, column] == z_max for column, row in border)
        return free, internal if not free else [], border if not free else []


@mutant("W15", of=KNOWING, contract="first")
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


NOT_HERE["G2"] = "no box is rasterised, so no face of one is culled"
NOT_HERE["G8"] = "an object's own depth is not there when its box is tested"


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


@mutant("G13", of=ALL, caught_by="behind_glass")
class GlassOccludes:
    """Every triangle hides what lies behind it."""

    def occluders(self, scene):
        return np.ones(scene.triangle_count, bool)


@mutant("G14", of=(GL, GL_Z), caught_by="peeking_by_a_pixel")
class UnfinishedQueryReadAsZero:
    """A query's answer is read before it is there, and taken to say zero."""

    def passes(self, samples):
        return np.zeros(len(samples), bool)


NOT_HERE["G12"] = "the depth that is read or queried has one sample a pixel; no step makes another"
