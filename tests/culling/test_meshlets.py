"""Meshlets, their backface cones, and the culler that decides about them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.support.culling_scenes import drawn_by
from visref.camera import Camera, look_at
from visref.errors import InputError
from visref.registry import make_culler
from visref.scene import Alpha, Scene, Units
from visref_culling.boxes.commands import view_bytes
from visref_culling.gl.device import device, shader_source
from visref_culling.gl.view import View
from visref_culling.hzb.cones import AXIS, CENTRE, COSINE, NONE, REACH, SINE, cones_of
from visref_culling.hzb.meshlets import meshlets_of

Mesh = tuple[np.ndarray, np.ndarray]


def patch(side: int, heights: np.ndarray) -> Mesh:
    """A square of (side - 1) ** 2 squares with these heights, (side ** 2,), that faces +Z."""
    y, x = np.divmod(np.arange(side * side), side)
    at = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).reshape(-1)
    faces = [[at, at + 1, at + side + 1], [at, at + side + 1, at + side]]
    return np.column_stack([x, y, heights]), np.concatenate([np.stack(f, axis=1) for f in faces])


def flat(side: int) -> Mesh:
    return patch(side, np.zeros(side * side))


def scene_of(meshes: list[Mesh], *, one_sided: bool = True) -> Scene:
    scene = Scene.from_objects([("mesh", *mesh) for mesh in meshes])
    return replace(scene, one_sided=np.full(scene.triangle_count, one_sided))


def random_scene(seed: int) -> Scene:
    """Objects of all sizes, one of them empty, with vertices shared and repeated."""
    rng = np.random.default_rng(seed)
    meshes = [flat(int(rng.integers(2, 40))), (np.zeros((0, 3)), np.zeros((0, 3), int))]
    for _ in range(6):
        count = int(rng.integers(3, 400))
        meshes.append(
            (rng.normal(size=(count, 3)), rng.integers(0, count, (int(rng.integers(1, 900)), 3)))
        )
    scene = scene_of(meshes)
    return replace(scene, one_sided=rng.random(scene.triangle_count) < 0.7)


def assert_limits(scene: Scene, units: Units) -> None:
    assert sorted(units.triangles.tolist()) == list(range(scene.triangle_count))
    for unit in range(units.count):
        members = units.triangles[units.offsets[unit] : units.offsets[unit + 1]]
        assert 0 < len(members) <= 124
        assert len(np.unique(scene.triangles[members])) <= 64
        assert len(np.unique(scene.object_of_triangle[members])) == 1
        assert len(np.unique(scene.one_sided[members])) == 1


@pytest.mark.parametrize("seed", range(8))
def test_meshlets_are_full_at_most_and_hold_each_triangle_once_and_one_object(seed):
    scene = random_scene(seed)
    units = meshlets_of(scene)
    assert_limits(scene, units)
    again = meshlets_of(scene)
    assert units.offsets.tobytes() == again.offsets.tobytes()
    assert units.triangles.tobytes() == again.triangles.tobytes()


def test_what_is_absent_at_first_is_within_the_limits_once_it_appears():
    scene = random_scene(3)
    assert scene.object_count > 4
    gone = replace(scene, absent=np.arange(scene.object_count) % 2 == 0)
    assert_limits(scene, meshlets_of(gone))


def test_a_meshlet_ends_where_its_triangles_or_vertices_are_full():
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    same = (corners, np.tile([[0, 1, 2]], (300, 1)))
    apart = (np.tile(corners, (50, 1)), np.arange(150).reshape(-1, 3))
    assert meshlets_of(scene_of([same, apart])).sizes.tolist() == [124, 124, 52, 21, 21, 8]


def test_a_scene_without_triangles_has_no_meshlets():
    assert meshlets_of(scene_of([])).count == 0


# Cones.


def cones(scene: Scene) -> np.ndarray:
    return cones_of(scene, scene.object_units())


def test_a_roofs_cone_holds_both_sides_and_no_more():
    rise = math.tan(math.radians(30.0))
    points = np.array([[-1.0, 0, 0], [0, 0, rise], [1, 0, 0], [-1, 1, 0], [0, 1, rise], [1, 1, 0]])
    roof = points, np.array([[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]])
    (cone,) = cones(scene_of([roof]))
    np.testing.assert_allclose(cone[AXIS : AXIS + 3], [0, 0, 1], atol=1e-6)
    np.testing.assert_allclose(cone[COSINE], math.cos(math.radians(30.0)), atol=1e-6)
    np.testing.assert_allclose(cone[SINE], 0.5, atol=1e-6)
    # Its planes pass before the centre where the centre is below the ridge.
    np.testing.assert_allclose(cone[CENTRE : CENTRE + 3], [0, 0.5, rise / 2], atol=1e-6)
    assert cone[REACH] <= 0.0


def test_what_has_two_sides_or_a_mask_or_no_area_or_faces_everywhere_has_no_cone():
    square = flat(2)
    line = np.vstack([square[0], [0.5, 0.0, 0.0]]), np.vstack([square[1], [0, 1, 4]])
    shell = square[0], np.vstack([square[1], square[1][:, ::-1]])
    scene = scene_of([square, square, square, square, line, shell])
    sided, alpha = scene.one_sided.copy(), scene.alpha.copy()
    sided[3], alpha[5], alpha[7] = False, Alpha.MASK, Alpha.BLEND
    found = cones(replace(scene, one_sided=sided, alpha=alpha))[:, REACH]
    assert (found == NONE).tolist() == [False, True, True, True, True, True]


AWAY = """#version 450
layout(local_size_x = 64) in;
%s
%s
layout(std430, binding = 9) buffer Found { uint found[]; };
void main() {
    if (gl_GlobalInvocationID.x < units) {
        found[gl_GlobalInvocationID.x] = uint(faces_away(gl_GlobalInvocationID.x));
    }
}
"""


def facing_away(scene: Scene, cones: np.ndarray, cameras: list[Camera]) -> np.ndarray:
    """(c, u) bool: what the shader says of each cone, seen by each camera."""
    context, result = device().context, []
    shader = context.compute_shader(
        AWAY % (shader_source("box_commands.glsl"), shader_source("cones.glsl"))
    )
    shader["units"] = len(cones)
    given, found = context.buffer(cones.tobytes()), context.buffer(reserve=4 * len(cones))
    for camera in cameras:
        view = context.buffer(view_bytes(View.of(camera, scene, 8), 1))
        for binding, buffer in ((7, view), (8, given), (9, found)):
            buffer.bind_to_storage_buffer(binding)
        shader.run(-(-len(cones) // 64))
        context.memory_barrier()
        result.append(np.frombuffer(found.read(), np.uint32) != 0)
        view.release()
    for one in (given, found, shader):
        one.release()
    return np.array(result)


def from_there(eye: np.ndarray, **lens: float) -> Camera:
    """A camera at an eye, (3,), that looks at the origin, or down where it stands there."""
    eye = np.asarray(eye, np.float64)
    target = np.zeros(3) if eye.any() else np.array([0.0, 0.0, -1.0])
    pose = look_at(eye, target, up=(0.1, 1.0, 0.2))
    return Camera(pose, 32, 24, near=0.01, far=1e4, **(lens or {"yfov": 1.0}))


@pytest.mark.gl
def test_a_flat_grid_is_left_out_from_behind_and_from_nowhere_else():
    points, faces = flat(8)
    tilt = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, -2.0], [0.0, 0.0, 1.0]])
    points = points @ tilt  # float32 holds it; z = x / 2 - 2 y
    normal = np.array([-0.5, 2.0, 1.0])
    scene = scene_of([(points, faces)])
    rng = np.random.default_rng(1)
    for _ in range(20):
        near = points[rng.integers(len(points))] + rng.uniform(-9.0, 9.0) * np.array([2, 0, 1])
        eyes = [near + side * away * normal for away in (1e-9, 0.1, 30) for side in (-1, 1)]
        found = facing_away(scene, cones(scene), [from_there(eye) for eye in eyes])
        assert found[:, 0].tolist() == [True, False] * 3


def bumpy(seed: int) -> list[Mesh]:
    """Patches in whole numbers that face all ways, from flat ones to hemispheres and spikes."""
    rng = np.random.default_rng(seed)
    meshes = []
    for number in range(60):
        side = int(rng.integers(2, 8))
        points, faces = patch(side, rng.integers(-1, 2, side * side) * (number % 4))
        if number % 5 == 0:
            dome = 2 * side * side - ((points[:, :2] - side // 2) ** 2).sum(axis=1)
            points[:, 2] = dome // 3
        points[:, :2] *= rng.integers(1, 6)
        axes, signs = rng.permutation(3), rng.choice([-1, 1], 3)
        points = points[:, axes] * signs + rng.integers(-20, 20, 3)
        if rng.random() < 0.5:
            faces = faces[:, ::-1]
        meshes.append((points, faces))
    return meshes


def fronts(scene: Scene, eye: np.ndarray, toward: np.ndarray | None) -> np.ndarray:
    """(n,) bool: the objects with a triangle that shows its front, in whole numbers: exactly."""
    points = scene.vertices.astype(np.int64)[scene.triangles]
    normal = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    sight = points[:, 0] - eye if toward is None else np.broadcast_to(toward, normal.shape)
    front = (normal * sight).sum(axis=1) < 0
    return np.logical_or.reduceat(front, scene.object_offsets[:-1])


@pytest.mark.gl
@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_no_cone_leaves_out_what_shows_a_front(seed, orthographic):
    scene = scene_of(bumpy(seed))
    rng = np.random.default_rng(seed)
    eyes = rng.integers(-40, 40, (40, 3))
    if orthographic:
        # Along the axes, so that the direction is one of whole numbers.
        eyes = np.concatenate([50 * np.eye(3, dtype=int), -50 * np.eye(3, dtype=int)])
        cameras = [Camera(axis_pose(eye), 32, 24, near=0.01, far=1e4, ymag=20.0) for eye in eyes]
    else:
        cameras = [from_there(eye) for eye in eyes]
    towards = [camera.forward.astype(np.int64) if orthographic else None for camera in cameras]
    shown = np.array([fronts(scene, *one) for one in zip(eyes, towards, strict=True)])
    right = cones(scene)
    away = facing_away(scene, right, cameras)
    assert not (away & shown).any()
    # Of those that could be left out not few are.
    assert away.sum() > 0.3 * (~shown).sum() > 20
    # That brute force sees what a cone must not be: narrower, or of planes through its centre.
    narrow, through = right.copy(), right.copy()
    narrow[:, SINE], narrow[:, COSINE] = 0.0, 1.0
    through[:, REACH] = np.minimum(0.0, 1e9 * np.maximum(0.0, right[:, REACH]))
    through[right[:, REACH] > 0.0, REACH] = NONE
    assert (facing_away(scene, narrow, cameras) & shown).any()
    if not orthographic:
        assert (facing_away(scene, through, cameras) & shown).any()


def axis_pose(eye: np.ndarray) -> np.ndarray:
    """A pose at an eye on an axis that looks at the origin, of whole numbers."""
    back = np.sign(eye)
    up = np.roll(np.abs(back), 1)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([np.cross(up, back), up, back], axis=1)
    pose[:3, 3] = eye
    return pose


# The culler.


@pytest.mark.gl
@pytest.mark.parametrize("linear", [np.diag([4.0, 1, 0.25]), np.diag([-1.0, 1, 1])])
def test_cones_of_what_moves_are_those_of_a_scene_that_stands_so(linear):
    scene = scene_of([patch(6, np.arange(36) % 3), flat(4)])
    turn = np.array([[0.6, 0.8, 0], [-0.8, 0.6, 0], [0, 0, 1]])
    first = slice(*scene.object_offsets[:2])
    vertices, triangles = scene.vertices.copy(), scene.triangles.copy()
    vertices[:36] = vertices[:36] @ (turn @ linear)
    if np.linalg.det(linear) < 0.0:
        triangles[first] = triangles[first, ::-1]
    now = replace(scene, vertices=vertices, triangles=triangles)
    culler = make_culler("two-pass-hzb:units=meshlets")
    try:
        units = culler.prepare(scene)
        before = culler.cones
        culler.update(now)
        wanted = cones_of(now, units)
        assert (culler.cones == wanted).all()
        on_gpu = np.frombuffer(culler.gpu.blocks[8].read(), np.float64).reshape(wanted.shape)
        assert (on_gpu == wanted).all()
        assert (before != wanted).any()
    finally:
        culler.close()


@pytest.mark.gl
@pytest.mark.parametrize("first", ["set", "pyramid"])
def test_meshlets_behind_others_or_that_face_away_are_not_drawn(first):
    wall, away = flat(4), flat(3)
    away = away[0] + [10.0, 0.0, 0.0], away[1][:, ::-1]
    hidden = flat(2)[0] * 0.2 + [1.4, 1.4, -1.0], flat(2)[1]
    scene = scene_of([wall, away, hidden])
    camera = Camera(look_at((4.0, 1.5, 9.0), (4.0, 1.5, 0.0)), 64, 48, near=0.1, far=100, yfov=1.2)
    spec = f"two-pass-hzb:units=meshlets,first={first}"
    assert drawn_by(spec, [camera] * 3, scene)[2] == [0]
    assert drawn_by(spec + ",cones=false", [camera] * 3, scene)[2] == [0, 1]


@pytest.mark.gl
def test_cullers_with_cones_and_without_work_side_by_side():
    faces = flat(3)[1]
    scene = scene_of([flat(3), (flat(3)[0] + [3.0, 0.0, 0.0], faces[:, ::-1])])
    camera = Camera(look_at((2.5, 1.0, 9.0), (2.5, 1.0, 0.0)), 64, 48, near=0.1, far=100, yfov=1.2)
    specs = ["two-pass-hzb:units=meshlets", "two-pass-hzb:units=meshlets,cones=false"]
    cullers = [make_culler(spec) for spec in [*specs, "two-pass-hzb"]]
    for culler in cullers:
        culler.prepare(scene)
    try:
        for _ in range(2):
            found = [sorted(culler.cull(camera).unit_ids.tolist()) for culler in cullers]
            assert found == [[0], [0, 1], [0, 1]]
    finally:
        for culler in cullers:
            culler.close()


def test_objects_have_no_cones_to_leave_out():
    with pytest.raises(InputError, match="meshlets"):
        make_culler("two-pass-hzb:cones=false")
