"""The command line as a stranger uses it: statuses, files, and bad input in one line."""

from __future__ import annotations

import json
import math
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import trimesh

from tests.support.bad_input import BAD_INPUT
from visref.cli.main import main
from visref.inputs import open_inputs
from visref.registry import make_culler

REAL_MODEL = Path("/usr/share/assimp/models/glTF2/2CylinderEngine-glTF-Binary/2CylinderEngine.glb")


def write_scene(folder: Path, frames: int = 2) -> tuple[str, str]:
    """Two boxes, one behind the other, and a third beside them; a path of so many equal frames."""
    scene = trimesh.Scene()
    for name, centre in (("front", (0, 0, 0)), ("behind", (0, 0, -5)), ("beside", (3, 0, 0))):
        box = trimesh.creation.box((2, 2, 2))
        box.apply_translation(centre)
        scene.add_geometry(box, node_name=name, geom_name=name)
    (folder / "scene.glb").write_bytes(scene.export(file_type="glb"))
    pose = np.eye(4)
    pose[2, 3] = 10.0
    path = {
        "format": "visref-path",
        "version": 1,
        "width": 64,
        "height": 48,
        "near": 0.1,
        "far": None,
        "yfov": 0.9,
        "frames": [{"world_from_camera": pose.tolist()}] * frames,
    }
    (folder / "path.json").write_text(json.dumps(path))
    return str(folder / "scene.glb"), str(folder / "path.json")


def record(folder: Path, *frames: list[str]) -> str:
    file = folder / "drawn.jsonl"
    rows = [json.dumps({"frame": i, "visible": names}) for i, names in enumerate(frames)]
    file.write_text("\n".join(rows) + "\n")
    return str(file)


@pytest.fixture
def inputs(tmp_path):
    return write_scene(tmp_path)


def check(inputs, tmp_path, visible, *more):
    scene, path = inputs
    out = tmp_path / "run"
    arguments = ["check", scene, "--path", path, "--visible", visible, "--out", str(out)]
    status = main([*arguments, *more])
    verdict = out / "verdict.json"
    return status, json.loads(verdict.read_text()) if verdict.exists() else None


def test_engine_that_draws_what_is_visible_passes(inputs, tmp_path):
    visible = record(tmp_path, ["front", "beside"], ["front", "beside"])
    status, verdict = check(inputs, tmp_path, visible)
    assert status == 0
    assert verdict["status"] == "no_violation_found"
    (sums,) = verdict["cullers"].values()
    assert (sums["visible"], sums["drawn"], sums["superfluous"]) == (4, 4, 0)


def test_engine_that_forgets_a_visible_object_is_convicted_with_a_witness(inputs, tmp_path, capsys):
    visible = record(tmp_path, ["front", "beside", "behind"], ["front"])
    status, verdict = check(inputs, tmp_path, visible)
    assert status == 1
    assert verdict["exit_status"] == 1
    (sums,) = verdict["cullers"].values()
    assert (sums["missed"], sums["confirmed"], sums["violations"]) == (1, 1, 1)
    assert sums["superfluous"] == 1
    worst = sums["worst"]
    assert (worst["object_name"], worst["frame"]) == ("beside", 1)
    assert sums["missed_pixels"] == worst["pixels"] == worst["owned"] > 0
    assert "MISSED_OBJECT" in capsys.readouterr().out


def test_declared_approximate_engine_is_measured_not_convicted(inputs, tmp_path):
    visible = record(tmp_path, ["front"], ["front"])
    status, verdict = check(inputs, tmp_path, visible, "--promise", "approximate")
    assert status == 0
    (sums,) = verdict["cullers"].values()
    assert (sums["confirmed"], sums["violations"]) == (2, 0)


def test_a_run_in_which_nothing_is_visible_is_inconclusive(inputs, tmp_path):
    _, path = inputs
    data = json.loads(Path(path).read_text())
    for frame in data["frames"]:
        frame["world_from_camera"][2][3] = -100.0
    Path(path).write_text(json.dumps(data))
    visible = record(tmp_path, ["front"], [])
    status, verdict = check(inputs, tmp_path, visible)
    assert status == 3
    assert verdict["status"] == "inconclusive"
    assert "NOTHING_JUDGED" in {finding["code"] for finding in verdict["findings"]}


