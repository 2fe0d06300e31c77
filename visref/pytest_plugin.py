"""The pytest plug-in: fixtures that judge a culler, or what an engine recorded, in a test.

pytest imports this module at every start, where visref is installed: it imports nothing but pytest,
and all else when a test asks for a fixture (`visref.judged_in_tests`).
"""

from __future__ import annotations

from collections.abc import Generator
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from visref.judged_in_tests import Judge, SceneChoice

MARKER = "visref_scene"
# The verdicts of a test, which its report shows if it fails.
_JUDGES = pytest.StashKey["Judge"]()


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line(
        "markers",
        f"{MARKER}(scene, path=None, **settings): the scene that the fixture visref_judge judges on"
        " (a file or a generated scene, and a camera path; settings of visref.open_inputs)",
    )


@pytest.fixture(scope="session")
def _visref_opened() -> dict[Any, Any]:
    """Scenes and paths that this process has read, by what was asked for."""
    return {}


@pytest.fixture
def visref_scene(request: pytest.FixtureRequest, _visref_opened: dict[Any, Any]) -> SceneChoice:
    """Call it to choose the scene that `visref_judge` judges on: `visref_scene("scene.glb",
    path="walk.path.json", frames="0:50")`, with the arguments of `visref.open_inputs`. The marker
    `@pytest.mark.visref_scene(...)` does so before the test begins. `visref_scene.inputs` has it
    read."""
    from visref.judged_in_tests import SceneChoice

    choice = SceneChoice(_visref_opened)
    marker = request.node.get_closest_marker(MARKER)
    if marker is not None:
        choice(*marker.args, **marker.kwargs)
    return choice


@pytest.fixture
def visref_judge(
    request: pytest.FixtureRequest, visref_scene: SceneChoice, tmp_path_factory: Any
) -> Judge:
    """Call it with a culler (`visref.Culler` or its class), a spec (`"n-buffer:levels=4"`,
    `"module:Class"`), or `recording=` or `visible=` and a file; it returns what was found
    (`visref.judged_in_tests.Judged`): `visref_judge("frustum").assert_no_violation()`."""
    from visref.judged_in_tests import Judge

    judge = Judge(visref_scene, lambda: tmp_path_factory.mktemp("visref"))
    request.node.stash[_JUDGES] = judge
    return judge


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    judge = item.stash.get(_JUDGES, None)
    if judge is not None and report.failed and call.when == "call":
        report.sections += [("visref", text) for text in judge.unsaid(str(report.longrepr))]
    return report
