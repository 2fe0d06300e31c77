"""Every broken N-buffer culler is caught where it should be, and the sound ones pass there."""

import pytest

from tests.mutants.bad_cullers import COMMON
from tests.mutants.bad_n_buffer import ALL, EQUIVALENT, LOOKUPS, MUTANTS, NOT_HERE, OF_THE_METHOD
from tests.mutants.n_buffer_contract import edges_of_the_image, problems
from tests.support.convictions import assert_only_the_mutant_is_convicted
from visref.conformance import Status, case, check_culler, conformance_checks

pytestmark = pytest.mark.gl

CHECKS = {check.name: check for check in conformance_checks()}
METHODS = {method.name: method for method in ALL}
UNSAFE = [mutant for mutant in MUTANTS if mutant.caught_by]
WASTEFUL = [mutant for mutant in MUTANTS if mutant.contract]
# Where contracts are watched; each frame stands for three.
WATCHED = ("revealed_by_a_pierced_wall", "crowd", "peeking_by_a_pixel")


def departures(culler):
    """What the watched scenes find of it."""
    edges = edges_of_the_image()
    found = problems(culler(), edges.scene, list(edges.path))
    for name in WATCHED:
        scene, path = case(name)
        frames = [camera for camera in path.frames[:2] for _ in range(3)]
        found += problems(culler(), scene, frames)
    return found


@pytest.mark.parametrize("mutant", UNSAFE, ids=str)
def test_unsafe_mutant_is_convicted_and_the_sound_method_is_not(mutant):
    assert_only_the_mutant_is_convicted(mutant, CHECKS)


@pytest.mark.parametrize("method", LOOKUPS, ids=str)
def test_sound_method_keeps_its_contract(method):
    assert departures(method.make) == []


@pytest.mark.parametrize("mutant", WASTEFUL, ids=str)
def test_wasteful_mutant_breaks_its_contract_and_misses_nothing(mutant):
    assert mutant.contract in {line.split(":")[0] for line in departures(mutant.make)}
    for name in WATCHED:
        (found,) = check_culler(mutant.make, checks=[CHECKS[name]])
        assert found.status is Status.PASSED, found.problems


def test_every_mutant_of_every_method_is_tried_or_has_a_reason():
    known = {(m.id, m.method.name) for m in MUTANTS} | set(EQUIVALENT) | set(NOT_HERE)
    wanted = {(id, name) for id in (*COMMON, *OF_THE_METHOD) for name in METHODS}
    assert sorted(wanted - known) == []
