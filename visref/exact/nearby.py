"""The triangles near samples: what the margins and a rasteriser's surfaces look through."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from visref.camera import Camera
from visref.exact import screen
from visref.exact.filters import View
from visref.exact.scene import Bool, ExactScene
from visref.scene import Int64


class Nearby(NamedTuple):
    """Some samples, and the triangles that may lie within a radius of each.

    `x`, `y`: (k,) int64, the samples' columns and rows; `tile`: (k,) int64, their tiles in
    `binned`.
    """

    x: Int64
    y: Int64
    tile: Int64
    binned: screen.Binned

    def part(self, some: slice) -> Nearby:
        """The same of some of the samples."""
        return self._replace(x=self.x[some], y=self.y[some], tile=self.tile[some])


def near_samples(
    exact_scene: ExactScene,
    camera: Camera,
    view: View,
    usable: Bool,
    samples: Int64,
    radius_px: float,
) -> Nearby:
    """Find the triangles within a radius of some samples, (k,) flat indices.

    `view`: of the camera, perhaps with a larger range. `usable`: (t,) bool, in cluster order.
    Outward: triangles a little farther off are found too.
    """
    y, x = samples // camera.width, samples % camera.width
    wanted = np.zeros((camera.height, camera.width), np.bool_)
    wanted[y, x] = True
    # Half a pixel more than the radius holds every box's rounding.
    found, boxes, keys = exact_scene.project(view, usable, wanted, radius_px + 0.5)
    columns, rows = -(-camera.width // screen.TILE), -(-camera.height // screen.TILE)
    tile = y // screen.TILE * columns + x // screen.TILE
    tiles = np.zeros(rows * columns, np.bool_)
    tiles[tile] = True
    offsets, entries = screen.bin_boxes(boxes, tiles, columns)
    return Nearby(x, y, tile, screen.Binned(found, boxes, keys, offsets, entries, columns))
