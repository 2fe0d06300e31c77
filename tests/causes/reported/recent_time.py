"""A recent lot: reports of late answers, of what is kept, of what moves, and of what appears."""

from __future__ import annotations

import numpy as np

from tests.causes.reported import places
from tests.causes.reported.sound import InView, Sound, recent


def named(scene, *starts):
    """(n,) bool, the objects whose names start so."""
    return np.array([name.startswith(starts) for name in scene.names])


# Late, and kept.


@recent("openscenegraph/OpenSceneGraph #714", "answer a frame late", places.fairground)
class ResultOfTheFormerGeometry(Sound):
    """The result of a query is read after the box that it is about has changed, and was asked with
    the box before: so of whatever moves, and of nothing else."""

    def shows(self, camera, some, boxes):
        now = np.ones(self.scene.object_count, np.bool_)
        now[some] = super().shows(camera, some, boxes)
        changed = self.scene.object_bounds != self.before.object_bounds
        before, self.answers = getattr(self, "answers", now), now
        return np.where(changed.any(axis=(1, 2)), before, now)[some]


@recent("decentraland/unity-renderer #663", "answer kept on the spot", places.bridges)
class StillCulledWhenCullingIsOff(Sound):
    """When culling is switched off for a while, what was culled last is not shown again."""

    OFF = (range(7, 12), range(18, 23))
    number = -1

    def kept(self, camera):
        self.number += 1
        if not any(self.number in one for one in self.OFF):
            self.answer = super().kept(camera)
        return self.answer


@recent("RogoShum/BruteForceRenderingCulling #27", "answer several frames late", places.hills)
class ListBuiltInTheBackground(Sound):
    """The list of what is drawn is built in the background from the view at its start, and is used
    until the next one is done."""

    TAKES = 3
    number, being_built = -1, None

    def kept(self, camera):
        self.number += 1
        now = super().kept(camera)
        if self.number % self.TAKES == 0:
            done, self.being_built = self.being_built, now
            self.used = now if done is None else done
        return self.used


# Moving and animated.


@recent("panda3d/panda3d #1083", "box of the last drawn frame", places.fairground)
class CulledBeforeItIsAnimated(InView):
    """What moves is tested in the pose of the frame that it was last drawn in, for only what is
    drawn is animated, and that after the test."""

    def prepare(self, scene):
        self.posed = np.array(scene.object_bounds)
        return super().prepare(scene)

    def boxes(self):
        return self.posed

    def kept(self, camera):
        kept = super().kept(camera)
        self.posed[kept] = self.scene.object_bounds[kept]
        return kept


@recent("mkkellogg/TrailRendererJS #10", "box at rest, too small", places.space)
class TrailAsShortAsAtFirst(InView):
    """A trail grows behind a ship, and its sphere is the one of when it was started."""

    def boxes(self):
        trails = named(self.scene, "trail")
        boxes = np.array(self.scene.object_bounds)
        boxes[trails] = self.first.object_bounds[trails]
        return boxes


@recent("Realm667/WolfenDoom #531", "pose at rest", places.terminal)
class TooFarFromWhereItStarted(InView):
    """What drives is left out when the place that it started from is beyond the distance at which
    things are culled."""

    RANGE = 30.0

    def kept(self, camera):
        start = self.first.object_bounds.mean(axis=1)
        away = np.linalg.norm(start - camera.eye, axis=1)
        return super().kept(camera) & ~(named(self.scene, "lorry") & (away > self.RANGE))


@recent("galacean/engine #3033", "box at rest, too small", places.terminal)
class BoxFollowsTheRootAlone(InView):
    """The box of what is jointed is that of its pose at rest, carried along with its root, and the
    joints turn out of it."""

    def boxes(self):
        boxes = np.array(self.scene.object_bounds)
        booms, towers = (np.flatnonzero(named(self.scene, one)) for one in ("boom", "tower"))
        travel = (self.scene.object_bounds - self.first.object_bounds)[towers]
        boxes[booms] = self.first.object_bounds[booms] + travel
        return boxes


# What appears and is removed.


@recent("L3P3/minicraft #61", "appeared unknown", places.terminal)
class KnownOnceAChunkIsEntered(Sound):
    """What has come is not shown before the player walks into another chunk."""

    CHUNK = 16.0
    chunk = None

    def kept(self, camera):
        chunk = tuple(np.floor(camera.eye / self.CHUNK))
        if chunk != self.chunk:
            self.chunk, self.known = chunk, self.there()
        return super().kept(camera) & self.known


@recent("OctoAwesome/octoawesome #21", "removed still hides", places.quarry)
class FacesOfTheNextChunkStayHidden(InView):
    """A block is not drawn while others stand on all its sides, and that is found out anew when a
    block of its own chunk is removed, not when one of the next chunk is."""

    SIDE = np.array([3, 4, 2])

    def prepare(self, scene):
        self.open = None
        return super().prepare(scene)

    def there(self):
        there = super().there()
        blocks = named(self.scene, "block")
        cells = np.stack(np.unravel_index(np.arange(blocks.sum()), places.FACE), axis=1)
        filled = np.pad(there[blocks].reshape(places.FACE), 1)
        # The ground lies below the lowest.
        filled[:, 0] = True
        x, y, z = (cells + 1).T
        closed = filled[x - 1, y, z] & filled[x + 1, y, z] & filled[x, y - 1, z]
        closed &= filled[x, y + 1, z] & filled[x, y, z - 1] & filled[x, y, z + 1]
        now, chunks = ~closed, np.ravel_multi_index((cells // self.SIDE).T, (9, 9, 9))
        if self.open is None:
            self.open, self.filled = now, there[blocks]
        rebuilt = np.isin(chunks, chunks[self.filled != there[blocks]])
        self.open[rebuilt] = now[rebuilt]
        self.filled = there[blocks]
        there[blocks] &= self.open
        return there