def test_a_truth_file_gives_the_same_verdict_as_casting_again(inputs, tmp_path):
    scene, path = inputs
    truth = tmp_path / "truth.parquet"
    assert main(["truth", scene, "--path", path, "--out", str(truth)]) == 0
    for frames in (
        (["front", "beside"], ["front", "beside", "behind"]),
        (["front"], ["behind", "beside"]),
    ):
        visible = record(tmp_path, *frames)
        cast = check(inputs, tmp_path, visible)
        reused = check(inputs, tmp_path, visible, "--truth", str(truth))
        assert cast[0] == reused[0]
        assert cast[1]["cullers"] == reused[1]["cullers"]
        # The folder needs the file no longer, and knows the samples owned either way.
        kept = tmp_path / "run" / "truth.parquet"
        assert kept.read_bytes() == truth.read_bytes()
        owned = pq.read_table(tmp_path / "run" / "frames.parquet")["owned"].to_pylist()
        assert all(count > 0 for count in owned)


def test_a_far_that_hides_the_scene_is_said_by_truth_and_check(inputs, tmp_path, capsys):
    scene, path = inputs
    data = json.loads(Path(path).read_text())
    # The boxes are nine units before the camera, and further.
    Path(path).write_text(json.dumps({**data, "far": 1.0}))
    said = "FAR_HIDES: far = 1 hides 100 % of what the cameras meet, in 2 frames"
    truth = str(tmp_path / "truth.parquet")
    assert main(["truth", scene, "--path", path, "--out", truth]) == 0
    assert said in " ".join(capsys.readouterr().out.split())
    _, verdict = check(inputs, tmp_path, record(tmp_path, ["front"], []))
    assert f"FAR_HIDES: {verdict['findings'][0]['message']}" == said
    assert said in " ".join(capsys.readouterr().out.split())
    Path(path).write_text(json.dumps({**data, "far": 100.0}))
    assert main(["truth", scene, "--path", path, "--out", truth]) == 0
    assert "FAR_HIDES" not in capsys.readouterr().out


def test_a_generated_scenes_seed_is_recorded_though_nobody_gave_it():
    spec = "city:scale=0.01,frames=2"
    opened = open_inputs(spec, path=None, frames=None, engine="embree")
    assert opened.settings["generated"] == {"seed": 0, "scale": 0.01, "frames": 2}


def test_a_truth_file_is_followed_by_the_engine_that_cast_it(inputs, tmp_path, capsys):
    scene, path = inputs
    both = trimesh.load(scene)
    both.add_geometry(both.geometry["front"].copy(), node_name="twin", geom_name="twin")
    Path(scene).write_bytes(both.export(file_type="glb"))
    truth = str(tmp_path / "truth.parquet")
    arguments = ["truth", scene, "--path", path, "--out", truth, "--engine", "exact"]
    assert main(arguments) == 0
    # One of the twins: Embree, which lists no tie, sees only one of them.
    for drawn in (["front", "beside"], ["twin", "beside"]):
        visible = record(tmp_path, drawn, drawn)
        cast = check(inputs, tmp_path, visible, "--engine", "exact")
        reused = check(inputs, tmp_path, visible, "--truth", truth)
        assert cast[1]["cullers"]["drawn.jsonl"]["ties"] == 2
        assert cast == reused
    status, _ = check(inputs, tmp_path, visible, "--truth", truth, "--engine", "open3d")
    assert status == 2
    assert "it was cast by 'exact', not 'open3d'" in capsys.readouterr().err


def test_who_cast_a_truth_file_is_told_even_if_nothing_was_cast_again(inputs, tmp_path):
    scene, path = inputs
    truth = str(tmp_path / "truth.parquet")
    assert main(["truth", scene, "--path", path, "--out", truth]) == 0
    visible = record(tmp_path, ["front", "beside"], ["front", "beside"])
    assert check(inputs, tmp_path, visible, "--truth", truth) == check(inputs, tmp_path, visible)


