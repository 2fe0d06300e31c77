"""Recorded visible sets: three forms of file, and what is refused."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.support.hand_made import camera, scene_of_squares, still_path
from visref.camera_path import CameraPath, Frame
from visref.errors import InputError
from visref.recordings.visible_sets import Replay, read_visible_sets

SCENE = scene_of_squares(0.0, -1.0, -2.0)


def lines(*rows: object) -> str:
    return "".join(json.dumps(row) + "\n" for row in rows)


def write(tmp_path, name, text):
    file = tmp_path / name
    file.write_text(text)
    return file


def test_ids_and_names_mean_the_same_objects(tmp_path):
    text = lines({"frame": 1, "visible": ["square2", 0]}, {"frame": 0, "visible": []})
    read = read_visible_sets(write(tmp_path, "v.jsonl", text), SCENE, range(2), still_path(2))
    assert [read.frames[f].tolist() for f in (0, 1)] == [[], [0, 2]]


def test_csv_and_parquet_say_the_same_as_json_lines(tmp_path):
    expected = [[1], [], [0, 2]]
    json_file = write(
        tmp_path, "v.jsonl", lines(*({"frame": f, "visible": v} for f, v in enumerate(expected)))
    )
    by_id = write(tmp_path, "i.csv", "frame,object_id\n0,1\n1,\n2,2\n2,0\n")
    by_name = write(tmp_path, "n.csv", "frame,object\n0,square1\n1,\n2,square2\n2,square0\n")
    pq.write_table(
        pa.table({"frame": [0, 1, 2, 2], "object_id": [1, None, 2, 0]}), tmp_path / "i.parquet"
    )
    pq.write_table(
        pa.table({"frame": [0, 1, 2, 2], "object": ["square1", None, "square2", "square0"]}),
        tmp_path / "n.parquet",
    )
    for file in (json_file, by_id, by_name, tmp_path / "i.parquet", tmp_path / "n.parquet"):
        read = read_visible_sets(file, SCENE, range(3), still_path(3))
        assert [read.frames[f].tolist() for f in range(3)] == expected, file.name


def test_stats_come_through(tmp_path):
    text = lines({"frame": 0, "visible": [0], "stats": {"queries": 7, "ms": {"cull": 1.5}}})
    read = read_visible_sets(write(tmp_path, "v.jsonl", text), SCENE, range(1), still_path(1))
    assert read.stats[0].queries == 7
    assert read.stats[0].ms == {"cull": 1.5}


def test_replay_plays_the_frames_that_are_judged_in_path_order(tmp_path):
    same = camera()
    path = CameraPath((same, same, same))
    text = lines(*({"frame": f, "visible": [f]} for f in (2, 0, 1)))
    file = write(tmp_path, "v.jsonl", text)
    replay = Replay(read_visible_sets(file, SCENE, range(1, 3), still_path(3)), path)
    assert [replay.cull(same).unit_ids.tolist() for _ in range(2)] == [[1], [2]]


STEREO = CameraPath([Frame(tuple(replace(camera(), view=view) for view in ("left", "right")))] * 3)


def test_sets_by_view_say_the_same_in_all_three_forms(tmp_path):
    expected = [{"left": [1], "right": []}, {"": [0, 2]}, {"left": [0], "right": [0, 1]}]
    json_lines = [{"frame": f, "visible": v} for f, v in enumerate(expected)]
    json_lines[1]["visible"] = [2, 0]
    json_file = write(tmp_path, "v.jsonl", lines(*json_lines))
    rows = [
        (0, "left", 1), (0, "right", None), (1, "", 0), (1, "", 2),
        (2, "right", 1), (2, "left", 0), (2, "right", 0),
    ]  # fmt: skip
    text = "".join(f"{f},{view},{'' if i is None else i}\n" for f, view, i in rows)
    csv_file = write(tmp_path, "v.csv", "frame,view,object_id\n" + text)
    frames, views, ids = (list(column) for column in zip(*rows, strict=True))
    # A null is a set for all views too.
    views = [view or None for view in views]
    table = pa.table({"frame": frames, "view": views, "object_id": ids})
    pq.write_table(table, tmp_path / "v.parquet")
    for file in (json_file, csv_file, tmp_path / "v.parquet"):
        read = read_visible_sets(file, SCENE, range(3), STEREO)
        found = [
            {view: ids.tolist() for view, ids in read.sets[frame].items()} for frame in range(3)
        ]
        assert found == expected, file.name


def test_replay_is_joint_in_the_frames_that_have_one_set_for_all_views(tmp_path):
    text = lines(
        {"frame": 0, "visible": [1]},
        {"frame": 1, "visible": {"right": [2], "left": [0]}},
        {"frame": 2, "visible": []},
    )
    sets = read_visible_sets(write(tmp_path, "v.jsonl", text), SCENE, range(3), STEREO)
    replay = Replay(sets, STEREO)
    left, right = STEREO.views(0)
    assert replay.joint
    assert replay.cull_joint((left, right)).unit_ids.tolist() == [1]
    assert not replay.joint
    assert replay.cull(left).unit_ids.tolist() == [0]
    assert not replay.joint
    assert replay.cull(right).unit_ids.tolist() == [2]
    assert replay.joint
    assert replay.cull_joint((left, right)).unit_ids.tolist() == []


WRONG_VIEWS = {
    "unknown view": ({"left": [], "rigth": []}, "the frame has no view 'rigth'"),
    "missing view": ({"left": [0]}, "view 'right' is missing"),
    "no view": ({}, "view 'left' is missing"),
    "all views and one": ({"": [0], "left": [0]}, "a set for all views and others by view"),
    "a view's set a name": ({"left": "square0", "right": []}, "visible of view 'left' is not"),
    "a view's set of views": ({"left": {"a": []}, "right": []}, "visible of view 'left' is not"),
}


@pytest.mark.parametrize("name", WRONG_VIEWS)
def test_wrong_views_are_one_line_with_their_place(name, tmp_path):
    visible, expected = WRONG_VIEWS[name]
    good = {"frame": 0, "visible": []}
    file = write(tmp_path, "v.jsonl", lines(good, {"frame": 1, "visible": visible}))
    with pytest.raises(InputError) as caught:
        read_visible_sets(file, SCENE, range(2), STEREO)
    assert str(caught.value).startswith(f"{file}: line 2: ")
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_frame_with_one_view_without_a_name_has_no_sets_by_view(tmp_path):
    file = write(tmp_path, "v.jsonl", lines({"frame": 0, "visible": {"left": [0]}}))
    with pytest.raises(InputError, match="the frame has one view without a name: write a list"):
        read_visible_sets(file, SCENE, range(1), still_path(1))


BAD = {
    "unknown name": (
        "v.jsonl",
        lines({"frame": 0, "visible": ["square9"]}),
        "'square9'; did you mean",
    ),
    "unknown id": ("v.jsonl", lines({"frame": 0, "visible": [3]}), "object id 3"),
    "negative id": ("v.jsonl", lines({"frame": 0, "visible": [-1]}), "object id -1"),
    "missing frame": ("v.jsonl", "", "1 of 1 frames are missing: 0"),
    "repeated frame": (
        "v.jsonl",
        lines({"frame": 0, "visible": []}, {"frame": 0, "visible": []}),
        "comes twice (first at line 1)",
    ),
    "frame off the path": ("v.jsonl", lines({"frame": 5, "visible": []}), "frame 5"),
    "fractional frame": ("v.jsonl", lines({"frame": 0.5, "visible": []}), "frame is 0.5"),
    "boolean id": ("v.jsonl", lines({"frame": 0, "visible": [True]}), "not a list of ids"),
    "not a list": ("v.jsonl", lines({"frame": 0, "visible": "all"}), "not a list of ids"),
    "no visible": ("v.jsonl", lines({"frame": 0}), "needs 'frame' and 'visible'"),
    "broken JSON": ("v.jsonl", '{"frame": 0, "visi', "not valid JSON"),
    "unknown counter": (
        "v.jsonl",
        lines({"frame": 0, "visible": [], "stats": {"quries": 1}}),
        "'quries'",
    ),
    "wrong columns": ("v.csv", "frame,thing\n0,1\n", "columns are frame, thing"),
    "text id in CSV": ("v.csv", "frame,object_id\n0,one\n", "object_id is 'one'"),
    "not Parquet": ("v.parquet", "no", "not a Parquet file"),
    "unknown ending": ("v.txt", "", "rename"),
    "lists too deep": ("v.jsonl", '{"frame": 0, "visible":' + "[" * 100_000, "lists too deep"),
    "id too long to read": ("v.jsonl", '{"frame": 0, "visible": [' + "9" * 5000 + "]}", "line 1"),
    "id too long in CSV": ("v.csv", "frame,object_id\n0," + "9" * 5000 + "\n", "an integer"),
    "id with underscore": ("v.csv", "frame,object_id\n0,1_0\n", "object_id is '1_0'"),
    "counter too large": (
        "v.jsonl",
        lines({"frame": 0, "visible": [], "stats": {"queries": 1 << 63}}),
        "stats has 'queries'",
    ),
    "negative counter": (
        "v.jsonl",
        lines({"frame": 0, "visible": [], "stats": {"queries": -1}}),
        "stats has 'queries': -1",
    ),
    "text for a time": (
        "v.jsonl",
        lines({"frame": 0, "visible": [], "stats": {"ms": {"cull": "1"}}}),
        "milliseconds by phase",
    ),
    "NaN for a time": (
        "v.jsonl",
        lines({"frame": 0, "visible": [], "stats": {"ms": {"cull": float("nan")}}}),
        "milliseconds by phase",
    ),
    "name with a comma, unquoted": ("v.csv", "frame,object\n0,a,b\n", "quote names"),
    "row cut short": ("v.csv", "frame,object\n0\n", "not as many fields"),
    "field without end": ("v.csv", "frame,object\n0," + "a" * 200_000, "not valid CSV"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_recording_is_one_clear_line_naming_the_file(name, tmp_path):
    file_name, text, expected = BAD[name]
    file = write(tmp_path, file_name, text)
    with pytest.raises(InputError) as caught:
        read_visible_sets(file, SCENE, range(1), still_path(1))
    message = str(caught.value)
    assert message.startswith(str(file))
    assert expected in message
    assert "\n" not in message


@pytest.mark.parametrize("ending", ["jsonl", "csv", "parquet"])
def test_missing_file_is_a_clear_error(ending, tmp_path):
    with pytest.raises(InputError, match="cannot read the file"):
        read_visible_sets(tmp_path / f"none.{ending}", SCENE, range(1), still_path(1))


@pytest.mark.parametrize("name", ["v.jsonl", "v.csv"])
def test_byte_order_mark_of_a_text_editor_is_no_part_of_the_recording(name, tmp_path):
    text = "frame,object\n0,square1\n" if name == "v.csv" else lines({"frame": 0, "visible": [1]})
    file = tmp_path / name
    file.write_text(text, encoding="utf-8-sig")
    assert read_visible_sets(file, SCENE, range(1), still_path(1)).frames[0].tolist() == [1]


def test_parquet_that_lost_its_middle_is_a_clear_error(tmp_path):
    pq.write_table(pa.table({"frame": [0], "object_id": [1]}), tmp_path / "v.parquet")
    content = bytearray((tmp_path / "v.parquet").read_bytes())
    content[4:40] = b"\xff" * 36
    (tmp_path / "v.parquet").write_bytes(content)
    with pytest.raises(InputError, match="not a whole one"):
        read_visible_sets(tmp_path / "v.parquet", SCENE, range(1), still_path(1))


def test_parquet_ids_must_be_whole(tmp_path):
    table = pa.table({"frame": np.array([0]), "object_id": np.array([0.5])})
    pq.write_table(table, tmp_path / "v.parquet")
    with pytest.raises(InputError, match="object_id is of type double"):
        read_visible_sets(tmp_path / "v.parquet", SCENE, range(1), still_path(1))


def test_boxes_by_name_come_to_their_units(tmp_path):
    file = tmp_path / "v.jsonl"
    name = SCENE.names[1]
    lines = [
        {"frame": 0, "visible": [0], "bounds": {name: [[0, -1, 2.5], [1, 1, 3]]}},
        {"frame": 1, "visible": [0]},
    ]
    file.write_text("".join(json.dumps(line) + "\n" for line in lines))
    read = read_visible_sets(file, SCENE, range(2), still_path(2))
    assert list(read.boxes) == [0]
    assert read.boxes[0][1].tolist() == [[0.0, -1.0, 2.5], [1.0, 1.0, 3.0]]
    assert not np.isfinite(np.delete(read.boxes[0], 1, axis=0)).any()


@pytest.mark.parametrize(
    ("bounds", "said"),
    [
        ([], "bounds is not an object"),
        ({"nobody": [[0, 0, 0], [1, 1, 1]]}, "no object named 'nobody'"),
        *(
            ({"front": box}, "no two corners of three numbers")
            for box in ([], [[0, 0, 0]], [[0, 0], [1, 1, 1, 1]], [[0, 0, "a"], [1, 1, 1]], 3,
                        [[0, 0, 10**400], [1, 1, 1]], [[0, 0, True], [1, 1, 1]])
        ),
        ({"front": [[2, 0, 0], [1, 1, 1]]}, "a least corner above its greatest"),
    ],
)  # fmt: skip
def test_what_is_no_box_is_one_line_with_its_place(bounds, said, tmp_path):
    file = tmp_path / "v.jsonl"
    named = {SCENE.names[0] if key == "front" else key: box for key, box in dict(bounds).items()}
    line = {"frame": 0, "visible": [], "bounds": named if bounds else bounds}
    file.write_text(json.dumps(line) + "\n")
    with pytest.raises(InputError, match=f"line 1: .*{said}") as refused:
        read_visible_sets(file, SCENE, range(1), still_path(1))
    assert "\n" not in str(refused.value)
