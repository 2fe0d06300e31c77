"""Labels whose values are known beforehand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.labels.test_silhouettes import labelled
from tests.support.truth_scenes import Part, build, quad
from visref.camera import Camera
from visref.scene import Alpha

CAMERA = Camera(np.eye(4), 32, 24, near=0.5, far=100.0, yfov=1.0)
FLAT = Camera(np.eye(4), 32, 24, near=0.5, far=100.0, ymag=6.0)


@pytest.mark.parametrize("camera", [CAMERA, FLAT], ids=["perspective", "orthographic"])
def test_two_squares_that_overlap_by_half(camera):
    scene = build(quad(camera, (4, 4, 12, 12), 5.0), quad(camera, (8, 4, 16, 12), 3.0))
    labels = labelled(scene, camera)
    assert labels.silhouette_samples.tolist() == [64, 64]
    assert labels.visible_samples.tolist() == [32, 64]
    assert labels.visibility_fraction.tolist() == [0.5, 1.0]
    assert labels.in_view_fraction.tolist() == [1.0, 1.0]
    assert labels.undecided_fraction.tolist() == [0.0, 0.0]
    assert labels.visible_box.tolist() == [[4, 4, 8, 12], [8, 4, 16, 12]]
    assert labels.amodal_box.tolist() == [[4, 4, 12, 12], [8, 4, 16, 12]]
    assert labels.occluders.tolist() == [[0, 1, 32]]
    assert labels.depth == pytest.approx([5.0, 3.0], rel=2.0**-20)


def disc(camera: Camera, x: float, y: float, radius: float, depth: float) -> Part:
    """64 corners, symmetric about the pixel border x to the last bit where x is the middle."""
    turn = np.exp(2j * np.pi * (np.arange(16) + 0.5) / 64)
    quarter = np.stack([turn.real, turn.imag], axis=1)
    around = np.concatenate(
        [quarter, quarter[::-1] * [-1, 1], quarter * [-1, -1], quarter[::-1] * [1, -1]]
    )
    flat = quad(camera, (x - radius, y - radius, x + radius, y + radius), depth).points
    middle, right, up = flat.mean(axis=0), (flat[1] - flat[0]) / 2, (flat[3] - flat[0]) / 2
    points = middle + around[:, :1] * right + around[:, 1:] * up
    return Part(points, np.array([[0, i, i + 1] for i in range(1, 63)]))


def test_disc_behind_a_wall_up_to_its_middle_shows_by_half():
    scene = build(disc(CAMERA, 16, 12, 9.25, 6.0), quad(CAMERA, (0, 0, 16, 24), 2.0))
    labels = labelled(scene, CAMERA)
    # Pixel centres in the circle, which none is near to.
    y, x = np.mgrid[:24, :32]
    away = np.hypot(x - 15.5, y - 11.5)
    assert np.abs(away - 9.25).min() > 9.25 * (1 - np.cos(np.pi / 64))
    assert labels.silhouette_samples[0] == (away < 9.25).sum()
    assert labels.visibility_fraction[0] == 0.5
    assert labels.occluders.tolist() == [[0, 1, (away < 9.25).sum() // 2]]
    assert labels.amodal_box[0].tolist() == [7, 3, 25, 21]
    assert labels.visible_box[0].tolist() == [16, 3, 25, 21]


def test_what_is_partly_out_of_view_is_counted_beyond_the_image():
    boxes = {
        "left": (-8, 2, 8, 10),
        "right and below": (24, 20, 40, 28),
        "all around": (-4, -4, 36, 28),
        "outside": (40, 2, 50, 10),
    }
    depths = [3.0, 4.0, 9.0, 3.0]
    scene = build(*(quad(CAMERA, box, d) for box, d in zip(boxes.values(), depths, strict=True)))
    labels = labelled(scene, CAMERA)
    assert labels.silhouette_samples.tolist() == [64, 32, 32 * 24, 0]
    assert labels.in_view_fraction.tolist() == [0.5, 0.25, 32 * 24 / (40 * 32), 0.0]
    assert labels.amodal_box.tolist() == [*map(list, list(boxes.values())[:3]), [0] * 4]
    assert labels.visible_box[1].tolist() == [24, 20, 32, 24]
    assert np.isnan(labels.visibility_fraction[3])
    assert np.isnan(labels.depth[3])


def test_silhouette_is_clipped_at_near_and_not_counted_beyond():
    far, near = 8.0, CAMERA.near
    # A floor from behind the eye to `far`, and one that begins at near, to the last bit.
    floor = Part(
        np.array([[-1, -1, 2], [1, -1, 2], [1, -1, -far], [-1, -1, -far]], float),
        np.array([[0, 1, 2], [0, 2, 3]]),
    )
    at_near = Part(
        np.array([[-1, 1, -near], [1, 1, -near], [1, 1, -far], [-1, 1, -far]], float), floor.faces
    )
    just_nearer = replace(at_near, points=at_near.points.copy())
    just_nearer.points[0, 2] = -np.nextafter(np.float32(near), np.float32(0))
    labels = labelled(build(floor, at_near, just_nearer), CAMERA)
    assert np.isnan(labels.in_view_fraction[0])
    assert np.isnan(labels.in_view_fraction[2])
    # The floor's rows: those whose rays are 1 below the eye before `far`.
    step = np.tan(0.5) / 24
    below = -CAMERA.row_b * step
    rows = np.flatnonzero((below > 0) & (1 / np.where(below > 0, below, 1) <= far))
    assert labels.amodal_box[0, 1] == rows[0]
    assert labels.amodal_box[0, 3] == 24
    # What begins at near reaches 1 / (2 near step) = 43.9 rows above the middle.
    assert labels.amodal_box[1, 1] == 12 - int(1 / (2 * near * step) - 0.5 + 1)
    assert 0.0 < labels.in_view_fraction[1] < 1.0


def test_edges_on_pixel_centres_belong_to_the_object():
    # From centre to centre: nine by nine, not eight by eight.
    scene = build(quad(FLAT, (4.5, 4.5, 12.5, 12.5), 5.0))
    labels = labelled(scene, FLAT)
    assert labels.silhouette_samples.tolist() == [81]
    assert labels.amodal_box.tolist() == [[4, 4, 13, 13]]


def test_ties_count_for_each_and_hide_for_each():
    same = quad(FLAT, (4, 4, 12, 12), 4.0)
    scene = build(same, same, quad(FLAT, (4, 4, 12, 16), 8.0))
    labels = labelled(scene, FLAT)
    assert labels.visible_samples.tolist() == [64, 64, 32]
    assert labels.visibility_fraction.tolist() == [1.0, 1.0, 1 / 3]
    assert labels.occluders.tolist() == [[2, 0, 64], [2, 1, 64]]


def test_glass_is_labelled_by_its_seen_samples_and_hides_nothing():
    glass = quad(FLAT, (4, 4, 12, 12), 4.0, alpha=Alpha.BLEND)
    wall = quad(FLAT, (8, 0, 20, 20), 6.0)
    behind = quad(FLAT, (4, 4, 12, 12), 8.0, alpha=Alpha.BLEND)
    labels = labelled(build(glass, wall, behind), FLAT)
    assert labels.visible_samples.tolist() == [64, 240, 32]
    assert labels.silhouette_samples.tolist() == [64, 240, 64]
    assert labels.occluders.tolist() == [[2, 1, 32]]
    assert labels.visible_box[2].tolist() == [4, 4, 8, 12]


def test_undecided_samples_count_for_none_and_are_told():
    # A mask that nobody can look up is in between everywhere.
    veil = quad(FLAT, (4, 4, 12, 12), 4.0, alpha=Alpha.MASK)
    labels = labelled(build(veil, quad(FLAT, (4, 4, 12, 20), 6.0)), FLAT)
    assert labels.silhouette_samples.tolist() == [0, 128]
    assert labels.visible_samples.tolist() == [0, 64]
    assert labels.undecided_fraction.tolist() == [1.0, 0.5]
    assert labels.visibility_fraction[1] == 0.5
    assert not len(labels.occluders)


def test_occluders_come_by_share_then_by_id():
    scene = build(
        quad(FLAT, (0, 0, 16, 16), 9.0),
        quad(FLAT, (0, 0, 4, 4), 3.0),
        quad(FLAT, (4, 0, 12, 4), 3.0),
        quad(FLAT, (0, 4, 4, 8), 3.0),
    )
    labels = labelled(scene, FLAT)
    assert labels.occluders.tolist() == [[0, 2, 32], [0, 1, 16], [0, 3, 16]]


def test_objects_without_triangles_and_absent_ones():
    scene = build(quad(FLAT, (4, 4, 12, 12), 4.0), quad(FLAT, (4, 4, 12, 12), 6.0))
    empty = replace(
        scene,
        object_offsets=np.array([0, 2, 2, 4]),
        names=("front", "empty", "back"),
        given_names=(),
        paths=(),
    )
    labels = labelled(empty, FLAT)
    assert labels.silhouette_samples.tolist() == [64, 0, 64]
    assert np.isnan(labels.in_view_fraction[1])
    assert labels.visibility_fraction[2] == 0.0
    gone = replace(empty, absent=np.array([True, False, False]))
    labels = labelled(gone, FLAT)
    assert labels.there.tolist() == [False, True, True]
    assert labels.visibility_fraction[2] == 1.0
