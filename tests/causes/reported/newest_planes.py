"""The newest lot, second part: reports of rooms, of sides, and of near and far planes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.causes.reported import places
from tests.causes.reported.recent_depth import named
from tests.causes.reported.recent_rooms import ThroughDoorways
from tests.causes.reported.sound import InView, Sound, corners, depths, newest, outside, planes


@newest("godotengine/godot #51370", "first of several windows", places.mansion)
class EachRoomEnteredOnce(ThroughDoorways):
    """The search for the rooms that show enters each room once, and goes on from it only through
    what is seen by the doorway that it came in by."""

    def through(self, camera, room, window, way):
        self.entered = {room} if not way else self.entered
        yield room, window
        for door in places.doorways():
            if room not in door.rooms:
                continue
            other = door.rooms[0] if door.rooms[1] == room else door.rooms[1]
            inner = None if other in self.entered else self.inner(camera, door, window)
            if inner is not None:
                self.entered.add(other)
                yield from self.through(camera, other, inner, (*way, door))

    def kept(self, camera):
        seen = {room for room, _ in self.visits(camera)}
        cells = np.asarray(self.place.cells)
        inside = named(self.scene, "furniture", "guest")
        return super().kept(camera) & (~inside | np.isin(cells, list(seen)))


@newest("TTimo/GtkRadiant #390", "narrow openings left out", places.castle)
class TinyPortalsDropped(ThroughDoorways):
    """Openings below some size get no portal, and a room that shows through such ones alone does
    not."""

    LEAST = 1.0

    MOST = None

    def doors(self):
        wide = [
            np.ptp(one.corners, axis=0).max(initial=0.0, where=[True, False, True])
            for one in places.openings()
        ]
        return [one for one, w in zip(places.openings(), wide, strict=True) if w >= self.LEAST]

    def room_of(self, point):
        return places.castle_room_of(point)

    def kept(self, camera):
        seen = {room for room, _ in self.visits(camera)}
        cells = np.asarray(self.place.cells)
        return super().kept(camera) & ((cells < 0) | np.isin(cells, list(seen)))


@newest("ericwa/ericw-tools #264", "parts in no list", places.castle)
class CellsOfNoContents(Sound):
    """Some cells of the map are written without contents, and whatever stands in one is never
    drawn."""

    CELLS = (4, 10, 11)

    def there(self):
        cells = np.asarray(self.place.cells)
        empty = np.isin(cells, self.CELLS) & named(self.scene, "thing")
        return super().there() & ~empty


@newest("effekseer/Effekseer #683", "front of flat things for back", places.harbour)
class SidesSwappedWithReversedDepth(Sound):
    """Where depth is reversed, the side of effects that is culled is swapped too, and one-sided
    ones vanish for who looks at their front."""

    def kept(self, camera):
        kept = super().kept(camera)
        for one in np.flatnonzero(kept & named(self.scene, "screen", "mark")):
            first, last = self.scene.object_offsets[one : one + 2]
            a, b, c = self.scene.vertices[self.scene.triangles[first:last]].swapaxes(0, 1)
            normals = np.cross(b.astype(float) - a, c.astype(float) - a)
            kept[one] = (((camera.eye - a) * normals).sum(axis=1) < 0).any()
        return kept


@newest("etlegacy/etlegacy-deprecated #87", "answer a frame late, nothing moves", places.harbour)
class DecalsByAStaleFrustum(InView):
    """Decals are culled before the view is set, by the frustum that was left from the frame
    before."""

    last = None

    def in_view(self, camera, some, boxes):
        before, self.last = self.last or camera, camera
        marks = named(self.scene, "mark")[some]
        stale = super().in_view(before, some, boxes)
        return np.where(marks, stale, super().in_view(camera, some, boxes))


@newest("NASA-AMMOS/3DTilesRendererJS #486", "far too near", places.basins)
class FarPlaneAtTheHorizon(InView):
    """The far plane lies at the horizon of a smooth globe, which is close for an eye low above it,
    and cuts off ground that is higher."""

    RADIUS, LEAST = 100.0, 14.0

    def lens(self, camera):
        up = max(float(np.linalg.norm(camera.eye)) - self.RADIUS, 0.0)
        horizon = np.sqrt(up * (up + 2 * self.RADIUS))
        return replace(camera, far=max(horizon, self.LEAST))


@newest("coin3d/coin #577", "planes fitted to what is there", places.drawing)
class NearPlaneOnTheDrawing(InView):
    """The near plane is fitted to what there is without any slack, and what is flat and lies on it
    is clipped."""

    def lens(self, camera):
        return replace(camera, near=float(depths(camera, corners(self.boxes())).min()))

    def in_view(self, camera, some, boxes):
        near = planes(camera)[4]
        beyond = corners(boxes) @ near[:3] + near[3] > 1e-9
        return ~outside(camera, corners(boxes)).all(axis=2).any(axis=0) & beyond.any(axis=1)


@newest("bulletphysics/bullet3 #1006", "corners behind the eye", places.castle)
class TrianglesAcrossTheNearPlaneDiscarded(Sound):
    """A triangle that reaches in front of the near plane is not clipped but discarded, and a floor
    of large ones is gone below who stands on it."""

    def kept(self, camera):
        kept = super().kept(camera)
        for one in np.flatnonzero(kept & named(self.scene, "floor", "cloth", "thing")):
            first, last = self.scene.object_offsets[one : one + 2]
            points = self.scene.vertices[self.scene.triangles[first:last]].astype(float)
            kept[one] = (depths(camera, points) >= camera.near).all(axis=1).any()
        return kept
