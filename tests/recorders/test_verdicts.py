"""What the recorders write is judged: a safe recording passes, one that loses an object names it,
and one whose engine was killed is judged as far as it came."""

from __future__ import annotations

import json
import math
import subprocess
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from tests.cli.test_cli import write_scene
from tests.recorders.calls import Call, exactly, strict_lines
from tests.recorders.languages import each
from tests.recorders.languages.base import RECORDERS, Language, Recording, Recordings, compiled
from tests.recorders.languages.c import STRICT
from tests.support import chromium
from visref.cli.main import main
from visref.schemas import schema

DATA = Path(__file__).parent / "data"


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """Three boxes: `front`, `behind` it, and `beside`."""
    return write_scene(tmp_path_factory.mktemp("scene"))[0]


Judgement = tuple[int, dict, str]
_judgements: dict[str, Judgement] = {}


def judged(scene: str, recording: Path, capsys) -> Judgement:
    """The exit status, what verdict.json says of the recording, and what was printed. Recordings
    whose lines hold equal values, to the bit, are judged once, whichever language wrote them."""
    text = recording.read_bytes()
    whole = text.endswith(b"\n")
    values = json.dumps(exactly(strict_lines(text))) if whole else text.decode("utf-8")
    if values not in _judgements:
        _judgements[values] = judged_anew(scene, recording, capsys)
    return _judgements[values]


def judged_anew(scene: str, recording: Path, capsys) -> Judgement:
    out = recording.parent / f"run of {recording.name}"
    status = main(
        ["check", scene, "--recording", str(recording), "--out", str(out), "--pictures", "0"]
    )
    told = "".join(capsys.readouterr())
    assert (out / "verdict.json").exists(), told
    (verdict,) = json.loads((out / "verdict.json").read_text("utf-8"))["cullers"].values()
    return status, verdict, told


def assert_valid(recording: Path) -> None:
    """Each line fits the schema."""
    validator = jsonschema.Draft202012Validator(schema("recording"))
    for line in strict_lines(recording.read_bytes()):
        validator.validate(line)


def assert_safe(scene: str, recording: Path, capsys, frames: int = 4) -> None:
    status, verdict, told = judged(scene, recording, capsys)
    assert status == 0, told
    assert (verdict["status"], verdict["frames"]) == ("no_violation_found", frames)
    assert verdict["visible"] > frames


def assert_loses(name: str, scene: str, recording: Path, capsys) -> None:
    status, verdict, told = judged(scene, recording, capsys)
    assert status == 1, told
    assert verdict["status"] == "violation"
    assert verdict["worst"]["object_name"] == name
    assert name in told


# The cases that an issue's reader looks for: a C program, a page, a text as GDScript writes it.


@pytest.mark.needs("gcc")
def test_c_example_ends_in_a_verdict(scene, tmp_path, capsys):
    source = RECORDERS / "c" / "example.c"
    compiled(["gcc", "-std=c99", *STRICT, source, "-o", "engine", "-lm"], tmp_path)
    subprocess.run([tmp_path / "engine", "safe.jsonl"], cwd=tmp_path, check=True)
    subprocess.run([tmp_path / "engine", "loses.jsonl", "beside"], cwd=tmp_path, check=True)
    assert_valid(tmp_path / "safe.jsonl")
    assert_safe(scene, tmp_path / "safe.jsonl", capsys)
    assert_loses("beside", scene, tmp_path / "loses.jsonl", capsys)


# The page's own scripts, run in the order in which it has them.
IN_NODE = """
const [fs, vm, path] = [require("fs"), require("vm"), require("path")];
const page = process.argv[2];
const scripts = /<script(?: src="(.*?)")?>(.*?)<.script>/gs;
for (const [, src, text] of fs.readFileSync(page, "utf8").matchAll(scripts)) {
  vm.runInThisContext(src ? fs.readFileSync(path.join(path.dirname(page), src), "utf8") : text);
}
(async () => {
  fs.writeFileSync("safe.jsonl", await record().close().text());
  fs.writeFileSync("loses.jsonl", await record("front").close().text());
})();
"""


@pytest.mark.needs("node")
def test_page_run_by_node_ends_in_a_verdict(scene, tmp_path, capsys):
    (tmp_path / "run.cjs").write_text(IN_NODE, encoding="utf-8")
    page = RECORDERS / "javascript" / "example.html"
    subprocess.run(["node", "run.cjs", page], cwd=tmp_path, check=True)
    assert_safe(scene, tmp_path / "safe.jsonl", capsys)
    assert_loses("front", scene, tmp_path / "loses.jsonl", capsys)


