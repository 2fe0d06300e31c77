"""visref as a stranger gets it: the wheel and what it needs, in an environment of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests.cli.test_cli import record, write_scene
from tests.house.test_wheel import build

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parent.parent.parent
# What `pip install visref` may take, in 10^6 bytes: it was 569 (docs/start.md says of what).
MOST_MB = 590


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """The environment's folder."""
    folder = tmp_path_factory.mktemp("clean")
    wheel = build("wheel", folder / "wheel")
    environment = folder / "environment"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", environment], check=True)
    command = [
        *(sys.executable, "-m", "pip", "--python", environment / "bin" / "python", "install"),
        *("--quiet", "--disable-pip-version-check", "--constraint", ROOT / "constraints.txt"),
        *("--retries", "1", wheel),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode and "No matching distribution" in done.stderr:
        pytest.skip("no package index can be reached")
    assert done.returncode == 0, done.stderr
    return environment


def visref(installed, folder, *arguments):
    # No trace of the checkout, nor of what is compiled for it.
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    environment["NUMBA_CACHE_DIR"] = str(installed / "kernels")
    return subprocess.run(
        [installed / "bin" / "visref", *arguments],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )


def test_it_is_no_larger_than_it_was(installed):
    (packages,) = installed.glob("lib/python3*/site-packages")
    files = [file for file in packages.rglob("*") if file.is_file() and not file.is_symlink()]
    assert sum(file.stat().st_size for file in files) / 1e6 <= MOST_MB


def test_what_extras_bring_is_not_there(installed, tmp_path):
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    (packages,) = installed.glob("lib/python3*/site-packages")
    there = {one.name.partition("-")[0].lower() for one in packages.glob("*.dist-info")}
    for extra, needs in project["optional-dependencies"].items():
        for need in needs:
            name = need.partition(">")[0].partition("[")[0].replace("-", "_").lower()
            assert name not in there, (extra, name)
    ran = visref(installed, tmp_path, "bench", "city:scale=0.02", "--out", "bench")
    assert (ran.returncode, ran.stdout) == (2, "")
    assert "pip install 'visref[plots]'" in ran.stderr


def test_it_checks_and_reports_and_convicts(installed, tmp_path):
    scene, path = write_scene(tmp_path)
    visible = record(tmp_path, ["front", "beside"], ["front"])
    ran = visref(
        installed, tmp_path, "check", scene, "--path", path, "--visible", visible, "--out", "run"
    )
    assert (ran.returncode, ran.stderr) == (1, "")
    verdict = json.loads((tmp_path / "run" / "verdict.json").read_text())
    assert verdict["status"] == "violation"
    assert visref(installed, tmp_path, "report", "run", "--out", "page").returncode == 1
    assert (tmp_path / "page" / "report.html").is_file()
