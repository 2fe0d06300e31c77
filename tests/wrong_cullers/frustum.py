"""View-frustum culling of boxes, right and wrong."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np

from tests.wrong_cullers import registry
from visref.camera import look_at
from visref.culler import Culler, DrawnSet

wrong = registry.wrong("frustum")

# Outward: float64 errs by far less, and what is drawn too much only costs.
SLACK = 1e-9


@registry.right
class Frustum(Culler):
    """Leaves out a box only if one plane of the view has all its corners outside."""

    def prepare(self, scene):
        self.scene = scene
        self.filled = np.flatnonzero(np.diff(scene.object_offsets))
        sides = scene.object_bounds
        self.corners = np.stack(
            [
                np.stack([sides[:, x, 0], sides[:, y, 1], sides[:, z, 2]], axis=1)
                for x, y, z in itertools.product((0, 1), repeat=3)
            ],
            axis=1,
        )
        return scene.object_units()

    def cull(self, camera):
        view = self.believed(camera)
        kept = [unit for unit in self.filled if self.keeps(view, self.box(unit))]
        return DrawnSet(np.array(kept, np.int32))

    # The steps.

    def believed(self, camera):
        """The camera that the method works with."""
        return camera

    def box(self, unit):
        """(8, 3) corners of the unit's box."""
        return self.corners[unit]

    def keeps(self, view, corners):
        return not self.outside(view, corners).all(axis=1).any()

    def outside(self, view, corners):
        """(6, n) bool, whether each corner is outside each plane."""
        local = (corners - view.eye) @ view.world_from_camera[:3, :3]
        depth = -local[:, 2]
        scale = depth if view.is_perspective else np.ones_like(depth)
        step = np.linalg.norm(view.right_step)
        a, b = local[:, 0] / step, local[:, 1] / step
        slack = SLACK * (np.abs(local).max() / step + view.width + view.height)
        left, top = 2.0 * view.shift_x_px - view.width, view.height - 2.0 * view.shift_y_px
        right, bottom = left + 2.0 * view.width, top - 2.0 * view.height
        slack_t = SLACK * (np.abs(local).max() + view.near)
        return np.stack(
            [
                a < left * scale - slack,
                a > right * scale + slack,
                b > top * scale + slack,
                b < bottom * scale - slack,
                depth < view.near - slack_t,
                depth > view.far + slack_t,
            ]
        )


@wrong
class CornersOnly(Frustum):
    """A box is in the view only if one of its corners is."""

    def keeps(self, view, corners):
        return (~self.outside(view, corners).any(axis=0)).any()


@wrong
class CentreOnly(Frustum):
    """A box is in the view only if its centre is."""

    def box(self, unit):
        return self.corners[unit].mean(axis=0)[None]


@wrong
class AnyCornerBehind(Frustum):
    """A box with a corner behind the near plane counts as outside."""

    def keeps(self, view, corners):
        return super().keeps(view, corners) and not self.outside(view, corners)[4].any()


@wrong
class CornersBehindProjected(Frustum):
    """Corners are divided by their depth, whatever its sign, and the rectangle tested."""

    def keeps(self, view, corners):
        places, depth = view.pixel_of(corners)
        low, high = places.min(axis=0), places.max(axis=0)
        size = np.array([view.width, view.height])
        seen = (high >= -0.5).all() and (low <= size - 0.5).all()
        return seen and depth.max() >= view.near and depth.min() <= view.far


@wrong
class SphereOfHalfTheSide(Frustum):
    """The sphere that is tested reaches to the box's faces, not to its corners."""

    def keeps(self, view, corners):
        centre = corners.mean(axis=0)
        radius = (corners.max(axis=0) - centre).max()
        axes = np.concatenate([np.eye(3), -np.eye(3)])
        return super().keeps(view, centre + radius * axes)


@wrong
class TwoCorners(Frustum):
    """Only the least and the greatest corner are transformed."""

    def keeps(self, view, corners):
        rotation = view.world_from_camera[:3, :3]
        local = (corners[[0, -1]] - view.eye) @ rotation
        spanned = itertools.product(*zip(local.min(axis=0), local.max(axis=0), strict=True))
        return super().keeps(view, np.array(list(spanned)) @ rotation.T + view.eye)


@wrong
class ShiftIgnored(Frustum):
    """The frustum is symmetric, whatever the lens."""

    def believed(self, camera):
        return replace(camera, shift_x_px=0.0, shift_y_px=0.0)


@wrong
class ShiftXIgnored(Frustum):
    """The lens's sideways shift is left out."""

    def believed(self, camera):
        return replace(camera, shift_x_px=0.0)


@wrong
class ShiftYIgnored(Frustum):
    """The lens's upright shift is left out."""

    def believed(self, camera):
        return replace(camera, shift_y_px=0.0)


@wrong
class ShiftXReversed(Frustum):
    """The lens is shifted to the other side."""

    def believed(self, camera):
        return replace(camera, shift_x_px=-camera.shift_x_px)


@wrong
class ShiftYReversed(Frustum):
    """The lens is shifted up for down: y flipped."""

    def believed(self, camera):
        return replace(camera, shift_y_px=-camera.shift_y_px)


@wrong
class ShiftHalved(Frustum):
    """A shift in pixels is taken for one in half pixels."""

    def believed(self, camera):
        shift = {"shift_x_px": camera.shift_x_px / 2, "shift_y_px": camera.shift_y_px / 2}
        return replace(camera, **shift)


