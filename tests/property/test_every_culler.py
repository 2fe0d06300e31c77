"""No installed culler, with any option, misses a visible object: not on the conformance
suite's scenes, not on scenes that hypothesis finds."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import HealthCheck, Phase, find, given, settings
from hypothesis import strategies as st

from tests import bad_occupancy_map as _its_mutants  # noqa: F401
from tests import strategies
from tests.bad_cullers import MUTANTS
from visref.conformance import assert_conforms, exact_truths, judge_on
from visref.conformance_scenes import Case
from visref.culler import Culler, Option
from visref.registry import CULLERS, available, make_culler

pytestmark = pytest.mark.gl


def values(option: Option) -> tuple:
    """All that an option may be, where that is a short list; else its default."""
    if isinstance(option.default, bool):
        return (False, True)
    return option.choices or (option.default,)


def spec(name: str, chosen: dict) -> str:
    return f"{name}:{','.join(f'{key}={value}' for key, value in chosen.items())}".rstrip(":")


def classes() -> dict[str, type[Culler]]:
    return {name: point.load() for name, point in available(CULLERS).items()}


def one_at_a_time() -> list[str]:
    """Each culler as it comes, and with each option away from its default."""
    specs = []
    for name, culler in classes().items():
        specs.append(name)
        for key, option in culler.options.items():
            others = [value for value in values(option) if value != option.default]
            specs += [spec(name, {key: value}) for value in others]
    return specs


def all_combinations() -> dict[str, list[str]]:
    """Per culler every combination of its options."""
    found = {}
    for name, culler in classes().items():
        choices = itertools.product(*(values(option) for option in culler.options.values()))
        found[name] = [
            spec(name, dict(zip(culler.options, chosen, strict=True))) for chosen in choices
        ]
    return found


COMBINATIONS = all_combinations()

# One seed for the same examples everywhere; GL is slow to start, and drawing is no fault.
QUIET = settings(derandomize=True, deadline=None, suppress_health_check=list(HealthCheck))


@pytest.mark.parametrize("culler", one_at_a_time())
def test_culler_conforms_with_each_option(culler):
    assert_conforms(lambda: make_culler(culler))


@settings(max_examples=60, derandomize=True, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    built=strategies.cases(),
    cullers=st.tuples(*(st.sampled_from(specs) for specs in COMBINATIONS.values())),
)
def test_no_culler_misses_what_hypothesis_puts_in_view(built, cullers):
    truths = exact_truths(built)
    for culler in cullers:
        problems, _ = judge_on(lambda culler=culler: make_culler(culler), built, truths)
        assert problems == (), culler


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
