"""Triangles against the whole image, not its samples: what is outside for certain.

The continuous image is the union of the pixels: x from -1/2 to width - 1/2, y likewise, at view
depths from near to far. In the coordinates of `visref.camera` a point p has p - e = z F + A R +
B U, and lies at (a, b) = (A / z, B / z), orthographic (A, B).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.exact.rational import lowest_bit, plane_names
from visref.scene import Float32, Float64

Bool = NDArray[np.bool_]

# Roundings of a plane's value n . (p - e - o), u = 2^-53 each: n is a cross product of an exact
# vector with F + a R (2), a product and a difference: 4. p - e and o one each, their difference
# one: 3. The dot product's product and two sums: 3. 10 u of the sums of absolute products; 16 u
# holds the second order and the rounding of the bound itself. Outward: what this leaves open is
# called neither outside nor hidden.
PLANE_ROUNDING = 16.0 * 2.0**-53
# Above anything that underflow can add.
TINY = 2.0**-1000


def image_limits(camera: Camera) -> Float64:
    """(6,) float64: the least and greatest a, b and view depth of the continuous image."""
    a, b = 2.0 * camera.shift_x_px, -2.0 * camera.shift_y_px
    return np.array(
        [a - camera.width, a + camera.width, b - camera.height, b + camera.height, camera.near,
         camera.far]
    )  # fmt: skip


def pixel_at(camera: Camera, a: Float64, b: Float64) -> tuple[Float64, Float64]:
    """Pixel coordinates (x, y) of image points, inside the image: (k,) float64 each."""
    x = (a - 1.0 + camera.width) / 2.0 - camera.shift_x_px
    y = (camera.height - 1.0 - b) / 2.0 - camera.shift_y_px
    return np.clip(x, -0.5, camera.width - 0.5), np.clip(y, -0.5, camera.height - 0.5)


def certainly_outside(camera: Camera, points: Float64) -> Bool:
    """Whether the convex hull of each row of points certainly shows nowhere in the image.

    `points`: (k, n, 3) float64, world space. True is proven: some border plane of the view has
    all n points beyond it by more than the roundings of the test.
    """
    limits = image_limits(camera)
    e, f, r, u = camera.eye, camera.forward, camera.right_step, camera.up_step
    beyond_all = np.zeros(len(points), np.bool_)
    q = points - e
    for axis, (along, across) in enumerate(((r, u), (u, r), (f, None))):
        for side in (0, 1):
            # One unit in the last place outward, for the limit's own rounding.
            limit = np.nextafter(limits[2 * axis + side], (-np.inf, np.inf)[side])
            if not np.isfinite(limit):
                continue
            # Spanned by two vectors, through e + offset.
            if across is None:
                first, second, second_size, offset = r, u, np.abs(u), limit * f
            elif camera.is_perspective:
                first, second = across, f + limit * along
                second_size, offset = np.abs(f) + np.abs(limit * along), np.zeros(3)
            else:
                first, second, second_size, offset = across, f, np.abs(f), limit * along
            normal = np.cross(first, second)
            # |x| |y| + |y| |x| in each component, what the cross product's rounding scales with.
            size = np.abs(first)[[1, 2, 0]] * second_size[[2, 0, 1]]
            size += np.abs(first)[[2, 0, 1]] * second_size[[1, 2, 0]]
            sign = np.sign(normal @ along) * (1.0 if side else -1.0)
            value = sign * ((q - offset) @ normal)
            bound = PLANE_ROUNDING * ((np.abs(q) + np.abs(offset)) @ size) + TINY
            beyond_all |= np.all(value > bound, axis=1)
    return beyond_all


def degenerate(corners: Float32) -> Bool:
    """(k,) bool: which triangles, (k, 3, 3) float32, are a line or a point, exactly."""
    p = corners.astype(np.float64)
    g, h = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    normal = np.abs(np.cross(g, h))
    g, h = np.abs(g), np.abs(h)
    size = g[:, [1, 2, 0]] * h[:, [2, 0, 1]] + g[:, [2, 0, 1]] * h[:, [1, 2, 0]]
    result: Bool = np.all(normal <= PLANE_ROUNDING * size + TINY, axis=1)
    doubtful = np.flatnonzero(result)
    if len(doubtful):
        names = plane_names(corners[doubtful], lowest_bit(corners[doubtful]))
        result[doubtful] = [name is None for name in names]
    return result
