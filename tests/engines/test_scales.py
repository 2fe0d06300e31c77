"""A scene in other units has the same owners, and what an engine cannot see it refuses.

Times a power of two nothing rounds, so the answers are the same bit for bit. Times a power of ten,
or where float32 goes subnormal, vertices round, and the reference is decided anew, in whole
numbers, by the brute force of `tests.fuzz_verdicts`, which shares no code with visref.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

from tests.fuzz_verdicts.brute import View as WholeNumbers
from tests.support.truth_scenes import random_soup
from visref.camera import Camera, look_at
from visref.camera_path import CameraPath
from visref.culler import Culler, DrawnSet
from visref.engines import make_engine
from visref.engines.embree import EmbreeEngine
from visref.engines.known_samples import PER_OCTAVE, known_samples, misses, of_each_size
from visref.errors import InputError
from visref.findings import Code
from visref.judging.referee import Referee
from visref.scene import Scene

RAYS = ["embree", "embree:robust=false", "open3d"]
BASE = random_soup(3)
CAMERAS = [
    Camera(look_at((0.0, 0.0, 6.0), (0.0, 0.0, -4.0)), 32, 24, near=0.5, far=100.0, yfov=1.0),
    Camera(look_at((0.5, 0.1, -2.0), (0.0, 0.0, -4.0)), 32, 24, near=0.01, yfov=1.5),
    Camera(look_at((1.0, 3.0, 6.0), (0.0, 0.0, -4.0)), 32, 24, near=0.5, far=100.0, ymag=6.0),
]
# The soup's greatest coordinate is between 8 and 16, 2^4, and float32 ends at 2^128. Its least
# one that is not zero is above 2^-12 and has 24 bits: from 2^-149 + 36 on nothing is rounded.
LEAST, GREATEST = -113, 124


def scene_times(factor: float) -> Scene:
    vertices = (BASE.vertices.astype(np.float64) * factor).astype(np.float32)
    return Scene(vertices, BASE.triangles, BASE.object_offsets, BASE.names)


def camera_times(camera: Camera, factor: float) -> Camera:
    pose = camera.world_from_camera.copy()
    pose[:3, 3] *= factor
    size = {"near": camera.near * factor, "far": camera.far * factor}
    if camera.ymag is not None:
        size["ymag"] = camera.ymag * factor
    return replace(camera, world_from_camera=pose, **size)


def engine_or_skip(spec: str, scene: Scene):
    if spec == "open3d":
        pytest.importorskip("open3d")
    return make_engine(spec, scene)


def owners(spec: str, scene: Scene, factor: float) -> list[np.ndarray]:
    engine = engine_or_skip(spec, scene)
    frames = []
    for camera in CAMERAS:
        buffer = engine.frame(camera_times(camera, factor)).buffer
        frames.append((buffer.triangle.copy(), buffer.depth / factor))
    engine.close()
    return frames


def whole_number_owners(scene: Scene, camera: Camera) -> list[set[int]]:
    """Every sample's nearest triangles, all that tie, decided in whole numbers."""
    triangles = [
        SimpleNamespace(corners=[[float(x) for x in v] for v in scene.vertices[t]], one_sided=False)
        for t in scene.triangles
    ]
    described = {
        "width": camera.width,
        "height": camera.height,
        "near": camera.near,
        "far": None if math.isinf(camera.far) else camera.far,
        "world_from_camera": camera.world_from_camera.tolist(),
    }
    described |= {"ymag": camera.ymag} if camera.ymag is not None else {"yfov": camera.yfov}
    view, found = WholeNumbers(triangles, described), []
    for at in range(camera.samples):
        hits = view.hits(at)
        found.append({t for depth, t in hits if depth == hits[0][0]})
    return found


def test_least_and_greatest_are_where_float32_begins_to_round():
    for power in (LEAST, GREATEST):
        there = np.ldexp(BASE.vertices.astype(np.float64), power)
        np.testing.assert_array_equal(there.astype(np.float32).astype(np.float64), there)
    greatest = float(np.abs(BASE.vertices).max())
    assert (
        greatest * 2.0**GREATEST
        < float(np.finfo(np.float32).max)
        < greatest * 2.0 ** (GREATEST + 1)
    )


@pytest.mark.parametrize("spec", ["exact", *RAYS])
def test_a_power_of_two_changes_no_owner_and_no_depth(spec):
    expected = owners(spec, BASE, 1.0)
    for power in [*range(LEAST, GREATEST, 13), -1, 1, 57, 60, GREATEST]:
        factor = 2.0**power
        for one, other in zip(expected, owners(spec, scene_times(factor), factor), strict=True):
            np.testing.assert_array_equal(one[0], other[0])
            np.testing.assert_array_equal(one[1], other[1])


