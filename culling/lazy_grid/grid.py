"""The lazy occlusion grid: what is known of each cell, and which cells of a box must be asked.

Both variants scan a box's cells in the order of Figs. 2 and 3: all that can be decided from
states first, internal cells before border cells; what cannot comes back as two lists.

A cell is internal to a box if all of its pixels are in the box's area; a cell at the image's
right or lower edge has only the pixels that the image has.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.scene import Float64, Int64
from visref_culling.lazy_grid.nodes import Area

# States of the occlusion-buffer variant.
FREE, PARTLY_FREE, OUTDATED, FULL = 0, 1, 2, 3

# What is known of a cell that nobody asked since something was drawn there.
UNKNOWN = -np.inf


class Grid(ABC):
    """One frame's cells. `cell`: pixels on a side; `columns`, `rows` cover the whole image.

    `covered`: (rows, columns) float64, drawn primitives' areas as a share of each cell's, summed
    (section 6: a cell with less than `likely` of it counts as free without asking).
    """

    def __init__(self, width: int, height: int, cell: int, likely: float) -> None:
        self.width, self.height, self.cell, self.likely = width, height, cell, likely
        self.columns, self.rows = self.cells_of(width), self.cells_of(height)
        self.covered: Float64 = np.zeros((self.rows, self.columns))
        self._internal = np.zeros((self.rows * self.columns, 2), np.int64)
        self._border = np.zeros_like(self._internal)

    def cells_of(self, pixels: int) -> int:
        return -(-pixels // self.cell)

    def area(self, cell: tuple[int, int]) -> Area:
        """The pixels of a cell (column, row)."""
        x, y = cell[0] * self.cell, cell[1] * self.cell
        return x, y, min(x + self.cell, self.width), min(y + self.cell, self.height)

    def cells(self, area: Area) -> tuple[slice, slice]:
        """Rows and columns of the cells that meet an area."""
        x0, y0, x1, y1 = area
        size = self.cell
        if x0 >= x1 or y0 >= y1:
            return slice(0, 0), slice(0, 0)
        return (
            slice(y0 // size, min(-(-y1 // size), self.rows)),
            slice(x0 // size, min(-(-x1 // size), self.columns)),
        )

    def spans(self, area: Area, all_internal: bool) -> Int64:
        """(8,) int64: columns and rows of a box's cells, and of its internal cells."""
        rows, columns = self.cells(area)
        x0, y0, x1, y1 = area
        size = self.cell
        if all_internal:
            inner = columns.start, rows.start, columns.stop, rows.stop
        else:
            inner = (
                -(-x0 // size),
                -(-y0 // size),
                self.columns if x1 == self.width else x1 // size,
                self.rows if y1 == self.height else y1 // size,
            )
        return np.array([columns.start, rows.start, columns.stop, rows.stop, *inner])

    @abstractmethod
    def scan(self, spans: Int64, depth: float) -> tuple[bool, Int64, Int64]:
        """Whether some cell is known to be free, and the internal and border cells to ask,
        (k, 2) int64 columns and rows each, good until the next scan. `spans`: (8,) int64, as
        `spans` gives."""

    @abstractmethod
    def mark(self, area: Area) -> None:
        """Something was drawn in the area: its cells are outdated."""

    @abstractmethod
    def is_current(self, cell: tuple[int, int]) -> bool:
        """Whether the cell's state holds for all that is drawn by now."""


class OcclusionGrid(Grid):
    """Section 3.1. `state`: (rows, columns) uint8; full overrides outdated."""

    def __init__(self, width: int, height: int, cell: int, likely: float) -> None:
        super().__init__(width, height, cell, likely)
        self.state = np.full((self.rows, self.columns), FREE, np.uint8)

    def scan(self, spans: Int64, depth: float) -> tuple[bool, Int64, Int64]:
        """As `Grid.scan`, from states: `spans` (8,) int64, cells (k, 2) int64 columns and rows."""
        free, internal, border = _scan_states(
            self.state, self.covered, self.likely, spans, self._internal, self._border
        )
        return free, self._internal[:internal], self._border[:border]

    def mark(self, area: Area) -> None:
        part = self.state[self.cells(area)]
        part[part != FULL] = OUTDATED

    def is_current(self, cell: tuple[int, int]) -> bool:
        return bool(self.state[cell[1], cell[0]] != OUTDATED)

    def set(self, cell: tuple[int, int], *, full: bool) -> None:
        """A query of the whole cell has answered."""
        self.state[cell[1], cell[0]] = FULL if full else PARTLY_FREE

    def set_partly_free(self, cell: tuple[int, int]) -> None:
        """A free pixel was found in the cell."""
        self.state[cell[1], cell[0]] = PARTLY_FREE


class DepthGrid(Grid):
    """Section 3.2, with a cell's z_far known between two bounds.

    `farthest`: (rows, columns) float64, no pixel of the cell is farther; it stays true when
    more is drawn. `reached`: some pixel is at least so far, `UNKNOWN` once something was drawn.
    A query that returns the true z_far sets both to it; one that only compares moves one.
    `untouched`: nothing was drawn in the cell in this frame.
    """

    def __init__(self, width: int, height: int, cell: int, likely: float, z_max: float) -> None:
        super().__init__(width, height, cell, likely)
        shape = (self.rows, self.columns)
        self.farthest: Float64 = np.full(shape, z_max)
        self.reached: Float64 = np.full(shape, z_max)
        self.untouched = np.full(shape, True)

    def scan(self, spans: Int64, depth: float) -> tuple[bool, Int64, Int64]:
        """As `Grid.scan`, from depths: `spans` (8,) int64, cells (k, 2) int64 columns and rows."""
        free, internal, border = _scan_depths(
            self.farthest,
            self.reached,
            self.untouched,
            self.covered,
            self.likely,
            depth,
            spans,
            self._internal,
            self._border,
        )
        return free, self._internal[:internal], self._border[:border]

    def mark(self, area: Area) -> None:
        cells = self.cells(area)
        self.reached[cells] = UNKNOWN
        self.untouched[cells] = False

    def is_current(self, cell: tuple[int, int]) -> bool:
        return bool(self.reached[cell[1], cell[0]] == self.farthest[cell[1], cell[0]])

    def learn(self, cell: tuple[int, int], reached: float, farthest: float) -> None:
        """A query of the whole cell has answered."""
        column, row = cell
        self.reached[row, column] = max(self.reached[row, column], reached)
        self.farthest[row, column] = min(self.farthest[row, column], farthest)

    def learn_reached(self, cell: tuple[int, int], reached: float) -> None:
        """A pixel at least so far was found in the cell."""
        self.reached[cell[1], cell[0]] = max(self.reached[cell[1], cell[0]], reached)


@njit()
def _scan_states(
    state: NDArray[Any],
    covered: NDArray[Any],
    likely: float,
    spans: NDArray[Any],
    internal: NDArray[Any],
    border: NDArray[Any],
) -> tuple[bool, int, int]:
    """Fig. 2's two functions without pixel queries."""
    x0, y0, x1, y1, inner_x0, inner_y0, inner_x1, inner_y1 = spans
    internals = borders = 0
    for y in range(inner_y0, inner_y1):
        for x in range(inner_x0, inner_x1):
            if state[y, x] == FULL:
                continue
            if state[y, x] != OUTDATED or covered[y, x] < likely:
                return True, 0, 0
            internal[internals, 0], internal[internals, 1] = x, y
            internals += 1
    for y in range(y0, y1):
        inner_row = inner_y0 <= y < inner_y1
        for x in range(x0, x1):
            if (inner_row and inner_x0 <= x < inner_x1) or state[y, x] == FULL:
                continue
            if state[y, x] == FREE or covered[y, x] < likely:
                return True, 0, 0
            border[borders, 0], border[borders, 1] = x, y
            borders += 1
    return False, internals, borders


@njit()
def _scan_depths(
    farthest: NDArray[Any],
    reached: NDArray[Any],
    untouched: NDArray[Any],
    covered: NDArray[Any],
    likely: float,
    depth: float,
    spans: NDArray[Any],
    internal: NDArray[Any],
    border: NDArray[Any],
) -> tuple[bool, int, int]:
    """Fig. 3's two functions without pixel queries.

    Its border test `z_far = z_max -> visible` is asked of untouched cells alone. As printed it
    fires for every cell with a single pixel of background too, up to date or not, so that
    nothing is ever hidden behind a horizon, which is what border cells are there for.
    """
    x0, y0, x1, y1, inner_x0, inner_y0, inner_x1, inner_y1 = spans
    internals = borders = 0
    for y in range(inner_y0, inner_y1):
        for x in range(inner_x0, inner_x1):
            if depth > farthest[y, x]:
                continue
            if depth <= reached[y, x] or covered[y, x] < likely:
                return True, 0, 0
            internal[internals, 0], internal[internals, 1] = x, y
            internals += 1
    for y in range(y0, y1):
        inner_row = inner_y0 <= y < inner_y1
        for x in range(x0, x1):
            if (inner_row and inner_x0 <= x < inner_x1) or depth > farthest[y, x]:
                continue
            if untouched[y, x] or covered[y, x] < likely:
                return True, 0, 0
            border[borders, 0], border[borders, 1] = x, y
            borders += 1
    return False, internals, borders
