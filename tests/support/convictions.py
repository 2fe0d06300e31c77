"""What holds of every unsafe mutant: the verdict convicts it, and not the method it comes from."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

from tests.mutants.bad_cullers import Mutant
from visref.conformance import Check, CheckResult, Status, check_culler
from visref.culler import Culler


def assert_only_the_mutant_is_convicted(mutant: Mutant, checks: Mapping[str, Check]) -> None:
    """On the check that it names; the sound method runs with the mutant's options."""
    check = checks[mutant.caught_by]
    (found,) = check_culler(mutant.make, checks=[check])
    assert found.status is Status.FAILED
    assert found.missed > 0
    assert "MISSED_OBJECT" in found.problems[0]
    options = tuple(sorted(mutant.options.items()))
    sound = _sound_result(mutant.method.culler, options, check)
    assert sound.status is Status.PASSED, sound.problems


@cache
def _sound_result(
    culler: Callable[..., Culler], options: tuple[tuple[str, Any], ...], check: Check
) -> CheckResult:
    return check_culler(lambda: culler(**dict(options)), checks=[check])[0]
