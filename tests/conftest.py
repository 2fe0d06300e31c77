"""What a machine lacks (a browser, a compiler, an extra) skips tests, and fails them on CI: a
build that tests less than it says must not pass. And every run folder that a test writes is held
against the schemas.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Generator
from typing import Any

import jsonschema
import pytest

from visref.schemas import schema

# Each worker of a parallel run has a core: Mesa's own threads would only wait for it.
if os.environ.get("PYTEST_XDIST_WORKER"):
    os.environ.setdefault("LP_NUM_THREADS", "0")

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


def pytest_collection_finish() -> None:
    """Have every run folder checked once it is written."""
    module = sys.modules.get("visref.run_folder.write")
    if module is None:
        return
    finish = module.RunWriter.finish
    validators = {
        name: jsonschema.Draft202012Validator(schema(name)) for name in ("verdict", "manifest")
    }

    def finish_and_check(self: Any, outcome: Any) -> None:
        finish(self, outcome)
        for name, validator in validators.items():
            validator.validate(json.loads((self._folder / f"{name}.json").read_text()))

    module.RunWriter.finish = finish_and_check
