"""The experiment `particles`: depth tests of sprites with and without culling them first.

Décoret 2005, section 4.3: N sprites of 16 by 16 pixels take 256 N depth tests when rasterised,
and N when looked up. The lookups do not draw what they let through, though; both are told.
"""

from __future__ import annotations

from statistics import fmean
from typing import Any

import numpy as np

from visref.camera_path import CameraPath, middles
from visref.effects.images import ImageVerdict
from visref.effects.solid import solid
from visref.effects.sprite_truth import SpriteTruth
from visref.effects.sprites import Sprites
from visref.scene import Scene
from visref_culling.n_buffer.particles import Particles

SPRITES = 60**2  # section 4.3's
SIDE_PX = 16
SEED = 2005
FRAMES = 20


def measure(scene: Scene, path: CameraPath) -> dict[str, Any]:
    """Averages over up to `FRAMES` frames of snow all over the scene: sprites in the view, those
    not hidden by one lookup, depth tests by rasterising all of them, lookups, depth tests of the
    sprites left; and the verdict's counts summed."""
    scene = solid(scene)
    sprites = Sprites(snow(scene, SPRITES), SIDE_PX)
    particles, truth = Particles(scene, sprites), SpriteTruth(scene, sprites)
    verdict = ImageVerdict()
    in_view, kept, plain, lookups, left = [], [], [], [], []
    try:
        for frame in middles(len(path), FRAMES):
            camera = path.cameras[frame]
            everything = particles.frame(camera, culled=False, fragments=True)
            culled = particles.frame(camera, fragments=True)
            tolerance = particles.tolerance(camera)
            verdict = verdict.plus(truth.judge(camera, culled.layers, everything.layers, tolerance))
            in_view.append(everything.in_image)
            kept.append(len(culled.kept))
            plain.append(everything.fragments or 0)
            lookups.append(culled.lookups)
            left.append(culled.fragments or 0)
    finally:
        particles.close()
        truth.close()
    return {
        "frames": len(plain),
        "sprites": len(sprites.centres),
        "side_px": SIDE_PX,
        "sprites_in_view": fmean(in_view),
        "sprites_kept": fmean(kept),
        "depth_tests_plain": fmean(plain),
        "lookups": fmean(lookups),
        "depth_tests_left": fmean(left),
        "verdict": verdict.to_json(),
    }


def snow(scene: Scene, count: int) -> np.ndarray[Any, np.dtype[np.float32]]:
    """(count, 3) float32 places, even all over the scene's core."""
    rng = np.random.Generator(np.random.PCG64(SEED))
    low, high = scene.core_bounds
    return rng.uniform(low, high, (count, 3)).astype(np.float32)