def test_a_breakdown_of_visref_is_no_verdict(inputs, tmp_path, monkeypatch, capsys):
    def breaks(given):
        raise RuntimeError("boom")

    monkeypatch.setattr("visref.cli.doctor.run", breaks)
    assert main(["doctor"]) == 70
    assert "boom" in capsys.readouterr().err


def test_names_are_printed_as_they_are(inputs, tmp_path, capsys):
    scene, _ = inputs
    odd = trimesh.load(scene)
    odd.add_geometry(trimesh.creation.box(), node_name="[/red] :b: box", geom_name="odd")
    Path(scene).write_bytes(odd.export(file_type="glb"))
    assert main(["objects", scene]) == 0
    assert "[/red] :b: box" in capsys.readouterr().out
    visible = Path(record(tmp_path, ["front", "beside"], ["front", "beside"]))
    named = visible.rename(tmp_path / "[bold] :b:.jsonl")
    check(inputs, tmp_path, str(named))
    assert "[bold] :b:.jsonl" in capsys.readouterr().out


def test_truth_file_has_the_promised_columns_and_metadata(inputs, tmp_path):
    scene, path = inputs
    truth = tmp_path / "truth.parquet"
    arguments = ["truth", scene, "--path", path, "--out", str(truth), "--engine", "exact"]
    assert main([*arguments, "--frames", "1:"]) == 0
    table = pq.read_table(truth)
    assert dict(zip(table.schema.names, map(str, table.schema.types), strict=True)) == {
        "frame": "int32",
        "view": "string",
        "object": "int32",
        "name": "string",
        "pixels": "int64",
        "status": "string",
        "x": "int32",
        "y": "int32",
        "depth": "double",
    }
    facts = json.loads(table.schema.metadata[b"visref"])
    assert (facts["engine"], facts["ties_complete"], facts["frames"]) == ("exact", True, [1])
    rows = {row["name"]: row for row in table.to_pylist()}
    assert set(rows) == {"front", "beside"}
    # The front box's face is at z = 1, the eye at z = 10, and it lies across the view.
    assert rows["front"]["depth"] == 9.0


def test_truth_of_another_scene_is_refused(inputs, tmp_path, capsys):
    scene, path = inputs
    truth = tmp_path / "truth.parquet"
    main(["truth", scene, "--path", path, "--out", str(truth)])
    other = tmp_path / "other"
    other.mkdir()
    data = json.loads(Path(path).read_text())
    data["yfov"] = 0.8
    (other / "path.json").write_text(json.dumps(data))
    visible = record(tmp_path, ["front", "beside"], ["front", "beside"])
    moved = (scene, str(other / "path.json"))
    status, _ = check(moved, tmp_path, visible, "--truth", str(truth))
    assert status == 2
    assert "another path" in capsys.readouterr().err


def one_line(text: str) -> str:
    assert text.endswith("\n")
    assert text.count("\n") == 1
    assert "Traceback" not in text
    return text.strip()


@pytest.mark.slow
@pytest.mark.parametrize("case", BAD_INPUT, ids=lambda case: case[0])
def test_bad_scene_or_path_is_one_line_and_status_2(case, tmp_path, capsys):
    _, make, expected = case
    scene, path = make(tmp_path)
    out = tmp_path / "out" / "truth.parquet"
    arguments = ["truth", str(scene), "--out", str(out)]
    assert main([*arguments, *(["--path", str(path)] if path is not None else [])]) == 2
    assert expected in one_line(capsys.readouterr().err)
    assert not out.exists()
    assert not out.parent.exists() or not list(out.parent.iterdir())


