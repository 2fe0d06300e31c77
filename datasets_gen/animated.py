"""Scenes in motion: what a still scene graph lacks, and a GLB and a camera path that hold it.

Tracks move a node, its morph weights or its visibility; a skin's joints place a mesh's vertices;
a node may have coarser levels. All tracks of a file make one animation.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref_datasets_gen.dataset import json_bytes, write_files
from visref_datasets_gen.glb import GlbDocument
from visref_datasets_gen.graph import Node, Primitive
from visref_datasets_gen.shapes import Float64

_UNSIGNED_BYTE, _FLOAT = 5121, 5126
_ARRAY_BUFFER = 34962
_KINDS = {1: "SCALAR", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
VISIBLE = "visible"


@dataclass(frozen=True, eq=False)
class Track:
    """`path`: translation, rotation, scale, weights, or visible; `times_s`: (k,) ascending;
    `values`: (k, width), rotations as unit quaternions x, y, z, w, visible 0 or 1; of a cubic
    spline (k, 3, width), the tangent in, the value and the tangent out. `how`: STEP, LINEAR or
    CUBICSPLINE."""

    path: str
    times_s: Float64
    values: Float64
    how: str = "LINEAR"


@dataclass(frozen=True, eq=False)
class Skin:
    """`joints`: nodes of the same file; `inverse_bind`: (j, 4, 4) float64, joint_from_mesh in the
    bind pose. `mesh` primitives are `SkinnedPrimitive`."""

    joints: tuple[Node, ...]
    inverse_bind: Float64


@dataclass(frozen=True, eq=False)
class AnimatedNode(Node):
    """A node whose `parent_from_node` is a translation wherever it has tracks of its place.

    `levels`: coarser ones of it, the finest first; `visible`: whether it and what is below it
    show, where no track says otherwise.
    """

    tracks: tuple[Track, ...] = ()
    skin: Skin | None = None
    levels: tuple[Node, ...] = ()
    visible: bool = True


@dataclass(frozen=True, eq=False)
class MorphPrimitive(Primitive):
    """`targets`: displacements, (v, 3) float32 each, scaled by the node's weights and added."""

    targets: tuple[NDArray[np.float32], ...] = ()


@dataclass(frozen=True, eq=False)
class SkinnedPrimitive(Primitive):
    """`joints`: (v, 4) uint8; `weights`: (v, 4) float32, their sum 1."""

    joints: NDArray[np.uint8] = field(default_factory=lambda: np.zeros((0, 4), np.uint8))
    weights: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 4), np.float32))


@dataclass(frozen=True, eq=False)
class AnimatedDataset:
    """A scene graph in motion and a path through it: `path` is the path file's JSON value."""

    name: str
    clip: str
    nodes: tuple[Node, ...]
    path: dict[str, Any]

    def write(self, directory: Path) -> tuple[Path, Path]:
        """Write NAME.glb and NAME.path.json, as `Dataset.write` does."""
        scene_file = directory / f"{self.name}.glb"
        path_file = directory / f"{self.name}.path.json"
        made = {
            scene_file: animated_glb_bytes(self.nodes, self.clip),
            path_file: json_bytes(self.path),
        }
        write_files(directory, made)
        return scene_file, path_file

    def resized(self, width: int, height: int) -> AnimatedDataset:
        """The same with images of another size."""
        return replace(self, path={**self.path, "width": width, "height": height})


def animated_glb_bytes(nodes: tuple[Node, ...], clip: str) -> bytes:
    """The GLB file that holds `nodes`, in their order, and their tracks as the animation `clip`."""
    document = _AnimatedDocument()
    roots = [document.node(node) for node in nodes]
    document.finish(clip)
    return document.pack(roots)


