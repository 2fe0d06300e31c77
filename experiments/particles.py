"""The experiment `particles`: depth tests of sprites with and without culling them first.

Décoret 2005, section 4.3: N sprites of 16 by 16 pixels take 256 N depth tests when rasterised,
and N when looked up. The lookups do not draw what they let through, though; both are told. So are
the times of drawing with culling and without, which the paper gives for 60 by 60 particles.

Sprites of 24 by 24 pixels stand for those whose size is no power of two (section 3.2): four
lookups cover them exactly, and one does by a square of 32.
"""

from __future__ import annotations

from functools import partial
from statistics import fmean
from typing import Any

import numpy as np

from visref.camera import Camera
from visref.camera_path import CameraPath, middles
from visref.effects.images import ImageVerdict
from visref.effects.solid import solid
from visref.effects.sprite_truth import SpriteTruth
from visref.effects.sprites import Sprites
from visref.scene import Scene
from visref_culling.n_buffer.cover import FOUR, ONE
from visref_culling.n_buffer.particles import Particles
from visref_experiments.timing import quickest_ms

SPRITES = 60**2  # section 4.3's
SIDE_PX = 16
OTHER_SIDE_PX = 24
SEED = 2005
FRAMES = 20
FEW_FRAMES = 5
ROUNDS = 3


def measure(scene: Scene, path: CameraPath) -> dict[str, Any]:
    """Averages over up to `FRAMES` frames of snow all over the scene: sprites in the view, those
    not hidden by one lookup, depth tests by rasterising all of them, lookups as the shader counts
    them, depth tests of the sprites left; the same by frame; and the verdict's counts summed.
    `culled_ms`, `plain_ms`: of drawing scene and sprites, in each of up to `FEW_FRAMES` frames.
    `other`: of sprites of `OTHER_SIDE_PX`, by how many squares cover one, on as few."""
    scene = solid(scene)
    places = snow(scene, SPRITES)
    frames = middles(len(path), FRAMES)
    cameras = [path.cameras[frame] for frame in frames]
    result = _counted(scene, Sprites(places, SIDE_PX), cameras)
    result |= {"sprites": len(places), "side_px": SIDE_PX, "frames": frames}
    result |= _timed(scene, Sprites(places, SIDE_PX), path)
    other = Sprites(places, OTHER_SIDE_PX)
    result["other_side_px"] = OTHER_SIDE_PX
    few = [path.cameras[frame] for frame in middles(len(path), FEW_FRAMES)]
    result["other"] = {
        str(squares): _counted(scene, other, few, squares=squares) for squares in (ONE, FOUR)
    }
    return result


def _counted(
    scene: Scene, sprites: Sprites, cameras: list[Camera], *, squares: int | None = None
) -> dict[str, Any]:
    particles = Particles(scene, sprites, squares=squares)
    truth = SpriteTruth(scene, sprites)
    verdict = ImageVerdict()
    rows: list[dict[str, int]] = []
    try:
        for camera in cameras:
            everything = particles.frame(camera, culled=False, fragments=True)
            culled = particles.frame(camera, fragments=True)
            tolerance = particles.tolerance(camera)
            verdict = verdict.plus(truth.judge(camera, culled.layers, everything.layers, tolerance))
            rows.append(
                {
                    "sprites_in_view": everything.in_image,
                    "sprites_kept": len(culled.kept),
                    "depth_tests_plain": everything.fragments or 0,
                    "lookups_counted": culled.lookups,
                    "depth_tests_left": culled.fragments or 0,
                }
            )
    finally:
        particles.close()
        truth.close()
    by_frame = {name: [row[name] for row in rows] for name in rows[0]}
    means = {name: fmean(values) for name, values in by_frame.items()}
    return {**means, "by_frame": by_frame, "verdict": verdict.to_json()}


def _timed(scene: Scene, sprites: Sprites, path: CameraPath) -> dict[str, list[float]]:
    particles = Particles(scene, sprites)
    times: dict[str, list[float]] = {"culled_ms": [], "plain_ms": []}
    try:
        for frame in middles(len(path), FEW_FRAMES):
            jobs = [
                partial(particles.draw_alone, path.cameras[frame], culled=culled)
                for culled in (True, False)
            ]
            for name, ms in zip(times, quickest_ms(*jobs, rounds=ROUNDS), strict=True):
                times[name].append(ms)
    finally:
        particles.close()
    return times


def snow(scene: Scene, count: int) -> np.ndarray[Any, np.dtype[np.float32]]:
    """(count, 3) float32 places, even all over the scene's core."""
    rng = np.random.Generator(np.random.PCG64(SEED))
    low, high = scene.core_bounds
    return rng.uniform(low, high, (count, 3)).astype(np.float32)
