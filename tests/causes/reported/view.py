"""Reports of a frustum that is not the view's: another lens, another camera, another moment."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from tests.causes.reported import places
from tests.causes.reported.sound import (
    InView,
    Sound,
    corners,
    depths,
    outside,
    reported,
    sphere_in_view,
    spheres,
)
from visref.camera import look_at


@reported(
    "GarageGames/Torque3D #525", "lens shift left out", partial(places.village_twice, "headset")
)
class EyesWithoutTheirOffset(InView):
    """The frustum of each eye is a regular one, without the offset of its lens."""

    def lens(self, camera):
        return replace(camera, shift_x_px=0.0, shift_y_px=0.0)


@reported(
    "scp-fs2open/fs2open.github.com #6673",
    "lens shift left out",
    partial(places.village, shift_x_px=-40.0, shift_y_px=8.0, yfov=1.1),
)
class HalfTheFieldToEachSide(InView):
    """An object is out if its sphere is farther aside than half of the field of view."""

    def in_view(self, camera, some, boxes):
        middle = replace(camera, shift_x_px=0.0, shift_y_px=0.0)
        return sphere_in_view(middle, *spheres(boxes))


class FirstViewsFrustum(InView):
    """All views are culled by the first one's frustum."""

    def lens(self, camera):
        views = self.place.path.views(self.frame_of(camera))
        return views[0]

    def frame_of(self, camera):
        for number in self.place.path.numbers:
            for one in self.place.path.views(number):
                if one.view == camera.view and np.array_equal(one.eye, camera.eye):
                    return number
        raise AssertionError("a camera of no frame")


@reported("mrdoob/three.js #13236", "the first view", partial(places.village_twice, "headset"))
class LeftEyeForBoth(FirstViewsFrustum):
    """What is outside the left eye's view is left out of the right eye's too."""


@reported("wave-harmonic/crest #116", "the first view", partial(places.village_twice, "mirror"))
class MirrorByTheMainCamera(FirstViewsFrustum):
    """The mirror's objects are culled by the matrix of the main camera."""


@reported("DoubleStyx/Renderide #230", "the first view", partial(places.village_twice, "headset"))
class OneEyeCullsForBoth(Sound):
    """View and depth of one eye decide for both."""

    def kept(self, camera):
        if camera.view == "left":
            self.left = super().kept(camera)
        return self.left


@reported("secondlife/viewer #1469", "the other view", partial(places.village_twice, "probe"))
class ProbeWithoutTheOccluded(Sound):
    """What the main camera's depth hides is left out of the other's image too."""

    def kept(self, camera):
        kept = super().kept(camera)
        if camera.view == "main":
            seen = self.there()
            some = np.flatnonzero(seen)
            boxes = self.boxes()[some]
            inside = InView.in_view(self, camera, some, boxes)
            self.hidden = np.zeros(len(seen), np.bool_)
            self.hidden[some[inside & ~kept[some]]] = True
        return kept & ~self.hidden


@reported("tr7zw/EntityCulling #279", "the other view", partial(places.village_twice, "split"))
class ViewfinderByThePlayer(Sound):
    """Small things that the player does not see are left out of what a viewfinder shows."""

    def kept(self, camera):
        kept = super().kept(camera)
        if camera.view == "left":
            self.player = kept
            return kept
        small = np.array([n.startswith(("barrel", "cart")) for n in self.scene.names])
        return kept & (self.player | ~small)


