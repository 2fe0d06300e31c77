"""A fault's picture: what the last frame shows, and which of its samples are wrong.

A shrunk frame has a few dozen samples. Beside them stands the same view at more, or nobody would
know what he looks at.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from visref.camera import Camera
from visref.culler import Culler, DrawnSet
from visref.judging.asking import Job
from visref.judging.frame import SettledFrame
from visref.judging.referee import JudgedFrame
from visref.run_folder.colours import MISSED_RGB
from visref.run_folder.read import read_run
from visref.runs import judge_to_folder
from visref.scene import Scene, Units
from visref.search import edits
from visref.search.case import Case
from visref.search.judging import Kind, Violation
from visref.visibility import FrameTruth, ObjectVisibility

# Panels are at least so wide.
_WIDTH_PX = 480
_GAP_PX = 12
# A cross fits on a sample that is drawn so large.
_CROSSED_PX = 24
_NOTHING_RGB = (236, 236, 232)
# Okabe and Ito's colours but vermilion, which is for what is wrong; paled towards white.
_OBJECTS_RGB = ((0, 114, 178), (230, 159, 0), (0, 158, 115), (204, 121, 167), (86, 180, 233),
                (240, 228, 66))  # fmt: skip


class LastFrame:
    """A run's listener that keeps what the verdict on one frame rests on: per view, what was
    settled."""

    def __init__(self, frame: int) -> None:
        self._frame = frame
        self.settled: list[SettledFrame] = []

    def on_truth(self, frame: int, truth: FrameTruth, seen: ObjectVisibility, ms: float) -> None:
        pass

    def on_verdict(self, job: Job, judged: JudgedFrame) -> None:
        if judged.record.frame == self._frame:
            for one in judged.settled:
                # The engine's arrays change with its next frame.
                self.settled.append(replace(one, truth=one.truth.copy()))

    def on_frame_done(self, frame: int) -> None:
        pass


def draw(case: Case, violation: Violation, last: LastFrame, file: Path) -> None:
    """Left the last frame's view at more samples; right each sample in the colour of the object
    that owns it, those that are wrong in vermilion: lost, or covered by what was drawn for
    nothing, with a mark at the witness."""
    views = [one.truth.camera.view for one in last.settled]
    settled = last.settled[views.index(violation.seen_in) if violation.seen_in in views else 0]
    camera = settled.truth.camera
    times = max(1, -(-_WIDTH_PX // camera.width))
    size = (camera.width * times, camera.height * times)
    samples = Image.fromarray(_samples(settled, violation))
    sheet = Image.new("RGB", (2 * size[0] + _GAP_PX, size[1]), (255, 255, 255))
    sheet.paste(_at_more_samples(case, camera, times).resize(size))
    right = samples.resize(size, Image.Resampling.NEAREST)
    if violation.x >= 0:
        _mark(right, violation, times)
    sheet.paste(right, (size[0] + _GAP_PX, 0))
    sheet.save(file, optimize=True)


def _samples(settled: SettledFrame, violation: Violation) -> NDArray[np.uint8]:
    """(height, width, 3) uint8."""
    scene, truth = settled.scene, settled.truth
    owner = truth.buffer.triangle
    colours = np.array(_OBJECTS_RGB, np.float64)
    colours = 255.0 - 0.55 * (255.0 - colours)
    picture = np.empty((*owner.shape, 3), np.uint8)
    picture[:] = _NOTHING_RGB
    there = owner >= 0
    picture[there] = colours[scene.object_of_triangle[owner[there]] % len(colours)]
    flat = picture.reshape(-1, 3)
    if violation.kind is not Kind.SUPERFLUOUS:
        flat[settled.walk.lost_samples] = MISSED_RGB
    elif violation.x >= 0:
        flat[violation.y * truth.camera.width + violation.x] = MISSED_RGB
    return picture


def _mark(picture: Image.Image, violation: Violation, times: int) -> None:
    """A cross on the sample of the witness, or a frame about one that a cross would hide."""
    x, y = (violation.x + 0.5) * times, (violation.y + 0.5) * times
    pen = ImageDraw.Draw(picture)
    if times < _CROSSED_PX:
        arm = times / 2.0 + 4.0
        pen.rectangle([(x - arm, y - arm), (x + arm, y + arm)], outline=(0, 0, 0), width=3)
        return
    arm = times / 3.0
    for up in (-arm, arm):
        pen.line([(x - arm, y - up), (x + arm, y + up)], fill=(0, 0, 0), width=3)


class _All(Culler):
    """Draws everything: for pictures of the scene alone."""

    name = "all"

    def prepare(self, scene: Scene) -> Units:
        self._count = scene.object_count
        return scene.object_units()

    def update(self, scene: Scene) -> None:
        pass

    def cull(self, camera: Camera) -> DrawnSet:
        return DrawnSet(np.arange(self._count, dtype=np.int32))


def _at_more_samples(case: Case, camera: Camera, times: int) -> Image.Image:
    """The view of the last frame with so many times as many samples along each side."""
    last = edits.only_frames(case, [len(case.path) - 1])
    views = [one.view for one in last.path.frames[0].cameras]
    if camera.view in views:
        last = edits.only_views(last, [camera.view])
    inputs = edits.resized(last, camera.width * times, camera.height * times).inputs()
    with tempfile.TemporaryDirectory(prefix="visref-picture-") as name:
        run = Path(name) / "run"
        judge_to_folder(inputs, [("all", _All())], run, pictures=1)
        (picture,) = read_run(run).manifest.pictures
        return Image.open(run / picture.files["picture"]).convert("RGB")
