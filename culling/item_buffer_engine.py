"""The item buffer as a truth engine of its own (`gl`): truth as this rasteriser sees it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.culler import Option
from visref.engines.base import TruthEngine
from visref.masks.lookup import BETWEEN, HOLE, SOLID
from visref.placing import somewhere
from visref.scene import OTHERS_MOVE, Alpha, Float32, Float64, Int32, Scene, same_moving
from visref.visibility import (
    BACKGROUND,
    BlendVisibility,
    Doubt,
    FrameTruth,
    VisibilityBuffer,
    hit_depths,
    mask_states,
)
from visref_culling.boxes.conservative import inflated, meets_frustum
from visref_culling.gl.changes import Changes
from visref_culling.gl.device import Target, UsesDevice, device
from visref_culling.gl.item_buffer import ItemBuffer
from visref_culling.gl.layers import GivenDepth, Hits, Layers
from visref_culling.gl.view import FLOAT32_UNIT, View


class ItemBufferEngine(UsesDevice, TruthEngine):
    """Truth as this rasteriser sees it: quick, and wrong wherever snapping or depth rounds.

    Masks are decided on the CPU, at the sample's own ray (`mask_states`), for each masked fragment
    front to back down to the first certain one.
    """

    name = "gl"
    summary = "OpenGL item buffer: snapped to sub-pixels, rounded depth; one GL thread"
    options: ClassVar[Mapping[str, Option]] = {
        "depth": Option(32, "bits of the depth buffer: 24 fixed point, 32 floating point", (24, 32))
    }

    def __init__(self, scene: Scene, *, threads: int | None = None, depth: int = 32) -> None:
        super().__init__(scene, threads=threads)
        self.items = ItemBuffer(device(), scene, depth_bits=depth)
        # What is solid everywhere is among the items' opaque triangles.
        masked = (scene.alpha == Alpha.MASK) & ~self.items.solid
        self.layers: Layers | None = None
        if masked.any():
            self.layers = Layers(device(), scene, self.items.vertices, masked)
            self.given_depth = GivenDepth(device())

    def pose(self, scene: Scene) -> None:
        if not same_moving(self.scene, scene):
            raise ValueError(OTHERS_MOVE)
        changes = Changes.between(self.scene, scene)
        self.scene = scene
        self.items.update(scene, changes)
        if self.layers is not None:
            self.layers.update(scene, changes)

    def describe(self) -> str:
        """Renderer and limits."""
        return ", ".join(f"{name} {value}" for name, value in device().report().items())

    def pixels_differ(self, camera: Camera, drawn: NDArray[np.bool_]) -> int:
        """Pixels in which the picture of some triangles, (t,) bool, is not the whole scene's."""
        whole = self.items.whole_image(camera)
        return int(np.count_nonzero(self.items.image(camera, drawn) != whole))

    def frame(self, camera: Camera) -> FrameTruth:
        items = self.items
        camera = camera.relative_to(self.scene.origin)
        view, target = items.view(camera), items.clear(camera)
        items.draw(view, target, items.opaque, depth_write=True)
        triangle = np.ascontiguousarray(target.read_ids())
        window = target.read_depth()
        doubt = Doubt()
        if self.layers is not None:
            triangle, window, doubt, nearest = let_masks_own(
                self.scene, camera, triangle, window, self.layers.before(view, target)
            )
            # What blends is seen for certain before all that may own.
            self.given_depth.write(target, nearest)
        depth = np.where(triangle >= 0, view_depth(window, view), np.inf)
        blend = self._blend(camera, view, target)
        return FrameTruth(
            camera,
            self.name,
            VisibilityBuffer(triangle, depth),
            doubt=doubt,
            blend=blend,
            veiled=self._veiled(blend, doubt),
        )

    def _veiled(self, blend: BlendVisibility, doubt: Doubt) -> Int32:
        """An image shows one triangle of an object a sample: its others may be seen as well, and
        any where a mask leaves open what is behind it."""
        scene = self.scene
        blended = scene.alpha == Alpha.BLEND
        if not len(doubt):
            of_seen = np.zeros(scene.object_count, np.bool_)
            of_seen[blend.object] = True
            blended = blended & of_seen[scene.object_of_triangle]
        return np.flatnonzero(blended).astype(np.int32)

    def _blend(self, camera: Camera, view: View, target: Target) -> BlendVisibility:
        """An image for each BLEND object in the view, against the depth of all else: its last
        drawn triangle at each sample."""
        scene = self.scene
        if not scene.has_blend:
            return BlendVisibility()
        blended = scene.alpha == Alpha.BLEND
        samples, triangles = [np.zeros(0, np.int64)], [np.zeros(0, np.int32)]
        for object_id in np.unique(scene.object_of_triangle[blended]):
            bounds = somewhere(scene.object_bounds[object_id : object_id + 1])
            if not len(bounds) or not meets_frustum(view, inflated(view, bounds))[0]:
                continue
            batches = self.items.upload(blended & (scene.object_of_triangle == object_id))
            self.items.forget_ids(target)
            self.items.draw(view, target, batches, depth_write=False)
            for batch in batches:
                batch.release()
            ids = target.read_ids().reshape(-1)
            covered = np.flatnonzero(ids != BACKGROUND)
            samples.append(covered)
            triangles.append(ids[covered])
        sample, triangle = np.concatenate(samples), np.concatenate(triangles)
        depth = hit_depths(scene, camera, sample, triangle)
        return BlendVisibility.of(scene, sample, triangle, depth)

    def close(self) -> None:
        if self.layers is not None:
            self.layers.release()
            self.given_depth.release()
        self.items.release()


