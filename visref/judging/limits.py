"""Whether near or far hides what the cameras look at: a question about the input, not a verdict.

A path whose `far` is in other units than its scene sees next to nothing, and every culler passes.
So a few frames are cast again, at a few of their samples and without limits, and a finding says
where a limit hides most of what is met.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from visref.camera import Camera
from visref.engines.base import TruthEngine
from visref.findings import Code, Finding
from visref.scene import Float64, Scene
from visref.visibility import FrameTruth, hit_depths
from visref.wording import counted

# Frames that are looked at, and samples on an image's longer side: thirty thousand rays of a path
# put a share within a percent or two, and the question is whether it is above one half.
LOOKED_AT = 10
LONGER_SIDE = 64

# A perspective camera needs a positive near plane. What lies nearer than a millionth of the way to
# the scene's far end is not met: a surface so near fills a view only if the eye lies in it.
_NEAREST = 2.0**-20


def sparse(camera: Camera, longer_side: int = LONGER_SIDE) -> Camera:
    """A camera whose samples are every k-th of this one's, both ways, but for rounding; k the
    least for which the longer side has at most so many."""
    width, height = camera.width, camera.height
    k = -(-max(width, height) // longer_side)
    few_x, few_y = -(-width // k), -(-height // k)

    def shift(side: int, few: int, own: float) -> float:
        # k (2 (i + shift) + 1 - few) = 2 (k i + first + own) + 1 - side, the first one such that
        # as much is left out at the other border.
        first = (side - 1 - (few - 1) * k) // 2
        return ((2.0 * (first + own) + 1.0 - side) / k - 1.0 + few) / 2.0

    # One step of the few is k steps: tan(yfov / 2) / few_y = k tan(yfov / 2) / height.
    grow = k * few_y / height
    if camera.yfov is not None:
        yfov, ymag = 2.0 * math.atan(grow * math.tan(camera.yfov / 2.0)), None
    else:
        assert camera.ymag is not None
        yfov, ymag = None, grow * camera.ymag
    return replace(
        camera,
        width=few_x,
        height=few_y,
        yfov=yfov,
        ymag=ymag,
        shift_x_px=shift(width, few_x, camera.shift_x_px),
        shift_y_px=shift(height, few_y, camera.shift_y_px),
    )


def unlimited(camera: Camera, bounds: Float64) -> Camera | None:
    """The camera with limits that hide nothing of a box, (2, 3) float64 in its coordinates; None
    where a perspective camera has nothing of it ahead."""
    corners = np.array(np.meshgrid(*bounds.T)).reshape(3, -1).T - camera.eye
    depth = corners @ camera.forward
    least, greatest = float(depth.min()), float(depth.max())
    if camera.is_perspective:
        if greatest <= 0.0:
            return None
        near = min(camera.near, _NEAREST * greatest)
    else:
        # Before the box by its own depth, and by more than its corners' depths were rounded.
        near = least - (greatest - least) - _NEAREST * float(np.abs(corners).max())
    return replace(camera, near=near, far=math.inf)


def met(engine: TruthEngine, scene: Scene, camera: Camera) -> Float64:
    """View depths of what each sample meets first, (h,) float64, a sample that a mask leaves open
    by the nearest that may be seen; glass is looked through."""
    truth: FrameTruth = engine.frame(camera)
    owner = truth.buffer.triangle.reshape(-1).copy()
    owner[truth.doubt.sample] = truth.doubt.triangle[truth.doubt.offsets[:-1]]
    sample = np.flatnonzero(owner >= 0)
    # By the triangles: an item buffer's own depths round to nothing over such a range.
    return hit_depths(scene, truth.camera, sample, owner[sample])


def hidden_by_limits(
    engine: TruthEngine, scene: Scene, frames: Sequence[Sequence[Camera]]
) -> list[Finding]:
    """Findings where near or far hides more than half of what the cameras of these frames, a list
    of views each, meet without limits. Cameras are relative to the scene's origin."""
    total = before = beyond = 0
    cameras = [camera for views in frames for camera in views]
    for camera in cameras:
        free = unlimited(sparse(camera), scene.bounds)
        if free is None:
            continue
        depth = met(engine, scene, free)
        total += len(depth)
        before += int(np.count_nonzero(depth < camera.near))
        beyond += int(np.count_nonzero(depth > camera.far))
    found = []
    for code, name, hidden, values in (
        (Code.NEAR_HIDES, "near", before, [camera.near for camera in cameras]),
        (Code.FAR_HIDES, "far", beyond, [camera.far for camera in cameras]),
    ):
        if 2 * hidden > total:
            least, greatest = f"{min(values):g}", f"{max(values):g}"
            limit = least if least == greatest else f"{least} to {greatest}"
            text = f"{name} = {limit} hides {share(hidden, total)} of what the cameras meet"
            found.append(Finding(code, f"{text}, in {counted(len(frames), 'frame')}"))
    return found


def share(part: int, whole: int) -> str:
    """A share in whole percent, rounded down: 100 only where nothing is left."""
    return f"{100 * part // whole} %"


def known_to_be_wrong(
    engine: TruthEngine, scene: Scene, frames: Sequence[Sequence[Camera]]
) -> list[Finding]:
    """A finding where an engine errs, in these frames, a list of views each, at samples whose
    owner is known. The judge decides exactly what is disputed, but nobody disputes what nobody
    saw."""
    unseen, asked = engine.unseen
    wrong = [unseen]
    for views in frames:
        for camera in views:
            triangles, known = engine.known_wrong(camera)
            asked += known
            wrong.append(triangles)
    met = np.concatenate(wrong)
    if not len(met):
        return []
    owner = scene.names[scene.object_of_triangle[met[0]]]
    text = f"{len(met)} of {asked} known samples, in {counted(len(frames), 'frame')}"
    return [Finding(Code.ENGINE_WRONG, text, object=owner)]
