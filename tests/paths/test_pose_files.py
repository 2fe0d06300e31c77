"""Poses of other programs: one camera, written as each of them would, is the same camera.

The camera stands at (2, 3, 7) metres, looks to the right of -Z and down, and rolls; its four
vectors are told to each program in that program's own axes and units, as its manual has them.
"""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from visref.camera import Camera
from visref.camera_path import CameraPath
from visref.cli.main import main
from visref.errors import InputError
from visref.paths.conventions import CONVENTIONS, find_convention
from visref.paths.lens import Lens
from visref.paths.pose_files import from_poses

# A rotation of small whole numbers: columns right, up and back, each over 3.
RIGHT, UP, BACK = np.array([(2, -1, 2), (2, 2, -1), (-1, 2, 2)]) / 3.0
EYE = np.array((2.0, 3.0, 7.0))
POSE = np.eye(4)
POSE[:3, 0], POSE[:3, 1], POSE[:3, 2], POSE[:3, 3] = RIGHT, UP, BACK, EYE

# Each program's world: where a point (x, y, z) of glTF's, in metres, is there.
WORLDS = {
    "opencv": lambda x, y, z: (x, y, z),
    "opengl": lambda x, y, z: (x, y, z),
    "d3d": lambda x, y, z: (x, y, -z),
    "unity": lambda x, y, z: (-x, y, z),
    # y becomes its z, z its y; in centimetres.
    "unreal": lambda x, y, z: (100 * x, 100 * z, 100 * y),
    "blender": lambda x, y, z: (x, -z, y),
}
# A camera's own x, y and z axes there, by what is right, up and ahead in its image.
AXES = {
    "opencv": lambda right, up, ahead: (right, -up, ahead),
    "opengl": lambda right, up, ahead: (right, up, -ahead),
    "d3d": lambda right, up, ahead: (right, up, ahead),
    "unity": lambda right, up, ahead: (right, up, ahead),
    "unreal": lambda right, up, ahead: (ahead, right, up),
    "blender": lambda right, up, ahead: (right, up, -ahead),
}


def written(name: str) -> tuple[np.ndarray, np.ndarray]:
    """The camera as that program has it: the rotation whose columns are the camera's axes in its
    world, (3, 3), and the position in its world."""

    def direction(vector):
        there = np.array(WORLDS[name](*vector), np.float64)
        return there / np.linalg.norm(there)

    axes = AXES[name](direction(RIGHT), direction(UP), direction(-BACK))
    return np.stack(axes, axis=1), np.array(WORLDS[name](*EYE), np.float64)


def quaternion(rotation) -> np.ndarray:
    """x, y, z, w: the eigenvector of the largest eigenvalue of Bar-Itzhack's matrix (2000)."""
    (a, b, c), (d, e, f), (g, h, i) = rotation
    matrix = np.array(
        [[a - e - i, d + b, g + c, h - f], [d + b, e - a - i, h + f, c - g],
         [g + c, h + f, i - a - e, d - b], [h - f, c - g, d - b, a + e + i]]
    )  # fmt: skip
    values, vectors = np.linalg.eigh(matrix)
    return vectors[:, np.argmax(values)]


# An eigenvector of a well-conditioned matrix of numbers below 3, and a few products: within a
# hundred roundings.
CLOSE = 100 * 2.0**-53


def same(camera: Camera) -> None:
    assert np.abs(camera.world_from_camera[:3, :3] - POSE[:3, :3]).max() <= CLOSE
    assert np.abs(camera.eye - EYE).max() <= CLOSE * 10


@pytest.mark.parametrize("name", CONVENTIONS)
def test_a_rotation_of_each_convention_is_one(name):
    rotation, _ = written(name)
    assert np.linalg.det(rotation) == pytest.approx(1.0, abs=CLOSE)


@pytest.mark.parametrize("name", CONVENTIONS)
def test_the_same_camera_in_each_convention_is_the_same(name):
    rotation, position = written(name)
    pose = find_convention(name).pose(rotation, position)
    assert np.abs(pose - POSE).max() <= CLOSE
    assert pose[:3, 3].tolist() == EYE.tolist()


def row(name: str) -> str:
    rotation, position = written(name)
    return ",".join(f"{value:.17g}" for value in (*position, *quaternion(rotation)))


