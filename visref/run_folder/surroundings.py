"""What a witness's line says of its surroundings: the frame around it, as it ought to be seen and
as it was drawn, and the same few pixels at closer sight.

Pictures rest on it, no verdict does. What ought to be seen are the truth's own owners. What was
drawn is the same wherever that was drawn, and elsewhere what a float64 rasteriser finds behind it.
The closer sight lies between the samples, by that rasteriser; a mask is there over a pixel what it
is at the pixel's sample.

A picture is a list of run lengths, row by row: a number of cells, the place of their appearance in
`appearances`, and so on. A record takes 3 to 15 kB as a rule, and never more than 200 kB: there are
at most 2 x 48 x 48 + 56 x 56 cells and 256 appearances.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.run_folder.balls import BLOCK
from visref.run_folder.colours import BRIGHTEST, DARKEST
from visref.run_folder.cuts import Cut
from visref.run_folder.layout import (
    CLOSE_CELLS,
    CLOSE_PX,
    MAX_APPEARANCES,
    OTHERS,
    SHADES,
)
from visref.run_folder.pictures import light_on
from visref.run_folder.silhouettes import UnitImage, Window, from_behind
from visref.scene import Alpha, Float64, Int32, Int64, Scene, Units
from visref.visibility import mask_states

# A name as a picture may show it.
NAME_LENGTH = 80
# How many holes of masks and cut-away surfaces are looked through behind a lost sample.
_LAYERS = 8


class _Cells(NamedTuple):
    """What is seen at each cell: (h, w) int32 triangles, -1 for none."""

    triangle: Int32
    glass: Int32
    lost: NDArray[np.bool_]


class Surroundings:
    """Makes the records of one scene. `balls`: (blocks, 4) float64, centre and radius about each
    64 triangles."""

    def __init__(self, scene: Scene, balls: Float64) -> None:
        self._scene, self._balls = scene, balls
        count = scene.triangle_count
        self._units = Units(np.arange(count + 1), np.arange(count, dtype=np.int32), "triangle")

    def record(
        self, camera: Camera, cut: Cut, obj: int, sample: int, drawn: NDArray[np.bool_]
    ) -> dict[str, Any]:
        """The record of a miss of `obj` at `sample`. `drawn`: (t,) bool triangles."""
        scene, shape = self._scene, cut.triangle.shape
        truth = _Cells(cut.triangle, cut.glass, cut.lost)
        shown = cut.triangle.copy()
        if cut.gone.any():
            window = Window(
                cut.x + 0.5 - 0.5 * cut.step, cut.y + 0.5 - 0.5 * cut.step, 1.0 / cut.step
            )
            rows, columns = (np.arange(n) * cut.step for n in shape)
            at = (cut.y + rows)[:, None] * camera.width + cut.x + columns
            behind = self._rasterised(camera, window, at, drawn)
            shown[cut.gone] = behind[cut.gone]
        none = np.zeros(shape, np.bool_)
        seen = _Cells(shown, cut.glass_drawn, none)
        x, y = sample % camera.width, sample // camera.width
        around = np.repeat(np.arange(-CLOSE_PX, CLOSE_PX + 1), CLOSE_CELLS)
        rows, columns = (y + around)[:, None], x + around
        inside = (rows >= 0) & (rows < camera.height) & (columns >= 0) & (columns < camera.width)
        at = np.where(inside, rows * camera.width + columns, -1)
        close = self._rasterised(camera, Window(x - CLOSE_PX, y - CLOSE_PX, CLOSE_CELLS), at, None)
        pictures = [truth, seen, _Cells(close, np.full_like(close, -1), np.zeros_like(close, bool))]
        appearances, runs = _encoded(scene, camera, pictures, obj)
        objects = sorted({entry[key] for entry in appearances for key in ("object", "glass")
                          if entry[key] is not None and entry[key] != OTHERS})  # fmt: skip
        return {
            "x": cut.x,
            "y": cut.y,
            "step": cut.step,
            "width": shape[1],
            "height": shape[0],
            "objects": [{"object": one, "name": _short(scene.names[one])} for one in objects],
            "appearances": appearances,
            "truth": runs[0],
            "drawn": runs[1],
            "close": runs[2],
        }

    def _rasterised(
        self, camera: Camera, window: Window, at: Int64, drawn: NDArray[np.bool_] | None
    ) -> Int32:
        """The nearest opaque triangles, of those that were drawn if given, in a window, whose cells
        lie `at` (h, w) samples: -1 outside the image. Masks are asked at these."""
        scene = self._scene
        triangles = self._within(camera, window, at.shape)
        kept = scene.alpha[triangles] != Alpha.BLEND
        if drawn is not None:
            kept &= drawn[triangles]
        triangles = triangles[kept]
        triangles = triangles[~from_behind(scene, camera, triangles)].astype(np.int32)
        image = UnitImage(scene, camera, self._units, at.shape, window)
        farthest = 1.0 / camera.far if camera.is_perspective else -camera.far
        for _ in range(_LAYERS):
            image.draw(triangles)
            image.owner[image.nearness < farthest] = -1
            hole = self._holes(camera, image.owner, window, at)
            if not hole.any():
                break
            image.behind[:] = np.where(hole, image.nearness, -np.inf)
            image.owner[hole], image.nearness[hole] = -1, -np.inf
        return image.owner

    def _holes(self, camera: Camera, owner: Int32, window: Window, at: Int64) -> NDArray[np.bool_]:
        """Cells at which the owner is cut away by the clip plane or, at samples, a mask's hole."""
        from visref.masks.lookup import HOLE

        scene, hole = self._scene, np.zeros(owner.shape, np.bool_)
        hit = owner >= 0
        masked = np.nonzero(hit & (at >= 0) & (scene.alpha[owner] == Alpha.MASK))
        if len(masked[0]):
            hole[masked] = mask_states(scene, camera, at[masked], owner[masked]) == HOLE
        if camera.clip_plane is not None:
            rows, columns = np.nonzero(hit)
            points = _points(scene, camera, owner[hit], window, rows, columns)
            hole[rows, columns] |= points @ camera.clip_plane[:3] + camera.clip_plane[3] < 0.0
        return hole

    def _within(self, camera: Camera, window: Window, shape: tuple[int, int]) -> Int64:
        """Triangles of the blocks that may show in a window: ascending ids."""
        right, bottom = (np.array(shape[::-1]) / window.scale + (window.left, window.top)).tolist()
        # The sides in the numbers a and b of the samples; a sample's middle is at its half.
        a = 2.0 * (np.array([window.left, right]) + camera.shift_x_px) - camera.width
        b = camera.height - 2.0 * (np.array([window.top, bottom]) + camera.shift_y_px)
        from_eye = self._balls[:, :3] - camera.eye
        radius = self._balls[:, 3]
        axes = np.stack([camera.right_step, camera.up_step, camera.forward])
        # The camera's axes are orthogonal to 1e-6: widened by as much of the distance.
        radius = radius + 4e-6 * np.linalg.norm(from_eye, axis=1)
        lengths = np.linalg.norm(axes, axis=1)
        along = from_eye @ (axes / lengths[:, None] ** 2).T
        kept = along[:, 2] + radius >= camera.near
        for axis, (low, high) in ((0, sorted(a)), (1, sorted(b))):
            for side, sign in ((low, 1.0), (high, -1.0)):
                deep = along[:, 2] if camera.is_perspective else 1.0
                slope = side * lengths[axis] if camera.is_perspective else 0.0
                inside = sign * (along[:, axis] - side * deep) * lengths[axis]
                kept &= inside >= -radius * math.hypot(1.0, slope)
        blocks = np.flatnonzero(kept)
        triangles = (blocks[:, None] * BLOCK + np.arange(BLOCK)).reshape(-1)
        return triangles[triangles < self._scene.triangle_count]