def let_masks_own(
    scene: Scene, camera: Camera, triangle: Int32, window: Float32, hits: Hits
) -> tuple[Int32, Float32, Doubt, Float32]:
    """What masked triangles make of a frame of opaque ones.

    `triangle`, `window`: (height, width) ids and window depths of the opaque owners; `hits`: the
    masked fragments before them or level with them; a solid one level with an opaque one owns.
    Returns ids and depths with masked owners, the doubt, and the (height, width) window depth of
    the first triangle at each sample that owns or may own it.
    """
    shape = triangle.shape
    owner, depth = triangle.reshape(-1).copy(), window.reshape(-1).copy()
    nearest = depth.copy()
    limit = np.full_like(depth, np.inf)
    _, first = np.unique(hits.sample, return_index=True)
    ends = np.append(first[1:], len(hits.sample))
    between = np.zeros(len(hits.sample), np.bool_)
    at = first
    while len(at):
        state = mask_states(scene, camera, hits.sample[at], hits.triangle[at])
        between[at] = state == BETWEEN
        solid = at[state == SOLID]
        # A second solid one can only be level with the first.
        owner[hits.sample[solid]] = hits.triangle[solid]
        depth[hits.sample[solid]] = limit[hits.sample[solid]] = hits.depth[solid]
        maybe = at[state != HOLE]
        nearest[hits.sample[maybe]] = np.minimum(nearest[hits.sample[maybe]], hits.depth[maybe])
        at = at + 1
        more = at < ends
        at, ends = at[more], ends[more]
        more = hits.depth[at] <= limit[hits.sample[at]]
        at, ends = at[more], ends[more]
    doubt = Doubt.of(hits.sample[between], hits.triangle[between])
    return owner.reshape(shape), depth.reshape(shape), doubt, nearest.reshape(shape)


def view_depth(window: Float32, view: View) -> Float64:
    """View depth from window depth in [0, 1], both (height, width); float64."""
    # A point so far that its depth rounded to 1 is put half a rounding step before infinity.
    ndc = 2.0 * np.minimum(window.astype(np.float64), 1.0 - 0.5 * FLOAT32_UNIT) - 1.0
    clip = view.camera.clip_from_camera(view.far)
    scale, offset = clip[2, 2], clip[2, 3]
    depth: Float64
    depth = offset / (ndc + scale) if view.camera.is_perspective else (offset - ndc) / scale
    return depth
