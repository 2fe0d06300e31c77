"""Scenes, their bounds and their units."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.gltf_files import SQUARE, TRIANGLE, TWO
from visref.errors import InputError
from visref.scene import Alpha, Scene, Units, unique_names

ONE = np.array([[0, 1, 2]])


def boxes(*corners: tuple[float, float, float]) -> Scene:
    """An object of one triangle, a unit in size, at each corner."""
    return Scene.from_objects([("part", TRIANGLE + np.array(c), ONE) for c in corners])


@given(st.lists(st.sampled_from(["a", "a#2", "a#3", "b", "b#2", "a#2#2"]), max_size=12))
def test_unique_names_are_unique_and_first_ones_keep_theirs(names):
    result = unique_names(names)
    assert len(set(result)) == len(names)
    for index, (given_name, name) in enumerate(zip(names, result, strict=True)):
        if given_name not in names[:index]:
            assert name == given_name
        else:
            assert name.startswith(given_name + "#")
            assert name not in names


def test_repeats_count_from_two_and_skip_taken_names():
    assert unique_names(["a", "a", "a#2", "a"]) == ("a", "a#3", "a#2", "a#4")


def test_many_repeats_are_named_in_linear_time():
    # Quadratic search would take hours here.
    names = unique_names(["object"] * 300_000)
    assert names[-1] == "object#300000"


def test_from_objects_groups_triangles_by_object_and_counts_vertices_on():
    scene = Scene.from_objects(
        [("a", TRIANGLE, ONE), ("empty", np.zeros((0, 3)), []), ("a", SQUARE, TWO.reshape(-1, 3))]
    )
    assert scene.names == ("a", "empty", "a#2")
    assert scene.object_offsets.tolist() == [0, 1, 1, 3]
    assert scene.triangles.tolist() == [[0, 1, 2], [3, 4, 5], [3, 5, 6]]
    assert scene.object_of_triangle.tolist() == [0, 2, 2]
    assert scene.id_of_name["a#2"] == 2
    assert not scene.one_sided.any()
    assert not scene.has_mask
    assert not scene.has_blend


def test_vertices_are_rounded_to_float32_once():
    value = 0.1 + 1e-9
    scene = Scene.from_objects([("a", TRIANGLE * value, ONE)])
    assert scene.vertices[1, 0] == np.float32(value)


def test_scene_without_objects_is_a_scene():
    scene = Scene.from_objects([])
    assert (scene.object_count, scene.triangle_count) == (0, 0)
    assert scene.bounds.tolist() == scene.core_bounds.tolist() == [[0, 0, 0], [0, 0, 0]]
    assert scene.object_units().count == 0


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e39])
def test_vertex_that_is_not_finite_names_its_object(bad):
    points = TRIANGLE.astype(np.float64)
    points[2, 1] = bad
    with pytest.raises(InputError, match="object 'torn': a vertex is NaN or infinite"):
        Scene.from_objects([("whole", TRIANGLE, ONE), ("torn", points, ONE)])


def test_unused_vertex_that_is_not_finite_is_named_too():
    points = np.concatenate([TRIANGLE, [[np.nan] * 3]])
    with pytest.raises(InputError, match="vertex 3, which no triangle uses"):
        Scene.from_objects([("a", points, ONE)])


@pytest.mark.parametrize("index", [-1, 3])
def test_index_out_of_range_names_its_object(index):
    with pytest.raises(InputError, match=r"object 'bad'\.triangle 0: it names vertex -?\d of 3"):
        Scene.from_objects([("good", TRIANGLE, ONE), ("bad", TRIANGLE, [[0, 1, index]])])
    scene = boxes((0, 0, 0), (1, 1, 1))
    triangles = scene.triangles.copy()
    triangles[1, 2] = index if index < 0 else 6
    with pytest.raises(InputError, match="object 'part#2', triangle 1: it names vertex"):
        replace(scene, triangles=triangles)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"object_offsets": np.array([0, 1])}, "do not span"),
        ({"object_offsets": np.array([0, 1, 1])}, "do not span"),
        ({"object_offsets": np.array([1, 1, 2])}, "do not span"),
        ({"object_offsets": np.array([0, 3, 2])}, "decrease"),
        ({"names": ("a", "a")}, "names repeat"),
        ({"one_sided": np.zeros(1, np.bool_)}, "not one a triangle"),
        ({"alpha": np.zeros(3, np.uint8)}, "not one a triangle"),
    ],
)
def test_arrays_that_do_not_belong_together_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        replace(boxes((0, 0, 0), (1, 1, 1)), **change)


def test_arrays_are_read_only():
    with pytest.raises(ValueError, match="read-only"):
        boxes((0, 0, 0)).vertices[0, 0] = 1.0


def test_bounds_are_exact_and_an_empty_object_has_none():
    scene = Scene.from_objects([("a", TRIANGLE + 3, ONE), ("none", TRIANGLE - 9, [])])
    assert scene.object_bounds[0].tolist() == [[3, 3, 3], [4, 4, 3]]
    assert scene.object_bounds[1].tolist() == [[np.inf] * 3, [-np.inf] * 3]
    # Vertices that no triangle uses do not count.
    assert scene.bounds.tolist() == [[3, 3, 3], [4, 4, 3]]


@pytest.mark.parametrize("count", [2, 9, 10, 11, 500])
def test_one_stray_object_300_km_away_does_not_set_the_scale(count):
    rng = np.random.default_rng(count)
    places = [tuple(p) for p in rng.integers(-50, 50, size=(count, 3)).tolist()]
    places[0] = (-50, -50, -50)
    places[1] = (49, 49, 49)
    stray = boxes(*places[: count // 2], (300_000, 0, 0), *places[count // 2 :])
    assert stray.core_bounds.tolist() == [[-50, -50, -50], [50, 50, 49]]
    assert stray.bounds[1, 0] == 300_001


def test_core_bounds_of_objects_that_belong_together_are_their_bounds():
    for scene in (boxes((5, 5, 5)), boxes((0, 0, 0), (9, 9, 9)), boxes(*[(2, 2, 2)] * 20)):
        assert np.array_equal(scene.core_bounds, scene.bounds)


def test_digest_changes_with_everything_that_a_verdict_depends_on():
    scene = boxes((0, 0, 0), (1, 1, 1))
    moved = scene.vertices.copy()
    moved[0, 0] = np.nextafter(np.float32(0), np.float32(1))
    others = [
        replace(scene, vertices=moved),
        replace(scene, triangles=scene.triangles[:, ::-1]),
        replace(scene, object_offsets=np.array([0, 2, 2])),
        replace(scene, one_sided=np.array([True, False])),
        replace(scene, alpha=np.array([0, Alpha.BLEND], np.uint8)),
        replace(scene, names=("part", "other")),
    ]
    assert len({scene.digest, *(other.digest for other in others)}) == 7
    assert replace(scene, source="elsewhere", notes=(("CODE", "text"),)).digest == scene.digest


def test_units_gather_and_mask_their_triangles():
    units = Units(np.array([0, 2, 2, 5]), np.array([4, 0, 1, 0, 3], np.int32), "box")
    assert units.sizes.tolist() == [2, 0, 3]
    assert units.gather(np.array([2, 0, 1])).tolist() == [1, 0, 3, 4, 0]
    assert units.gather(np.array([], np.int32)).tolist() == []
    assert units.mask(np.array([0]), 6).tolist() == [True, False, False, False, True, False]
    scene = boxes(*[(i, i, i) for i in range(5)])
    units.check(scene, source="test")
    assert scene.bounds_of(units)[2].tolist() == [[0, 0, 0], [4, 4, 3]]


@pytest.mark.parametrize(
    ("offsets", "triangles", "message"),
    [
        ([0, 1], [0, 1], "do not span"),
        ([1, 2], [0, 1], "do not span"),
        ([0, 2, 1, 2], [0, 1], "do not span"),
        ([0, 2], [0, 2], "that the scene lacks"),
        ([0, 2], [-1, 0], "that the scene lacks"),
    ],
)
def test_units_that_do_not_fit_the_scene_are_refused(offsets, triangles, message):
    units = Units(np.array(offsets), np.array(triangles, np.int32))
    with pytest.raises(InputError, match=message):
        units.check(boxes((0, 0, 0), (1, 1, 1)), source="culler x")
