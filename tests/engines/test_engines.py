"""The ray engines against closed forms, against brute force, and against each other."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.support.engine_kinds import engine_kind
from tests.support.truth_scenes import Part, box, brute_force, build, filled, quad, random_soup
from visref.camera import Camera, look_at
from visref.camera_path import CameraPath
from visref.engines import engine_names, make_engine
from visref.engines.base import TruthEngine
from visref.engines.embree import EmbreeEngine
from visref.engines.exact import ExactEngine
from visref.engines.open3d import Open3DEngine
from visref.errors import InputError
from visref.judging.referee import Referee
from visref.placing import origin_of
from visref.scene import Alpha, Scene
from visref.visibility import BACKGROUND, FrameTruth, objects_seen

Make = Callable[..., TruthEngine]


@pytest.fixture(params=["packets", "single rays", "open3d"])
def make(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Make:
    """An engine of each kind; "single rays" is Embree without its bundled library."""
    return engine_kind(request.param, monkeypatch)


def perspective(width: int = 32, height: int = 24, **rest: float) -> Camera:
    # tan(yfov / 2) is 1 to a rounding; the samples' steps are what they are, exactly.
    values: dict[str, float] = {"near": 0.5, "far": 64.0, "yfov": math.pi / 2, **rest}
    return Camera(np.eye(4), width, height, **values)


def orthographic(width: int = 32, height: int = 24, **rest: float) -> Camera:
    values: dict[str, float] = {"near": 0.5, "far": 64.0, "ymag": height / 2, **rest}
    return Camera(np.eye(4), width, height, **values)


CAMERAS = {"perspective": perspective, "orthographic": orthographic}
both_projections = pytest.mark.parametrize("camera_of", CAMERAS.values(), ids=CAMERAS)


def objects(truth: FrameTruth, scene: Scene) -> np.ndarray:
    """(height, width) object ids, BACKGROUND for none."""
    triangle = truth.buffer.triangle
    if not scene.triangle_count:
        return np.full(triangle.shape, BACKGROUND)
    return np.where(triangle >= 0, scene.object_of_triangle[triangle], BACKGROUND)


@both_projections
def test_a_quad_owns_exactly_the_pixels_that_it_fills_at_its_depth(
    make: Make, camera_of: Callable[..., Camera]
) -> None:
    camera = camera_of()
    scene = build(quad(camera, (5, 3, 20, 17), 4.0), quad(camera, (10, 10, 30, 24), 8.0))
    truth = make(scene).frame(camera)
    front, back = filled(camera, (5, 3, 20, 17)), filled(camera, (10, 10, 30, 24))
    expected = np.where(front, 0, np.where(back, 1, BACKGROUND))
    np.testing.assert_array_equal(objects(truth, scene), expected)
    np.testing.assert_array_equal(
        truth.buffer.depth, np.where(front, 4.0, np.where(back, 8.0, np.inf))
    )
    assert not len(truth.ties.sample)
    assert not truth.ties_complete


@both_projections
def test_hits_exactly_on_the_near_and_far_planes_count(
    make: Make, camera_of: Callable[..., Camera]
) -> None:
    camera = camera_of(near=2.0, far=16.0)
    scene = build(quad(camera, (0, 0, 16, 24), 2.0), quad(camera, (16, 0, 32, 24), 16.0))
    assert (objects(make(scene).frame(camera), scene) >= 0).all()


@both_projections
def test_hits_one_rounding_outside_the_range_do_not_count_and_hide_nothing(
    make: Make, camera_of: Callable[..., Camera]
) -> None:
    camera = camera_of(near=2.0, far=16.0)
    before = float(np.nextafter(np.float32(2.0), np.float32(0.0)))
    beyond = float(np.nextafter(np.float32(16.0), np.float32(99.0)))
    whole = (0, 0, 32, 24)
    scene = build(
        quad(camera, whole, 1.0),
        quad(camera, whole, before),
        quad(camera, (0, 0, 16, 24), 8.0),
        quad(camera, whole, beyond),
    )
    expected = np.where(filled(camera, (0, 0, 16, 24)), 2, BACKGROUND)
    np.testing.assert_array_equal(objects(make(scene).frame(camera), scene), expected)


def test_an_infinite_range_sees_very_far(make: Make) -> None:
    camera = perspective(far=math.inf)
    scene = build(quad(camera, (0, 0, 32, 24), 1e7), quad(camera, (0, 0, 4, 4), 2.0))
    truth = make(scene).frame(camera)
    expected = np.where(filled(camera, (0, 0, 4, 4)), 1, 0)
    np.testing.assert_array_equal(objects(truth, scene), expected)
    assert truth.buffer.depth[-1, -1] == pytest.approx(1e7, rel=1e-6)


def test_an_orthographic_range_may_begin_behind_the_eye(make: Make) -> None:
    camera = orthographic(near=-8.0)
    scene = build(quad(camera, (0, 0, 32, 24), 2.0), quad(camera, (3, 3, 9, 9), -8.0))
    truth = make(scene).frame(camera)
    expected = np.where(filled(camera, (3, 3, 9, 9)), 1, 0)
    np.testing.assert_array_equal(objects(truth, scene), expected)
    assert truth.buffer.depth[3, 3] == -8.0


def test_a_floor_that_crosses_the_near_plane_is_seen_from_near_to_far(make: Make) -> None:
    camera = perspective(height=32, near=2.0, far=16.0)
    floor = Part(
        np.array([[-99.0, -1, 99], [99, -1, 99], [99, -1, -99], [-99, -1, -99]]),
        np.array([[0, 1, 2], [0, 2, 3]]),
    )
    truth = make(build(floor)).frame(camera)
    with np.errstate(divide="ignore"):
        depth = -1.0 / (camera.row_b * camera.up_step[1])
    inside = (depth >= 2.0) & (depth <= 16.0)
    assert 0 < inside.sum() < 16
    expected = np.broadcast_to(np.where(inside, depth, np.inf)[:, None], (32, 32))
    np.testing.assert_allclose(truth.buffer.depth, expected, rtol=1e-14)


def test_the_eye_inside_an_object_sees_its_inside(make: Make) -> None:
    camera = perspective(near=0.25)
    half = np.array([3.0, 2.0, 5.0])
    scene = build(box((0.0, 0.0, 0.0), tuple(half)))
    truth = make(scene).frame(camera)
    direction = np.stack([camera.ray(x, y)[1] for y in range(24) for x in range(32)])
    with np.errstate(divide="ignore"):
        depth = (half / np.abs(direction)).min(axis=1).reshape(24, 32)
    np.testing.assert_allclose(truth.buffer.depth, depth, rtol=1e-14)


@both_projections
def test_a_lens_shift_by_whole_pixels_moves_the_picture(
    make: Make, camera_of: Callable[..., Camera]
) -> None:
    camera = camera_of()
    shifted = replace(camera, shift_x_px=3.0, shift_y_px=-2.0)
    scene = build(quad(camera, (5, 3, 20, 17), 4.0))
    engine = make(scene)
    still = engine.frame(camera).buffer.triangle.copy()
    moved = engine.frame(shifted).buffer.triangle
    np.testing.assert_array_equal(moved[2:, :-3], still[:-2, 3:])
    assert (moved >= 0).sum() == (still >= 0).sum()


@pytest.mark.parametrize(("width", "height"), [(1, 1), (1, 4096), (4096, 1), (641, 479)])
def test_any_viewport_works(make: Make, width: int, height: int) -> None:
    camera = perspective(width, height)
    part = (width // 3, height // 3, width - width // 4, height - height // 4)
    scene = build(quad(camera, part, 4.0))
    truth = make(scene).frame(camera)
    assert truth.buffer.triangle.shape == (height, width)
    np.testing.assert_array_equal(truth.buffer.triangle >= 0, filled(camera, part))


# Sides and alpha.


@both_projections
def test_a_one_sided_quad_seen_from_behind_neither_shows_nor_hides(
    make: Make, camera_of: Callable[..., Camera]
) -> None:
    camera = camera_of()
    scene = build(
        quad(camera, (0, 0, 20, 24), 2.0, turned=True, one_sided=True),
        quad(camera, (10, 0, 32, 24), 4.0, one_sided=True),
        quad(camera, (0, 0, 5, 24), 8.0),
    )
    expected = np.full((24, 32), BACKGROUND)
    expected[:, 10:], expected[:, :5] = 1, 2
    np.testing.assert_array_equal(objects(make(scene).frame(camera), scene), expected)


@both_projections
def test_of_two_coincident_one_sided_faces_the_one_that_faces_the_eye_is_seen(
    make: Make, camera_of: Callable[..., Camera]
) -> None:
    camera = camera_of()
    leaf = [quad(camera, (4, 4, 20, 20), 4.0, turned=t, one_sided=True) for t in (True, False)]
    for front, parts in ((1, leaf), (0, leaf[::-1])):
        scene = build(*parts, quad(camera, (0, 0, 32, 24), 8.0))
        expected = np.where(filled(camera, (4, 4, 20, 20)), front, 2)
        np.testing.assert_array_equal(objects(make(scene).frame(camera), scene), expected)


def test_a_one_sided_room_seen_from_inside_or_outside(make: Make) -> None:
    camera = perspective(near=0.25)
    room = replace(box((0.0, 0.0, 0.0), (3.0, 2.0, 5.0)), one_sided=True)
    outside = box((0.0, 0.0, -20.0), (29.0, 29.0, 1.0))
    scene = build(room, outside)
    engine = make(scene)
    assert (objects(engine.frame(camera), scene) == 1).all()
    from_afar = replace(camera, world_from_camera=look_at((0, 0, 30), (0, 0, 0)))
    assert (objects(engine.frame(from_afar), scene)[11:13, 15:17] == 0).all()


@both_projections
def test_every_blended_layer_before_the_opaque_hit_is_seen(
    make: Make, camera_of: Callable[..., Camera]
) -> None:
    camera = camera_of()
    scene = build(
        quad(camera, (0, 0, 16, 24), 8.0),
        quad(camera, (8, 8, 24, 16), 4.0, alpha=Alpha.BLEND),
        # Coincident with the layer before: a recast past that would lose this one.
        quad(camera, (8, 8, 24, 16), 4.0, alpha=Alpha.BLEND),
        quad(camera, (0, 0, 32, 24), 12.0, alpha=Alpha.BLEND),
        # Level with the opaque quad, so not before it; and behind it.
        quad(camera, (0, 0, 10, 10), 8.0, alpha=Alpha.BLEND),
        quad(camera, (0, 0, 10, 10), 9.0, alpha=Alpha.BLEND),
        quad(camera, (0, 0, 2, 2), 0.25, alpha=Alpha.BLEND),
        quad(camera, (0, 0, 2, 2), 2.0, alpha=Alpha.BLEND, turned=True, one_sided=True),
    )
    truth = make(scene).frame(camera)
    opaque = np.where(filled(camera, (0, 0, 16, 24)), 0, BACKGROUND)
    np.testing.assert_array_equal(objects(truth, scene), opaque)
    right = filled(camera, (16, 0, 32, 24))
    layers = {1: (filled(camera, (8, 8, 24, 16)), 4.0), 3: (right, 12.0)}
    layers[2] = layers[1]
    assert np.unique(truth.blend.object).tolist() == [1, 2, 3]
    for owner, (covered, depth) in layers.items():
        mine = truth.blend.object == owner
        # A sample on the diagonal of a quad is both its triangles'.
        assert np.unique(truth.blend.sample[mine]).tolist() == np.flatnonzero(covered).tolist()
        assert (truth.blend.depth[mine] == depth).all()
    owners = scene.object_of_triangle[truth.blend.triangle]
    assert owners.tolist() == truth.blend.object.tolist()
    seen = objects_seen(truth, scene)
    assert seen.samples.tolist() == [16 * 24, 128, 128, 16 * 24, 0, 0, 0, 0]


def test_a_blended_object_of_many_layers_counts_a_sample_once(make: Make) -> None:
    camera = perspective()
    glass = box((0.0, 0.0, -8.0), (2.0, 1.0, 2.0))
    scene = build(replace(glass, alpha=Alpha.BLEND))
    truth = make(scene).frame(camera)
    solid = make(build(glass)).frame(camera)
    covered = np.flatnonzero(solid.buffer.triangle >= 0)
    assert np.unique(truth.blend.sample).tolist() == covered.tolist()
    # Front and back are hits each.
    assert len(truth.blend.sample) >= 2 * len(covered)
    seen = objects_seen(truth, scene)
    assert seen.samples.tolist() == [len(covered)]
    assert seen.nearest[0] == solid.buffer.depth.min() == 6.0


@pytest.mark.slow
@pytest.mark.parametrize("alpha", [Alpha.MASK, Alpha.BLEND])
@both_projections
def test_what_float64_decides_alone_is_what_the_library_decides(
    make: Make, camera_of: Callable[..., Camera], alpha: Alpha
) -> None:
    # Planes that cross the near plane, the eye's own plane and the picture's borders.
    camera = camera_of(near=1.0, far=20.0)
    flat = np.array([[-99.0, -1, 99], [99, -1, 99], [99, -1.5, -99], [-99, -1.5, -99]])
    steep = flat + np.array([[0, 40, 0], [0, 40, 0], [0, -40, 0], [0, -40, 0]])
    total = 0
    for points in (flat, flat[:, [1, 0, 2]], -flat, steep, steep[:, [1, 0, 2]], -steep):
        floor = Part(points, np.array([[0, 1, 2], [0, 2, 3]]))
        expected = np.flatnonzero(make(build(floor)).frame(camera).buffer.triangle >= 0)
        truth = make(build(replace(floor, alpha=alpha))).frame(camera)
        total += len(expected)
        if alpha == Alpha.MASK:
            np.testing.assert_array_equal(truth.undecided, expected)
        else:
            np.testing.assert_array_equal(np.unique(truth.blend.sample), expected)
    assert total > 500


def test_a_sample_that_an_object_owns_is_not_counted_again_for_its_own_glass(make: Make) -> None:
    camera = perspective()
    frame, pane = quad(camera, (0, 0, 16, 24), 8.0), quad(camera, (8, 0, 24, 24), 4.0)
    both = build(Part(np.concatenate([frame.points, pane.points]), np.arange(6).reshape(2, 3)))
    faces = np.concatenate([frame.faces, pane.faces + 4])
    scene = Scene(
        both.vertices,
        faces.astype(np.int32),
        np.array([0, 4]),
        ("window",),
        alpha=np.array([0, 0, 2, 2], np.uint8),
    )
    truth = make(scene).frame(camera)
    assert objects_seen(truth, scene).samples.tolist() == [24 * 24]


@both_projections
def test_a_masked_quad_at_or_before_the_owner_leaves_its_samples_undecided(
    make: Make, camera_of: Callable[..., Camera]
) -> None:
    camera = camera_of()
    scene = build(
        quad(camera, (0, 0, 16, 24), 8.0),
        quad(camera, (8, 0, 20, 4), 4.0, alpha=Alpha.MASK),
        quad(camera, (0, 10, 4, 12), 8.0, alpha=Alpha.MASK),
        quad(camera, (8, 10, 12, 12), 9.0, alpha=Alpha.MASK),
        quad(camera, (8, 14, 12, 16), 4.0, alpha=Alpha.MASK, turned=True, one_sided=True),
        quad(camera, (0, 0, 32, 24), 2.0, alpha=Alpha.BLEND),
    )
    truth = make(scene).frame(camera)
    expected = filled(camera, (8, 0, 20, 4), (0, 10, 4, 12))
    np.testing.assert_array_equal(truth.undecided, np.flatnonzero(expected))
    opaque = np.where(filled(camera, (0, 0, 16, 24)), 0, BACKGROUND)
    np.testing.assert_array_equal(objects(truth, scene), opaque)
    doubted = scene.object_of_triangle[truth.doubt.triangle]
    assert set(zip(truth.doubt.at().tolist(), doubted.tolist(), strict=True)) == {
        *((s, 1) for s in np.flatnonzero(filled(camera, (8, 0, 20, 4)))),
        *((s, 2) for s in np.flatnonzero(filled(camera, (0, 10, 4, 12)))),
    }
    # Glass before all of it is seen, whatever the mask says.
    assert np.unique(truth.blend.object).tolist() == [5]
    assert np.unique(truth.blend.sample).tolist() == list(range(32 * 24))


@both_projections
def test_glass_is_seen_for_certain_only_before_all_that_a_mask_leaves_open(
    make: Make, camera_of: Callable[..., Camera]
) -> None:
    camera = camera_of()
    whole = (0, 0, 32, 24)
    scene = build(
        quad(camera, whole, 8.0),
        quad(camera, (0, 0, 16, 24), 4.0, alpha=Alpha.MASK),
        quad(camera, (0, 0, 8, 24), 3.0, alpha=Alpha.MASK),
        quad(camera, whole, 6.0, alpha=Alpha.BLEND),
        # Level with the leaf: not before it.
        quad(camera, whole, 4.0, alpha=Alpha.BLEND),
        quad(camera, whole, 2.0, alpha=Alpha.BLEND),
    )
    truth = make(scene).frame(camera)
    seen = {o: np.unique(truth.blend.sample[truth.blend.object == o]) for o in (3, 4, 5)}
    right = np.flatnonzero(filled(camera, (16, 0, 32, 24)))
    np.testing.assert_array_equal(seen[3], right)
    np.testing.assert_array_equal(seen[4], right)
    np.testing.assert_array_equal(seen[5], np.arange(32 * 24))
    # Front to back.
    at, depth = truth.doubt.at(), {1: 4.0, 2: 3.0}
    depths = [depth[o] for o in scene.object_of_triangle[truth.doubt.triangle]]
    assert np.array_equal(np.lexsort((depths, at)), np.arange(len(at)))
    assert sorted(set(depths)) == [3.0, 4.0]


# Scenes without much in them, and with very much.


def test_an_empty_scene_and_empty_objects_are_background(make: Make) -> None:
    camera = perspective()
    nothing = Scene.from_objects([])
    hollow = Scene.from_objects([("hollow", np.zeros((0, 3)), np.zeros((0, 3)))])
    for scene in (nothing, hollow):
        truth = make(scene).frame(camera)
        assert (truth.buffer.triangle == BACKGROUND).all()
        assert np.isinf(truth.buffer.depth).all()
    full = quad(camera, (0, 0, 32, 24), 4.0)
    empty = Part(np.zeros((0, 3)), np.zeros((0, 3), np.int64))
    scene = build(empty, full, empty)
    seen = objects_seen(make(scene).frame(camera), scene)
    assert seen.samples.tolist() == [0, 32 * 24, 0]


def test_degenerate_and_edge_on_triangles_cover_nothing_and_hide_nothing(make: Make) -> None:
    camera = orthographic()
    edge_on = Part(np.array([[-9.0, 0.5, -2], [9, 0.5, -2], [0, 0.5, -9]]), np.array([[0, 1, 2]]))
    point = Part(np.full((3, 3), -1.5), np.array([[0, 1, 2]]))
    needle = Part(np.array([[-9.0, 0.5, -2], [9, 0.5, -2], [0, 0.5, -2]]), np.array([[0, 1, 2]]))
    scene = build(edge_on, point, needle, quad(camera, (0, 0, 32, 24), 8.0))
    assert (objects(make(scene).frame(camera), scene) == 3).all()


@pytest.mark.slow
def test_forty_thousand_objects_of_one_triangle_own_a_pixel_each(make: Make) -> None:
    side = 200
    camera = orthographic(side, side)
    x, y = (grid.ravel() for grid in np.meshgrid(np.arange(side), np.arange(side)))
    centre = np.stack([2.0 * x + 1 - side, side - 2.0 * y - 1, np.full(side**2, -8.0)], axis=1) / 2
    corners = np.array([[-0.4, -0.3, 0], [0.4, -0.3, 0], [0, 0.4, 0]])
    points = (centre[:, None] + corners).reshape(-1, 3)
    scene = Scene(
        points.astype(np.float32),
        np.arange(3 * side**2, dtype=np.int32).reshape(-1, 3),
        np.arange(side**2 + 1),
        tuple(f"object {i}" for i in range(side**2)),
    )
    truth = make(scene).frame(camera)
    np.testing.assert_array_equal(truth.buffer.triangle.ravel(), np.arange(side**2))


@pytest.mark.slow
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e4])
@pytest.mark.parametrize("offset", [0.0, 0.37, 1 / 3])
def test_nothing_shows_through_a_tessellated_wall(make: Make, scale: float, offset: float) -> None:
    rng = np.random.default_rng(5)
    camera = perspective(160, 120, near=1e-2 * scale, far=math.inf)
    line = np.linspace(-12.0, 12.0, 60)
    points = np.stack([*np.meshgrid(line, line), np.zeros((60, 60))], axis=-1) + offset
    points[..., 2] = -6.0 + rng.uniform(-0.2, 0.2, (60, 60))
    i = np.add.outer(np.arange(59) * 60, np.arange(59)).ravel()[:, None]
    faces = np.concatenate([i + np.array([0, 1, 61]), i + np.array([0, 61, 60])])
    wall = Part(points.reshape(-1, 3) * scale, faces)
    scene = build(wall, quad(camera, (0, 0, 160, 120), 20.0 * scale))
    assert (objects(make(scene).frame(camera), scene) == 0).all()


@both_projections
def test_a_wall_whose_vertices_lie_on_the_samples_has_no_hole(
    make: Make, camera_of: Callable[..., Camera]
) -> None:
    camera = camera_of(height=32)
    # One vertex a sample, so that every sample is a vertex of up to six triangles.
    spread = 4.0 if camera.is_perspective else 1.0
    a, b = (grid.ravel()[:, None] for grid in np.meshgrid(camera.column_a, camera.row_b))
    side = a * camera.right_step + b * camera.up_step
    i = np.add.outer(np.arange(31) * 32, np.arange(31)).ravel()[:, None]
    faces = np.concatenate([i + np.array([0, 1, 33]), i + np.array([0, 33, 32])])
    wall = Part(4.0 * camera.forward + spread * side, faces)
    scene = build(wall, quad(camera, (0, 0, 32, 32), 8.0))
    found = objects(make(scene).frame(camera), scene)
    assert (found[1:-1, 1:-1] == 0).all()


# Against brute force, and against each other.


def view(seed: int, width: int = 48, height: int = 36) -> Camera:
    rng = np.random.default_rng(seed)
    pose = look_at(rng.uniform(-1, 1, 3), rng.uniform((-1, -1, -6), (1, 1, -4)))
    shift = dict(zip(("shift_x_px", "shift_y_px"), rng.uniform(-2, 2, 2), strict=True))
    if seed % 3:
        return Camera(pose, width, height, 0.5, 9.0, yfov=1.2, **shift)
    return Camera(pose, width, height, -1.0, 9.0, ymag=3.0, **shift)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(8))
def test_owners_are_those_of_brute_force_save_where_float32_cannot_tell(
    make: Make, seed: int
) -> None:
    scene, camera = random_soup(seed), view(seed)
    truth = make(scene).frame(camera)
    reference = brute_force(scene, camera)
    wrong = truth.buffer.triangle != reference.owner
    assert not (wrong & ~reference.doubtful).any()
    # The excuse is rare, and the scene is no easy one.
    assert reference.doubtful.mean() < 0.02
    assert wrong.sum() <= 1
    assert len(np.unique(reference.owner)) > 10


def test_the_comparison_with_brute_force_can_fail() -> None:
    camera = view(1)
    truth = EmbreeEngine(random_soup(1)).frame(camera)
    other = brute_force(random_soup(2), camera)
    assert ((truth.buffer.triangle != other.owner) & ~other.doubtful).any()


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_embree_and_open3d_agree_on_random_scenes(seed: int) -> None:
    pytest.importorskip("open3d")
    scene, camera = random_soup(100 + seed, triangles=3000), view(seed, 320, 240)
    first = EmbreeEngine(scene).frame(camera)
    second = Open3DEngine(scene).frame(camera)
    differ = first.buffer.triangle != second.buffer.triangle
    # Crossing and touching surfaces within float32's rounding, a few in 76,800 samples.
    assert differ.sum() <= 8
    depths = first.buffer.depth, second.buffer.depth
    np.testing.assert_array_equal(depths[0][~differ], depths[1][~differ])


# Far out.

# Multiples of the scenes' size, as powers of two: coordinates stay exact in float32.
FAR = [2.0**17, 2.0**20, 2.0**23]


def on_a_grid(scene: Scene, step: float) -> Scene:
    return replace(scene, vertices=np.rint(scene.vertices / step).astype(np.float32) * step)


@pytest.mark.parametrize("distance", FAR)
def test_a_scene_far_from_the_origin_has_the_owners_of_the_same_scene_at_the_origin(
    make: Make, distance: float
) -> None:
    # At 2^23 float32 holds whole numbers only, so the scene is large enough for that.
    scale = distance * 2.0**-13
    near_by = random_soup(3, triangles=300)
    scene = on_a_grid(replace(near_by, vertices=near_by.vertices * scale), scale * 2.0**-10)
    shift = np.array([distance, -distance, distance])
    moved = replace(scene, vertices=(scene.vertices + shift).astype(np.float32))
    np.testing.assert_array_equal(moved.vertices - shift, scene.vertices)
    camera = Camera(np.eye(4), 160, 120, 0.25 * scale, yfov=1.0)
    pose = np.eye(4)
    pose[:3, 3] = shift
    engine = make(moved)
    assert engine.rebase_exact
    assert np.abs(engine.rebase - shift).max() <= 16.0 * scale
    at_origin = make(scene).frame(camera).buffer
    far_out = engine.frame(replace(camera, world_from_camera=pose)).buffer
    differ = at_origin.triangle != far_out.triangle
    assert differ.sum() <= 2
    np.testing.assert_array_equal(at_origin.depth[~differ], far_out.depth[~differ])


def test_an_eye_far_from_the_scene_sees_it_undistorted(make: Make) -> None:
    scene = random_soup(4)
    pose = look_at((3e6, 1e6, 2e6), (0.0, 0.0, -4.0))
    camera = Camera(pose, 48, 36, 1.0, yfov=3e-6)
    reference = brute_force(scene, camera)
    truth = make(scene).frame(camera)
    assert len(np.unique(reference.owner)) > 10
    assert not ((truth.buffer.triangle != reference.owner) & ~reference.doubtful).any()


def test_a_scene_about_the_origin_is_not_moved() -> None:
    assert origin_of(random_soup(1).object_bounds).tolist() == [0.0, 0.0, 0.0]


def test_a_translation_that_rounds_a_vertex_is_reported() -> None:
    scene = random_soup(3)
    moved = [
        ("far", scene.vertices + np.array([1e6, 0, 0], np.float32), scene.triangles),
        ("stray", np.array([[0.1, 0, 0], [0.2, 0, 0], [0.1, 0.1, 0]]), [[0, 1, 2]]),
    ]
    objects_ = [(n, v, t) for n, v, t in moved]
    assert EmbreeEngine(Scene.from_objects(objects_[:1])).rebase_exact
    many = [(f"far {i}", v, t) for i in range(20) for _, v, t in objects_[:1]]
    engine = EmbreeEngine(Scene.from_objects([*many, objects_[1]]))
    assert engine.rebase[0] == pytest.approx(1e6, rel=1e-3)
    assert not engine.rebase_exact


# Determinism, reuse, registry.


def mixed_scene() -> Scene:
    """Everything at once: duplicates, one-sided, masked and blended triangles."""
    soup = random_soup(9, triangles=600)
    rng = np.random.default_rng(9)
    return Scene(
        np.concatenate([soup.vertices] * 2),
        np.concatenate([soup.triangles, soup.triangles + len(soup.vertices)]),
        np.concatenate([soup.object_offsets, 600 + soup.object_offsets[1:]]),
        tuple(f"object {i}" for i in range(400)),
        one_sided=rng.random(1200) < 0.5,
        alpha=rng.choice(np.array([0, 0, 0, 1, 2], np.uint8), 1200),
    )


def contents(truth: FrameTruth) -> list[bytes]:
    arrays = [truth.buffer.triangle, truth.buffer.depth]
    arrays += [getattr(truth.doubt, n) for n in ("sample", "offsets", "triangle")]
    arrays += [getattr(truth.blend, n) for n in ("object", "sample", "triangle", "depth")]
    return [array.tobytes() for array in arrays]


@pytest.mark.slow
def test_any_number_of_threads_gives_the_same_bytes(make: Make) -> None:
    scene, camera = mixed_scene(), view(4, 320, 240)
    one, two, five = (contents(make(scene, threads=n).frame(camera)) for n in (1, 2, 5))
    assert one == two == five
    assert all(len(part) for part in one)


@pytest.mark.slow
def test_a_frame_does_not_depend_on_the_frames_before_it(make: Make) -> None:
    scene = mixed_scene()
    engine = make(scene)
    small = engine.frame(view(1)).copy()
    large = engine.frame(view(2, 320, 240))
    assert large.buffer.triangle.shape == (240, 320)
    assert contents(engine.frame(view(1))) == contents(small)
    engine.close()


def test_samples_out_of_the_librarys_reach_are_decided_like_the_rest(
    make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    # One-sided triangles send samples to the float64 path; two-sided, the library decides.
    scene, camera = random_soup(12, triangles=300), view(4, 160, 120)
    facing = scene.vertices[scene.triangles].astype(float) - camera.eye
    normal = np.cross(facing[:, 1] - facing[:, 0], facing[:, 2] - facing[:, 0])
    behind = np.einsum("ij,ij->i", normal, facing[:, 0]) > 0.0
    kept = np.flatnonzero(~behind)
    only_facing = Scene(
        scene.vertices, scene.triangles[kept], np.array([0, len(kept)]), ("all that face",)
    )
    one_sided = replace(scene, one_sided=np.ones(scene.triangle_count, np.bool_))
    expected = make(only_facing).frame(camera).buffer
    found = make(one_sided).frame(camera).buffer
    owners = np.where(expected.triangle >= 0, kept[expected.triangle], BACKGROUND)
    differ = found.triangle != owners
    assert differ.sum() <= 2
    np.testing.assert_array_equal(found.depth[~differ], expected.depth[~differ])


def test_engines_are_found_by_name() -> None:
    assert {"embree", "open3d"} <= set(engine_names())
    engine = make_engine("embree", random_soup(1), threads=1)
    assert isinstance(engine, EmbreeEngine)
    with pytest.raises(InputError, match="no engine is named 'embre'"):
        make_engine("embre", random_soup(1))
    with pytest.raises(InputError, match=r"known are .*embree.*open3d"):
        make_engine("xyz", random_soup(1))
    with pytest.raises(InputError, match="threads is 0"):
        make_engine("embree", random_soup(1), threads=0)


def test_without_open3d_the_message_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "open3d", None)
    with pytest.raises(InputError, match=r"visref\[open3d\]"):
        Open3DEngine(random_soup(1))


def test_an_engine_is_exact_by_its_own_word_whatever_its_name():
    """A plug-in engine that is exact has no blind spots, live or from its own truth file."""

    class Mine(ExactEngine):
        name = "mine"

    class Rays(ExactEngine):
        name = "rays"
        exact = False

    scene = random_soup(1)
    path = CameraPath((Camera(look_at((0, 0, 9), (0, 0, 0)), 8, 6, near=0.1, yfov=1.0),))
    for engine, blind in ((Mine, False), (Rays, True), (ExactEngine, False)):
        outcome = Referee(scene, lambda made=engine: made(scene)).run(path, [0], [])
        codes = {finding.code for finding in outcome.findings}
        assert ("ENGINE_BLIND_SPOTS" in codes) == blind