@wrong
class OrthographicShiftIgnored(Frustum):
    """The lens's shift is left out of orthographic views."""

    def believed(self, camera):
        if camera.is_perspective:
            return camera
        return replace(camera, shift_x_px=0.0, shift_y_px=0.0)


@wrong
class AspectIgnored(Frustum):
    """The view is as wide as it is high."""

    def believed(self, camera):
        return replace(camera, width=camera.height)


@wrong
class AspectInverted(Frustum):
    """Width and height are taken for each other."""

    def believed(self, camera):
        return replace(camera, width=camera.height, height=camera.width)


@wrong
class HorizontalFieldOfView(Frustum):
    """The vertical field of view is taken for the horizontal one."""

    def believed(self, camera):
        if not camera.is_perspective:
            return camera
        half = np.tan(camera.yfov / 2) * camera.height / camera.width
        return replace(camera, yfov=2.0 * float(np.arctan(half)))


@wrong
class FieldOfViewOfTheFirstFrame(Frustum):
    """A zoom is not noticed."""

    first = None

    def believed(self, camera):
        if not camera.is_perspective:
            return camera
        self.first = self.first or camera.yfov
        return replace(camera, yfov=self.first)


@wrong
class ViewportOfTheFirstFrame(Frustum):
    """A window that changes its sides is not noticed."""

    first = None

    def believed(self, camera):
        self.first = self.first or camera
        return replace(camera, width=self.first.width, height=self.first.height)


@wrong
class UpAssumed(Frustum):
    """The camera's roll is left out."""

    def believed(self, camera):
        pose = look_at(camera.eye, camera.eye + camera.forward)
        return replace(camera, world_from_camera=pose)


@wrong
class OrthographicAsPerspective(Frustum):
    """An orthographic view is taken for a pyramid of 45 degrees."""

    def believed(self, camera):
        if camera.is_perspective:
            return camera
        return replace(camera, ymag=None, yfov=np.pi / 4, near=max(camera.near, 0.01))


@wrong
class HeightHalved(Frustum):
    """An orthographic view's half height is taken for the whole."""

    def believed(self, camera):
        return camera if camera.is_perspective else replace(camera, ymag=camera.ymag / 2)


@wrong
class NearTooLarge(Frustum):
    """The near plane lies ten times as far out."""

    def believed(self, camera):
        return replace(camera, near=min(10.0 * camera.near, camera.far / 2))


@wrong
class FarTooNear(Frustum):
    """What is farther than a hundred units is dropped."""

    def believed(self, camera):
        return replace(camera, far=max(min(camera.far, 100.0), 2.0 * camera.near))


@wrong
class FarHalved(Frustum):
    """The far plane lies at half its depth."""

    def believed(self, camera):
        return replace(camera, far=max(camera.far / 2, 1.5 * camera.near))


@wrong
class OnFarDropped(Frustum):
    """What lies exactly on the far plane counts as beyond it."""

    def keeps(self, view, corners):
        return super().keeps(view, corners) and view.pixel_of(corners)[1].min() < view.far


@wrong
class OnNearDropped(Frustum):
    """What lies exactly on the near plane counts as before it."""

    def keeps(self, view, corners):
        return super().keeps(view, corners) and view.pixel_of(corners)[1].max() > view.near


@wrong
class DistanceForFar(Frustum):
    """Straight distance is compared with the far plane's depth."""

    def keeps(self, view, corners):
        nearest = np.clip(view.eye, corners.min(axis=0), corners.max(axis=0))
        return super().keeps(view, corners) and np.linalg.norm(nearest - view.eye) <= view.far


@wrong
class EyeInsideDropped(Frustum):
    """A box around the eye counts as outside."""

    def keeps(self, view, corners):
        inside = (corners.min(axis=0) < view.eye) & (view.eye < corners.max(axis=0))
        return super().keeps(view, corners) and not inside.all()


@wrong
class SmallDropped(Frustum):
    """What covers less than a pixel is dropped."""

    def keeps(self, view, corners):
        places, depth = view.pixel_of(corners)
        small = depth.min() > view.near and np.ptp(places, axis=0).max() < 1.0
        return super().keeps(view, corners) and not small


@wrong
class ThinDropped(Frustum):
    """A box without volume is taken for empty."""

    def keeps(self, view, corners):
        return super().keeps(view, corners) and np.ptp(corners, axis=0).all()


@wrong
class OriginForgotten(Frustum):
    """The camera is placed in the world, the boxes about the scene's origin."""

    def believed(self, camera):
        return camera.relative_to((0.0, 0.0, 0.0))


@wrong
class FloatWorld(Frustum):
    """Boxes and camera are put in the world in float32."""

    def prepare(self, scene):
        units = super().prepare(scene)
        world = (self.corners + scene.origin).astype(np.float32)
        with np.errstate(invalid="ignore"):
            self.corners = world.astype(np.float64)
        return units

    def believed(self, camera):
        world = camera.relative_to((0.0, 0.0, 0.0))
        pose = world.world_from_camera.copy()
        pose[:3, 3] = pose[:3, 3].astype(np.float32)
        return replace(world, world_from_camera=pose)


@wrong
class HalfFloatBoxes(Frustum):
    """Boxes are kept in half precision."""

    def prepare(self, scene):
        units = super().prepare(scene)
        with np.errstate(over="ignore"):
            self.corners = self.corners.astype(np.float16).astype(np.float64)
        self.corners = np.nan_to_num(self.corners, posinf=65504.0, neginf=-65504.0)
        return units