def few(camera: Camera) -> Camera:
    return replace(camera, width=9, height=7)


@pytest.mark.parametrize("spec", ["exact", "embree", "open3d"])
@pytest.mark.parametrize("factor", [2.0**-148, 2.0**-140, 1e-38, 1e-30, 1e-17, 1e14, 1e17, 1e37])
def test_owners_at_any_scale_are_those_of_whole_numbers(spec, factor):
    scene = scene_times(factor)
    engine = engine_or_skip(spec, scene)
    for camera in (few(camera_times(camera, factor)) for camera in CAMERAS):
        owner = engine.frame(camera).buffer.triangle.reshape(-1).tolist()
        right = whole_number_owners(scene, camera)
        wrong = sum(one not in (who or {-1}) for one, who in zip(owner, right, strict=True))
        # A ray engine may err within float32's rounding of an edge; these samples have none.
        assert wrong == 0


class Draws(Culler):
    name = "draws"

    def __init__(self, ids) -> None:
        self.ids = np.array(ids, np.int32)

    def prepare(self, scene: Scene):
        return scene.object_units()

    def cull(self, camera: Camera) -> DrawnSet:
        return DrawnSet(self.ids)


@pytest.mark.parametrize("spec", ["exact", "embree", "open3d"])
def test_a_power_of_two_changes_no_verdict(spec):
    every = np.arange(BASE.object_count)
    sets = {"all": every, "most": every[every % 3 > 0], "none": every[:0]}

    def verdicts(power: int):
        factor = 2.0**power
        scene = scene_times(factor)
        cameras = tuple(camera_times(camera, factor) for camera in CAMERAS)
        outcome = Referee(scene, lambda: engine_or_skip(spec, scene)).run(
            CameraPath(cameras), range(len(cameras)), [(n, Draws(ids)) for n, ids in sets.items()]
        )
        return [
            (record.spec, record.status, record.totals, [f.verdict.misses for f in record.frames])
            for record in outcome.cullers
        ]

    def without_lengths(found):
        return [
            (spec, status, totals, [[replace(m, depth=0.0) for m in ms] for ms in misses])
            for spec, status, totals, misses in found
        ]

    expected = without_lengths(verdicts(0))
    assert any(ms for *_, misses in expected for ms in misses)
    for power in (LEAST, -60, 50, 57, 110):
        assert without_lengths(verdicts(power)) == expected


def beside_a_world(power: int) -> Scene:
    """The soup times 2^power, a screw, between two walls of a world of size one."""
    walls = [[x, y, z] for z in (-1, 1) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    count = len(BASE.vertices)
    faces = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]) + count
    return Scene(
        np.concatenate([scene_times(2.0**power).vertices, np.array(walls, np.float32)]),
        np.concatenate([BASE.triangles, faces]).astype(np.int32),
        np.append(BASE.object_offsets, BASE.triangle_count + 4),
        (*BASE.names, "walls"),
    )


@pytest.mark.parametrize("spec", RAYS)
def test_a_scene_of_sizes_that_float32_cannot_hold_at_once_is_refused_by_name(spec):
    for power in (-52, -60, -80, -110):
        with pytest.raises(InputError) as caught:
            engine_or_skip(spec, beside_a_world(power))
        assert "known samples" in str(caught.value)
        assert "part" in caught.value.place
        assert "exact" in caught.value.fix


@pytest.mark.parametrize("spec", RAYS)
def test_a_small_thing_in_a_large_world_is_seen(spec):
    scene = beside_a_world(-20)
    engine, exact = engine_or_skip(spec, scene), make_engine("exact", scene)
    for camera in (camera_times(camera, 2.0**-20) for camera in CAMERAS[:2]):
        np.testing.assert_array_equal(
            engine.frame(camera).buffer.triangle, exact.frame(camera).buffer.triangle
        )


def test_known_samples_are_known():
    """What each ray meets first, in whole numbers, is its triangle or something before it."""
    for seed in range(3):
        scene = random_soup(seed)
        known = known_samples(scene.vertices, scene.triangles)
        assert len(known.primitive) > scene.triangle_count // 2
        for primitive, ray, depth in zip(known.primitive, known.rays, known.depth, strict=True):
            direction = ray[3:].astype(float)
            corners = scene.vertices[scene.triangles[primitive]].astype(float) - ray[:3]
            volumes = [np.linalg.det([direction, corners[i - 2], corners[i - 1]]) for i in range(3)]
            assert min(volumes) > 0 or max(volumes) < 0
            normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
            assert depth == pytest.approx(normal @ corners[0] / (normal @ direction), rel=1e-9)