class _AnimatedDocument(GlbDocument):
    def __init__(self) -> None:
        super().__init__()
        self._index: dict[int, int] = {}
        self._animated: list[tuple[int, AnimatedNode]] = []
        self._shared: dict[bytes, int] = {}
        self._used: set[str] = set()

    def node(self, node: Node) -> int:
        index = self._index[id(node)] = super().node(node)
        if not isinstance(node, AnimatedNode):
            return index
        if any(track.path in ("translation", "rotation", "scale") for track in node.tracks):
            assert np.array_equal(node.parent_from_node[:3, :3], np.eye(3)), node.name
        self._animated.append((index, node))
        extensions: dict[str, Any] = {}
        if not node.visible or any(track.path == VISIBLE for track in node.tracks):
            extensions["KHR_node_visibility"] = {"visible": node.visible}
        if node.levels:
            extensions["MSFT_lod"] = {"ids": [self.node(level) for level in node.levels]}
        if extensions:
            self._used |= extensions.keys()
            self.nodes[index]["extensions"] = extensions
        return index

    def primitive(self, primitive: Primitive) -> dict[str, Any]:
        entry = super().primitive(primitive)
        if isinstance(primitive, MorphPrimitive):
            entry["targets"] = [
                {"POSITION": self.accessor(target, _ARRAY_BUFFER)} for target in primitive.targets
            ]
        if isinstance(primitive, SkinnedPrimitive):
            rows: dict[str, NDArray[Any]] = {
                "JOINTS_0": primitive.joints,
                "WEIGHTS_0": primitive.weights,
            }
            entry["attributes"] |= {
                name: self._numbers(values, target=_ARRAY_BUFFER) for name, values in rows.items()
            }
        return entry

    def finish(self, clip: str) -> None:
        """Skins and the animation, which name nodes by their numbers."""
        skins: list[dict[str, Any]] = []
        channels: list[dict[str, Any]] = []
        samplers: list[dict[str, Any]] = []
        for index, node in self._animated:
            if node.skin is not None:
                self.nodes[index]["skin"] = len(skins)
                matrices = node.skin.inverse_bind.transpose(0, 2, 1).reshape(-1, 16)
                skins.append(
                    {
                        "joints": [self._index[id(joint)] for joint in node.skin.joints],
                        "inverseBindMatrices": self._numbers(matrices),
                    }
                )
            for track in node.tracks:
                channels.append({"sampler": len(samplers), "target": self._target(index, track)})
                samplers.append(self._sampler(track))
        if skins:
            self.more["skins"] = skins
        if channels:
            self.more["animations"] = [{"name": clip, "channels": channels, "samplers": samplers}]
        if self._used:
            self.more["extensionsUsed"] = sorted(self._used)

    def _target(self, index: int, track: Track) -> dict[str, Any]:
        if track.path != VISIBLE:
            return {"node": index, "path": track.path}
        self._used.add("KHR_animation_pointer")
        pointer = f"/nodes/{index}/extensions/KHR_node_visibility/visible"
        return {"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": pointer}}}

    def _sampler(self, track: Track) -> dict[str, Any]:
        times = np.asarray(track.times_s, np.float32).reshape(-1, 1)
        values = np.asarray(track.values)
        # Weights are a list of numbers, whatever their count.
        width = 1 if track.path in ("weights", VISIBLE) else values.shape[-1]
        kind = np.uint8 if track.path == VISIBLE else np.float32
        return {
            "input": self._numbers(times, bounds=True),
            "interpolation": track.how,
            "output": self._numbers(values.reshape(-1, width).astype(kind)),
        }

    def _numbers(
        self, values: NDArray[Any], *, bounds: bool = False, target: int | None = None
    ) -> int:
        """An accessor of bytes or float32, (n, width); equal ones are stored once."""
        small = values.dtype == np.uint8
        data = np.ascontiguousarray(values, "u1" if small else "<f4")
        entry: dict[str, Any] = {
            "componentType": _UNSIGNED_BYTE if small else _FLOAT,
            "count": len(data),
            "type": _KINDS[data.shape[1]],
        }
        if bounds:
            entry |= {"min": data.min(axis=0).tolist(), "max": data.max(axis=0).tolist()}
        key = repr((entry, target)).encode() + data.tobytes()
        if key not in self._shared:
            more = {} if target is None else {"target": target}
            entry["bufferView"] = self.view(data.tobytes(), **more)
            self.accessors.append(entry)
            self._shared[key] = len(self.accessors) - 1
        return self._shared[key]


def at_place(at: Iterable[float]) -> Float64:
    """(4, 4) float64, a translation in metres."""
    matrix = np.eye(4)
    matrix[:3, 3] = np.asarray(list(at), np.float64)
    return matrix
