"""The suite that authors of cullers run on their own: small scenes, judged on exact truth."""

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
)

__all__ = [
    "Check",
    "CheckResult",
    "Status",
    "assert_conforms",
    "case",
    "check_culler",
    "conformance_checks",
    "exact_truths",
    "judge_on",
]
