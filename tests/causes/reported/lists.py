"""Reports of lists and groups: what is in none, what is cut off, what stands for what."""

from __future__ import annotations

from functools import partial

import numpy as np

from tests.causes.reported import places
from tests.causes.reported.sound import InView, Sound, rectangles, reported


class WhereLastDrawn:
    """Before a culler: it knows the boxes of what it drew last, and of the others older ones."""

    known = None

    def boxes(self):
        now = np.array(self.scene.object_bounds)
        if self.known is None:
            self.known, self.drawn = now, np.ones(len(now), np.bool_)
        self.known[self.drawn] = now[self.drawn]
        return self.known

    def kept(self, camera):
        self.drawn = super().kept(camera)
        return self.drawn


@reported("TorchAPI/Concealment #22", "box of when it was hidden", places.plaza)
class PlaceWhereItWasConcealed(WhereLastDrawn, Sound):
    """What is not drawn is not brought up to date, and is tested where it was last seen."""


@reported("tr7zw/EntityCulling #204", "box of when it was hidden", places.moving_groves)
class TeleportedUnseen(WhereLastDrawn, InView):
    """What moves outside the view is looked for where it left it."""


@reported(
    "samp-incognito/samp-streamer-plugin #245",
    "appeared unknown",
    partial(places.plaza, leaving=True),
)
class ComeSinceTheLastStep(Sound):
    """What has come is not shown before the player has walked some metres."""

    STEP = 6.0
    eye = None

    def kept(self, camera):
        there = self.there()
        if self.eye is None or np.linalg.norm(camera.eye - self.eye) > self.STEP:
            self.eye, self.known = camera.eye, there
        return super().kept(camera) & self.known


@reported("MattRix/Futile #130", "outside at first, never drawn", places.plaza)
class OutsideWhenItWasMade(Sound):
    """What was outside the view when it was made is never drawn."""

    made = None

    def kept(self, camera):
        if self.made is None:
            boxes = self.boxes()
            self.made = self.in_view(camera, np.arange(len(boxes)), boxes)
            still = [not name.startswith("walker") for name in self.scene.names]
            self.made |= np.array(still)
        return super().kept(camera) & self.made


@reported("mackysoft/Vision #4", "answers shifted", partial(places.plaza, leaving=True))
class ListFromBeforeARemoval(Sound):
    """Answers are read by places in the list, in frames in which that has changed since."""

    listed = None

    def kept(self, camera):
        answers = super().kept(camera)
        now = np.flatnonzero(self.there())
        before = now if self.listed is None else self.listed
        self.listed = now
        result = np.zeros(len(answers), np.bool_)
        known = min(len(before), len(now))
        result[now[:known]] = answers[before[:known]]
        result[now[known:]] = answers[now[known:]]
        return result


@reported(
    "Kelsidavis/WoWee #104",
    "answer of what had its place",
    partial(places.plaza, leaving=True),
)
class PlacesSwappedSinceTheAnswer(Sound):
    """Answers are read two frames later by places in a list, where the last fills the place of
    what is removed."""

    def prepare(self, scene):
        self.listed, self.answers = [], []
        return super().prepare(scene)

    def kept(self, camera):
        now = set(np.flatnonzero(self.there()).tolist())
        for one in [one for one in self.listed if one not in now]:
            at, last = self.listed.index(one), self.listed.pop()
            if last != one:
                self.listed[at] = last
        self.listed += sorted(now - set(self.listed))
        self.answers.append(super().kept(camera)[self.listed])
        result = np.zeros(self.scene.object_count, np.bool_)
        result[self.listed] = True
        if len(self.answers) > 2:
            old = self.answers.pop(0)
            known = min(len(old), len(self.listed))
            result[self.listed[:known]] = old[:known]
        return result


@reported("matiaszanolli/ByroRedux #2751", "list cut short", places.village)
class MoreDrawsThanTheBufferHolds(Sound):
    """The buffer holds so many draws, and those beyond are dropped."""

    MOST = 44

    def kept(self, camera):
        kept = super().kept(camera)
        kept[np.flatnonzero(kept)[self.MOST :]] = False
        return kept


@reported("NJUCG/MoerEngine #138", "first of the group for those seen", places.groves)
class FirstInstancesForTheVisible(Sound):
    """As many instances are drawn as are visible, from the first on, whichever those are."""

    def kept(self, camera):
        kept = super().kept(camera)
        cells = np.asarray(self.place.cells)
        for cell in np.unique(cells[cells >= 0]):
            patch = np.flatnonzero(cells == cell)
            kept[patch] = np.arange(len(patch)) < np.count_nonzero(kept[patch])
        return kept


@reported("Samsung/GearVRf #787", "parent by its child", places.hall)
class RackWithoutItsGoods(InView):
    """A parent is left out if its last child is outside the view."""

    def kept(self, camera):
        kept = super().kept(camera)
        for name, at in self.scene.id_of_name.items():
            if name.startswith("rack"):
                child = self.scene.id_of_name[name.replace("rack", "goods") + "-3"]
                kept[at] &= kept[child]
        return kept


