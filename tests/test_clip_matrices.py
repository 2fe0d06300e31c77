"""Cameras out of clip matrices, against the projections as OpenGL's, Direct3D's and Vulkan's
documentation writes them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from visref.camera import Camera
from visref.clip_matrices import decomposed
from visref.errors import InputError

U = 2.0**-53


def gl_frustum(left, right, bottom, top, near, far):
    """glFrustum's matrix."""
    return np.array(
        [
            [2 * near / (right - left), 0, (right + left) / (right - left), 0],
            [0, 2 * near / (top - bottom), (top + bottom) / (top - bottom), 0],
            [0, 0, -(far + near) / (far - near), -2 * far * near / (far - near)],
            [0, 0, -1, 0],
        ]
    )


def d3d_off_centre_lh(left, right, bottom, top, near, far):
    """D3DXMatrixPerspectiveOffCenterLH's matrix, for column vectors; its view space looks along
    +z."""
    return np.array(
        [
            [2 * near / (right - left), 0, (left + right) / (left - right), 0],
            [0, 2 * near / (top - bottom), (top + bottom) / (bottom - top), 0],
            [0, 0, far / (far - near), near * far / (near - far)],
            [0, 0, 1, 0],
        ]
    )


def vulkan(left, right, bottom, top, near, far):
    """As Vulkan's clip space has it: y down, depth from 0 to 1."""
    return np.array(
        [
            [2 * near / (right - left), 0, (right + left) / (right - left), 0],
            [0, -2 * near / (top - bottom), -(top + bottom) / (top - bottom), 0],
            [0, 0, far / (near - far), near * far / (near - far)],
            [0, 0, -1, 0],
        ]
    )


def reversed_infinite(left, right, bottom, top, near, far):
    """Depth 1 at near and 0 at infinity."""
    assert far == math.inf
    return np.array(
        [
            [2 * near / (right - left), 0, (right + left) / (right - left), 0],
            [0, 2 * near / (top - bottom), (top + bottom) / (top - bottom), 0],
            [0, 0, 0, near],
            [0, 0, -1, 0],
        ]
    )


def reversed_finite(left, right, bottom, top, near, far):
    """Depth 1 at near and 0 at far."""
    result = reversed_infinite(left, right, bottom, top, near, math.inf)
    result[2] = [0, 0, near / (far - near), far * near / (far - near)]
    return result


IDENTITY, FLIP_Z = np.eye(4), np.diag([1.0, 1.0, -1.0, 1.0])
# A projection, what its view space has of one that looks along -z, the depth, and which way is up.
CONVENTIONS = {
    "OpenGL": (gl_frustum, IDENTITY, "-1..1", "up"),
    "Direct3D": (d3d_off_centre_lh, FLIP_Z, "0..1", "up"),
    "Vulkan": (vulkan, IDENTITY, "0..1", "down"),
    "reversed": (reversed_finite, IDENTITY, "1..0", "up"),
    "reversed, infinite": (reversed_infinite, IDENTITY, "1..0", "up"),
}


def rotation(x, y, z, w):
    """By Rodrigues' formula, for a unit quaternion."""
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross


def camera(pose, near=0.25, far=800.0, shift=(0.0, 0.0), yfov=1.0, size=(64, 48)) -> Camera:
    return Camera(pose, *size, near, far, yfov=yfov, shift_x_px=shift[0], shift_y_px=shift[1])


def edges(one: Camera) -> tuple[float, float, float, float]:
    """left, right, bottom, top of the image on the near plane, from the words of the samples'
    definition: the image is `height` pixels high, moved by the shift."""
    pixel = 2 * math.tan(one.yfov / 2) / one.height * one.near
    left = (one.shift_x_px - one.width / 2) * pixel
    top = (one.height / 2 - one.shift_y_px) * pixel
    return left, left + one.width * pixel, top - one.height * pixel, top


