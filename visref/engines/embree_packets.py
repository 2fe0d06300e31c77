"""Embree's ray packets, through the library that embreex brings along.

embreex casts single rays. Neighbouring samples share nearly all of their way through the
hierarchy, and Embree's own interface casts eight or sixteen such rays at once (`rtcIntersect8`,
`rtcIntersect16`, with `RTC_RAY_QUERY_FLAG_COHERENT`), several times as fast. Bound here are these
calls and what it takes to build a scene of triangles; numbers and layouts are those of Embree 4's
rtcore headers, which stay the same throughout version 4. `packet_loops` calls them.

What moves is an Embree scene of its own, built anew for each pose in Embree's low quality (Morton
order), and cast after what stands still, each ray no further than what it met there. Building it
took 0.7, 13 and 210 ms where 1 %, 10 % and all of 768,000 triangles move; in medium quality 2, 46
and 700 ms, which rays won back only where all moves. One dynamic scene of two geometries took
330, 390 and 630 ms, since a commit builds all of it. Refitting took 2, 4 and 40 ms, but a refitted
hierarchy hangs on the poses before, and so does which of two triangles at one distance is named.
"""

from __future__ import annotations

import ctypes
import weakref
from ctypes import c_char_p, c_int, c_size_t, c_ssize_t, c_uint, c_void_p
from functools import cache
from importlib.metadata import PackageNotFoundError, files
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.engines.packet_loops import (
    BLOCK_WIDTH,
    Aim,
    Scenes,
    cast,
    nearest,
    new_packet,
    new_scratch,
    well_shaped,
)
from visref.engines.ray_kernels import SampleGrid
from visref.engines.reached import boxes_of_runs, flag, reach
from visref.scene import Float32, Float64, Int32, Int64

_DEVICE_VERSION, _DEVICE_NATIVE_RAY8, _DEVICE_NATIVE_RAY16 = 0, 33, 34
_SCENE_ROBUST = 1 << 2
_QUALITY_LOW, _QUALITY_MEDIUM = 0, 1
_GEOMETRY_TRIANGLE = 0
_BUFFER_INDEX, _BUFFER_VERTEX = 0, 1
_FORMAT_UINT3, _FORMAT_FLOAT3 = 0x5003, 0x9003
_QUERY_COHERENT = 1 << 16
_ALL_FEATURES = 0xFFFFFFFF

_SIGNATURES: dict[str, tuple[Any, ...]] = {
    # name: result, arguments
    "rtcNewDevice": (c_void_p, c_char_p),
    "rtcGetDeviceProperty": (c_ssize_t, c_void_p, c_int),
    "rtcGetDeviceError": (c_int, c_void_p),
    "rtcReleaseDevice": (None, c_void_p),
    "rtcNewScene": (c_void_p, c_void_p),
    "rtcSetSceneFlags": (None, c_void_p, c_int),
    "rtcSetSceneBuildQuality": (None, c_void_p, c_int),
    "rtcCommitScene": (None, c_void_p),
    "rtcReleaseScene": (None, c_void_p),
    "rtcNewGeometry": (c_void_p, c_void_p, c_int),
    "rtcSetSharedGeometryBuffer": (
        *(None, c_void_p, c_int, c_uint, c_int),
        *(c_void_p, c_size_t, c_size_t, c_size_t),
    ),
    "rtcSetGeometryBuildQuality": (None, c_void_p, c_int),
    "rtcCommitGeometry": (None, c_void_p),
    "rtcAttachGeometry": (c_uint, c_void_p, c_void_p),
    "rtcReleaseGeometry": (None, c_void_p),
    "rtcIntersect8": (None, c_void_p, c_void_p, c_void_p, c_void_p),
    "rtcIntersect16": (None, c_void_p, c_void_p, c_void_p, c_void_p),
}


