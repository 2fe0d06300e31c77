"""The occupancy map's traversal a step at a time, in plain Python.

The shipped traversal is compiled, goes on past shapes that wait for answers as long as none can
change what it decides, and arranges the lists by themselves. This is its reference, which decides
the same (`tests/culling/test_occupancy_map.py`), tells an observer of each lookup and mark, and
whose every step a test can break:

| step | what it decides |
|---|---|
| `clear_maps` | the maps at the frame's start (shipped) |
| `address` | word and bit of a tile |
| `covered` | whether every tile under a rectangle is set |
| `tiles_to_mark` | which tiles a rectangle marks |
| `mark_skipped` | that a shape drawn without a query marks |
| `mark_arranged` | that a shape joining a list marks |
| `mark_drawn` | that a shape found visible marks |
| `last_list` | where a shape goes that every map shows covered |
| `list_numbers`, `order`, `passes`, `query_state` | as shipped |

Events, with plain values: `lookup` (unit, map, tiles, covered) and `mark` (unit, map, tiles),
`tiles` being c0, r0, c1, r1, inclusive.
"""

from __future__ import annotations

import numpy as np

from visref_culling.boxes.conservative import inflated
from visref_culling.boxes.rectangles import screen_rectangles
from visref_culling.occupancy_map import OccupancyMapCulling
from visref_culling.occupancy_map.tiles import DRAW_NOW, TILES, UNDECIDED, WORDS_PER_ROW


class StepwiseOccupancyMap(OccupancyMapCulling):
    def decide(self, frame):
        self.units_in_order = frame.ids
        super().decide(frame)

    def tiles(self, frame, rectangles):
        """With the parts of all shapes, drawn or not."""
        found = super().tiles(frame, rectangles)
        bounds = self.part_bounds[self.parts.gather(frame.ids.astype(np.int32))]
        grid = found.grid
        for row, (x0, y0, x1, y1) in zip(
            found.parts.tiles,
            screen_rectangles(frame.view, inflated(frame.view, bounds)).tolist(),
            strict=True,
        ):
            if x0 <= x1 and y0 <= y1:
                columns = np.clip([(x - grid.x0) // grid.width for x in (x0, x1)], 0, TILES - 1)
                rows = np.clip([(y - grid.y0) // grid.height for y in (y0, y1)], 0, TILES - 1)
                row[:] = columns[0], rows[0], columns[1], rows[1]
        return found

    def arrange(self, tiles, sure, list_of, start, *, stop_after_run):
        """Section 3 as it is read: each shape is decided for good before the next, and where
        answers are waited for one at a time, it stops at each."""
        for place in range(start, len(tiles.under)):
            if list_of[place] != UNDECIDED:
                continue
            if sure[place] or not self.look_up(place, 0, tiles.under[place]):
                list_of[place] = DRAW_NOW
                self.mark_skipped(place, tiles)
                continue
            for number in range(1, self.lists):
                if not self.look_up(place, number, tiles.under[place]):
                    list_of[place] = number
                    self.mark_arranged(place, number, tiles.under[place])
                    break
            else:
                list_of[place] = self.last_list()
            if stop_after_run:
                return place + 1
        return len(tiles.under)

    def arrange_lists(self, tiles, list_of):
        pass  # they are, already

    def mark_drawn(self, tiles, places):
        for place in places:
            self.mark_parts(place, tiles)

    def mark_skipped(self, place, tiles):
        self.mark_parts(place, tiles)

    def mark_parts(self, place, tiles):
        for part in range(*tiles.parts.first[place : place + 2]):
            self.mark(place, 0, tiles.parts.tiles[part])

    def mark_arranged(self, place, number, tiles):
        self.mark(place, number, tiles)

    def last_list(self):
        return self.lists

    def look_up(self, place, number, tiles):
        answer = self.covered(number, tiles)
        unit = int(self.units_in_order[place])
        self.observe("lookup", unit=unit, map=number, tiles=tuple(map(int, tiles)), covered=answer)
        return answer

    def covered(self, number, tiles):
        return all(self.is_set(number, column, row) for column, row in each_tile(tiles))

    def mark(self, place, number, tiles):
        for column, row in each_tile(self.tiles_to_mark(tiles)):
            word, bit = self.address(column, row)
            self.maps[number, word] |= 1 << bit
        unit = int(self.units_in_order[place])
        self.observe("mark", unit=unit, map=number, tiles=tuple(map(int, tiles)))

    def tiles_to_mark(self, tiles):
        return tiles

    def is_set(self, number, column, row):
        word, bit = self.address(column, row)
        return bool(self.maps[number, word] >> bit & 1)

    def address(self, column, row):
        return row * WORDS_PER_ROW + column // 32, column % 32


def each_tile(tiles):
    c0, r0, c1, r1 = (int(side) for side in tiles)
    return [(column, row) for row in range(r0, r1 + 1) for column in range(c0, c1 + 1)]
