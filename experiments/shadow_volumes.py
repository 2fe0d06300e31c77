"""The experiment `shadow-volumes`: what clamping saves, and that it changes no picture.

Décoret 2005, section 4.4: fragments of shadow volumes without and with clamping, along a path.
"""

from __future__ import annotations

from statistics import fmean
from typing import Any

from visref.camera_path import CameraPath, middles
from visref.effects.images import ImageVerdict
from visref.effects.light import sun
from visref.effects.shadow_truth import ShadowTruth
from visref.effects.solid import solid
from visref.scene import Scene
from visref_culling.shadow_volumes.volumes import ShadowVolumes, endless

# The sun shines from the left, before the observer of `terrain_towers`, some 35 degrees high;
# the paper does not say where its light is.
SUN_DIRECTION = (-0.45, -0.8, 0.3)
# On the longer side of the litmaps; twice as many save about a hundredth of the fragments more.
LEXELS = 512
# Frames looked at, evenly along the path: full volumes in a city take seconds a frame.
FRAMES = 6


def measure(scene: Scene, path: CameraPath) -> dict[str, Any]:
    """Averages over up to `FRAMES` frames: casters, those kept, fragments in full and clamped,
    the same share by frame, and the verdict's counts summed."""
    scene = solid(scene)
    light = sun(SUN_DIRECTION, scene, LEXELS)
    volumes, rays = ShadowVolumes(scene, light), ShadowTruth(scene, light)
    verdict = ImageVerdict()
    full, clamped, kept = [], [], []
    try:
        for frame in middles(len(path), FRAMES):
            camera = endless(path.cameras[frame])
            whole = volumes.frame(camera, clamped=False, fragments=True)
            cut = volumes.frame(camera, fragments=True)
            truth = rays.engine.frame(camera)
            tolerance = volumes.tolerance(camera)
            verdict = verdict.plus(rays.judge(truth, cut.image, whole.image, tolerance))
            full.append(whole.fragments or 0)
            clamped.append(cut.fragments or 0)
            kept.append(len(cut.kept))
    finally:
        volumes.close()
        rays.close()
    return {
        "frames": len(full),
        "casters": scene.object_count,
        "casters_kept": fmean(kept),
        "fragments_full": fmean(full),
        "fragments_clamped": fmean(clamped),
        "fragments_full_by_frame": full,
        "fragments_clamped_by_frame": clamped,
        "verdict": verdict.to_json(),
    }
