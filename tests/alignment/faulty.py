"""Recordings of the suite's wrong cullers along its own cases: right inputs, wrong engines."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tests.wrong_cullers import RIGHT, WRONG
from visref.camera_path import CameraPath
from visref.conformance import case
from visref.conformance.scenes import SCENES
from visref.culler import Culler
from visref.recordings.visible_sets import VisibleSets
from visref.scene import Scene
from visref.timeline import Timeline

# Engines whose answers are to the last object those of a sound engine on other inputs: what they
# draw cannot tell which of both it is, and the message says both.
LIKE_AN_INPUT = {
    "last-answer",
    "last-frustum",
    "aspect-ignored",
    "aspect-inverted",
    "horizontal-field-of-view",
    "shift-x-reversed",
    "shift-y-reversed",
    "numbers-off-by-one",
    "answers-shifted",
    "answer-of-the-other-view",
    "winding-reversed",
}


def recorded(make: type[Culler], scene: Scene, path: CameraPath) -> tuple[Timeline, VisibleSets]:
    """What a culler draws along a path. Raises whatever the culler does, and ValueError where it
    does not follow what moves."""
    timeline = Timeline(scene, path)
    culler = make()
    try:
        if timeline.moves and not culler.moves:
            raise ValueError("a static culler")
        units, met, sets = culler.prepare(timeline.still), timeline.still, {}
        for number in path.numbers:
            now = timeline.at(number)
            if now is not met:
                culler.update(now)
                met = now
            views = path.views(number)
            drawn = (
                {"": culler.cull_joint(views)}
                if culler.joint and len(views) > 1
                else {camera.view: culler.cull(camera) for camera in views}
            )
            sets[number] = {
                view: np.sort(np.asarray(one.unit_ids, np.int32)) for view, one in drawn.items()
            }
    finally:
        culler.close()
    return timeline, VisibleSets(sets, {}, units)


def recordings(
    cases: dict[str, tuple[Scene, CameraPath]], every: int = 1
) -> Iterator[tuple[str, str, CameraPath, Timeline, VisibleSets]]:
    """Each culler, wrong and right, along every so many of the cases, another start for each; those
    that break down there are left out."""
    makers = {**{name: wrong.culler for name, wrong in WRONG.items()}, **RIGHT}
    for index, (name, make) in enumerate(makers.items()):
        for at, (scene, world) in list(cases.items())[index % every :: every]:
            path = world.relative_to(scene.origin)
            try:
                yield name, at, path, *recorded(make, scene, path)
            except Exception:  # an engine's own, of any kind
                continue


def conformance_cases() -> dict[str, tuple[Scene, CameraPath]]:
    names = [one if isinstance(one, str) else one.name for one in SCENES]
    return {name: case(name) for name in names}
