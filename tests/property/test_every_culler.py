"""No installed culler, with any option, misses a visible object: not on the conformance
suite's scenes, not on scenes that hypothesis finds."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import pytest
from hypothesis import HealthCheck, Phase, find, given, settings
from hypothesis import strategies as st

from tests import bad_occupancy_map as _its_mutants  # noqa: F401
from tests import strategies
from tests.bad_cullers import MUTANTS
from visref.conformance import assert_conforms, exact_truths, judge_on
from visref.conformance_scenes import Case
from visref.culler import Culler, Option
from visref.registry import CULLERS, available

pytestmark = pytest.mark.gl


CLASSES: dict[str, type[Culler]] = {
    name: point.load() for name, point in available(CULLERS).items()
}


@dataclass(frozen=True)
class Variant:
    """A culler with some of its options away from their defaults."""

    name: str
    chosen: tuple[tuple[str, object], ...] = ()

    def make(self) -> Culler:
        return CLASSES[self.name](**dict(self.chosen))

    def __str__(self) -> str:
        return f"{self.name}:{','.join(f'{k}={v}' for k, v in self.chosen)}".rstrip(":")


def values(option: Option) -> tuple:
    """All that an option may be, where that is a short list; else its default."""
    if isinstance(option.default, bool):
        return (False, True)
    return option.choices or (option.default,)


def one_at_a_time() -> list[Variant]:
    """Each culler as it comes, and with each option away from its default."""
    found = []
    for name, culler in CLASSES.items():
        found.append(Variant(name))
        for key, option in culler.options.items():
            others = [value for value in values(option) if value != option.default]
            found += [Variant(name, ((key, value),)) for value in others]
    return found


def all_combinations(name: str) -> list[Variant]:
    options = CLASSES[name].options
    choices = itertools.product(*map(values, options.values()))
    return [Variant(name, tuple(zip(options, chosen, strict=True))) for chosen in choices]


COMBINATIONS = [all_combinations(name) for name in CLASSES]

# One seed for the same examples everywhere; GL is slow to start, and drawing is no fault.
QUIET = settings(derandomize=True, deadline=None, suppress_health_check=list(HealthCheck))


@pytest.mark.parametrize("variant", one_at_a_time(), ids=str)
def test_culler_conforms_with_each_option(variant):
    assert_conforms(variant.make)


@settings(max_examples=60, derandomize=True, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    built=strategies.cases(),
    variants=st.tuples(*map(st.sampled_from, COMBINATIONS)),
)
def test_no_culler_misses_what_hypothesis_puts_in_view(built, variants):
    truths = exact_truths(built)
    for variant in variants:
        problems, _ = judge_on(variant.make, built, truths)
        assert problems == (), str(variant)


@pytest.mark.parametrize(
    "found",
    [
        "G2-QueryWithTheEyeInside",
        "G10-MirroredCornersUnsorted",
        "G14-UnfinishedQueryReadAsZero",
        "U1-DepthMaskLeftOn",
        "U2-ResultsShiftedByOne",
    ],
)
def test_hypothesis_scenes_convict_the_broken(found):
    """Or the property above would hold of anything."""
    mutant = next(m for m in MUTANTS if str(m).startswith(found))

    def convicted(built: Case) -> bool:
        problems, _ = judge_on(mutant.make, built, exact_truths(built))
        return any(problem.startswith("MISSED_OBJECT") for problem in problems)

    few = settings(QUIET, max_examples=60, phases=[Phase.generate], database=None)
    find(strategies.cases(), convicted, settings=few)
