"""Margins are true lower bounds, and a surviving witness survives every displacement."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.support.exact_scenes import HALF, pose, rotation
from visref.camera import Camera
from visref.culler import RasterTolerance
from visref.exact import REACH_PX, ExactScene, surviving, witness_margins
from visref.scene import Alpha, Scene

SIDE = 16
Soup = tuple[np.ndarray, np.ndarray]


def orthographic(*, near: float = 0.5, far: float = 100.0) -> Camera:
    """A pixel is one unit; sample (x, y) stands at the point (x - 7.5, 7.5 - y)."""
    return Camera(pose(np.eye(3), np.zeros(3)), SIDE, SIDE, near, far, ymag=SIDE / 2)


def sample_at(x: float, y: float) -> int:
    return int(7.5 - y) * SIDE + int(x + 7.5)


def quad(x0: float, y0: float, x1: float, y1: float, z: float) -> Soup:
    corners = np.array([[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]])
    return corners, np.array([[0, 1, 2], [0, 2, 3]])


def scene_of(*objects: Soup) -> Scene:
    return Scene.from_objects([(f"o{i}", v, f) for i, (v, f) in enumerate(objects)])


def margins(
    scene: Scene, camera: Camera, sample: int, owner: int = 0, **how: Any
) -> tuple[float, float]:
    px, depth = witness_margins(
        ExactScene(scene, threads=1), camera, np.array([sample]), np.array([owner]), **how
    )
    return float(px[0]), float(depth[0])


def survives(
    scene: Scene, camera: Camera, sample: int, snap_px: float, owner: int = 0, bits: int | None = 24
) -> bool:
    result = surviving(
        ExactScene(scene, threads=1), camera, np.array([sample]), np.array([owner]),
        RasterTolerance(snap_px, bits),
    )  # fmt: skip
    return bool(result[0])


# Of the projected corners, in pixels: see filters.PIXEL_SLACK, twice.
CLOSE = 4e-6


def test_margin_is_the_distance_to_the_rim() -> None:
    scene = scene_of(quad(-0.25, -3, 3, 3, -10))
    px, depth = margins(scene, orthographic(), sample_at(0.5, 0.5))
    assert px == pytest.approx(0.75, abs=CLOSE)
    assert px <= 0.75
    assert depth == math.inf


def test_margin_ignores_inner_edges_and_ends_at_the_reach() -> None:
    # The diagonal runs through the sample; the rim is 2.5 away, beyond a reach of 1.
    scene, sample = scene_of(quad(-3, -3, 3, 3, -10)), sample_at(0.5, 0.5)
    assert margins(scene, orthographic(), sample)[0] == pytest.approx(2.5, abs=CLOSE)
    assert margins(scene, orthographic(), sample, reach_px=1.0)[0] == 1.0
    # Nor does it end with the image: of a plane without end it is what is asked for.
    endless = scene_of(quad(-90, -90, 90, 90, -10))
    for reach in (2.0, REACH_PX):
        assert margins(endless, orthographic(), sample_at(-7.5, 7.5), reach_px=reach)[0] == reach


@pytest.mark.parametrize("perspective", [False, True])
@pytest.mark.parametrize("half_gap", [0.25, 1.75, 5.5, 11.25])
def test_margin_in_a_gap_is_the_way_to_its_edge(half_gap: float, perspective: bool) -> None:
    # Two halves of a fence at half the depth of the wall behind, in perspective half as wide.
    at = 0.5 if perspective else 1.0
    left = quad((-99 + 0.5 - half_gap) * at, -50, (0.5 - half_gap) * at, 50, -8)
    right = quad((0.5 + half_gap) * at, -50, 99 * at, 50, -8)
    scene = scene_of(quad(-99, -99, 99, 99, -16), left, right)
    camera = orthographic()
    if perspective:
        # A pixel is one unit wide at depth 16.
        camera = Camera(pose(np.eye(3), np.zeros(3)), SIDE, SIDE, 0.5, 99.0, yfov=HALF)
    found = margins(scene, camera, sample_at(0.5, 0.5))[0]
    assert found == pytest.approx(half_gap, abs=CLOSE)
    assert found <= half_gap


def test_margin_ends_where_the_surface_leaves_the_range() -> None:
    # z = -10 - x: it passes a far plane at 12.5 two pixels to the right of the sample.
    slope = np.array([[-7, -9, -3], [9, -9, -19], [9, 9, -19], [-7, 9, -3.0]])
    scene = scene_of((slope, np.array([[0, 1, 2], [0, 2, 3]])))
    sample = sample_at(0.5, 0.5)
    assert margins(scene, orthographic(far=12.5), sample)[0] == pytest.approx(2.0, abs=1e-5)
    assert margins(scene, orthographic(), sample)[0] == pytest.approx(7.5, abs=1e-5)


@pytest.mark.parametrize("perspective", [False, True])
@pytest.mark.parametrize(("plane", "way"), [((-1, 0, 0, 4.25), 3.75), ((0, -1, 0, 2.25), 1.75)])
def test_margin_ends_at_the_clip_plane(plane, way: float, perspective: bool) -> None:
    camera = orthographic()
    if perspective:
        camera = Camera(pose(np.eye(3), np.zeros(3)), SIDE, SIDE, 0.5, 99.0, yfov=HALF)
    clipped = replace(camera, clip_plane=plane)
    # In perspective a pixel is one unit wide at depth 16.
    scene = scene_of(quad(-99, -99, 99, 99, -16))
    assert margins(scene, clipped, sample_at(0.5, 0.5))[0] == pytest.approx(way, abs=1e-5)
    assert margins(scene, camera, sample_at(0.5, 0.5))[0] == REACH_PX


def test_a_leaf_before_the_surface_bounds_the_margin_wherever_its_holes_are() -> None:
    wall, leaf = quad(-9, -9, 9, 9, -10), quad(3.25, -9, 5, 9, -8)
    scene = scene_of(wall, leaf)
    alpha = scene.alpha.copy()
    alpha[2:] = Alpha.MASK
    masked = replace(scene, alpha=alpha)
    sample = sample_at(0.5, 0.5)
    assert margins(masked, orthographic(), sample)[0] == pytest.approx(2.75, abs=CLOSE)
    assert margins(masked, orthographic(), sample_at(3.5, 0.5))[0] == 0.0
    # Glass hides nothing.
    alpha[2:] = Alpha.BLEND
    clear = replace(scene, alpha=alpha)
    assert margins(clear, orthographic(), sample)[0] == pytest.approx(8.5, abs=CLOSE)


def test_nothing_is_told_where_too_many_triangles_lie_around() -> None:
    blades = [quad(x, -9, x + 0.25, 9, -5) for x in np.arange(1.0, 6.0)]
    scene, sample = scene_of(quad(-9, -9, 9, 9, -10), *blades), sample_at(0.5, 0.5)
    assert margins(scene, orthographic(), sample)[0] == pytest.approx(0.5, abs=CLOSE)
    # Two triangles of the wall, and two of each of the three blades within the reach.
    assert margins(scene, orthographic(), sample, reach_px=3.0, most_around=7)[0] == 0.0
    assert margins(scene, orthographic(), sample, reach_px=3.0, most_around=8)[0] > 0.0


def test_margin_at_a_vertex_inside_a_mesh_is_not_zero() -> None:
    ring = np.array([[0.5, 0.5], [3, 0.5], [0.5, 3], [-3, 0.5], [0.5, -3]])
    fan = (
        np.column_stack([ring, np.full(5, -9.0)]),
        np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1]]),
    )
    assert margins(scene_of(fan), orthographic(), sample_at(0.5, 0.5))[0] > 1.0
    # One blade less, and the sample stands on the rim.
    assert margins(scene_of((fan[0], fan[1][:3])), orthographic(), sample_at(0.5, 0.5))[0] == 0.0


def test_a_fold_is_a_rim() -> None:
    # Two triangles share the edge x = 0.75 and lie on the same side of it: a silhouette.
    v = np.array([[0.75, -4, -5], [0.75, 4, -5], [-4, 0, -5.0], [-4, 0, -8.0]])
    scene = scene_of((v, np.array([[0, 1, 2], [0, 1, 3]])))
    assert margins(scene, orthographic(), sample_at(0.5, 0.5))[0] == pytest.approx(0.25, abs=CLOSE)


def test_a_sliver_between_all_probes_bounds_the_margin() -> None:
    wall, sliver = quad(-3, -3, 3, 3, -10), quad(0.81, -5, 0.8101, 5, -5)
    px, _ = margins(scene_of(wall, sliver), orthographic(), sample_at(0.5, 0.5))
    assert px == pytest.approx(0.31, abs=CLOSE)
    assert survives(scene_of(wall, sliver), orthographic(), sample_at(0.5, 0.5), 0.3)
    assert not survives(scene_of(wall, sliver), orthographic(), sample_at(0.5, 0.5), 0.32)
    # Behind the wall it takes nothing away, and is the next in depth where it is met.
    behind = quad(0.45, -5, 0.55, 5, -12)
    px, depth = margins(scene_of(wall, behind), orthographic(), sample_at(0.5, 0.5))
    assert px == pytest.approx(2.5, abs=CLOSE)
    assert depth == pytest.approx(0.2)


def test_a_crossing_surface_bounds_the_margin_where_it_comes_out() -> None:
    # The plane z = -10 + (x - 0.9) comes before the wall at x > 0.9.
    wall = quad(-3, -3, 3, 3, -10)
    v = np.array([[-3, -9, -13.9], [3, -9, -7.9], [3, 9, -7.9], [-3, 9, -13.9]])
    px, depth = margins(scene_of(wall, (v, wall[1])), orthographic(), sample_at(0.5, 0.5))
    assert px == pytest.approx(0.4, abs=1e-4)
    assert depth == pytest.approx(0.04, abs=1e-6)


def test_a_tie_has_no_margin() -> None:
    wall = quad(-3, -3, 3, 3, -10)
    scene, sample = scene_of(wall, wall), sample_at(0.5, 0.5)
    assert margins(scene, orthographic(), sample) == (0.0, 0.0)
    assert not survives(scene, orthographic(), sample, 1e-3)


def test_depths_within_a_step_of_the_buffer_do_not_survive() -> None:
    camera, sample = orthographic(near=1.0, far=101.0), sample_at(0.5, 0.5)

    def pair(gap: float, bits: int | None) -> bool:
        scene = scene_of(quad(-3, -3, 3, 3, -10), quad(-3, -3, 3, 3, -10 - gap))
        return survives(scene, camera, sample, 1e-3, bits=bits)

    # A step of 16 bits is 100 / 65536 = 0.00153 units, the bound of float32 errors 0.0002.
    assert not pair(0.0015, 16)
    assert pair(0.0018, 16)
    assert pair(0.0015, 24)
    assert not pair(1e-6, None)


def test_a_slope_costs_depth_within_the_snap() -> None:
    # 45 degrees: 0.1 pixels are 0.1 units of depth, on either surface.
    camera, sample = orthographic(), sample_at(0.5, 0.5)
    v = np.array([[-3, -3, -13], [3, -3, -7.0], [3, 3, -7.0], [-3, 3, -13]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])

    def pair(gap: float) -> bool:
        return survives(scene_of((v, faces), (v - (0, 0, gap), faces)), camera, sample, 0.1)

    assert not pair(0.19)
    assert pair(0.21)


def test_what_touches_the_near_or_far_plane_does_not_survive() -> None:
    sample = sample_at(0.5, 0.5)
    scene = scene_of(quad(-3, -3, 3, 3, -10))
    assert survives(scene, orthographic(near=9.99, far=10.01), sample, 0.01)
    assert not survives(scene, orthographic(near=10.0, far=20.0), sample, 0.01)
    assert not survives(scene, orthographic(near=0.5, far=10.0), sample, 0.01)


def test_an_object_that_does_not_cover_the_sample_has_no_margin() -> None:
    scene = scene_of(quad(-3, -3, 0, 3, -10), quad(-9, -9, 9, 9, -20))
    assert margins(scene, orthographic(), sample_at(4.5, 0.5), owner=0)[0] == 0.0
    assert not survives(scene, orthographic(), sample_at(4.5, 0.5), 1e-3, owner=0)


def random_mesh(rng: np.random.Generator) -> Soup:
    """A bumpy patch of a triangle mesh, or a loose sliver or two."""
    if rng.random() < 0.5:
        n = 4
        x, y = np.meshgrid(np.linspace(-6, 6, n), np.linspace(-6, 6, n))
        flat = np.stack([x, y], -1).reshape(-1, 2) * rng.uniform(0.2, 1.2)
        flat = flat + rng.uniform(-1.0, 1.0, flat.shape) + rng.uniform(-4, 4, 2)
        v = np.column_stack([flat, rng.uniform(-14, -6, len(flat))])
        corner = np.array([n * i + j for i in range(n - 1) for j in range(n - 1)])
        faces = np.concatenate([corner[:, None] + (0, 1, n + 1), corner[:, None] + (0, n + 1, n)])
        return v, faces
    start, along = rng.uniform(-6, 6, 2), rng.normal(size=2)
    width = rng.choice([1e-3, 0.05, 0.5]) * rng.normal(size=2)
    ends = np.array([start - 5 * along, start + 5 * along, start + 5 * along + width])
    return np.column_stack([ends, rng.uniform(-14, -6, 3)]), np.array([[0, 1, 2]])


@pytest.mark.slow
@pytest.mark.parametrize("perspective", [False, True])
def test_no_displacement_loses_a_surviving_witness(perspective: bool) -> None:
    rng = np.random.default_rng(17)
    lost_without = kept = 0
    for _ in range(40):
        objects = [random_mesh(rng) for _ in range(4)]
        if perspective:
            turn = rotation(rng, aligned=False)
            camera = Camera(pose(turn, rng.normal(size=3)), SIDE, SIDE, 1.0, 50.0, yfov=HALF)
            # The same picture: pixels at unit depth, then out along the ray.
            moved = []
            for v, f in objects:
                depth = -v[:, 2]
                local = np.column_stack([v[:, :2] / 16.0 * depth[:, None], -depth])
                moved.append((local @ turn.T + camera.eye, f))
            objects = moved
        else:
            camera = orthographic()
        scene = scene_of(*objects)
        exact = ExactScene(scene, threads=1)
        frame = exact.certify(camera)
        samples = np.flatnonzero(frame.buffer.triangle.reshape(-1) >= 0)
        owner = scene.object_of_triangle[frame.buffer.triangle.reshape(-1)[samples]].astype(int)
        snap = float(rng.choice([0.3, 0.1, 0.02]))
        survive = surviving(exact, camera, samples, owner, RasterTolerance(snap, 24))
        px, _ = witness_margins(exact, camera, samples, owner)
        # What survives a displacement of everything survives that of the sample alone.
        assert (px[survive] > snap - CLOSE).all()
        for _ in range(6):
            pixels, depth = camera.pixel_of(scene.vertices.astype(float))
            angle = rng.uniform(0, 2 * math.pi, len(pixels))
            pixels = pixels + 0.999 * snap * np.stack([np.cos(angle), np.sin(angle)], 1)
            again = moved_scene(scene, camera, pixels, depth)
            owners = ExactScene(again, threads=1).decide(camera, samples)
            first = np.full(len(samples), -1)
            hit = np.diff(owners.offsets) > 0
            first[hit] = again.object_of_triangle[owners.triangles[owners.offsets[:-1][hit]]]
            assert (first[survive] == owner[survive]).all()
            lost_without += int((first[~survive] != owner[~survive]).sum())
            kept += int(survive.sum())
    # Neither answer is the safe constant one.
    assert lost_without > 100
    assert kept > 1000


def moved_scene(scene: Scene, camera: Camera, pixels: np.ndarray, depth: np.ndarray) -> Scene:
    """The scene with each vertex moved, at its depth, to where a pixel position says."""
    a = 2.0 * pixels[:, :1] + 1.0 - camera.width
    b = camera.height - 2.0 * pixels[:, 1:] - 1.0
    offset = a * camera.right_step + b * camera.up_step
    if camera.is_perspective:
        vertices = camera.eye + depth[:, None] * (camera.forward + offset)
    else:
        vertices = camera.eye + offset + depth[:, None] * camera.forward
    return Scene(vertices.astype(np.float32), scene.triangles, scene.object_offsets, scene.names)


@pytest.mark.slow
@pytest.mark.parametrize("perspective", [False, True])
def test_the_sample_may_move_as_far_as_its_margin(perspective: bool) -> None:
    # A lens shift moves every sample alike.
    rng = np.random.default_rng(23)
    reached = 0
    for _ in range(25):
        scene = scene_of(*[random_mesh(rng) for _ in range(4)])
        options = {"yfov": HALF} if perspective else {"ymag": SIDE / 2}
        base = pose(np.eye(3), np.zeros(3))
        camera = Camera(base, SIDE, SIDE, 1.0, 50.0, **options)
        exact = ExactScene(scene, threads=1)
        triangle = exact.certify(camera).buffer.triangle.reshape(-1)
        samples = np.flatnonzero(triangle >= 0)
        owner = scene.object_of_triangle[triangle[samples]].astype(int)
        px, _ = witness_margins(exact, camera, samples, owner)
        for _ in range(8):
            angle, far = rng.uniform(0, 2 * math.pi), rng.choice([0.02, 0.1, 0.4, 0.9, 2.1])
            shift = far * math.cos(angle), far * math.sin(angle)
            moved = Camera(
                base, SIDE, SIDE, 1.0, 50.0, shift_x_px=shift[0], shift_y_px=shift[1], **options
            )
            after = exact.certify(moved).buffer.triangle.reshape(-1)[samples]
            same = (after >= 0) & (scene.object_of_triangle[after] == owner)
            assert same[px > far].all()
            reached += int((~same).sum())
    assert reached > 100


@pytest.mark.parametrize("perspective", [False, True])
def test_what_rounding_may_bring_across_the_near_plane_can_hide(perspective: bool) -> None:
    camera, sample = orthographic(near=4.0), sample_at(0.5, 0.5)
    if perspective:
        camera = Camera(pose(np.eye(3), np.zeros(3)), SIDE, SIDE, 4.0, 100.0, yfov=HALF)

    def hidden_by(depth: float) -> bool:
        hider, shown = quad(-9, -9, 9, 9, -depth), quad(-9, -9, 9, 9, -10)
        return not survives(scene_of(shown, hider), camera, sample, 0.01)

    assert hidden_by(5.0)
    assert hidden_by(4.0 - 2.0**-22)
    assert not hidden_by(3.9)
