"""A glTF's own cameras: lenses, poses, and the three interpolations."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.support.gltf_files import Gltf
from visref.camera import look_at
from visref.camera_path import CameraPath
from visref.errors import InputError
from visref.formats import load_path


def camera_file(**node) -> Gltf:
    """A file with one perspective camera, on node 0."""
    gltf = Gltf()
    gltf.entry("cameras", type="perspective", perspective={"yfov": 1.0, "znear": 0.5, "zfar": 9.0})
    gltf.node(camera=0, **node)
    return gltf


def animate(gltf: Gltf, node: int, path: str, times, values, interpolation: str = "LINEAR") -> None:
    """Add a channel to the file's first animation."""
    if "animations" not in gltf.json:
        gltf.entry("animations", samplers=[], channels=[])
    (animation,) = gltf.json["animations"]
    animation["samplers"].append(
        {
            "input": gltf.accessor(np.array(times, "f4")),
            "output": gltf.accessor(np.array(values, "f4")),
            "interpolation": interpolation,
        }
    )
    animation["channels"].append(
        {
            "sampler": len(animation["samplers"]) - 1,
            "target": {"node": node, "path": path},
        }
    )


def load(gltf: Gltf, folder, **options) -> CameraPath:
    return load_path(gltf.write(folder / "path.glb"), **options)


def eyes(path: CameraPath) -> list[list[float]]:
    return [camera.eye.tolist() for camera in path]


def test_perspective_lens_is_taken_over_and_the_image_size_is_ours(tmp_path):
    (camera,) = load(camera_file(translation=[1, 2, 3]), tmp_path, width=64, height=48)
    assert (camera.width, camera.height) == (64, 48)
    assert (camera.near, camera.far, camera.yfov, camera.ymag) == (0.5, 9.0, 1.0, None)
    assert camera.eye.tolist() == [1, 2, 3]
    assert camera.forward.tolist() == [0, 0, -1]


def test_absent_far_plane_is_infinite(tmp_path):
    gltf = camera_file()
    del gltf.json["cameras"][0]["perspective"]["zfar"]
    (camera,) = load(gltf, tmp_path)
    assert math.isinf(camera.far)


def test_orthographic_lens(tmp_path):
    gltf = camera_file()
    lens = {"xmag": 4.0, "ymag": 3.0, "znear": 0.0, "zfar": 5.0}
    gltf.json["cameras"][0] = {"type": "orthographic", "orthographic": lens}
    (camera,) = load(gltf, tmp_path)
    assert (camera.near, camera.far, camera.yfov, camera.ymag) == (0.0, 5.0, None, 3.0)


def test_scale_of_a_camera_is_ignored_but_moves_what_hangs_below(tmp_path):
    gltf = camera_file(translation=[1, 0, 0], scale=[1, 1, 5])
    gltf.json["nodes"].append({"children": [0], "scale": [3, 3, 3], "rotation": [0, 1, 0, 1]})
    gltf.json["scenes"][0]["nodes"] = [1]
    (camera,) = load(gltf, tmp_path)
    # A quarter turn about y takes x to -z; the look along -z becomes one along -x.
    assert np.allclose(camera.eye, [0, 0, -3], atol=1e-15)
    assert np.allclose(camera.forward, [-1, 0, 0], atol=1e-15)


def test_matrix_of_six_digits_is_rigid_enough(tmp_path):
    matrix = look_at((3, 5, 7), (-1, 0.4, 2)).round(6)
    assert np.abs(matrix[:3, :3].T @ matrix[:3, :3] - np.eye(3)).max() > 1e-7
    (camera,) = load(camera_file(matrix=matrix.T.reshape(-1).tolist()), tmp_path)
    axes = camera.world_from_camera[:3, :3]
    assert np.abs(axes.T @ axes - np.eye(3)).max() < 1e-15
    assert np.abs(axes - matrix[:3, :3]).max() < 1e-6


def test_linear_translation_is_sampled_at_its_keys_or_at_a_rate(tmp_path):
    gltf = camera_file()
    animate(gltf, 0, "translation", [1, 2, 4], [[0, 0, 0], [8, 0, 0], [8, 4, 0]])
    assert eyes(load(gltf, tmp_path)) == [[0, 0, 0], [8, 0, 0], [8, 4, 0]]
    at_two = eyes(load(gltf, tmp_path, fps=2.0))
    assert at_two == [[0, 0, 0], [4, 0, 0], [8, 0, 0], [8, 1, 0], [8, 2, 0], [8, 3, 0], [8, 4, 0]]


def test_step_holds_until_the_next_key(tmp_path):
    gltf = camera_file()
    animate(gltf, 0, "translation", [0, 1, 2], [[0, 0, 0], [1, 0, 0], [2, 0, 0]], "STEP")
    xs = [eye[0] for eye in eyes(load(gltf, tmp_path, fps=4.0))]
    assert xs == [0, 0, 0, 0, 1, 1, 1, 1, 2]


