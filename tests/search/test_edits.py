"""What an edit leaves alone stays as it was; what it says of the image holds to the last sample."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from visref.camera_path import CameraPath
from visref.conformance.building import box, camera, case, panel
from visref.search import edits
from visref.search.case import Case

NAMES = ("a", "b", "c")


@pytest.fixture
def made() -> Case:
    """Three boxes, of which the last is carried along and absent in the first of three frames."""
    boxes = [
        (name, box((2.0 * k - 2.0, 0.0, -6.0), (2.0 * k - 1.0, 1.3, -5.0)))
        for k, name in enumerate(NAMES)
    ]
    built = case(boxes, [camera((0.1 * k, 0.5, 1.0)) for k in range(3)])
    step = np.eye(4)
    frames = []
    for k, frame in enumerate(built.path.frames):
        step[0, 3] = 0.25 * k
        gone = ("c",) if k == 0 else ()
        frames.append(replace(frame, world_from_object={"c": step.copy()}, absent=gone))
    return Case.of(built.scene, CameraPath(frames))


def corners(made: Case, frame: int, name: str) -> np.ndarray:
    scene = made.inputs().timeline.at(frame)
    index = scene.id_of_name[name]
    return scene.vertices[scene.triangles[slice(*scene.object_offsets[index : index + 2])]]


def rays(made: Case, frame: int) -> np.ndarray:
    """(height, width, 3), the directions of a frame's samples."""
    view = made.path.frames[frame].cameras[0]
    a = 2.0 * np.arange(view.width) + 1.0 - view.width + 2.0 * view.shift_x_px
    b = view.height - 2.0 * np.arange(view.height) - 1.0 - 2.0 * view.shift_y_px
    right, up = a[None, :, None] * view.right_step, b[:, None, None] * view.up_step
    return view.forward + right + up


def test_only_objects_keeps_their_triangles_their_frames_and_no_other_name(made):
    fewer = edits.only_objects(made, {"c", "a"})
    assert fewer.scene.names == ("a", "c")
    for frame in range(3):
        for name in ("a", "c"):
            np.testing.assert_array_equal(corners(fewer, frame, name), corners(made, frame, name))
    rest = edits.only_objects(made, {"a"})
    assert not any(f.world_from_object or f.absent for f in rest.path.frames)


def test_only_triangles_keeps_the_objects_and_the_triangles_with_these_ids(made):
    kept = [1, 2, 14]
    fewer = edits.only_triangles(made, kept)
    assert fewer.scene.names == made.scene.names
    assert np.diff(fewer.scene.object_offsets).tolist() == [2, 1, 0]
    before = made.scene.vertices[made.scene.triangles[kept]]
    np.testing.assert_array_equal(fewer.scene.vertices[fewer.scene.triangles], before)
    assert len(fewer.scene.vertices) == len(np.unique(made.scene.triangles[kept]))


def test_only_frames_keeps_them_in_their_order(made):
    fewer = edits.only_frames(made, [0, 2])
    assert [f.absent for f in fewer.path.frames] == [("c",), ()]
    np.testing.assert_array_equal(corners(fewer, 1, "c"), corners(made, 2, "c"))


def test_stopped_objects_stand_as_in_the_last_frame(made):
    still = edits.stopped(made, {"c"})
    assert not still.moves
    for frame in range(3):
        np.testing.assert_array_equal(corners(still, frame, "c"), corners(made, 2, "c"))


def test_a_cut_out_image_has_the_samples_that_were_there(made):
    view = made.path.frames[1].cameras[0]
    part = edits.cut_out(made, 5, 30, 12, 9)
    np.testing.assert_allclose(rays(part, 1), rays(made, 1)[30:39, 5:17], rtol=0.0, atol=1e-14)
    assert view.width == 64


def test_a_resized_image_looks_at_what_it_looked_at(made):
    small = edits.resized(made, 16, 12)
    # The middle of each new pixel is the middle of four by four old ones.
    middles = rays(made, 0).reshape(12, 4, 16, 4, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(rays(small, 0), middles, rtol=0.0, atol=1e-14)


@pytest.mark.parametrize("turned", [True, False])
def test_moved_to_the_eye_every_distance_is_what_it_was(made, turned):
    there = edits.each_camera(made, lambda c: replace(c, clip_plane=(0.0, 0.6, 0.8, 2.0)))
    moved = edits.to_the_eye(there, turned=turned)
    last = moved.path.frames[-1].cameras[0]
    assert last.world_from_camera[:3, 3].tolist() == [0.0, 0.0, 0.0]
    for frame in range(3):
        before, after = (one.path.frames[frame].cameras[0] for one in (there, moved))
        for name in set(NAMES) - set(there.path.frames[frame].absent):
            old, new = corners(there, frame, name), corners(moved, frame, name)
            # A float32 vertex below 8 moves by at most 2^-22 each time that it is rounded.
            np.testing.assert_allclose(
                np.linalg.norm(new - after.eye, axis=-1), np.linalg.norm(old - before.eye, axis=-1),
                rtol=0.0, atol=4 * 2.0**-22,
            )  # fmt: skip
            np.testing.assert_allclose(
                new @ np.array(after.clip_plane[:3]) + after.clip_plane[3],
                old @ np.array(before.clip_plane[:3]) + before.clip_plane[3],
                rtol=0.0, atol=4 * 2.0**-22,
            )  # fmt: skip


def test_a_camera_that_is_aimed_looks_where_the_middle_of_its_shifted_image_was(made):
    shifted = edits.with_lens(made, {"shift_x_px": 20.0, "shift_y_px": -7.0})
    view = edits.aimed(shifted).path.frames[0].cameras[0]
    assert (view.shift_x_px, view.shift_y_px) == (0.0, 0.0)
    middle = rays(shifted, 0).mean(axis=(0, 1))
    np.testing.assert_allclose(view.forward, middle / np.linalg.norm(middle), atol=1e-14)
    assert math.isclose(view.right_step @ view.up_step, 0.0, abs_tol=1e-15)


def test_rounded_vertices_are_short_and_those_that_are_kept_are_as_they_were():
    built = case([("a", panel((-0.123, 1.456), (0.0, 0.77), -5.56))], [camera()])
    made = Case.of(built.scene, built.path)
    assert edits.not_so_short(made, 2).tolist() == [0, 1, 2, 3]
    rough = edits.rounded_vertices(made, 1, {2})
    assert rough.scene.vertices[2].tolist() == made.scene.vertices[2].tolist()
    assert rough.scene.vertices[0].tolist() == np.float32([-0.1, 0.0, -5.6]).tolist()
    assert edits.not_so_short(rough, 1).tolist() == [2]
