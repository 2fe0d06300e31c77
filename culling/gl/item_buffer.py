"""The unculled image of triangle ids, drawn by GL: the witness of what this rasteriser makes of a
scene.

Opaque triangles are drawn in id order with a `<=` depth test, so of several at the same stored
depth the last one owns the sample. Then follow masked triangles, material by material, each
with its mask: what passes writes id and depth. The others, BLEND ones and those whose mask cannot
be looked up, may be drawn over these, whole.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import moderngl
import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.culler import MOST_SNAP_PX, Raster, RasterTolerance
from visref.scene import OTHERS_MOVE, Int32, Scene, same_moving
from visref.visibility import BACKGROUND
from visref_culling.gl.changes import Changes, write_indices, write_rows, write_vertices
from visref_culling.gl.device import Device, State, Target, UsesDevice, device
from visref_culling.gl.geometry import occluders, view_uniforms
from visref_culling.gl.masks import (
    CORNER_LAYOUT,
    CORNER_NAMES,
    MaskTextures,
    corners,
    with_known_mask,
)
from visref_culling.gl.view import View


@dataclass(eq=False)
class _Batch:
    """Triangles on the GPU, drawn at once: ids ascending, back faces all or none shown.
    `data`: their indices, or where `material` is not None their corners. `triangles`: (n,) int32,
    their ids."""

    one_sided: bool
    triangles: Int32
    data: moderngl.Buffer
    ids: moderngl.Buffer
    vertex_array: moderngl.VertexArray
    material: int | None = None

    def release(self) -> None:
        for part in (self.vertex_array, self.data, self.ids):
            part.release()


class ItemBuffer:
    """Draws triangle ids of a scene into integer images. Uploads what it is asked to draw."""

    def __init__(self, gl: Device, scene: Scene, depth_bits: int) -> None:
        self.device = gl
        self.scene = scene
        self.depth_bits = depth_bits
        self.program = gl.program("mesh.vert", "item.frag")
        self.masked_program = gl.program("masked.vert", "masked.frag")
        self.vertices = gl.context.buffer(scene.vertices.tobytes() or bytes(12))
        self.textures = None if scene.masks is None else MaskTextures(gl, scene.masks)
        # (t,) bool each, disjoint: what is drawn whole, by its mask, and over these.
        self.solid = occluders(scene)
        self.by_mask = with_known_mask(scene) & ~self.solid
        self.over = ~(self.solid | self.by_mask)
        self.opaque, self.others = self.upload(self.solid), self.upload(self.over)
        self.masked = self.upload_masked(self.by_mask)

    def pose(self, scene: Scene) -> None:
        """Follow the scene to another moment: what it changes is written. Raises ValueError where
        other objects move than in the scene that this was made of."""
        if not same_moving(self.scene, scene):
            raise ValueError(OTHERS_MOVE)
        self.update(scene, Changes.between(self.scene, scene))

    def view(self, camera: Camera) -> View:
        return View.of(camera, self.scene, self.device.subpixel_bits)

    def upload(self, chosen: NDArray[np.bool_]) -> list[_Batch]:
        """Put some triangles on the GPU, to be drawn whole. `chosen`: (t,) bool."""
        batches = []
        for one_sided in (False, True):
            ids = np.flatnonzero(chosen & (self.scene.one_sided == one_sided)).astype(np.int32)
            if len(ids):
                context = self.device.context
                indices = context.buffer(self.scene.triangles[ids].tobytes())
                vertex_array = context.vertex_array(
                    self.program, [(self.vertices, "3f", "vertex_world")], index_buffer=indices
                )
                ids_buffer = context.buffer(ids.tobytes())
                batches.append(_Batch(one_sided, ids, indices, ids_buffer, vertex_array))
        return batches

    def upload_masked(self, chosen: NDArray[np.bool_]) -> list[_Batch]:
        """Put some triangles of `by_mask` on the GPU, to be drawn by their masks. `chosen`:
        (t,) bool."""
        batches: list[_Batch] = []
        scene, masks, context = self.scene, self.scene.masks, self.device.context
        triangles = np.flatnonzero(chosen).astype(np.int32)
        if masks is None or not len(triangles):
            return batches
        material = masks.arrays.triangles["material"][masks.row[triangles]]
        sided = scene.one_sided[triangles]
        order = np.lexsort((triangles, sided, material))
        starts = np.flatnonzero(np.diff(2 * material[order] + sided[order])) + 1
        for part in np.split(order, starts):
            ids = triangles[part]
            data = context.buffer(corners(scene, masks, ids).tobytes())
            vertex_array = context.vertex_array(
                self.masked_program, [(data, CORNER_LAYOUT, *CORNER_NAMES)]
            )
            batches.append(
                _Batch(
                    bool(sided[part[0]]),
                    ids,
                    data,
                    context.buffer(ids.tobytes()),
                    vertex_array,
                    int(material[part[0]]),
                )
            )
        return batches

    def update(self, scene: Scene, changes: Changes) -> None:
        """Follow the scene to another moment, in which this has changed."""
        self.scene = scene
        write_vertices(self.vertices, scene, changes)
        for batch in (*self.opaque, *self.others):
            write_indices(batch.data, scene, changes, batch.triangles)
        for batch in self.masked:
            write_rows(
                batch.data, changes.triangles[batch.triangles], partial(self._corners, batch)
            )

    def _corners(self, batch: _Batch, first: int, end: int) -> NDArray[np.void]:
        """(end - first, 3) of CORNER."""
        assert self.scene.masks is not None
        return corners(self.scene, self.scene.masks, batch.triangles[first:end])

    def clear(self, camera: Camera) -> Target:
        """The camera's empty integer image."""
        target = self.device.target(camera.width, camera.height, self.depth_bits, "i4")
        self.device.clear(State(target.framebuffer, self.program))
        self.forget_ids(target)
        return target

    def forget_ids(self, target: Target) -> None:
        """Empty the image and keep its depth."""
        self.device.clear_ids(State(target.framebuffer, self.program), BACKGROUND)

    def draw(self, view: View, target: Target, batches: list[_Batch], *, depth_write: bool) -> None:
        view_uniforms(self.program, view)
        view_uniforms(self.masked_program, view)
        for batch in batches:
            program = self.program if batch.material is None else self.masked_program
            if batch.material is not None and self.textures is not None:
                self.textures.bind(program, batch.material)
            self.device.apply(
                State(
                    target.framebuffer,
                    program,
                    depth_write=depth_write,
                    cull_back_faces=batch.one_sided,
                    cut=view.is_cut,
                )
            )
            batch.ids.bind_to_storage_buffer(0)
            batch.vertex_array.render()

    def image(self, camera: Camera, drawn: NDArray[np.bool_]) -> Int32:
        """(height, width) int32: the picture that some triangles make, `drawn`: (t,) bool.

        Opaque triangles and masked ones by their masks, then the others over them, tested
        against depth and not writing it, so that each of those shows as well. With all triangles
        it is the unculled image, which a safe culler's drawn set gives pixel for pixel.
        """
        view, target = self.view(camera), self.clear(camera)
        for batches, depth_write in (
            (self.upload(drawn & self.solid), True),
            (self.upload_masked(drawn & self.by_mask), True),
            (self.upload(drawn & self.over), False),
        ):
            self.draw(view, target, batches, depth_write=depth_write)
            for batch in batches:
                batch.release()
        return target.read_ids()

    def whole_image(self, camera: Camera) -> Int32:
        """(height, width) int32: `image` of all triangles, which are on the GPU already: a
        million of them uploaded for each frame leave holes in the heap that it never fills
        again."""
        view, target = self.view(camera), self.clear(camera)
        self.draw(view, target, [*self.opaque, *self.masked], depth_write=True)
        self.draw(view, target, self.others, depth_write=False)
        return target.read_ids()

    def owners(self, camera: Camera) -> Int32:
        """(height, width) int32 ids of the triangles that own the samples: opaque ones, and
        masked ones where their masks pass."""
        view, target = self.view(camera), self.clear(camera)
        self.draw(view, target, [*self.opaque, *self.masked], depth_write=True)
        return target.read_ids()

    def release(self) -> None:
        for batch in (*self.opaque, *self.masked, *self.others):
            batch.release()
        if self.textures is not None:
            self.textures.release()
        self.vertices.release()


