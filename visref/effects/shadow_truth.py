"""Ray-cast shadows: a ray from the light to every visible sample.

A sample is in shadow where another triangle than its own lies between it and the light, or
where the light and the eye are on different sides of its own (the sheet seen is lit from
behind). Embree finds what the ray meets first, float64 compares the distances.

Where an image disagrees, `ShadowTruth.bounds` asks geometry instead of rays. A triangle's shadow
is a prism open at the far end: behind its plane, within the three planes through an edge and the
light. A point is in it for certain where it is deeper than `reach` in all four, possibly where
it is no further than `reach` outside each. `reach` is how far apart the rasteriser may put the
sample and the shadow's faces: its snap and its float32 error at the sample's depth. Shadow
volumes count faces in and out, so next to two faces of a prism at once a sample may count it as
minus one, and lose another shadow by that.

Which way this errs: outward. A point near an edge shared by two casters is deep in neither, so
it is a close call although it may be in shadow for certain.
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.culler import RasterTolerance
from visref.effects.images import NO_BOUNDS, Bounds, ImageVerdict, disputed, judge
from visref.effects.light import Light
from visref.effects.surfaces import TRANSFORM, surfaces_at
from visref.engines.embree import EmbreeEngine
from visref.exact import ExactScene
from visref.scene import Float64, Int32, Int64, Scene
from visref.visibility import FrameTruth

# The orientation of a triangle towards a point is a dot product with a normal: 16 roundings of
# 2^-53 on the sum of absolute products, counted as in `ray_kernels.PLANE_ROUNDING`.
ORIENTATION_ROUNDING = 16.0 * 2.0**-53

# A shadow's face is made of a vertex and that vertex moved along the light's ray, which costs as
# many roundings as a transform again on a sum of two lengths, each at most the scene's reach from
# the eye.
FACE_TRANSFORMS = 3.0


class ShadowTruth:
    """Casts shadow rays in a solid scene (`visref.effects.solid`)."""

    def __init__(self, scene: Scene, light: Light, *, threads: int | None = None) -> None:
        self.scene, self.light = scene, light
        self.engine = EmbreeEngine(scene, threads=threads)
        corners = scene.vertices[scene.triangles].astype(np.float64)
        low, high = corners.min(axis=1), corners.max(axis=1)
        self._corners = corners
        self._box = low, high

    def image(self, truth: FrameTruth) -> Int32:
        """(height, width) int32, 1 where a visible sample is in shadow, 0 elsewhere."""
        triangle = truth.buffer.triangle.reshape(-1)
        seen = np.flatnonzero(triangle >= 0)
        points = sample_points(truth.camera, seen, truth.buffer.depth.reshape(-1)[seen])
        result = np.zeros(triangle.shape, np.int32)
        result[seen] = self._from_behind(truth.camera, triangle[seen])
        if len(seen):
            result[seen] |= self._cut_off(points, triangle[seen])
        return result.reshape(truth.buffer.triangle.shape)

    def judge(
        self, truth: FrameTruth, image: Int32, reference: Int32, tolerance: RasterTolerance
    ) -> ImageVerdict:
        """Hold a frame's shadows, and the unclamped ones, against rays: the protocol of
        `visref.effects.images`, on the visible samples that the light holds.

        `image`, `reference`: (height, width) int32."""
        cast, domain = self.image(truth), self.lit_domain(truth, tolerance)
        samples = disputed(image, reference, cast, domain)
        bounds = self.bounds(truth.camera, samples, tolerance)
        return judge(image, reference, cast, bounds, domain)

    def lit_domain(self, truth: FrameTruth, tolerance: RasterTolerance) -> NDArray[np.bool_]:
        """(height, width) bool, the visible samples that the light's image holds for certain."""
        camera, light = truth.camera, self.light.camera
        depth = truth.buffer.depth.reshape(-1)
        seen = np.flatnonzero(truth.buffer.triangle.reshape(-1) >= 0)
        points = sample_points(camera, seen, depth[seen])
        pixel, light_depth = light.pixel_of(points)
        spare = self.reach(camera, depth[seen], depth[seen], tolerance)
        scale = light_depth if light.is_perspective else np.ones_like(light_depth)
        lexels = 1.0 + spare / (2.0 * np.linalg.norm(light.right_step) * scale)
        inside = (light_depth - spare > light.near) & (light_depth + spare < light.far)
        for axis, side in enumerate((light.width, light.height)):
            inside &= (pixel[:, axis] > lexels) & (pixel[:, axis] < side - 1 - lexels)
        result = np.zeros(depth.shape, np.bool_)
        result[seen[inside]] = True
        return result.reshape(truth.buffer.triangle.shape)

    def bounds(self, camera: Camera, samples: Int64, tolerance: RasterTolerance) -> Bounds:
        """Between what the shadow at some samples, (k,) flat indices, lies, whatever surface the
        rasteriser sees there."""
        if not len(samples):
            return NO_BOUNDS
        surfaces = surfaces_at(self._exact, camera, samples, tolerance)
        least = np.ones(len(samples), np.int32)
        most = np.zeros(len(samples), np.int32)
        # The background receives no shadow.
        least[~np.isfinite(surfaces.limit)] = 0
        for index, sample in enumerate(samples):
            for at in range(surfaces.offsets[index], surfaces.offsets[index + 1]):
                far = min(float(surfaces.far[at]), float(surfaces.limit[index]))
                certain, possible = self._shadow(
                    camera, int(sample), int(surfaces.triangle[at]),
                    float(surfaces.near[at]), far, tolerance,
                )  # fmt: skip
                least[index] &= certain
                most[index] |= possible
        return Bounds(samples, np.minimum(least, most), most)

    def reach(
        self, camera: Camera, near: Float64, far: Float64, tolerance: RasterTolerance
    ) -> Float64:
        """(k,) float64, how far in world units the rasteriser may move the samples' points and
        the shadows' faces there against each other, for points at depths `near` ... `far`."""
        # Half of the interval is the surface's own doubt; a shadow's face has no more there.
        along = (far - near) + _depth_step(camera, far, tolerance)
        pixel = 2.0 * camera.half_pixel
        across = tolerance.snap_px * pixel * (far if camera.is_perspective else np.ones_like(far))
        return along * self._longest(camera) + across + self._face_error(camera)

    def _longest(self, camera: Camera) -> float:
        """The greatest length of a sample's ray a unit of view depth."""
        if not camera.is_perspective:
            return 1.0
        a, b = float(np.abs(camera.column_a).max()), float(np.abs(camera.row_b).max())
        aside = a * np.linalg.norm(camera.right_step) + b * np.linalg.norm(camera.up_step)
        return math.hypot(1.0, float(aside))

    def _face_error(self, camera: Camera) -> float:
        low, high = self.scene.bounds
        distance = float(
            np.linalg.norm(np.maximum(np.abs(low - camera.eye), np.abs(high - camera.eye)))
        )
        return FACE_TRANSFORMS * TRANSFORM * distance

    def _shadow(
        self,
        camera: Camera,
        sample: int,
        own: int,
        near: float,
        far: float,
        tolerance: RasterTolerance,
    ) -> tuple[bool, bool]:
        """Whether a point on triangle `own` is in shadow: (certainly, possibly)."""
        middle = np.array([(near + far) / 2.0])
        (point,) = sample_points(camera, np.array([sample]), middle)
        if not np.isfinite(far):
            return False, True
        reach = float(self.reach(camera, np.array([near]), np.array([far]), tolerance)[0])
        casters = self._near_ray(point, reach)
        others = casters[~(self._corners[casters] == self._corners[own]).all(axis=(1, 2))]
        inside = self._prisms.depth(others, point)
        # The sample's own triangle: its plane passes through the point, and the visible side
        # decides; its other planes are as any caster's.
        from_behind, maybe = self._lit_from_behind(camera, own, reach)
        sides = self._prisms.depth(np.array([own]), point)[:, 1:]
        possible = (inside >= -reach).all(axis=1)
        certain = int((inside >= reach).all(axis=1).sum())
        certain += int(from_behind and (sides >= reach).all())
        # Near two faces of a prism at once, one may count and the other not: minus one.
        negative = int((possible & ((inside <= reach).sum(axis=1) > 1)).sum())
        negative += int((sides >= -reach).all() and (sides <= reach).any())
        return certain > negative, bool(possible.any() or maybe)

    def _near_ray(self, point: Float64, reach: float) -> Int64:
        """Triangles whose box the way from a point to the light meets, `reach` around."""
        (way,) = self.light.toward(point[None])
        low, high = self._box
        first = np.zeros(len(low))
        last = np.full(len(low), np.inf if self.light.directional else 1.0)
        for axis in range(3):
            below, above = low[:, axis] - reach - point[axis], high[:, axis] + reach - point[axis]
            if way[axis] == 0.0:
                last[(below > 0.0) | (above < 0.0)] = -1.0
                continue
            t = np.stack([below / way[axis], above / way[axis]])
            first, last = np.maximum(first, t.min(axis=0)), np.minimum(last, t.max(axis=0))
        # A part in 2^40 covers the divisions' rounding, outward.
        return np.flatnonzero(first * (1.0 - 2.0**-40) <= last * (1.0 + 2.0**-40))

    def _lit_from_behind(self, camera: Camera, own: int, reach: float) -> tuple[bool, bool]:
        a, b, c = self._corners[own]
        normal = np.cross(b - a, c - a)
        eye = -camera.forward if not camera.is_perspective else camera.eye - a
        (light,) = self.light.toward(a[None])
        sides = []
        for way, error in ((eye, reach if camera.is_perspective else 0.0), (light, 0.0)):
            value = float(normal @ way)
            doubt = ORIENTATION_ROUNDING * float(np.abs(normal) @ np.abs(way))
            doubt += error * float(np.linalg.norm(normal))
            sides.append((value > doubt, value < -doubt))
        (eye_front, eye_back), (light_front, light_back) = sides
        certain = (eye_front and light_back) or (eye_back and light_front)
        same = (eye_front and light_front) or (eye_back and light_back)
        return certain, not same

    def _from_behind(self, camera: Camera, triangle: Int32) -> NDArray[np.bool_]:
        corners = self._corners[triangle]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        eye = camera.eye - corners[:, 0]
        if not camera.is_perspective:
            eye = np.broadcast_to(-camera.forward, eye.shape)
        light = self.light.toward(corners[:, 0])
        behind: NDArray[np.bool_] = (normal * eye).sum(axis=1) * (normal * light).sum(axis=1) < 0.0
        return behind

    def _cut_off(self, points: Float64, own: Int32) -> NDArray[np.bool_]:
        """Whether something else than a point's own triangle is met first from the light."""
        toward = self.light.toward(points)
        if self.light.directional:
            # From a plane before the scene, so that no origin is farther out than need be.
            low, high = self.scene.bounds
            forward = self.light.camera.forward
            first = np.where(forward > 0.0, low, high) @ forward
            origins = points + toward * (points @ forward - first)[:, None]
            directions = -toward
        else:
            origins, directions = np.broadcast_to(self.light.camera.eye, points.shape), -toward
        met = self.engine.along(origins, directions)
        other = np.flatnonzero((met >= 0) & (met != own))
        corners = self._corners[met[other]]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        result = np.zeros(len(points), np.bool_)
        # How far behind the caster's plane the point lies; the light is on the other side.
        behind = (normal * (points[other] - corners[:, 0])).sum(axis=1)
        behind *= -np.sign((normal * self.light.toward(corners[:, 0])).sum(axis=1))
        size = (np.abs(normal) * np.abs(points[other] - corners[:, 0])).sum(axis=1)
        result[other] = behind > ORIENTATION_ROUNDING * size
        return result

    def close(self) -> None:
        self.engine.close()

    @cached_property
    def _prisms(self) -> Prisms:
        """The shadows of all triangles, made once for however many samples."""
        return Prisms(self._corners, self.light)

    @cached_property
    def _exact(self) -> ExactScene:
        """The scene made ready for `bounds`; only disputes need it."""
        return ExactScene(self.scene)


