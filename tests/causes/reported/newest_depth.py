"""The newest lot: reports of what is asked of depth, and of what hides."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from tests.causes.reported import places
from tests.causes.reported.hiding import Pyramid
from tests.causes.reported.recent_depth import Twice, named, rays
from tests.causes.reported.sound import SLACK, Sound, newest, rectangles
from tests.causes.reported.sound import places as projected
from visref.conformance.building import Mesh, panel
from visref.scene import Alpha, Scene


@newest("red1oon/bim-ootb #1328", "own depth", places.castle)
class ThinThingsAsDeepAsTheirWall(Twice):
    """A cloth on a wall is as deep as the wall, as far as depths can be told apart, and an equal
    depth hides it."""

    APART = 0.03
    alone = None

    def shows(self, camera, some, boxes):
        result = super().shows(camera, some, boxes)
        if self.alone is None:
            structure = named(self.scene, "wall", "outer wall", "floor", "vault")
            self.alone = replace(self.scene, absent=~structure)
        depth = self.also(self.alone, camera)
        low, high = rectangles(camera, boxes)
        nearest = self.nearest(camera, boxes)
        cloths = named(self.scene, "cloth")[some]
        for at in np.flatnonzero(result & cloths & (nearest > camera.near)):
            ways = rays(camera, low[at], high[at])
            box = boxes[at] - camera.eye
            with np.errstate(divide="ignore", invalid="ignore"):
                ends = np.stack([(box[0] - SLACK) / ways, (box[1] + SLACK) / ways])
            enters, leaves = ends.min(axis=0).max(axis=2), ends.max(axis=0).min(axis=2)
            found = depth[low[at, 1] : high[at, 1] + 1, low[at, 0] : high[at, 0] + 1]
            result[at] = ((enters <= leaves) & (found > enters + self.APART)).any()
        return result


@newest(
    "DaemonEngine/Daemon #1248",
    "level without texels",
    partial(places.library, width=200, height=60),
)
class LevelsOfNoHeight(Pyramid):
    """An image that is wider than high has levels of depth for its width, and the last of them have
    no rows: what is looked up there reads as depth zero, and hides."""

    def passes(self, levels, low, high, nearest):
        rows, columns = levels[0].shape
        at = self.level(low, high)
        if at <= int(np.log2(columns)) and rows >> at == 0:
            return False
        return super().passes(levels, low, high, nearest)


@newest("zeux/niagara #17", "upside down", places.village)
class RectangleMirroredAtTheMiddle(Sound):
    """The projection of a thing's sphere has a sign wrong, and its rectangle lies as far below the
    middle of the image as it should lie above it."""

    def passes(self, depth, low, high, nearest):
        last = depth.shape[0] - 1
        above, below = (low[0], last - high[1]), (high[0], last - low[1])
        return super().passes(depth, above, below, nearest)


@newest("overviewer/Minecraft-Overviewer #1920", "slabs hide like cubes", places.terraces)
class SlabsHideLikeCubes(Sound):
    """A cube is left out if the three cells towards the eye are filled, and a slab or stairs count
    as filling theirs."""

    TOWARDS = ((1, 0, 0), (0, 1, 0), (0, 0, 1))

    def there(self):
        result = super().there()
        cells = {}
        for one, name in enumerate(self.scene.names):
            if name != "rock":
                cells[tuple(int(part) for part in name.split()[1:])] = one
        for (i, j, k), one in cells.items():
            if self.scene.names[one].startswith("cube"):
                result[one] &= not all((i + a, j + b, k + c) in cells for a, b, c in self.TOWARDS)
        return result


@newest("Cubicake/RaycastedAntiESP #64", "some samples of the rectangle", places.village)
class RayToTheFeet(Sound):
    """One ray goes to a thing, half a metre above its foot, and a tall thing of which the foot is
    hidden counts as hidden."""

    UP = 0.5

    def shows(self, camera, some, boxes):
        result = super().shows(camera, some, boxes)
        depth = self.depth(camera)
        feet = boxes.mean(axis=1)
        feet[:, 1] = boxes[:, 0, 1] + self.UP
        pixels, _ = projected(camera, feet[:, None])
        nearest = self.nearest(camera, boxes)
        size = np.array([camera.width, camera.height])
        asked = named(self.scene, "lamp", "cart")[some]
        for at in np.flatnonzero(result & asked & (nearest > camera.near)):
            place = np.rint(pixels[at, 0]).astype(int)
            if ((place >= 0) & (place < size)).all():
                result[at] = depth[place[1], place[0]] >= nearest[at] * (1.0 - SLACK)
        return result


@newest("snowy-shack/PortalMod #262", "glass and masks solid", places.glasshouse)
class RaysStopAtGlassAndLattices(Twice):
    """Whether some things show is asked by rays that stop at anything: at panes and at lattices as
    well as at walls."""

    solid = None

    def shows(self, camera, some, boxes):
        result = super().shows(camera, some, boxes)
        if self.solid is None:
            alpha = np.full_like(self.scene.alpha, Alpha.OPAQUE)
            self.solid = replace(self.scene, alpha=alpha, masks=None)
        depth = self.also(self.solid, camera)
        low, high = rectangles(camera, boxes)
        nearest = self.nearest(camera, boxes)
        asked = np.array([self.scene.names[one].startswith("plant") for one in some])
        asked &= some % 3 == 0
        for at in np.flatnonzero(result & asked & (nearest > camera.near)):
            result[at] = self.passes(depth, low[at], high[at], nearest[at])
        return result


@newest("o3de/o3de #14908", "occluders too large", places.strewn)
class OccludingPlaneScaledEvenly(Twice):
    """A wall hides by a plane that is scaled alike both ways, as high as the wall is long."""

    planes = None

    def depth(self, camera):
        if self.planes is None:
            walls = np.flatnonzero(named(self.scene, "wall"))[::3]
            meshes = [(f"plane {one}", *self.plane(one)) for one in walls]
            self.planes = Scene.from_objects(meshes, source="reported")
        return np.minimum(super().depth(camera), self.also(self.planes, camera))

    def plane(self, one) -> Mesh:
        low, high = self.scene.object_bounds[one]
        middle, half = (low + high) / 2, max(high[0] - low[0], high[1] - low[1]) / 2
        x, y = ((centre - half, centre + half) for centre in middle[:2])
        return panel(x, y, middle[2])


@newest("CesiumGS/cesium #8398", "occluders too large", places.basins)
class GlobeHidesWhatLiesBelowItsRadius(Sound):
    """A globe of the mean radius hides things, which lie below that radius in the basins."""

    RADIUS = 100.0

    def in_view(self, camera, some, boxes):
        result = super().in_view(camera, some, boxes)
        if np.linalg.norm(camera.eye) < self.RADIUS:
            return result
        middle = boxes.mean(axis=1)
        ways = middle - camera.eye
        reach = np.linalg.norm(ways, axis=1)
        along = -(ways @ camera.eye) / reach
        off = camera.eye @ camera.eye - along**2
        inside = np.sqrt(np.maximum(self.RADIUS**2 - off, 0.0))
        hidden = (inside > 0) & (along > 0) & (along - inside < reach)
        return result & ~(hidden & named(self.scene, "rock")[some])
