"""The unculled image of triangle ids, drawn by GL: the witness of what this rasteriser makes of a
scene.

Triangles are drawn in id order with a `<=` depth test, so of several at the same stored depth
the last one owns the sample.
"""

from __future__ import annotations

from dataclasses import dataclass

import moderngl
import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.culler import Raster, RasterTolerance
from visref.scene import Int32, Scene
from visref.visibility import BACKGROUND
from visref_culling.gl.device import Device, State, Target, device
from visref_culling.gl.geometry import occluders, view_uniforms
from visref_culling.gl.view import View


@dataclass(eq=False)
class _Batch:
    """Triangles on the GPU, drawn at once: ids ascending, back faces all or none shown."""

    one_sided: bool
    indices: moderngl.Buffer
    ids: moderngl.Buffer
    vertex_array: moderngl.VertexArray

    def release(self) -> None:
        for part in (self.vertex_array, self.indices, self.ids):
            part.release()


class ItemBuffer:
    """Draws triangle ids of a scene into integer images. Uploads what it is asked to draw."""

    def __init__(self, gl: Device, scene: Scene, depth_bits: int) -> None:
        self.device = gl
        self.scene = scene
        self.depth_bits = depth_bits
        self.program = gl.program("mesh.vert", "item.frag")
        self.vertices = gl.context.buffer(scene.vertices.tobytes() or bytes(12))
        solid = occluders(scene)
        self.opaque, self.others = self.upload(solid), self.upload(~solid)

    def view(self, camera: Camera) -> View:
        return View.of(camera, self.scene, self.device.subpixel_bits)

    def upload(self, chosen: NDArray[np.bool_]) -> list[_Batch]:
        """Put some triangles on the GPU. `chosen`: (t,) bool."""
        batches = []
        for one_sided in (False, True):
            ids = np.flatnonzero(chosen & (self.scene.one_sided == one_sided)).astype(np.int32)
            if len(ids):
                context = self.device.context
                indices = context.buffer(self.scene.triangles[ids].tobytes())
                vertex_array = context.vertex_array(
                    self.program, [(self.vertices, "3f", "vertex_world")], index_buffer=indices
                )
                batches.append(
                    _Batch(one_sided, indices, context.buffer(ids.tobytes()), vertex_array)
                )
        return batches

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
        for batch in batches:
            self.device.apply(
                State(
                    target.framebuffer,
                    self.program,
                    depth_write=depth_write,
                    cull_back_faces=batch.one_sided,
                )
            )
            batch.ids.bind_to_storage_buffer(0)
            batch.vertex_array.render()

    def image(self, camera: Camera, drawn: NDArray[np.bool_]) -> Int32:
        """(height, width) int32: the picture that some triangles make, `drawn`: (t,) bool.

        Opaque triangles in id order, then the others over them, tested against depth and not
        writing it, so that each of those shows as well. With all triangles it is the
        unculled image, which a safe culler's drawn set gives pixel for pixel.
        """
        view, target = self.view(camera), self.clear(camera)
        solid = occluders(self.scene)
        for chosen, depth_write in ((drawn & solid, True), (drawn & ~solid, False)):
            batches = self.upload(chosen)
            self.draw(view, target, batches, depth_write=depth_write)
            for batch in batches:
                batch.release()
        return target.read_ids()

    def whole_image(self, camera: Camera) -> Int32:
        """`image` of all triangles, which are on the GPU already: a million of them uploaded for
        each frame leave holes in the heap that it never fills again."""
        view, target = self.view(camera), self.clear(camera)
        self.draw(view, target, self.opaque, depth_write=True)
        self.draw(view, target, self.others, depth_write=False)
        return target.read_ids()

    def release(self) -> None:
        for batch in (*self.opaque, *self.others):
            batch.release()
        self.vertices.release()


class GLRaster(Raster):
    """The rasteriser behind the GL cullers. `depth_bits` is that of the culler's own depth.

    Its tolerance is the greatest over the cameras that it has seen, since the float32 part
    hangs on the view.
    """

    def __init__(self, scene: Scene, depth_bits: int = 24) -> None:
        self.scene = scene
        self.depth_bits = depth_bits
        self._items: ItemBuffer | None = None
        self.tolerance = RasterTolerance(0.0, None if depth_bits == 32 else depth_bits)

    def see(self, camera: Camera) -> None:
        """Widen the tolerance to hold for this camera too."""
        view = View.of(camera, self.scene, device().subpixel_bits)
        declared = view.tolerance(self.depth_bits)
        if declared.snap_px > self.tolerance.snap_px:
            self.tolerance = declared

    def _ready(self) -> ItemBuffer:
        if self._items is None:
            self._items = ItemBuffer(device(), self.scene, self.depth_bits)
        return self._items

    def item_buffer(self, camera: Camera) -> Int32:
        """(height, width) int32 ids of the opaque triangles alone, `BACKGROUND` for none."""
        self.see(camera)
        items = self._ready()
        target = items.clear(camera)
        items.draw(items.view(camera), target, items.opaque, depth_write=True)
        return target.read_ids()

    def image(self, camera: Camera, drawn: NDArray[np.bool_]) -> Int32:
        """`ItemBuffer.image` of this scene."""
        return self._ready().image(camera, drawn)

    def close(self) -> None:
        if self._items is not None:
            self._items.release()
            self._items = None