@reported("DinosaurPlanetRecomp/dino-recomp #9", "other lens", partial(places.village, width=240))
class FourToThree(InView):
    """The view is four to three, however wide the window is."""

    def lens(self, camera):
        return replace(camera, width=camera.height * 4 // 3)


@reported("InsanityBringer/PiccuEngine #3", "other lens", places.hall)
class SquareAndAcross(InView):
    """The vertical field of view is taken for that across, of a square image."""

    def lens(self, camera):
        return replace(camera, width=camera.height)


@reported("forkiesassds/PictureMode #5", "other lens", partial(places.village_with, "zoomed"))
class ZoomUnnoticed(InView):
    """The frustum keeps the field of view from before a zoom."""

    kept_yfov = None

    def lens(self, camera):
        self.kept_yfov = self.kept_yfov or camera.yfov
        return replace(camera, yfov=self.kept_yfov)


@reported("CesiumGS/cesium #220", "other lens", partial(places.village_with, "resized"))
class AspectFromBeforeAResize(InView):
    """The aspect ratio is that of the window before its sides were changed."""

    aspect = None

    def lens(self, camera):
        self.aspect = self.aspect or camera.width / camera.height
        return replace(camera, width=round(camera.height * self.aspect))


@reported("AdaEngine/Ada #63", "other lens", partial(places.village_from_above, zoomed=True))
class OrthographicScaleIgnored(InView):
    """The map is zoomed out, and culled at its former scale."""

    ymag = None

    def lens(self, camera):
        self.ymag = self.ymag or camera.ymag
        return replace(camera, ymag=self.ymag)


@reported("CesiumGS/cesium #78", "roll left out", partial(places.village_from_above, rolled=True))
class MapNotTurned(InView):
    """The rectangle that the map is culled by does not turn with it."""

    def lens(self, camera):
        upright = look_at(camera.eye, camera.eye + camera.forward)
        return replace(camera, world_from_camera=upright)


@reported("cedricpinson/osgjs #73", "far too near", places.village)
class FarPlaneAtAnotherDistance(InView):
    """The far plane's distance is taken from the wrong place."""

    def lens(self, camera):
        return replace(camera, far=26.0)


@reported("CaffeineMC/sodium #2373", "distance against far", places.hills)
class BeyondFogThatIsNotThere(InView):
    """What lies farther away than fog ends is left out, where fog hides nothing."""

    END = 34.0

    def in_view(self, camera, some, boxes):
        closest = np.clip(camera.eye, boxes[:, 0], boxes[:, 1])
        away = np.linalg.norm(closest - camera.eye, axis=1)
        return super().in_view(camera, some, boxes) & (away <= self.END)


@reported("OPM/ResInsight #13745", "near too large", places.village)
class NearPushedByARatio(InView):
    """The near plane is pushed out until far is no more than so many times as far."""

    RATIO = 14.0

    def lens(self, camera):
        farthest = depths(camera, corners(self.boxes())).max()
        return replace(camera, near=max(camera.near, float(farthest) / self.RATIO))


@reported("vfx-dev/Beddium #42", "answer a frame late, nothing moves", places.village)
class FrustumSampledAFrameAgo(InView):
    """The list of what is in the view is made before the camera turns."""

    last = None

    def lens(self, camera):
        before, self.last = self.last or camera, camera
        return before


@reported("ThatOpen/engine_components #2", "first answer kept", partial(places.village, 14))
class WalkingUpdatesNothing(Sound):
    """Culling runs when the camera orbits, and never again once it walks."""

    answer = None

    def kept(self, camera):
        if self.answer is None:
            self.answer = super().kept(camera)
        return self.answer


@reported(
    "Realm667/WolfenDoom #536", "answer kept on the spot", partial(places.village_with, "stands")
)
class OnlyAStepCullsAnew(InView):
    """What is drawn is found anew when the player has moved, not when he has turned."""

    eye = None

    def kept(self, camera):
        if self.eye is None or not np.array_equal(self.eye, camera.eye):
            self.eye, self.answer = camera.eye, super().kept(camera)
        return self.answer


@reported(
    "ZeaInc/zea-engine #586", "answer from before a cut", partial(places.village_with, "jumps")
)
class SwitchedCameraCullsNothing(InView):
    """A cut to another camera changes nothing that is drawn, until that one moves."""

    eye = answer = None

    def kept(self, camera):
        moved = self.eye is None or np.linalg.norm(camera.eye - self.eye) > 0.0
        self.eye = camera.eye
        if self.answer is None or (moved and not camera.cut):
            self.answer = super().kept(camera)
        return self.answer


@reported("o3de/o3de #11856", "rounded coordinates", places.far_village)
class PlanesInFloat(InView):
    """Boxes and planes are put in the world in float32, far from its origin."""

    def kept(self, camera):
        self.origin = np.array(camera.origin)
        return super().kept(camera)

    def in_view(self, camera, some, boxes):
        world = (boxes + self.origin).astype(np.float32).astype(np.float64)
        pose = camera.world_from_camera.copy()
        eye = (pose[:3, 3] + self.origin).astype(np.float32)
        pose[:3, 3] = eye.astype(np.float64) - self.origin
        coarse = replace(camera, world_from_camera=pose)
        return ~outside(coarse, corners(world - self.origin)).all(axis=2).any(axis=0)


@reported("drsnuggles8/OloEngineBase #429", "boxes about another origin", places.hills)
class TilesWhereTheTerrainIsNot(InView):
    """The ground's tiles are tested where they lie in the terrain, not where it lies."""

    AT = np.array([9.0, 0.0, -6.0])

    def boxes(self):
        boxes = np.array(self.scene.object_bounds)
        boxes[[name.startswith("tile") for name in self.scene.names]] -= self.AT
        return boxes
