"""Geometric truth: closed forms between the samples, proofs of hiding, and exact witnesses."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.truth_scenes import Part, build, quad, random_soup
from visref.between.aiming import Aim, SeenMesh, draw_points, projected_areas
from visref.between.search import (
    FrameGeometry,
    GeometricSearch,
    Status,
    geometric_line,
    point_camera,
    write_geometric,
)
from visref.camera import Camera, look_at
from visref.camera_path import CameraPath
from visref.engines.embree import EmbreeEngine
from visref.errors import InputError
from visref.exact import ExactScene
from visref.exact.outside import certainly_outside, degenerate, image_limits
from visref.inputs import open_inputs
from visref.runs import truth_to_file
from visref.scene import Alpha, Int32, Scene
from visref.visibility import BACKGROUND, objects_seen


def perspective(width: int = 32, height: int = 24, **rest: float) -> Camera:
    values: dict[str, float] = {"near": 0.5, "far": 64.0, "yfov": math.pi / 2, **rest}
    return Camera(np.eye(4), width, height, **values)


def orthographic(width: int = 32, height: int = 24, **rest: float) -> Camera:
    values: dict[str, float] = {"near": 0.5, "far": 64.0, "ymag": height / 2, **rest}
    return Camera(np.eye(4), width, height, **values)


CAMERAS = {"perspective": perspective, "orthographic": orthographic}
both_projections = pytest.mark.parametrize("camera_of", CAMERAS.values(), ids=CAMERAS)


def search(scene: Scene, camera: Camera, frame: int = 0, threads: int = 1) -> FrameGeometry:
    exact, prober = ExactScene(scene, threads=threads), EmbreeEngine(scene, threads=threads)
    seen = objects_seen(exact.certify(camera), scene)
    return GeometricSearch(scene, prober, exact).frame(frame, camera, seen)


def statuses(scene: Scene, camera: Camera) -> list[Status]:
    return [Status(status) for status in search(scene, camera).status]


def ids(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """(a, b) of all samples, flat."""
    a, b = np.meshgrid(camera.column_a, camera.row_b)
    return a.ravel(), b.ravel()


@pytest.mark.slow
@both_projections
def test_a_third_of_a_pixel_between_the_samples_is_found_with_a_witness_on_it(
    camera_of: Callable[..., Camera],
) -> None:
    camera = camera_of(shift_x_px=0.25)
    # Pixel 5 spans 5 to 6, its sample is in the middle.
    scene = build(quad(camera, (0, 0, 32, 24), 8.0), quad(camera, (5.6, 3.6, 5.9, 3.9), 4.0))
    found = search(scene, camera)
    assert list(found.status) == [Status.VISIBLE, Status.SUBPIXEL]
    # Witnesses have samples at whole numbers.
    assert 5.1 <= found.x[1] <= 5.4
    assert 3.1 <= found.y[1] <= 3.4
    assert found.depth[1] == pytest.approx(4.0, rel=1e-6)
    assert found.depth[0] == pytest.approx(8.0, rel=1e-6)
    assert found.x[0] == int(found.x[0])


@both_projections
def test_the_same_square_behind_a_wall_is_unseen_and_not_called_hidden(
    camera_of: Callable[..., Camera],
) -> None:
    camera = camera_of()
    scene = build(quad(camera, (0, 0, 32, 24), 2.0), quad(camera, (5.6, 3.6, 5.9, 3.9), 4.0))
    assert statuses(scene, camera) == [Status.VISIBLE, Status.UNSEEN]


def test_a_hundredth_of_a_pixel_that_looks_out_from_behind_a_wall_is_found() -> None:
    camera = perspective()
    scene = build(quad(camera, (0, 0, 8.6, 24), 2.0), quad(camera, (7.0, 3.0, 8.61, 4.0), 4.0))
    found = search(scene, camera)
    assert found.status[1] == Status.SUBPIXEL
    assert 8.1 <= found.x[1] <= 8.11 + 1e-6


def test_a_sliver_a_thousandth_of_a_pixel_wide_is_found() -> None:
    camera = perspective()
    corners = quad(camera, (9.7, 2.0, 9.701, 22.0), 4.0).points[[0, 1, 2]]
    scene = build(quad(camera, (0, 0, 32, 24), 8.0), Part(corners, np.array([[0, 1, 2]])))
    assert statuses(scene, camera) == [Status.VISIBLE, Status.SUBPIXEL]


def test_one_small_triangle_before_a_large_hidden_rest_is_found() -> None:
    camera = perspective(256, 192)
    rest, front = quad(camera, (0, 0, 256, 192), 9.0), quad(camera, (5.6, 3.6, 5.7, 3.7), 1.0)
    split = Part(
        np.concatenate([rest.points, front.points]), np.concatenate([rest.faces, front.faces + 4])
    )
    scene = build(quad(camera, (0, 0, 256, 192), 2.0), split)
    assert statuses(scene, camera) == [Status.VISIBLE, Status.SUBPIXEL]


@both_projections
def test_only_what_is_outside_or_has_no_area_is_proven_hidden(
    camera_of: Callable[..., Camera],
) -> None:
    camera = camera_of()
    line = Part(quad(camera, (3, 3, 9, 9), 4.0).points[[0, 2, 2]], np.array([[0, 1, 2]]))
    behind_eye = quad(camera, (3, 3, 9, 9), 4.0)
    behind_eye.points[:, 2] += 40.0
    scene = build(
        quad(camera, (0, 0, 32, 24), 2.0),
        quad(camera, (40, 3, 45, 9), 4.0),
        quad(camera, (3, -9, 9, -0.01), 4.0),
        quad(camera, (3, 3, 9, 9), 0.4),
        quad(camera, (3, 3, 9, 9), 65.0),
        behind_eye,
        line,
        Part(np.zeros((0, 3)), np.zeros((0, 3), np.int64)),
        quad(camera, (31.99, 3, 45, 9), 4.0),
    )
    assert statuses(scene, camera) == [
        Status.VISIBLE,
        *[Status.HIDDEN] * 7,
        # A corner of it is in the view, behind the wall: nothing is proven.
        Status.UNSEEN,
    ]


def test_boxes_that_straddle_the_view_are_judged_by_their_triangles() -> None:
    camera = orthographic()
    # A frame around the picture: its box holds the whole view, none of its triangles does.
    parts = [(-9, -9, 41, -1), (-9, 25, 41, 33), (-9, -9, -1, 33), (33, -9, 41, 33)]
    quads = [quad(camera, pixels, 4.0) for pixels in parts]
    frame = Part(
        np.concatenate([part.points for part in quads]),
        np.concatenate([part.faces + 4 * i for i, part in enumerate(quads)]),
    )
    assert statuses(build(frame), camera) == [Status.HIDDEN]


def test_a_lying_prober_finds_nothing_because_every_witness_is_decided_exactly() -> None:
    camera = perspective()
    scene = build(quad(camera, (0, 0, 32, 24), 2.0), quad(camera, (5.6, 3.6, 5.9, 3.9), 4.0))

    class Liar(EmbreeEngine):
        def probe(self, camera: Camera, a: np.ndarray, b: np.ndarray) -> Int32:
            return np.full(len(a), 2, np.int32)  # a triangle of the hidden square

    exact = ExactScene(scene)
    seen = objects_seen(exact.certify(camera), scene)
    found = GeometricSearch(scene, Liar(scene), exact).frame(0, camera, seen)
    assert list(found.status) == [Status.VISIBLE, Status.UNSEEN]


@pytest.mark.parametrize(
    ("alpha", "depth", "expected"),
    [
        (Alpha.BLEND, 4.0, Status.SUBPIXEL),
        (Alpha.BLEND, 9.0, Status.UNSEEN),
        # Its texture decides: a point of it convicts nobody.
        (Alpha.MASK, 4.0, Status.UNSEEN),
    ],
)
def test_blended_objects_show_before_the_wall_and_masked_ones_are_never_claimed(
    alpha: Alpha, depth: float, expected: Status
) -> None:
    camera = perspective()
    small = quad(camera, (5.6, 3.6, 5.9, 3.9), depth, alpha=alpha)
    scene = build(quad(camera, (0, 0, 32, 24), 8.0), small)
    assert statuses(scene, camera) == [Status.VISIBLE, expected]


@both_projections
def test_points_cast_at_the_samples_see_what_the_frame_sees(
    camera_of: Callable[..., Camera],
) -> None:
    for seed in range(3):
        scene = random_soup(seed)
        # Near cuts through the soup and every other triangle has a front only, so that hits
        # that do not count hide some that do.
        scene = replace(scene, one_sided=np.arange(scene.triangle_count) % 2 == 0)
        camera = camera_of(
            40, 30, near=3.0, far=8.0, **({} if camera_of is perspective else {"ymag": 3.0})
        )
        engine = EmbreeEngine(scene)
        frame = engine.frame(camera).buffer.triangle.copy()
        a, b = ids(camera)
        np.testing.assert_array_equal(engine.probe(camera, a, b), frame.ravel())
        order = np.random.default_rng(seed).permutation(len(a))
        shuffled = engine.probe(camera, a[order], b[order])
        np.testing.assert_array_equal(shuffled, frame.ravel()[order])
        assert (frame != BACKGROUND).any()


def test_casting_no_points_is_no_error() -> None:
    assert len(EmbreeEngine(random_soup(0)).probe(perspective(), np.zeros(0), np.zeros(0))) == 0


@both_projections
def test_every_witness_of_the_file_replays(
    camera_of: Callable[..., Camera], tmp_path: Path
) -> None:
    scene = random_soup(5, triangles=240)
    camera = camera_of(10, 8, **({} if camera_of is perspective else {"ymag": 3.0}))
    found = search(scene, camera)
    assert found.count(Status.SUBPIXEL) > 3
    file = tmp_path / "geometric.parquet"
    write_geometric(file, scene, CameraPath((camera,)), [(0, found)], engine="exact")
    rows = pq.read_table(file).to_pylist()
    assert [row["object"] for row in rows] == list(range(scene.object_count))
    exact = ExactScene(scene)
    for row in rows:
        if row["status"] in ("unseen", "hidden"):
            assert row["x"] is row["y"] is row["depth"] is None
            continue
        assert -0.5 <= row["x"] <= camera.width - 0.5
        assert -0.5 <= row["y"] <= camera.height - 0.5
        owners = exact.decide(point_camera(camera, row["x"], row["y"]), np.array([0]))
        assert row["object"] in scene.object_of_triangle[owners.triangles]
        assert owners.depth[0] == pytest.approx(row["depth"], rel=1e-12)


def test_the_file_is_the_same_for_one_thread_and_two(tmp_path: Path) -> None:
    camera, scene = perspective(10, 8), random_soup(5, triangles=240)
    for threads in (1, 2):
        frames = [(n, search(scene, camera, n, threads)) for n in (0, 1)]
        path = CameraPath((camera, camera))
        write_geometric(tmp_path / str(threads), scene, path, frames, engine="exact")
    assert (tmp_path / "1").read_bytes() == (tmp_path / "2").read_bytes()
    # Another frame casts other rays.
    x = [found.x[found.status == Status.SUBPIXEL] for _, found in frames]
    assert not np.array_equal(*x)


def test_the_command_writes_both_files_and_refuses_one_name_for_both(tmp_path: Path) -> None:
    inputs = open_inputs("city:scale=0.02,frames=2", path=None, frames="0:1", engine="embree")
    inputs = replace(inputs, path=inputs.path.resized(64, 48))
    truth, geometric = tmp_path / "truth.parquet", tmp_path / "geometric.parquet"
    cast = truth_to_file(inputs, truth, geometric=geometric)
    visible = {row["object"] for row in pq.read_table(truth).to_pylist()}
    rows = pq.read_table(geometric).to_pylist()
    assert visible == {row["object"] for row in rows if row["status"] == "visible"}
    subpixel = sum(row["status"] == "subpixel" for row in rows)
    assert geometric_line(cast.between).startswith(f"{subpixel} objects visible between")
    assert visible == set(np.flatnonzero(cast.visible))
    with pytest.raises(InputError, match="same file"):
        truth_to_file(inputs, truth, geometric=truth)


def test_projected_area_is_that_of_the_part_inside_the_view() -> None:
    camera = perspective()
    scene = build(
        quad(camera, (5, 3, 20, 17), 4.0),
        quad(camera, (-10, 3, 2, 4), 4.0),
        quad(camera, (5, 3, 20, 17), 0.1),
        # A floor under the eye, that runs through the near plane to the horizon: it fills the
        # lower half but for the strip that the near plane cuts off.
        Part(
            np.array([[-9e5, -0.25, 9e5], [9e5, -0.25, 9e5], [0, -0.25, -9e5]]),
            np.array([[0, 1, 2]]),
        ),
    )
    camera = replace(camera, far=math.inf)
    every = np.arange(scene.triangle_count, dtype=np.int32)
    mesh = SeenMesh.of(camera, scene.vertices, scene.triangles, image_limits(camera))
    areas = projected_areas(every, mesh)
    sums = np.add.reduceat(areas, scene.object_offsets[:-1])
    # At near = 0.5 the floor is half the half view's height below: 6 of 12 rows.
    np.testing.assert_allclose(sums, [15 * 14, 2 * 1, 0, 32 * 6], rtol=1e-4)


def test_points_are_drawn_inside_the_projection_and_in_proportion_to_area() -> None:
    camera = perspective()
    scene = build(quad(camera, (5, 3, 8, 6), 4.0), quad(camera, (10, 3, 11, 6), 2.0))
    mesh = SeenMesh.of(camera, scene.vertices, scene.triangles, image_limits(camera))
    which = np.arange(4, dtype=np.int32)
    aim = Aim(np.array([3], np.int32), np.array([0, 4]), which, projected_areas(which, mesh))
    target, a, b = draw_points(aim, mesh, 7, 0, 20_000, 0.25)
    x, y = (a + 32) / 2, (24 - b) / 2
    near = target >= 2
    assert (((x > 5) & (x < 8) & (y > 3) & (y < 6)) | near).all()
    assert (((x > 10) & (x < 11) & (y > 3) & (y < 6)) | ~near).all()
    # Three of twelve pixels by area, or half of the triangles: 3/4 * 1/4 + 1/4 * 1/2 = 0.3125,
    # a standard deviation of 0.0033.
    assert near.mean() == pytest.approx(0.3125, abs=0.014)
    assert y[near].mean() == pytest.approx(4.5, abs=0.05)
    assert np.histogram(x[~near], bins=3, range=(5, 8))[0] == pytest.approx([4583] * 3, rel=0.06)


@settings(max_examples=150, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    far_out=st.sampled_from([0.0, 1e3, 1e6]),
    ymag=st.sampled_from([None, 3.0]),
    near_miss=st.sampled_from([0.0, 1e-12, -1e-12, 1e-3, -1e-3]),
)
def test_what_is_certainly_outside_is_outside_in_exact_arithmetic(
    seed: int, far_out: float, ymag: float | None, near_miss: float
) -> None:
    rng = np.random.default_rng(seed)
    at = rng.uniform(-1, 1, 3) * far_out
    camera = Camera(
        look_at(at, at + rng.normal(size=3)),
        7,
        5,
        near=0.5,
        far=50.0,
        yfov=None if ymag else 1.0,
        ymag=ymag,
        shift_x_px=float(rng.normal()),
    )
    limits = image_limits(camera)
    # A point about the right border.
    a, b, z = limits[1] * (1 + near_miss), rng.uniform(limits[2], limits[3]), rng.uniform(0.6, 49.0)
    side = a * camera.right_step + b * camera.up_step
    point = camera.eye + z * camera.forward + (side if ymag else z * side)
    # Only whole-float64 points may be said to be outside; which they are is decided exactly.
    outside = certainly_outside(camera, point[None, None])[0]
    exact_a = _exact_a(camera, point)
    if outside:
        assert not Fraction(limits[0]) <= exact_a <= Fraction(limits[1])
    if near_miss == 1e-3 and far_out < 1e6:
        assert outside
    if near_miss == -1e-3 and far_out < 1e6:
        assert not outside


def _exact_a(camera: Camera, point: np.ndarray) -> Fraction:
    """a of a point, by Cramer's rule in fractions."""
    q = [Fraction(float(p)) - Fraction(float(e)) for p, e in zip(point, camera.eye, strict=True)]

    def exact(values: np.ndarray) -> list[Fraction]:
        return [Fraction(float(value)) for value in values]

    r, u, f = exact(camera.right_step), exact(camera.up_step), exact(camera.forward)

    def determinant(x: list[Fraction], y: list[Fraction], z: list[Fraction]) -> Fraction:
        return (
            x[0] * (y[1] * z[2] - y[2] * z[1])
            - x[1] * (y[0] * z[2] - y[2] * z[0])
            + x[2] * (y[0] * z[1] - y[1] * z[0])
        )

    along, depth = determinant(q, u, f), determinant(r, u, q)
    return along / depth if camera.is_perspective else along / determinant(r, u, f)