def sample_points(camera: Camera, samples: Int64, depth: Float64) -> Float64:
    """(k, 3) float64 world points of samples (flat indices) at view depths."""
    a, b = camera.column_a[samples % camera.width], camera.row_b[samples // camera.width]
    aside = a[:, None] * camera.right_step + b[:, None] * camera.up_step
    if camera.is_perspective:
        result: Float64 = camera.eye + depth[:, None] * (camera.forward + aside)
    else:
        result = camera.eye + aside + depth[:, None] * camera.forward
    return result


def _depth_step(camera: Camera, depth: Float64, tolerance: RasterTolerance) -> Float64:
    """(k,) float64, one step of the depth buffer at view depths, in world units."""
    step = 2.0 ** -(tolerance.depth_bits or 24)
    if not camera.is_perspective:
        return np.full_like(depth, step * (camera.far - camera.near))
    return step * depth**2 * (1.0 / camera.near - 1.0 / camera.far)


class Prisms:
    """The shadow prisms of triangles, (t, 3, 3) float64 corners."""

    def __init__(self, corners: Float64, light: Light) -> None:
        a, b, c = corners.transpose(1, 0, 2)
        away = -light.toward(corners.reshape(-1, 3)).reshape(-1, 3, 3)
        normal = np.cross(b - a, c - a)
        # The prism is on the light's far side: turn all normals by the triangle's.
        self._facing = np.sign((normal * away[:, 0]).sum(axis=1))
        sides = [
            np.cross(away[:, i], end - start)
            for i, (start, end) in enumerate(((a, b), (b, c), (c, a)))
        ]
        # Of each triangle (t, 4, 3): its own plane, then those through its edges and the light.
        self._across = np.stack([normal, *sides], axis=1)
        self._origin = np.stack([a, a, b, c], axis=1)
        self._length = np.linalg.norm(self._across, axis=2)
        self._is_plane = (self._length > 0.0) & (self._facing != 0.0)[:, None]

    def depth(self, triangles: Int64, point: Float64) -> Float64:
        """How deep a point lies in the prisms of some triangles, (k,): (k, 4) float64 distances to
        the triangle's own plane and the three others, positive inside; -inf where a plane is
        none."""
        across, turn = self._across[triangles], self._facing[triangles, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = (across * (point - self._origin[triangles])).sum(axis=2)
            distance = turn * distance / self._length[triangles]
        return np.where(self._is_plane[triangles], distance, -np.inf)
