"""Policies on the command line, on scenes whose misses have sizes and ages known beforehand.

A pixel is a tenth of a unit; what comes into view does so because the path says that it was absent.
"""

from __future__ import annotations

import json

import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.cases.files import add_rectangle, check_rows, write_path
from tests.cases.unsteady import STATE, Unsteady
from tests.support.gltf_files import Gltf
from tests.support.hand_made import camera
from visref.camera_path import CameraPath, Frame
from visref.cli.main import main
from visref.culler import Culler, DrawnSet
from visref.engines import make_engine
from visref.judging.policy import Policy
from visref.judging.referee import Referee
from visref.run_folder.read import read_run
from visref.scene import Scene, Units
from visref.timeline import Timeline

pytestmark = pytest.mark.slow

# By name, sides in pixels: samples of each.
SIZES = {"lamp": (4, 5), "bolt": (3, 3), "nut": (2, 4)}
ALL = ("lamp", "bolt", "nut", "hill")


def room(folder, frames):
    """Three rectangles side by side before a hill; `frames`: who is absent in each, and cuts."""
    gltf = Gltf()
    for index, (name, (width, height)) in enumerate(SIZES.items()):
        left = -3.0 + 2.0 * index
        add_rectangle(gltf, name, left, 0.0, left + 0.1 * width, 0.1 * height, -5.0)
    add_rectangle(gltf, "hill", -10.0, -5.0, 30.0, 5.0, -8.0)
    write_path(folder, each=frames)
    return gltf.write(folder / "scene.glb")


def judged(folder, scene, rows, policy="", *more):
    given = []
    if policy:
        (folder / "visref.toml").write_text(policy)
        given = ["--policy", str(folder / "visref.toml"), *more]
    drawn = [{"visible": list(names)} for names in rows]
    return check_rows(scene, *drawn, engine="embree", more=given)


def newest(folder):
    return max(folder.glob("run*"), key=lambda run: int(run.name[3:]))


def without(*names):
    return tuple(name for name in ALL if name not in names)


# The lamp is switched on in frame 2, off in frame 5, and on again in frame 6.
SWITCHED = [{"absent": ["lamp"]} if at in (0, 1, 5) else {} for at in range(8)]
LATE = [ALL, ALL, without("lamp"), without("lamp"), ALL, ALL, without("lamp"), ALL]


@pytest.mark.parametrize(
    ("latency", "status", "late", "confirmed"), [(0, 1, 0, 3), (1, 1, 2, 1), (2, 0, 3, 0)]
)
def test_misses_are_late_below_their_age_in_frames(tmp_path, latency, status, late, confirmed):
    scene = room(tmp_path, SWITCHED)
    one = judged(tmp_path, scene, LATE, f"latency_frames = {latency}\n")
    assert (one.status, one.sums["late"], one.sums["confirmed"]) == (status, late, confirmed)
    assert one.sums["violations"] == confirmed
    # Ages are raw: whatever is accepted, they say what was found.
    assert one.sums["ages"] == {"0": 2, "1": 1}
    assert one.sums["missed"] == 3
    rows = pq.read_table(newest(tmp_path) / "objects.parquet").to_pylist()
    told = [(row["frame"], row["age"], row["kind"]) for row in rows if row["kind"] != "superfluous"]
    assert told == [
        (frame, age, "late" if age < latency else "confirmed")
        for frame, age in ((2, 0), (3, 1), (6, 0))
    ]


def test_at_a_cut_and_in_the_first_frame_nothing_is_late(tmp_path):
    frames = [dict(one) for one in SWITCHED]
    frames[2]["cut"] = True
    scene = room(tmp_path, frames)
    rows = [without("bolt"), ALL, without("lamp"), ALL, ALL, ALL, without("lamp"), ALL]
    one = judged(tmp_path, scene, rows, "latency_frames = 100\n")
    assert (one.status, one.sums["late"], one.sums["confirmed"]) == (1, 1, 2)
    assert one.sums["ages"] == {"0": 1}


