"""Objects by themselves: the scene without all others, decided sample by sample in integers."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tests.support import exact_brute
from visref.camera import Camera
from visref.scene import Scene


@dataclass
class Alone:
    """`mine`, `open`: (samples,) bool, what is the object's and what is undecided; `depth`: the
    least view depth of what is its own, inf if nothing is."""

    mine: NDArray[np.bool_]
    open: NDArray[np.bool_]
    depth: float


def scene_of(scene: Scene, *objects: int) -> Scene:
    """The scene with these objects only; the others are absent."""
    absent = np.ones(scene.object_count, np.bool_)
    absent[list(objects)] = False
    if scene.absent is not None:
        absent |= scene.absent
    return replace(scene, absent=absent)


def by_the_book(scene: Scene, camera: Camera, object_id: int) -> Alone:
    """What the rules say of an object that is the only one there; a mask is in between."""
    only = scene_of(scene, object_id)
    mine, open_ = np.zeros((2, camera.samples), np.bool_)
    depth = np.inf
    hits = exact_brute.hits(only, camera)
    for sample, said in enumerate(exact_brute.truth(only, camera)):
        glass = bool(said.blend)
        open_[sample] = bool(said.doubt) and not glass
        mine[sample] = glass or (bool(said.tied) and not said.doubt)
        if mine[sample]:
            masked = {i for _, i in said.doubt}
            depth = min([depth, *(float(t) for t, i in hits[sample] if i not in masked)])
    return Alone(mine, open_, depth)