@pytest.mark.skipif(chromium.FOUND is None, reason="there is no Chromium")
def test_page_in_a_browser_ends_in_a_verdict(scene, tmp_path, capsys):
    """And its button hands a file to the user."""
    with chromium.browser() as page:
        page.call("Page.setDownloadBehavior", behavior="allow", downloadPath=str(tmp_path))
        page.open(RECORDERS / "javascript" / "example.html")
        page.run("record('front').close().text().then((text) => { globalThis.told = text; })")
        while not (told := page.run("globalThis.told")):
            pass
        page.click("button")
        while not (tmp_path / "recording.jsonl").exists():
            page.run("1")
        assert page.problems == []
    (tmp_path / "loses.jsonl").write_text(told, encoding="utf-8")
    assert_safe(scene, tmp_path / "recording.jsonl", capsys)
    assert_loses("front", scene, tmp_path / "loses.jsonl", capsys)


@pytest.mark.parametrize("lost", [None, "behind"])
def test_text_as_gdscript_writes_it_ends_in_a_verdict(lost, scene, tmp_path, capsys):
    """`data/godot.jsonl` was written by the GDScript recorder in Godot; for the engine that loses
    an object its name is taken out of it."""
    text = (DATA / "godot.jsonl").read_text("utf-8")
    file = tmp_path / "godot.jsonl"
    file.write_text(text if lost is None else text.replace(f',"{lost}"', ""), encoding="utf-8")
    if lost is None:
        assert_safe(scene, file, capsys)
    else:
        assert file.read_text("utf-8") != text
        assert_loses(lost, scene, file, capsys)


def calls_of_an_engine(forgotten: str = "") -> list[Call]:
    """Past the three boxes, with `side`: both `front` and `beside`, said as a group."""
    calls: list[Call] = [("field", "near", 0.1, None), ("field", "far", float("inf"), None)]
    calls += [("field", "yfov", 0.9, None), ("group", "side", ["front", "beside"])]
    for frame in range(4):
        pose = [
            1.0,
            0.0,
            0.0,
            frame,
            0.0,
            1.0,
            0.0,
            0.5,
            0.0,
            0.0,
            1.0,
            10.0 - 2 * frame,
            0.0,
            0.0,
            0.0,
            1.0,
        ]
        drawn = [name for name in ("side", "behind") if name != forgotten]
        calls += [("begin_frame", 3 * frame), ("visible_names", drawn, None)]
        calls += [("camera", "world_from_camera", "column_major", pose, None)]
        calls += [
            ("bounds", "behind", [-1.0, -1.0, -6.0], [1.0, 1.0, -4.0]),
            ("stat", "queries", 3),
        ]
        calls += [("end_frame",)]
    return calls


OF_ENGINES = Recordings(
    Recording("safe.jsonl", calls_of_an_engine()),
    Recording("behind.jsonl", calls_of_an_engine("behind")),
)


@each()
def test_what_each_recorder_writes_ends_in_a_verdict(language: Language, scene, tmp_path, capsys):
    assert OF_ENGINES.run(language, tmp_path) == ["ok", "ok"]
    assert_valid(tmp_path / "safe.jsonl")
    assert_safe(scene, tmp_path / "safe.jsonl", capsys)
    assert_loses("behind", scene, tmp_path / "behind.jsonl", capsys)


def calls_before_a_crash() -> list[Call]:
    calls = [*calls_of_an_engine(), ("flush",)]
    for frame in range(20, 40):
        calls += [
            ("begin_frame", frame),
            calls[6],
            ("visible_names", ["side", "behind"], None),
            ("end_frame",),
        ]
    return [*calls, ("kill",)]


OF_KILLED = Recordings(Recording("killed.jsonl", calls_before_a_crash()))


@each()
def test_recording_of_an_engine_that_was_killed_is_judged_up_to_its_last_whole_line(
    language: Language, scene, tmp_path, capsys
):
    assert OF_KILLED.run(language, tmp_path) == []
    # Wherever the crash cut it.
    text = (tmp_path / "killed.jsonl").read_bytes()
    lines = text.split(b"\n")
    cut = tmp_path / "cut.jsonl"
    cut.write_bytes(b"\n".join(lines[:4]) + b"\n" + lines[4][:40])
    assert_safe(scene, cut, capsys, frames=3)
    status, verdict, told = judged(scene, tmp_path / "killed.jsonl", capsys)
    assert status == 0, told
    assert verdict["frames"] == text.count(b"\n") - 1
    assert ("not whole" in told) == (not text.endswith(b"\n"))


