"""A view's clip plane: only hits before it count, decided like near and far, by every engine."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.shares import examples
from visref.camera import Camera, look_at
from visref.engines import make_engine
from visref.errors import InputError
from visref.exact import ExactScene
from visref.exact.ray import Ray, along_ray
from visref.scene import Scene


def owners_in_fractions(scene: Scene, camera: Camera) -> np.ndarray:
    """The owner of each sample by rational arithmetic alone, -1 for none; tied ones by least id."""
    corners = [
        [[Fraction(float(x)) for x in v] for v in scene.vertices[t]] for t in scene.triangles
    ]
    e, f, r, u = (
        [Fraction(float(x)) for x in v]
        for v in (camera.eye, camera.forward, camera.right_step, camera.up_step)
    )
    plane = None if camera.clip_plane is None else [Fraction(x) for x in camera.clip_plane]

    def dot(p, q):
        return sum((x * y for x, y in zip(p, q, strict=True)), Fraction(0))

    def cross(p, q):
        return [p[i - 2] * q[i - 1] - p[i - 1] * q[i - 2] for i in range(3)]

    def minus(p, q):
        return [x - y for x, y in zip(p, q, strict=True)]

    result = np.full((camera.height, camera.width), -1)
    for y in range(camera.height):
        for x in range(camera.width):
            a, b = Fraction(float(camera.column_a[x])), Fraction(float(camera.row_b[y]))
            aside = [a * p + b * q for p, q in zip(r, u, strict=True)]
            origin, direction = e, [p + q for p, q in zip(f, aside, strict=True)]
            if not camera.is_perspective:
                origin, direction = [p + q for p, q in zip(e, aside, strict=True)], f
            best = None
            for t, (p, q, s) in enumerate(corners):
                normal = cross(minus(q, p), minus(s, p))
                steep = dot(normal, direction)
                if steep == 0:
                    continue
                depth = dot(normal, minus(p, origin)) / steep
                if depth < Fraction(camera.near) or depth > Fraction(camera.far):
                    continue
                point = [o + depth * d for o, d in zip(origin, direction, strict=True)]
                if plane is not None and dot(plane[:3], point) + plane[3] < 0:
                    continue
                sides = [
                    dot(normal, cross(minus(two, one), minus(point, one)))
                    for one, two in ((p, q), (q, s), (s, p))
                ]
                if min(sides) >= 0 and (best is None or depth < best):
                    best, result[y, x] = depth, t
    return result


WHOLE = st.integers(-4, 4)


@st.composite
def cases(draw):
    """Triangles with whole corners, so that planes, edges and the clip plane often meet exactly."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    objects = [
        (f"o{i}", rng.integers(-4, 5, (3, 3)) * np.array([1.0, 1.0, 0.5]), np.array([[0, 1, 2]]))
        for i in range(draw(st.integers(1, 7)))
    ]
    normal = draw(st.tuples(WHOLE, WHOLE, WHOLE).filter(any))
    plane = (*map(float, normal), float(draw(WHOLE)))
    pose = np.eye(4)
    pose[:3, 3] = draw(st.tuples(WHOLE, WHOLE, st.integers(3, 6)))
    lens = {"ymag": 4.0} if draw(st.booleans()) else {"yfov": 2.0 * np.arctan(0.75)}
    return Scene.from_objects(objects), Camera(pose, 8, 6, 0.5, 20.0, clip_plane=plane, **lens)


@settings(max_examples=examples(60), deadline=None)
@given(cases())
def test_the_exact_engine_equals_rational_arithmetic(case):
    scene, camera = case
    truth = make_engine("exact", scene).frame(camera)
    np.testing.assert_array_equal(truth.buffer.triangle, owners_in_fractions(scene, camera))


