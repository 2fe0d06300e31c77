"""Boxes relative to the eye, and what is certain about them however GL rounds.

A box has to cover its geometry after rounding. Both move on the screen by as much as `gl.view`
says, so a box is inflated by twice that. All tests here err outward: what they leave out is
hidden or outside for certain, and what they keep may be kept in vain.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.compiled import njit
from visref.scene import Float32, Float64
from visref_culling.gl.view import FLOAT32_UNIT, TRANSFORM_ROUNDINGS, View

# Clipping at the side planes: per plane the two distances to it (2 roundings of up to twice the
# larger coordinate M), their quotient, the difference, product and sum of the new position come
# to 14 units of M in x and as much in w; a corner of the image is made by two planes: 56.
CLIP_ROUNDINGS = 64
# A polygon over the whole image that is clipped short by less than this still covers the
# samples at its rim.
RIM_PX = 0.5

# Coordinates farther from the eye than this would overflow float32 when the shader multiplies
# them by a matrix entry; what reaches there is drawn without asking.
FARTHEST_QUERY = 1e30

# World coordinates are exact in float64; subtracting the eye rounds by 2**-53 of the larger.
FLOAT64_UNIT = 2.0**-53


def growth(view: View) -> tuple[float, float, float]:
    """By how much boxes are inflated: a part of their distance from the eye, a part of a
    pixel there (of that distance too in a perspective view), a part of their coordinates."""
    return (
        2.0 * TRANSFORM_ROUNDINGS * FLOAT32_UNIT,
        2.0 * view.window_error,
        4.0 * FLOAT64_UNIT,
    )


def inflated(view: View, bounds: Float64) -> Float64:
    """World boxes (k, 2, 3) -> boxes relative to the eye, float64, that cover their
    geometry however GL rounds it and them. Outward: too large a box only draws too much.
    """
    result = np.empty((len(bounds), 2, 3))
    _inflated(np.asarray(bounds, np.float64), view.camera.eye, growth_of_box(view), result)
    return result


def growth_of_box(view: View) -> Float64:
    """(5,) float64: what `inflate_box` needs: two parts of a box's distance from the eye, of one,
    of its coordinates, and the greatest of the eye's."""
    part, pixel, rounding = growth(view)
    away, always = (pixel, 0.0) if view.camera.is_perspective else (0.0, pixel)
    return np.array([part, away, always, rounding, np.abs(view.camera.eye).max()])


@njit()
def _inflated(
    bounds: NDArray[Any], eye: NDArray[Any], growth: NDArray[Any], result: NDArray[Any]
) -> None:
    for i in range(len(bounds)):
        inflate_box(bounds[i], eye, growth, result[i])


@njit()
def inflate_box(
    bounds: NDArray[Any], eye: NDArray[Any], growth: NDArray[Any], result: NDArray[Any]
) -> None:
    """`inflated` of one box, (2, 3) float64, into `result`, (2, 3). `eye`: (3,) float64;
    `growth`: of `growth_of_box`."""
    squares = largest = 0.0
    for axis in range(3):
        low, high = bounds[0, axis] - eye[axis], bounds[1, axis] - eye[axis]
        result[0, axis], result[1, axis] = low, high
        aside = max(abs(low), abs(high))
        squares += aside * aside
        largest = max(largest, abs(bounds[0, axis]), abs(bounds[1, axis]))
    reach = np.sqrt(squares)
    grow = growth[0] * reach + growth[1] * reach + growth[2]
    grow += growth[3] * (largest + growth[4])
    for axis in range(3):
        result[0, axis] -= grow
        result[1, axis] += grow


def nearest_depth(view: View, relative: Float64) -> Float64:
    """(k,) float64: the least view depth of boxes relative to the eye, over all corners
    (a linear function's least value over a box takes one bound in each axis)."""
    row = view.depth_row
    nearest: Float64 = np.where(row > 0.0, relative[:, 0], relative[:, 1]) @ row
    return nearest


def meets_frustum(view: View, relative: Float64) -> NDArray[np.bool_]:
    """(k,) bool, False only where a box relative to the eye lies wholly outside one of
    the view's planes. Outward: a box near an edge of the frustum may be kept in vain."""
    result = np.ones(len(relative), np.bool_)
    for plane in view.planes:
        farthest = np.where(plane[:3] > 0.0, relative[:, 1], relative[:, 0])
        result &= farthest @ plane[:3] + plane[3] >= 0.0
    return result


def cut_by_plane(view: View, relative: Float64) -> NDArray[np.bool_]:
    """(k,) bool, False only where a box relative to the eye lies for certain on the side of the
    camera's clip plane that counts. The part that is cut off of a *queried* box only draws more,
    but what is asked about by its own triangles may lie on the plane itself."""
    plane = view.clip_plane
    if plane is None:
        return np.zeros(len(relative), np.bool_)
    least = np.where(plane[:3] > 0.0, relative[:, 0], relative[:, 1]) @ plane[:3] + plane[3]
    result: NDArray[np.bool_] = least <= 0.0
    return result


def needs_no_query(view: View, relative: Float64) -> NDArray[np.bool_]:
    """(k,) bool, True where a box holds the eye, crosses the near plane, is too far away
    for float32, or reaches so far beside the image that clipping it may lose samples at
    the rim: visible without asking, since GL cannot draw such a box whole."""
    nearest = nearest_depth(view, relative)
    result: NDArray[np.bool_] = nearest <= view.camera.near
    result |= np.abs(relative).max(axis=(1, 2)) > FARTHEST_QUERY
    result |= _clipping_error_px(view, relative, nearest) >= RIM_PX
    return result


def _clipping_error_px(view: View, relative: Float64, nearest: Float64) -> Float64:
    """(k,) float64: by how much clipping may move a box's corners on the image's rim."""
    half_side = 0.5 * max(view.camera.width, view.camera.height)
    axes = view.camera_from_relative
    # The greatest of each coordinate over a box, then of them all, in pixels times w.
    pick = axes[:, None, :] > 0.0
    low, high = relative[None, :, 0], relative[None, :, 1]
    most = np.sum(axes[:, None, :] * np.where(pick, high, low), axis=2)
    least = np.sum(axes[:, None, :] * np.where(pick, low, high), axis=2)
    sizes = np.maximum(np.abs(most), np.abs(least))
    aside = sizes[:2].max(axis=0) / view.pixel
    if view.camera.is_perspective:
        largest = np.maximum(aside, sizes[2] * half_side)
        largest /= np.maximum(nearest, view.camera.near)
    else:
        largest = np.maximum(aside, half_side)
    error: Float64 = CLIP_ROUNDINGS * FLOAT32_UNIT * largest
    return error


def round_outward(relative: Float64) -> Float32:
    """Boxes (k, 2, 3) in float32, none smaller than given."""
    result = relative.astype(np.float32)
    low, high = result[:, 0], result[:, 1]
    np.copyto(low, np.nextafter(low, np.float32(-np.inf)), where=low > relative[:, 0])
    np.copyto(high, np.nextafter(high, np.float32(np.inf)), where=high < relative[:, 1])
    return result
