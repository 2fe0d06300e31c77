"""Runs whose parts hang on each other: things come into view, are remembered, and break down."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tests.support.report_runs import PILLAR, WALL, path, scene, triangle_units
from visref.camera_path import CameraPath, Frame
from visref.culler import Culler, DrawnSet, Promise, RasterTolerance
from visref.inputs import Inputs
from visref.recordings.visible_sets import DeclaredRaster
from visref.scene import Scene, Units

FRAMES = 9


class Moving(Culler):
    """What the cullers here have in common: they know what is there."""

    units: Units | None = None

    def prepare(self, scene: Scene) -> Units:
        self.asked: list[str] = []
        self.update(scene)
        return self.units or scene.object_units()

    def update(self, scene: Scene) -> None:
        self.there = np.flatnonzero(~scene.absent).astype(np.int32)

    def cull(self, camera):
        self.asked.append(camera.view)
        return DrawnSet(np.array(self.draw(camera), np.int32))

    def draw(self, camera) -> Sequence[int]:
        return [int(one) for one in self.there]

    def without(self, *objects: int) -> list[int]:
        return [int(one) for one in self.there if one not in objects]


class FrameLate(Moving):
    """Draws what was there a frame ago."""

    memory = 1

    def prepare(self, scene):
        units = super().prepare(scene)
        self.before = self.there
        return units

    def draw(self, camera):
        drawn, self.before = self.before, self.there
        return drawn


class CountsAll(Moving):
    """Leaves something out each third time that it is asked: it remembers all of them."""

    def draw(self, camera):
        return self.without(PILLAR) if len(self.asked) % 3 == 0 else super().draw(camera)


class Forgets(Moving):
    """Leaves out two visible things, the one the more the further the camera is."""

    memory = 0

    def draw(self, camera):
        return self.without(WALL, PILLAR) if camera.eye[0] > 3.5 else self.without(PILLAR)


class FallsOver(Moving):
    """Breaks down in the sixth call, and would in none of a part that forgot the others."""

    def draw(self, camera):
        if len(self.asked) == 6:
            raise RuntimeError("it fell over")
        return self.without(PILLAR)


class FallsOverAtEnd(Moving):
    """Cannot be let go."""

    memory = 0

    def close(self):
        raise RuntimeError("it does not let go")


class Halves(Moving):
    """Leaves out half of the pillar, and of the wall from the middle on."""

    memory = 0
    units = triangle_units()

    def draw(self, camera):
        left_out = {2 * PILLAR} | ({2 * WALL + 1} if camera.eye[0] > 4.5 else set())
        there = set(self.there.tolist())
        return [unit for unit in range(12) if unit not in left_out and unit // 2 in there]


class Greedy(Moving):
    """Promises to draw nothing hidden."""

    memory = 0
    promise = Promise.EXACT


class Jointly(Moving):
    """One set for all views, from which it leaves something out in some frames."""

    joint = True
    memory = 0

    def cull_joint(self, cameras):
        left_out = [PILLAR] if cameras[0].eye[0] % 2 else []
        return DrawnSet(np.array(self.without(*left_out), np.int32))


class Declares(Forgets):
    """Has a rasteriser, the looser the further the camera is, and boxes that are too small, the
    wall's by less from frame to frame."""

    memory = None

    def draw(self, camera):
        self.raster = DeclaredRaster(RasterTolerance(0.001 * (1 + int(camera.eye[0])), 24))
        return super().draw(camera)

    def prepare(self, scene):
        self.scene = scene
        return super().prepare(scene)

    def bounds(self):
        boxes = np.tile([[-1.0] * 3, [1.0] * 3], (6, 1, 1))
        boxes[WALL] = [[-10.0, -10.0, -1.0], [10.0 + len(self.asked), 10.0, 1.0]]
        return boxes


KINDS: dict[str, tuple[type[Culler], ...]] = {
    "objects": (Forgets, FrameLate, CountsAll, Greedy),
    "broken": (FallsOver, FallsOverAtEnd, Declares, Forgets),
    "units": (Halves, Forgets),
    "views": (Jointly, Forgets, Halves),
}


def cullers(kind: str) -> list[tuple[str, Culler]]:
    return [(one.__name__, one()) for one in KINDS[kind]]


def switched(frames: int = FRAMES) -> Inputs:
    """The squares, of which some come and go, with a cut."""
    absent = {"pillar": {0, 1, 4}, "wall": {5, 6}, "hidden": {3}}
    base = path(frames)
    made = []
    for number in base.numbers:
        (camera,) = base.views(number)
        gone = tuple(name for name, when in absent.items() if number in when)
        made.append(Frame((replace(camera, cut=number == 7),), absent=gone))
    return Inputs(scene(), CameraPath(made, source="switched.path.json"), range(frames))


def stereo(frames: int = 5) -> Inputs:
    """Two views a frame, of which the right one is smaller; things come and go."""
    base = path(frames)
    made = []
    for number in base.numbers:
        (camera,) = base.views(number)
        right = replace(camera, view="right", width=24, height=16, ymag=8.0)
        gone = ("pillar",) if number == 1 else ()
        made.append(Frame((replace(camera, view="left"), right), absent=gone))
    return Inputs(scene(), CameraPath(made, source="stereo.path.json"), range(frames))
