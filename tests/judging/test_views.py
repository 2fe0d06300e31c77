"""One drawn set for several views, and one for each: what is counted once, and what twice."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from visref.camera import Camera
from visref.camera_path import CameraPath, Frame
from visref.culler import Culler, DrawnSet, Promise
from visref.engines import make_engine
from visref.judging.referee import Referee
from visref.judging.status import Status
from visref.scene import Scene

SQUARE = np.array([(0, 0, 0), (4, 0, 0), (4, 4, 0), (0, 4, 0)], float)
FACES = np.array([(0, 1, 2), (0, 2, 3)])


def scene() -> Scene:
    """A square on the left and one on the right, and one behind the left one."""
    shifts = {"left": (-4, 0, 0), "right": (4, 0, 0), "hidden": (-4, 0, -1)}
    return Scene.from_objects([(name, SQUARE + shift, FACES) for name, shift in shifts.items()])


def camera(x: float, view: str, size: int = 8) -> Camera:
    """Sees 8 by 8 units about (x, 2), in size by size samples."""
    pose = np.eye(4)
    pose[:3, 3] = x, 2.0, 5.0
    return Camera(pose, size, size, 1.0, 100.0, ymag=4.0, view=view)


# The first view sees the left square alone, in 4 x 4 of 8 x 8 samples; the second, of another
# size, both squares, in 2 x 8 x 4 of 16 x 16: all of right and left, half of each beyond its edge.
WEST, BOTH = camera(-4.0, "west"), camera(2.0, "both", 16)
PATH = CameraPath([Frame((WEST, BOTH)), Frame((WEST, BOTH))])
LEFT, RIGHT, HIDDEN = range(3)


class Draws(Culler):
    name = "draws"

    def __init__(self, *ids: int, joint: bool = True, promise=Promise.CONSERVATIVE) -> None:
        self.ids, self.joint, self.promise = np.array(ids, np.int32), joint, promise

    def cull(self, camera):
        return DrawnSet(self.ids)

    def cull_joint(self, cameras):
        assert [camera.view for camera in cameras] == ["west", "both"]
        return DrawnSet(self.ids)


def judged(culler, engine="exact"):
    made = scene()
    outcome = Referee(made, lambda: make_engine(engine, made)).run(PATH, range(2), [("d", culler)])
    return outcome, outcome.cullers[0]


def owned(view: Camera) -> dict[int, int]:
    """How many samples each square has in a view: in closed form, by its overlap with the image."""
    half, width = 4.0, view.width
    x = (np.arange(width) + 0.5) / width * 2 * half - half + view.world_from_camera[0, 3]
    columns = {LEFT: np.sum((x > -4) & (x < 0)), RIGHT: np.sum((x > 4) & (x < 8))}
    return {index: int(count) * width // 2 for index, count in columns.items()}


@pytest.mark.parametrize("engine", ["exact", "embree"])
def test_a_joint_set_counts_an_object_once_and_its_samples_in_every_view(engine):
    outcome, record = judged(Draws(RIGHT), engine)
    west, both = owned(WEST), owned(BOTH)
    assert west[RIGHT] == 0
    assert west[LEFT] > 0
    assert both[LEFT] > west[LEFT]
    totals = record.totals
    assert (totals.visible, totals.missed, totals.drawn) == (4, 2, 2)
    assert totals.missed_pixels == 2 * (west[LEFT] + both[LEFT])
    assert totals.owned_samples == 2 * (west[LEFT] + both[LEFT] + both[RIGHT])
    assert (totals.superfluous, totals.missed_units) == (0, 2)
    assert [row.view for row in record.frames] == ["", ""]
    for row in record.frames:
        (miss,) = row.verdict.misses
        # The witness is from the view that loses most, and lies in its image.
        assert (miss.object, miss.view, miss.width) == (LEFT, "both", 16)
        assert miss.sample < 16 * 16
        assert miss.samples == west[LEFT] + both[LEFT]
    (told,) = [f for f in outcome.findings if f.code == "MISSED_OBJECT"]
    assert "over 2 frames, worst in frame 0, view 'both'" in told.message


def test_a_set_per_view_counts_an_object_in_each_view_in_which_it_is_seen():
    outcome, record = judged(Draws(RIGHT, joint=False))
    totals = record.totals
    assert (totals.visible, totals.missed, totals.drawn) == (6, 4, 4)
    # The right square is drawn for nothing in the first view.
    assert totals.superfluous == 2
    assert [row.view for row in record.frames] == ["west", "both"] * 2
    (told,) = [f for f in outcome.findings if f.code == "MISSED_OBJECT"]
    assert "over 2 frames" in told.message


def test_superfluous_is_what_shows_in_no_view_that_it_was_drawn_for():
    _, record = judged(Draws(LEFT, RIGHT, HIDDEN))
    assert record.totals.superfluous == 2
    assert record.status is Status.NO_VIOLATION_FOUND
    outcome, record = judged(Draws(LEFT, RIGHT, HIDDEN, promise=Promise.EXACT))
    assert (record.status, record.totals.violations) == (Status.VIOLATION, 2)
    (one,) = record.frames[0].verdict.confirmed_superfluous
    # Examined in both views: all samples that it covers, and it covers what the left one does.
    assert one.samples == owned(WEST)[LEFT] + owned(BOTH)[LEFT]
    (told,) = [f for f in outcome.findings if f.code == "DRAWN_HIDDEN"]
    assert "drawn though hidden in 2 frames" in told.message


def test_a_view_alone_is_judged_as_it_was_without_a_name():
    made = scene()
    plain = CameraPath([replace(BOTH, view="")])
    engine = make_engine("exact", made)
    one = Referee(made, lambda: engine).run(plain, [0], [("d", Draws(RIGHT, joint=False))])
    two = judged(Draws(RIGHT, joint=False))[1].frames[1]
    assert one.cullers[0].frames[0].verdict.counts == two.verdict.counts