@cache
def load_library() -> ctypes.CDLL | None:
    """The Embree 4 library inside the embreex package, None where there is none of use: it
    is not bundled (then embreex itself casts the rays), or has no packets of eight."""
    try:
        bundled = files("embreex") or []
    except PackageNotFoundError:
        return None
    for file in bundled:
        if "embree4" in file.name and not file.name.endswith((".py", ".pxd", ".pyi")):
            try:
                library = ctypes.CDLL(str(file.locate()))
                for name, (result, *arguments) in _SIGNATURES.items():
                    function = getattr(library, name)
                    function.restype, function.argtypes = result, arguments
            except (OSError, AttributeError):
                continue
            return library if _has_packets(library) else None
    return None


def _has_packets(library: ctypes.CDLL) -> bool:
    device = library.rtcNewDevice(None)
    if not device:
        return False
    version = library.rtcGetDeviceProperty(device, _DEVICE_VERSION)
    native = library.rtcGetDeviceProperty(device, _DEVICE_NATIVE_RAY8)
    library.rtcReleaseDevice(device)
    return bool(40000 <= version < 50000 and native)


class PacketScene:
    """Triangles in Embree, cast sixteen rays at a time where the machine has vectors of sixteen,
    else eight.

    `vertices` (v, 3) float32, `triangles` (t, 3) int32; both stay as they are, for Embree reads
    them. Raises MemoryError
    where Embree cannot build its hierarchy.
    """

    def __init__(
        self, library: ctypes.CDLL, vertices: Float32, triangles: Int32, *, robust: bool
    ) -> None:
        self._library = library
        self._robust = robust
        self._device = library.rtcNewDevice(None)
        weakref.finalize(self, library.rtcReleaseDevice, self._device)
        self._still = self._built(vertices, triangles, _QUALITY_MEDIUM)
        self._still_boxes = boxes_of_runs(vertices, triangles)
        self._moving_boxes = np.zeros((0, 2, 3), np.float32)
        self._moving: _Built | None = None
        self._still_shaped = well_shaped(vertices, triangles)
        self._moving_shaped = np.zeros(0, np.bool_)
        self._places = np.zeros(0, np.int32), np.zeros(0, np.int32)
        native16 = library.rtcGetDeviceProperty(self._device, _DEVICE_NATIVE_RAY16)
        self.lanes = 16 if native16 else 8
        # RTCIntersectArguments: flags, features, then pointers that stay null.
        self._arguments = np.zeros(16, np.uint32)
        self._arguments[:2] = _QUERY_COHERENT, _ALL_FEATURES

    def pose(self, vertices: Float32, triangles: Int32, places: tuple[Int32, Int32]) -> None:
        """Meet what moves, as it is now, in place of what it was.

        From then on `nearest` answers in `places`, one per triangle of those given at first,
        (t,) int32, and of these here, (m,) int32. Of both at one distance, the lesser is given.
        """
        self._moving = None  # freed before the next is made
        self._moving = self._built(vertices, triangles, _QUALITY_LOW)
        self._moving_boxes = boxes_of_runs(vertices, triangles)
        self._places = places
        self._moving_shaped = well_shaped(vertices, triangles)

    def _built(self, vertices: Float32, triangles: Int32, quality: int) -> _Built:
        return _Built(self._library, self._device, vertices, triangles, quality, self._robust)

    def nearest(self, rays: Float32) -> Int32:
        """(n,) int32, the nearest triangle along each ray (n, 6), -1 for none."""
        places = np.empty(len(rays), np.int32)
        nearest(new_scratch(self.lanes, 0), self._scenes, new_packet(self.lanes), rays, places)
        return places

    def well_shaped(self, places: int) -> NDArray[np.bool_]:
        """(places,) bool, of which triangles the normal is told in float32; as now posed."""
        if self._moving is None:
            shaped: NDArray[np.bool_] = self._still_shaped
            return shaped
        result = np.zeros(places, np.bool_)
        for where, shaped in zip(
            self._places, (self._still_shaped, self._moving_shaped), strict=True
        ):
            result[where] = shaped
        return result

    def reached(
        self, grid: SampleGrid, rebase: Float64, scale: float, slack: float
    ) -> NDArray[np.uint8]:
        """(r, c) uint8, in which blocks of an image anything may be met. `rebase`, `scale`: how the
        vertices come from the scene's; `slack`: how far Embree may be off, in the scene's units."""
        block = BLOCK_WIDTH, self.lanes // BLOCK_WIDTH
        shape = -(-len(grid.row_b) // block[1]), -(-len(grid.column_a) // block[0])
        counts = np.zeros((shape[0] + 1, shape[1] + 1), np.int32)
        eye, corner = (grid.axes[0] - rebase) * scale, np.empty((3, 8))
        for boxes in (self._still_boxes, self._moving_boxes):
            reach(boxes, grid, eye, scale, slack, block, counts, corner)
        result = np.empty(shape, np.uint8)
        flag(counts, result)
        return result

    def cast(self, aim: Aim, turns: Int64, triangle: Int32) -> Int64:
        """Who owns the samples of some views, as many as the threads take that share `turns`: see
        `packet_loops.cast`. (v,) int64, how many of each are pending."""
        pending = np.zeros(len(triangle), np.int64)
        scratch = new_scratch(self.lanes, aim.across.shape[2])
        cast(scratch, self._scenes, new_packet(self.lanes), aim, turns, triangle, pending)
        return pending

    @property
    def _scenes(self) -> Scenes:
        intersect = (
            self._library.rtcIntersect16 if self.lanes == 16 else self._library.rtcIntersect8
        )
        moving = 0 if self._moving is None else self._moving.scene
        arguments = self._arguments.ctypes.data
        return Scenes(intersect, arguments, self._still.scene, moving, *self._places)


class _Built:
    """An Embree scene of triangles, and the arrays that it refers to."""

    def __init__(
        self,
        library: ctypes.CDLL,
        device: int,
        vertices: Float32,
        triangles: Int32,
        quality: int,
        robust: bool,
    ) -> None:
        self._vertices = _with_one_beyond(vertices)
        self._triangles = np.ascontiguousarray(triangles, np.int32).view(np.uint32)
        self.scene = library.rtcNewScene(device)
        weakref.finalize(self, library.rtcReleaseScene, self.scene)
        # Stated, never left to the library's default.
        library.rtcSetSceneFlags(self.scene, _SCENE_ROBUST if robust else 0)
        library.rtcSetSceneBuildQuality(self.scene, quality)
        geometry = library.rtcNewGeometry(device, _GEOMETRY_TRIANGLE)
        for kind, form, array, rows in (
            (_BUFFER_VERTEX, _FORMAT_FLOAT3, self._vertices, len(vertices)),
            (_BUFFER_INDEX, _FORMAT_UINT3, self._triangles, len(triangles)),
        ):
            library.rtcSetSharedGeometryBuffer(
                geometry, kind, 0, form, array.ctypes.data, 0, array.strides[0], rows
            )
        library.rtcSetGeometryBuildQuality(geometry, quality)
        library.rtcCommitGeometry(geometry)
        if len(triangles):
            library.rtcAttachGeometry(self.scene, geometry)
        library.rtcReleaseGeometry(geometry)
        library.rtcCommitScene(self.scene)
        code = library.rtcGetDeviceError(device)
        if code:
            raise MemoryError(f"Embree cannot build the scene (error {code})")


def _with_one_beyond(vertices: Float32) -> Float32:
    """The vertices, in memory that holds one more at least: Embree reads one with 16 bytes."""
    base = vertices.base
    if (
        isinstance(base, np.ndarray)
        and base.dtype == np.float32
        and base.flags.c_contiguous
        and vertices.flags.c_contiguous
        and base.ctypes.data == vertices.ctypes.data
        and base.size >= vertices.size + 3
    ):
        return vertices
    return np.concatenate([vertices, np.zeros((1, 3), np.float32)])
