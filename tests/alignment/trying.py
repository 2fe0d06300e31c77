"""A mistake made, and what is said of it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from tests.alignment.mistakes import Mistake
from tests.alignment.scenes import RECORDERS, SCENES, two_eyes, visible_sets
from visref.alignment import Alignment, best_alignment
from visref.scene import Scene
from visref.timeline import Timeline


@cache
def recorded(scene_name, recorder, shift=(0.0, 0.0), stereo=False, one_sided=False):
    """Right inputs: a scene, its path, and by frame and view what a sound recorder lists."""
    scene, path = SCENES[scene_name](shift)
    if one_sided:
        scene = open_shells(scene)
    if stereo:
        path = two_eyes(path)
    return scene, path, RECORDERS[recorder](scene, path)


def open_shells(scene: Scene) -> Scene:
    """What of a scene faces up or to one side, one-sided: a closed solid shows much the same from
    within."""
    corners = scene.vertices[scene.triangles].astype(np.float64)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    kept = normal @ (0.4, 1.0, 0.3) > 0.0
    sizes = np.bincount(scene.object_of_triangle[kept], minlength=scene.object_count)
    return replace(
        scene,
        triangles=scene.triangles[kept],
        object_offsets=np.concatenate([[0], np.cumsum(sizes)]),
        one_sided=np.ones(int(kept.sum()), np.bool_),
        alpha=scene.alpha[kept],
        masks=None,
    )


def said_of(scene, path, sets) -> Alignment | None:
    return best_alignment(Timeline(scene, path), path, visible_sets(scene, sets), threads=1)


def found_for(scene_name: str, recorder: str, mistake: Mistake) -> Alignment | None:
    right = recorded(scene_name, recorder, mistake.shift, mistake.stereo, mistake.one_sided)
    return said_of(*mistake.change(*right))
