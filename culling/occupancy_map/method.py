"""The Occupancy Map: Staneker, Bartz, Meissner, "Improving Occlusion Query Efficiency with
Occupancy Maps", PVG 2003.

The map is a bit for each tile of the screen, 2,048 bytes in all, set where something may have
been drawn. A shape whose screen rectangle holds an unset tile cannot be hidden there, so its
query is skipped and the shape drawn (section 3.1). A map can never cull: it only saves queries.

With five maps (section 3.2) the first records what is drawn, and four arrange the rest into
five lists: a shape joins the first list whose map has an unset tile under it, and marks that
map; what all four show as covered joins the fifth. All queries of a list go out together, then
its visible shapes are drawn, then comes the next list.

Departures from the paper:

- The text's tile of "4 * 48" pixels for 1024 x 768 is 8 x 6, 48 pixels: 128 x 128 tiles.
- A rectangle is that of the box clipped at the near plane, so a box around the eye marks the
  tiles that it may touch and not always all.
- A shape whose rectangle meets no pixel is left out, as outside the view.
- The paper says that the first map stores where geometry was rendered, not how it learns that.
  Here a drawn shape marks the tiles under each of its parts: its triangles by the cells of a
  grid over its box, `parts` per side, each cell with a box of its own. With `parts=1` it marks
  under its whole box; two per side are what gives the saving of the paper on its vessels
  (`visref tables` has both).
- What a list's queries found visible is marked in the first map too, so that it always holds
  everything drawn.
- Section 6.1 proposes a second thread that arranges the lists while what shows at once is
  drawn: `thread=true`. The first map alone says what shows at once, and no other map hangs on
  what is drawn, so the lists are the same.
- Section 6.1 proposes to test the corners first. For the lookup that cannot change the answer
  (corners lie in the rectangle); for the query it is `corners=true`.
- Section 6.1 also proposes to cull by screen size from the lookup's rectangle: `min_pixels`.
  That misses visible objects, so the method then only promises to be measured. A level of detail
  by the same rectangle would draw other triangles than the unit's own, which is no drawing here;
  `visref_experiments.occupancy_map_scenes.detail` measures what it would save.

With single queries a shape that the map shows as covered stays covered whatever the answers are. So
the traversal goes on past shapes that wait for answers, up to the first that would be drawn at
once: that one waits for what they mark. It is a call for each such run, and not for each query.
"""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from visref.culler import Option, Promise
from visref.errors import InputError
from visref.scene import Int32, Int64, Scene, Units
from visref_culling.boxes.conservative import growth_of_box, inflated, nearest_depth
from visref_culling.boxes.rectangles import projection_of, screen_rectangles
from visref_culling.gl.changes import Changes, taken
from visref_culling.gl.view import View
from visref_culling.method import GL_OPTIONS, QUERY_OPTIONS, Frame, GLCuller, phase
from visref_culling.occupancy_map.parts import MOST_CELLS, parts_of
from visref_culling.occupancy_map.tiles import (
    DRAW_NOW,
    OUTSIDE,
    TILES,
    UNDECIDED,
    WORDS,
    Grid,
    Parts,
    Projection,
    Tiles,
    arrange,
    arrange_lists,
    mark_shapes,
    tiles_under,
)


