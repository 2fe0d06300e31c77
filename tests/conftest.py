"""What a machine lacks (a browser, a compiler, an extra) skips tests, and fails them on CI: a
build that tests less than it says must not pass. Only what CI need not have is left out there too:
tests marked `needs` for a program in `NOT_ON_CI`. And every run folder that a test writes is held
against the schemas.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Generator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from visref.schemas import schema

# Each worker of a parallel run has a core: Mesa's own threads would only wait for it.
if os.environ.get("PYTEST_XDIST_WORKER"):
    os.environ.setdefault("LP_NUM_THREADS", "0")

# What these runs print is no word to the CI server that runs the tests.
for name in ("GITHUB_ACTIONS", "GITHUB_STEP_SUMMARY"):
    os.environ.pop(name, None)

Report = pytest.TestReport | pytest.CollectReport


# Engines that `make engines` brings, and where they then are.
NODE_MODULES = Path(__file__).parent.parent / "examples" / "engines" / "node_modules"
ENGINES = {
    "panda3d": lambda: find_spec("panda3d") is not None and find_spec("gltf") is not None,
    **{name: (NODE_MODULES / name).is_dir for name in ("three", "babylonjs", "playcanvas")},
    "openscenegraph": Path("/usr/include/osgUtil/SceneView").exists,
    "openarena-081-maps": Path("/usr/share/games/openarena/baseoa/pak1-maps.pk3").exists,
}
# Those, shells that people have, and toolchains of recorders whose packages are large, or that few
# distributions have.
NOT_ON_CI = frozenset({"rustc", "mcs", "mono", "godot4", "godot3-server", "zsh", "fish", *ENGINES})
EXCUSED = pytest.StashKey[bool]()

# Where rustup installs, whatever the shell.
os.environ["PATH"] = os.pathsep.join(
    [os.environ.get("PATH", ""), str(Path.home() / ".cargo" / "bin")]
)


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "needs(*programs): skipped where one of them is missing")


def is_there(needed: str) -> bool:
    return ENGINES[needed]() if needed in ENGINES else shutil.which(needed) is not None


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """`needs("gcc", "godot4|godot3-server")`: each, and of those between bars any."""
    for marker in item.iter_markers("needs"):
        missing = [one for one in marker.args if not any(map(is_there, one.split("|")))]
        if missing:
            item.stash[EXCUSED] = all(NOT_ON_CI.issuperset(one.split("|")) for one in missing)
            pytest.skip(f"there is no {', no '.join(missing)}")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, Any, Any]:
    report = yield
    return report if item.stash.get(EXCUSED, False) else failed_on_ci(report)


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

    def finish_and_check(self: Any, outcome: Any, part: Any = None) -> None:
        finish(self, outcome, part)
        for name, validator in validators.items():
            validator.validate(json.loads((self._folder / f"{name}.json").read_text()))

    module.RunWriter.finish = finish_and_check
