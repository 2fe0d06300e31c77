"""Plug-in cullers with one wrong rule, on small scenes that public bug reports are like: the
command line convicts them, and not the right culler that they start from."""

from __future__ import annotations

import numpy as np
import pytest

from tests.cases.files import add_box, add_rectangle, run, write_path
from tests.support.gltf_files import Gltf
from tests.wrong_cullers import depth, frustum, memory, units
from visref.camera import look_at
from visref.conformance import check_culler, conformance_checks

pytestmark = pytest.mark.slow


@pytest.fixture(params=["embree", "exact"])
def engine(request):
    return request.param


def convicted_of(scene, culler, right, engine):
    """What the verdict says of the wrong culler; the right one has no violation."""
    status, sums = run(scene, right, engine=engine)
    assert (status, sums["missed"], sums["partly_missed"]) == (0, 0, 0)
    status, sums = run(scene, culler, engine=engine)
    assert status == 1
    return sums


def test_floor_whose_corners_are_all_out_of_view_is_missed_by_corners_alone(tmp_path, engine):
    gltf = Gltf()
    add_box(gltf, "floor", (0.0, -1.5, 0.0), (400.0, 0.2, 400.0))
    add_box(gltf, "crate", (0.5, -1.0, -6.0), (0.8, 0.8, 0.8))
    write_path(tmp_path, yfov=1.0)
    scene = gltf.write(tmp_path / "scene.glb")
    sums = convicted_of(scene, frustum.CornersOnly, frustum.Frustum, engine)
    assert (sums["confirmed"], sums["worst"]["object_name"]) == (1, "floor")


def test_wall_that_passes_the_eye_is_missed_where_any_corner_behind_counts(tmp_path, engine):
    gltf = Gltf()
    add_box(gltf, "fence", (1.5, 0.0, -4.0), (0.1, 1.0, 16.0))
    add_box(gltf, "tree", (-1.5, 0.0, -8.0), (1.0, 3.0, 1.0))
    write_path(tmp_path, yfov=1.0)
    scene = gltf.write(tmp_path / "scene.glb")
    sums = convicted_of(scene, frustum.AnyCornerBehind, frustum.Frustum, engine)
    assert (sums["confirmed"], sums["worst"]["object_name"]) == (1, "fence")


def test_slanting_wall_is_missed_by_the_depth_of_its_nearest_point(tmp_path, engine):
    """By straight distance the barn's nearest point lies at depth 7.1; in the image it begins at
    5.7, before the billboard at 6.4."""
    gltf = Gltf()
    add_box(gltf, "barn", (3.5, 0.0, -10.25), (11.0, 2.0, 0.5))
    # Square to the view, and with a lamp near the eye, so that it is asked about first.
    turn = [0.0, -np.sin(np.pi / 8), 0.0, np.cos(np.pi / 8)]
    middle = 6.4 * np.array([1.0, 0.0, -1.0]) / np.sqrt(2.0)
    board = add_rectangle(gltf, "billboard", -30.0, -20.0, 30.0, 20.0, 0.0)
    gltf.json["nodes"][board] |= {"rotation": turn, "translation": middle.tolist()}
    pose = look_at((0.0, 0.0, 0.0), (1.0, 0.0, -1.0))
    write_path(tmp_path, pose, yfov=1.8)
    scene = gltf.write(tmp_path / "scene.glb")
    sums = convicted_of(scene, depth.DepthOfTheNearestByDistance, depth.Depth, engine)
    assert (sums["confirmed"], sums["worst"]["object_name"]) == (1, "barn")


def test_what_the_lens_shift_brings_into_view_is_missed_by_a_symmetric_frustum(tmp_path, engine):
    gltf = Gltf()
    add_box(gltf, "straight on", (0.0, 0.0, -6.0), (0.5, 0.5, 0.5))
    add_box(gltf, "aside", (-5.5, -0.8, -6.0), (0.5, 0.5, 0.5))
    write_path(tmp_path, yfov=0.9, shift_x_px=-48.0, shift_y_px=10.5)
    scene = gltf.write(tmp_path / "scene.glb")
    sums = convicted_of(scene, frustum.ShiftIgnored, frustum.Frustum, engine)
    assert (sums["confirmed"], sums["worst"]["object_name"]) == (1, "aside")


def test_conformance_convicts_the_symmetric_frustum_too():
    checks = [c for c in conformance_checks() if c.name == "beside_the_unshifted_view"]
    (found,) = check_culler(frustum.ShiftIgnored, checks=checks)
    assert not found.ok
    (found,) = check_culler(frustum.Frustum, checks=checks)
    assert found.ok


def test_half_of_a_walls_clusters_lost_is_half_of_its_samples(tmp_path, engine):
    """A wall of 12 by 6 squares of 4 by 6 samples, two squares per cluster."""
    x, y = np.arange(13) * 0.4 - 2.4, np.arange(7) * 0.6 - 1.8
    points = np.array([(a, b, -5.0) for b in y for a in x], "f4")
    corner = (np.arange(6)[:, None] * 13 + np.arange(12)).reshape(-1)
    around = np.stack([corner, corner + 1, corner + 14, corner, corner + 14, corner + 13], axis=1)
    gltf = Gltf()
    wall = gltf.primitive(points, around.astype("u2").reshape(-1))
    gltf.node(mesh=gltf.mesh(wall), name="wall")
    write_path(tmp_path)
    scene = gltf.write(tmp_path / "scene.glb")
    samples = 48 * 36
    sums = convicted_of(scene, units.HalfOfTheClusters, units.Clusters, engine)
    assert (sums["owned_samples"], sums["missed_pixels"]) == (samples, samples // 2)
    assert (sums["missed"], sums["partly_missed"], sums["confirmed"]) == (0, 1, 1)
    assert (sums["missed_units"], sums["drawn"]) == (18, 18)


def test_answer_that_comes_a_frame_late_is_convicted(tmp_path, engine):
    gltf = Gltf()
    add_box(gltf, "house", (0.1, 0.0, -6.0), (3.1, 2.8, 1.0))
    add_box(gltf, "well", (0.0, 0.0, -12.0), (1.0, 1.0, 1.0))
    poses = [look_at((x, 0.0, 0.0), (x, 0.0, -1.0)) for x in (0.0, 6.0)]
    write_path(tmp_path, *poses, yfov=1.0)
    scene = gltf.write(tmp_path / "scene.glb")
    sums = convicted_of(scene, memory.LastAnswer, depth.Depth, engine)
    assert sums["worst"]["object_name"] == "well"
    assert sums["worst"]["frame"] == 1
