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
# For lack of what CI need not have. Both must be missing for the test to be left out.
OF_A_TOOL = """
import shutil
import pytest

@pytest.mark.needs("godot4|mcs")
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


def run(
    folder: Path, test: str, ci: str, path: str | None = None
) -> subprocess.CompletedProcess[str]:
    (folder / "test_one.py").write_text(test)
    (folder / "pytest.ini").write_text("[pytest]\n")
    (folder / "conftest.py").write_text((ROOT / "tests" / "conftest.py").read_text())
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:dash", "."]
    environment = {**os.environ, "CI": ci}
    if path is not None:
        environment |= {"PATH": path, "HOME": path}
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


def test_lack_of_what_ci_need_not_have_is_a_skip_on_ci_too(tmp_path):
    found = run(tmp_path, OF_A_TOOL, "true", path=str(tmp_path))
    assert found.returncode == pytest.ExitCode.OK
    assert "1 skipped" in found.stdout


def test_what_is_there_is_not_skipped(tmp_path):
    (tmp_path / "mcs").write_text("")
    (tmp_path / "mcs").chmod(0o755)
    found = run(tmp_path, OF_A_TOOL, "true", path=str(tmp_path))
    assert found.returncode == pytest.ExitCode.TESTS_FAILED
    assert "assert False" in found.stdout


@pytest.mark.parametrize("needs", ['"gcc"', '"godot4", "gcc"', '"godot4|gcc"'])
def test_lack_of_anything_else_is_a_failure_on_ci(needs, tmp_path):
    """Beside something that CI need not have, too, and as an alternative to it."""
    found = run(tmp_path, OF_A_TOOL.replace('"godot4|mcs"', needs), "true", path=str(tmp_path))
    assert found.returncode == pytest.ExitCode.TESTS_FAILED
    assert "with CI set, a skip is a failure" in found.stdout
