"""The part of a scene on which effects stand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from visref.scene import Alpha, Scene


def solid(scene: Scene) -> Scene:
    """The scene's opaque triangles, two-sided; objects keep their ids, though some be empty.

    Blended and alpha-tested triangles neither hide a particle for certain nor cast or receive
    a shadow that a ray could decide, so an effect is judged without them.
    """
    kept = scene.alpha == Alpha.OPAQUE
    before = np.concatenate([[0], np.cumsum(kept)])
    return replace(
        scene,
        triangles=scene.triangles[kept],
        object_offsets=before[scene.object_offsets],
        one_sided=np.zeros(int(kept.sum()), np.bool_),
        alpha=np.zeros(int(kept.sum()), np.uint8),
    )
