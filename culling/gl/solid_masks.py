"""Masked triangles as occluders: depth only where the mask is certainly solid (`solid.frag`).

All masks of a scene lie in one storage buffer, a byte for each entry of the pyramids of least
alphas. Textures for which this OpenGL's largest storage block has no room hide nothing.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from visref.masks.store import Masks
from visref.scene import Int32, Int64, Scene, Units
from visref_culling.gl.changes import Changes, write_rows
from visref_culling.gl.device import Device, State, set_uniform
from visref_culling.gl.view import View

NEVER = 256  # no byte is as great
BINDINGS = (4, 5, 6, 7)


class SolidMasks:
    """`chosen`: (t,) bool, triangles with known masks. `first`, `count`: (u,) int64 ranges of each
    unit, in indices."""

    def __init__(self, gl: Device, scene: Scene, units: Units, chosen: NDArray[np.bool_]) -> None:
        self.device = gl
        self.program = gl.program("solid.vert", "solid.frag")
        masks = scene.masks
        assert masks is not None
        words, textures, levels, kept = least_bytes(masks, gl.max_block_bytes)
        triangles = np.flatnonzero(chosen).astype(np.int32)
        texture = masks.arrays.materials["texture"][
            masks.arrays.triangles["material"][masks.row[triangles]]
        ]
        triangles = triangles[(texture >= 0) & kept[texture]]
        self.triangles = triangles
        row_of_triangle = np.full(scene.triangle_count, -1, np.int64)
        row_of_triangle[triangles] = np.arange(len(triangles))
        rows = row_of_triangle[units.triangles]
        before = np.concatenate([[0], np.cumsum(rows >= 0)])[units.offsets]
        self.first, self.count = 3 * before[:-1], 3 * np.diff(before)
        indices = 3 * rows[rows >= 0, None] + np.arange(3)
        of = masks.arrays.triangles[masks.row[triangles]]
        facts = triangle_table(scene, masks, triangles)
        context = gl.context
        tables = np.concatenate([facts.reshape(-1), textures.reshape(-1), levels.reshape(-1)])
        parts = (
            scene.vertices[scene.triangles[triangles]].tobytes(),
            of["uv"].tobytes(),
            tables.astype(np.int32).tobytes(),
            words.tobytes(),
        )
        self.buffers = [context.buffer(part or bytes(16)) for part in parts]
        self.indices = context.buffer(indices.astype(np.int32).tobytes() or bytes(12))
        self.vertex_array = context.vertex_array(self.program, [], index_buffer=self.indices)
        self.textures_at, self.levels_at = facts.size, facts.size + textures.size

    def update(self, scene: Scene, changes: Changes) -> None:
        """Follow the scene to another moment, in which this has changed."""
        corners, triangles = self.buffers[0], self.triangles
        write_rows(
            corners,
            changes.triangles[triangles],
            lambda first, end: scene.vertices[scene.triangles[triangles[first:end]]],
        )

    def ready(self, view: View, state: State) -> int:
        """Everything but the draw; returns the state changes."""
        camera, program = view.camera, self.program
        axes = (camera.eye, camera.forward, camera.right_step, camera.up_step)
        for name, axis in zip(("eye", "forward", "right_step", "up_step"), axes, strict=True):
            set_uniform(program, name, np.asarray(axis, np.float64).tobytes())
        # The doubled footprints reach 2 beyond the samples. Twice as much, for rounding.
        aside = 2.0 * (
            (np.abs(camera.column_a).max() + 2.0) * np.abs(camera.right_step).sum()
            + (np.abs(camera.row_b).max() + 2.0) * np.abs(camera.up_step).sum()
        )
        along = 2.0 * np.abs(camera.forward).sum()
        reach = (along + aside, 0.0) if camera.is_perspective else (along, aside)
        set_uniform(program, "way_side", np.array(reach, np.float64).tobytes())
        set_uniform(program, "perspective", np.int32(camera.is_perspective).tobytes())
        steps = np.array([camera.column_a[0], 2.0, camera.row_b[-1], 2.0], np.float64)
        set_uniform(program, "samples", steps.tobytes())
        set_uniform(program, "textures_at", np.int32(self.textures_at).tobytes())
        set_uniform(program, "levels_at", np.int32(self.levels_at).tobytes())
        for buffer, binding in zip(self.buffers, BINDINGS, strict=True):
            buffer.bind_to_storage_buffer(binding)
        return self.device.apply(state._replace(program=program, colour_write=False))

    def release(self) -> None:
        self.vertex_array.release()
        for buffer in (*self.buffers, self.indices):
            buffer.release()


def triangle_table(scene: Scene, masks: Masks, triangles: Int32) -> Int64:
    """(k, 6): texture, both wrap modes, the least byte that is solid there, whether one-sided,
    whether nearest."""
    of = masks.arrays.triangles[masks.row[triangles]]
    material = masks.arrays.materials[of["material"]]
    result = np.zeros((len(triangles), 6), np.int64)
    result[:, 0] = material["texture"]
    result[:, 1], result[:, 2] = material["wrap_s"], material["wrap_t"]
    # In the order and precision of the lookup, so that byte / 255 <= alpha / scale carries over.
    vertex_alpha = of["vertex_alpha"].min(axis=1)
    byte = np.arange(NEVER) / 255.0
    passes = (
        byte[None, :] * material["factor"][:, None] * vertex_alpha[:, None]
        >= material["cutoff"][:, None]
    )
    # A vertex alpha below zero turns the order round: never.
    passes &= (vertex_alpha >= 0.0)[:, None]
    result[:, 3] = np.where(passes.any(axis=1), passes.argmax(axis=1), NEVER)
    result[:, 5] = material["nearest"]
    result[:, 4] = scene.one_sided[triangles]
    return result


def least_bytes(
    masks: Masks, room: int
) -> tuple[NDArray[np.uint8], Int64, Int64, NDArray[np.bool_]]:
    """The pyramids of least alphas that fit into `room` bytes, rounded down to 8 bits.

    Returns the bytes; textures (n, 4): width, height, first level, number of levels; levels
    (l, 2): first byte and width; and which textures are there, (n,) bool.
    """
    arrays = masks.arrays
    parts: list[NDArray[np.uint8]] = []
    levels: list[tuple[int, int]] = []
    textures = np.zeros((len(arrays.textures), 4), np.int64)
    kept, end = np.zeros(len(arrays.textures), np.bool_), 0
    for number, of in enumerate(arrays.textures):
        own, size = [], 0
        for k in range(of["levels"]):
            level = arrays.levels[of["level"] + k]
            height = -(-int(of["height"]) // (1 << k))
            count = int(level["width"]) * height
            least = arrays.alpha[level["least"] : level["least"] + count].astype(np.int64)
            own.append((least * 255 // of["scale"]).astype(np.uint8))
            size += count
        if end + size + 4 > room:
            continue
        kept[number] = True
        textures[number] = of["width"], of["height"], len(levels), len(own)
        for k, part in enumerate(own):
            levels.append((end, int(arrays.levels[of["level"] + k]["width"])))
            parts.append(part)
            end += len(part)
    # The shader reads words of four bytes.
    parts.append(np.zeros(4 - end % 4, np.uint8))
    table = np.array(levels, np.int64).reshape(-1, 2)
    return np.concatenate(parts), textures, table, kept