@reported("Gepetto/gepetto-viewer #52", "threshold of samples", places.village)
class SmallFeaturesLeftOut(Sound):
    """What is smaller than a few pixels is left out."""

    LEAST = 6.0

    def shows(self, camera, some, boxes):
        low, high = rectangles(camera, boxes)
        # The rectangle is a pixel wider all round, and then some for rounding.
        small = (high - low).max(axis=1) - 2 < self.LEAST
        sure = self.nearest(camera, boxes) <= camera.near
        return super().shows(camera, some, boxes) & (sure | ~small)


@reported("Facepunch/sbox-issues #2424", "threshold of samples", places.plaza)
class TooFarForItsSize(InView):
    """What is farther away than so many times its size is left out, however near the lens."""

    TIMES = 14.0

    def in_view(self, camera, some, boxes):
        size = np.linalg.norm(np.ptp(boxes, axis=1), axis=1)
        away = np.linalg.norm(boxes.mean(axis=1) - camera.eye, axis=1)
        return super().in_view(camera, some, boxes) & (away <= self.TIMES * size)


@reported("CaffeineMC/sodium #2232", "parts in no list", places.village)
class NeighboursNotSent(Sound):
    """A section is drawn only if all sections around it have been sent: none at the rim is."""

    def kept(self, camera):
        kept = super().kept(camera)
        centre = self.boxes().mean(axis=1)
        rim = (np.abs(centre[:, [0, 2]]) > 22.0).any(axis=1)
        return kept & ~rim


@reported("CaffeineMC/sodium #872", "traversal stops short", partial(places.village, 15))
class SectionsTakenForClosed(Sound):
    """Sections are reached through faces of open ones, and one with a house in it counts as
    closed on all sides."""

    SIDE = 11.0

    def kept(self, camera):
        kept = super().kept(camera)
        boxes = self.boxes()
        start = tuple(np.floor(camera.eye[[0, 2]] / self.SIDE).astype(int))
        reached = self.flood(camera, start)
        low = np.floor(boxes[:, 0][:, [0, 2]] / self.SIDE).astype(int)
        high = np.floor(boxes[:, 1][:, [0, 2]] / self.SIDE).astype(int)
        for at in np.flatnonzero(kept):
            i, k = (range(low[at, axis], high[at, axis] + 1) for axis in (0, 1))
            kept[at] = any((x, z) in reached for x in i for z in k)
        return kept

    def flood(self, camera, start):
        """Sections that are reached from one, itself among them."""
        closed, reached, ahead = self.houses(), {start}, [start]
        while ahead:
            x, z = one = ahead.pop()
            if one in closed and one != start:
                continue
            for at in ((x + 1, z), (x - 1, z), (x, z + 1), (x, z - 1)):
                if at not in reached and max(map(abs, at)) < 6 and self.section_in_view(camera, at):
                    reached.add(at)
                    ahead.append(at)
        return reached

    def houses(self):
        centre = self.boxes().mean(axis=1)[:, [0, 2]]
        houses = [name.startswith("house") for name in self.scene.names]
        return {tuple(one) for one in np.floor(centre[houses] / self.SIDE).astype(int)}

    def section_in_view(self, camera, section):
        low = np.array([section[0] * self.SIDE, -1.0, section[1] * self.SIDE])
        box = np.array([[low, np.add(low, (self.SIDE, 12.0, self.SIDE))]])
        return bool(self.in_view(camera, np.zeros(1, int), box)[0])


@reported("TokisanGames/Terrain3D #691", "no level drawn", places.avenue)
class GapBetweenLevels(Sound):
    """A level ends before the next one begins, and in between there is none."""

    GAP = 0.07

    def kept(self, camera):
        kept = super().kept(camera)
        boxes = self.boxes()
        boxes[~self.there()] = 0.0
        centre = boxes.mean(axis=1)
        trees = [name.startswith("tree") for name in self.scene.names]
        away = np.linalg.norm(centre - camera.eye, axis=1)
        between = np.zeros(len(kept), np.bool_)
        for end in places.LEVEL_ENDS:
            between |= (away > (1 - self.GAP) * end) & (away < (1 + self.GAP) * end)
        return kept & ~(between & np.array(trees))


@reported(
    "pioneerspacesim/pioneer #2077",
    "another level of detail",
    partial(places.avenue, by_distance=False),
)
class LevelWithoutTheZoom(Sound):
    """The level is chosen by distance, and not by how large the lens shows it."""

    def kept(self, camera):
        kept = super().kept(camera)
        for group in self.place.scene.groups:
            every = [one for level in group.levels for one in level]
            shown = [one for one in every if kept[one]]
            if not shown:
                continue
            box = self.boxes()[shown[0]]
            away = np.linalg.norm(box.mean(axis=0) - camera.eye)
            level = int(np.searchsorted(places.LEVEL_ENDS, away))
            kept[every] = False
            kept[list(group.levels[level])] = True
        return kept
