"""A recent lot: reports of lists and levels, of several views, and of units and coordinates."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from tests.causes.reported import places
from tests.causes.reported.recent_time import named
from tests.causes.reported.sound import InView, Sound, recent

# Lists and instances.


@recent("CesiumGS/cesium-unreal #928", "answer of the former user", places.terminal)
class ResultOfTheFormerTile(Sound):
    """Queries are taken from a pool, and until the first result about its new user is in, one gives
    the last about the former."""

    UNTIL = 2

    def prepare(self, scene):
        self.query, self.taken, self.free, self.results = {}, {}, [], []
        self.number = -1
        return super().prepare(scene)

    def shows(self, camera, some, boxes):
        self.number += 1
        now = dict(zip(some.tolist(), super().shows(camera, some, boxes).tolist(), strict=True))
        for one in sorted(set(self.query) - set(now)):
            self.free.append(self.query.pop(one))
        for one in sorted(set(now) - set(self.query)):
            if not self.free:
                self.free.append(len(self.results))
                self.results.append(True)
            self.query[one], self.taken[one] = self.free.pop(), self.number
        for one, query in self.query.items():
            if self.number - self.taken[one] >= self.UNTIL:
                self.results[query] = now[one]
            else:
                now[one] = self.results[query]
        return np.array([now[one] for one in some.tolist()], np.bool_)


@recent("AmbientRun/Ambient #955", "list as long as the frame before", places.bridges)
class DrawCountsReadBackLate(Sound):
    """Of each material as many are drawn as were visible in the frame before, the first of those
    that are visible now."""

    counts = None

    def kept(self, camera):
        kept = super().kept(camera)
        kinds = np.array([name.split(" ")[0] for name in self.scene.names])
        counts = {kind: int(np.count_nonzero(kept[kinds == kind])) for kind in set(kinds)}
        before, self.counts = self.counts or counts, counts
        for kind, most in before.items():
            kept[np.flatnonzero(kept & (kinds == kind))[most:]] = False
        return kept


@recent("open-goal/jak-project #1164", "list cut short", places.stadium)
class ListOfActorsIsFull(InView):
    """The list of actors that may be drawn holds so many, and who comes while it is full is not
    drawn."""

    MOST = 34

    def prepare(self, scene):
        self.listed = []
        return super().prepare(scene)

    def kept(self, camera):
        there, actors = self.there(), named(self.scene, "person")
        self.listed = [one for one in self.listed if there[one]]
        new = [one for one in np.flatnonzero(there & actors) if one not in self.listed]
        self.listed += new[: self.MOST - len(self.listed)]
        listed = np.isin(np.arange(len(there)), self.listed)
        return super().kept(camera) & (listed | ~actors)


# Levels, and tiles in tiles.


@recent("NASA-AMMOS/3DTilesRendererJS #1304", "level never drawn", places.avenue)
class ErrorNoSmallerThanTheParents(Sound):
    """Of a tree whose middle level claims no smaller an error than its coarse one, neither is fine
    enough where the middle one is due, and none is drawn."""

    def kept(self, camera):
        kept = super().kept(camera)
        for group in self.scene.groups[::3]:
            kept[list(group.levels[1])] = False
        return kept


@recent("CesiumGS/cesium-native #585", "parent by its children's boxes", places.bridges)
class ParentWithinItsChildren(InView):
    """A tile is tested by the boxes of its children, though it shows what none of them does."""

    def kept(self, camera):
        kept = super().kept(camera)
        cells, houses = np.asarray(self.place.cells), named(self.scene, "house")
        for at in np.flatnonzero(named(self.scene, "street")):
            kept[at] &= kept[houses & (cells == cells[at])].any()
        return kept


@recent("supertuxkart/stk-code #1742", "another level of detail", places.avenue)
class LevelByTheDistanceOfTheKart(Sound):
    """The level is chosen by the distance from the kart, and the camera follows it behind."""

    AHEAD = 6.0

    def kept(self, camera):
        kept = super().kept(camera)
        kart = camera.eye + self.AHEAD * camera.forward
        for group in self.scene.groups:
            every = [one for level in group.levels for one in level]
            shown = [one for one in every if kept[one]]
            if shown:
                middle = self.scene.object_bounds[shown[0]].mean(axis=0)
                away = np.linalg.norm(middle - kart)
                kept[every] = False
                kept[list(group.levels[int(np.searchsorted(places.LEVEL_ENDS, away))])] = True
        return kept


# Views and lenses.


@recent(
    "Looking-Glass/looking-glass-webxr #21", "the first view", partial(places.stadium, fan=True)
)
class FirstOfManyCameras(InView):
    """A display takes many views side by side, and all are culled by the first one's frustum."""

    def kept(self, camera):
        if camera.view == "view 0":
            self.answer = super().kept(camera)
        return self.answer


@recent("overte-org/overte #666", "lens shift reversed", partial(places.bridges, headset=True))
class LeftLensForBothEyes(InView):
    """Each eye is culled from its own place, but through the left eye's lens, which is shifted to
    the left."""

    def lens(self, camera):
        if camera.view == "left":
            self.left = camera
        left = self.left
        return replace(camera, shift_x_px=left.shift_x_px, shift_y_px=left.shift_y_px)


# Units and coordinates.


@recent("pioneerspacesim/pioneer #6269", "other lens", partial(places.space, zooming=True))
class DegreesTakenForRadians(InView):
    """The field of view is handed over in degrees, and its tangent taken as if it were radians."""

    def lens(self, camera):
        tangent = abs(np.tan(np.degrees(camera.yfov) / 2))
        return replace(camera, yfov=2 * float(np.arctan(tangent)))


@recent("c42f/displaz #163", "rounded boxes", partial(places.space, far=True))
class OffsetOfTheBoxInFloat(InView):
    """The place of a box in the world is kept in float32, far from the world's origin."""

    def boxes(self):
        boxes = np.array(self.scene.object_bounds)
        centre = boxes.mean(axis=1)
        rounded = (centre + self.scene.origin).astype(np.float32).astype(np.float64)
        return boxes + (rounded - self.scene.origin - centre)[:, None]


@recent("matiaszanolli/ByroRedux #995", "box or sphere too small", places.bridges)
class BoxOfAnotherUpAxis(InView):
    """Trees stand upright along Y, and their boxes are taken over from where Z is up."""

    def boxes(self):
        boxes = np.array(self.scene.object_bounds)
        trees = named(self.scene, "poplar")
        foot = boxes[trees].mean(axis=1)
        foot[:, 1] = boxes[trees, 0, 1]
        boxes[trees] = (boxes[trees] - foot[:, None])[:, :, [0, 2, 1]] + foot[:, None]
        return boxes