@pytest.mark.parametrize("name", CONVENTIONS)
@pytest.mark.parametrize("kind", ["csv", "tum", "colmap"])
def test_every_kind_of_file_in_every_convention_gives_that_camera(name, kind, tmp_path):
    rotation, position = written(name)
    x, y, z, w = quaternion(rotation)
    if kind == "csv":
        file = tmp_path / "poses.csv"
        file.write_text(f"time_s,name,x,y,z,qx,qy,qz,qw\n0.5,first,{row(name)}\n")
    elif kind == "tum":
        file = tmp_path / "poses.txt"
        file.write_text(f"# a comment\n1305031102.25 {row(name).replace(',', ' ')}\n")
    else:
        file = tmp_path / "images.txt"
        # COLMAP has the inverse.
        turn = np.linalg.inv(rotation)
        shift = " ".join(f"{value:.17g}" for value in -turn @ position)
        file.write_text(f"1 {w:.17g} {-x:.17g} {-y:.17g} {-z:.17g} {shift} 1 a.jpg\n\n")
    path = from_poses(file, find_convention(name), Lens(64, 48), near=0.25, far=math.inf)
    ((camera,),) = (frame.cameras for frame in path.frames)
    same(camera)
    assert (camera.width, camera.height, camera.near, camera.far) == (64, 48, 0.25, math.inf)
    assert path.frames[0].time_s == {"csv": 0.5, "tum": 0.0, "colmap": None}[kind]


def test_tum_counts_time_from_the_first_pose(tmp_path):
    file = tmp_path / "poses.txt"
    file.write_text("100.5 0 0 0 0 0 0 1\n\n101.25 0 0 1 0 0 0 1 # the second\n")
    path = from_poses(file, find_convention("opengl"), None, near=0.1, far=9.0)
    assert [frame.time_s for frame in path.frames] == [0.0, 0.75]
    assert path.cameras[1].eye.tolist() == [0, 0, 1]


IMAGES = """# Image list with two lines of data per image:
2 1 0 0 0 0 0 -5 7 frame_b.jpg
10.5 20.5 -1 3.25 4.5 12
1 1 0 0 0 1 0 0 8 frame a.jpg

"""
CAMERAS = """# Camera list with one line of data per camera:
7 PINHOLE 640 480 500.0 500.0 310.5 244.25
8 SIMPLE_RADIAL 640 480 400 320 240 0
"""


def colmap(folder, images=IMAGES, cameras=CAMERAS) -> CameraPath:
    (folder / "images.txt").write_text(images)
    (folder / "cameras.txt").write_text(cameras)
    return from_poses(
        folder / "images.txt", find_convention("opencv"), None, near=0.1, far=math.inf
    )


def test_colmap_s_cameras_see_what_their_pixels_do(tmp_path):
    path = colmap(tmp_path)
    first, second = path.cameras
    # By name: 'frame a.jpg' is before 'frame_b.jpg'.
    assert first.eye.tolist() == [-1, 0, 0]
    assert second.eye.tolist() == [0, 0, 5]
    assert (first.shift_x_px, first.shift_y_px) == (0.0, 0.0)
    # A pinhole: the middle of pixel (x, y) is at (x + 1/2, y + 1/2), and its ray is
    # ((x + 1/2 - cx) / f, (y + 1/2 - cy) / f, 1) in axes right, down, ahead.
    for x, y in ((0, 0), (639, 479), (17, 400)):
        _, ray = second.ray(x, y)
        pinhole = ((x + 0.5 - 310.5) / 500, (y + 0.5 - 244.25) / 500, 1.0)
        # The identity there: x right, y down, z ahead.
        assert ray @ (1, 0, 0) == pytest.approx(pinhole[0], abs=1e-14)
        assert ray.tolist() == pytest.approx([pinhole[0], pinhole[1], pinhole[2]], abs=1e-14)


def test_a_lens_that_is_given_stands_over_colmap_s(tmp_path):
    (tmp_path / "images.txt").write_text(IMAGES)
    lens = Lens(32, 24, 1.0)
    path = from_poses(tmp_path / "images.txt", find_convention("opencv"), lens, near=0.5, far=9.0)
    assert {(c.width, c.height, c.yfov, c.near) for c in path.cameras} == {(32, 24, 1.0, 0.5)}


