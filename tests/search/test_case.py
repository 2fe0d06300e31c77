"""A case is what a run judged, whatever moved there, and its two files say it exactly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from visref.camera_path import CameraPath, Frame
from visref.conformance.building import box, camera, case
from visref.conformance.scenes import SCENES
from visref.errors import InputError
from visref.search import edits
from visref.search.case import Case, starts_of
from visref.timeline import Timeline

BUILD = {maker.name: maker.build for maker in SCENES}
# Still, masked, glassy, one-sided, far out, with two views; carried, absent, and deformed.
NAMES = (
    "glass", "through_the_holes_of_a_mask", "masks_behind_masks", "one_sided_walls",
    "about_an_origin_of_its_own", "objects_without_triangles", "cut_by_a_plane", "two_views",
    "sliding_door", "carried_about", "turning_about", "appearing_and_vanishing", "bending_reeds",
    "two_views_of_a_changing_city",
)  # fmt: skip


def laid(name: str) -> tuple[Timeline, Case]:
    built = BUILD[name](np.random.default_rng(0))
    path = built.path.relative_to(built.scene.origin)
    return Timeline(built.scene, path), Case.of(built.scene, built.path)


def corners(timeline: Timeline, frame: int) -> np.ndarray:
    """(t, 3, 3) float64, where the triangles of a frame are; NaN for what is absent."""
    scene = timeline.at(frame)
    result = scene.vertices.astype(np.float64)[scene.triangles] + scene.origin
    result[timeline.absent(frame)[scene.object_of_triangle]] = np.nan
    return result


@pytest.mark.parametrize("name", NAMES)
def test_a_case_has_each_frame_s_triangles_where_they_were(name):
    before, made = laid(name)
    inputs = made.inputs()
    for frame in made.path.numbers:
        # In the order of corners too, which says what faces where.
        np.testing.assert_array_equal(corners(inputs.timeline, frame), corners(before, frame))


@pytest.mark.parametrize("name", NAMES)
def test_what_its_files_say_is_the_same_case(name):
    _, made = laid(name)
    assert made.files() == made.files()
    assert made.read_back().digest == made.digest
    assert made.read_back().files() == made.files()


def test_a_case_that_differs_anywhere_has_another_digest():
    built = case([("a", box((0, 0, -5), (1, 1, -4))), ("b", box((2, 0, -5), (3, 1, -4)))],
                 [camera()])  # fmt: skip
    made = Case.of(built.scene, built.path)
    scene = made.scene
    moved = scene.vertices.copy()
    moved[3, 1] = np.nextafter(moved[3, 1], np.float32(9))
    view = built.path.frames[0].cameras[0]
    others = [
        replace(made, scene=replace(scene, vertices=moved)),
        replace(made, scene=replace(scene, one_sided=~scene.one_sided)),
        replace(made, scene=replace(scene, names=("a", "c"))),
        replace(made, path=CameraPath([replace(view, near=0.2)])),
        replace(made, path=CameraPath([view, view])),
        replace(made, cull_backfaces=False),
    ]
    assert len({made.digest, *(other.digest for other in others)}) == 1 + len(others)


def test_objects_vertices_start_where_their_triangles_use_them():
    built = BUILD["objects_without_triangles"](np.random.default_rng(0))
    made = Case.of(built.scene, built.path)
    starts = starts_of(made.scene)
    for index in range(made.scene.object_count):
        part = slice(*made.scene.object_offsets[index : index + 2])
        used = np.unique(made.scene.triangles[part])
        assert used.tolist() == list(range(starts[index], starts[index + 1]))


def test_a_scene_of_no_object_has_no_files():
    built = BUILD["empty_scene"](np.random.default_rng(0))
    with pytest.raises(InputError):
        Case.of(built.scene, built.path).files()


def equal_names(*names: str) -> Case:
    """A row of boxes with these names."""
    row = [(n, box((2 * k, 0, -5), (2 * k + 1, 1, -4))) for k, n in enumerate(names)]
    built = case(row, [camera()])
    return Case.of(built.scene, built.path)


def test_names_that_repeat_stay_as_they_were_given_in_its_files_too():
    made = equal_names("a", "b", "a", "a")
    assert made.scene.names == ("a", "b", "a#2", "a#3")
    for one in (made, made.read_back()):
        assert one.inputs().scene.given_names == ("a", "b", "a", "a")
    assert made.read_back().digest == made.digest
    assert edits.told_apart(made).digest != made.digest
    # A file that has less still has the same names, or each its own.
    for kept, given in (
        ({"a", "a#2"}, ("a", "a")),
        ({"a", "a#3"}, ("a", "a#3")),
        ({"b", "a#2"}, ("b", "a#2")),
    ):
        less = edits.only_objects(made, kept)
        assert set(less.scene.names) == kept
        assert less.read_back().scene.given_names == given
        assert less.read_back().digest == less.digest


def test_what_a_path_names_has_a_name_of_its_own():
    made = equal_names("a", "a")
    path = CameraPath([Frame(made.path.frames[0].cameras, absent=("a#2",))])
    assert Case.of(made.scene, path).scene.given_names == ("a", "a")
    path = CameraPath([Frame(made.path.frames[0].cameras, absent=("a",))])
    told = Case.of(edits.told_apart(made).scene, path)
    assert told.scene.given_names == ("a", "a#2")
    assert told.read_back().digest == told.digest
