"""Every broken lazy grid is caught where it should be, and the sound one passes there."""

import itertools
from functools import partial

import pytest

from tests.mutants.bad_cullers import COMMON
from tests.mutants.bad_lazy_grid import ALL, EQUIVALENT, MUTANTS, NOT_HERE, OF_THE_METHOD, OWN
from tests.mutants.lazy_grid_contract import watched
from tests.support.convictions import assert_only_the_mutant_is_convicted
from visref.conformance.suite import (
    Check,
    Status,
    _judge_on,
    case,
    check_culler,
    conformance_checks,
)

pytestmark = pytest.mark.gl

CHECKS = {check.name: check for check in conformance_checks()}
CHECKS |= {m.name: Check(m.name, m.claim, m.trap, _judge_on(m)) for m in OWN.values()}
UNSAFE = [mutant for mutant in MUTANTS if mutant.caught_by]
WASTEFUL = [mutant for mutant in MUTANTS if mutant.contract]
# Where contracts are watched.
WATCHED = ("walk_through_a_city", "crowd", "odd_viewports")
METHODS = {method.name: method for method in ALL}


@pytest.mark.parametrize("mutant", UNSAFE, ids=str)
def test_unsafe_mutant_is_convicted_and_the_sound_method_is_not(mutant):
    assert_only_the_mutant_is_convicted(mutant, CHECKS)


@pytest.mark.parametrize("method", ALL, ids=lambda method: method.name)
@pytest.mark.parametrize("update", ["lazy", "busy"])
def test_sound_method_keeps_its_contract(method, update):
    options = {**method.options, "update": update}
    for name in WATCHED:
        scene, path = case(name)
        watch, _ = watched(method.culler(**options), scene, path, **options)
        assert watch.problems == []
        assert watch.tests > 20


@pytest.mark.parametrize("mutant", WASTEFUL, ids=str)
def test_wasteful_mutant_breaks_its_rule_and_misses_nothing(mutant):
    problems = []
    for name in WATCHED:
        scene, path = case(name)
        problems += watched(mutant.make(), scene, path, **mutant.options)[0].problems
        (found,) = check_culler(mutant.make, checks=[CHECKS[name]])
        assert found.status is Status.PASSED, found.problems
    assert mutant.contract in {problem.split(":")[0] for problem in problems}


def test_every_mutant_is_tried_or_has_a_reason():
    ids = {mutant.id for mutant in MUTANTS} | set(EQUIVALENT) | set(NOT_HERE)
    assert sorted({*COMMON, *OF_THE_METHOD} - ids) == []
    assert not {mutant.id for mutant in MUTANTS} & {*EQUIVALENT, *NOT_HERE}


@pytest.mark.parametrize("check", conformance_checks(), ids=str)
def test_every_variant_conforms(check):
    for method, update in itertools.product(ALL, ("lazy", "busy")):
        make = partial(method.culler, **method.options, update=update)
        (found,) = check_culler(make, checks=[check])
        assert found.status is Status.PASSED, (method.name, update, found.problems)
