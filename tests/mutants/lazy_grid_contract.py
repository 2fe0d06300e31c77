"""What the lazy grid promises to save, checked by watching its steps.

`Watch` is an observer that keeps its own record of every cell, from the draws and the answers
alone, and compares: was a question needed, was it the right one to ask first, and does the
answer follow from what is known? None of the method's own code is used. `problems` holds a
line for each departure, its first word naming the rule:

- outdated: a cell is asked whole only if what is known of it does not decide the question;
- first: no pixel is looked at while a cell that is up to date shows the box;
- border: border cells are asked after internal ones, and only where box and cell meet;
- proof: a box counts as visible only if an answer, or a cell that is up to date, shows it, and
  as hidden only if every cell hides it;
- lazy: nothing is asked but for a test (not so with update=busy).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


@dataclass
class Cell:
    """Bounds on the farthest depth in a cell; free and covered pixels are 1 and 0 with the
    occlusion buffer. `reached` is forgotten when something is drawn, `farthest` never."""

    reached: float
    farthest: float
    untouched: bool = True


@dataclass
class Watch:
    """Observer of one lazy grid. `tests` counts box tests, `by_query` those that saw pixels."""

    size: int
    occlusion: bool
    busy: bool = False
    problems: list[str] = field(default_factory=list)
    tests: int = 0
    by_query: int = 0

    def __call__(self, step, data):
        getattr(self, f"on_{step}", lambda **_: None)(**data)

    def on_grid(self, grid):
        self.width, self.height = grid.width, grid.height
        columns, rows = -(-self.width // self.size), -(-self.height // self.size)
        z_max = 1.0 if self.occlusion else float(grid.farthest.max())
        self.cells = {(x, y): Cell(z_max, z_max) for x in range(columns) for y in range(rows)}
        self.test = None

    def pixels(self, cell):
        """The set of a cell's pixels, as two ranges."""
        x, y = cell[0] * self.size, cell[1] * self.size
        return (
            range(x, min(x + self.size, self.width)),
            range(y, min(y + self.size, self.height)),
        )

    def meets(self, cell, area):
        columns, rows = self.pixels(cell)
        return (
            area[0] < area[2]
            and area[1] < area[3]
            and columns.start < area[2]
            and area[0] < columns.stop
            and rows.start < area[3]
            and area[1] < rows.stop
        )

    def internal(self, cell, area):
        columns, rows = self.pixels(cell)
        return (
            area[0] <= columns.start
            and columns.stop <= area[2]
            and area[1] <= rows.start
            and rows.stop <= area[3]
        )

    def on_mark(self, area, unit):
        for cell, known in self.cells.items():
            if self.meets(cell, area):
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
            if self.meets(cell, self.test)
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
                self.problems.append(f"lazy: cell {cell} is asked outside a test")
            if known.reached == known.farthest:
                self.problems.append(f"outdated: cell {cell} is up to date and asked")
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
            self.problems.append(f"first: cell {cell} is asked though {showing[0]} shows the box")
        self.asked = True
        if kind == "cell":
            if self.depth <= known.reached or self.depth > known.farthest:
                self.problems.append(f"outdated: cell {cell} is asked what it knows")
            if self.asked_border:
                self.problems.append(f"border: internal cell {cell} is asked after border cells")
            return
        self.asked_border = True
        columns, rows = self.pixels(cell)
        x0, y0, x1, y1 = self.test
        shared = (
            max(x0, columns.start),
            max(y0, rows.start),
            min(x1, columns.stop),
            min(y1, rows.stop),
        )
        if area != shared:
            self.problems.append(f"border: {area} is asked of cell {cell}, not {shared}")

    def on_tested(self, node, hidden):
        if self.sure and hidden:
            self.problems.append("proof: a box that needs no test is hidden")
        self.by_query += self.asked
        if not hidden and not self.shown and not self.known_to_show():
            self.problems.append(f"proof: nothing shows the box in {self.test}")
        if hidden:
            for cell, known in self.cells.items():
                covers = self.depth > known.farthest or cell in self.hidden_shares
                if self.meets(cell, self.test) and not covers:
                    self.problems.append(f"proof: cell {cell} does not hide the box")
        self.test = None


def watched(culler, scene, cameras, **options):
    """The Watch of a culler over some frames, and what it drew."""
    watch = Watch(
        options.get("cell", 32),
        options.get("buffer", "occlusion") == "occlusion",
        options.get("update") == "busy",
    )
    culler.prepare(scene)
    culler.observer = watch
    drawn = [culler.cull(camera) for camera in cameras]
    culler.close()
    return watch, drawn