class GLRaster(UsesDevice, Raster):
    """The rasteriser behind the GL cullers. `depth_bits` is that of the culler's own depth.

    Its tolerance is the greatest over the cameras that it has seen, since the float32 part
    hangs on the view.
    """

    def __init__(self, scene: Scene, depth_bits: int = 24) -> None:
        self.scene = scene
        self.depth_bits = depth_bits
        self._items: ItemBuffer | None = None
        self.tolerance = RasterTolerance(0.0, None if depth_bits == 32 else depth_bits)

    def update(self, scene: Scene, changes: Changes) -> None:
        """Follow the scene to another moment, in which this has changed."""
        self.scene = scene
        if self._items is not None:
            self._items.update(scene, changes)

    def see(self, camera: Camera) -> None:
        """Widen the tolerance to hold for this camera too."""
        view = View.of(camera, self.scene, device().subpixel_bits)
        declared = view.tolerance(self.depth_bits)
        if declared.snap_px > MOST_SNAP_PX:  # so far off, it is excused no further
            declared = replace(declared, snap_px=MOST_SNAP_PX)
        if declared.snap_px > self.tolerance.snap_px:
            self.tolerance = declared

    def pose(self, scene: Scene) -> None:
        """Follow the scene to another moment, as `ItemBuffer.pose`."""
        self.scene = scene
        if self._items is not None:
            self._items.pose(scene)

    def _ready(self) -> ItemBuffer:
        if self._items is None:
            self._items = ItemBuffer(device(), self.scene, self.depth_bits)
        return self._items

    def item_buffer(self, camera: Camera) -> Int32:
        """(height, width) int32, `ItemBuffer.owners`: `BACKGROUND` where nothing owns, holes in
        a mask show what is behind them, and what blends is not there."""
        self.see(camera)
        return self._ready().owners(camera)

    def image(self, camera: Camera, drawn: NDArray[np.bool_]) -> Int32:
        """(height, width) int32: `ItemBuffer.image` of this scene. `drawn`: (t,) bool."""
        return self._ready().image(camera, drawn)

    def close(self) -> None:
        if self._items is not None:
            self._items.release()
            self._items = None
