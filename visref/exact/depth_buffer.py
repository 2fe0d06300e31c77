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
    in it; `first` and `last` are the keys of near and far. `most`: how large an error of the key
    counts, which must be less: infinite for any, 0 for the key itself (see `resolved`).
    """

    z_sizes: Float64
    w_sizes: Float64
    step: float
    scale: float
    first: float
    last: float
    perspective: bool
    most: float = math.inf


# In the place of a depth buffer where none is asked about.
NO_DEPTH_BUFFER = DepthBuffer(np.zeros(4), np.zeros(4), 0.0, 0.0, 0.0, 0.0, False)


def depth_buffer(
    camera: Camera, exact_scene: ExactScene, tolerance: RasterTolerance
) -> DepthBuffer:
    """The depth buffer that a rasteriser of this tolerance has for a camera."""
    far = camera.far
    if math.isinf(far) and not camera.is_perspective:
        # Closed behind the last object, as such a depth buffer must be.
        corners = exact_scene.scene.vertices.astype(np.float64)
        far = float(((corners - camera.eye) @ camera.forward).max(initial=camera.near + 1.0))
    with np.errstate(over="ignore", invalid="ignore"):  # of a far or near without measure
        clip = np.abs(camera.clip_from_world(far))
    if not camera.is_perspective:
        scale = far - camera.near
    elif math.isinf(far):
        scale = 1.0 / camera.near
    elif 0.0 < far * camera.near < math.inf:
        scale = (far - camera.near) / (far * camera.near)
    else:  # the product leaves float64's range
        scale = 1.0 / camera.near - 1.0 / far
    bits = 24 if tolerance.depth_bits is None else tolerance.depth_bits
    if camera.is_perspective:
        first, last = 1.0 / camera.near, 1.0 / camera.far
    else:
        first, last = -camera.near, -camera.far
    return DepthBuffer(
        clip[2], clip[3], 2.0**-bits, float(scale), float(first), float(last), camera.is_perspective
    )


def resolved(depth: DepthBuffer, exact_scene: ExactScene) -> DepthBuffer:
    """The same buffer, of which only what it resolves counts.

    Its error in the key grows without limit as near goes to 0 (or an orthographic range to
    infinity). Where the error reaches the key itself, the buffer does not tell a depth from
    infinity; an orthographic one tells nothing where the error reaches the scene's size.
    """
    if depth.perspective:
        return depth._replace(most=0.0)
    low, high = exact_scene.scene.bounds
    return depth._replace(most=float(np.linalg.norm(high - low)))


def resolves(
    camera: Camera, exact_scene: ExactScene, tolerance: RasterTolerance, depth: float
) -> bool:
    """Whether one step of such a buffer is less than what `resolved` lets count, at a view depth:
    nothing at a greater one is told apart where this is not."""
    buffer = resolved(depth_buffer(camera, exact_scene, tolerance), exact_scene)
    return buffer.step * buffer.scale < (buffer.most if buffer.most > 0.0 else 1.0 / depth)


def with_doubtful_range(view: View, exact_scene: ExactScene, depth: DepthBuffer) -> View:
    """The view with near and far moved outward to where rounding may still let a triangle in.

    By the scene's greatest coordinates; `key_error` then says it of one triangle.
    """
    size = np.abs(exact_scene.scene.bounds).max(axis=0)
    worst = 0.5 * float((depth.z_sizes + depth.w_sizes) @ np.append(size, 1.0))
    if view.perspective:
        worst *= depth.first
    # Not finite where near is next to nothing: then all that lies before the eye comes in.
    doubt = (DEPTH_ROUNDINGS * FLOAT32 * (worst + 1.0) + depth.step) * depth.scale
    first, last = depth.first + doubt, depth.last - doubt
    if not view.perspective:
        return view._replace(near=-first, far=-last)
    near = 1.0 / first if first < math.inf else view.near
    return view._replace(near=near, far=1.0 / last if last > 0.0 else math.inf)


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


@njit(error_model="numpy")
def counted(error: float, key: float, depth: DepthBuffer) -> float:
    """An error of a key as far as it counts: none where the buffer resolves nothing."""
    limit = depth.most if depth.most > 0.0 else key
    return error if error < limit else 0.0
