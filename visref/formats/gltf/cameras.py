"""A glTF file's own cameras as a path: its camera nodes, still or animated.

Every camera node that the scene reaches is a piece of the path, in the hierarchy's order. An
animation that moves the node or one of its ancestors is played, each such animation a piece
of its own; without one the camera is a single frame. A new piece starts with a cut.

A camera's scale means nothing to its view (section 3.10.1 asks that it be ignored), so the
columns of its matrix are normalised, here and nowhere else.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.camera_path import CameraPath
from visref.errors import InputError
from visref.formats.gltf.accessors import read_floats
from visref.formats.gltf.document import Document, Json
from visref.formats.gltf.nodes import Nodes, have_length, read_nodes, trs_matrices
from visref.formats.placed import compose
from visref.scene import Float64

# Exporters write matrices with as few as six digits: an entry of a unit column is off by up to
# 5e-7, the product of two columns by 6 * 5e-7 = 3e-6, and in a chain of a few nodes a few times
# that. Anything more is shear; up to here the nearest rotation stands in.
SHEAR_TOLERANCE = 2e-5

_PATHS = {"translation": "VEC3", "rotation": "VEC4", "scale": "VEC3"}
# Frames from one animation; a corrupt time of 1e30 seconds must not fill the memory.
_MAX_FRAMES = 1_000_000
# Of the ways from the root to each animated camera, together: some seconds of work.
_MAX_STEPS = 100_000
# A camera: its matrix as an array of its own, its fields, and what it works out once.
_CAMERA_BYTES = 1500


def read_cameras(document: Document, *, width: int, height: int, fps: float | None) -> CameraPath:
    """The file's cameras at a given resolution. Raises InputError naming the place.

    The vertical field of view is kept; the file's own aspect ratio is not used. `fps`:
    frames a second of animation; None takes the keyframes' times.
    """
    if fps is not None and not 0.0 < fps < math.inf:
        raise InputError(f"fps is {fps}", place="fps", fix="give frames a second above 0")
    nodes = read_nodes(document)
    world_from_node = nodes.world_from_node()
    moved = _below_what_moves(document, nodes)
    steps = 0
    frames: list[Camera] = []
    for node in nodes.order:
        entry = document.entries("nodes")[node]
        if "camera" not in entry.value:
            continue
        lens = document.entry("cameras", entry["camera"])
        pieces = []
        if node in moved:
            chain = nodes.chain(node)
            steps += len(chain)
            if steps > _MAX_STEPS:
                entry.fail("animated cameras are nested too deep", "export fewer of them")
            pieces = _moves(document, nodes, chain, fps)
        for matrices in pieces or [world_from_node[node][None]]:
            document.budget.claim(
                f"{len(frames) + len(matrices):,} cameras",
                len(matrices) * _CAMERA_BYTES,
                place=entry.place,
            )
            poses = [_rigid(matrix, entry) for matrix in matrices]
            piece = [_camera(lens, pose, width, height) for pose in poses]
            if frames:
                piece[0] = replace(piece[0], cut=True)
            frames.extend(piece)
    if not frames:
        raise InputError(
            "no node of the file's scene has a camera",
            place="nodes",
            fix="give a path file, or export the scene with its camera",
        )
    return CameraPath(tuple(frames))


def _camera(lens: Json, pose: Float64, width: int, height: int) -> Camera:
    kind = lens["type"].text()
    if kind not in ("perspective", "orthographic"):
        lens["type"].fail(f"'{kind}' is not perspective or orthographic")
    values = lens[kind]
    far = values.get("zfar")
    try:
        return Camera(
            world_from_camera=pose,
            width=width,
            height=height,
            near=values["znear"].number(),
            far=math.inf if far is None else far.number(),
            yfov=values["yfov"].number() if kind == "perspective" else None,
            ymag=values["ymag"].number() if kind == "orthographic" else None,
        )
    except InputError as error:
        inside = error.place.startswith(values.place) or error.place in ("width", "height")
        raise error if inside else error.at(place=values.place) from error


def _rigid(world_from_node: Float64, node: Json) -> Float64:
    """The camera's pose: the node's matrix with its columns normalised."""
    if not np.isfinite(world_from_node).all():
        node.fail("the camera's matrix is not finite", "mend its node, its parents, their keys")
    linear = world_from_node[:3, :3]
    lengths = np.linalg.norm(linear, axis=0)
    fix = "remove it from the camera's node and its parents"
    if not lengths.all():
        node.fail("the camera's matrix is singular", fix)
    axes = linear / lengths
    if np.linalg.det(axes) < 0.0:
        node.fail("the camera's matrix is mirrored", fix)
    error = float(np.abs(axes.T @ axes - np.eye(3)).max())
    if error > SHEAR_TOLERANCE:
        node.fail(f"the camera's matrix is sheared (by {error:.3g})", fix)
    left, _, right = np.linalg.svd(axes)
    pose = np.eye(4)
    pose[:3, :3] = left @ right
    pose[:3, 3] = world_from_node[:3, 3]
    return pose


@dataclass(frozen=True, eq=False)
class _Channel:
    """One animated property: key times (k,) and values (k, width), or (3k, width) for a
    cubic spline (in-tangent, value, out-tangent of each key)."""

    node: int
    path: str
    times: Float64
    values: Float64
    interpolation: str

    def at(self, times: Float64) -> Float64:
        """(n, width) float64: the property at each time; ends are held (section 3.11)."""
        keys = self.times
        clamped = np.clip(times, keys[0], keys[-1])
        right = np.clip(np.searchsorted(keys, clamped, side="right"), 1, max(1, len(keys) - 1))
        left = right - 1
        if len(keys) == 1:
            right = left
        span = np.where(right > left, keys[right] - keys[left], 1.0)[:, None]
        u = (clamped - keys[left])[:, None] / span
        if self.interpolation == "CUBICSPLINE":
            return self._spline(left, right, u, span)
        if self.interpolation == "STEP":
            return self.values[np.where(u[:, 0] >= 1.0, right, left)]
        if self.path == "rotation":
            return _slerp(self.values[left], self.values[right], u)
        return (1.0 - u) * self.values[left] + u * self.values[right]

    def _spline(
        self, left: NDArray[Any], right: NDArray[Any], u: Float64, span: Float64
    ) -> Float64:
        """Cubic Hermite spline (appendix C.5)."""
        into, value, out = self.values.reshape(len(self.times), 3, -1).transpose(1, 0, 2)
        u2, u3 = u * u, u * u * u
        result: Float64 = (
            (2.0 * u3 - 3.0 * u2 + 1.0) * value[left]
            + span * (u3 - 2.0 * u2 + u) * out[left]
            + (3.0 * u2 - 2.0 * u3) * value[right]
            + span * (u3 - u2) * into[right]
        )
        return result


def _slerp(a: Float64, b: Float64, u: Float64) -> Float64:
    """Spherical interpolation of (n, 4) quaternions the short way (appendix C.4)."""
    a = a / np.linalg.norm(a, axis=1, keepdims=True)
    b = b / np.linalg.norm(b, axis=1, keepdims=True)
    b = np.where((a * b).sum(axis=1, keepdims=True) < 0.0, -b, b)
    # Twice the half angle's arctangent: accurate for small angles, where acos is not.
    angle = 2.0 * np.arctan2(
        np.linalg.norm(a - b, axis=1, keepdims=True), np.linalg.norm(a + b, axis=1, keepdims=True)
    )
    sine = np.sin(angle)
    straight = sine == 0.0
    safe = np.where(straight, 1.0, sine)
    result: Float64 = (
        np.where(straight, 1.0 - u, np.sin((1.0 - u) * angle) / safe) * a
        + np.where(straight, u, np.sin(u * angle) / safe) * b
    )
    return result


def _below_what_moves(document: Document, nodes: Nodes) -> set[int]:
    """The nodes that an animation moves, with all below them."""
    targets = {
        target.integer()
        for animation in document.entries("animations")
        for channel in animation["channels"].items()
        if (target := channel["target"].get("node")) is not None
    }
    moved: set[int] = set()
    for node in nodes.order:
        if node in targets or nodes.parent[node] in moved:
            moved.add(node)
    return moved


def _moves(document: Document, nodes: Nodes, chain: list[int], fps: float | None) -> list[Float64]:
    """(frames, 4, 4) float64 world_from_node of the last node of `chain`, which is the way to it
    from the root, for each animation that moves it."""
    pieces = []
    for animation in document.entries("animations"):
        channels = _channels(document, animation, set(chain))
        if not channels:
            continue
        keys = np.unique(np.concatenate([channel.times for channel in channels]))
        times = keys if fps is None else _ticks(keys, fps, animation)
        # Its matrix, one of the chain's, and the products while they are added up.
        document.budget.need(
            f"{len(times):,} frames", len(times) * 8 * 16 * 6, place=animation.place
        )
        world = np.tile(np.eye(4), (len(times), 1, 1))
        for step in chain:
            world = compose(world, _animated(nodes, step, channels, times))
        pieces.append(world)
    return pieces


def _ticks(keys: Float64, fps: float, animation: Json) -> Float64:
    # Half a millionth of a frame: the last tick is kept where rounding falls just short of it.
    count = (keys[-1] - keys[0]) * fps + 5e-7
    if count > _MAX_FRAMES:
        animation.fail(f"it lasts for {count:.3g} frames", f"at most {_MAX_FRAMES} are read")
    result: Float64 = np.minimum(keys[0] + np.arange(math.floor(count) + 1) / fps, keys[-1])
    return result


def _animated(nodes: Nodes, node: int, channels: list[_Channel], times: Float64) -> Float64:
    """(n, 4, 4) float64: the node's own transform at each time."""
    mine = {channel.path: channel.at(times) for channel in channels if channel.node == node}
    if not mine and node in nodes.matrix:
        return nodes.matrix[node][None]

    def rest(values: Float64) -> Float64:
        return np.tile(values[node], (len(times), 1))

    return trs_matrices(
        mine.get("translation", rest(nodes.translation)),
        mine.get("rotation", rest(nodes.rotation)),
        mine.get("scale", rest(nodes.scale)),
    )


