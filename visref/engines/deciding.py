"""What a ray library's hits leave open is decided in float64: samples whose hit does not count,
what masked triangles own, and what blended ones veil. Nothing is recast: triangles are tested
against samples (`splat_kernels`, `mask_kernels`)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.engines import mask_kernels, ray_kernels, splat_kernels
from visref.engines.crew import Crew
from visref.engines.lending import Lender
from visref.engines.ray_kernels import PENDING, SampleGrid, Triangles
from visref.masks.store import Masks
from visref.scene import Alpha, Float64, Int32, Int64, Scene
from visref.visibility import (
    BACKGROUND,
    BlendVisibility,
    Doubt,
    FrameTruth,
    VisibilityBuffer,
)

# Hits of masked or blended triangles, a column an array.
Layers = tuple[NDArray[Any], ...]

# How many masked triangles, and rows of an image, a core takes at a time.
MASKED_A_TURN, MASKED_ROWS = 1 << 13, 32


@dataclass(frozen=True)
class View:
    """One view of a scene as it stands, and who owns its samples as far as that is known:
    (samples,) int32, changed in place."""

    scene: Scene
    camera: Camera
    grid: SampleGrid
    mesh: Triangles
    triangle: Int32


class Deciding:
    """Decides of views of one scene, which may move. `solid`: its opaque triangles, (t,) int32;
    `crew` and `memory`: whose threads, and what arrays they get."""

    def __init__(self, scene: Scene, solid: Int32, crew: Crew, memory: Lender) -> None:
        self._solid = solid
        self._masked = of_alpha(scene, Alpha.MASK)
        self._blended = of_alpha(scene, Alpha.BLEND)
        self._crew, self._memory = crew, memory
        # What threads need while they look through masks, while none does.
        self._scratch: list[mask_kernels.Scratch] = []

    def truth(self, view: View, engine: str, *, pending: bool) -> FrameTruth:
        """A view's truth, by the engine of that name. `pending`: whether any sample is."""
        if pending:
            self._settle(view)
        open_ = self._mask(view)
        blend, veiled = self._blend(view, open_)
        camera = view.camera
        image = view.triangle.reshape(camera.height, camera.width)
        buffer = VisibilityBuffer(image, OwnerDepths(view.mesh, view.grid))
        return FrameTruth(camera, engine, buffer, doubt=open_[0], blend=blend, veiled=veiled)

    def _settle(self, view: View) -> None:
        """Decide the pending samples in float64, against all opaque triangles."""
        triangle, mesh, grid = view.triangle, view.mesh, view.grid
        mark = triangle == PENDING
        triangle[mark] = BACKGROUND
        depth = np.empty(len(triangle))
        depth[mark] = np.inf
        rows, columns = np.divmod(np.flatnonzero(mark), len(grid.column_a))
        window = (int(columns.min()), int(columns.max()) + 1, int(rows[0]), int(rows[-1]) + 1)

        def work(part: tuple[int, int, int, int]) -> None:
            splat_kernels.splat(self._solid, mesh, grid, part, mark, triangle, depth)

        self._crew.in_bands(window, work)

    def _mask(self, view: View) -> tuple[Doubt, Float64]:
        """Let masked triangles own the samples where they are solid, in place, and return the
        samples that they leave open, with the least depth of what may be seen at each."""
        if not len(self._masked):
            return Doubt(), np.zeros(0)
        camera, mesh, grid = view.camera, view.mesh, view.grid
        axes = np.stack([camera.eye, camera.forward, camera.right_step, camera.up_step])
        masks = view.scene.masks or Masks.none(view.scene.triangle_count)
        parts: list[Layers] = self._crew.by_turns(
            lambda start: mask_kernels.in_view(
                self._masked[start : start + MASKED_A_TURN], mesh, grid
            ),
            range(0, len(self._masked), MASKED_A_TURN),
        )
        found = mask_kernels.InView._make(_joined(parts, self._memory))
        seen = found.taken(self._by_depth(found.nearest))
        if not len(seen.triangle):
            return Doubt(), np.zeros(0)
        top, bottom = int(seen.window[:, 2].min()), int(seen.window[:, 3].max())

        def work(row: int) -> Layers:
            try:
                scratch = self._scratch.pop().seeing(grid, MASKED_ROWS)
            except IndexError:
                scratch = mask_kernels.Scratch.of(grid, MASKED_ROWS)
            rows = row, min(row + MASKED_ROWS, bottom)
            found = mask_kernels.shown(seen, mesh, grid, rows, view.triangle, masks, axes, scratch)
            self._scratch.append(scratch)
            return found

        bands = self._crew.by_turns(work, range(top, bottom, MASKED_ROWS))
        sample, many, which, least = _joined(bands, self._memory)
        offsets = self._memory.lend(len(many) + 1, np.int64)
        offsets[0] = 0
        np.cumsum(many, out=offsets[1:])
        return Doubt(sample, offsets, which), least

    def _by_depth(self, nearest: Float64) -> Int64:
        """The order in which masked triangles are looked at, by the least depths of each."""
        return np.argsort(nearest)

    def _blend(self, view: View, open_: tuple[Doubt, Float64]) -> tuple[BlendVisibility, Int32]:
        """Blended triangles that lie before the owners, and before all that a mask leaves open;
        and those, ascending, that lie before the owners alone."""
        if not len(self._blended):
            return BlendVisibility(), np.zeros(0, np.int32)
        mesh, grid = view.mesh, view.grid

        def work(part: tuple[int, int, int, int]) -> Layers:
            found: Layers = splat_kernels.layers(
                self._blended, mesh, grid, part, view.triangle, False
            )
            return found

        whole = 0, len(grid.column_a), 0, len(grid.row_b)
        sample, which, z, error = _joined(self._crew.in_bands(whole, work), self._memory)
        doubt, least = open_
        kept = np.ones(len(sample), np.bool_)
        if len(doubt):
            place = np.minimum(np.searchsorted(doubt.sample, sample), len(doubt) - 1)
            kept = (doubt.sample[place] != sample) | (z + error < least[place])
        blend = BlendVisibility.of(view.scene, sample[kept], which[kept], z[kept])
        return blend, np.unique(which[~kept])


@dataclass(frozen=True)
class OwnerDepths:
    """How deep a frame's owners lie: in float64, as they stood when it was cast."""

    mesh: Triangles
    grid: SampleGrid

    def __call__(self, triangle: Int32, samples: Int64 | None) -> Float64:
        """As `visref.visibility.DepthOf`."""
        depth = np.full(len(triangle), np.inf)
        if len(self.mesh.triangles):
            at = np.zeros(0, np.int64) if samples is None else samples
            everywhere = samples is None
            ray_kernels.owner_depths(triangle, at, everywhere, self.mesh, self.grid, depth)
        return depth


def of_alpha(scene: Scene, alpha: Alpha) -> Int32:
    """(k,) int32, the triangles of that kind."""
    return np.flatnonzero(scene.alpha == alpha).astype(np.int32)


def _joined(bands: list[Layers], memory: Lender) -> Layers:
    """Each column of the bands' hits, one after another."""
    found = []
    for column in zip(*bands, strict=True):
        rows, of_row = sum(len(part) for part in column), column[0].shape[1:]
        room = memory.lend(rows * math.prod(of_row), column[0].dtype)
        found.append(np.concatenate(column, out=room.reshape(rows, *of_row)))
    return tuple(found)
