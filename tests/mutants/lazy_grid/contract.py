"""What the lazy grid promises to save, checked by watching its steps.

A cell is updated only when it is asked and outdated, and cells that are up to date are asked
first. `Replay` keeps a record of its own of every cell, from the draws and the answers alone, and
compares: was a question needed, was it the right one to ask first, and does the answer follow from
what is known? None of the method's own code is used.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from tests.mutants.harness import Suite, Trace

SUITE = Suite(
    {
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
    },
    watched=("walk_through_a_city", "crowd", "odd_viewports"),
)


@SUITE.contract
def a_cell_is_asked_whole_only_where_it_may_not_know(trace: Trace) -> Iterator[str]:
    """What is known of it does not decide the question."""
    yield from replay(trace).problems["outdated"]


@SUITE.contract
def cells_that_know_are_looked_up_first(trace: Trace) -> Iterator[str]:
    """No pixel is looked at while a cell that is up to date shows the box."""
    yield from replay(trace).problems["first"]


@SUITE.contract
def border_cells_come_last_and_only_their_share_is_asked(trace: Trace) -> Iterator[str]:
    """They are asked after internal ones, and only where box and cell meet."""
    yield from replay(trace).problems["border"]


@SUITE.contract
def each_answer_follows_from_what_is_known(trace: Trace) -> Iterator[str]:
    """A box counts as visible only if an answer, or a cell that is up to date, shows it, and as
    hidden only if every cell hides it."""
    yield from replay(trace).problems["proof"]


@SUITE.contract
def nothing_is_asked_but_for_a_test(trace: Trace) -> Iterator[str]:
    """Not so with update=busy."""
    yield from replay(trace).problems["lazy"]


@lru_cache(maxsize=1)
def replay(trace: Trace) -> Replay:
    """A frame followed step by step."""
    options = trace.options
    made = Replay(
        options.get("cell", 32),
        options.get("buffer", "occlusion") == "occlusion",
        options.get("update") == "busy",
    )
    for event in trace.events:
        getattr(made, f"on_{event.step}", lambda **_: None)(**event.data)
    return made


@dataclass
class Cell:
    """Bounds on the farthest depth in a cell; free and covered pixels are 1 and 0 with the
    occlusion buffer. `reached` is forgotten when something is drawn, `farthest` never."""

    reached: float
    farthest: float
    untouched: bool = True


@dataclass
class Replay:
    """The cells of one frame. `tests` counts box tests, `by_query` those that saw pixels."""

    size: int
    occlusion: bool
    busy: bool = False
    problems: dict[str, list[str]] = field(
        default_factory=lambda: {k: [] for k in ("outdated", "first", "border", "proof", "lazy")}
    )
    tests: int = 0
    by_query: int = 0

    def on_grid(self, grid):
        self.width, self.height = grid.width, grid.height
        columns, rows = -(-self.width // self.size), -(-self.height // self.size)
        z_max = 1.0 if self.occlusion else float(grid.farthest.max())
        self.cells = {(x, y): Cell(z_max, z_max) for x in range(columns) for y in range(rows)}
        self.test = None

    def whole(self, cell):
        """The pixels x0, y0, x1, y1 of a cell, the last ones excluded."""
        x, y = cell[0] * self.size, cell[1] * self.size
        return x, y, min(x + self.size, self.width), min(y + self.size, self.height)

    def shared(self, cell, area):
        """Those that a cell and an area share; empty ones are None."""
        (a, b, c, d), (x0, y0, x1, y1) = self.whole(cell), area
        found = max(a, x0), max(b, y0), min(c, x1), min(d, y1)
        return found if found[0] < found[2] and found[1] < found[3] else None

    def internal(self, cell, area):
        return self.shared(cell, area) == self.whole(cell)

    def on_mark(self, area, unit):
        for cell, known in self.cells.items():
            if self.shared(cell, area):
                known.reached, known.untouched = -np.inf, False

    def on_test(self, node, area, depth, sure):
        self.tests += 1
        self.test = area
        self.depth = 1.0 if self.occlusion else depth
        self.sure = sure
        self.shown, self.hidden_shares, self.asked, self.asked_border = sure, set(), False, False

    def known_to_show(self):
        """Cells that are up to date and show the box tested."""
        return [
            cell
            for cell, known in self.cells.items()
            if self.shared(cell, self.test)
            and (
                self.depth <= known.reached
                if self.internal(cell, self.test)
                else known.untouched and self.depth <= known.reached
            )
        ]

    def on_query(self, kind, cell, area, free=None, reached=None, farthest=None):
        known = self.cells[cell]
        if self.occlusion:
            reached, farthest = (1.0, 1.0) if free else (-np.inf, 0.0)
        if self.test is None:
            if not self.busy:
                self.problems["lazy"].append(f"cell {cell} is asked outside a test")
            if known.reached == known.farthest:
                self.problems["outdated"].append(f"cell {cell} is up to date and asked")
        else:
            self.check_question(kind, cell, area, known)
            if self.depth <= reached:
                self.shown = True
            elif kind == "border":
                self.hidden_shares.add(cell)
        known.reached = max(known.reached, reached)
        if kind == "cell":
            known.farthest = min(known.farthest, farthest)

    def check_question(self, kind, cell, area, known):
        if not self.asked and (showing := self.known_to_show()):
            self.problems["first"].append(f"cell {cell} is asked though {showing[0]} shows the box")
        self.asked = True
        if kind == "cell":
            if self.depth <= known.reached or self.depth > known.farthest:
                self.problems["outdated"].append(f"cell {cell} is asked what it knows")
            if self.asked_border:
                self.problems["border"].append(f"internal cell {cell} is asked after border cells")
            return
        self.asked_border = True
        shared = self.shared(cell, self.test)
        if area != shared:
            self.problems["border"].append(f"{area} is asked of cell {cell}, not {shared}")

    def on_tested(self, node, hidden):
        if self.sure and hidden:
            self.problems["proof"].append("a box that needs no test is hidden")
        self.by_query += self.asked
        if not hidden and not self.shown and not self.known_to_show():
            self.problems["proof"].append(f"nothing shows the box in {self.test}")
        if hidden:
            for cell, known in self.cells.items():
                covers = self.depth > known.farthest or cell in self.hidden_shares
                if self.shared(cell, self.test) and not covers:
                    self.problems["proof"].append(f"cell {cell} does not hide the box")
        self.test = None
