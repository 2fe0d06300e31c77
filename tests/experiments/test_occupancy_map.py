"""What is measured of the occupancy map is what its names say; how long it took is not asserted."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests.support.culling_scenes import box, perspective, quad
from visref.camera_path import CameraPath
from visref.scene import Scene
from visref_culling.baselines import SingleQueryCulling
from visref_culling.occupancy_map import OccupancyMapCulling
from visref_datasets_gen.solids import torus
from visref_experiments import occupancy_map, occupancy_map_scenes
from visref_experiments.occupancy_map_scenes import Levels, detail, turns


def scene() -> Scene:
    rng = np.random.default_rng(3)
    objects = [("wall", *quad((-3, -3), (3, 3), -5.0))]
    objects += [
        (f"b{i}", *box(tuple(rng.uniform(-1, 1, 3) * (5, 4, 3.5) - (0, 0, 6)), 0.4))
        for i in range(40)
    ]
    return Scene.from_objects(objects)


PATH = CameraPath((perspective(160, 120), perspective(200, 90)))


@pytest.mark.gl
def test_turns_keep_each_methods_own_counts_frame_by_frame() -> None:
    found = json.loads(json.dumps(turns(scene(), PATH)))
    assert set(found["methods"]) == {"single", "map", "multiple", "thread"}
    for name, culler in (
        ("single", SingleQueryCulling()),
        ("map", OccupancyMapCulling(maps=1)),
        ("multiple", OccupancyMapCulling()),
        ("thread", OccupancyMapCulling(thread=True)),
    ):
        culler.prepare(scene())
        stats = [culler.cull(camera).stats for camera in PATH.cameras]
        culler.close()
        method = found["methods"][name]
        for counter in ("queries", "batches", "triangles_drawn", "tests_skipped"):
            assert method[counter] == [getattr(one, counter) or 0 for one in stats]
        for measure in ("frame_ms", "processor_ms", "query_ms"):
            assert len(method[measure]) == 2
            assert min(method[measure]) > 0.0
    drawn = found["methods"]["single"]["triangles_drawn"]
    assert all(a >= b for a, b in zip(found["triangles_in_view"], drawn, strict=True))
    assert max(found["triangles_in_view"]) <= scene().triangle_count


@pytest.mark.parametrize("methods", ["ab", "abcd"])
def test_turns_put_every_method_in_every_place(methods: str) -> None:
    turn = range(len(methods))
    orders = [occupancy_map_scenes._rotated(list(methods), by) for by in turn]
    assert [set(places) for places in zip(*orders, strict=True)] == [set(methods) for _ in turn]


def ring(fine: float) -> tuple[np.ndarray, np.ndarray]:
    """A torus around (0, 0, -8), up to 3 from there."""
    vertices, faces = torus(2.0, 1.0, fine)
    return vertices - (0.0, 0.0, 8.0), faces


def test_levels_are_the_coarsest_with_enough_triangles() -> None:
    levels = Levels(Scene.from_objects([("ring", *ring(1.0)), ("few", *box((9, 0, -5), 1.0))]))
    assert levels.sizes[0].tolist() == [len(ring(1.0)[1]), 12]
    assert (levels.sizes[1:, 1] == 12).all()  # too few to have levels
    full, quarter, sixteenth = levels.sizes[:, 0].tolist()
    assert full > quarter > sixteenth > 24
    for wanted, level in ((full + 1, 0), (full, 0), (quarter, 1), (sixteenth, 2), (0, 2)):
        assert levels.coarsest(np.array([wanted, 0.0]))[0] == level
    mixed = levels.mixed(np.array([0]), np.array([2, 0]))
    assert np.diff(mixed.object_offsets).tolist() == [sixteenth, 0]
    whole = levels.scene.object_bounds[0]
    assert np.abs(mixed.object_bounds[0] - whole).max() < 0.5


@pytest.mark.gl
def test_detail_leaves_fewer_triangles_and_changes_more_samples_the_coarser_it_is() -> None:
    far = CameraPath((perspective(600, 450), perspective(60, 45)))
    found = detail(Scene.from_objects([("ring", *ring(3.0))]), far)
    count = len(ring(3.0)[1])
    assert found["triangles"] == count
    left, changed = found["triangles_left"], found["samples_changed"]
    assert sorted(left, reverse=True) == left
    assert left[-1] < left[0] <= count
    assert sorted(changed) == changed
    assert 0.0 <= changed[0] < changed[-1] < 0.2


@pytest.mark.gl
def test_levels_that_are_the_scene_itself_change_no_sample(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(occupancy_map_scenes, "REDUCTIONS", (1, 1))
    found = detail(scene(), PATH)
    assert found["samples_changed"] == [0.0] * 3
    assert found["triangles_left"] == [found["triangles"]] * 3


@pytest.mark.gl
def test_lookups_and_queries_are_of_the_same_boxes(monkeypatch: pytest.MonkeyPatch) -> None:
    """A lookup of a box finds all its tiles set, so as many as its pixels need."""
    monkeypatch.setattr(occupancy_map, "ROUNDS", 1)
    monkeypatch.setattr(occupancy_map, "BOXES", 16)
    monkeypatch.setattr(occupancy_map, "WAYS", {"sync": 2})
    found = occupancy_map.latency(None, None)
    for key in ("lookup_ms", "bits_ms", "culled_ms", "unculled_ms"):
        assert len(found[key]) == len(found["sizes_px"])
    asker = occupancy_map._Asker()
    full = occupancy_map._full()
    grid, projection = occupancy_map._lookup_of(asker.view)
    for size in (8, 1000):
        box_ = asker.bounds(size)
        for bits_only in (False, True):
            arguments = (box_, projection, grid, 5, bits_only)
            assert occupancy_map._look_up_boxes(full, *arguments) == 5
            assert occupancy_map._look_up_boxes(full * 0, *arguments) == 0
            # One tile unset in the box's middle, and one beside it.
            holed, beside = full.copy(), full.copy()
            holed[64 * 4 + 2] = 0
            beside[0] = 0
            assert occupancy_map._look_up_boxes(holed, *arguments) == 0
            assert occupancy_map._look_up_boxes(beside, *arguments) == 5
    asker.queries.release()
