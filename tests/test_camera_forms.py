"""The forms in which a file gives a camera: the same camera, however it is written."""

from __future__ import annotations

import math

import numpy as np
import pytest

from visref.camera import Camera, look_at
from visref.camera_forms import over, read_camera
from visref.errors import InputError

U = 2.0**-53
EYE, TARGET = (3.0, 4.0, -12.0), (0.0, 2.0, 1.0)
POSE = look_at(EYE, TARGET)
CAMERA = Camera(POSE, 64, 48, near=0.25, far=100.0, yfov=1.0)


def quaternion(rotation) -> list[float]:
    """x, y, z, w of a rotation whose trace is positive (Shepperd 1978)."""
    w = math.sqrt(1.0 + np.trace(rotation)) / 2
    x, y, z = (rotation[[2, 0, 1], [1, 2, 0]] - rotation[[1, 2, 0], [2, 0, 1]]) / (4 * w)
    return [x, y, z, w]


# A camera that turns little, so that its trace is positive.
NEARBY = look_at(EYE, np.add(EYE, (0.5, -0.25, -2.0)))
INVERSE = np.linalg.inv(NEARBY)


def forms(pose):
    inverse, clip = np.linalg.inv(pose), Camera(pose, 64, 48, 0.25, 100.0, yfov=1.0)
    matrix = clip.clip_from_world()
    return {
        "world_from_camera": {"world_from_camera": pose.tolist()},
        "flat rows": {"world_from_camera": {"row_major": pose.reshape(-1).tolist()}},
        "flat columns": {"world_from_camera": {"column_major": pose.T.reshape(-1).tolist()}},
        "camera_from_world": {"camera_from_world": inverse.tolist()},
        "its columns": {"camera_from_world": {"column_major": inverse.T.reshape(-1).tolist()}},
        "eye and target": {
            "eye": pose[:3, 3].tolist(),
            "target": (pose[:3, 3] - 3.0 * pose[:3, 2]).tolist(),
        },
        "with up": {
            "eye": pose[:3, 3].tolist(),
            "target": (pose[:3, 3] - 3.0 * pose[:3, 2]).tolist(),
            "up": (pose[:3, 1] * 7.0 + pose[:3, 2]).tolist(),
        },
        "position and rotation": {
            "position": pose[:3, 3].tolist(),
            "rotation": quaternion(pose[:3, :3]),
        },
        "clip_from_world": {"clip_from_world": matrix.tolist(), "clip_depth": "-1..1"},
        "its columns, y down": {
            "clip_from_world": {
                "column_major": (np.diag([1, -1, 1, 1]) @ matrix).T.reshape(-1).tolist()
            },
            "clip_depth": "-1..1",
            "clip_y": "down",
        },
    }


@pytest.mark.parametrize("form", forms(NEARBY))
def test_every_form_of_a_camera_is_the_same_camera(form):
    made = read_camera(forms(NEARBY)[form], 64, 48)
    assert (made.off, made.made) == (0.0, "")
    # An inverse, or a target, has numbers of the eye's size, 13, rounded, and a few sums of them.
    assert np.abs(made.world_from_camera - NEARBY).max() <= 64 * U * 13
    if "clip" in form or "y down" in form:
        assert made.lens["yfov"] == pytest.approx(1.0, rel=64 * U)
        assert made.lens["near"] == pytest.approx(0.25, rel=1e-12)
        assert made.lens["far"] == pytest.approx(100.0, rel=1e-9)
    else:
        assert not made.lens


def test_rows_are_taken_as_they_are():
    made = read_camera({"world_from_camera": POSE.tolist()}, 64, 48)
    assert made.world_from_camera.tolist() == POSE.tolist()


