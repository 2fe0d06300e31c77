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

import numpy as np

from visref.camera import Camera
from visref.camera_path import CameraPath, Frame
from visref.errors import InputError
from visref.formats.gltf.animation import TRANSFORMS, Animations, Channel
from visref.formats.gltf.document import Document
from visref.formats.gltf.nodes import Nodes, read_nodes, trs_matrices
from visref.formats.gltf.values import Json
from visref.formats.placed import compose
from visref.scene import Float64

# Exporters write matrices with as few as six digits: an entry of a unit column is off by up to
# 5e-7, the product of two columns by 6 * 5e-7 = 3e-6, and in a chain of a few nodes a few times
# that. Anything more is shear; up to here the nearest rotation stands in.
SHEAR_TOLERANCE = 2e-5

# Frames from one animation; a corrupt time of 1e30 seconds must not fill the memory.
_MAX_FRAMES = 1_000_000
# Of the ways from the root to each animated camera, together: some seconds of work.
_MAX_STEPS = 100_000
# A camera: its matrix as an array of its own, its fields, and what it works out once; its frame,
# with two dictionaries and a tuple.
_CAMERA_BYTES = 2000


def read_cameras(document: Document, *, width: int, height: int, fps: float | None) -> CameraPath:
    """The file's cameras at a given resolution; the frames of a moving one say the time and the
    animation, so that objects move in step. Raises InputError naming the place.

    The vertical field of view is kept; the file's own aspect ratio is not used. `fps`:
    frames a second of animation; None takes the keyframes' times.
    """
    if fps is not None and not 0.0 < fps < math.inf:
        raise InputError(f"fps is {fps}", place="fps", fix="give frames a second above 0")
    nodes = read_nodes(document)
    world_from_node = nodes.world_from_node()
    animations = Animations(document)
    moved = _below_what_moves(nodes, animations)
    steps = 0
    frames: list[Frame] = []
    for node in nodes.order:
        entry = document.entries("nodes")[node]
        if "camera" not in entry.value:
            continue
        lens = document.entry("cameras", entry["camera"])
        pieces: list[_Piece | None] = []
        if node in moved:
            chain = nodes.chain(node)
            steps += len(chain)
            if steps > _MAX_STEPS:
                entry.fail("animated cameras are nested too deep", "export fewer of them")
            pieces.extend(_moves(nodes, animations, chain, fps))
        for moving in pieces or [None]:
            matrices = world_from_node[node][None] if moving is None else moving.worlds
            document.budget.claim(
                f"{len(frames) + len(matrices):,} cameras",
                len(matrices) * _CAMERA_BYTES,
                place=entry.place,
            )
            poses = [_rigid(matrix, entry) for matrix in matrices]
            piece = [_camera(lens, pose, width, height) for pose in poses]
            if frames:
                piece[0] = replace(piece[0], cut=True)
            if moving is None:
                frames.extend(Frame((camera,)) for camera in piece)
            else:
                frames.extend(
                    Frame((camera,), time_s, animations.clips[moving.clip])
                    for camera, time_s in zip(piece, moving.times.tolist(), strict=True)
                )
    if not frames:
        raise InputError(
            "no node of the file's scene has a camera",
            place="nodes",
            fix="give a path file, or export the scene with its camera",
        )
    return CameraPath(frames)


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


def _below_what_moves(nodes: Nodes, animations: Animations) -> set[int]:
    """The nodes that an animation moves, with all below them."""
    driven = {
        target.index
        for targets in animations.targets
        for target in targets
        if target.kind == "nodes" and target.path in TRANSFORMS
    }
    moved: set[int] = set()
    for node in nodes.order:
        if node in driven or nodes.parent[node] in moved:
            moved.add(node)
    return moved


@dataclass(frozen=True, eq=False)
class _Piece:
    """A camera node's matrices over an animation: `times` (k,) in seconds and `worlds` (k, 4, 4),
    float64; `clip`: the animation's number."""

    clip: int
    times: Float64
    worlds: Float64


def _moves(
    nodes: Nodes, animations: Animations, chain: list[int], fps: float | None
) -> list[_Piece]:
    """How each animation that does so moves the last node of `chain`, which is the way to it from
    the root."""
    pieces = []
    wanted = set(chain)
    for clip, (targets, place) in enumerate(
        zip(animations.targets, animations.places, strict=True)
    ):
        channels = [
            animations.channel(target)
            for target in targets
            if target.kind == "nodes" and target.index in wanted and target.path in TRANSFORMS
        ]
        if not channels:
            continue
        keys = np.unique(np.concatenate([channel.times for channel in channels]))
        times = keys if fps is None else _ticks(keys, fps, place)
        # Its matrix, one of the chain's, and the products while they are added up.
        animations.document.budget.need(
            f"{len(times):,} frames", len(times) * 8 * 16 * 6, place=place.place
        )
        world = np.tile(np.eye(4), (len(times), 1, 1))
        for step in chain:
            world = compose(world, _animated(nodes, step, channels, times))
        pieces.append(_Piece(clip, times, world))
    return pieces


def _ticks(keys: Float64, fps: float, animation: Json) -> Float64:
    # Half a millionth of a frame: the last tick is kept where rounding falls just short of it.
    count = (keys[-1] - keys[0]) * fps + 5e-7
    if count > _MAX_FRAMES:
        animation.fail(f"it lasts for {count:.3g} frames", f"at most {_MAX_FRAMES} are read")
    result: Float64 = np.minimum(keys[0] + np.arange(math.floor(count) + 1) / fps, keys[-1])
    return result


def _animated(nodes: Nodes, node: int, channels: list[Channel], times: Float64) -> Float64:
    """(n, 4, 4) float64: the node's own transform at each time."""
    mine = {
        channel.target.path: channel.at(times)
        for channel in channels
        if channel.target.index == node
    }
    if not mine and node in nodes.matrix:
        return nodes.matrix[node][None]

    def rest(values: Float64) -> Float64:
        return np.tile(values[node], (len(times), 1))

    return trs_matrices(
        mine.get("translation", rest(nodes.translation)),
        mine.get("rotation", rest(nodes.rotation)),
        mine.get("scale", rest(nodes.scale)),
    )
