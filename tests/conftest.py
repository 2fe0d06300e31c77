"""What a machine lacks (a browser, a compiler, an extra) skips tests, and fails them on CI: a
build that tests less than it says must not pass.
"""

from __future__ import annotations

import os
from collections.abc import Generator
from typing import Any

import pytest

Report = pytest.TestReport | pytest.CollectReport


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, Any, Any]:
    return failed_on_ci((yield))


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report() -> Generator[None, Any, Any]:
    return failed_on_ci((yield))


def failed_on_ci(report: Report) -> Report:
    """The report, a skip turned into a failure where the environment variable CI is set."""
    if os.environ.get("CI") and report.skipped and not hasattr(report, "wasxfail"):
        reason = report.longrepr[-1] if isinstance(report.longrepr, tuple) else report.longrepr
        report.outcome = "failed"
        report.longrepr = f"with CI set, a skip is a failure: {reason}"
    return report