WRONG_CAMERAS = {
    "missing": ("8 SIMPLE_PINHOLE 640 480 400 320 240\n", "line 2: camera 7 is not in cameras.txt"),
    "oblong": ("7 PINHOLE 640 480 500 501 320 240\n", "line 1: the focal lengths are 500 and 501"),
    "distorting": ("7 OPENCV 640 480 500 500 320 240 0 0.1 0 0\n", "line 1: the lens distorts"),
    "fisheye": ("7 OPENCV_FISHEYE 640 480 5 5 3 2 0 0 0 0\n", "OPENCV_FISHEYE are no perspective"),
    "too few": ("7 PINHOLE 640 480 500\n", "line 1: PINHOLE has 1 parameters; give 4"),
    "no camera": ("7 PINHOLE\n", "line 1: it is no camera"),
    "no number": ("7 PINHOLE 640 480 500 500 x 240\n", "line 1: 'x' is not a number"),
    "no size": ("7 PINHOLE 640.5 480 500 500 320 240\n", "'640.5' is not a whole number"),
    "no focal": ("7 PINHOLE 640 480 0 0 320 240\n", "focal lengths are 0 and 0"),
}


@pytest.mark.parametrize("name", WRONG_CAMERAS)
def test_cameras_that_are_no_camera_s_of_ours_are_refused(name, tmp_path):
    text, expected = WRONG_CAMERAS[name]
    with pytest.raises(InputError) as caught:
        colmap(tmp_path, cameras=text)
    assert expected in str(caught.value)
    assert "txt: " in str(caught.value)


def test_without_cameras_txt_the_fix_is_said(tmp_path):
    (tmp_path / "images.txt").write_text(IMAGES)
    with pytest.raises(InputError, match=r"cameras\.txt: .*; put .* or give --size and --fov"):
        from_poses(tmp_path / "images.txt", find_convention("opencv"), None, near=0.1, far=9.0)


WRONG_FILES = {
    "empty": ("a.txt", "# nothing\n", "there is no pose in it"),
    "seven": ("a.txt", "0 0 0 0 0 0 1\n", "line 1: it has 7 numbers"),
    "a word": ("a.txt", "0 0 0 zero 0 0 0 1\n", "line 1: 'zero' is not a number"),
    "long quaternion": ("a.txt", "0 0 0 0 0 0 0 2\n", "line 1: the quaternion's length is 2"),
    "no heading": ("a.csv", "0,0,0,0,0,0,1\n", "line 1: there is no one column 'x'"),
    "half a heading": ("a.csv", "x,y,z,qx,qy,qz\n", "there is no one column 'qw'"),
    "twice": ("a.csv", "x,x,y,z,qx,qy,qz,qw\n", "there is no one column 'x'"),
    "two times": ("a.csv", "time_s,time_s,x,y,z,qx,qy,qz,qw\n", "no one column 'time_s'"),
    "short row": ("a.csv", "x,y,z,qx,qy,qz,qw\n1,2\n", "line 2: it has 2 cells for 7 columns"),
    "infinite": ("a.csv", "x,y,z,qx,qy,qz,qw\ninf,0,0,0,0,0,1\n", "line 2: 'inf' is not a"),
    "bytes": ("a.txt", b"\xff\xfe0 0 0", "it is no UTF-8 text"),
    "quaternion of zeros": (
        "images.txt",
        "1 0 0 0 0 0 0 0 1 a\n\n",
        "the quaternion's length is 0",
    ),
    "not an id": ("images.txt", "1 1 0 0 0 0 0 0 x a\n\n", "'x' is not a whole number"),
}


@pytest.mark.parametrize("name", WRONG_FILES)
def test_a_file_that_holds_no_poses_is_one_line(name, tmp_path):
    file_name, content, expected = WRONG_FILES[name]
    file = tmp_path / file_name
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    lens = Lens()
    with pytest.raises(InputError) as caught:
        from_poses(file, find_convention("opencv"), lens, near=0.1, far=9.0)
    assert expected in str(caught.value)
    assert str(caught.value).startswith(str(file))
    assert "\n" not in str(caught.value)


def test_the_command_writes_a_path_that_is_read(tmp_path, capsys):
    file, out = tmp_path / "poses.csv", tmp_path / "path.json"
    file.write_text(f"x,y,z,qx,qy,qz,qw\n{row('unreal')}\n")
    given = ["path", "from-poses", str(file), "--out", str(out), "--size", "32x24"]
    assert main([*given, "--convention", "unreal", "--fov", "90", "--far", "100"]) == 0
    (camera,) = CameraPath.load(out).cameras
    same(camera)
    assert (camera.width, camera.height, camera.far) == (32, 24, 100.0)
    assert camera.yfov == math.pi / 2
    assert json.loads(out.read_text())["near"] == 0.1
    assert main([*given, "--convention", "unrael"]) == 2
    assert "did you mean 'unreal'?" in capsys.readouterr().err