# A frame that gets no camera, behind good ones.
OF_STOPPED = Recordings(
    Recording("stopped.jsonl", [*calls_of_an_engine(), ("begin_frame", 77), ("end_frame",)])
)


@each()
def test_recording_that_a_recorder_gave_up_is_judged_up_to_there_and_the_verdict_says_why(
    language: Language, scene, tmp_path, capsys
):
    assert OF_STOPPED.run(language, tmp_path) == ["problem: frame 77: no camera"]
    file = tmp_path / "stopped.jsonl"
    assert_valid(file)
    status, verdict, told = judged(scene, file, capsys)
    assert (status, verdict["frames"]) == (0, 4), told
    assert "frame 77: no camera" in told


def opengl(frame: int) -> np.ndarray:
    """clip_from_world of the engine's camera, as gluPerspective and a translation make it."""
    near, far, f = 0.1, 100.0, 1 / math.tan(0.45)
    clip = np.array([
        [f * 48 / 64, 0, 0, 0],
        [0, f, 0, 0],
        [0, 0, (far + near) / (near - far), 2 * far * near / (near - far)],
        [0, 0, -1, 0],
    ])  # fmt: skip
    view = np.eye(4)
    view[:3, 3] = -frame, -0.5, 2 * frame - 10
    return clip @ view


# Vulkan's clip space: y down, depths from 0 to 1, and from 1 to 0 where they are reversed.
DOWN = np.diag([1.0, -1.0, 1.0, 1.0])
HALVED = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0.5, 0.5], [0, 0, 0, 1]])
REVERSED = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -0.5, 0.5], [0, 0, 0, 1]])


def of_conventions() -> Recordings:
    conventions = {"-1..1": np.eye(4), "0..1": DOWN @ HALVED, "1..0": REVERSED}
    recordings = []
    for depth, change in conventions.items():
        calls: list[Call] = [("text", "clip_depth", depth)]
        calls += (
            [("text", "clip_y", "down")]
            if change is not conventions["-1..1"] and depth == "0..1"
            else []
        )
        for frame in range(4):
            matrix = [float(x) for x in (change @ opengl(frame)).flat]
            calls += [
                ("begin_frame", frame),
                ("camera", "clip_from_world", "column_major", matrix, None),
            ]
            # From frame 1 on, `beside` is left out.
            calls += [
                ("visible_names", ["front", "behind", *["beside"] * (frame < 1)], None),
                ("end_frame",),
            ]
        recordings.append(Recording(f"clip {len(recordings)}.jsonl", calls))
    return Recordings(*recordings)


OF_CONVENTIONS = of_conventions()


@each()
def test_view_projection_matrices_of_each_convention_are_judged(language, scene, tmp_path, capsys):
    """No field of view, near or far: they are read from the matrix."""
    assert OF_CONVENTIONS.run(language, tmp_path) == ["ok"] * 3
    for number in range(3):
        assert_valid(tmp_path / f"clip {number}.jsonl")
        assert_loses("beside", scene, tmp_path / f"clip {number}.jsonl", capsys)


def calls_of_two_views() -> list[Call]:
    """`beside` is left out of the right view alone, which sees it; the left one is smaller."""
    calls: list[Call] = [("field", "near", 0.1, None), ("field", "far", math.inf, None)]
    calls += [("field", "yfov", 0.9, None), ("begin_frame", 5)]
    for view, x in (("left", -1.0), ("right", 1.0)):
        pose = [1.0, 0.0, 0.0, x, 0.0, 1.0, 0.0, 0.5, 0.0, 0.0, 1.0, 12.0, 0.0, 0.0, 0.0, 1.0]
        calls += [("camera", "world_from_camera", "row_major", pose, view)]
        calls += [("visible_names", ["front", "behind", *["beside"] * (view == "left")], view)]
    calls += [("field", "width", 32.0, "left"), ("field", "height", 24.0, "left")]
    return [*calls, ("end_frame",)]


OF_VIEWS = Recordings(Recording("views.jsonl", calls_of_two_views()))


@each()
def test_sets_of_two_views_are_judged_by_view(language, scene, tmp_path, capsys):
    assert OF_VIEWS.run(language, tmp_path) == ["ok"]
    assert_valid(tmp_path / "views.jsonl")
    status, verdict, told = judged(scene, tmp_path / "views.jsonl", capsys)
    assert status == 1, told
    assert (verdict["worst"]["object_name"], verdict["worst"]["view"]) == ("beside", "right")
