"""A culler on the CPU in a hundred lines: rectangles tested against a depth buffer in float64.

It needs no GL and is slow, and it has the steps that a GL occlusion query has not: corners
projected by hand, a rectangle rounded to pixels, a depth read back. The mutants of those
steps (G1, G3 ... G7, G11) are tried on it, and the conformance suite on them.
"""

from __future__ import annotations

import itertools

import numpy as np

from visref.culler import Culler, DrawnSet
from visref.scene import Alpha

# A sample this near to an edge (as a share of the triangle) is not filled, and depths this
# close do not hide: float64 errs by less, and inward only draws too much.
EDGE = 1e-9
DEPTH = 1e-9


class ToyCuller(Culler):
    name = "toy"
    summary = "rectangles against a float64 depth buffer, for tests"

    def __init__(self, texel=1):
        """The rectangle is looked up in a buffer of the farthest depths of texel x texel pixels."""
        self.texel = texel

    def prepare(self, scene):
        self.scene = scene
        self.last_depth = None
        return scene.object_units()

    def cull(self, camera):
        depth = self.empty_depth(camera)
        drawn = []
        corners = {int(unit): self.corners(int(unit)) for unit in self.filled()}
        nearest = {unit: self.nearest(camera, points) for unit, points in corners.items()}
        for unit in sorted(corners, key=lambda unit: (nearest[unit], unit)):
            if self.sure(camera, corners[unit]):
                visible = True
            else:
                x, y = self.rectangle(camera, corners[unit])
                texels = self.reduce(self.read_back(camera, depth))
                visible = self.passes(texels[self.texels(y), self.texels(x)], nearest[unit])
            if visible:
                drawn.append(unit)
                self.rasterise(camera, unit, depth)
        self.last_depth = depth
        return DrawnSet(np.array(drawn, np.int32))

    # The steps.

    def filled(self):
        """The units that there is anything of."""
        return np.flatnonzero(np.diff(self.scene.object_offsets))

    def empty_depth(self, camera):
        return np.full((camera.height, camera.width), np.inf)

    def corners(self, unit):
        """(8, 3) of the unit's box."""
        low, high = self.scene.object_bounds[unit]
        return np.array(list(itertools.product(*zip(low, high, strict=True))))

    def nearest(self, camera, corners):
        return camera.pixel_of(corners)[1].min()

    def sure(self, camera, corners):
        """Whether the box crosses the near plane, or the eye is in it."""
        return camera.pixel_of(corners)[1].min() <= camera.near

    def rectangle(self, camera, corners):
        """Slices of the pixels that the box may touch; outward."""
        points, _ = camera.pixel_of(corners)
        low = np.floor(points.min(axis=0) - 1e-6).clip(-1, None)
        high = np.ceil(points.max(axis=0) + 1e-6).clip(-1, (camera.width, camera.height))
        return tuple(slice(max(0, int(a)), int(b) + 1) for a, b in zip(low, high, strict=True))

    def texels(self, pixels):
        return slice(pixels.start // self.texel, -(-pixels.stop // self.texel))

    def reduce(self, depth):
        """The farthest depth of each texel's pixels."""
        rows, columns = (range(0, side, self.texel) for side in depth.shape)
        return np.maximum.reduceat(np.maximum.reduceat(depth, rows, axis=0), columns, axis=1)

    def read_back(self, camera, depth):
        return depth

    def passes(self, depth, nearest):
        return np.count_nonzero(depth >= nearest * (1.0 - DEPTH)) > 0

    def occludes(self, triangles):
        return self.scene.alpha[triangles] == Alpha.OPAQUE

    def rasterise(self, camera, unit, depth):
        own = np.arange(*self.scene.object_offsets[unit : unit + 2])
        fill(camera, self.scene, own[self.occludes(own)], depth)


def fill(camera, scene, triangles, depth):
    """Write the depth of triangles at the samples well inside them."""
    points = scene.vertices[scene.triangles[triangles]].astype(np.float64) - camera.eye
    local = points @ camera.world_from_camera[:3, :3]
    step = np.linalg.norm(camera.right_step)
    t = -local[:, :, 2]
    homogeneous = np.stack([local[:, :, 0] / step, local[:, :, 1] / step, t], axis=2)
    if not camera.is_perspective:
        homogeneous[:, :, 2] = 1.0
    edges = np.cross(np.roll(homogeneous, -1, axis=1), np.roll(homogeneous, -2, axis=1))
    whole = (homogeneous[:, 0] * edges[:, 0]).sum(axis=1)
    seen = (whole != 0.0) & ~(scene.one_sided[triangles] & (whole < 0.0))
    # Per triangle, row and column the three weights, positive inside.
    samples = np.stack(np.broadcast_arrays(camera.column_a, camera.row_b[:, None], 1.0), axis=2)
    signed = edges[seen] * np.sign(whole[seen])[:, None, None]
    weights = np.einsum("yxk,tik->tiyx", samples, signed)
    total = weights.sum(axis=1)
    inside = (weights > EDGE * np.abs(weights).sum(axis=1, keepdims=True)).all(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        if camera.is_perspective:
            at = np.abs(whole[seen])[:, None, None] / total
        else:
            at = np.einsum("tiyx,ti->tyx", weights, t[seen]) / total
        inside &= (at >= camera.near) & (at <= camera.far)
        if camera.clip_plane is not None:
            # Along a sample's ray the distance to the plane is linear in depth.
            plane = np.array(camera.clip_plane)
            rays = (
                camera.forward
                + camera.column_a[:, None] * camera.right_step
                + camera.row_b[:, None, None] * camera.up_step
            )
            start, way = camera.eye, rays
            if not camera.is_perspective:
                start, way = camera.eye + rays - camera.forward, camera.forward
            ahead = start @ plane[:3] + plane[3] + at * (way @ plane[:3])
            inside &= ahead > EDGE * (np.abs(start @ plane[:3]) + abs(plane[3]) + at)
    np.minimum(depth, np.where(inside, at, np.inf).min(axis=0, initial=np.inf), out=depth)
