"""Occupancy maps with one step broken.

Staneker, Bartz, Meissner 2003: a map can never cull, it only skips queries. So it is safe if
queries are, and if each shape is decided exactly once.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.mutants.common import common
from tests.mutants.harness import breaks, equivalent, mutant, not_here
from tests.mutants.occupancy_map.contract import SUITE
from tests.mutants.occupancy_map.stepwise import StepwiseOccupancyMap
from visref_culling.occupancy_map import OccupancyMapCulling
from visref_culling.occupancy_map.tiles import OUTSIDE

FIVE = SUITE.method("occupancy-map", OccupancyMapCulling)
INSTANCED = SUITE.method("occupancy-map-instanced", OccupancyMapCulling, query="instanced")
ONE = SUITE.method("occupancy-map-one", OccupancyMapCulling, maps=1)
ONE_BATCH = SUITE.method("occupancy-map-one-batch", OccupancyMapCulling, maps=1, query="batch")
MAPS = (FIVE, INSTANCED, ONE, ONE_BATCH)

# The same decisions a step at a time, for what the shipped loop does in one go.
FIVE_STEPS = SUITE.method("occupancy-map", StepwiseOccupancyMap)
ONE_STEPS = SUITE.method("occupancy-map-one", StepwiseOccupancyMap, maps=1)
STEPS = (FIVE_STEPS, ONE_STEPS)


common("G2 G9 G10 G12 G13 G14 G15 M1 M2 M3 M4 M5 M6", of=MAPS)
not_here("G5 G6 G7", MAPS, "the rasteriser compares the depths: none is tested or read back")
not_here("G8", MAPS, "an object's own depth is not there when its box is asked")
not_here("G11", MAPS, "maps and image are emptied at a frame's start (see W7)")
equivalent(
    "G3",
    MAPS,
    "a shape is left out if its rectangle meets no pixel; rounded to nearest it meets none only if "
    "it holds no pixel's centre, and then no sample can be the shape's. A tile too few under it "
    "costs a query",
)


@mutant("G1", of=MAPS, caught_by="object_crossing_the_near_plane")
class CornersBehindTheEye:
    """The rectangle spans all eight corners' projections, those behind the eye included."""

    def rectangles(self, frame):
        camera = frame.view.camera
        window = np.array([camera.width, camera.height])
        result = np.empty((len(frame.ids), 4), np.int32)
        for place, unit in enumerate(frame.ids):
            low, high = self.unit_boxes[unit]
            choice = np.array([[i & 1, i >> 1 & 1, i >> 2] for i in range(8)])
            at = np.nan_to_num(camera.pixel_of(np.where(choice, high, low))[0] + 0.5)
            result[place, :2] = np.floor(at.min(axis=0).clip(0, window))
            result[place, 2:] = np.floor(at.max(axis=0).clip(-1, window - 1))
        return result


@mutant("G4", of=MAPS, caught_by="rows_and_columns_at_the_border")
class LastRowAndColumnLeftOut:
    """The window is taken to end before its last row and column."""

    def rectangles(self, frame):
        camera = frame.view.camera
        result = super().rectangles(frame)
        result[:, 2:] = np.minimum(result[:, 2:], (camera.width - 2, camera.height - 2))
        return result


@mutant("U1", of=MAPS, caught_by="stacks_of_sheets")
class DepthMaskLeftOn:
    """Query boxes write their depth, and hide the boxes asked after them."""

    def query_state(self, state):
        return super().query_state(state)._replace(depth_write=True)


@mutant("U2", of=MAPS, caught_by="crowd")
class ResultsShiftedByOne:
    """Each query is given the answer to the one before it."""

    def decide(self, frame):
        self.held = np.zeros(1, bool)
        super().decide(frame)

    def query(self, frame, places, **how):
        answers = np.concatenate([self.held, super().query(frame, places, **how)])
        self.held = answers[-1:]
        return answers[:-1]


@mutant("U3", of=(FIVE_STEPS,), caught_by="stacks_of_sheets")
class DroppedAfterTheLastMap:
    """A shape that every arranging map shows as covered joins no list."""

    def last_list(self):
        return OUTSIDE


not_here("U3", (INSTANCED,), "the ways of asking share the traversal")
not_here("U3", (ONE, ONE_BATCH), "one map arranges nothing: its only list is the last")


@mutant("W4", of=MAPS, contract="outside_shapes_cost_nothing")
class NothingUnderItIsAllSet:
    """A shape whose clipped rectangle is empty is asked: none of its no tiles is unset."""

    def left_out(self, frame, rectangles):
        return np.zeros(len(rectangles), bool)


@mutant("U5", of=(FIVE, INSTANCED, ONE_BATCH), caught_by="stacks_of_sheets")
class LastListNotFlushed:
    """The last list is never asked."""

    def list_numbers(self):
        return super().list_numbers()[:-1]


not_here("U5", (ONE,), "each shape is asked as it comes; there is no list to flush")


@mutant("W6", of=STEPS, contract="drawn_shapes_mark_every_tile")
class SkippedShapesNotMarked:
    """A shape drawn without a query leaves no mark."""

    def mark_skipped(self, place, tiles):
        pass