def clip_matrix(one: Camera, convention: str):
    project, view_from_gl, depth, up = CONVENTIONS[convention]
    rotation = one.world_from_camera[:3, :3].T
    view = np.eye(4)
    view[:3, :3], view[:3, 3] = rotation, -rotation @ one.eye
    return project(*edges(one), one.near, one.far) @ view_from_gl @ view, depth, up


def read(matrix, one: Camera, depth, up="up") -> Camera:
    matrix = matrix * [[1.0], [-1.0 if up == "down" else 1.0], [1.0], [1.0]]
    pose, lens, off = decomposed(matrix, one.width, one.height, depth=depth)
    assert off <= 1e-6
    return Camera(pose, one.width, one.height, **lens)


def printed(matrix, form="%.17g"):
    return np.array([[float(form % value) for value in row] for row in matrix])


unit = st.floats(-1.0, 1.0)
poses = st.tuples(unit, unit, unit, unit, *[st.floats(-1000.0, 1000.0)] * 3).filter(
    lambda q: math.hypot(*q[:4]) > 0.1
)


def posed(values) -> np.ndarray:
    quaternion = np.array(values[:4])
    pose = np.eye(4)
    pose[:3, :3] = rotation(*quaternion / np.linalg.norm(quaternion))
    pose[:3, 3] = values[4:]
    return pose


cameras = st.builds(
    lambda pose, near, ratio, *rest: camera(posed(pose), near, near * ratio, *rest),
    poses,
    st.floats(0.01, 10.0),
    st.floats(2.0, 1e6),
    st.tuples(st.floats(-40.0, 40.0), st.floats(-40.0, 40.0)),
    st.floats(0.1, 2.5),
    st.sampled_from([(64, 48), (1920, 1080), (1, 1), (31, 257)]),
)


