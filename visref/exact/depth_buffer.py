"""A rasteriser's depth buffer: what it stores of a depth, and how far off float32 may put that."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.compiled import njit
from visref.culler import RasterTolerance
from visref.exact.filters import View
from visref.exact.scene import ExactScene
from visref.scene import Float64

# float32's rounding unit. A window depth is a product of a float32 matrix (each entry rounded)
# with a float32 vertex: rounding of the entry, product, three sums, then the division, the
# viewport's scale and offset: 8 in all, on the sum of the terms' sizes.
FLOAT32 = 2.0**-24
DEPTH_ROUNDINGS = 8.0


class DepthBuffer(NamedTuple):
    """A depth buffer: what it stores of a key, and what a float32 transform makes of it.

    `z_sizes`, `w_sizes`: (4,) float64, the sizes of the clip matrix's rows z and w. `step`: one
    step of the buffer, in window depth. `scale` turns window depth into the key, which is affine
    in it; `first` and `last` are the keys of near and far.
    """

    z_sizes: Float64
    w_sizes: Float64
    step: float
    scale: float
    first: float
    last: float


# In the place of a depth buffer where none is asked about.
NO_DEPTH_BUFFER = DepthBuffer(np.zeros(4), np.zeros(4), 0.0, 0.0, 0.0, 0.0)


def depth_buffer(
    camera: Camera, exact_scene: ExactScene, tolerance: RasterTolerance
) -> DepthBuffer:
    """The depth buffer that a rasteriser of this tolerance has for a camera."""
    far = camera.far
    if math.isinf(far) and not camera.is_perspective:
        # Closed behind the last object, as such a depth buffer must be.
        corners = exact_scene.scene.vertices.astype(np.float64)
        far = float(((corners - camera.eye) @ camera.forward).max(initial=camera.near + 1.0))
    clip = np.abs(camera.clip_from_world(far))
    if not camera.is_perspective:
        scale = far - camera.near
    elif math.isinf(far):
        scale = 1.0 / camera.near
    else:
        scale = (far - camera.near) / (far * camera.near)
    bits = 24 if tolerance.depth_bits is None else tolerance.depth_bits
    if camera.is_perspective:
        first, last = 1.0 / camera.near, 1.0 / camera.far
    else:
        first, last = -camera.near, -camera.far
    return DepthBuffer(clip[2], clip[3], 2.0**-bits, float(scale), float(first), float(last))


def with_doubtful_range(view: View, exact_scene: ExactScene, depth: DepthBuffer) -> View:
    """The view with near and far moved outward to where rounding may still let a triangle in.

    By the scene's greatest coordinates; `key_error` then says it of one triangle.
    """
    size = np.abs(exact_scene.scene.bounds).max(axis=0)
    worst = 0.5 * float((depth.z_sizes + depth.w_sizes) @ np.append(size, 1.0))
    if view.perspective:
        worst *= depth.first
    doubt = (DEPTH_ROUNDINGS * FLOAT32 * (worst + 1.0) + depth.step) * depth.scale
    first, last = depth.first + doubt, depth.last - doubt
    if not view.perspective:
        return view._replace(near=-first, far=-last)
    return view._replace(near=1.0 / first, far=1.0 / last if last > 0.0 else math.inf)


@njit(error_model="numpy")
def key_error(p: NDArray[Any], view: View, depth: DepthBuffer) -> float:
    """How far off a float32 rasteriser's key of a triangle, (9,) float32 corners, may be at any of
    its points."""
    worst = 0.0
    for i in range(3):
        z, w, t = depth.z_sizes[3], depth.w_sizes[3], 0.0
        for k in range(3):
            size = abs(np.float64(p[3 * i + k]))
            z += depth.z_sizes[k] * size
            w += depth.w_sizes[k] * size
            t += view.z_dual[k] * (np.float64(p[3 * i + k]) - view.e[k])
        divisor = max(t, 1.0 / depth.first) if view.perspective else 1.0
        worst = max(worst, 0.5 * (z + w) / divisor)
    error: float = DEPTH_ROUNDINGS * FLOAT32 * (worst + 1.0) * depth.scale
    return error
