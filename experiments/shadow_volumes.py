"""The experiment `shadow-volumes`: what clamping saves, and that it changes no picture.

Décoret 2005, section 4.4: fragments of shadow volumes without and with clamping, along a path; and
whose they are.
"""

from __future__ import annotations

import re
from statistics import fmean
from typing import Any

import numpy as np

from visref.camera_path import CameraPath, middles
from visref.effects.images import ImageVerdict
from visref.effects.light import sun
from visref.effects.shadow_truth import ShadowTruth
from visref.effects.solid import solid
from visref.scene import Int64, Scene
from visref_culling.shadow_volumes.volumes import ShadowVolumes, endless

# The sun shines from the left, before the observer of `terrain_towers`, some 35 degrees high;
# the paper does not say where its light is.
SUN_DIRECTION = (-0.45, -0.8, 0.3)
# On the longer side of the litmaps; twice as many save about a hundredth of the fragments more.
LEXELS = 512
# Frames looked at, evenly along the path: full volumes in a city take seconds a frame.
FRAMES = 6


def measure(scene: Scene, path: CameraPath) -> dict[str, Any]:
    """Averages over up to `FRAMES` frames: casters, those kept, fragments in full and clamped, the
    same by frame, which frames they are, and the verdict's counts summed. `solid`: the share of
    triangles that bound a solid. `kinds`: fragments in full and clamped of the casters of a kind,
    by their names' first word, averages too."""
    scene = solid(scene)
    light = sun(SUN_DIRECTION, scene, LEXELS)
    volumes, rays = ShadowVolumes(scene, light), ShadowTruth(scene, light)
    verdict = ImageVerdict()
    frames = middles(len(path), FRAMES)
    full, clamped, kept = [], [], []
    kinds = kinds_of(scene)
    of_kind: dict[str, list[list[int]]] = {kind: [[], []] for kind in kinds}
    try:
        for frame in frames:
            camera = endless(path.cameras[frame])
            whole = volumes.frame(camera, clamped=False, fragments=True)
            cut = volumes.frame(camera, fragments=True)
            truth = rays.engine.frame(camera)
            tolerance = volumes.tolerance(camera)
            verdict = verdict.plus(rays.judge(truth, cut.image, whole.image, tolerance))
            full.append(whole.fragments or 0)
            clamped.append(cut.fragments or 0)
            kept.append(len(cut.kept))
            for kind, casters in kinds.items():
                for place, is_clamped in enumerate((False, True)):
                    found = volumes.fragments_of(camera, casters, clamped=is_clamped)
                    of_kind[kind][place].append(found)
    finally:
        volumes.close()
        rays.close()
    return {
        "frames": frames,
        "casters": scene.object_count,
        "casters_kept": fmean(kept),
        "solid": volumes.casters.solid / max(1, scene.triangle_count),
        "fragments_full": fmean(full),
        "fragments_clamped": fmean(clamped),
        "by_frame": {"fragments_full": full, "fragments_clamped": clamped},
        "kinds": {
            kind: {
                "fragments_full": fmean(whole),
                "fragments_clamped": fmean(cut),
                "by_frame": {"fragments_full": whole, "fragments_clamped": cut},
                "frames": frames,
            }
            for kind, (whole, cut) in of_kind.items()
        },
        "verdict": verdict.to_json(),
    }


def kinds_of(scene: Scene) -> dict[str, Int64]:
    """The objects of each kind, (k,) int64 ids: by the last part of their paths, up to the first
    that is no letter."""
    kinds: dict[str, list[int]] = {}
    for number, name in enumerate(scene.names):
        word = re.match("[A-Za-z_]*", name.rpartition("/")[2])
        kinds.setdefault(word[0] if word is not None else "", []).append(number)
    return {kind: np.array(numbers, np.int64) for kind, numbers in sorted(kinds.items())}
