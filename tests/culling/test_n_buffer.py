"""N-buffer culling: CPU and GPU decide the same, and calls do not grow with the scene."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.support import strategies
from visref.camera import look_at
from visref.camera_path import CameraPath
from visref.conformance.scenes import box, camera, panel
from visref.conformance.scenes import case as scene_case
from visref.conformance.suite import case
from visref.errors import InputError
from visref_culling.n_buffer import NBufferCulling
from visref_culling.n_buffer.cover import four_squares, one_square
from visref_experiments.n_buffer import coverage, covered_pixels

pytestmark = pytest.mark.gl


def drawn_sets(culler, scene, path):
    culler.prepare(scene)
    found = [sorted(culler.cull(camera).unit_ids.tolist()) for camera in path]
    culler.close()
    return found


@pytest.mark.parametrize("squares", [1, 4])
@pytest.mark.parametrize(
    "name", ["walk_through_a_city", "crowd", "jump_cuts", "odd_viewports", "far_from_the_origin",
             "orthographic_camera", "lens_shift_and_zoom", "huge_depth_range"]
)  # fmt: skip
def test_gpu_draws_what_the_cpu_draws(name, squares):
    scene, path = case(name)
    assert drawn_sets(NBufferCulling(where="gpu", squares=squares), scene, path) == drawn_sets(
        NBufferCulling(squares=squares), scene, path
    )


@pytest.mark.slow
@settings(max_examples=40, derandomize=True, deadline=None, suppress_health_check=list(HealthCheck))
@given(built=strategies.cases(), squares=st.sampled_from([1, 4]), depth=st.sampled_from([24, 32]))
def test_gpu_draws_what_the_cpu_draws_on_scenes_of_hypothesis(built, squares, depth):
    options = {"squares": squares, "depth": depth}
    path = CameraPath(tuple(camera for camera in built.path for _ in range(2)))
    assert drawn_sets(NBufferCulling(where="gpu", **options), built.scene, path) == drawn_sets(
        NBufferCulling(**options), built.scene, path
    )


@pytest.mark.parametrize("where", ["cpu", "gpu"])
def test_a_box_that_gl_could_not_draw_whole_is_looked_up_all_the_same(where):
    """So far beside the image that clipping it as a query box might lose samples at the rim."""
    view = replace(camera((0.0, 0.0, 0.0)), far=1e4)
    wall = panel((-99.0, 99.0), (-99.0, 99.0), -5.0)
    backdrop = panel((-4e6, 4e6), (-9.0, 9.0), -900.0)
    built = scene_case([("wall", wall), ("backdrop", backdrop)], [view] * 3)
    assert drawn_sets(NBufferCulling(where=where), built.scene, built.path)[-1] == [0]
    assert drawn_sets(NBufferCulling(test="query"), built.scene, built.path)[-1] == [0, 1]


@pytest.mark.parametrize("name", ["walk_through_a_city", "crowd"])
def test_hierarchy_draws_no_more_than_testing_every_box(name):
    scene, path = case(name)
    tree = drawn_sets(NBufferCulling(hierarchy=True), scene, path)
    flat = drawn_sets(NBufferCulling(), scene, path)
    for with_tree, without in zip(tree, flat, strict=True):
        assert set(with_tree) <= set(without)


def town(side):
    """side * side boxes before the eye, some behind others."""
    objects = [
        (f"box{x},{z}", box((2 * x, 0, -4 - 3 * z), (2 * x + 1, 1 + z % 3, -3 - 3 * z)))
        for x in range(side)
        for z in range(side)
    ]  # fmt: skip
    view = camera((side, 1.0, 4.0), (side, 1.0, -9.0))
    return scene_case(objects, [view] * 3)


def gl_calls(culler, views):
    """Calls into the GL binding while the frames are culled."""
    calls = []

    def watch(frame, event, function):
        if event == "c_call" and type(getattr(function, "__self__", None)).__module__ == "mgl":
            calls.append(function.__name__)

    sys.setprofile(watch)
    try:
        for view in views:
            culler.cull(view)
    finally:
        sys.setprofile(None)
    return calls


def test_calls_of_the_gpu_path_do_not_depend_on_the_number_of_objects():
    counts = {}
    for where in ("gpu", "cpu"):
        for side in (2, 12):
            built = town(side)
            culler = NBufferCulling(where=where)
            culler.prepare(built.scene)
            views = list(built.path)
            culler.cull(views[0])
            counts[where, side] = len(gl_calls(culler, views[1:]))
            culler.close()
    assert counts["gpu", 2] == counts["gpu", 12] > 10


def test_the_watch_of_gl_calls_sees_what_grows():
    from visref_culling.baselines import SingleQueryCulling

    counts = []
    for side in (2, 12):
        built = town(side)
        culler = SingleQueryCulling()
        culler.prepare(built.scene)
        counts.append(len(gl_calls(culler, list(built.path))))
        culler.close()
    assert counts[0] < counts[1]


def test_draws_are_one_indirect_call_a_class_and_pass():
    built = town(6)
    culler = NBufferCulling(where="gpu")
    culler.prepare(built.scene)
    for view in built.path:
        stats = culler.cull(view).stats
        assert stats.draw_calls == 2
        assert stats.batches == 1
    culler.close()


@pytest.mark.parametrize("where", ["cpu", "gpu"])
@pytest.mark.parametrize("squares", [1, 4])
def test_every_test_costs_as_many_lookups_as_squares(where, squares):
    built = town(6)
    culler = NBufferCulling(where=where, squares=squares)
    culler.prepare(built.scene)
    for view in built.path:
        stats = culler.cull(view).stats
        assert stats.lookups == squares * stats.queries > 0
        assert 0 < stats.queries_passed <= stats.queries
    assert stats.queries_passed < stats.queries
    culler.close()


@pytest.mark.parametrize("where", ["cpu", "gpu"])
def test_a_stale_occluder_is_drawn_once_and_forgotten(where):
    built = town(6)
    view = built.path.cameras[0]
    aside = replace(view, world_from_camera=look_at((6.0, 9.0, 4.0), (6.0, 0.0, -9.0)))
    sets = drawn_sets(NBufferCulling(where=where), built.scene, [aside, aside, view, view, view])
    # From above more is seen than from the street.
    assert set(sets[2]) - set(sets[4])
    assert sets[3] == sets[4]


@pytest.mark.parametrize(
    "options", [{}, {"hierarchy": True}, {"where": "gpu"}, {"test": "query"}], ids=str
)
def test_referee_learns_when_each_unit_was_asked_about(options):
    """Who was seen before is drawn without asking; the others are asked about after that."""
    built = town(6)
    view = built.path.cameras[0]
    aside = replace(view, world_from_camera=look_at((6.0, 9.0, 4.0), (6.0, 0.0, -9.0)))
    culler = NBufferCulling(**options)
    culler.prepare(built.scene)
    first = culler.cull(view)
    assert (first.asked_at == 0).all()
    culler.cull(view)
    remembered = set(culler.cull(view).unit_ids.tolist())
    last = culler.cull(aside)
    occluders = int((last.asked_at == -1).sum())
    assert 0 < occluders < len(last.unit_ids)
    assert set(last.unit_ids[:occluders].tolist()) <= remembered
    assert (last.asked_at[:occluders] == -1).all()
    assert (last.asked_at[occluders:] == occluders).all()
    culler.close()


def test_gpu_refuses_more_units_than_a_storage_block_holds(monkeypatch):
    built = town(2)
    culler = NBufferCulling(where="gpu")
    monkeypatch.setattr(culler.device, "max_block_bytes", 4 * 48 - 1)
    with pytest.raises(InputError, match="4 units"):
        culler.prepare(built.scene)
    culler.close()


def test_first_frame_knows_no_occluders_and_draws_all_in_view():
    built = town(6)
    first, second, *_ = drawn_sets(NBufferCulling(), built.scene, built.path)
    third = drawn_sets(NBufferCulling(), built.scene, built.path)[2]
    assert first == second
    assert len(third) < len(first)


@pytest.mark.parametrize(
    "options",
    [
        {"where": "gpu", "hierarchy": True},
        {"where": "gpu", "test": "query"},
        {"test": "query", "squares": 1},
    ],
)
def test_options_that_contradict_each_other_are_refused(options):
    with pytest.raises(InputError):
        NBufferCulling(**options)


# The coverage figure.


@pytest.mark.parametrize("cover", [one_square, four_squares])
def test_covered_pixels_are_those_of_the_painted_union(cover):
    sizes = np.array([(w, h) for w in range(1, 20) for h in range(1, 20)], np.int32)
    made = cover(np.concatenate([0 * sizes, sizes - 1], axis=1))
    for level, x, y, pixels in zip(*made, covered_pixels(made), strict=True):
        painted = np.zeros((64, 64), bool)
        for left, top in zip(x, y, strict=True):
            painted[top : top + (1 << level), left : left + (1 << level)] = True
        assert painted.sum() == pixels


def test_coverage_is_that_of_the_figures_five_cases():
    """Fig. 3 for every size up to 512, in whole numbers and without our squares."""
    found = coverage(None, None)
    largest, own = 512, (512 * 513 // 2) ** 2
    # One square: 4^k - 4^(k-1) sizes have their longer side in (2^(k-1), 2^k].
    one = 1 + sum(4**k * (4**k - 4 ** (k - 1)) for k in range(1, 10))
    assert found["extra_1"] == (one - own) / own
    four = exact = 0
    for longer in range(1, largest + 1):
        half = max(1, (1 << (longer - 1).bit_length()) // 2)
        for shorter in range(1, longer + 1):
            # Two quadrants by less than half their side: four squares in a row, of half the side.
            side = half if 2 * shorter > half or half == 1 else half // 2
            covered = longer * max(shorter, side)
            sizes = 1 if shorter == longer else 2
            four += sizes * covered
            exact += sizes * (covered == longer * shorter)
    assert found["extra_4"] == (four - own) / own
    assert found["exact_4"] == exact / largest**2
    assert len(found["row_1"]) == len(found["row_4"]) == len(found["heights"]) == 32
