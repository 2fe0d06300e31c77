"""From a recording to a path and visible sets and back: the same frames, the same verdict."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from tests.recordings.test_recording import HEADER, POSE, SCENE, VIEWS, drawn, line, write
from visref.camera_path import CameraPath
from visref.cli.main import main
from visref.errors import InputError
from visref.recordings import (
    RecordingWriter,
    pair_of_recording,
    read_recording,
    read_visible_sets,
    recording_of_pair,
)

MOVED = np.diag([1.0, 1.0, 1.0, 1.0]).tolist()
LINES = [
    line(0, [2], time_s=0.5, absent=["square1"], stats={"queries": 3}),
    {"frame": 1, "views": VIEWS, "visible": {"left": [0], "right": []}, "cut": True},
    line(
        2, [1], world_from_object={"square0": MOVED}, bounds={"square1": [[0, 0, 0], [1, 1, 2.5]]}
    ),
]


def apart(folder, *lines):
    file = write(folder, *lines)
    path, visible = folder / "path.json", folder / "visible.jsonl"
    pair_of_recording(file, path, visible)
    return path, visible


def test_a_pair_says_what_the_recording_said(tmp_path):
    path_file, visible_file = apart(tmp_path, HEADER, *LINES)
    whole = read_recording(tmp_path / "run.jsonl", SCENE)
    path = CameraPath.load(path_file)
    assert [frame.definition() for frame in path.frames] == [
        frame.definition() for frame in whole.path.frames
    ]
    assert [frame.cameras[0].cut for frame in path.frames] == [False, True, False]
    sets = read_visible_sets(visible_file, SCENE, range(3), path)
    for frame in range(3):
        assert {view: ids.tolist() for view, ids in sets.sets[frame].items()} == {
            view: ids.tolist() for view, ids in whole.sets.sets[frame].items()
        }
    assert sets.stats[0].queries == 3
    assert np.array_equal(sets.boxes[2], whole.sets.boxes[2])


def test_there_and_back_is_the_same_recording(tmp_path):
    path, visible = apart(tmp_path, HEADER, *LINES)
    again = tmp_path / "again.jsonl"
    assert recording_of_pair(path, visible, again) == 3
    first, second = (read_recording(tmp_path / f, SCENE) for f in ("run.jsonl", "again.jsonl"))
    assert [f.definition() for f in first.path.frames] == [
        f.definition() for f in second.path.frames
    ]
    assert drawn(first, 2) == drawn(second, 2) == [1]


def test_gaps_become_cuts_and_keep_their_time(tmp_path):
    path_file, visible = apart(tmp_path, {**HEADER, "fps": 4}, line(2), line(3), line(8))
    path = CameraPath.load(path_file)
    assert [frame.time_s for frame in path.frames] == [0.5, 0.75, 2.0]
    assert [frame.cameras[0].cut for frame in path.frames] == [False, False, True]
    assert [json.loads(text)["frame"] for text in visible.read_text().splitlines()] == [0, 1, 2]


def test_csv_makes_a_recording_too(tmp_path):
    path, _ = apart(tmp_path, HEADER, line(0), line(1))
    (tmp_path / "v.csv").write_text("frame,object_id\n1,2\n1,0\n0,\n")
    assert recording_of_pair(path, tmp_path / "v.csv", tmp_path / "again.jsonl") == 2
    recording = read_recording(tmp_path / "again.jsonl", SCENE)
    assert [drawn(recording, frame) for frame in (0, 1)] == [[], [0, 2]]


@pytest.mark.parametrize("what", [{"groups": {"g": [0]}}, {"units": "u.csv"}])
def test_what_a_pair_cannot_say_is_refused(tmp_path, what):
    with pytest.raises(InputError, match="of its own, which a path and visible sets cannot say"):
        apart(tmp_path, {**HEADER, **what}, line(0))
    assert not (tmp_path / "path.json").exists()


def test_the_command_converts_both_ways_and_says_what_it_lacks(tmp_path, capsys):
    file = write(tmp_path, HEADER, line(0, [0]), '{"frame"', end="")
    path, visible = tmp_path / "p.json", tmp_path / "v.jsonl"
    apart_ = ["--recording", str(file), "--path-out", str(path), "--visible-out", str(visible)]
    assert main(["convert", *apart_]) == 0
    assert "line 3 is not whole; what is whole was taken" in capsys.readouterr().out
    joined = ["--path", str(path), "--visible", str(visible)]
    assert main(["convert", *joined, "--recording-out", str(tmp_path / "r.jsonl")]) == 0
    capsys.readouterr()
    assert main(["convert", *apart_, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["path"], told["visible"], told["frames"]) == (str(path), str(visible), 1)
    assert told["cut_off"].startswith("line 3")
    again = str(tmp_path / "r.jsonl")
    assert main(["convert", *joined, "--recording-out", again, "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"recording": again, "frames": 1}
    assert main(["convert", *joined]) == 2
    assert main(["convert", *joined, "--recording-out", str(path)]) == 2
    errors = capsys.readouterr().err
    assert "what is to be converted?" in errors
    assert errors.count("\n") == 2


def test_a_number_that_is_not_finite_converts_to_one_line(tmp_path):
    for lines, place in (
        ((HEADER, line(0), line(1, note=math.nan)), "frame 1: JSON cannot say it"),
        (({**HEADER, "note": math.inf}, line(0)), "line 1: JSON cannot say it"),
    ):
        with pytest.raises(InputError, match=place):
            apart(tmp_path, *lines)
        assert not (tmp_path / "path.json").exists()


def test_names_are_converted_to_what_every_file_can_hold(tmp_path):
    _, visible = apart(tmp_path, HEADER, line(0, ["\ud800", "ü"], absent=["\udfff"]))
    assert json.loads(visible.read_text(encoding="utf-8"))["visible"] == ["\ufffd", "ü"]
    frames = json.loads((tmp_path / "path.json").read_text(encoding="utf-8"))["frames"]
    assert frames[0]["absent"] == ["\ufffd"]


def test_a_table_that_is_no_text_converts_to_one_line(tmp_path):
    path, _ = apart(tmp_path, HEADER, line(0))
    table = tmp_path / "visible.csv"
    table.write_bytes(b"frame,object\n0,sa\xff\n")
    with pytest.raises(InputError, match=r"visible\.csv: it is not UTF-8 text"):
        recording_of_pair(path, table, tmp_path / "back.jsonl")
    assert not (tmp_path / "back.jsonl").exists()


def test_what_the_writer_writes_the_reader_reads(tmp_path):
    file = tmp_path / "run.jsonl"
    shared = {name: value for name, value in HEADER.items() if name not in ("format", "version")}
    with RecordingWriter(file, **shared, groups={"pair": [0, 1]}) as recording:
        recording.frame(2, world_from_camera=np.array(POSE), visible=["pair"], time_s=0.25)
        recording.frame(np.int64(5), world_from_camera=POSE, visible=np.array([2]),
                        stats={"queries": 4})  # fmt: skip
        # Each line is whole before the next: an engine may die at any time.
        assert list(read_recording(file, SCENE).path.numbers) == [2, 5]
        recording.frame(6, views=VIEWS, visible={"left": [0], "right": (1,)})
    read = read_recording(file, SCENE)
    assert list(read.path.numbers) == [2, 5, 6]
    assert [drawn(read, frame) for frame in (2, 5)] == [[0, 1], [2]]
    assert drawn(read, 6, "right") == [1]
    assert read.path.remarks == ()


@pytest.mark.parametrize(
    ("frame", "fields", "expected"),
    [
        (3, {"visible": [0]}, "it comes after frame 4"),
        (5, {"visible": [0], "visible_nodes": [0]}, "both visible and visible_nodes"),
        (5, {}, "needs 'frame' and 'visible'"),
        (5, {"visible": [0.5]}, "visible is not a list"),
        (5, {"visible": [0], "world_from_camera": [1]}, "not a 4 by 4 matrix"),
        (5, {"visible": [0], "abscent": []}, "did you mean 'absent'"),
        (5, {"visible": [0], "cut": object()}, "cut is not true or false"),
    ],
)
def test_the_writer_refuses_what_no_reader_takes(tmp_path, frame, fields, expected):
    file = tmp_path / "run.jsonl"
    shared = {name: value for name, value in HEADER.items() if name not in ("format", "version")}
    with RecordingWriter(file, **shared) as recording:
        recording.frame(4, world_from_camera=POSE, visible=[0])
        with pytest.raises(InputError, match=expected):
            recording.frame(frame, **{"world_from_camera": POSE, **fields})
        recording.frame(9, world_from_camera=POSE, visible=[1])
    assert list(read_recording(file, SCENE).path.numbers) == [4, 9]