@pytest.mark.parametrize("digits", [5, 6, 7])
@pytest.mark.parametrize("name", ["world_from_camera", "camera_from_world"])
def test_a_matrix_printed_with_few_digits_is_made_rigid_and_said(name, digits):
    given = POSE if name == "world_from_camera" else np.linalg.inv(POSE)
    printed = np.round(given, digits)
    axes = printed[:3, :3] if name == "world_from_camera" else printed[:3, :3].T
    off = np.abs(axes.T @ axes - np.eye(3)).max()
    made = read_camera({name: printed.tolist()}, 64, 48)
    rotation = made.world_from_camera[:3, :3]
    if off <= 1e-6:
        assert made.off == 0.0
        assert np.abs(rotation - POSE[:3, :3]).max() <= 0.5 * 10.0**-digits
        return
    assert made.off == pytest.approx(off, rel=1e-9)
    assert made.made == f"{name} was made orthonormal"
    assert np.abs(rotation.T @ rotation - np.eye(3)).max() <= 16 * U
    # The nearest rotation is at most as far from what was printed as the one that was printed, in
    # the sum of squares: 9 entries of half a unit of the last digit.
    nearness = np.linalg.norm(rotation - (printed if name[0] == "w" else printed.T)[:3, :3][:3])
    assert nearness <= 3 * 0.5 * 10.0**-digits * (1 + 1e-9)
    Camera(made.world_from_camera, 64, 48, near=1.0, yfov=1.0)


def test_the_nearest_rotation_of_a_stretched_one_is_itself():
    # A rotation times a symmetric positive matrix: its polar decomposition is known.
    stretch = np.eye(3) + 2e-5 * np.array([[1.0, 0.5, 0.0], [0.5, 1.0, -0.25], [0.0, -0.25, 0.5]])
    given = POSE.copy()
    given[:3, :3] = POSE[:3, :3] @ stretch
    made = read_camera({"world_from_camera": given.tolist()}, 64, 48)
    assert made.off > 1e-6
    assert np.abs(made.world_from_camera - POSE).max() <= 16 * U


def test_a_quaternion_nearly_of_unit_length_is_made_one():
    near = np.array(quaternion(NEARBY[:3, :3])) * (1.0 + 2e-5)
    made = read_camera({"position": list(EYE), "rotation": near.tolist()}, 64, 48)
    assert made.off == pytest.approx(4e-5, rel=1e-4)
    assert made.made == "rotation was made a unit quaternion"
    assert np.abs(made.world_from_camera - NEARBY).max() <= 32 * U


def test_the_eye_of_a_matrix_with_few_digits_is_what_it_takes_to_zero():
    printed = np.round(INVERSE, 5)
    made = read_camera({"camera_from_world": printed.tolist()}, 64, 48)
    assert np.abs(printed @ made.world_from_camera[:, 3] - (0, 0, 0, 1)).max() <= 32 * U * 13


def test_a_form_overrides_the_forms_above_it():
    top = {"eye": list(EYE), "target": [0, 0, 0], "up": [0, 0, 1], "yfov": 1.0, "near": 1.0}
    assert over(top, {"eye": [1, 2, 3]}) == {**top, "eye": [1, 2, 3]}
    lens = {"yfov": 1.0, "near": 1.0}
    assert over(top, {"world_from_camera": 0}) == {**lens, "world_from_camera": 0}
    with_clip = over(top, {"clip_from_world": 0})
    assert {name: with_clip.get(name) for name in (*top, "clip_from_world")} == {
        **dict.fromkeys(top), "near": 1.0, "clip_from_world": 0
    }  # fmt: skip
    # The lens that a clip matrix makes void counts again where another form overrides that.
    assert over(with_clip, {"world_from_camera": 0}) == {**lens, "world_from_camera": 0}
    assert over(top, {"ymag": 2.0}) == {
        **{k: v for k, v in top.items() if k != "yfov"},
        "ymag": 2.0,
    }
    # A projection of null says nothing.
    assert over(top, {"yfov": None, "ymag": None}) == top
    assert over({"clip_from_world": 0, "clip_depth": "0..1"}, {"near": 1.0}) == {
        "clip_from_world": 0, "clip_depth": "0..1", "near": 1.0,
    }  # fmt: skip


def test_near_and_far_over_a_clip_matrix_stand():
    values = {**forms(NEARBY)["clip_from_world"], "near": 0.5, "far": None}
    lens = read_camera(values, 64, 48).lens
    assert (lens["near"], lens["far"]) == (0.5, math.inf)


def target(**changes):
    return {"eye": [0, 0, 0], "target": [0, 0, -1], **changes}