def _channels(document: Document, animation: Json, wanted: set[int]) -> list[_Channel]:
    """The channels of one animation that move the wanted nodes."""
    samplers = animation["samplers"].items()
    result = []
    for channel in animation["channels"].items():
        target = channel["target"]
        node = target.get("node")
        if node is None or node.integer() not in wanted:
            continue
        path = target["path"].text()
        if path not in _PATHS:
            continue
        entry = document.entry("nodes", node)
        if "matrix" in entry.value:
            entry.fail("an animated node has a matrix", "give translation, rotation, scale")
        index = channel["sampler"].integer()
        if index >= len(samplers):
            channel["sampler"].fail(f"samplers[{index}] is named of {len(samplers)}")
        result.append(_channel(document, node.integer(), path, samplers[index]))
    return result


def _channel(document: Document, node: int, path: str, sampler: Json) -> _Channel:
    named = sampler.get("interpolation")
    interpolation = "LINEAR" if named is None else named.text()
    if interpolation not in ("LINEAR", "STEP", "CUBICSPLINE"):
        sampler.fail(f"interpolation '{interpolation}' is not known")
    times = read_floats(document, sampler["input"], ("SCALAR",))[:, 0].astype(np.float64)
    values = read_floats(document, sampler["output"], (_PATHS[path],), integers=True)
    values = values.astype(np.float64)
    expected = len(times) * (3 if interpolation == "CUBICSPLINE" else 1)
    if len(values) != expected:
        sampler.fail(f"{len(values)} output values where {expected} belong to its times")
    if not np.isfinite(times).all() or (np.diff(times) <= 0.0).any():
        sampler["input"].fail("its times do not increase")
    if not np.isfinite(values).all():
        sampler["output"].fail("a value is NaN or infinite")
    if path == "rotation" and interpolation != "CUBICSPLINE" and not have_length(values):
        sampler["output"].fail("a rotation of zero or infinite length")
    return _Channel(node, path, times, values, interpolation)