@mutant("W7", of=MAPS, contract="all_bits_are_cleared_at_the_start")
class MapsNotCleared:
    """The maps of the frame before are kept."""

    def clear_maps(self):
        pass


@mutant("W8", of=STEPS, contract="drawn_shapes_mark_every_tile")
class TilesRoundedInward:
    """A shape marks only the tiles that lie wholly in its rectangle."""

    def tiles_to_mark(self, tiles):
        return tiles + np.array([1, 1, -1, -1])


@mutant("W9", of=STEPS, contract="query_is_skipped_if_and_only_if_a_tile_is_unset")
class AnyForAll:
    """One set tile under a rectangle is taken for all."""

    def covered(self, number, tiles):
        c0, r0, c1, r1 = tiles
        return any(
            self.is_set(number, column, row)
            for column in range(c0, c1 + 1)
            for row in range(r0, r1 + 1)
        )


@mutant("W10", of=STEPS, contract="query_is_skipped_if_and_only_if_a_tile_is_unset")
class WrongStride:
    """Rows of the map overlap: three words on, not four."""

    def address(self, column, row):
        return row * 3 + column // 32, column % 32


@mutant("W11", of=(FIVE_STEPS,), contract="lists_are_arranged_as_the_paper_says")
class ArrangingMapNotMarked:
    """A shape that joins a list leaves no mark in its map."""

    def mark_arranged(self, place, number, tiles):
        pass


not_here("W11", (ONE, ONE_BATCH), "one map arranges nothing")


@mutant("W12", of=MAPS, contract="shapes_come_front_to_back")
class BackToFront:
    """The farthest shape comes first."""

    def order(self, ids, nearest):
        return super().order(ids, nearest)[::-1]


not_here("W6 W8 W9 W10 W11", (INSTANCED,), "the ways of asking share the traversal")
not_here("W6 W8 W9 W10", (ONE_BATCH,), "the ways of asking share the traversal")


# What the other contracts see.


@breaks("bits_are_only_ever_set", of=(FIVE,))
class UnsetsABit:
    def mark_drawn(self, *tiles):
        super().mark_drawn(*tiles)
        self.maps[0, self.maps[0].nonzero()[0][:1]] = 0


@breaks("rectangles_hold_the_box_and_little_more", of=(FIVE,))
class RectanglesTooSmall:
    def rectangles(self, frame):
        return super().rectangles(frame) + np.array([1, 0, -1, 0], np.int32)


@breaks("rectangles_hold_the_box_and_little_more", of=(FIVE,))
class RectanglesTooLarge:
    def rectangles(self, frame):
        found = super().rectangles(frame)
        found[:, :2] = np.maximum(found[:, :2] - 2, 0)
        return found


@breaks("tiles_hold_every_pixel_of_the_rectangle", of=(FIVE,))
class TilesOfTheNextRow:
    def tiles(self, frame, rectangles):
        found = super().tiles(frame, rectangles)
        return replace(found, under=found.under + np.array([0, 1, 0, 1], np.int32))


@breaks("marks_hold_every_triangle_and_no_more_than_the_box", of=(FIVE,))
class MarksHalfItsParts:
    def prepare(self, scene):
        units = super().prepare(scene)
        self.part_bounds[::2] = [[np.inf], [-np.inf]]
        return units


@breaks("marks_hold_every_triangle_and_no_more_than_the_box", of=(FIVE,))
class MarksTheWholeWindow:
    def prepare(self, scene):
        units = super().prepare(scene)
        self.part_bounds[:] = [[-1e6], [1e6]]
        return units


@breaks("each_shape_is_decided_exactly_once", of=(FIVE,))
class AsksTwice:
    def query(self, frame, places, **how):
        super().query(frame, places, **how)
        return super().query(frame, places, **how)


@breaks("each_shape_is_decided_exactly_once", of=(FIVE,))
class DrawsTwice:
    def draw(self, frame, places):
        super().draw(frame, places)
        super().draw(frame, places[:1])


@breaks("each_shape_is_decided_exactly_once", of=(FIVE,))
class IgnoresAnswers:
    def query(self, frame, places, **how):
        return np.ones_like(super().query(frame, places, **how))


@breaks("no_more_batches_than_lists", of=(FIVE,))
class AsksOneAtATime:
    def ask(self, frame, tiles, places):
        for place in places:
            super().ask(frame, tiles, np.array([place]))


@breaks("each_shape_is_decided_exactly_once", of=(FIVE,))
class ReadsTheListsBeforeTheyAreArranged:
    """The second thread is not waited for: it is done when the first list has been asked."""

    def begin_lists(self, tiles, list_of):
        self.late = (tiles, list_of)

    def ask(self, frame, tiles, places):
        super().ask(frame, tiles, places)
        if self.late is not None:
            self.arrange_lists(*self.late)
            self.late = None


SUITE.kept_by(*MAPS, *STEPS)
for variant in (FIVE, FIVE_STEPS):
    SUITE.kept_by(variant, query="instanced", backfaces=True)
    SUITE.kept_by(variant, corners=True)
    SUITE.kept_by(variant, thread=True)
    SUITE.kept_by(variant, scale="scene", depth=32, parts=1)
    SUITE.kept_by(variant, maps=1, scale="scene", corners=True)
SUITE.kept_by(ONE_STEPS, query="batch")