BAD_ARGUMENTS = {
    "unknown culler": (["run", "--culler", "occlusion-qery"], "did you mean 'occlusion-query'?"),
    "unknown option": (["run", "--culler", "none:speed=9"], "no option 'speed'"),
    "option of another type": (["run", "--culler", "occlusion-query:size=big"], "not a int"),
    "option out of its choices": (["run", "--culler", "occlusion-query:query=psychic"], "choice"),
    "option twice": (["run", "--culler", "occlusion-query:size=1,size=2"], "comes twice"),
    "option without a value": (["run", "--culler", "occlusion-query:size"], "option=value"),
    "unknown module": (["run", "--culler", "nowhere_at_all:Class"], "nowhere_at_all"),
    "unknown class": (["run", "--culler", "visref_culling.baselines:Nothing"], "has no 'Nothing'"),
    "class that is no culler": (["run", "--culler", "json:JSONDecoder"], "subclass"),
    "unknown engine": (["truth", "--engine", "embre"], "did you mean 'embree'?"),
    "no threads": (["truth", "--threads", "0"], "--threads is 0"),
    "frames that are no slice": (["truth", "--frames", "one"], "is no slice"),
    "frames beyond the path": (["truth", "--frames", "7:9"], "none of the path's 2 frames"),
    "frames backwards": (["truth", "--frames", "::-1"], "in order"),
    "negative pictures": (["run", "--culler", "none", "--pictures", "-1"], "--pictures is -1"),
    "no such recording": (["check", "--visible", "none.jsonl"], "none.jsonl: cannot read the file"),
    "raster not understood": (
        ["check", "--visible", "none.jsonl", "--raster", "tight"],
        "not understood",
    ),
    "no such truth": (["run", "--culler", "none", "--truth", "no.parquet"], "truth file"),
}


@pytest.mark.parametrize("name", BAD_ARGUMENTS)
def test_bad_argument_is_one_line_and_status_2(name, inputs, tmp_path, capsys):
    (command, *more), expected = BAD_ARGUMENTS[name]
    scene, path = inputs
    if more[0] == "--visible" and "--raster" in more:
        more[1] = record(tmp_path, ["front"], ["front"])
    out = tmp_path / "out.parquet"
    assert main([command, scene, "--path", path, "--out", str(out), *more]) == 2
    assert expected in one_line(capsys.readouterr().err)
    assert not out.exists()


def test_scene_without_a_path_asks_for_one(inputs, tmp_path, capsys):
    mesh = tmp_path / "box.stl"
    trimesh.creation.box().export(mesh)
    assert main(["truth", str(mesh), "--out", str(tmp_path / "t.parquet")]) == 2
    assert "--path" in one_line(capsys.readouterr().err)


def test_report_of_a_folder_that_is_no_run_is_refused(tmp_path, capsys):
    assert main(["report", str(tmp_path), "--out", str(tmp_path / "page")]) == 2
    assert str(tmp_path) in one_line(capsys.readouterr().err)


def test_folder_of_somebody_elses_is_not_replaced(inputs, tmp_path, capsys):
    scene, path = inputs
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("x")
    arguments = ["run", scene, "--path", path, "--culler", "none"]
    assert main([*arguments, "--out", str(tmp_path / "mine")]) == 2
    assert "not empty" in one_line(capsys.readouterr().err)
    assert (tmp_path / "mine" / "thesis.tex").exists()


@pytest.mark.gl
def test_run_with_one_and_two_threads_leaves_the_same_bytes(inputs, tmp_path):
    scene, path = inputs
    folders = []
    for threads in ("1", "2"):
        out = tmp_path / threads
        arguments = ["run", scene, "--path", path, "--threads", threads, "--out", str(out)]
        cullers = [
            "--culler",
            "occlusion-query",
            "--culler",
            "visref_culling.broken:HastyQueryCulling",
        ]
        main([*arguments, *cullers])
        folders.append(out)
    names = sorted(str(p.relative_to(folders[0])) for p in folders[0].rglob("*") if p.is_file())
    assert names == sorted(
        str(p.relative_to(folders[1])) for p in folders[1].rglob("*") if p.is_file()
    )
    for name in set(names) - {"timings.parquet"}:
        assert (folders[0] / name).read_bytes() == (folders[1] / name).read_bytes(), name


