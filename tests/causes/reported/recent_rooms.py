"""A recent lot, second part: reports of rooms, of sides and materials, and of mirrors."""

from __future__ import annotations

import numpy as np

from tests.causes.reported import places
from tests.causes.reported.recent_depth import named
from tests.causes.reported.sound import (
    Sound,
    recent,
    rectangles,
)
from tests.causes.reported.sound import places as projected


class ThroughDoorways(Sound):
    """In the mansion: which rooms show, through which windows on the screen."""

    MOST = 7

    def doors(self):
        return places.doorways()

    def room_of(self, point):
        return places.room_of(point)

    def visits(self, camera):
        """Rooms in the order in which they are come to, each with the window that it is seen
        through: first and last column and row."""
        whole = np.array([[0.0, 0.0], [camera.width - 1.0, camera.height - 1.0]])
        yield from self.through(camera, self.room_of(camera.eye), whole, ())

    def through(self, camera, room, window, way):
        yield room, window
        if len(way) == self.MOST:
            return
        for door in self.doors():
            if room not in door.rooms or door in way:
                continue
            inner = self.inner(camera, door, window)
            if inner is not None:
                other = door.rooms[0] if door.rooms[1] == room else door.rooms[1]
                yield from self.through(camera, other, inner, (*way, door))

    def inner(self, camera, door, window):
        """What of a window is seen through a doorway, None for nothing."""
        pixels, depth = projected(camera, door.corners[None])
        if (depth <= 0).all():
            return None
        if (depth <= camera.near).any():
            return window
        low = np.maximum(window[0], np.floor(pixels[0].min(axis=0)) - 1)
        high = np.minimum(window[1], np.ceil(pixels[0].max(axis=0)) + 1)
        return None if (low > high).any() else np.stack([low, high])


@recent("LostArtefacts/TRX #2005", "box or sphere too small", places.mansion)
class ThingsOfOneRoom(ThroughDoorways):
    """A thing belongs to one room, and what of it reaches into the next vanishes once all corners
    of the doorway to that room are behind the camera."""

    def kept(self, camera):
        seen = {room for room, _ in self.visits(camera)}
        cells = np.asarray(self.place.cells)
        return super().kept(camera) & ((cells < 0) | np.isin(cells, list(seen)))


@recent("godotengine/godot #51688", "first of several windows", places.mansion)
class DoneAtTheFirstDoorway(ThroughDoorways):
    """Who walks about is tested against the first doorway that his room is seen through, and not
    against a second one."""

    def kept(self, camera):
        kept = super().kept(camera)
        first: dict[int, np.ndarray] = {}
        for room, window in self.visits(camera):
            first.setdefault(room, window)
        some = np.flatnonzero(kept & named(self.scene, "guest"))
        low, high = rectangles(camera, self.boxes()[some])
        sure = self.nearest(camera, self.boxes()[some]) <= camera.near
        for at, one in enumerate(some):
            window = first.get(self.place.cells[one])
            apart = window is None or (low[at] > window[1]).any() or (high[at] < window[0]).any()
            kept[one] = sure[at] or not apart
        return kept


@recent("SNMetamorph/PrimeXT #98", "parts in no list", places.mansion)
class OriginInAWall(Sound):
    """What has its origin inside a wall is in no cell of the map, and is never drawn."""

    THICK = 0.1

    def there(self):
        boxes = self.scene.object_bounds
        # Of a lamp, its origin is in the middle of the side that it hangs by.
        off = boxes[:, :, 0] - 8.0 * np.rint(boxes[:, :, 0] / 8.0)
        off = np.abs(off).min(axis=1)
        return super().there() & ~(named(self.scene, "lamp") & (off < self.THICK))


