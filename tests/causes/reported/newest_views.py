"""The newest lot, second part: reports of spheres, levels, several views, and far-away worlds."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from tests.causes.reported import places
from tests.causes.reported.recent_time import named
from tests.causes.reported.sound import (
    InView,
    Sound,
    newest,
    sphere_in_view,
    spheres,
)

# Instances and levels.


@newest("diarmidmackenzie/instanced-mesh #24", "box or sphere too small", places.groves)
class SphereOfTheLastThatSharesTheMesh(InView):
    """The sphere of a patch is stored with the mesh of its plants, and patches that share a mesh
    all have the sphere of the last of them."""

    MESHES = 4

    def in_view(self, camera, some, boxes):
        result = super().in_view(camera, some, boxes)
        cells = np.asarray(self.place.cells)
        shared = (cells >= 0) & (cells % self.MESHES == 0)
        last = self.boxes()[cells == cells[shared].max()]
        whole = np.array([[last[:, 0].min(axis=0), last[:, 1].max(axis=0)]])
        result[shared[some]] = sphere_in_view(camera, *spheres(whole))[0]
        return result


@newest("Facepunch/sbox-issues #4434", "another level of detail", places.canyon)
class LevelByTheDistanceFromTheWorldsOrigin(Sound):
    """The level is chosen by the distance of a thing from the world's origin."""

    def kept(self, camera):
        kept = super().kept(camera)
        for group in self.scene.groups:
            every = [one for level in group.levels for one in level]
            shown = [one for one in every if kept[one]]
            if shown:
                away = np.linalg.norm(self.scene.object_bounds[shown[0]].mean(axis=0))
                kept[every] = False
                kept[list(group.levels[int(np.searchsorted(places.PINE_ENDS, away))])] = True
        return kept


# Several views.


@newest(
    "Alex-LeTux/perfect_dark_VR #71",
    "lens shift left out",
    partial(places.bridges, headset=True),
)
class MeanOfBothLenses(InView):
    """Both eyes are culled by a symmetric frustum as wide as theirs are in the mean, though the
    lens of each is shifted."""

    def lens(self, camera):
        return replace(camera, shift_x_px=0.0, shift_y_px=0.0)


@newest("DmitriySalnikov/godot_debug_draw_3d #79", "the other view", places.village_twice)
class FrustumOfTheLastViewport(InView):
    """What is small is culled in every viewport by the frustum of the one that was set last."""

    def in_view(self, camera, some, boxes):
        small = named(self.scene, "barrel", "cart", "lamp")[some]
        result = super().in_view(camera, some, boxes)
        last = self.last(camera)
        return np.where(small, super().in_view(last, some, boxes), result)

    def last(self, camera):
        """The last view of the frame that has this one."""
        path = self.place.path.relative_to(self.place.scene.origin)
        for number in path.numbers:
            every = path.views(number)
            if any(np.array_equal(camera.eye, one.eye) for one in every if one.view == camera.view):
                return every[-1]
        return camera


# Frusta, and far-away worlds.


@newest("IvanPopov/akra-engine-core #43", "box or sphere too small", places.hills)
class NodeOfAnOctreeForAPowerOfTwo(InView):
    """What is as wide as a power of two is put in an octree's node that does not hold it, and is
    tested by the box of that node."""

    def boxes(self):
        boxes = np.array(self.scene.object_bounds)
        side = np.ptp(boxes, axis=1).max(axis=1)
        for at in np.flatnonzero(np.exp2(np.rint(np.log2(side))) == side):
            low = np.floor(boxes[at, 0] / side[at]) * side[at]
            boxes[at] = low, low + side[at]
        return boxes


@newest(
    "luanti-org/luanti #12887",
    "centre's distance against far",
    partial(places.canyon, far=24.0),
)
class BlocksByTheDistanceOfTheirMiddle(InView):
    """A block is left out if its middle is farther away than one can see, though half of it may be
    nearer."""

    def in_view(self, camera, some, boxes):
        away = np.linalg.norm(boxes.mean(axis=1) - camera.eye, axis=1)
        blocks = named(self.scene, "tile")[some]
        return super().in_view(camera, some, boxes) & ~(blocks & (away > camera.far))


@newest("o3de/o3de #20115", "root of the tree too small", places.canyon)
class RootOfTheOctreeStaysSmall(Sound):
    """The octree does not grow: what lies beyond its root is stored in the root, and is found only
    where the root's box is in the view."""

    ROOT = np.array([[[-24.0, -24.0, -22.0], [24.0, 24.0, 26.0]]])

    def kept(self, camera):
        root = super().in_view(camera, np.zeros(1, int), self.ROOT)[0]
        return super().kept(camera) & root


@newest("PommeMC/Client #67", "rounded coordinates", places.fleet)
class EyeStoredInFloat(InView):
    """The camera's place in the world is stored in float32, and boxes are tested relative to it,
    far from the world's origin."""

    def kept(self, camera):
        self.origin = np.array(camera.origin)
        return super().kept(camera)

    def lens(self, camera):
        pose = camera.world_from_camera.copy()
        stored = (pose[:3, 3] + self.origin).astype(np.float32).astype(np.float64)
        pose[:3, 3] = stored - self.origin
        return replace(camera, world_from_camera=pose)
