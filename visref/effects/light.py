"""A light, as those who draw shadows and those who judge them both take it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from visref.camera import Camera, look_at
from visref.errors import InputError
from visref.scene import Float64, Scene

# A shadow's judge leaves out what lies within one lexel and a footprint of the rim of the light's
# image.
RIM_LEXELS = 2.0


@dataclass(frozen=True, eq=False)
class Light:
    """A light as a camera: its samples are the lexels of light-space maps.

    An orthographic camera is a directional light (the sun), a perspective one a spot light in
    its eye. Beyond the camera's image there is no light.
    """

    camera: Camera

    @property
    def directional(self) -> bool:
        return not self.camera.is_perspective

    def toward(self, points: Float64) -> Float64:
        """(n, 3) float64: from points to the light; for the sun, against its direction."""
        if self.directional:
            return np.broadcast_to(-self.camera.forward, points.shape)
        return self.camera.eye - points


def sun(direction: tuple[float, float, float], scene: Scene, lexels: int) -> Light:
    """A directional light over the whole scene, which shines along `direction`.

    `lexels`: the longer side of its maps. Raises InputError for a scene without triangles.
    """
    low, high = scene.bounds
    if not scene.triangle_count:
        raise InputError("a light over a scene without triangles", source=scene.source)
    centre = (low + high) / 2.0
    pose = look_at(tuple(centre - np.asarray(direction, np.float64)), tuple(centre))
    corners = np.array(np.meshgrid(*np.stack([low, high], axis=1))).reshape(3, -1).T
    local = np.abs((corners - centre) @ pose[:3, :3]).max(axis=0)
    # Two lexels around, so that rounding and footprints leave nothing of the scene at the rim.
    # A scene that the sun sees as a point is as wide as it is deep.
    across = float(local[:2].max()) or float(local[2]) or 1.0
    half = local + RIM_LEXELS * 2.0 * across / lexels
    pose[:3, 3] = centre + pose[:3, 2] * half[2]
    width = max(1, math.ceil(lexels * min(1.0, half[0] / half[1])))
    height = max(1, math.ceil(lexels * min(1.0, half[1] / half[0])))
    # Square lexels: the image's height decides, and must hold the width as well.
    ymag = max(half[1], half[0] * height / width)
    return Light(Camera(pose, width, height, near=0.0, far=2.0 * half[2], ymag=ymag))