@pytest.mark.parametrize("spec", ["embree", "open3d"])
@settings(max_examples=examples(40), deadline=None)
@given(case=cases())
def test_ray_engines_agree_wherever_float32_lets_them(spec, case):
    """Certain samples alone: those whose neighbourhood of a thousandth of a pixel is of one owner,
    which shifted samples tell, which a plane a thousandth aside leaves as they are, and at which
    the engine meets each triangle alone, without any plane, as it should: not a grazing one that
    is not there."""
    scene, camera = case
    exact = make_engine("exact", scene)
    every = [
        exact.frame(replace(camera, shift_x_px=dx, shift_y_px=dy)).buffer.triangle.copy()
        for dx in (-1e-3, 0.0, 1e-3)
        for dy in (-1e-3, 0.0, 1e-3)
    ]
    for step in (-1e-3, 1e-3):
        a, b, c, d = camera.clip_plane
        every.append(
            exact.frame(replace(camera, clip_plane=(a, b, c, d + step))).buffer.triangle.copy()
        )
    certain = np.all(np.stack(every) == every[4], axis=0)
    engine = make_engine(spec, scene)
    found = engine.frame(camera).buffer.triangle.copy()
    engine.close()
    whole = replace(camera, clip_plane=None)
    for triangle in scene.triangles:
        alone = Scene(scene.vertices, triangle[None], np.array([0, 1]), ("alone",))
        engine = make_engine(spec, alone)
        met = engine.frame(whole).buffer.triangle
        certain &= met == make_engine("exact", alone).frame(whole).buffer.triangle
        engine.close()
    tied = exact.frame(camera).ties.sample
    certain.reshape(-1)[tied] = False
    np.testing.assert_array_equal(found[certain], every[4][certain])


def mirror() -> tuple[Scene, Camera]:
    """A wall behind which the eye stands, and an object before it: a mirror's camera."""
    wall = np.array([(-9, -9, 0), (9, -9, 0), (9, 9, 0), (-9, 9, 0)], float)
    ball = np.array([(-1, -1, -3), (1, -1, -3), (0, 1, -3)], float)
    scene = Scene.from_objects(
        [("wall", wall, np.array([(0, 1, 2), (0, 2, 3)])), ("ball", ball, np.array([(0, 1, 2)]))]
    )
    pose = look_at((0.0, 0.0, 5.0), (0.0, 0.0, 0.0))
    return scene, Camera(pose, 32, 32, 0.1, 100.0, yfov=0.8)


@pytest.mark.parametrize("spec", ["exact", "embree", "open3d"])
def test_what_lies_behind_a_mirror_is_cut_away_and_its_plane_itself_counts(spec):
    scene, camera = mirror()
    seen = make_engine(spec, scene).frame(camera).buffer.triangle
    assert set(np.unique(seen)) == {0, 1}
    # z <= -1: the wall is gone, and the ball is seen through it.
    cut = replace(camera, clip_plane=(0.0, 0.0, -1.0, -1.0))
    seen = make_engine(spec, scene).frame(cut).buffer.triangle
    assert set(np.unique(seen)) == {-1, 2}
    # z <= 0: the wall lies in the plane, and counts.
    at = replace(camera, clip_plane=(0.0, 0.0, -1.0, 0.0))
    assert set(np.unique(make_engine(spec, scene).frame(at).buffer.triangle)) == {0, 1}


def test_a_witness_ray_replays_with_the_plane():
    scene, camera = mirror()
    cut = replace(camera, clip_plane=(0.0, 0.0, -1.0, -1.0))
    ray = Ray.from_definition(cut.definition(), 16, 16)
    corners = scene.vertices[scene.triangles]
    assert [hit.triangle for hit in along_ray(ray, corners)] == [2]
    whole = Ray.from_definition(camera.definition(), 16, 16)
    assert {hit.triangle for hit in along_ray(whole, corners)} > {2}


def test_a_scene_s_own_origin_moves_the_plane_with_the_camera():
    scene, camera = mirror()
    origin = np.array([2.0**20, 0.0, -(2.0**21)])
    far = replace(scene, origin=origin)
    pose = camera.world_from_camera.copy()
    pose[:3, 3] += origin
    plane = (0.0, 0.0, -1.0, -1.0 + float(origin[2]))
    there = replace(camera, world_from_camera=pose, clip_plane=plane)
    near = replace(camera, clip_plane=(0.0, 0.0, -1.0, -1.0))
    np.testing.assert_array_equal(
        make_engine("exact", far).frame(there).buffer.triangle,
        make_engine("exact", scene).frame(near).buffer.triangle,
    )


def test_a_decision_beside_the_others_knows_the_plane_too():
    scene, camera = mirror()
    cut = replace(camera, clip_plane=(0.0, 0.0, -1.0, -1.0))
    owners = ExactScene(scene).decide(cut, np.array([16 * 32 + 16]))
    assert owners.triangles.tolist() == [2]


@pytest.mark.parametrize("plane", [(0.0, 0.0, 0.0, 1.0), (1.0, 0.0, np.nan, 0.0), (1.0, 2.0, 3.0)])
def test_what_is_no_plane_is_refused(plane):
    with pytest.raises(InputError, match="clip_plane"):
        replace(mirror()[1], clip_plane=plane)
