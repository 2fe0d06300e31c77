"""What a path's frames say: several views, time, poses, absences and levels of detail."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import jsonschema
import numpy as np
import pytest

from tests.support.bad_input import path_json
from visref.camera import Camera, look_at
from visref.camera_path import CameraPath, Frame
from visref.errors import InputError
from visref.findings import Code
from visref.recordings.truth_file import path_digest
from visref.schemas import schema

POSE = np.eye(4).tolist()


def of_frame(frame, **top):
    return path_json(frames=[frame], **top)


def read(frame, **top) -> Frame:
    (made,) = CameraPath.from_json(of_frame(frame, **top)).frames
    return made


def eye(view: str, **changes) -> Camera:
    pose = look_at((0.0, 0.0, 3.0), (0.0, 0.0, -5.0))
    return replace(Camera(pose, 8, 6, near=0.1, yfov=1.0), view=view, **changes)


def test_a_view_takes_what_it_does_not_say_from_its_frame_and_then_from_the_top():
    views = {
        "left": {"world_from_camera": POSE},
        "map": {"world_from_camera": POSE, "ymag": 5.0, "width": 3},
        "right": {},
    }
    moved = look_at((1.0, 0.0, 0.0), (1.0, 0.0, -1.0)).tolist()
    frame = read({"views": views, "near": 0.5, "world_from_camera": moved})
    left, plan, right = frame.cameras
    assert [camera.view for camera in frame.cameras] == ["left", "map", "right"]
    assert (left.width, left.near, left.yfov) == (8, 0.5, 1.0)
    assert (plan.width, plan.height, plan.near, plan.yfov, plan.ymag) == (3, 6, 0.5, None, 5.0)
    assert (left.eye[0], right.eye[0]) == (0.0, 1.0)


def test_a_cut_is_of_all_views():
    frame = read({"views": {"a": {}, "b": {}}, "world_from_camera": POSE, "cut": True})
    assert [camera.cut for camera in frame.cameras] == [True, True]


def test_time_is_the_frame_s_own_or_its_number_over_fps():
    frames = [
        {"world_from_camera": POSE},
        {"world_from_camera": POSE, "time_s": 7.0},
        {"world_from_camera": POSE, "time_s": None},
    ]
    made = CameraPath.from_json(path_json(frames=frames, fps=4))
    assert [frame.time_s for frame in made.frames] == [0.0, 7.0, 0.5]
    untimed = CameraPath.from_json(path_json(frames=frames))
    assert [frame.time_s for frame in untimed.frames] == [None, 7.0, None]


def test_nothing_is_taken_over_from_the_frame_before():
    frames = [
        {
            "world_from_camera": POSE,
            "absent": ["door"],
            "levels": {"tree": 1},
            "world_from_object": {"lift": POSE},
        },
        {"world_from_camera": POSE},
    ]
    first, second = CameraPath.from_json(path_json(frames=frames)).frames
    assert (first.absent, first.levels, list(first.world_from_object)) == (
        ("door",),
        {"tree": 1},
        ["lift"],
    )
    assert not second.poses


EVERYTHING = CameraPath(
    [
        Frame(
            (eye("left", shift_x_px=0.5), eye("right", clip_plane=(0.0, 1.0, 0.0, -0.25))),
            0.1,
            "walk",
            {"lift": np.diag([1.0, 2.0, 3.0, 1.0])},
            ("door", "lamp"),
            {"tree": 2},
        ),
        Frame((eye("", cut=True, far=50.0),), 1.0 / 3.0, "run"),
        Frame((eye("alone"),)),
    ]
)


def test_what_frames_say_survives_the_file_bit_for_bit(tmp_path):
    file = tmp_path / "path.json"
    file.write_text(json.dumps(EVERYTHING.to_json()))
    again = CameraPath.load(file)
    assert [frame.definition() for frame in again.frames] == [
        frame.definition() for frame in EVERYTHING.frames
    ]
    assert [[c.cut for c in frame.cameras] for frame in again.frames] == [
        [False, False],
        [True],
        [False],
    ]
    jsonschema.validate(EVERYTHING.to_json(), schema("path"))


@pytest.mark.parametrize(
    "change",
    [
        {"time_s": 0.2},
        {"clip": "run"},
        {"world_from_object": {"lift": np.eye(4)}},
        {"absent": ("door",)},
        {"levels": {"tree": 1}},
        {"cameras": (eye("left", shift_x_px=0.5), eye("right"))},
    ],
    ids=lambda change: next(iter(change)),
)
def test_the_digest_hangs_on_all_that_a_frame_says(change):
    first, *others = EVERYTHING.frames
    assert path_digest(CameraPath([replace(first, **change), *others])) != path_digest(EVERYTHING)


def test_a_frame_that_says_nothing_new_has_the_digest_that_it_had():
    camera = eye("")
    assert Frame((camera,)).definition() == camera.definition()


def test_names_are_made_clean_as_those_of_objects_are():
    frame = read(
        {
            "world_from_camera": POSE,
            "views": {"a\0": {}},
            "absent": ["\ud800"],
            "levels": {"b\0": 0},
            "world_from_object": {"c\0": POSE},
        }
    )
    assert frame.cameras[0].view == "a\ufffd"
    assert (frame.absent, dict(frame.levels)) == (("\ufffd",), {"b\ufffd": 0})
    assert list(frame.world_from_object) == ["c\ufffd"]


def frame(**fields):
    return of_frame({"world_from_camera": POSE, **fields})


MIRROR = [0.0, 1.0, 0.0, 0.0]

# A path, where the fault is, what is said, and whether the schema can say it too.
WRONG = {
    "no view": (frame(views={}), "frames[0].views: the frame has no view", True),
    "views a list": (frame(views=[]), "frames[0].views: this is not a JSON object", True),
    "a view a number": (frame(views={"a": 3}), "frames[0].views.a: this is not a JSON", True),
    "a view without a pose": (
        of_frame({"views": {"a": {"world_from_camera": POSE}, "b": {}}}),
        "frames[0].views.b: world_from_camera is missing",
        True,
    ),
    "a view without a name among several": (
        frame(views={"": {}, "a": {}}),
        "frames[0].views: one of several views has no name",
        False,
    ),
    "views whose names are alike once clean": (
        frame(views={"\0": {}, "\ufffd": {}}),
        "frames[0].views: two views have the same name",
        False,
    ),
    "time a text": (frame(time_s="1"), "frames[0].time_s: '1' is not a number", True),
    "infinite time": (frame(time_s=math.inf), "frames[0].time_s: time_s is inf", False),
    "fps zero": (path_json(fps=0), "fps: fps is 0", True),
    "fps negative": (path_json(fps=-1.0), "fps: fps is -1.0", True),
    "fps a text": (path_json(fps="30"), "fps: '30' is not a number", True),
    "animation a number": (frame(animation=1), "frames[0].animation: animation is not", True),
    "poses a list": (frame(world_from_object=[]), "frames[0].world_from_object: this is", True),
    "a pose too small": (
        frame(world_from_object={"lift": POSE[:3]}),
        "frames[0].world_from_object.lift: not a 4 by 4 matrix",
        True,
    ),
    "a pose's entry a text": (
        frame(world_from_object={"lift": [*POSE[:3], [0, 0, 0, "1"]]}),
        "frames[0].world_from_object.lift[3][3]: '1' is not a number",
        True,
    ),
    "absent a name": (frame(absent="door"), "frames[0].absent: absent is not a list", True),
    "absent an id": (frame(absent=[3]), "frames[0].absent: absent is not a list", True),
    "levels a list": (frame(levels=[1]), "frames[0].levels: this is not a JSON", True),
    "a level below zero": (frame(levels={"tree": -1}), "frames[0].levels.tree: -1 is no", True),
    "a level a fraction": (frame(levels={"tree": 0.5}), "frames[0].levels.tree: 0.5 is", True),
    "clip plane of three": (frame(clip_plane=MIRROR[:3]), "frames[0].clip_plane: clip_plane", True),
    "clip plane a text": (frame(clip_plane="up"), "frames[0].clip_plane: clip_plane is no", True),
    "clip plane's entry": (frame(clip_plane=[None, 1, 0, 0]), "frames[0].clip_plane: None", True),
    "clip plane without a side": (
        frame(clip_plane=[0, 0, 0, 1]),
        "frames[0].clip_plane: clip_plane is [0.0, 0.0, 0.0, 1.0]",
        False,
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_frame_is_one_line_with_its_place(name):
    value, expected, told_by_schema = WRONG[name]
    with pytest.raises(InputError) as caught:
        CameraPath.from_json(value)
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)
    assert jsonschema.Draft202012Validator(schema("path")).is_valid(value) is not told_by_schema


@pytest.mark.parametrize(
    "fields",
    [
        {"time_s": None, "animation": None, "clip_plane": None},
        {"world_from_object": {}, "absent": [], "levels": {}},
        {"clip_plane": MIRROR, "absent": ["door"], "levels": {"tree": 3}, "time_s": -2},
        {"views": {"a": {"yfov": 2.0}, "b": {"ymag": 1.0, "clip_plane": MIRROR}}},
        {"views": {"": {}}},
    ],
    ids=str,
)
def test_what_is_right_is_right_by_reader_and_schema(fields):
    value = frame(**fields)
    jsonschema.validate(value, schema("path"))
    CameraPath.from_json(value)


def test_a_path_of_several_views_has_no_single_camera():
    path = CameraPath([Frame((eye("a"),)), Frame((eye("a"), eye("b")))])
    with pytest.raises(InputError, match=r"frames\[1\]: it has 2 views"):
        _ = path.cameras


PASSED_OVER = {
    "at the top": (path_json(abscent=["door"]), "field 'abscent' is not known", "at the top"),
    "in a frame": (
        frame(world_from_objekt={}),
        "did you mean 'world_from_object'?",
        "at frames[0]",
    ),
    "in a view": (frame(views={"a": {"cut": True}}), "field 'cut'", "at frames[0].views.a"),
}


@pytest.mark.parametrize("name", PASSED_OVER)
def test_a_field_that_is_not_known_is_passed_over_and_said(name):
    value, said, where = PASSED_OVER[name]
    jsonschema.validate(value, schema("path"))
    ((code, text),) = CameraPath.from_json(value, source="a.json").remarks
    assert code == Code.FIELD_IGNORED
    assert text.startswith("a.json: ")
    assert said in text
    assert where in text


def test_a_field_in_every_frame_is_said_once_with_its_count():
    value = frame(fov=1.0)
    value["frames"] *= 5
    ((_, text),) = CameraPath.from_json(value).remarks
    assert "(5 times, first at frames[0])" in text


def test_frames_of_a_path_with_gaps_go_by_their_numbers():
    cameras = CameraPath.from_json(path_json()).views(0)
    one = cameras[0]
    path = CameraPath([one, one, replace(one, near=0.5)], numbers=[2, 7, 1 << 30])
    assert [path.place(number) for number in (2, 7, 1 << 30)] == [0, 1, 2]
    assert path.views(1 << 30)[0].near == 0.5
    assert path.relative_to(np.ones(3)).numbers == [2, 7, 1 << 30]
    assert not path.without_gaps
    for number in (-1, 0, 3, 1 << 31):
        assert not path.has(number)
        with pytest.raises(KeyError):
            path.frame(number)


CLIP = replace(eye(""), far=50.0).clip_from_world().tolist()
OTHERWISE = {
    "flat": {"world_from_camera": {"column_major": np.eye(4).reshape(-1).tolist()}},
    "inverse": {"camera_from_world": POSE},
    "clip matrix": {"clip_from_world": CLIP, "clip_depth": "-1..1"},
    "eye and target": {"eye": [0, 0, 3], "target": [0, 0, -5]},
    "quaternion": {"position": [0, 0, 3], "rotation": [0, 0, 0, 1]},
}


@pytest.mark.parametrize("form", OTHERWISE)
@pytest.mark.parametrize("where", ["top", "frame", "view"])
def test_a_camera_in_any_form_may_stand_at_the_top_in_a_frame_or_in_a_view(form, where):
    given = OTHERWISE[form]
    if where == "top":
        value = path_json(frames=[{}], **given)
        if "clip_from_world" in given:
            # The lens is the matrix's, and stands beside it nowhere.
            value = {k: v for k, v in value.items() if k not in ("yfov", "near", "far")}
    elif where == "frame":
        value = of_frame(given)
    else:
        value = of_frame({"views": {"": given}, "world_from_camera": POSE})
    jsonschema.validate(value, schema("path"))
    path = CameraPath.from_json(value)
    assert not path.remarks
    (camera,) = path.frames[0].cameras
    place = 0.0 if form in ("flat", "inverse") else 3.0
    # The clip matrix's eye is solved for: numbers of up to 3, rounded a few times.
    assert np.abs(camera.eye - (0.0, 0.0, place)).max() <= 32 * 2.0**-53 * 3.0
    assert camera.yfov == pytest.approx(1.0, rel=32 * 2.0**-53)


def test_a_clip_matrix_in_a_frame_overrides_the_lens_at_the_top():
    given = {"clip_from_world": CLIP, "clip_depth": "-1..1", "near": 0.5}
    (camera,) = read(given, shift_x_px=2.0, yfov=0.5).cameras
    assert camera.shift_x_px == 0.0
    assert camera.yfov == pytest.approx(1.0, rel=32 * 2.0**-53)
    assert camera.near == 0.5
    with pytest.raises(InputError, match=r"frames\[0\]\.yfov: yfov is given, and clip_from_world"):
        read({**given, "yfov": 0.5})


def test_a_pose_printed_with_few_digits_is_taken_with_one_remark_for_all_frames():
    rounded = np.round(look_at((3.0, 1.0, 2.0), (0.0, 0.0, 0.0)), 6)
    rounded[0, 0] += 1e-6
    frames = [{"world_from_camera": rounded.tolist()}] * 3 + [{"world_from_camera": POSE}]
    path = CameraPath.from_json(path_json(frames=frames), source="a.json")
    ((code, text),) = path.remarks
    assert code == Code.CAMERA_MADE_RIGID
    assert text == (
        "a.json: world_from_camera was made orthonormal: it was off by up to 1e-05 "
        "(3 times, first at frames[0])"
    )
    linear = path.frames[0].cameras[0].world_from_camera[:3, :3]
    assert np.abs(linear.T @ linear - np.eye(3)).max() <= 16 * 2.0**-53


def test_an_object_s_place_may_be_flat_too():
    flat = {"column_major": np.arange(16.0).tolist()}
    frame_made = read({"world_from_camera": POSE, "world_from_object": {"lift": flat}})
    assert frame_made.world_from_object["lift"].tolist() == np.arange(16.0).reshape(4, 4).T.tolist()
