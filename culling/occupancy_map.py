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
- Section 6.1 proposes to test the corners first. For the lookup that cannot change the answer
  (corners lie in the rectangle); for the query it is `corners=true`.
- Section 6.1 also proposes to cull by screen size from the lookup's rectangle: `min_pixels`.
  That misses visible objects, so the method then only promises to be measured.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.culler import Option, Promise
from visref.errors import InputError
from visref.scene import Float64, Int32, Int64, Scene, Units
from visref_culling.boxes.conservative import inflated, nearest_depth
from visref_culling.boxes.rectangles import screen_rectangles
from visref_culling.gl.changes import Changes, taken
from visref_culling.gl.view import View
from visref_culling.method import GL_OPTIONS, QUERY_OPTIONS, Frame, GLCuller, phase

TILES = 128  # a side
WORDS_PER_ROW = TILES // 32
WORDS = TILES * WORDS_PER_ROW  # 512 of 32 bits

# Of a shape's grid, a side; finer ones cost more to mark than their queries do.
MOST_CELLS = 32

# What becomes of a shape; lists count from 1.
OUTSIDE, DRAW_NOW, UNDECIDED = -1, 0, -2


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
        self.observe("lists", units=frame.ids, list_of=list_of, sure=frame.sure, maps=self.maps)
        saved = (list_of == DRAW_NOW) & ~frame.sure
        frame.stats.tests_skipped = int(np.count_nonzero(saved))

    def ask_one_by_one(self, frame: Frame, tiles: Tiles, list_of: NDArray[np.int8]) -> None:
        """Section 3.1: front to back, a query wherever the map shows everything as set.
        `list_of`: (k,) int8, one per shape, is filled in."""
        start = 0
        while start < len(list_of):
            with phase(frame.stats, "arrange"):
                stop = self.arrange(tiles, frame.sure, list_of, start, stop_at_list=True)
            skipped = np.arange(start, stop)
            self.draw(frame, skipped[list_of[start:stop] == DRAW_NOW])
            if stop < len(list_of):
                self.ask(frame, tiles, np.array([stop]))
            start = stop + 1

    def ask_in_lists(self, frame: Frame, tiles: Tiles, list_of: NDArray[np.int8]) -> None:
        """Section 3.2: arrange everything, draw what shows, then list after list. `list_of`:
        (k,) int8, one per shape, is filled in."""
        with phase(frame.stats, "arrange"):
            self.arrange(tiles, frame.sure, list_of, 0, stop_at_list=False)
        self.draw(frame, np.flatnonzero(list_of == DRAW_NOW))
        for number in self.list_numbers():
            self.ask(frame, tiles, np.flatnonzero(list_of == number))

    def ask(self, frame: Frame, tiles: Tiles, places: Int64) -> None:
        """All queries of a list, then its visible shapes. `places`: (n,) int64 in the frame's
        order."""
        if not len(places):
            return
        visible = np.zeros(len(places), np.bool_)
        if self.corners:
            visible |= self.query(frame, places, corners_only=True)
        unsure = np.flatnonzero(~visible)
        visible[unsure] = self.query(frame, places[unsure])
        self.draw(frame, places[visible])
        with phase(frame.stats, "arrange"):
            self.mark_drawn(tiles, places[visible])

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
        extent = rectangles[:, 2:] - rectangles[:, :2] + 1
        small = (extent.max(axis=1) < self.min_pixels) & ~frame.sure
        result: NDArray[np.bool_] = (extent.min(axis=1) <= 0) | small
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
        """What each shape asks about and what it would mark. `rectangles`: (k, 4) int32 pixels."""
        ids = frame.ids
        boxes = inflated(frame.view, self.part_bounds[self.parts.gather(ids.astype(np.int32))])
        first_part = np.concatenate([[0], np.cumsum(self.parts.sizes[ids])])
        parts = screen_rectangles(frame.view, boxes)
        return Tiles(
            self.tiles_under(frame, rectangles), self.tiles_under(frame, parts), first_part
        )

    def tiles_under(self, frame: Frame, rectangles: Int32) -> Int32:
        """(k, 4) int32 columns and rows of tiles under rectangles of pixels, (k, 4) int32."""
        x0, y0, x1, y1 = self.region(frame.view)
        size = np.array([-(-(x1 - x0 + 1) // TILES), -(-(y1 - y0 + 1) // TILES)] * 2)
        tiles = (rectangles - np.array([x0, y0, x0, y0])) // size
        # An inflated box may reach a pixel over the scene's own rectangle.
        result: Int32 = np.clip(tiles, 0, TILES - 1).astype(np.int32)
        empty = (rectangles[:, 2:] < rectangles[:, :2]).any(axis=1)
        result[empty] = (0, 0, -1, -1)
        return result

    def arrange(
        self,
        tiles: Tiles,
        sure: NDArray[np.bool_],
        list_of: NDArray[np.int8],
        start: int,
        *,
        stop_at_list: bool,
    ) -> int:
        """Decide shapes from `start` on, front to back, in `list_of` and the maps. Returns
        where it stopped: at the first that needs a query, if so told, else at the end. `sure`:
        (k,) bool and `list_of`: (k,) int8, one per shape."""
        return int(
            arrange(
                tiles.under,
                tiles.parts,
                tiles.first_part,
                sure,
                self.maps,
                list_of,
                start,
                stop_at_list,
            )
        )

    def mark_drawn(self, tiles: Tiles, places: Int64) -> None:
        """Record shapes, (n,) int64 places, that a query showed, and that are drawn, in the
        first map."""
        mark_shapes(self.maps[0], tiles.parts, tiles.first_part, places)


@dataclass(frozen=True, eq=False)
class Tiles:
    """Columns and rows of tiles, inclusive (c0, r0, c1, r1), of the k shapes of a frame.

    `under`: (k, 4) int32, under each shape's rectangle, which is what a lookup asks about.
    `parts`: (q, 4) int32, under the rectangle of each part of each shape, which is what
    drawing it marks; empty (c1 < c0) for a part out of view. Shape i has the parts
    `first_part[i]:first_part[i + 1]`.
    """

    under: Int32
    parts: Int32
    first_part: Int64


def parts_of(scene: Scene, units: Units, cells: int) -> tuple[Float64, Int64]:
    """Cut each unit into boxes of its triangles, by the cell of a grid over the unit's box that
    a triangle's middle lies in, `cells` per side. Returns bounds (m, 2, 3) float64 and offsets
    (u + 1,) int64; together a unit's boxes hold all of it."""
    corners = scene.vertices[scene.triangles[units.triangles]].astype(np.float64)
    low, high = corners.min(axis=1), corners.max(axis=1)
    unit = np.repeat(np.arange(units.count), units.sizes)
    bounds = scene.bounds_of(units)[unit]
    extent = bounds[:, 1] - bounds[:, 0]
    at = (0.5 * low + 0.5 * high - bounds[:, 0]) / np.where(extent > 0.0, extent, 1.0)
    at[extent < 0.0] = 0.0  # an absent unit's triangles are somewhere, and its box is nowhere
    cell = np.minimum((at * cells).astype(np.int64), cells - 1)
    key = unit * cells**3 + (cell[:, 0] * cells + cell[:, 1]) * cells + cell[:, 2]
    order = np.argsort(key, kind="stable")
    starts = np.flatnonzero(np.diff(key[order], prepend=-1))
    if not len(starts):
        return np.zeros((0, 2, 3)), np.zeros(units.count + 1, np.int64)
    boxes = np.stack(
        [
            np.minimum.reduceat(low[order], starts, axis=0),
            np.maximum.reduceat(high[order], starts, axis=0),
        ],
        axis=1,
    )
    offsets = np.searchsorted(unit[order][starts], np.arange(units.count + 1))
    return boxes, offsets


@njit(inline="always")
def covered(words: NDArray[Any], c0: int, r0: int, c1: int, r1: int) -> bool:
    """Whether every tile of columns c0...c1 and rows r0...r1 is set in a map, (WORDS,) uint32."""
    first, last = c0 >> 5, c1 >> 5
    for row in range(r0, r1 + 1):
        for word in range(first, last + 1):
            mask = np.uint32(0xFFFFFFFF)
            if word == first:
                mask &= np.uint32(0xFFFFFFFF) << np.uint32(c0 & 31)
            if word == last:
                mask &= np.uint32(0xFFFFFFFF) >> np.uint32(31 - (c1 & 31))
            if words[row * WORDS_PER_ROW + word] & mask != mask:
                return False
    return True


@njit(inline="always")
def mark(words: NDArray[Any], c0: int, r0: int, c1: int, r1: int) -> None:
    """Set every tile of columns c0...c1 and rows r0...r1 in a map, (WORDS,) uint32."""
    first, last = c0 >> 5, c1 >> 5
    for row in range(r0, r1 + 1):
        for word in range(first, last + 1):
            mask = np.uint32(0xFFFFFFFF)
            if word == first:
                mask &= np.uint32(0xFFFFFFFF) << np.uint32(c0 & 31)
            if word == last:
                mask &= np.uint32(0xFFFFFFFF) >> np.uint32(31 - (c1 & 31))
            words[row * WORDS_PER_ROW + word] |= mask


@njit()
def mark_shapes(
    words: NDArray[Any], parts: NDArray[Any], first_part: NDArray[Any], places: NDArray[Any]
) -> None:
    """Set the tiles of every part of the shapes at `places`, (k,), in a map, (WORDS,) uint32.

    `parts`, `first_part`: as of `Tiles`.
    """
    for place in places:
        for p in range(first_part[place], first_part[place + 1]):
            mark(words, parts[p, 0], parts[p, 1], parts[p, 2], parts[p, 3])


@njit()
def arrange(
    under: NDArray[Any],
    parts: NDArray[Any],
    first_part: NDArray[Any],
    sure: NDArray[Any],
    maps: NDArray[Any],
    list_of: NDArray[Any],
    start: int,
    stop_at_list: bool,
) -> int:
    """The traversal of `OccupancyMapCulling.arrange`, over all shapes in one go.

    `under`, `parts`, `first_part`: as of `Tiles`; `sure`: (k,) bool; `maps`: (maps, WORDS)
    uint32; `list_of`: (k,) int8.
    """
    for i in range(start, len(under)):
        if list_of[i] != UNDECIDED:
            continue
        c0, r0, c1, r1 = under[i, 0], under[i, 1], under[i, 2], under[i, 3]
        if sure[i] or not covered(maps[0], c0, r0, c1, r1):
            list_of[i] = DRAW_NOW
            for p in range(first_part[i], first_part[i + 1]):
                mark(maps[0], parts[p, 0], parts[p, 1], parts[p, 2], parts[p, 3])
            continue
        list_of[i] = len(maps)  # the last list takes what every arranging map shows covered
        for number in range(1, len(maps)):
            if not covered(maps[number], c0, r0, c1, r1):
                list_of[i] = number
                mark(maps[number], c0, r0, c1, r1)
                break
        if stop_at_list:
            return i
    return len(under)
