"""The suites that authors of cullers and of truth engines run on their own: small scenes, and
what exact arithmetic says of them."""

from visref.conformance.engines import (
    EngineCheck,
    assert_engine_conforms,
    engine_checks,
    parametrize_with_engine_checks,
)
from visref.conformance.suite import (
    Check,
    CheckResult,
    Status,
    assert_conforms,
    case,
    check_culler,
    conformance_checks,
    exact_truths,
    judge_on,
    parametrize_with_checks,
)

__all__ = [
    "Check",
    "CheckResult",
    "EngineCheck",
    "Status",
    "assert_conforms",
    "assert_engine_conforms",
    "case",
    "check_culler",
    "conformance_checks",
    "engine_checks",
    "exact_truths",
    "judge_on",
    "parametrize_with_checks",
    "parametrize_with_engine_checks",
]
