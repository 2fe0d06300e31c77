"""Every broken culler is caught where it should be, and the sound method passes there."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tests.mutants.bad_cullers import (
    COMMON,
    COMMON_METHODS,
    EQUIVALENT,
    MUTANTS,
    NOT_HERE,
    Method,
    Mutant,
    accounted_for,
)
from tests.mutants.bad_occupancy_map import FIVE, MAPS, MUTANTS_OF_THE_MAP, ONE
from tests.mutants.contracts import OCCUPANCY_MAP, TILES, broken_contracts, watch
from tests.mutants.stepwise_occupancy_map import StepwiseOccupancyMap
from visref.conformance import Status, assert_conforms, check_culler, conformance_checks
from visref.conformance import suite as conformance
from visref.conformance.scenes import box, camera, case, panel
from visref.culler import Culler
from visref.engines.exact import ExactEngine
from visref.judging.referee import Referee
from visref.scene import Alpha
from visref_culling.occupancy_map import OccupancyMapCulling

pytestmark = pytest.mark.gl

CHECKS = {check.name: check for check in conformance_checks()}
UNSAFE = [mutant for mutant in MUTANTS if mutant.caught_by]
WASTEFUL = [mutant for mutant in MUTANTS if mutant.contract]

# Five full lists; shapes outside the view; many small shapes. At this size a tile has several
# pixels, and neither side is a multiple of a tile's.
# And more than one frame: what one leaves behind spoils the next.
WATCHED = {"stacks_of_sheets": 2, "object_crossing_the_near_plane": 5, "crowd": 2}
SIZE = (201, 133)


def contracts_broken(make: Callable[..., Culler], **options) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for name, count in WATCHED.items():
        scene, path = conformance.case(name)
        frames = path.resized(*SIZE).frames[:count]
        traces = watch(make(**options), scene, frames, **options)
        for contract, lines in broken_contracts(traces).items():
            found.setdefault(contract, []).extend(f"{name}: {line}" for line in lines)
    return found


@pytest.mark.parametrize("mutant", UNSAFE, ids=str)
def test_unsafe_mutant_is_convicted_with_a_witness(mutant: Mutant):
    (found,) = check_culler(mutant.make, checks=[CHECKS[mutant.caught_by]])
    assert found.status is Status.FAILED
    assert found.missed > 0
    assert "MISSED_OBJECT" in found.problems[0]
    assert "witness: pixel" in found.problems[0]


def _sound() -> list:
    """Each sound method with each check that convicts one of its mutants."""
    pairs = {f"{m.method}-{m.caught_by}": (m.method, m.caught_by) for m in UNSAFE}
    return [pytest.param(*pair, id=id) for id, pair in pairs.items()]


@pytest.mark.parametrize(("method", "check"), _sound())
def test_sound_method_passes_where_its_mutants_fail(method: Method, check: str):
    (found,) = check_culler(method.make, checks=[CHECKS[check]])
    assert found.status is Status.PASSED, found.problems
    assert found.missed == 0


@pytest.mark.parametrize("mutant", WASTEFUL, ids=str)
def test_wasteful_mutant_breaks_its_contract(mutant: Mutant):
    broken = contracts_broken(mutant.culler, **mutant.options)
    assert mutant.contract in broken, f"only {list(broken)}"


@pytest.mark.parametrize("mutant", WASTEFUL, ids=str)
def test_wasteful_mutant_draws_the_right_picture(mutant: Mutant):
    checks = [CHECKS[name] for name in (*WATCHED, "eye_inside_an_object")]
    assert_conforms(mutant.make, checks=checks)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"maps": 1},
        {"maps": 1, "query": "batch"},
        {"query": "instanced", "backfaces": True},
        {"corners": True},
        {"scale": "scene", "depth": 32, "parts": 1},
        {"maps": 1, "scale": "scene", "corners": True},
    ],
    ids=str,
)
@pytest.mark.parametrize("culler", [OccupancyMapCulling, StepwiseOccupancyMap])
def test_sound_map_keeps_every_contract(culler, options):
    assert contracts_broken(culler, **options) == {}


def test_watched_scenes_ask_every_question():
    """All five lists, drawn, outside and sure shapes come up, or a contract would be vacuous."""
    lists, sure = set(), 0
    for name in WATCHED:
        scene, path = conformance.case(name)
        for trace in watch(FIVE.make(), scene, path.resized(*SIZE)):
            (event,) = trace.of("lists")
            lists |= set(event.data["list_of"].tolist())
            sure += int(event.data["sure"].sum())
    assert lists == {-1, 0, 1, 2, 3, 4, 5}
    assert sure > 0


def test_every_contract_can_be_broken():
    """By a mutant of the table, or by one of those below."""
    broken = {mutant.contract for mutant in WASTEFUL} | {name for name, _ in FURTHER}
    assert broken == set(OCCUPANCY_MAP)


class UnsetsABit(OccupancyMapCulling):
    def mark_drawn(self, *tiles):
        super().mark_drawn(*tiles)
        self.maps[0, self.maps[0].nonzero()[0][:1]] = 0


class RectanglesTooSmall(OccupancyMapCulling):
    def rectangles(self, frame):
        return super().rectangles(frame) + np.array([1, 0, -1, 0], np.int32)


class RectanglesTooLarge(OccupancyMapCulling):
    def rectangles(self, frame):
        found = super().rectangles(frame)
        found[:, :2] = np.maximum(found[:, :2] - 2, 0)
        return found


class TilesOfTheNextRow(OccupancyMapCulling):
    def tiles_under(self, frame, rectangles):
        return super().tiles_under(frame, rectangles) + np.array([0, 1, 0, 1], np.int32)


class MarksHalfItsParts(OccupancyMapCulling):
    def tiles(self, frame, rectangles):
        found = super().tiles(frame, rectangles)
        found.parts[::2] = (0, 0, -1, -1)
        return found


class MarksTheWholeWindow(OccupancyMapCulling):
    def tiles(self, frame, rectangles):
        found = super().tiles(frame, rectangles)
        found.parts[:] = (0, 0, TILES - 1, TILES - 1)
        return found


class AsksTwice(OccupancyMapCulling):
    def query(self, frame, places, **how):
        super().query(frame, places, **how)
        return super().query(frame, places, **how)


class DrawsTwice(OccupancyMapCulling):
    def draw(self, frame, places):
        super().draw(frame, places)
        super().draw(frame, places[:1])


class IgnoresAnswers(OccupancyMapCulling):
    def query(self, frame, places, **how):
        return np.ones_like(super().query(frame, places, **how))


class AsksOneAtATime(OccupancyMapCulling):
    def ask(self, frame, tiles, places):
        for place in places:
            super().ask(frame, tiles, np.array([place]))


FURTHER = [
    ("bits_are_only_ever_set", UnsetsABit),
    ("rectangles_hold_the_box_and_little_more", RectanglesTooSmall),
    ("rectangles_hold_the_box_and_little_more", RectanglesTooLarge),
    ("tiles_hold_every_pixel_of_the_rectangle", TilesOfTheNextRow),
    ("marks_hold_every_triangle_and_no_more_than_the_box", MarksHalfItsParts),
    ("marks_hold_every_triangle_and_no_more_than_the_box", MarksTheWholeWindow),
    ("each_shape_is_decided_exactly_once", AsksTwice),
    ("each_shape_is_decided_exactly_once", DrawsTwice),
    ("each_shape_is_decided_exactly_once", IgnoresAnswers),
    ("no_more_batches_than_lists", AsksOneAtATime),
]


@pytest.mark.parametrize(("contract", "culler"), FURTHER)
def test_contract_sees_what_breaks_it(contract, culler):
    assert contract in contracts_broken(culler)


def test_common_mutants_are_tried_or_have_a_reason():
    assert accounted_for(COMMON, (*COMMON_METHODS, FIVE, ONE)) == []


def test_mutants_of_the_map_are_tried_or_have_a_reason():
    assert accounted_for(MUTANTS_OF_THE_MAP, MAPS) == []


def test_no_mutant_is_both_tried_and_excused():
    tried = {(mutant.id, mutant.method.name) for mutant in MUTANTS}
    assert not tried & (set(NOT_HERE) | set(EQUIVALENT))
    assert all((NOT_HERE | EQUIVALENT).values())


def test_oracle_is_the_one_that_the_mutants_letter_names():
    for mutant in MUTANTS:
        if mutant.id in MUTANTS_OF_THE_MAP:
            assert bool(mutant.contract) == mutant.id.startswith("W")


def test_alpha_cut_occluder_leaves_doubt_and_no_conviction():
    """G13's other half: behind an alpha-cut surface whose texture nobody looks at, a sample is
    undecided, so the mutant's loss is counted there and convicts nobody."""
    fenced = case(
        [
            ("fence", panel((-2.0, 2.0), (-2.0, 2.0), -4.0)),
            ("behind it", box((-1.0, -1.0, -8.0), (1.0, 1.0, -6.0))),
            ("beside it", box((4.0, -1.0, -8.0), (5.0, 1.0, -6.0))),
        ],
        [camera(width=32, height=16)],
        alpha={"fence": Alpha.MASK},
    )
    scene, path = fenced.scene, fenced.path
    mutants = [m for m in MUTANTS if m.id == "G13" and m.method.name == "occlusion-query"]
    for mutant, undecided in (*[(m, True) for m in mutants], (mutants[0].method, False)):
        referee = Referee(scene, lambda: ExactEngine(scene))
        outcome = referee.run(path, range(len(path)), [("fence", mutant.make())])
        totals = outcome.cullers[0].totals
        assert totals.violations == 0
        assert (totals.undecided > 0) == undecided
