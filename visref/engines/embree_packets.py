"""Embree's ray packets, through the library that embreex brings along.

embreex casts single rays. Neighbouring samples share nearly all of their way through the
hierarchy, and Embree's own interface casts eight such rays at once (`rtcIntersect8` with
`RTC_RAY_QUERY_FLAG_COHERENT`), two to three times as fast. Bound here is that one call and
what it takes to build a scene of triangles; numbers and layouts are those of Embree 4's
rtcore headers, which stay the same throughout version 4.

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

from visref.compiled import njit
from visref.scene import Float32, Int32

_DEVICE_VERSION, _DEVICE_NATIVE_RAY8 = 0, 33
_SCENE_ROBUST = 1 << 2
_QUALITY_LOW, _QUALITY_MEDIUM = 0, 1
_GEOMETRY_TRIANGLE = 0
_BUFFER_INDEX, _BUFFER_VERTEX = 0, 1
_FORMAT_UINT3, _FORMAT_FLOAT3 = 0x5003, 0x9003
_QUERY_COHERENT = 1 << 16
_ALL_FEATURES = 0xFFFFFFFF

LANES = 8

# RTCRayHit8 in 32-bit words: eight lanes each of origin, tnear, direction, time, tfar, mask,
# id, flags, then the normal, u, v, the primitive's, the geometry's and the instance's ids
# (one or two words per level). 2 KiB hold it, the valid mask and the alignment to spare.
_TNEAR, _DIRECTION, _TIME, _TFAR = 3 * LANES, 4 * LANES, 7 * LANES, 8 * LANES
_MASK, _ID, _FLAGS = 9 * LANES, 10 * LANES, 11 * LANES
_PRIMITIVE, _GEOMETRY = 17 * LANES, 18 * LANES
_VALID = 32 * LANES
_SCRATCH_WORDS = 34 * LANES
_ALIGNMENT = 64

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
    """Triangles in Embree, cast eight rays at a time.

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
        self._moving: _Built | None = None
        self._places = np.zeros(0, np.int32), np.zeros(0, np.int32)
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
        self._places = places

    def _built(self, vertices: Float32, triangles: Int32, quality: int) -> _Built:
        return _Built(self._library, self._device, vertices, triangles, quality, self._robust)

    def nearest(self, rays: Float32) -> Int32:
        """(n,) int32, the nearest triangle along each ray (n, 6), -1 for none."""
        primitives = np.empty(len(rays), np.int32)
        memory = np.empty(_SCRATCH_WORDS + _ALIGNMENT // 4, np.float32)
        scratch = memory[-(memory.ctypes.data // 4) % (_ALIGNMENT // 4) :][:_SCRATCH_WORDS]
        record = scratch, scratch.view(np.int32), scratch.ctypes.data
        intersect8, arguments = self._library.rtcIntersect8, self._arguments.ctypes.data
        if self._moving is None:
            _cast(intersect8, self._still.scene, arguments, rays, *record, primitives)
        else:
            scenes = self._still.scene, self._moving.scene
            _cast_both(intersect8, *scenes, arguments, rays, *record, *self._places, primitives)
        return primitives


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


@njit(inline="always")
def _load(rays, start, words, ids):  # type: ignore[no-untyped-def]
    """Make a packet of the rays from `start` on; lanes beyond the last are not valid."""
    for lane in range(LANES):
        ray = start + lane
        ids[_VALID + lane] = -1 if ray < len(rays) else 0
        ray = min(ray, len(rays) - 1)
        for axis in range(3):
            words[axis * LANES + lane] = rays[ray, axis]
            words[_DIRECTION + axis * LANES + lane] = rays[ray, 3 + axis]
        words[_TNEAR + lane] = 0.0
        words[_TIME + lane] = 0.0
        words[_TFAR + lane] = np.inf
        ids[_MASK + lane] = -1
        ids[_ID + lane] = 0
        ids[_FLAGS + lane] = 0
        ids[_PRIMITIVE + lane] = -1
        ids[_GEOMETRY + lane] = -1


@njit()
def _cast(
    intersect8: Any,
    scene: int,
    arguments: int,
    rays: NDArray[Any],
    words: NDArray[Any],
    ids: NDArray[Any],
    address: int,
    primitives: NDArray[Any],
) -> None:
    """`words` and `ids` are the same aligned memory at `address`, as float32 and as int32."""
    for start in range(0, len(rays), LANES):
        _load(rays, start, words, ids)
        intersect8(address + 4 * _VALID, scene, address, arguments)
        for lane in range(min(LANES, len(rays) - start)):
            primitives[start + lane] = ids[_PRIMITIVE + lane]


@njit()
def _cast_both(
    intersect8: Any,
    still: int,
    moving: int,
    arguments: int,
    rays: NDArray[Any],
    words: NDArray[Any],
    ids: NDArray[Any],
    address: int,
    still_place: NDArray[Any],
    moving_place: NDArray[Any],
    places: NDArray[Any],
) -> None:
    """`_cast` in two scenes, one after the other: the second finds what is no further than what
    was found in the first. What a triangle is called is its place."""
    first, met = np.empty(LANES, np.int32), np.empty(LANES, np.float32)
    for start in range(0, len(rays), LANES):
        _load(rays, start, words, ids)
        intersect8(address + 4 * _VALID, still, address, arguments)
        for lane in range(LANES):
            first[lane], met[lane] = ids[_PRIMITIVE + lane], words[_TFAR + lane]
            ids[_GEOMETRY + lane] = -1
        intersect8(address + 4 * _VALID, moving, address, arguments)
        for lane in range(min(LANES, len(rays) - start)):
            place = still_place[first[lane]] if first[lane] >= 0 else -1
            if ids[_GEOMETRY + lane] != -1:
                other = moving_place[ids[_PRIMITIVE + lane]]
                if place < 0 or words[_TFAR + lane] < met[lane] or other < place:
                    place = other
            places[start + lane] = place
