"""Recordings of several views, and of scenes that move: what counts, and how old misses are."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from tests.support.hand_made import square
from visref.camera import Camera, look_at
from visref.camera_path import CameraPath, Frame
from visref.culler import Culler, DrawnSet, Promise
from visref.engines import make_engine
from visref.inputs import Inputs
from visref.judging.outcome import RunOutcome, verdict_json
from visref.judging.referee import Referee
from visref.recordings.truth_reading import read_truth
from visref.recordings.visible_sets import Replay, read_visible_sets
from visref.report.writing import write_report
from visref.run_folder.read import read_run
from visref.runs import judge_to_folder, truth_to_file
from visref.scene import Scene, Units
from visref.timeline import Timeline


def eye(view: str, towards: float, **changes) -> Camera:
    """8 by 8 samples of a unit each, orthographic, from the origin along Z."""
    pose = look_at((0.0, 0.0, 0.0), (0.0, 0.0, towards))
    return replace(Camera(pose, 8, 8, near=0.1, far=100.0, ymag=4.0), view=view, **changes)


FRONT, REAR, BOTH, NEVER = range(4)
# Seen ahead with 16 samples, behind with 4, at both sides with 4 each, and nowhere.
ROOM = Scene.from_objects(
    [
        ("front", *square(-4.0, 0.0, -5.0, 4.0)),
        ("rear", *square(-2.0, 0.0, 5.0, 2.0)),
        ("both", *square(-4.0, -4.0, -5.0, 2.0)),
        ("never", *square(50.0, 0.0, -5.0)),
    ]
)


def in_both() -> Scene:
    """The room, with the third object on both sides of the eyes."""
    ahead, faces = square(-4.0, -4.0, -5.0, 2.0)
    behind, _ = square(-4.0, -4.0, 5.0, 2.0)
    objects = [(ROOM.names[i], *_part(ROOM, i)) for i in range(4)]
    objects[BOTH] = ("both", np.concatenate([ahead, behind]), np.concatenate([faces, faces + 4]))
    return Scene.from_objects(objects)


def _part(scene: Scene, index: int):
    start, end = scene.object_offsets[index : index + 2]
    triangles = scene.triangles[start:end]
    low = triangles.min()
    return scene.vertices[low : triangles.max() + 1], triangles - low


STEREO = CameraPath([Frame((eye("ahead", -1.0), eye("behind", 1.0)))])


def replayed(tmp_path, scene, path, *lines, truth=None, promise=Promise.CONSERVATIVE):
    """The record of a recording, one line per frame."""
    file = tmp_path / "sets.jsonl"
    file.write_text(
        "".join(json.dumps({"frame": f, **line}) + "\n" for f, line in enumerate(lines))
    )
    timeline = Timeline(scene, path)
    replay = Replay(read_visible_sets(file, scene, range(len(path)), path), path, promise)
    recorded = None if truth is None else read_truth(truth, scene, path, range(len(path)))
    referee = Referee(
        scene,
        lambda: make_engine("exact", timeline.still),
        recorded=recorded,
        timeline=timeline,
    )
    outcome = referee.run(path, range(len(path)), [("replay", replay)])
    return outcome.cullers[0], outcome


@pytest.fixture(params=["cast", "recorded"])
def truth(request, tmp_path):
    """Where the truth of `in_both` is from."""
    if request.param == "cast":
        return None
    inputs = Inputs(in_both(), STEREO, range(1), "exact")
    truth_to_file(inputs, tmp_path / "truth.parquet")
    return tmp_path / "truth.parquet"


def test_one_set_for_all_views_counts_each_object_once(tmp_path, truth):
    visible = {"visible": ["front", "rear", "both", "never"]}
    record, _ = replayed(tmp_path, in_both(), STEREO, visible, truth=truth)
    counts = record.totals
    assert (counts.visible, counts.drawn, counts.superfluous, counts.missed) == (3, 4, 1, 0)
    assert counts.owned_samples == 16 + 4 + 4 + 4
    assert [row.view for row in record.frames] == [""]


def test_what_only_one_view_sees_is_not_superfluous_in_a_set_for_all(tmp_path, truth):
    visible = {"visible": ["front", "rear", "both"]}
    record, outcome = replayed(
        tmp_path, in_both(), STEREO, visible, truth=truth, promise=Promise.EXACT
    )
    assert (record.totals.superfluous, int(outcome.exit)) == (0, 0)


def test_what_one_view_sees_and_the_set_lacks_is_lost_in_that_view(tmp_path, truth):
    record, outcome = replayed(
        tmp_path, in_both(), STEREO, {"visible": ["front", "both"]}, truth=truth
    )
    (row,) = record.frames
    (miss,) = row.verdict.misses
    assert (miss.object, miss.samples, miss.view, miss.partly) == (REAR, 4, "behind", False)
    assert int(outcome.exit) == 1


def test_a_set_per_view_makes_a_cell_per_view(tmp_path, truth):
    visible = {"visible": {"behind": ["rear", "front"], "ahead": ["both", "front"]}}
    record, _ = replayed(tmp_path, in_both(), STEREO, visible, truth=truth)
    ahead, behind = record.frames
    assert (ahead.view, behind.view) == ("ahead", "behind")
    assert (ahead.verdict.counts.visible, ahead.verdict.counts.superfluous) == (2, 0)
    # `front` is behind this eye, and `both` shows here too.
    assert (behind.verdict.counts.visible, behind.verdict.counts.superfluous) == (2, 1)
    (miss,) = behind.verdict.misses
    assert (miss.object, miss.samples, miss.view) == (BOTH, 4, "behind")
    assert verdict_json_of(record)["frames"] == 1


def verdict_json_of(record):
    return verdict_json(RunOutcome([record]), in_both())["cullers"]["replay"]


def test_an_empty_list_draws_nothing_in_its_view(tmp_path):
    visible = {"visible": {"ahead": ["front", "both"], "behind": []}}
    record, _ = replayed(tmp_path, in_both(), STEREO, visible)
    assert [row.verdict.counts.missed for row in record.frames] == [0, 2]


def test_a_recording_may_change_from_one_set_to_sets_by_view(tmp_path):
    path = CameraPath([*STEREO.frames, *STEREO.frames, Frame((eye("", -1.0),))])
    record, _ = replayed(
        tmp_path,
        in_both(),
        path,
        {"visible": {"ahead": ["front", "both"], "behind": ["rear", "both"]}},
        {"visible": ["front", "rear", "both"]},
        {"visible": ["front", "both"]},
    )
    assert [(row.frame, row.view) for row in record.frames] == [
        (0, "ahead"),
        (0, "behind"),
        (1, ""),
        (2, ""),
    ]
    assert record.totals.missed == 0


# A lamp of 16 samples behind a door, which stands aside in some frames.
LAMP, DOOR, WALL = range(3)
HALL = Scene.from_objects(
    [
        ("lamp", *square(-2.0, -2.0, -20.0, 4.0)),
        ("door", *square(-2.0, -2.0, -10.0, 4.0)),
        ("wall", *square(-4.0, -4.0, -30.0, 8.0)),
    ]
)
ASIDE = np.eye(4)
ASIDE[0, 3] = 100.0


def hall(doors: str, *, cuts=(), absent=()) -> CameraPath:
    """A frame for each letter: the door is (c)losed or (o)pen."""
    return CameraPath(
        [
            Frame(
                (eye("", -1.0, cut=frame in cuts),),
                world_from_object={"door": ASIDE} if door == "o" else {},
                absent=("lamp",) if frame in absent else (),
            )
            for frame, door in enumerate(doors)
        ]
    )


def ages_of(record):
    return {row.frame: miss.age for row in record.frames for miss in row.verdict.misses}


def without_lamp(tmp_path, path, truth=None):
    lines = [{"visible": ["door", "wall"]}] * len(path)
    return replayed(tmp_path, HALL, path, *lines, truth=truth)[0]


def test_age_counts_the_frames_since_the_object_came_into_view(tmp_path):
    record = without_lamp(tmp_path, hall("ccoooco"))
    assert ages_of(record) == {2: 0, 3: 1, 4: 2, 6: 0}
    assert record.ages() == {0: 2, 1: 1, 2: 1}


def test_what_is_in_view_in_the_first_frame_or_at_a_cut_has_no_age(tmp_path):
    assert ages_of(without_lamp(tmp_path, hall("ooco"))) == {0: None, 1: None, 3: 0}
    cut = without_lamp(tmp_path, hall("coooco", cuts=(2,)))
    assert ages_of(cut) == {1: 0, 2: None, 3: None, 5: 0}
    assert cut.ages() == {0: 2}


def test_an_absent_object_starts_again_at_zero(tmp_path):
    record = without_lamp(tmp_path, hall("coooo", absent=(3,)))
    assert ages_of(record) == {1: 0, 2: 1, 4: 0}


def test_after_frames_that_were_not_judged_nothing_is_new(tmp_path):
    path = hall("coooo")
    timeline = Timeline(HALL, path)
    referee = Referee(HALL, lambda: make_engine("exact", timeline.still), timeline=timeline)
    record = referee.run(path, [0, 2, 3], [("door", Draws((DOOR, WALL)))]).cullers[0]
    assert ages_of(record) == {2: None, 3: None}


def test_ages_are_the_same_from_a_truth_on_file(tmp_path):
    path = hall("ccoooco")
    truth_to_file(Inputs(HALL, path, range(7), "exact"), tmp_path / "truth.parquet")
    record = without_lamp(tmp_path, path, truth=tmp_path / "truth.parquet")
    assert ages_of(record) == {2: 0, 3: 1, 4: 2, 6: 0}


class Draws(Culler):
    """The same units in each frame."""

    name = "draws"

    def __init__(self, units, of=None):
        self._ids, self._units = units, of

    def prepare(self, scene):
        return self._units or scene.object_units()

    def update(self, scene):
        pass

    def cull(self, camera):
        return DrawnSet(np.array(self._ids, np.int32))


def test_where_units_are_finer_the_age_is_the_lost_unit_s(tmp_path):
    left, faces = square(-4.0, -2.0, -20.0, 2.0)
    right, _ = square(-2.0, -2.0, -20.0, 4.0)
    lamps = np.concatenate([left, right]), np.concatenate([faces, faces + 4])
    scene = Scene.from_objects([("lamps", *lamps), ("door", *square(-2.0, -2.0, -10.0, 4.0))])
    units = Units(np.array([0, 2, 4, 6]), np.arange(6, dtype=np.int32), "half")
    path = hall("coo")
    timeline = Timeline(scene, path)
    for drawn, expected in (
        # The left half is in view by right, and the right one comes into view with the door.
        ((0, 2), {1: 0, 2: 1}),
        ((1, 2), {0: None, 1: None, 2: None}),
        # Of several lost units the oldest counts.
        ((2,), {0: None, 1: None, 2: None}),
    ):
        referee = Referee(scene, lambda: make_engine("exact", timeline.still), timeline=timeline)
        record = referee.run(path, range(3), [("half", Draws(drawn, units))]).cullers[0]
        assert ages_of(record) == expected, drawn


def test_an_absent_object_that_is_drawn_is_ignored_with_a_finding(tmp_path):
    path = hall("cc", absent=(1,))
    lines = [{"visible": ["lamp", "door", "wall"]}] * 2
    record, outcome = replayed(tmp_path, HALL, path, *lines, promise=Promise.EXACT)
    # Hidden behind the door in the first frame, and not there in the second.
    assert [row.verdict.counts.superfluous for row in record.frames] == [1, 0]
    assert [row.verdict.counts.drawn for row in record.frames] == [3, 2]
    (finding,) = [one for one in outcome.findings if one.code == "ABSENT_NAMED"]
    assert (finding.frame, finding.object, finding.rule.severity) == (1, "lamp", "info")


def test_a_run_folder_and_its_report_say_what_moved(tmp_path):
    path = hall("ccoooco", absent=(4,))
    inputs = Inputs(HALL, path, range(7), "exact")
    judge_to_folder(inputs, [("door", Draws((DOOR, WALL)))], tmp_path / "run", pictures=7)
    run = read_run(tmp_path / "run")
    motion = run.manifest.motion
    assert [(one.frame, one.moved, one.appeared, one.vanished) for one in motion.frames] == [
        (2, 1, 0, 0),
        (4, 0, 0, 1),
        (5, 1, 1, 0),
        (6, 1, 0, 0),
    ]
    assert [(one.name, one.frames) for one in motion.most] == [("door", 3), ("lamp", 2)]
    assert (motion.objects, run.verdict.cullers["door"].ages) == (2, {0: 2, 1: 1})
    columns = (run.objects[name].to_pylist() for name in ("frame", "kind", "age"))
    ages = {frame: age for frame, kind, age in zip(*columns, strict=True) if kind == "confirmed"}
    assert ages == {2: 0, 3: 1, 6: 0}
    write_report([tmp_path / "run"], tmp_path / "page")
    page = (tmp_path / "page" / "report.html").read_text()
    assert "2 objects changed in 4 frames" in page
    assert "since the frame before: 1 moved, 1 appeared" in page
    assert "Ages of misses" in page


def test_a_scene_that_stands_still_says_nothing_of_motion(tmp_path):
    inputs = Inputs(in_both(), STEREO, range(1), "exact")
    judge_to_folder(inputs, [("all", Draws(range(4)))], tmp_path / "run", pictures=0)
    assert read_run(tmp_path / "run").manifest.motion is None


class DrawsJointly(Draws):
    """One set for all views."""

    joint = True

    def cull_joint(self, cameras):
        return self.cull(cameras[0])


def test_a_report_shows_each_view_and_says_what_a_set_is_for(tmp_path):
    inputs = Inputs(in_both(), STEREO, range(1), "exact")
    cullers = [("joint", DrawsJointly((FRONT, BOTH))), ("single", Draws((FRONT, BOTH)))]
    judge_to_folder(inputs, cullers, tmp_path / "run", pictures=1)
    run = read_run(tmp_path / "run")
    assert {(p.culler, p.view) for p in run.manifest.pictures} == {
        (culler, view) for culler in ("joint", "single") for view in ("ahead", "behind")
    }
    for culler in ("joint", "single"):
        (lost,) = run.lost_objects(culler)
        assert (lost.worst.view, lost.worst.pixels, lost.frames) == ("behind", 4, 1)
    write_report([tmp_path / "run"], tmp_path / "page")
    page = (tmp_path / "page" / "report.html").read_text()
    titles = re.findall(r'data-frame="0" data-view="(\w+)" data-title="([^"]+)"', page)
    assert titles == [("ahead", "Frame 0, view ahead"), ("behind", "Frame 0, view behind")]
    captions = re.findall(r"<figcaption>(.*?)</figcaption>", page, flags=re.S)
    text = [re.sub(r"<[^>]+>", "", caption).strip() for caption in captions]
    # Three are visible in all: `front` and `both` ahead, `rear` and `both` behind.
    assert text.count("joint, all views: 2 drawn, 0 superfluous, 1 missed") == 2
    assert "single: 2 drawn, 0 superfluous, 0 missed" in text
    assert "single: 2 drawn, 1 superfluous, 1 missed" in text
    assert len(re.findall(r"worst in (?:<a [^>]*>)?frame 0, view behind", page)) == 2
