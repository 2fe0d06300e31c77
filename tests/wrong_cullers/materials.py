"""Wrong in what hides, and from which side: glass, masks, back faces, winding."""

from __future__ import annotations

import numpy as np

from tests.support.toy_culler import fill
from tests.wrong_cullers import registry
from tests.wrong_cullers.depth import Depth
from tests.wrong_cullers.frustum import Frustum
from visref.scene import Alpha

wrong = registry.wrong("materials")


@wrong
class GlassOccludes(Depth):
    """What is blended hides what is behind it."""

    def occludes(self, triangles):
        return self.scene.alpha[triangles] != Alpha.MASK


@wrong
class MasksAreSolid(Depth):
    """What is alpha-masked hides what is behind it, holes and all."""

    def occludes(self, triangles):
        return self.scene.alpha[triangles] != Alpha.BLEND


@wrong
class GlassDropped(Frustum):
    """What is blended is not drawn."""

    def prepare(self, scene):
        units = super().prepare(scene)
        owner = scene.object_of_triangle[scene.alpha == Alpha.BLEND]
        self.filled = np.setdiff1d(self.filled, owner)
        return units


@wrong
class MasksDropped(Frustum):
    """What is alpha-masked is not drawn."""

    def prepare(self, scene):
        units = super().prepare(scene)
        owner = scene.object_of_triangle[scene.alpha == Alpha.MASK]
        self.filled = np.setdiff1d(self.filled, owner)
        return units


@wrong
class BackFacesOcclude(Depth):
    """What is one-sided hides from behind too: `--cull-backfaces` is not heeded."""

    def rasterise(self, camera, unit, depth):
        own = np.arange(*self.scene.object_offsets[unit : unit + 2])
        own = own[self.occludes(own)]
        fill(camera, TwoSided(self.scene), own, depth)


class TwoSided:
    """A scene as `fill` reads it, seen from both sides."""

    def __init__(self, scene):
        self.vertices, self.triangles = scene.vertices, scene.triangles
        self.one_sided = np.zeros(scene.triangle_count, bool)


@registry.right
class Facing(Frustum):
    """Frustum culling that also leaves out one-sided objects which turn away altogether."""

    def cull(self, camera):
        answer = super().cull(camera)
        scene = self.scene
        corners = scene.vertices[scene.triangles].astype(np.float64)
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        away = self.away(camera, corners, normal) & self.sided(scene)
        shown = np.bincount(scene.object_of_triangle[~away], minlength=scene.object_count) > 0
        answer.unit_ids.setflags(write=True)
        return type(answer)(answer.unit_ids[shown[answer.unit_ids]])

    def sided(self, scene):
        return scene.one_sided

    def away(self, camera, corners, normal):
        """Whether each triangle's front is turned from the eye."""
        towards = self.ray(camera, corners)
        return (normal * towards).sum(axis=1) > 1e-6 * np.linalg.norm(
            normal, axis=1
        ) * np.linalg.norm(towards, axis=1)

    def ray(self, camera, corners):
        if camera.is_perspective:
            return corners[:, 0] - camera.eye
        return np.broadcast_to(camera.forward, corners[:, 0].shape)


@wrong
class TwoSidedTurnedAway(Facing):
    """What turns away is left out, two-sided or not."""

    def sided(self, scene):
        return np.ones(scene.triangle_count, bool)


@wrong
class WindingReversed(Facing):
    """The front is taken for the back, as where a transform mirrors."""

    def away(self, camera, corners, normal):
        return super().away(camera, corners, -normal)


@wrong
class FacingByTheViewAxis(Facing):
    """Whether a face is turned away is asked of the view's axis in place of the ray to it."""

    def ray(self, camera, corners):
        return np.broadcast_to(camera.forward, corners[:, 0].shape)


@wrong
class FacingByTheEyeInOrthographic(Facing):
    """Orthographic rays are taken to start at the eye."""

    def ray(self, camera, corners):
        return corners[:, 0] - camera.eye


@wrong
class FacingByTheFirstTriangle(Facing):
    """An object turns away where its first triangle does."""

    def away(self, camera, corners, normal):
        own = super().away(camera, corners, normal)
        first = self.scene.object_offsets[self.scene.object_of_triangle]
        return own[first]