@pytest.mark.parametrize(
    ("least", "status", "small"), [(8, 1, 0), (9, 1, 1), (10, 1, 2), (20, 1, 2), (21, 0, 3)]
)
def test_what_loses_fewer_samples_is_small(tmp_path, least, status, small):
    scene = room(tmp_path, [{}])
    one = judged(tmp_path, scene, [("hill",)], f"min_samples = {least}\n")
    assert (one.status, one.sums["small"], one.sums["confirmed"]) == (status, small, 3 - small)
    assert one.sums["missed_pixels"] == 20 + 9 + 8
    manifest = json.loads((newest(tmp_path) / "manifest.json").read_text())
    assert manifest["policy"]["min_samples"] == least
    assert len(manifest["policy"]["sha256"]) == 64


WAIVERS = """
[[waive]]
object = "[bn]*t"
reason = "screws; #31"
frames = "0:2"
expires = 2030-01-31
"""


@pytest.mark.parametrize(
    ("today", "rows", "status", "waived", "stale"),
    [
        ("2030-01-31", [without("bolt"), ALL], 0, 1, 0),
        ("2030-01-31", [without("bolt", "nut"), without("nut")], 0, 3, 0),
        ("2030-01-31", [without("bolt", "lamp"), ALL], 1, 1, 0),
        # Nothing is missed that it names: it is stale, and the culler is well all the same.
        ("2030-01-31", [ALL, ALL], 1, 0, 1),
        ("2030-02-01", [without("bolt"), ALL], 1, 1, 1),
    ],
)
def test_waivers_excuse_what_they_name_and_fail_the_run_when_stale(
    tmp_path, capsys, today, rows, status, waived, stale
):
    scene = room(tmp_path, [{}, {}])
    one = judged(tmp_path, scene, rows, WAIVERS, "--today", today)
    assert (one.status, one.sums["waived"]) == (status, waived)
    assert [code for code, _, _ in one.findings].count("STALE_WAIVER") == stale
    assert one.sums["status"] == ("violation" if one.sums["confirmed"] else "no_violation_found")
    run = read_run(newest(tmp_path))
    assert (run.verdict.status == "violation", run.exit) == (status == 1, status)
    assert run.manifest.policy.today == today
    assert run.manifest.policy.waivers[0].reason == "screws; #31"
    assert ("STALE_WAIVER: waive[0]" in capsys.readouterr().out) == bool(stale)
    assert main(["report", str(run.folder), "--out", str(tmp_path / "page")]) == status
    for name in ("junit.xml", "summary.md", "report.html"):
        text = (tmp_path / "page" / name).read_text()
        assert ("STALE" in text) == bool(stale)
        assert "visref.toml" in text
    junit = (tmp_path / "page" / "junit.xml").read_text()
    # A case for the culler, and one for the object that convicts it: the lamp alone.
    assert f'failures="{stale + 2 * bool(one.sums["confirmed"])}"' in junit


def test_first_adoption_writes_an_entry_an_object_and_asks_for_its_reason(tmp_path, capsys):
    scene = room(tmp_path, [{}, {}, {}])
    rows = [without("lamp"), without("lamp", "nut"), ALL]
    file = tmp_path / "adopted.toml"
    drawn = [{"visible": list(names)} for names in rows]
    one = check_rows(scene, *drawn, engine="embree", more=["--write-waivers", str(file)])
    assert one.status == 1
    text = file.read_text()
    capsys.readouterr()
    assert judged(tmp_path, scene, rows, text).status == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "waive[0].reason: the reason is empty" in line
    filled = text.replace('reason = ""', 'reason = "as it always was"')
    one = judged(tmp_path, scene, rows, filled)
    assert (one.status, one.sums["waived"]) == (0, 3)
    # Another frame is another miss.
    one = judged(tmp_path, scene, [*rows[:2], without("lamp")], filled)
    assert (one.status, one.sums["confirmed"]) == (1, 1)
    # Reasons that somebody wrote are never overwritten.
    given = ["--write-waivers", str(file)]
    assert check_rows(scene, *drawn, engine="embree", more=given).status == 2
    assert file.read_text() == text


