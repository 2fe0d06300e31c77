"""ExactScene's ways in agree with each other, whatever the threads, and cost what they should."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest

from tests.support.exact_brute import hits
from tests.support.exact_scenes import HALF, pose, random_case, rotation
from visref.camera import Camera
from visref.engines.exact import ExactEngine
from visref.errors import InputError
from visref.exact import ExactScene, compare_depths
from visref.exact.depths import depths
from visref.exact.filters import view_of
from visref.exact.planes import lowest_bit_of_single
from visref.exact.rational import in_units, lowest_bit, plane_names
from visref.exact.scene import Owners
from visref.scene import Alpha, Scene
from visref.visibility import FrameTruth


def frame_of(owners: Owners, frame: FrameTruth, samples: np.ndarray) -> None:
    """Raise unless `owners` says of the samples what the frame says."""
    triangle, depth = frame.buffer.triangle.reshape(-1), frame.buffer.depth.reshape(-1)
    for i, sample in enumerate(samples):
        own = [int(triangle[sample])] if triangle[sample] >= 0 else []
        further = frame.ties.triangle[frame.ties.sample == sample].tolist()
        assert owners.triangles[owners.offsets[i] : owners.offsets[i + 1]].tolist() == own + further
        assert owners.depth[i] == depth[sample]


def soup(rng: np.random.Generator, count: int) -> Scene:
    centre = rng.uniform((-20, -20, -60), (20, 20, -5), (count, 1, 3))
    corners = centre + rng.normal(size=(count, 3, 3)) * rng.choice([0.1, 1.0, 4.0], (count, 1, 1))
    # Every tenth has a twin, and some whole coordinates meet.
    corners[::7] = corners[::7].round()
    corners[1::10] = corners[::10][: len(corners[1::10])]
    alpha = np.zeros(count, np.uint8)
    alpha[::11], alpha[5::11] = Alpha.MASK, Alpha.BLEND
    return Scene(
        corners.reshape(-1, 3).astype(np.float32),
        np.arange(3 * count, dtype=np.int32).reshape(-1, 3),
        np.arange(0, count + 1, 10),
        tuple(f"o{i}" for i in range(count // 10)),
        alpha=alpha,
    )


def camera(width: int = 150, height: int = 131, **options: float) -> Camera:
    options = options or {"yfov": 1.0}
    return Camera(pose(np.eye(3), np.array([0.0, 0.0, 10.0])), width, height, 0.5, 200.0, **options)


@pytest.mark.parametrize("options", [{"yfov": 1.0}, {"ymag": 20.0}])
def test_threads_change_no_byte(options: dict[str, float]) -> None:
    scene = soup(np.random.default_rng(3), 2000)
    frames = [ExactEngine(scene, threads=n).frame(camera(**options)) for n in (1, 2, 3)]
    owners = [
        ExactScene(scene, threads=n).decide(camera(**options), np.arange(0, 150 * 131, 7))
        for n in (1, 2, 3)
    ]

    def content(frame: FrameTruth) -> tuple[bytes, ...]:
        blend, ties, buffer = frame.blend, frame.ties, frame.buffer
        arrays = (buffer.triangle, buffer.depth, ties.sample, ties.triangle)
        arrays += (frame.doubt.sample, frame.doubt.offsets, frame.doubt.triangle)
        arrays += (blend.object, blend.sample, blend.triangle, blend.depth)
        return tuple(array.tobytes() for array in arrays)

    assert len(frames[0].ties.sample)
    assert len(frames[0].doubt)
    assert len(frames[0].blend.object)
    assert content(frames[0]) == content(frames[1]) == content(frames[2])
    for other in owners[1:]:
        assert other.rational == owners[0].rational
        assert other.triangles.tobytes() == owners[0].triangles.tobytes()
        assert other.depth.tobytes() == owners[0].depth.tobytes()


def test_deciding_some_samples_is_what_the_frame_says_of_them() -> None:
    scene = soup(np.random.default_rng(4), 1500)
    exact = ExactScene(scene)
    frame = exact.certify(camera())
    rng = np.random.default_rng(5)
    for count in (0, 1, 50, 3000):
        samples = rng.integers(0, 150 * 131, count)
        owners = exact.decide(camera(), samples)
        assert len(owners.offsets) == count + 1
        frame_of(owners, frame, samples)


@pytest.mark.slow
def test_excluded_triangles_do_not_exist() -> None:
    for index in range(60):
        scene, view = random_case(31, index)
        include = np.random.default_rng(index).random(scene.triangle_count) < 0.6
        kept = [set(np.flatnonzero(include & (scene.alpha == Alpha.OPAQUE)).tolist())]
        owners = ExactScene(scene, threads=1).decide(view, np.arange(view.samples), include=include)
        for sample, found in enumerate(hits(scene, view)):
            allowed = [(t, i) for t, i in found if i in kept[0]]
            nearest = min((t for t, _ in allowed), default=None)
            tied = sorted(i for t, i in allowed if t == nearest)
            low, high = owners.offsets[sample : sample + 2]
            assert owners.triangles[low:high].tolist() == tied


def test_a_wall_of_duplicates_is_decided_by_planes_not_by_samples() -> None:
    corners = np.array([[-50.0, -50, -3], [50.0, -50, -3], [50.0, 50, -3], [-50.0, 50, -3]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    turn = rotation(np.random.default_rng(2), aligned=False)
    scene = Scene.from_objects([(f"wall {i}", corners @ turn.T, faces) for i in range(3)])
    view = Camera(pose(turn, np.zeros(3)), 201, 150, 0.5, 100.0, yfov=1.0)
    owners = ExactScene(scene).decide(view, np.arange(view.samples))
    assert (np.diff(owners.offsets) >= 3).all()
    assert owners.rational < view.samples / 10


def test_touching_planes_are_told_apart_from_the_same_plane() -> None:
    # The same plane, one that differs by a last place, one parallel, the same turned over.
    base = np.array([[0, 0, 0], [3, 0, 1], [0, 3, 1]], np.float32)
    moved = np.array([[3, 3, 2], [6, 3, 3], [3, 6, 3]], np.float32)
    tilted = moved.copy()
    tilted[2, 2] = np.nextafter(np.float32(3), np.float32(4))
    flat = np.array([[0, 0, 0], [1, 1, 1], [2, 2, 2]], np.float32)
    soups = np.stack([base, moved, tilted, base + np.float32(1), moved[::-1], flat])
    same, other, tilt, parallel, turned, none = plane_names(soups, lowest_bit(soups))
    assert same == other == turned
    assert len({same, tilt, parallel}) == 3
    assert none is None


def test_floats_are_whole_in_their_lowest_bit() -> None:
    rng = np.random.default_rng(6)
    values = np.concatenate(
        [rng.normal(size=50) * 10.0 ** rng.integers(-200, 200, 50), [0.0, 5e-324, 1.7e308, -1.5]]
    )
    for array in (values, values[-1:], np.zeros(3), values[:50]):
        unit = lowest_bit(array)
        whole = in_units(array, unit)
        assert all(
            Fraction(w) * Fraction(2) ** unit == Fraction(float(v))
            for w, v in zip(whole, array, strict=True)
        )
    assert lowest_bit(np.array([12.0, 40.0])) == 2


def test_depths_between_two_floats_round_to_even_by_integers() -> None:
    # The eye is half a last place of the depth away: double words cannot tell the rounding.
    corners = np.array([[-9.0, -9, -1], [9.0, -9, -1], [0.0, 9, -1]])
    scene = Scene.from_objects([("wall", corners, np.array([[0, 1, 2]]))])
    for half in (2.0**-53, 3.0 * 2.0**-53):
        view = Camera(pose(np.eye(3), np.array([0.0, 0.0, half])), 4, 4, 0.5, 9.0, ymag=2.0)
        samples, triangles = np.arange(16), np.zeros(16, np.int32)
        out = np.empty(16)
        torn = depths(
            samples, triangles, scene.vertices, scene.triangles, view_of(view),
            view.column_a, view.row_b, out,
        )  # fmt: skip
        assert len(torn) == 16
        exact = Fraction(half) + 1
        assert (ExactScene(scene).certify(view).buffer.depth == float(exact)).all()
    assert float(Fraction(2.0**-53) + 1) == 1.0


def test_compare_depths_refuses_what_is_not_hit() -> None:
    scene = soup(np.random.default_rng(4), 100)
    with pytest.raises(ValueError, match="cover the sample"):
        compare_depths(scene, camera(), 0, 0, 1)


def test_an_empty_scene_is_all_background() -> None:
    scene = Scene.from_objects([("nothing", np.zeros((0, 3)), np.zeros((0, 3), int))])
    frame = ExactScene(scene).certify(camera())
    assert (frame.buffer.triangle == -1).all()
    assert np.isinf(frame.buffer.depth).all()
    assert ExactScene(scene).decide(camera(), np.array([3])).offsets.tolist() == [0, 0]


def test_views_out_of_reach_are_clear_errors() -> None:
    scene = soup(np.random.default_rng(4), 10)
    far = Camera(pose(np.eye(3), np.array([1e200, 0.0, 0.0])), 4, 4, 0.1, math.inf, yfov=HALF)
    with pytest.raises(InputError, match=r"2\^300 units of the origin"):
        ExactScene(scene).certify(far)
    for ymag in (1e-310, 1e300):
        view = Camera(np.eye(4), 4, 4, 0.1, math.inf, ymag=ymag)
        with pytest.raises(InputError, match="half a pixel"):
            ExactScene(scene).certify(view)


def test_tall_and_single_sample_images_work() -> None:
    scene = soup(np.random.default_rng(4), 200)
    for width, height in ((1, 1), (1, 4096), (641, 3)):
        view = camera(width, height)
        frame = ExactScene(scene).certify(view)
        samples = np.arange(0, view.samples, 97)
        frame_of(ExactScene(scene).decide(view, samples), frame, samples)


@pytest.mark.parametrize("seed", range(20))
def test_the_lowest_bit_of_single_numbers_is_that_of_any(seed):
    rng = np.random.default_rng(seed)
    values = rng.integers(0, 2**32, 50, np.uint32).view(np.float32)
    values = np.append(values[np.isfinite(values)], [0.0, -0.0, 1.0]).astype(np.float32)
    if seed % 2:
        values = np.rint(values[np.abs(values) < 2.0**20] * 8.0).astype(np.float32) / 8.0
    for most in (200, -2, -149):
        right = min(most, lowest_bit(values))
        assert lowest_bit_of_single(values.view(np.uint32), most) == right