class OccupancyMapCulling(GLCuller):
    """One map in front of the queries, or five that arrange them; see the module."""

    name = "occupancy-map"
    memory = 0
    summary = "Staneker 2003: screen tiles tell which queries to skip, and which to ask together"
    notes_asked = True
    options: ClassVar[Mapping[str, Option]] = {
        "maps": Option(5, "one map, or one and four that arrange five query lists", (1, 5)),
        "query": Option(
            "auto",
            "wait for each query, or a batch of them, or one instanced draw; auto is sync for "
            "one map and batch for five",
            ("auto", "sync", "batch", "instanced"),
        ),
        "backfaces": QUERY_OPTIONS["backfaces"],
        "parts": Option(2, "a drawn shape marks by the cells of a grid of so many a side"),
        "scale": Option(
            "window",
            "tiles cover the window, or the scene's box on screen while it is wholly in view",
            ("window", "scene"),
        ),
        "thread": Option(False, "arrange the lists in a second thread while what shows is drawn"),
        "corners": Option(False, "ask a box's eight corners first, the box only if all fail"),
        "min_pixels": Option(0, "leave out what is smaller on its longer side; not conservative"),
        **GL_OPTIONS,
    }

    def __init__(
        self,
        *,
        maps: int = 5,
        query: str = "auto",
        backfaces: bool = False,
        parts: int = 2,
        scale: str = "window",
        thread: bool = False,
        corners: bool = False,
        min_pixels: int = 0,
        depth: int = 24,
        fragments: bool = False,
    ) -> None:
        super().__init__(depth=depth, fragments=fragments)
        if min_pixels < 0:
            raise InputError(
                f"min_pixels is {min_pixels}", place="min_pixels", fix="give 0 or more pixels"
            )
        if not 1 <= parts <= MOST_CELLS:
            raise InputError(
                f"parts is {parts}", place="parts", fix=f"give 1 to {MOST_CELLS} cells a side"
            )
        self.cells = parts
        self.way = {1: "sync", 5: "batch"}[maps] if query == "auto" else query
        self.query_back_faces = backfaces
        self.scale = scale
        self.second: ThreadPoolExecutor | None = None
        if thread:
            self.second = ThreadPoolExecutor(1, "arranging")
        self.corners = corners
        self.min_pixels = min_pixels
        if min_pixels:
            self.promise = Promise.APPROXIMATE
        self.lists = maps
        # Only the paper's first form asks one shape at a time and looks again after each.
        self.one_by_one = maps == 1 and self.way == "sync"
        self.maps = np.zeros((maps, WORDS), np.uint32)

    def prepare(self, scene: Scene) -> Units:
        units = super().prepare(scene)
        self.part_bounds, offsets = parts_of(scene, units, self.cells)
        self.parts = Units(offsets, np.arange(len(self.part_bounds), dtype=np.int32), "part")
        return units

    def follow(self, changes: Changes) -> None:
        super().follow(changes)
        units = changes.units(self.units)
        own, offsets = parts_of(self.scene, taken(self.units, units), self.cells)
        # All parts, and those made anew behind them; then each unit's in the order of the units.
        sizes, first = self.parts.sizes.copy(), self.parts.offsets[:-1].copy()
        sizes[units], first[units] = np.diff(offsets), len(self.part_bounds) + offsets[:-1]
        ends = np.cumsum(sizes)
        at = np.repeat(first - (ends - sizes), sizes) + np.arange(sizes.sum())
        self.part_bounds = np.concatenate([self.part_bounds, own])[at]
        parts = np.arange(len(at), dtype=np.int32)
        self.parts = Units(np.concatenate([[0], ends]), parts, "part")

    def close(self) -> None:
        super().close()
        if self.second is not None:
            self.second.shutdown()

    def decide(self, frame: Frame) -> None:
        with phase(frame.stats, "arrange"):
            self.clear_maps()
            rectangles = self.rectangles(frame)
            tiles = self.tiles(frame, rectangles)
            list_of = np.full(len(frame.ids), UNDECIDED, np.int8)
            list_of[self.left_out(frame, rectangles)] = OUTSIDE
        self.observe("tiles", units=frame.ids, rectangles=rectangles, tiles=tiles)
        if self.one_by_one:
            self.ask_one_by_one(frame, tiles, list_of)
        else:
            self.ask_in_lists(frame, tiles, list_of)
        self.observe(
            "lists",
            units=frame.ids,
            list_of=list_of,
            sure=frame.sure,
            maps=self.maps,
            tiles=tiles,
        )
        saved = (list_of == DRAW_NOW) & ~frame.sure
        frame.stats.tests_skipped = int(np.count_nonzero(saved))

    def ask_one_by_one(self, frame: Frame, tiles: Tiles, list_of: NDArray[np.int8]) -> None:
        """Section 3.1: front to back, a query wherever the map shows everything as set.
        `list_of`: (k,) int8, one per shape, is filled in."""
        start = 0
        while start < len(list_of):
            with phase(frame.stats, "arrange"):
                stop = self.arrange(tiles, frame.sure, list_of, start, stop_after_run=True)
                decided = list_of[start:stop]
                skipped = start + np.flatnonzero(decided == DRAW_NOW)
                run = start + np.flatnonzero(decided > DRAW_NOW)
            self.draw(frame, skipped)
            shown = []
            for number in range(len(run)):
                place = run[number : number + 1]
                if self.shown(frame, place)[0]:
                    self.draw(frame, place)
                    shown.append(place)
            if shown:
                with phase(frame.stats, "arrange"):
                    self.mark_drawn(tiles, np.concatenate(shown))
            start = stop

    def ask_in_lists(self, frame: Frame, tiles: Tiles, list_of: NDArray[np.int8]) -> None:
        """Section 3.2: arrange everything, draw what shows, then list after list. `list_of`:
        (k,) int8, one per shape, is filled in."""
        with phase(frame.stats, "arrange"):
            self.arrange(tiles, frame.sure, list_of, 0, stop_after_run=False)
            at_once = np.flatnonzero(list_of == DRAW_NOW)
            arranging = self.begin_lists(tiles, list_of)
        self.draw(frame, at_once)
        with phase(frame.stats, "arrange"):
            if arranging is not None:
                arranging.result()
        for number in self.list_numbers():
            self.ask(frame, tiles, np.flatnonzero(list_of == number))

    def begin_lists(self, tiles: Tiles, list_of: NDArray[np.int8]) -> Future[None] | None:
        """Arrange the lists, at once or in the second thread: no map that this needs hangs on what
        is drawn meanwhile. `list_of`: (k,) int8, one per shape, is filled in."""
        if self.second is not None:
            return self.second.submit(self.arrange_lists, tiles, list_of)
        self.arrange_lists(tiles, list_of)
        return None

    def ask(self, frame: Frame, tiles: Tiles, places: Int64) -> None:
        """All queries of a list, then its visible shapes. `places`: (n,) int64 in the frame's
        order."""
        if not len(places):
            return
        visible = places[self.shown(frame, places)]
        self.draw(frame, visible)
        with phase(frame.stats, "arrange"):
            self.mark_drawn(tiles, visible)

    def shown(self, frame: Frame, places: Int64) -> NDArray[np.bool_]:
        """(n,) bool: which of these shapes, (n,) int64 places, their queries show."""
        if not self.corners:
            return self.query(frame, places)
        visible = self.query(frame, places, corners_only=True)
        unsure = np.flatnonzero(~visible)
        if len(unsure):
            visible[unsure] = self.query(frame, places[unsure])
        return visible

    # The steps.

    def clear_maps(self) -> None:
        self.maps[:] = 0

    def list_numbers(self) -> range:
        """The lists in the order asked."""
        return range(1, self.lists + 1)

    def rectangles(self, frame: Frame) -> Int32:
        """(k, 4) int32 pixels x0, y0, x1, y1, inclusive, within the window; empty where x1 <
        x0 or y1 < y0."""
        return screen_rectangles(frame.view, frame.boxes)

    def left_out(self, frame: Frame, rectangles: Int32) -> NDArray[np.bool_]:
        """(k,) bool: shapes that meet no pixel, or are too small to matter. `rectangles`:
        (k, 4) int32 pixels."""
        width, height = (rectangles[:, 2:] - rectangles[:, :2] + 1).T
        small = (np.maximum(width, height) < self.min_pixels) & ~frame.sure
        result: NDArray[np.bool_] = (width <= 0) | (height <= 0) | small
        return result

    def region(self, view: View) -> tuple[int, int, int, int]:
        """Pixels x0, y0, x1, y1, inclusive, that the map's tiles are spread over."""
        camera = view.camera
        window = (0, 0, camera.width - 1, camera.height - 1)
        if self.scale == "window" or not self.scene.triangle_count:
            return window
        whole = inflated(view, self.scene.bounds[None])
        rectangle = screen_rectangles(view, whole, clip_to_window=False)[0]
        x0, y0, x1, y1 = (int(side) for side in rectangle)
        inside = x0 >= 0 and y0 >= 0 and x1 < camera.width and y1 < camera.height
        in_front = nearest_depth(view, whole)[0] > camera.near
        return (x0, y0, x1, y1) if inside and in_front else window

    def tiles(self, frame: Frame, rectangles: Int32) -> Tiles:
        """What each shape asks about, and what it marks once it is drawn. `rectangles`: (k, 4)
        int32 pixels."""
        x0, y0, x1, y1 = self.region(frame.view)
        grid = Grid(x0, y0, -(-(x1 - x0 + 1) // TILES), -(-(y1 - y0 + 1) // TILES))
        first = np.concatenate([[0], np.cumsum(self.parts.sizes[frame.ids])])
        marked = np.zeros((first[-1], 4), np.int32)
        marked[:, 2:] = -1
        parts = Parts(self.part_bounds, self.parts.offsets[frame.ids], first, marked)
        view = frame.view
        projection = Projection(view.camera.eye, growth_of_box(view), *projection_of(view))
        return Tiles(tiles_under(rectangles, grid), parts, projection, grid)

    def arrange(
        self,
        tiles: Tiles,
        sure: NDArray[np.bool_],
        list_of: NDArray[np.int8],
        start: int,
        *,
        stop_after_run: bool,
    ) -> int:
        """Decide shapes from `start` on, front to back, by the first map: `tiles.arrange`. `sure`:
        (k,) bool and `list_of`: (k,) int8, one per shape."""
        stopped = arrange(
            tiles.under,
            tiles.parts,
            tiles.projection,
            tiles.grid,
            sure,
            self.maps[0],
            list_of,
            start,
            stop_after_run,
        )
        return int(stopped)

    def arrange_lists(self, tiles: Tiles, list_of: NDArray[np.int8]) -> None:
        """Spread what has to be asked over the lists. `list_of`: (k,) int8, one per shape."""
        arrange_lists(tiles.under, self.maps, list_of)

    def mark_drawn(self, tiles: Tiles, places: Int64) -> None:
        """Record shapes, (n,) int64 places, that a query showed, and that are drawn, in the
        first map."""
        mark_shapes(self.maps[0], tiles.parts, tiles.projection, tiles.grid, places)