@pytest.mark.slow
@pytest.mark.gl
@pytest.mark.skipif(not REAL_MODEL.exists(), reason="Debian's assimp-testmodels is not installed")
def test_a_real_model_goes_through_truth_run_and_report(tmp_path):
    """A two-cylinder engine of 115 parts, orbited; drawn by its author, not by us."""
    from visref.camera import Camera, look_at
    from visref.camera_path import CameraPath
    from visref.formats import load_scene

    low, high = load_scene(REAL_MODEL).core_bounds
    centre, size = (low + high) / 2, float(np.linalg.norm(high - low))
    frames = tuple(
        Camera(
            look_at(centre + size * np.array([math.cos(turn), 0.3, math.sin(turn)]), centre),
            160,
            120,
            near=size / 100,
            yfov=0.9,
        )
        for turn in (0.3, 2.1)
    )
    path = tmp_path / "orbit.json"
    path.write_text(json.dumps(CameraPath(frames).to_json()))
    truth, run = tmp_path / "truth.parquet", tmp_path / "run"
    scene = [str(REAL_MODEL), "--path", str(path)]
    assert main(["truth", *scene, "--engine", "exact", "--out", str(truth)]) == 0
    seen = {(row["frame"], row["object"]) for row in pq.read_table(truth).to_pylist()}
    assert 20 < len(seen) < 2 * 115
    assert main(["run", *scene, "--culler", "occlusion-query", "--out", str(run)]) == 0
    (sums,) = json.loads((run / "verdict.json").read_text())["cullers"].values()
    assert sums["missed"] - sums["ties"] == 0
    assert sums["drawn"] >= sums["visible"]
    assert main(["report", str(run), "--out", str(tmp_path / "page")]) == 0
    page = (tmp_path / "page" / "report.html").read_text()
    assert re.search(r"no violation found", page, re.IGNORECASE)


@pytest.mark.slow
def test_the_module_runs_as_a_program(inputs):
    scene, _ = inputs
    command = [sys.executable, "-m", "visref", "objects", scene, "--json"]
    result = subprocess.run(command, capture_output=True, text=True, check=True)
    rows = json.loads(result.stdout)
    assert {row["name"] for row in rows} == {"front", "behind", "beside"}
    assert sum(row["triangles"] for row in rows) == 36


def test_a_plug_ins_folder_stands_last_once_the_plug_in_is_imported(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    for name in ("one_of_mine", "other_of_mine"):
        (tmp_path / f"{name}.py").write_text("from visref_culling.baselines import NoCulling\n")
        assert make_culler(f"{name}:NoCulling").name == "none"
        assert sys.path.index(str(tmp_path)) == len(sys.path) - 1


@pytest.mark.slow
def test_a_reader_that_stops_reading_changes_no_status():
    reader, writer = os.pipe()
    os.close(reader)
    try:
        run = subprocess.run(
            [sys.executable, "-m", "visref", "cullers"],
            stdout=writer,
            stderr=subprocess.PIPE,
            check=False,
        )
    finally:
        os.close(writer)
    assert (run.returncode, run.stderr) == (0, b"")


@pytest.mark.slow
def test_a_set_of_scenes_is_refused_in_one_line(tmp_path, capsys):
    given = ["run", "hard", "--culler", "none", "--out", str(tmp_path / "run")]
    assert main(given) == 2
    error = capsys.readouterr().err
    assert "a set of 63 scenes" in error
    assert error.count("\n") == 1


def test_of_many_missed_objects_the_console_has_the_first_ten_and_how_many_more(tmp_path, capsys):
    _, path = write_scene(tmp_path)
    lines = []
    for number in range(35):
        x, y = number % 7 - 3.5, number // 7 - 2.5
        lines += [f"o part {number}", f"v {x} {y} 0", f"v {x + 0.9} {y} 0", f"v {x} {y + 0.9} 0"]
        lines.append(f"f {3 * number + 1} {3 * number + 2} {3 * number + 3}")
    (tmp_path / "many.obj").write_text("\n".join(lines) + "\n", encoding="utf-8")
    visible = record(tmp_path, [], [])
    status, verdict = check((str(tmp_path / "many.obj"), path), tmp_path, visible)
    assert status == 1
    told = [f for f in verdict["findings"] if f["code"] == "MISSED_OBJECT"]
    assert len(told) == 35
    printed = capsys.readouterr().out
    assert len(re.findall("^MISSED_OBJECT: ", printed, flags=re.MULTILINE)) == 10
    assert "… and 25 more findings in verdict.json" in printed