CLIP = forms(NEARBY)["clip_from_world"]
TURNED = {"column_major": np.reshape(CLIP["clip_from_world"], -1).tolist()}
WRONG = {
    "nothing": ({}, "world_from_camera is missing"),
    "up alone": ({"up": [0, 1, 0]}, "world_from_camera is missing"),
    "two forms": ({"world_from_camera": POSE.tolist(), **target()}, "given twice"),
    "no target": ({"eye": [0, 0, 0]}, "target is missing"),
    "no eye": ({"target": [0, 0, 0]}, "eye is missing"),
    "no rotation": ({"position": [0, 0, 0]}, "rotation is missing"),
    "eye of two": (target(eye=[0, 0]), "eye: not 3 numbers"),
    "eye a text": (target(eye="0 0 0"), "eye: not 3 numbers"),
    "eye of texts": (target(eye=[0, "0", 0]), r"eye\[1\]: '0' is not a number"),
    "eye of true": (target(eye=[0, True, 0]), r"eye\[1\]: True is not a number"),
    "infinite eye": (target(eye=[0, math.inf, 0]), "eye is not finite"),
    "huge whole number": (target(eye=[0, 10**400, 0]), "too large"),
    "eye is target": (target(target=[0, 0, 0]), "looks at its own eye"),
    "up along view": (target(up=[0, 0, 3]), "looks along its up direction"),
    "up zero": (target(up=[0, 0, 0]), "up is zero"),
    "rotation of three": ({"position": [0, 0, 0], "rotation": [0, 0, 0]}, "not 4 numbers"),
    "rotation zero": ({"position": [0, 0, 0], "rotation": [0, 0, 0, 0]}, "length is 0"),
    "rotation of two": ({"position": [0, 0, 0], "rotation": [0, 0, 0, 2]}, "length is 2"),
    "rotation too long": ({"position": [0, 0, 0], "rotation": [0, 0, 0, 1.0001]}, "is 1.0001"),
    "flat of 15": ({"world_from_camera": {"row_major": [0] * 15}}, "row_major: not 16 numbers"),
    "flat of both": (
        {"world_from_camera": {"row_major": [0] * 16, "column_major": [0] * 16}},
        "not a flat matrix",
    ),
    "flat of neither": ({"world_from_camera": {"rows": [0] * 16}}, "not a flat matrix"),
    "three rows": ({"world_from_camera": POSE.tolist()[:3]}, "not a 4 by 4 matrix"),
    "row of a text": (
        {"camera_from_world": [*POSE.tolist()[:3], [0, 0, 0, "1"]]},
        r"camera_from_world\[3\]\[3\]: '1' is not a number",
    ),
    "infinite inverse": ({"camera_from_world": [[math.inf] * 4] * 4}, "not finite"),
    "transposed inverse": ({"camera_from_world": INVERSE.T.tolist()}, "say column_major"),
    "unknown depth": ({**CLIP, "clip_depth": "0-1"}, "'0-1' is no clip_depth; write one of"),
    "depth a list": ({**CLIP, "clip_depth": [0, 1]}, "is no clip_depth"),
    "unknown way up": ({**CLIP, "clip_y": "left"}, "'left' is no clip_y"),
    "lens twice": ({**CLIP, "yfov": 1.0}, "yfov is given, and clip_from_world says it too"),
    "no depth": ({"clip_from_world": CLIP["clip_from_world"]}, "near plane is not known"),
    "transposed": ({**CLIP, "clip_from_world": TURNED}, "are mistaken|say row_major"),
    "near a text": ({**CLIP, "near": "1"}, "near: '1' is not a number"),
}


@pytest.mark.parametrize(("values", "expected"), WRONG.values(), ids=WRONG)
def test_what_is_no_camera_is_one_line(values, expected):
    with pytest.raises(InputError) as caught:
        read_camera(values, 64, 48)
    text = str(caught.value)
    assert "\n" not in text
    assert np.any([part in text for part in expected.replace("\\", "").split("|")]), text


@pytest.mark.parametrize("size", [1.1e-4, 0.01, 3.0])
def test_a_matrix_that_is_further_off_is_refused_by_the_camera_with_the_size(size):
    given = POSE.copy()
    given[:3, 0] *= 1.0 + size
    made = read_camera({"world_from_camera": given.tolist()}, 64, 48)
    with pytest.raises(InputError, match="not orthonormal \\(off by"):
        Camera(made.world_from_camera, 64, 48, near=1.0, yfov=1.0)