def test_a_day_without_a_policy_is_refused(tmp_path):
    scene = room(tmp_path, [{}])
    one = check_rows(scene, {"visible": list(ALL)}, engine="embree", more=["--today", "2030-01-01"])
    assert one.status == 2


@pytest.mark.parametrize(("repeat", "status"), [("1", 0), ("2", 3)])
def test_a_culler_that_answers_otherwise_when_it_is_asked_again_is_inconclusive(
    tmp_path, monkeypatch, repeat, status
):
    monkeypatch.setenv(STATE, str(tmp_path / "state"))
    gltf = Gltf()
    add_rectangle(gltf, "hill", -10.0, -5.0, 30.0, 5.0, -8.0)
    add_rectangle(gltf, "hidden", 0.0, 0.0, 1.0, 1.0, -9.0)
    path = write_path(tmp_path, each=[{}, {}])
    scene = gltf.write(tmp_path / "scene.glb")
    spec = f"{Unsteady.__module__}:{Unsteady.__name__}"
    out = tmp_path / "run"
    given = ["run", str(scene), "--path", str(path), "--out", str(out), "--pictures", "0"]
    assert main([*given, "--culler", spec, "--culler", "none", "--repeat", repeat]) == status
    run = read_run(out)
    named = [one.culler for one in run.verdict.findings if one.code == "NOT_DETERMINISTIC"]
    assert named == ([spec] if status else [])
    assert run.verdict.cullers["none"].status == "no_violation_found"
    assert main(["report", str(out), "--out", str(tmp_path / "page")]) == status
    assert ("not deterministic" in (tmp_path / "page" / "summary.md").read_text()) == bool(status)


class OfTriangles(Culler):
    """Decides about triangles; draws what it is told, frame by frame."""

    name = "triangles"

    def __init__(self, *drawn):
        self.drawn = list(drawn)

    def prepare(self, scene):
        count = scene.triangle_count
        return Units(np.arange(count + 1), np.arange(count, dtype=np.int32), "triangle")

    def update(self, scene):
        pass

    def cull(self, camera):
        return DrawnSet(np.array(self.drawn.pop(0), np.int32))


WALL = np.array([[-2, -1, 0], [2, -1, 0], [2, 1, 0], [-2, 1, 0]], np.float64)


@pytest.mark.parametrize(
    ("drawn", "late", "confirmed"),
    [
        # Triangle 1 comes into view in frame 1, triangle 0 is in view by right.
        ([(0, 2), (0,), (0, 1)], 1, 0),
        ([(0, 2), (0, 1), (0,)], 0, 1),
        ([(0, 2), (), (0, 1)], 0, 1),
        ([(0, 2), (1,), (0, 1)], 0, 1),
    ],
)
def test_of_fine_units_an_object_is_late_only_if_every_lost_unit_is(drawn, late, confirmed):
    # In frame 0 a door hides the wall's second triangle, whose outline it has.
    wall, door = (
        (WALL, np.array([[0, 1, 3], [1, 2, 3]])),
        (WALL + np.array((0, 0, 1)), np.array([[1, 2, 3]])),
    )
    scene = Scene.from_objects([("wall", *wall), ("door", *door)])
    path = CameraPath([Frame((camera(),), absent=("door",) if at else ()) for at in range(3)])
    timeline = Timeline(scene, path)
    referee = Referee(
        scene,
        lambda: make_engine("exact", timeline.still),
        timeline=timeline,
        policy=Policy(latency_frames=1),
    )
    (record,) = referee.run(path, range(3), [("fine", OfTriangles(*drawn))]).cullers
    assert not record.failed
    assert (record.totals.late, record.totals.confirmed) == (late, confirmed)