def test_a_wrong_answer_to_a_known_sample_is_a_miss_and_something_before_it_is_not():
    corners = np.array([[0, 0, 0], [4, 0, 0], [0, 4, 0]], np.float32)
    # The last one lies between the first and the farther of its rays' origins.
    vertices = np.concatenate([corners + np.float32([0, 0, z]) for z in (0, -3, 2)])
    triangles = np.arange(9, dtype=np.int32).reshape(3, 3)
    known = known_samples(vertices, triangles)
    of_first = np.flatnonzero(known.primitive == 0)
    assert len(of_first) == 2
    for answer, wrong in ((0, 0), (-1, 2), (1, 2), (2, 0)):
        given = known.primitive.copy()
        given[of_first] = answer
        assert len(misses(known, given, vertices, triangles)) == wrong


def test_every_size_is_asked_for_evenly():
    sizes = np.repeat([1e-40, 1e-30, 1.0, 1.5, 0.0], [3, 100, 1000, 5, 7])
    vertices = (np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]]) * sizes[:, None, None]).astype("f4")
    triangles = np.arange(3 * len(sizes), dtype=np.int32).reshape(-1, 3)
    chosen = of_each_size(vertices.reshape(-1, 3), triangles, PER_OCTAVE)
    assert np.all(np.diff(chosen) > 0)
    taken = {size: np.count_nonzero(sizes[chosen] == size) for size in (1e-40, 1e-30, 0.0)}
    assert taken == {1e-40: 3, 1e-30: PER_OCTAVE, 0.0: 0}
    ones = chosen[(chosen >= 103) & (chosen < 1108)] - 103
    assert len(ones) == PER_OCTAVE
    assert np.all(np.abs(np.diff(ones) - 1005 / PER_OCTAVE) <= 1.0)


def findings(spec: str, scene: Scene, power: int) -> list[str]:
    cameras = tuple(camera_times(camera, 2.0**power) for camera in CAMERAS)
    outcome = Referee(scene, lambda: engine_or_skip(spec, scene), examine=True).run(
        CameraPath(cameras), range(len(cameras)), [("all", Draws(np.arange(scene.object_count)))]
    )
    return [f.message for f in outcome.findings if f.code is Code.ENGINE_WRONG]


@pytest.mark.parametrize("spec", ["embree", "open3d"])
def test_a_view_whose_rays_round_by_more_than_what_they_look_at_is_a_finding(spec):
    """An orthographic ray starts where the world does, 2^30 screws away."""
    (message,) = findings(spec, beside_a_world(-46), -46)
    assert "known samples, in 3 frames" in message
    assert findings("exact", beside_a_world(-46), -46) == []
    assert findings(spec, beside_a_world(-20), -20) == findings(spec, BASE, 0) == []


@pytest.mark.parametrize("seed", range(4))
def test_a_view_convicts_who_sees_nothing_or_the_farthest_and_nobody_else(seed):
    """A brute force in the library's place."""
    scene = random_soup(seed)

    class Given(EmbreeEngine):
        answer: ClassVar[Callable[[list], int]]

        def _nearest(self, rays):
            if not hasattr(self, "asking"):
                return super()._nearest(rays)
            found = []
            for ray in rays.astype(float):
                hits = []
                for t, ids in enumerate(scene.triangles):
                    corners = (scene.vertices[ids] - self.rebase) * self.scale - ray[:3]
                    volumes = [
                        np.linalg.det([ray[3:], corners[i - 2], corners[i - 1]]) for i in range(3)
                    ]
                    if min(volumes) > 0 or max(volumes) < 0:
                        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
                        depth = normal @ corners[0] / (normal @ ray[3:])
                        hits += [(depth, t)] if depth > 0 else []
                found.append(type(self).answer(sorted(hits)))
            return np.array(found, np.int32)

    engine = Given(scene)
    engine.asking = True
    for camera in CAMERAS:
        Given.answer = staticmethod(lambda hits: hits[0][1])
        wrong, asked = engine.known_wrong(camera)
        assert len(wrong) == 0 < asked
        Given.answer = staticmethod(lambda hits: -1)
        assert len(engine.known_wrong(camera)[0]) == asked
        Given.answer = staticmethod(lambda hits: hits[-1][1])
        assert len(engine.known_wrong(camera)[0]) > 0
