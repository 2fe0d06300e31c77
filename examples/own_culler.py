"""A culler of one's own: bounding spheres against the view, and small ones left out if asked to.

    cd examples
    visref run city:scale=0.05 --culler own_culler:SphereCulling --out run
    visref run city:scale=0.05 --culler own_culler:SphereCulling:small_px=8 --out run

The first promises to draw whatever is visible, and is convicted if it does not. The second leaves
out what spans fewer pixels than `small_px`, so it promises nothing and is measured.
"""

from typing import ClassVar

import numpy as np

from visref import Culler, DrawnSet, Option, Promise

# A sphere this near to a plane, as a share of the numbers that its distance is computed from, is
# kept: a float64 sum of a few products errs by less, and to keep too much only costs time.
SLACK = 1e-12


class SphereCulling(Culler):
    name = "spheres"
    summary = "bounding spheres against the view frustum, small ones left out if asked to"
    options: ClassVar = {"small_px": Option(0.0, "leave out what spans fewer pixels")}

    def __init__(self, *, small_px=0.0):
        self.small_px = small_px
        if small_px > 0.0:
            self.promise = Promise.APPROXIMATE

    def prepare(self, scene):
        """Once, before any camera. An object without triangles has no sphere, and is not drawn."""
        filled = np.diff(scene.object_offsets) > 0
        self.ids = np.flatnonzero(filled)
        low, high = scene.object_bounds[filled].transpose(1, 0, 2)
        self.centres = (low + high) / 2
        self.radii = np.linalg.norm(high - low, axis=1) / 2
        return scene.object_units()

    def cull(self, camera):
        """Once per frame: the ids of the objects to draw."""
        planes = side_planes(camera)
        scale = np.abs(self.centres).sum(axis=1) + self.radii + np.abs(camera.eye).sum()
        reach = self.radii + SLACK * scale
        sides = self.centres @ planes[:, :3].T + planes[:, 3]
        depth = (self.centres - camera.eye) @ camera.forward
        seen = (sides >= -reach[:, None]).all(axis=1)
        seen &= (depth + reach >= camera.near) & (depth - reach <= camera.far)
        if self.small_px > 0.0:
            seen &= self.diameter_px(camera, depth) >= self.small_px
        return DrawnSet(self.ids[seen])

    def diameter_px(self, camera, depth):
        """(n,) how many pixels each sphere spans; no end of them where it reaches the eye."""
        half_pixel = np.linalg.norm(camera.up_step)
        if camera.is_perspective:
            half_pixel = half_pixel * np.maximum(depth - self.radii, 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.nan_to_num(self.radii / half_pixel, nan=np.inf, posinf=np.inf)


def side_planes(camera):
    """(4, 4) left, right, bottom and top: unit normals that point inward, and offsets. They are
    the same whatever the far plane, so a finite one stands in."""
    x, y, _, w = camera.clip_from_world(far=camera.near + 1.0)
    planes = np.stack([w + x, w - x, w + y, w - y])
    return planes / np.linalg.norm(planes[:, :3], axis=1, keepdims=True)
