"""The rasteriser behind a culler's depth buffer, as the judge takes it: what it declares is read
once, checked and kept, and its picture is checked before anything rests on it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.culler import Culler, CullerError, Raster, RasterTolerance, check_tolerance
from visref.judging.restored import settings_restored
from visref.scene import Int32
from visref.visibility import BACKGROUND


class JudgedRaster(Raster):
    """A plug-in's rasteriser with the tolerance that it declared at one moment, checked. Raises
    CullerError for a tolerance that is out of bounds, or none."""

    def __init__(self, raster: Raster) -> None:
        try:
            self.tolerance: RasterTolerance = check_tolerance(raster.tolerance)
        except CullerError:  # from another process, and said so there
            raise
        except Exception as error:  # a plug-in may raise anything
            raise CullerError(f"raster.tolerance: {_told(error)}") from error
        self._raster = raster

    def item_buffer(self, camera: Camera) -> Int32 | None:
        """The plug-in's own picture, unchecked; see `triangles_shown`."""
        return self._raster.item_buffer(camera)

    def triangles_shown(self, camera: Camera, triangle_count: int) -> Int32 | None:
        """(k,) int32, ascending: the triangles in the rasteriser's unculled picture; None where it
        has no picture. Raises CullerError for what is no (height, width) array of integers from
        `BACKGROUND` to `triangle_count` - 1."""
        try:
            with settings_restored():
                given: object = self.item_buffer(camera.handed_out())
            if given is None:
                return None
            # A copy: the plug-in may write into its own later. No list: what is wrong with one
            # would only be guessed at.
            picture = np.array(given, subok=False) if isinstance(given, np.ndarray) else None
        except Exception as error:  # a plug-in may raise anything
            raise CullerError(f"item_buffer() raised {_told(error)}") from error
        shape = (camera.height, camera.width)
        if picture is None or picture.shape != shape or picture.dtype.kind not in "iu":
            raise CullerError(
                f"item_buffer() is {_kind(given)}, not an array of {shape[0]} x {shape[1]} integers"
            )
        seen: NDArray[np.integer] = np.unique(picture)
        if not BACKGROUND <= seen[0] <= seen[-1] < triangle_count:
            raise CullerError("item_buffer() is no picture of the scene's triangle ids")
        shown: Int32 = seen[seen >= 0].astype(np.int32)
        return shown


def raster_of(culler: Culler) -> JudgedRaster | None:
    """What stands behind a culler's depth buffer now, None if nothing does. Raises CullerError
    where it does not say properly."""
    try:
        raster = culler.raster
    except Exception as error:  # a plug-in may raise anything
        raise CullerError(f"raster raised {_told(error)}") from error
    return None if raster is None else JudgedRaster(raster)


def looser(one: RasterTolerance | None, other: RasterTolerance) -> RasterTolerance:
    """A tolerance that holds both: the greater snap, the coarser depth."""
    if one is None:
        return other
    # Floating depth holds 24 bits in its upper half, and is judged as that.
    coarser = min(one.depth_bits, other.depth_bits, key=lambda bits: 24 if bits is None else bits)
    return RasterTolerance(max(one.snap_px, other.snap_px), coarser)


def _kind(given: object) -> str:
    if isinstance(given, np.ndarray):
        return f"an array of shape {given.shape} and type {given.dtype}"
    return f"a {type(given).__name__}"


def _told(error: Exception) -> str:
    try:
        text = str(error)
        return text if type(error) is ValueError else f"{type(error).__name__}: {text}"
    except Exception:  # its own text may raise too
        return type(error).__name__
