"""What a machine lacks is skipped, and a failure on CI."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parent.parent.parent

OF_A_MODULE = """
import pytest
pytest.importorskip("no_such_module")
"""
OF_A_TEST = """
import shutil
import pytest

@pytest.mark.skipif(shutil.which("no-such-program") is None, reason="no such program")
def test_something():
    assert False
"""
# A test that is known to fail is no test left out.
KNOWN_TO_FAIL = """
import pytest

@pytest.mark.xfail(reason="known")
def test_something():
    assert False
"""


def run(folder: Path, test: str, ci: str) -> subprocess.CompletedProcess[str]:
    (folder / "test_one.py").write_text(test)
    (folder / "pytest.ini").write_text("[pytest]\n")
    (folder / "conftest.py").write_text((ROOT / "tests" / "conftest.py").read_text())
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:dash", "."]
    environment = {**os.environ, "CI": ci}
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)


@pytest.mark.parametrize("test", [OF_A_MODULE, OF_A_TEST])
def test_skip_is_a_skip_and_a_failure_on_ci(test, tmp_path):
    by_day = run(tmp_path, test, "")
    assert "1 skipped" in by_day.stdout
    assert "failed" not in by_day.stdout
    on_ci = run(tmp_path, test, "true")
    assert on_ci.returncode in (pytest.ExitCode.TESTS_FAILED, pytest.ExitCode.INTERRUPTED)
    assert "with CI set, a skip is a failure" in on_ci.stdout


def test_expected_failure_stays_one_on_ci(tmp_path):
    found = run(tmp_path, KNOWN_TO_FAIL, "true")
    assert found.returncode == pytest.ExitCode.OK
    assert "1 xfailed" in found.stdout
