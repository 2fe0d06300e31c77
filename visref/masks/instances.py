"""Alpha masks on their way into a scene: per mesh as a file has them, then a row per triangle.

The instances of a mesh share its rows, so a forest of one tree holds that tree's texture
coordinates once. Mirrored instances share a second copy: where the winding is flipped, the
corners change places, and what stands at them goes along.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.masks.materials import MaskMaterial
from visref.masks.store import TRIANGLE, Masks
from visref.masks.textures import AlphaImage


@dataclass
class MaskTable:
    """The masked materials of a file and their images, each once."""

    materials: list[MaskMaterial] = field(default_factory=list)
    images: list[AlphaImage] = field(default_factory=list)
    _known: dict[MaskMaterial, int] = field(default_factory=dict)

    def index_of(self, material: MaskMaterial) -> int:
        """Its index in `materials`, where it is put if it is new."""
        if material not in self._known:
            self._known[material] = len(self.materials)
            self.materials.append(material)
        return self._known[material]

    def add_image(self, image: AlphaImage) -> int:
        """Its index in `images`."""
        self.images.append(image)
        return len(self.images) - 1


@dataclass(frozen=True, eq=False)
class MeshMasks:
    """The masked triangles of a mesh.

    `row`: (t,) int32, a triangle's index in `corners`, -1 for one without a mask. `corners`:
    (m,) of `visref.masks.store.TRIANGLE`, corners in the triangle's order.
    """

    row: NDArray[np.int32]
    corners: NDArray[Any]

    @classmethod
    def of(
        cls, masked: NDArray[np.bool_], material: int, uv: NDArray[Any], alpha: NDArray[Any]
    ) -> MeshMasks:
        """`masked`: (t,) bool; of all t triangles `uv` (t, 3, 2) and vertex alpha (t, 3)."""
        count = int(masked.sum())
        row = np.full(len(masked), -1, np.int32)
        row[masked] = np.arange(count)
        corners = np.zeros(count, TRIANGLE)
        corners["material"] = material
        corners["uv"] = uv[masked]
        corners["vertex_alpha"] = alpha[masked]
        return cls(row, corners)

    @classmethod
    def joined(cls, parts: Sequence[tuple[int, MeshMasks | None]]) -> MeshMasks | None:
        """Of primitives one after another: each one's number of triangles, and its masks."""
        if all(masks is None for _, masks in parts):
            return None
        rows: list[NDArray[np.int32]] = []
        corners: list[NDArray[Any]] = []
        base = 0
        for count, masks in parts:
            if masks is None:
                rows.append(np.full(count, -1, np.int32))
                continue
            rows.append(_shifted(masks.row, np.int32(base)))
            corners.append(masks.corners)
            base += len(masks.corners)
        return cls(np.concatenate(rows), np.concatenate(corners))


class MaskRows:
    """The rows of a scene's triangles, filled mesh by mesh."""

    def __init__(self, triangle_count: int) -> None:
        self._triangle_count = triangle_count
        self._corners: list[NDArray[Any]] = []
        self._count = 0

    @cached_property
    def row(self) -> NDArray[np.int32]:
        """(t,) int32, of each triangle; made once something has one."""
        return np.full(self._triangle_count, -1, np.int32)

    def add(self, masks: MeshMasks, mirrored: NDArray[np.bool_]) -> NDArray[np.int32]:
        """(k,) int32, where each of a mesh's k instances has its rows, for `fill`."""
        bases = np.zeros(len(mirrored), np.int32)
        for flipped in (False, True):
            if not (mirrored == flipped).any():
                continue
            bases[mirrored == flipped] = self._count
            corners = masks.corners.copy()
            if flipped:
                corners["uv"] = corners["uv"][:, ::-1]
                corners["vertex_alpha"] = corners["vertex_alpha"][:, ::-1]
            self._corners.append(corners)
            self._count += len(corners)
        return bases

    def fill(self, triangles: NDArray[Any], masks: MeshMasks, bases: NDArray[np.int32]) -> None:
        """Give `triangles` (k, t), a row for each instance, the rows of their mesh."""
        self.row[triangles] = _shifted(masks.row, bases[:, None])

    def masks(self, table: MaskTable) -> Masks | None:
        """All of it, or None where no triangle is masked."""
        if not self._count:
            return None
        corners = np.concatenate(self._corners)
        return Masks.build(
            self.row,
            corners["material"],
            corners["uv"],
            corners["vertex_alpha"],
            table.materials,
            table.images,
        )


def _shifted(row: NDArray[np.int32], base: Any) -> NDArray[np.int32]:
    result: NDArray[np.int32] = np.where(row >= 0, row + base, np.int32(-1))
    return result
