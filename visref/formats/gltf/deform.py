"""Meshes whose vertices move: morph targets (section 3.7.2.2) and skins (section 3.7.3).

All in float64, in one order of operations, the rest pose and every other alike; whoever takes
the vertices rounds them once. Attributes are kept as they were decoded, for the vertices of the
`visref.formats.placed.Mesh` alone and in its order.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.scene import Float64


@dataclass(frozen=True, eq=False)
class Influences:
    """`joints`: (v, k) int32, `weights`: (v, k) float64, of each vertex, k = 4 for each pair of
    JOINTS_n and WEIGHTS_n."""

    joints: NDArray[np.int32]
    weights: Float64

    def totals(self) -> Float64:
        """(v,) float64, each vertex's weights added in order."""
        result = np.zeros(len(self.weights))
        for column in range(self.weights.shape[1]):
            result += self.weights[:, column]
        return result

    def take(self, rows: NDArray[Any]) -> Influences:
        """Those of some vertices."""
        return Influences(self.joints[rows], self.weights[rows])

    def place(self, positions: NDArray[Any], world_from_mesh: Float64) -> Float64:
        """Linear blend skinning: (v, 3) float64 in world space, of positions (v, 3) and
        world_from_mesh as each joint alone would have it, (j, 4, 4) float64.

        Weights are taken by their share of their sum, which files round.
        """
        from visref.formats.gltf.skinning import blend

        points = np.ascontiguousarray(positions, np.float64)
        result = np.empty((len(points), 3))
        matrices = np.ascontiguousarray(world_from_mesh)
        blend(points, self.joints, self.weights, matrices, result)
        return result


@dataclass(frozen=True, eq=False)
class Part:
    """One primitive. `base`: (v, 3) positions as stored; `displacements`: (v, 3) of each morph
    target, None for one that moves nothing; `influences`: None where it is not skinned."""

    base: NDArray[Any]
    displacements: Sequence[NDArray[Any] | None]
    influences: Influences | None

    def arrays(self) -> list[NDArray[Any]]:
        """All that it holds."""
        result = [self.base, *(moved for moved in self.displacements if moved is not None)]
        if self.influences is not None:
            result += [self.influences.joints, self.influences.weights]
        return result

    def at(self, weights: Sequence[float], world_from_mesh: Float64 | None) -> Float64:
        """(v, 3) float64, its vertices with these morph weights and joints."""
        result = self.base.astype(np.float64)
        for moved, weight in zip(self.displacements, weights, strict=False):
            if moved is not None and weight != 0.0:
                result += np.multiply(moved, weight, dtype=np.float64)
        if self.influences is None or world_from_mesh is None:
            return result
        return self.influences.place(result, world_from_mesh)


@dataclass(frozen=True, eq=False)
class Deformer:
    """A mesh's primitives, in order."""

    parts: Sequence[Part]

    def at(self, weights: Sequence[float], world_from_mesh: Float64 | None) -> Float64:
        """(v, 3) float64, as `Mesh.positions` of the mesh: in its own space, or in world space
        where it is skinned."""
        return np.concatenate([part.at(weights, world_from_mesh) for part in self.parts])

    def digest(self) -> bytes:
        """Of all that it holds."""
        state = hashlib.sha256()
        for part in self.parts:
            state.update(f"part {[moved is not None for moved in part.displacements]}".encode())
            for array in part.arrays():
                state.update(f"{array.dtype.str} {array.shape}".encode())
                state.update(np.ascontiguousarray(array).view(np.uint8).data)
        return state.digest()