def _points(
    scene: Scene, camera: Camera, triangle: Int32, window: Window, rows: Int64, columns: Int64
) -> Float64:
    """(k, 3) float64: where the cells' rays meet the planes of triangles."""
    x = window.left + (columns + 0.5) / window.scale
    y = window.top + (rows + 0.5) / window.scale
    a = 2.0 * (x + camera.shift_x_px) - camera.width
    b = camera.height - 2.0 * (y + camera.shift_y_px)
    aside = a[:, None] * camera.right_step + b[:, None] * camera.up_step
    origin, direction = camera.eye + np.zeros_like(aside), camera.forward + aside
    if not camera.is_perspective:
        origin, direction = camera.eye + aside, np.broadcast_to(camera.forward, aside.shape)
    corners = scene.vertices[scene.triangles[triangle]].astype(np.float64)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (normal * (corners[:, 0] - origin)).sum(axis=1) / (normal * direction).sum(axis=1)
    points: Float64 = origin + np.nan_to_num(t)[:, None] * direction
    return points


def _encoded(
    scene: Scene, camera: Camera, pictures: list[_Cells], obj: int
) -> tuple[list[dict[str, Any]], list[list[int]]]:
    """The appearances of all pictures, and each picture as run lengths."""
    triangle = np.concatenate([one.triangle.reshape(-1) for one in pictures])
    glass = np.concatenate([one.glass.reshape(-1) for one in pictures])
    lost = np.concatenate([one.lost.reshape(-1) for one in pictures])
    seen, place = np.unique(np.maximum(triangle, 0), return_inverse=True)
    share = (light_on(scene, camera, seen) - DARKEST) / (BRIGHTEST - DARKEST)
    light = np.clip(share, 0.0, 1.0)[place]

    # By place in a list of few, so that one number says all of a cell.
    objects, glasses = (
        np.unique(np.where(which >= 0, scene.object_of_triangle[which], -1), return_inverse=True)
        for which in (triangle, glass)
    )
    for shades in (SHADES, 4, 1):
        level = np.round(light * (shades - 1)) * ((SHADES - 1) // max(shades - 1, 1))
        if shades == 1:
            level = np.full(len(light), 2 * SHADES // 3)
        level = np.where(triangle >= 0, level, 0).astype(np.int64)
        key = (objects[1] * SHADES + level) * len(glasses[0]) + glasses[1]
        unique, which, counts = np.unique(2 * key + lost, return_inverse=True, return_counts=True)
        if len(unique) <= MAX_APPEARANCES:
            break
    key, through = np.divmod(unique // 2, len(glasses[0]))
    kinds = np.stack(
        [objects[0][key // SHADES], key % SHADES, glasses[0][through], unique % 2], axis=1
    )
    # What is not told apart any more: the rarest, and nothing of the object itself.
    own = (kinds[:, 0] == obj) | (kinds[:, 2] == obj)
    order = np.lexsort((-counts, ~own))[: MAX_APPEARANCES - 1]
    told = np.zeros(len(kinds), np.bool_)
    told[order] = True
    if len(kinds) <= MAX_APPEARANCES:
        told[:] = True
    number = np.where(told, np.cumsum(told) - 1, np.count_nonzero(told))
    appearances = [
        {
            "object": int(o) if o >= 0 else None,
            "shade": int(s),
            "glass": int(g) if g >= 0 else None,
            "lost": bool(w),
        }
        for o, s, g, w in kinds[told]
    ]
    if not told.all():
        appearances.append({"object": OTHERS, "shade": SHADES // 2, "glass": None, "lost": False})
    cells = number[which]
    runs, start = [], 0
    for one in pictures:
        end = start + one.triangle.size
        runs.append(_runs(cells[start:end]))
        start = end
    return appearances, runs


def _runs(values: Int64) -> list[int]:
    starts = np.flatnonzero(np.append(True, np.diff(values) != 0))
    lengths = np.diff(np.append(starts, len(values)))
    return np.stack([lengths, values[starts]], axis=1).reshape(-1).tolist()


def _short(name: str) -> str:
    return name if len(name) <= NAME_LENGTH else f"{name[: NAME_LENGTH - 1]}…"
