"""The newest lot: reports of late answers, of what moves, comes and goes, and of lists."""

from __future__ import annotations

from functools import partial

import numpy as np

from tests.causes.reported import places
from tests.causes.reported.recent_time import named
from tests.causes.reported.sound import InView, Sound, newest

# Late, and kept.


@newest(
    "GTNewHorizons/Angelica #506",
    "answer kept while the lens changes",
    partial(places.theatre, zooming=True),
)
class ListKeptWhileTheLensChanges(InView):
    """The list of what is drawn is made anew when the camera moves or turns, not when its field of
    view changes."""

    pose = None

    def kept(self, camera):
        if self.pose is None or not np.array_equal(self.pose, camera.world_from_camera):
            self.pose, self.answer = camera.world_from_camera, super().kept(camera)
        return self.answer


@newest("CesiumGS/cesium-unreal #506", "answer from before it was replaced", places.canyon)
class AnswerOfWhenTheLevelWasLastThere(Sound):
    """In the frame in which a level takes the place of another, it has the occlusion result of when
    it was last there."""

    def prepare(self, scene):
        self.before_there, self.results = None, {}
        return super().prepare(scene)

    def shows(self, camera, some, boxes):
        there = self.there()
        before = there if self.before_there is None else self.before_there
        self.before_there = there
        result = super().shows(camera, some, boxes)
        for at in np.flatnonzero(named(self.scene, "pine")[some]):
            one, now = some[at], result[at]
            if not before[one]:
                result[at] = self.results.get(one, True)
            self.results[one] = now
        return result


@newest("PeramatoG/Perastage #1482", "list made too early", places.theatre)
class CandidatesFromAnEmptyList(Sound):
    """Where the scene changes while the camera turns fast, the sorted list is made later, the
    candidates are taken from an empty one, and are kept until the scene changes again."""

    FAST = 0.3
    known = ahead = None
    empty = False

    def kept(self, camera):
        there = self.there()
        fast = self.ahead is not None and np.linalg.norm(camera.forward - self.ahead) > self.FAST
        if self.known is None or not np.array_equal(there, self.known):
            self.empty = bool(fast)
        self.known, self.ahead = there, camera.forward
        return super().kept(camera) & (not self.empty)


# Moving and animated.


@newest("ezEngine/ezEngine #281", "box carried along with its parent", places.railway)
class SmokeBoxCarriedByTheEngine(Sound):
    """The box of smoke, which stays in the world, is found anew every few frames, and between them
    it moves along with the engine."""

    EVERY = 6
    number = -1

    def kept(self, camera):
        self.number += 1
        if self.number % self.EVERY == 0:
            self.found = np.array(self.scene.object_bounds)
        return super().kept(camera)

    def boxes(self):
        boxes = np.array(self.scene.object_bounds)
        for at in np.flatnonzero(named(self.scene, "puff")):
            train = self.scene.names[at].split(" ")[1].split("-")[0]
            engine = self.scene.id_of_name[f"engine {train}"]
            boxes[at] = self.found[at] + (boxes[engine] - self.found[engine]).mean(axis=0)
        return boxes


@newest("sxrsdk/sxrsdk #90", "box at rest, too small", places.railway)
class AnimatedNotSkinned(InView):
    """The box of a skinned mesh follows the animation of its node, but not the skin, which makes it
    larger."""

    def boxes(self):
        boxes = np.array(self.scene.object_bounds)
        birds = named(self.scene, "bird")
        travel = boxes[birds].mean(axis=1) - self.first.object_bounds[birds].mean(axis=1)
        boxes[birds] = self.first.object_bounds[birds] + travel[:, None]
        return boxes


# What appears and is removed, and lists.


@newest("MCLCE/MinecraftConsoles #344", "appeared unknown", places.terminal)
class NewDrawnOnlyFromNearby(Sound):
    """What has come is left out of the test that tells what is drawn, until it was drawn once, and
    that happens only where it is near."""

    NEAR = 14.0
    known = None

    def kept(self, camera):
        there, kept = self.there(), super().kept(camera)
        if self.known is None:
            self.known = there
        boxes = np.array(self.scene.object_bounds)
        boxes[~there] = np.inf
        away = np.linalg.norm(boxes.mean(axis=1) - camera.eye, axis=1)
        self.known = self.known | (kept & (away < self.NEAR))
        return kept & self.known


@newest(
    "Hubs-Foundation/three-batch-manager #1",
    "answers shifted",
    partial(places.theatre, cleared=True),
)
class IndexNotLoweredAfterARemoval(Sound):
    """When one is removed, those after it move down in the list of answers, and each still reads at
    its former place."""

    def prepare(self, scene):
        self.listed, self.reads = list(range(scene.object_count)), np.arange(scene.object_count)
        return super().prepare(scene)

    def kept(self, camera):
        there = self.there()
        self.reads = self.reads[there[self.listed]]
        self.listed = [one for one in self.listed if there[one]]
        answers = super().kept(camera)[self.listed]
        result = np.zeros(len(there), np.bool_)
        inside = self.reads < len(answers)
        result[np.array(self.listed)[inside]] = answers[self.reads[inside]]
        return result


@newest("emezeske/digbuild #21", "list cut short", places.stadium)
class MoreQueriesThanTheyAre(Sound):
    """The nearest things are drawn without a query, so many others are asked about, and what is
    farther away than those is not drawn."""

    NEAREST, QUERIES = 12, 30

    def shows(self, camera, some, boxes):
        result = super().shows(camera, some, boxes)
        away = np.linalg.norm(boxes.mean(axis=1) - camera.eye, axis=1)
        order = np.argsort(away, kind="stable")
        result[order[: self.NEAREST]] = True
        result[order[self.NEAREST + self.QUERIES :]] = False
        return result