@pytest.mark.parametrize("convention", CONVENTIONS)
@given(cameras)
def test_samples_of_a_printed_clip_matrix_are_those_of_its_camera(convention, one):
    if convention == "reversed, infinite":
        one = replace(one, far=math.inf)
    matrix, depth, up = clip_matrix(one, convention)
    again = read(printed(matrix), one, depth, up)
    # In units of U, relative to a row of three numbers of length 1 + c, with c the lens shift over
    # the scale of its row. Making the matrix: the edges 6, their difference or sum and quotient 4,
    # two products with sums 6. Taking it apart: the scale 3, shift and what is left of the row 8,
    # its length 3; the nearest rotation, of singular values all near 1, 12. That is 42. The angle
    # is rounded twice by two units, and its tangent magnifies that by yfov / sin(yfov), which is
    # under 4.2 here: 17. Rounded up to 64.
    pixel = 2 * math.tan(one.yfov / 2) / one.height
    c = max(abs(one.shift_x_px) / one.width, abs(one.shift_y_px) / one.height) * 2
    bound = 64 * U * (1.0 + c)
    for x, y in ((0, 0), (one.width - 1, one.height // 2), (one.width // 2, one.height - 1)):
        (eye, ray), (read_eye, read_ray) = one.ray(x, y), again.ray(x, y)
        reach = 1.0 + pixel * (one.width + one.height + abs(one.shift_x_px) + abs(one.shift_y_px))
        assert np.abs(read_ray - ray).max() <= bound * reach
        # The eye comes from the last column, whose numbers are of its size.
        assert np.abs(read_eye - eye).max() <= bound * (1.0 + np.linalg.norm(eye))
    # Depth is offset / t - slope: offset is read with an error of the last column's size, and near
    # and far are offset over what is left of the slope at them, of size 1 and near / far.
    size = bound * (1.0 + np.linalg.norm(one.eye) / one.near)
    assert again.near == pytest.approx(one.near, rel=4 * size, abs=0.0)
    if math.isinf(one.far):
        assert again.far == math.inf
    elif 4 * size * one.far / one.near < 0.1:
        assert again.far == pytest.approx(one.far, rel=8 * size * one.far / one.near, abs=0.0)


@pytest.mark.parametrize("convention", CONVENTIONS)
def test_a_camera_without_a_shift_gets_none(convention):
    one = camera(posed((0.1, -0.7, 0.3, 0.6, 5.0, 1.0, -20.0)))
    if convention == "reversed, infinite":
        one = replace(one, far=math.inf)
    matrix, depth, up = clip_matrix(one, convention)
    for given_matrix in (matrix, matrix.astype(np.float32).astype(np.float64)):
        again = read(given_matrix, one, depth, up)
        assert (again.shift_x_px, again.shift_y_px) == (0.0, 0.0)


def test_a_left_handed_view_space_changes_nothing():
    one = camera(posed((0.1, -0.7, 0.3, 0.6, 5.0, 1.0, -20.0)))
    direct3d, vulkan_matrix = (clip_matrix(one, name)[0] for name in ("Direct3D", "Vulkan"))
    assert np.abs(direct3d - np.diag([1, -1, 1, 1]) @ vulkan_matrix).max() <= 64 * U * 800


def test_a_positive_factor_means_nothing():
    one = camera(posed((0.1, -0.7, 0.3, 0.6, 5.0, 1.0, -20.0)))
    matrix, depth, _ = clip_matrix(one, "OpenGL")
    # A power of two, so that nothing is rounded anew.
    assert read(matrix * 8.0, one, depth).definition() == read(matrix, one, depth).definition()


@pytest.mark.parametrize("depth", ["-1..1", "0..1", "1..0"])
def test_an_orthographic_matrix_sees_what_its_camera_sees(depth):
    pose = posed((0.1, -0.7, 0.3, 0.6, 5.0, 1.0, -20.0))
    one = Camera(pose, 64, 48, near=2.0, far=10.0, ymag=3.0, shift_x_px=2.5, shift_y_px=-1.0)
    # glOrtho's x and y from the samples' definition, depth by its two ends.
    pixel = 2 * 3.0 / 48
    left, top = (2.5 - 32) * pixel, (24 + 1.0) * pixel
    right, bottom = left + 64 * pixel, top - 48 * pixel
    at_near, at_far = {"-1..1": (-1, 1), "0..1": (0, 1), "1..0": (1, 0)}[depth]
    rate = (at_far - at_near) / 8.0
    projection = np.array(
        [
            [2 / (right - left), 0, 0, -(right + left) / (right - left)],
            [0, 2 / (top - bottom), 0, -(top + bottom) / (top - bottom)],
            [0, 0, -rate, at_near - 2.0 * rate],
            [0, 0, 0, 1],
        ]
    )
    again = read(printed(projection @ np.linalg.inv(pose)), one, depth)
    assert again.near == 0.0
    # The same points at the near plane and at the far plane; numbers of size 30, as above.
    for x, y in ((0, 0), (63, 20)):
        for t in (2.0, 10.0):
            eye, forward = one.ray(x, y)
            read_eye, read_forward = again.ray(x, y)
            moved = read_eye + (t - 2.0) * read_forward - (eye + t * forward)
            assert np.abs(moved).max() <= 64 * U * 30
    assert again.far == pytest.approx(8.0, rel=64 * U * 30)
    kept = decomposed(projection @ np.linalg.inv(pose), 64, 48, near=2.0, far=10.0, depth=depth)
    assert np.abs(Camera(kept[0], 64, 48, **kept[1]).forward - one.forward).max() <= 64 * U
    assert (kept[1]["near"], kept[1]["far"]) == (2.0, 10.0)
    # Of the eye, only how far it is before the near plane can be told.
    assert abs((kept[0][:3, 3] - one.eye) @ one.forward) <= 64 * U * 30


def matrix_of(**changes):
    one = camera(posed((0.1, -0.7, 0.3, 0.6, 5.0, 1.0, -20.0)), **changes)
    return clip_matrix(one, "OpenGL")[0]


def test_near_and_far_that_are_given_need_no_depth():
    matrix = matrix_of()
    matrix[2] = 0.0
    _, lens, _ = decomposed(matrix, 64, 48, near=3.0)
    assert (lens["near"], lens["far"]) == (3.0, math.inf)
    _, lens, _ = decomposed(matrix_of(), 64, 48, near=3.0, depth="-1..1")
    assert lens["near"] == 3.0
    assert lens["far"] == pytest.approx(800.0, rel=1e-9)


def tilted(matrix):
    """With an oblique near plane, as for mirrors: the depth row is a plane of the world's."""
    matrix[2] += 0.5 * matrix[0]
    return matrix


WRONG = {
    "no number": (matrix_of() * math.nan, {}, "not finite"),
    "all zeros": (np.zeros((4, 4)), {}, "singular"),
    "no last row": (np.vstack([matrix_of()[:3], np.zeros(4)]), {}, "singular"),
    "no first row": (matrix_of() * [[0], [1], [1], [1]], {}, "singular"),
    "two rows alike": (matrix_of()[[0, 0, 2, 3]], {}, "right angle"),
    "mirrored in x": (matrix_of() * [[-1], [1], [1], [1]], {}, "mirrored"),
    "y down": (matrix_of() * [[1], [-1], [1], [1]], {}, "mirrored"),
    "a left-handed world": (matrix_of() @ FLIP_Z, {}, "mirrored"),
    "negative": (-matrix_of(), {}, "mirrored"),
    "sheared": (matrix_of() + 0.01 * matrix_of()[[1, 1, 1, 1]] * [[1], [0], [0], [0]], {}, "right"),
    "wide pixels": (matrix_of(), {"width": 80}, "0.8 times as wide as high in 80 x 48"),
    "high pixels": (matrix_of(), {"height": 40}, "0.833333 times as wide"),
    "another depth": (matrix_of(), {"depth": "1..0"}, "near comes out as"),
    "no depth": (matrix_of(), {"depth": None}, "near plane is not known"),
    "oblique": (tilted(matrix_of()), {}, "near plane is tilted"),
    "orthographic, negative": (np.diag([1.0, 1.0, -1.0, -1.0]), {}, "negative"),
    "orthographic, flat": (np.diag([0.75, 1.0, 0.0, 1.0]), {}, "singular"),
    "orthographic, mirrored": (np.diag([0.75, 1.0, 1.0, 1.0]), {}, "mirrored"),
    "orthographic, no depth": (np.diag([0.75, 1.0, -1.0, 1.0]), {"depth": None}, "near plane"),
}


@pytest.mark.parametrize(("matrix", "changes", "expected"), WRONG.values(), ids=WRONG)
def test_what_is_no_camera_is_refused_with_its_reason(matrix, changes, expected):
    arguments = {"width": 64, "height": 48, "depth": "-1..1", **changes}
    with pytest.raises(InputError, match=expected):
        decomposed(np.asarray(matrix, np.float64), **arguments)


@pytest.mark.parametrize(("size", "refused"), [(0.9e-4, False), (1.1e-4, True)])
def test_shear_and_oblong_pixels_are_taken_up_to_the_bound_and_told(size, refused):
    lens = np.eye(4)
    lens[0, 1] = size * 48 / 64  # of the first row's scale, that of a wider image
    oblong = np.diag([1.0 + size, 1.0, 1.0, 1.0])
    for change in (lens, oblong):
        if refused:
            with pytest.raises(InputError):
                decomposed(change @ matrix_of(), 64, 48, depth="-1..1")
        else:
            pose, _, off = decomposed(change @ matrix_of(), 64, 48, depth="-1..1")
            # What was put in, but for its square.
            assert off == pytest.approx(size, rel=2e-4)
            assert np.abs(pose[:3, :3].T @ pose[:3, :3] - np.eye(3)).max() <= 16 * U
