"""A run with 1,500 violations: 300 small things before a wall, each of which each of five cullers
leaves out of one frame, by one of four causes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from tests.support.hand_made import square
from visref.camera import Camera, look_at
from visref.camera_path import CameraPath
from visref.causes.evidence import Evidence
from visref.culler import Culler, DrawnSet
from visref.inputs import Inputs
from visref.judging.causes import CausesFound, Named
from visref.judging.outcome import CullerRecord
from visref.runs import judge_to_folder
from visref.scene import Scene, Units

COLUMNS, ROWS, FRAMES, CULLERS = 20, 15, 12, 5
THINGS = COLUMNS * ROWS
VIOLATIONS = THINGS * CULLERS
CAUSES = ("near-larger", "centre-depth", "old-pose", "list-full")
WALL = THINGS


def name_of(thing: int) -> str:
    return f"floor {thing // COLUMNS}/window {thing}"


def scene() -> Scene:
    things = [
        (name_of(i), *square(5.0 * (i % COLUMNS) + 0.3, 5.0 * (i // COLUMNS) + 0.2, 2.0, 3.4))
        for i in range(THINGS)
    ]
    return Scene.from_objects(
        [*things, ("wall", *square(-20.0, -20.0, 0.0, 150.0))], source="windows.glb"
    )


def path() -> CameraPath:
    cameras = [
        Camera(
            look_at((49.0 + 0.25 * i, 37.0, 20.0), (49.0 + 0.25 * i, 37.0, 0.0)),
            128,
            96,
            near=1.0,
            far=100.0,
            ymag=40.0,
        )
        for i in range(FRAMES)
    ]
    return CameraPath(tuple(cameras), source="walk.path.json")


def frame_of(culler: int, thing: int) -> int:
    """In which a culler leaves a thing out."""
    return (thing * 7 + culler * 5) % FRAMES


class LeavesOut(Culler):
    """Draws all but what its number leaves out of a frame."""

    memory = 0

    def __init__(self, number: int) -> None:
        self._number = number

    def prepare(self, scene: Scene) -> Units:
        return scene.object_units()

    def cull(self, camera: Camera) -> DrawnSet:
        frame = round((camera.eye[0] - 49.0) / 0.25)
        drawn = [i for i in range(THINGS) if frame_of(self._number, i) != frame]
        return DrawnSet(np.array([*drawn, WALL], np.int32))


def name_causes(evidence: Evidence, records: Sequence[CullerRecord], *_: object) -> None:
    """In place of the search, which would not find one."""
    for number, record in enumerate(records):
        named = {
            (frame_of(number, i), "", i): (Named(CAUSES[(i + number) % len(CAUSES)], 0.9),)
            for i in range(THINGS)
        }
        record.causes = CausesFound(dict(sorted(named.items())), frozenset(named))


def many_losses(folder: Path) -> Path:
    """Write the run folder."""
    inputs = Inputs(scene(), path(), range(FRAMES))
    cullers = [(f"engine:way={number}", LeavesOut(number)) for number in range(CULLERS)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("visref.shares.find_causes", name_causes)
        judge_to_folder(inputs, cullers, folder, pictures=2)
    return folder
