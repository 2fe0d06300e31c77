"""A later lot: reports of wrong boxes, of what is asked in their place, and of what is cut off."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from tests.causes.reported import places
from tests.causes.reported.sound import (
    InView,
    corners,
    depths,
    later,
    outside,
    rectangles,
    sphere_in_view,
)


@later("GlenDC/StarEngine #6", "box or sphere too small", partial(places.strewn, "scaled"))
class MovedNotTurnedNorScaled(InView):
    """The box at home is moved to the object's place, neither turned nor scaled."""

    def boxes(self):
        homes, worlds = self.place.rigs
        return homes + worlds[:, None, :3, 3]


@later("fallahn/xygine #111", "box turned inside out", partial(places.strewn, "mirrored"))
class NegativeWidthIsNone(InView):
    """A box of negative width counts as empty, and what has it is never drawn."""

    def there(self):
        pieces = np.array([name.startswith("piece") for name in self.scene.names])
        return super().there() & ~(pieces & (np.arange(len(pieces)) % 3 == 0))


@later("ch-bas/threejs-sims-house-builder #104", "box or sphere too small", places.groves)
class SphereOfOneAtTheOrigin(InView):
    """Some patches are tested by the sphere of one plant where the world has its origin."""

    def in_view(self, camera, some, boxes):
        patches = np.isin(np.asarray(self.place.cells)[some], (1, 5, 9, 14))
        alone = sphere_in_view(camera, np.zeros((1, 3)), [0.9])[0]
        return super().in_view(camera, some, boxes) & (~patches | alone)


@later("virtuoso/clap #55", "box or sphere too small", places.village)
class BoxNeverComputed(InView):
    """Some things never get a box, and are tested by an empty one at the origin."""

    def boxes(self):
        boxes = np.array(self.scene.object_bounds)
        boxes[[name.startswith("lamp") for name in self.scene.names]] = 0.0
        return boxes


@later("TokisanGames/Terrain3D #204", "box or sphere too small", places.hills)
class HeightsBeyondTheStoredRange(InView):
    """The ground's boxes end at the greatest height stored, and a shader lifts it higher."""

    HIGHEST = 2.0

    def boxes(self):
        boxes = np.array(self.scene.object_bounds)
        tiles = [name.startswith("tile") for name in self.scene.names]
        boxes[tiles, :, 1] = np.minimum(boxes[tiles, :, 1], self.HIGHEST)
        return boxes


@later("gazebosim/gz-rendering #334", "corners behind the eye", places.village)
class AnyCornerBehind(InView):
    """A box is skipped if any corner of it lies behind the camera."""

    def in_view(self, camera, some, boxes):
        behind = (depths(camera, corners(boxes)) < 0).any(axis=1)
        return super().in_view(camera, some, boxes) & ~behind


@later("PixarAnimationStudios/OpenUSD #314", "threshold of samples", places.groves)
class TinyOnTheScreen(InView):
    """What is a few pixels large on the screen is taken for too tiny to show."""

    def in_view(self, camera, some, boxes):
        low, high = rectangles(camera, boxes)
        tiny = (high - low).max(axis=1) - 2 < 7
        tiny &= depths(camera, corners(boxes)).min(axis=1) > camera.near
        return super().in_view(camera, some, boxes) & ~tiny


@later("DHJComical/Actinium #113", "cut off by height", places.globe)
class TooFarBelow(InView):
    """What lies farther below or above the camera than a limit is left out."""

    LIMIT = 18.0

    def in_view(self, camera, some, boxes):
        away = np.abs(boxes.mean(axis=1)[:, 1] - camera.eye[1])
        return super().in_view(camera, some, boxes) & (away < self.LIMIT)


@later("Meldexun/Nothirium #48", "eye outside the grid", places.hills)
class EyeAboveTheGrid(InView):
    """Nothing is found once the camera is above the highest section."""

    TOP = 7.0

    def kept(self, camera):
        return super().kept(camera) & (camera.eye[1] < self.TOP)


@later("thunder-engine/thunder #238", "box or sphere too small", places.strewn)
class BoxNotPlaced(InView):
    """Every third thing is tested by the box that its mesh has at home, wherever it stands."""

    def boxes(self):
        boxes = np.array(self.scene.object_bounds)
        boxes[2::3] = self.place.rigs[0][2::3]
        return boxes


@later("GlenDC/StarEngine #82", "one corner in the view", places.passages)
class CornersOffTheScreen(InView):
    """What has all corners off the screen is left out, though it crosses the screen."""

    def in_view(self, camera, some, boxes):
        return (~outside(camera, corners(boxes)).any(axis=0)).any(axis=1)


@later("McManning/Coherence #25", "near too large", places.village_from_above)
class MapCameraMovedForward(InView):
    """The orthographic camera that culls moves forward with the zoom, past what is near."""

    def lens(self, camera):
        return replace(camera, near=58.0)


@later("stijnherfst/HiveWE #15", "origin in the view", partial(places.strewn, "scaled"))
class DoodadsByTheirPoint(InView):
    """Doodads are drawn if the point that they are put at is in the view."""

    def in_view(self, camera, some, boxes):
        point = sphere_in_view(camera, self.place.rigs[1][some, :3, 3], np.zeros(len(some)))
        doodads = np.array([self.scene.names[i].startswith("piece") for i in some])
        return super().in_view(camera, some, boxes) & (point | ~doodads)