@recent("CyclopsMC/EvilCraft #589", "masks solid", places.orchard)
class LeavesCountAsOpaqueCubes(Sound):
    """Blocks of leaves say that they are opaque cubes, and a block is left out if all of its sides
    touch such cubes."""

    def there(self):
        result = super().there()
        cubes = {tuple(np.rint(self.scene.object_bounds[i, 0]).astype(int)) for i in self.cubes()}
        for one in self.cubes():
            at = np.rint(self.scene.object_bounds[one, 0]).astype(int)
            sides = [tuple(at + way) for axis in np.eye(3, dtype=int) for way in (axis, -axis)]
            # Below the lowest cubes is soil.
            result[one] &= not all(side in cubes or side[1] < 0 for side in sides)
        return result

    def cubes(self):
        return np.flatnonzero(named(self.scene, "trunk", "fruit", "leaves"))


@recent("google/filament #1520", "front for back", places.harbour)
class MirroredStaysWoundTheOtherWay(Sound):
    """What is scaled by a negative number has its faces wound the other way, and those that face
    the camera are culled as back faces."""

    def kept(self, camera):
        kept = super().kept(camera)
        for one in np.flatnonzero(kept & named(self.scene, "mirrored")):
            first, last = self.scene.object_offsets[one : one + 2]
            a, b, c = self.scene.vertices[self.scene.triangles[first:last]].swapaxes(0, 1)
            normals = np.cross(b.astype(float) - a, c.astype(float) - a)
            front = ((camera.eye - a) * normals).sum(axis=1) > 0
            kept[one] = not front.all()
        return kept


@recent("rbfx/rbfx #466", "eye inside the box", places.harbour)
class DecalAroundTheEye(Sound):
    """A decal is drawn by the front faces of its box, and vanishes once the camera is in it."""

    REACH = 2.0

    def in_view(self, camera, some, boxes):
        marks = named(self.scene, "mark")[some]
        around = camera.near + self.REACH * np.array([0, 1, 0])
        inside = (boxes[:, 0] - around < camera.eye) & (camera.eye < boxes[:, 1] + around)
        return super().in_view(camera, some, boxes) & ~(marks & inside.all(axis=1))


@recent("Ploaj/SSBHLib #37", "both sides culled", places.harbour)
class TwoSidedCulledFromBoth(Sound):
    """The number that says two-sided is read as one that culls front and back faces."""

    def there(self):
        two_sided = np.ones(self.scene.object_count, np.bool_)
        two_sided[self.scene.object_of_triangle[self.scene.one_sided]] = False
        return super().there() & ~two_sided


@recent("ioquake/ioq3 #641", "depth of another projection", places.pond)
class ObliqueDepthReadAsRegular(Sound):
    """Depth in a mirror's image is read as that of a regular projection, where the near plane is
    the mirror's, and lamps count as hidden by it."""

    TOLERANCE = 1.0

    def shows(self, camera, some, boxes):
        result = super().shows(camera, some, boxes)
        nearest = self.nearest(camera, boxes)
        low, high = rectangles(camera, boxes)
        lamps = named(self.scene, "lamp")[some]
        read = self.read(camera)
        for at in np.flatnonzero(result & lamps & (nearest > camera.near)):
            away = nearest[at] - self.TOLERANCE
            result[at] = self.passes(read, low[at], high[at], away)
        return result

    def read(self, camera):
        """What the image's depths are taken for."""
        found = np.minimum(self.depth(camera), 1e6)
        x, y = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
        lens = camera.clip_from_camera()
        across = ((2.0 * x + 1.0) / camera.width - 1.0 + lens[0, 2]) / lens[0, 0]
        up = (1.0 - (2.0 * y + 1.0) / camera.height + lens[1, 2]) / lens[1, 1]
        row = self.depth_row(camera)
        stored = (row[0] * across + row[1] * up - row[2]) + row[3] / found
        n, f = camera.near, camera.far
        return 2.0 * f * n / (f + n - np.clip(stored, -1.0, 1.0) * (f - n))

    def depth_row(self, camera):
        """(4,) the row of depth of a projection whose near plane is the clip plane."""
        clip = np.linalg.inv(camera.camera_from_world).T @ np.array(camera.clip_plane)
        projection = camera.clip_from_camera()
        corner = np.array([np.sign(clip[0]), np.sign(clip[1]), 1.0, 1.0])
        far = np.linalg.solve(projection, corner)
        return clip * (2.0 / (clip @ far)) - projection[3]
