"""Real-time occlusion culling with a lazy occlusion grid.

H. Hey, R. F. Tobler, W. Purgathofer: TR-186-2-01-02, Vienna University of Technology, 2001.

A low-resolution grid of cells lies over the depth buffer. A bounding box is hidden if every cell
that its screen rectangle meets is; what a cell says is brought up to date by a pixel-level query
only when a box asks and something was drawn there since ("lazy", against "busy": after every
draw). Boxes are tested down a hierarchy, front to back:

- `buffer=z` (Figs. 3 and 4): a cell knows its farthest depth; what is visible is drawn at once.
- `buffer=occlusion` (Figs. 2, 5 and 6): a cell knows whether it is full, so all that is drawn
  must lie wholly in front of what is tested next. Two lists see to that: tests wait by their
  boxes' nearest depth, visible leaves by their farthest, and the least of all goes first. Boxes
  are inflated by more than rounding can move them, so two that compare equal do not touch.

Departures from the paper:

- The box's rectangle is of the samples that it may cover, and cells at the image's edge consist
  of the pixels that the image has.
- An eye in the box, or a box across the near plane, is visible without a test.
- Fig. 3's `z_far = z_max` (see `lazy_grid.grid`) and section 5's query for hardware that
  only counts samples (see `queries.areas`) are corrected.
- A border query that finds a pixel so far away tells that much of the whole cell, as Fig. 2
  says of `partially free` and Fig. 3 does not.
- Draws go out together when the next query, or the frame's end, needs them.

Whatever the way of asking, a query's answer equals the one that the true farthest depth gives,
so `update=lazy` and `update=busy` draw the same set; `probability` is the one option under
which they need not.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from heapq import heappop, heappush
from typing import ClassVar

import numpy as np

from visref.camera import Camera
from visref.culler import Option
from visref.errors import InputError
from visref.scene import Float64, Int64, Scene, Units
from visref_culling.boxes.conservative import FARTHEST_QUERY, nearest_depth
from visref_culling.gl.changes import Changes
from visref_culling.gl.item_buffer import GLRaster
from visref_culling.gl.view import View
from visref_culling.lazy_grid.boxes import triangle_boxes
from visref_culling.lazy_grid.coverage import add_coverage
from visref_culling.lazy_grid.grid import DepthGrid, Grid, OcclusionGrid
from visref_culling.lazy_grid.nodes import (
    INNER,
    Area,
    ViewNodes,
    areas,
    clipped_corners,
    corners_of,
    farthest_depth,
    nodes_in_view,
    pixel_bounds,
)
from visref_culling.method import GL_OPTIONS, Frame, GLCuller, phase
from visref_culling.queries.areas import AreaQueries, Readback, RectangleQueries
from visref_culling.queries.software_depth import SoftwareBuffer

Cell = tuple[int, int]  # column, row


@dataclass(eq=False)
class GridTraversal:
    """One frame's grid and nodes. `area`, `near`, `far`, `depth`, `sure`: of each node its
    pixels, least and greatest view depth, least depth as the buffer holds it, and whether it
    is visible without a test. `waiting`: units to draw before the next query."""

    frame: Frame
    nodes: ViewNodes
    grid: Grid
    area: list[Area]
    near: list[float]
    far: list[float]
    depth: list[float]
    sure: list[bool]
    unit: list[int]
    waiting: list[int] = field(default_factory=list)


class LazyGridCulling(GLCuller):
    """The lazy occlusion grid."""

    name = "lazy-grid"
    memory = 0
    summary = "grid of cells over the depth buffer, brought up to date only when asked"
    notes_asked = True
    options: ClassVar[Mapping[str, Option]] = {
        "buffer": Option("occlusion", "what a cell knows", ("occlusion", "z")),
        "update": Option(
            "lazy", "when asked, after every draw, or no occlusion test", ("lazy", "busy", "none")
        ),
        "query": Option(
            "readback",
            "read GL's depth, keep a software buffer, or GL occlusion queries",
            ("readback", "software", "gl"),
        ),
        "cell": Option(32, "pixels on a cell's side, 8 to 64"),
        "boxes": Option("objects", "what a leaf of the hierarchy holds", ("objects", "triangles")),
        "leaf": Option(1500, "most triangles in a leaf, with boxes=triangles"),
        "probability": Option(
            0.0, "drawn area over a cell's, below which it counts as free (section 6)"
        ),
        "whole": Option(
            0.0, "share of a border cell from which all of it is asked, 0 for never (section 6)"
        ),
        "large": Option(
            0, "pixels of a box from which border cells are internal, 0 for never (section 6)"
        ),
        **GL_OPTIONS,
    }

    def __init__(
        self,
        *,
        buffer: str = "occlusion",
        update: str = "lazy",
        query: str = "readback",
        cell: int = 32,
        boxes: str = "objects",
        leaf: int = 1500,
        probability: float = 0.0,
        whole: float = 0.0,
        large: int = 0,
        depth: int = 24,
        fragments: bool = False,
    ) -> None:
        super().__init__(depth=depth, fragments=fragments)
        _within("cell", cell, 8, 64)
        _within("leaf", leaf, 1, None)
        _within("probability", probability, 0, None)
        _within("whole", whole, 0, 1)
        _within("large", large, 0, None)
        self.occlusion_buffer = buffer == "occlusion"
        self.updates, self.query_way, self.cell = update, query, cell
        self.leaf = leaf if boxes == "triangles" else None
        self.probability, self.whole, self.large = probability, whole, large
        self.areas: AreaQueries | None = None

    def prepare(self, scene: Scene) -> Units:
        units = super().prepare(scene)
        self.areas = self.area_queries()
        self.opaque = self.occluders(scene)
        return units

    def follow(self, changes: Changes) -> None:
        super().follow(changes)
        assert self.areas is not None
        self.areas.update(self.scene)

    def _release(self) -> None:
        super()._release()
        if self.areas is not None:
            self.areas.release()
            self.areas = None

    # The steps.

    def units_of(self, scene: Scene) -> Units:
        return scene.object_units() if self.leaf is None else triangle_boxes(scene, self.leaf)

    def area_queries(self) -> AreaQueries:
        if self.query_way == "readback":
            return Readback()
        if self.query_way == "gl":
            return RectangleQueries(self.device, self.query_state, self.passes)
        occludes = self.occluders(self.scene)
        return SoftwareBuffer(self.scene, self.units, occludes, marks_only=self.occlusion_buffer)

    def raster_of(self, scene: Scene) -> GLRaster | None:
        return None if self.query_way == "software" else super().raster_of(scene)

    def new_grid(self, width: int, height: int) -> Grid:
        assert self.areas is not None
        if self.occlusion_buffer:
            return OcclusionGrid(width, height, self.cell, self.probability)
        return DepthGrid(width, height, self.cell, self.probability, self.areas.z_max)

    def corners(self, boxes: Float64) -> Float64:
        """(k, c, 3) points whose projections span the boxes' rectangles."""
        return corners_of(boxes)

    def rectangles(self, view: View, corners: Float64) -> Int64:
        """(k, 4) areas of boxes before the near plane."""
        low, high = pixel_bounds(view, corners)
        return areas(low, high, view.camera.width, view.camera.height)

    def nearest(self, view: View, boxes: Float64) -> Float64:
        """(k,) least view depth."""
        return nearest_depth(view, boxes)

    def test_key(self, walk: GridTraversal, node: int) -> float:
        return walk.near[node]

    def draw_key(self, walk: GridTraversal, node: int) -> float:
        return walk.far[node]

    def draws_first(self, draw_key: float, test_key: float) -> bool:
        """Whether a visible leaf is drawn before a box is tested. On a tie the test goes first:
        what lies at one depth may be seen beside or in one another."""
        return draw_key < test_key

    def scan(self, walk: GridTraversal, node: int) -> tuple[bool, list[Cell], list[Cell]]:
        """What the cells' states decide, and the internal and border cells to ask."""
        area = walk.area[node]
        spans = walk.grid.spans(area, 0 < self.large <= _pixels(area))
        free, internal, border = walk.grid.scan(spans, walk.depth[node])
        return free, _cells(internal), _cells(border)

    def ask_internal(self, walk: GridTraversal, cell: Cell, depth: float) -> bool:
        """Bring a cell up to date; whether it shows a box at `depth`."""
        area = walk.grid.area(cell)
        if isinstance(walk.grid, OcclusionGrid):
            free = self.any_free(walk, cell, area, "cell")
            walk.grid.set(cell, full=not free)
            return free
        assert isinstance(walk.grid, DepthGrid)
        reached, farthest = self.reach(walk, cell, area, depth, "cell")
        walk.grid.learn(cell, reached, farthest)
        return depth <= reached

    def ask_border(self, walk: GridTraversal, cell: Cell, node: int) -> bool:
        """Whether a cell shows a box in the part that they share."""
        area, depth = self.shared(walk.grid.area(cell), walk.area[node]), walk.depth[node]
        whole = walk.grid.area(cell)
        large = 0 < self.whole * _pixels(whole) <= _pixels(area)
        if large and not walk.grid.is_current(cell) and not self.ask_internal(walk, cell, depth):
            return False
        if isinstance(walk.grid, OcclusionGrid):
            free = self.any_free(walk, cell, area, "border")
            if free:
                walk.grid.set_partly_free(cell)
            return free
        assert isinstance(walk.grid, DepthGrid)
        reached, _ = self.reach(walk, cell, area, depth, "border")
        walk.grid.learn_reached(cell, reached)
        return depth <= reached

    def shared(self, cell: Area, box: Area) -> Area:
        return (
            max(cell[0], box[0]),
            max(cell[1], box[1]),
            min(cell[2], box[2]),
            min(cell[3], box[3]),
        )

    def mark(self, walk: GridTraversal, node: int) -> None:
        """The node's unit is drawn: its cells are outdated."""
        walk.grid.mark(walk.area[node])

    # The method.

    def begin(self, camera: Camera) -> Frame:
        return self.open(camera)

    def decide(self, frame: Frame) -> None:
        with phase(frame.stats, "sort"):
            walk = self.walk(frame)
        frame.ids = np.arange(self.units.count)
        self.observe("grid", grid=walk.grid)
        if self.updates == "none":
            self.draw(frame, walk.nodes.unit[walk.nodes.unit != INNER])
            return
        if len(walk.unit):
            if self.occlusion_buffer:
                self.test_then_draw(walk)
            else:
                self.test_and_draw(walk)
        self.flush(walk)

    def walk(self, frame: Frame) -> GridTraversal:
        """Find the nodes in the view, and all that is asked about them."""
        assert self.areas is not None
        view, camera = frame.view, frame.view.camera
        nodes = nodes_in_view(self.tree, view)
        sure = self.needs_no_query(view, nodes.boxes)
        near = self.nearest(view, nodes.boxes)
        far = farthest_depth(view, nodes.boxes)
        self.areas.begin(view, frame.target, frame.stats)
        area = np.tile(np.array([0, 0, camera.width, camera.height]), (len(sure), 1))
        area[~sure] = self.rectangles(view, self.corners(nodes.boxes[~sure]))
        cut = sure & (far >= camera.near) & (np.abs(nodes.boxes).max(axis=(1, 2)) < FARTHEST_QUERY)
        area[cut] = self.rectangles(view, clipped_corners(view, nodes.boxes[cut]))
        depth = np.zeros(len(sure))
        depth[~sure] = self.areas.depth_of(near[~sure])
        return GridTraversal(
            frame,
            nodes,
            self.new_grid(camera.width, camera.height),
            [tuple(row) for row in area.tolist()],
            near.tolist(),
            far.tolist(),
            depth.tolist(),
            sure.tolist(),
            nodes.unit.tolist(),
        )

    def test_and_draw(self, walk: GridTraversal) -> None:
        """Fig. 4, for the z-buffer variant."""
        tests = [(self.test_key(walk, 0), 0)]
        while tests:
            _, node = heappop(tests)
            if self.is_occluded(walk, node):
                continue
            for child in self.children(walk, node):
                heappush(tests, (self.test_key(walk, child), child))
            if walk.unit[node] != INNER:
                self.draw_leaf(walk, node)

    def test_then_draw(self, walk: GridTraversal) -> None:
        """Fig. 6, for the occlusion-buffer variant."""
        tests = [(self.test_key(walk, 0), 0)]
        draws: list[tuple[float, int]] = []
        while tests or draws:
            if draws and (not tests or self.draws_first(draws[0][0], tests[0][0])):
                self.draw_leaf(walk, heappop(draws)[1])
                continue
            _, node = heappop(tests)
            if self.is_occluded(walk, node):
                continue
            for child in self.children(walk, node):
                heappush(tests, (self.test_key(walk, child), child))
            if walk.unit[node] != INNER:
                heappush(draws, (self.draw_key(walk, node), node))

    def children(self, walk: GridTraversal, node: int) -> range:
        first = int(walk.nodes.first_child[node])
        return range(first, first + int(walk.nodes.children[node]))

    def is_occluded(self, walk: GridTraversal, node: int) -> bool:
        """Figs. 2 and 3."""
        area = walk.area[node]
        self.observe("test", node=node, area=area, depth=walk.depth[node], sure=walk.sure[node])
        if walk.sure[node]:
            return False
        if area[0] >= area[2] or area[1] >= area[3]:
            return True
        free, internal, border = self.scan(walk, node)
        hidden = (
            not free
            and not any(self.ask_internal(walk, cell, walk.depth[node]) for cell in internal)
            and not any(self.ask_border(walk, cell, node) for cell in border)
        )
        if not internal and not border:
            stats = walk.frame.stats
            stats.tests_skipped = (stats.tests_skipped or 0) + 1
        elif not free and walk.unit[node] != INNER:
            walk.frame.note_asked(np.array([walk.unit[node]]))
        self.observe("tested", node=node, hidden=hidden)
        return hidden

    def draw_leaf(self, walk: GridTraversal, node: int) -> None:
        unit = walk.unit[node]
        walk.waiting.append(unit)
        self.mark(walk, node)
        self.observe("mark", area=walk.area[node], unit=unit)
        if self.probability > 0.0:
            add_coverage(walk.grid, walk.frame.view, self.scene, self.units, self.opaque, unit)
        if self.updates == "busy":
            self.update_all(walk, node)

    def update_all(self, walk: GridTraversal, node: int) -> None:
        """Busy: ask every cell where a leaf was drawn. A query that only compares is asked
        about the leaf's farthest depth."""
        assert self.areas is not None
        rows, columns = walk.grid.cells(walk.area[node])
        far = max(walk.far[node], walk.frame.view.camera.near)
        depth = float(self.areas.depth_of(np.array([far]))[0])
        for row in range(rows.start, rows.stop):
            for column in range(columns.start, columns.stop):
                if not walk.grid.is_current((column, row)):
                    self.ask_internal(walk, (column, row), depth)

    def any_free(self, walk: GridTraversal, cell: Cell, area: Area, kind: str) -> bool:
        assert self.areas is not None
        self.flush(walk)
        with phase(walk.frame.stats, "query"):
            free = self.areas.any_free(area)
        self.observe("query", kind=kind, cell=cell, area=area, free=free)
        return free

    def reach(
        self, walk: GridTraversal, cell: Cell, area: Area, depth: float, kind: str
    ) -> tuple[float, float]:
        assert self.areas is not None
        self.flush(walk)
        with phase(walk.frame.stats, "query"):
            reached, farthest = self.areas.reach(area, depth)
        self.observe("query", kind=kind, cell=cell, area=area, reached=reached, farthest=farthest)
        return reached, farthest

    def flush(self, walk: GridTraversal) -> None:
        """Draw what waits."""
        assert self.areas is not None
        if walk.waiting:
            units = np.array(walk.waiting)
            walk.waiting.clear()
            self.draw(walk.frame, units)
            with phase(walk.frame.stats, "query"):
                self.areas.drawn(units)


def _pixels(area: Area) -> int:
    return (area[2] - area[0]) * (area[3] - area[1])


def _cells(found: Int64) -> list[Cell]:
    return [(x, y) for x, y in found.tolist()]


def _within(name: str, value: float, least: float, most: float | None) -> None:
    if value < least or (most is not None and value > most):
        until = "or more" if most is None else f"to {most}"
        raise InputError(f"{name} is {value}", place=name, fix=f"give {least} {until}")
