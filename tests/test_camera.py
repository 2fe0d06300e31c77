"""The conventions of cameras, samples and path files."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.bad_input import path_json
from visref.camera import Camera, look_at
from visref.camera_path import CameraPath
from visref.errors import InputError


def random_camera(seed: int, **changes) -> Camera:
    rng = np.random.default_rng(seed)
    lens = {"yfov": float(rng.uniform(0.2, 2.5))}
    if seed % 2:
        lens = {"ymag": float(rng.uniform(0.5, 9.0))}
    fields = {
        "world_from_camera": look_at(rng.normal(size=3) * 10, rng.normal(size=3)),
        "width": int(rng.integers(1, 40)),
        "height": int(rng.integers(1, 40)),
        "near": 0.5,
        "far": 80.0,
        "shift_x_px": float(rng.uniform(-3, 3)),
        "shift_y_px": float(rng.uniform(-3, 3)),
        **lens,
        **changes,
    }
    return Camera(**fields)


def test_rays_of_a_hand_made_perspective_camera():
    # Four by two pixels, a right angle of view: half the height is 1 at depth 1, so a pixel
    # is 1 wide there, and centres stand half a pixel off the axes.
    camera = Camera(np.eye(4), 4, 2, near=1.0, yfov=math.pi / 2)
    origin, direction = camera.ray(0, 0)
    assert origin.tolist() == [0, 0, 0]
    assert np.allclose(direction, [-1.5, 0.5, -1], rtol=0, atol=1e-15)
    assert np.allclose(camera.ray(3, 1)[1], [1.5, -0.5, -1], rtol=0, atol=1e-15)


def test_rays_of_a_hand_made_orthographic_camera():
    matrix = np.eye(4)
    matrix[:3, 3] = 10, 20, 30
    camera = Camera(matrix, 4, 2, near=0.0, ymag=3.0)
    origin, direction = camera.ray(0, 0)
    assert origin.tolist() == [10 - 4.5, 20 + 1.5, 30]
    assert direction.tolist() == [0, 0, -1]


def test_sample_definition_is_evaluated_in_the_stated_order():
    camera = random_camera(6)
    pose = camera.world_from_camera
    s = math.tan(camera.yfov / 2) / camera.height
    assert np.array_equal(camera.right_step, pose[:3, 0] * s)
    assert np.array_equal(camera.up_step, pose[:3, 1] * s)
    assert np.array_equal(camera.forward, -pose[:3, 2])
    x, y = camera.width // 2, camera.height // 3
    a = 2 * (x + camera.shift_x_px) + 1 - camera.width
    b = camera.height - 2 * (y + camera.shift_y_px) - 1
    expected = camera.forward + (a * camera.right_step + b * camera.up_step)
    assert np.array_equal(camera.ray(x, y)[1], expected)


def test_given_axes_are_never_normalised_again():
    matrix = np.eye(4)
    matrix[0, 0] = 1.0 + 4e-7
    camera = Camera(matrix, 2, 2, near=1.0, ymag=2.0)
    assert camera.right_step[0] == 1.0 + 4e-7


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10_000), depth=st.floats(0.5, 80.0))
def test_projection_puts_every_sample_at_its_pixel_centre(seed, depth):
    camera = random_camera(seed)
    rng = np.random.default_rng(seed)
    x, y = int(rng.integers(camera.width)), int(rng.integers(camera.height))
    origin, direction = camera.ray(x, y)
    point = origin + depth * direction
    clip = camera.clip_from_world() @ [*point, 1.0]
    ndc = clip[:3] / clip[3]
    # OpenGL's window coordinates have y up; the image has y down.
    assert (ndc[0] + 1) / 2 * camera.width == pytest.approx(x + 0.5, abs=1e-9)
    assert (1 - ndc[1]) / 2 * camera.height == pytest.approx(y + 0.5, abs=1e-9)
    assert -1.0 - 1e-9 <= ndc[2] <= 1.0 + 1e-9
    pixel, view_depth = camera.pixel_of(point[None])
    assert pixel[0] == pytest.approx([x, y], abs=1e-9)
    assert view_depth[0] == pytest.approx(depth, rel=1e-12)


@pytest.mark.parametrize("seed", [0, 1])
def test_near_and_far_planes_are_the_ends_of_the_depth_range(seed):
    camera = random_camera(seed)
    for depth, expected in ((camera.near, -1.0), (camera.far, 1.0)):
        origin, direction = camera.ray(0, 0)
        clip = camera.clip_from_world() @ [*(origin + depth * direction), 1.0]
        assert clip[2] / clip[3] == pytest.approx(expected, abs=1e-9)


def test_infinite_far_plane_is_a_limit_in_perspective_and_an_error_in_orthographic_gl():
    perspective = random_camera(0, far=math.inf)
    closed = random_camera(0, far=1e12)
    assert np.allclose(perspective.clip_from_camera(), closed.clip_from_camera(), atol=1e-9)
    orthographic = random_camera(1, far=math.inf)
    with pytest.raises(InputError, match="finite far"):
        orthographic.clip_from_camera()
    assert orthographic.clip_from_camera(80.0)[3, 3] == 1.0


def test_camera_from_world_inverts_the_pose():
    camera = random_camera(4)
    product = camera.camera_from_world @ camera.world_from_camera
    assert np.allclose(product, np.eye(4), rtol=0, atol=1e-14)


@pytest.mark.parametrize("up", [(0.0, 1.0, 0.0), (0.0, 0.0, 1.0)])
def test_look_at_looks_at_its_target_even_along_up(up):
    for target in ((0, 5, 0), (0, -5, 0), (3, 1, 2), (0, 0, 5)):
        pose = look_at((0, 0, 0), target, up)
        camera = Camera(pose, 5, 5, near=0.1, yfov=1.0)
        pixel, depth = camera.pixel_of(np.array([target], np.float64))
        assert pixel[0] == pytest.approx([2, 2], abs=1e-9)
        assert depth[0] == pytest.approx(np.linalg.norm(target))
        assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)
    with pytest.raises(InputError, match="own position"):
        look_at((1, 2, 3), (1, 2, 3))


def test_definition_keeps_every_bit():
    camera = random_camera(2)
    definition = json.loads(json.dumps(camera.definition()))
    for name, values in (("e", camera.eye), ("R", camera.right_step), ("U", camera.up_step)):
        assert [float.fromhex(v) for v in definition[name]] == values.tolist()
    assert float.fromhex(definition["shift_x_px"]) == camera.shift_x_px


@settings(max_examples=30, deadline=None)
@given(seeds=st.lists(st.integers(0, 1000), min_size=1, max_size=4), cut=st.booleans())
def test_path_survives_its_file_bit_for_bit(tmp_path_factory, seeds, cut):
    frames = tuple(random_camera(seed, cut=cut and i > 0) for i, seed in enumerate(seeds))
    file = tmp_path_factory.mktemp("path") / "path.json"
    file.write_text(json.dumps(CameraPath(frames).to_json()))
    loaded = CameraPath.load(file)
    assert [c.definition() for c in loaded] == [c.definition() for c in frames]
    assert [c.cut for c in loaded] == [c.cut for c in frames]
    assert loaded.source == str(file)


def test_null_and_absent_far_are_infinite():
    for far in (None, ...):
        (camera,) = CameraPath.from_json(path_json(far=far))
        assert math.isinf(camera.far)
    assert CameraPath.from_json(path_json(far=None)).to_json()["far"] is None


def test_frame_overrides_any_field_and_its_lens_replaces_the_path_s():
    pose = np.eye(4).tolist()
    path = CameraPath.from_json(
        path_json(
            frames=[
                {"world_from_camera": pose},
                {"world_from_camera": pose, "ymag": 2.0, "width": 3, "near": 0.0},
                {"world_from_camera": pose, "yfov": 0.5, "far": None, "shift_y_px": 0.5},
            ]
        )
    )
    first, second, third = path
    assert (first.yfov, first.ymag, first.width) == (1.0, None, 8)
    assert (second.yfov, second.ymag, second.width, second.near) == (None, 2.0, 3, 0.0)
    assert (third.yfov, third.far, third.shift_y_px) == (0.5, math.inf, 0.5)


def test_fields_that_all_frames_share_are_written_once():
    path = CameraPath((random_camera(2), random_camera(2, cut=True)))
    data = path.to_json()
    assert data["yfov"] == path.cameras[0].yfov
    assert set(data["frames"][1]) == {"world_from_camera", "cut"}


def test_resized_path_keeps_the_view():
    path = CameraPath((random_camera(2),)).resized(100, 50)
    (camera,) = path
    assert (camera.width, camera.height, camera.yfov) == (100, 50, random_camera(2).yfov)


@pytest.mark.parametrize("size", [(1, 1), (1, 4096), (641, 479)])
def test_odd_viewports_are_viewports(size):
    width, height = size
    camera = Camera(np.eye(4), width, height, near=0.1, yfov=1.0)
    assert (len(camera.column_a), len(camera.row_b)) == size
    assert camera.column_a.sum() == 0.0
    assert camera.row_b.sum() == 0.0


def test_pose_cannot_change_under_the_camera():
    matrix = np.eye(4)
    camera = Camera(matrix, 2, 2, near=0.1, yfov=1.0)
    matrix[0, 3] = 7.0
    assert camera.eye.tolist() == [0, 0, 0]
    with pytest.raises(ValueError, match="read-only"):
        camera.world_from_camera[0, 3] = 7.0


@pytest.mark.parametrize("scale", [1e-3, 0.999998, 1.000002, 1e3])
def test_uniformly_scaled_pose_is_refused_as_such(scale):
    matrix = np.diag([scale, scale, scale, 1.0])
    with pytest.raises(InputError, match="not orthonormal"):
        Camera(matrix, 2, 2, near=0.1, yfov=1.0)


@pytest.mark.parametrize("turn", [1, -1])
def test_pose_that_overflows_is_refused(turn):
    matrix = np.eye(4)
    matrix[:2, :2] = [[1e200, 1e200], [turn * -1e200, 1e200]]
    with pytest.raises(InputError, match="world_from_camera"):
        Camera(matrix, 2, 2, near=0.1, yfov=1.0)


@pytest.mark.parametrize(
    ("lens", "half"), [({"yfov": 1.0}, math.tan(0.5) / 6), ({"ymag": 3.0}, 0.5)]
)
def test_half_a_pixel_is_the_image_s_half_height_by_its_rows(lens, half):
    camera = Camera(look_at((1.0, 2.0, 3.0), (4.0, 5.0, 7.0)), 8, 6, near=0.1, far=10.0, **lens)
    assert camera.half_pixel == pytest.approx(half, rel=1e-15)
    assert camera.half_pixel == np.linalg.norm(camera.right_step)