def test_cubic_spline_reproduces_cubics_on_both_sides_of_a_kink(tmp_path):
    # A Hermite spline is exact on cubics; the two meet at t = 1 with different slopes.
    def x(t):
        return t**3 - 2 * t if t <= 1 else -1 + 5 * (t - 1) - (t - 1) ** 3

    gltf = camera_file()
    slopes = [(9, -2), (1, 5), (5 - 3 * 2**2, 9)]  # before and after each key; the 9s are unused
    values = [
        [v, 0, 0]
        for t, (before, after) in zip((0, 1, 3), slopes, strict=True)
        for v in (before, x(t), after)
    ]
    animate(gltf, 0, "translation", [0.0, 1.0, 3.0], values, "CUBICSPLINE")
    got = [eye[0] for eye in eyes(load(gltf, tmp_path, fps=8.0))]
    assert np.allclose(got, [x(k / 8) for k in range(25)], rtol=0, atol=1e-12)


def test_last_tick_is_kept_where_a_float32_time_falls_short_of_it(tmp_path):
    gltf = camera_file()
    animate(gltf, 0, "translation", [0, 0.7], [[0, 0, 0], [7, 0, 0]])
    xs = [eye[0] for eye in eyes(load(gltf, tmp_path, fps=10.0))]
    assert len(xs) == 8
    assert xs[-1] == 7.0


@pytest.mark.parametrize("sign", [1, -1])
def test_linear_rotation_turns_at_an_even_rate_the_short_way(tmp_path, sign):
    gltf = camera_file()
    half = math.radians(80) / 2
    ends = [[0, 0, 0, 1], [0, sign * math.sin(half), 0, sign * math.cos(half)]]
    animate(gltf, 0, "rotation", [0, 1], ends)
    path = load(gltf, tmp_path, fps=8.0)
    assert len(path) == 9
    for k, camera in enumerate(path):
        angle = math.radians(80) * k / 8
        expected = [-math.sin(angle), 0, -math.cos(angle)]
        assert np.allclose(camera.forward, expected, rtol=0, atol=1e-7)  # float32 keys


def test_still_rotation_stays_where_it_is(tmp_path):
    gltf = camera_file()
    animate(gltf, 0, "rotation", [0, 1], [[0, 1, 0, 1], [0, 1, 0, 1]])
    for camera in load(gltf, tmp_path, fps=4.0):
        assert np.allclose(camera.forward, [-1, 0, 0], atol=1e-15)


def test_channels_of_node_and_ancestor_play_together_with_their_ends_held(tmp_path):
    gltf = camera_file()
    gltf.json["nodes"].append({"children": [0], "rotation": [0, 0, 1, 1]})
    gltf.json["scenes"][0]["nodes"] = [1]
    animate(gltf, 0, "translation", [1, 2], [[1, 0, 0], [2, 0, 0]])
    animate(gltf, 1, "translation", [0, 2], [[0, 0, 0], [0, 0, 4]])
    animate(gltf, 1, "scale", [0], [[10, 10, 10]])
    path = load(gltf, tmp_path)
    # Keys at 0, 1 and 2; the parent turns x into y and is ten times as large.
    assert np.allclose(eyes(path), [[0, 10, 0], [0, 10, 2], [0, 20, 4]], atol=1e-14)


def test_every_camera_and_every_clip_is_a_piece_after_a_cut(tmp_path):
    gltf = camera_file()
    gltf.node(camera=0, translation=[5, 0, 0])
    animate(gltf, 0, "translation", [0, 1], [[0, 0, 0], [1, 0, 0]])
    animate(gltf, 1, "weights", [0, 1], [0.0, 1.0])
    second = {**gltf.json["animations"][0]}
    gltf.json["animations"].append(second)
    path = load(gltf, tmp_path)
    assert [eye[0] for eye in eyes(path)] == [0, 1, 0, 1, 5]
    assert [camera.cut for camera in path] == [False, False, True, False, True]


def test_normalized_integer_rotation_keys_are_decoded(tmp_path):
    gltf = camera_file()
    animate(gltf, 0, "rotation", [0], [[0, 1, 0, 1]])
    sampler = gltf.json["animations"][0]["samplers"][0]
    keys = np.array([[0, 23170, 0, 23170]], "i2")
    sampler["output"] = gltf.accessor(keys, normalized=True)
    (camera,) = load(gltf, tmp_path)
    assert np.allclose(camera.forward, [-1, 0, 0], atol=1e-15)


@pytest.mark.parametrize("fps", [0.0, -1.0, math.nan, math.inf])
def test_rate_must_be_positive(tmp_path, fps):
    with pytest.raises(InputError, match="fps"):
        load(camera_file(), tmp_path, fps=fps)


def test_endless_animation_is_refused(tmp_path):
    gltf = camera_file()
    animate(gltf, 0, "translation", [0, 1e30], [[0, 0, 0], [1, 0, 0]])
    with pytest.raises(InputError, match="frames"):
        load(gltf, tmp_path, fps=60.0)


def test_output_must_match_its_times(tmp_path):
    gltf = camera_file()
    animate(gltf, 0, "translation", [0, 1], [[0, 0, 0]])
    with pytest.raises(InputError, match="1 output values where 2 belong"):
        load(gltf, tmp_path)


def test_animated_node_with_a_matrix_is_refused(tmp_path):
    gltf = camera_file(matrix=np.eye(4).reshape(-1).tolist())
    animate(gltf, 0, "translation", [0], [[0, 0, 0]])
    with pytest.raises(InputError, match="an animated node has a matrix"):
        load(gltf, tmp_path)