def test_a_triangle_is_degenerate_exactly_or_not_at_all() -> None:
    line = np.array([[0, 0, 0], [1, 1, 1], [3, 3, 3]], np.float32)
    # One unit in the last place off the line.
    off = line.copy()
    off[1, 0] = np.nextafter(np.float32(1), np.float32(2))
    far = line * np.float32(1 / 3) + np.float32(1e6)
    corners = np.stack([line, off, far, np.zeros((3, 3), np.float32)])
    rational = [all(value == 0 for value in _exact_normal(triangle)) for triangle in corners]
    assert degenerate(corners).tolist() == rational
    assert rational[0]
    assert not rational[1]


def _exact_normal(triangle: np.ndarray) -> list[Fraction]:
    p = [[Fraction(float(value)) for value in corner] for corner in triangle]
    g, h = ([p[i][k] - p[0][k] for k in range(3)] for i in (1, 2))
    return [g[(k + 1) % 3] * h[(k + 2) % 3] - g[(k + 2) % 3] * h[(k + 1) % 3] for k in range(3)]


def test_the_search_stops_at_its_rounds_or_at_the_images_samples_whichever_is_more() -> None:
    for width, height, rays in ((32, 24, 16 * (2**6 - 1)), (256, 192, 16 * (2**11 - 1))):
        camera = perspective(width, height)
        wall = quad(camera, (0, 0, width, height), 2.0)
        scene = build(wall, quad(camera, (5.6, 3.6, 5.9, 3.9), 4.0))
        assert search(scene, camera).rays == rays
