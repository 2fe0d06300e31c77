"""Reports of wrong boxes and spheres, and of what is asked in their place."""

from __future__ import annotations

from functools import partial

import numpy as np

from tests.causes.reported import places
from tests.causes.reported.sound import (
    InView,
    Sound,
    corners,
    depths,
    outside,
    planes,
    reported,
    sphere_in_view,
    spheres,
)


@reported("mrdoob/three.js #14499", "box at rest, too small", places.reed_bed)
class SkinAtRest(InView):
    """What bends is tested by the box that it had at rest."""

    def boxes(self):
        return self.first.object_bounds


@reported("BabylonJS/Babylon.js #11424", "pose at rest", places.plaza)
class BoxStaysWhereTheMeshWasBound(InView):
    """The skeleton walks off, and the box stays where the mesh was bound to it."""

    def boxes(self):
        return self.first.object_bounds


@reported("BVE-Reborn/rend3 #475", "pose at rest", places.moving_groves)
class SphereNeverUpdated(InView):
    """Objects move, and their bounding spheres are those that they were added with."""

    def in_view(self, camera, some, boxes):
        return sphere_in_view(camera, *spheres(self.first.object_bounds[some]))


@reported("CesiumGS/cesium #487", "pose of the frame before", places.moving_groves)
class SphereOfTheFrameBefore(InView):
    """The sphere of what moves is brought up to date after it was tested."""

    def boxes(self):
        return self.before.object_bounds

    def kept(self, camera):
        result = super().kept(camera)
        self.before = self.scene
        return result


@reported("mrdoob/three.js #27733", "box at rest, too small", places.moving_groves)
class InstancesMovedSphereKept(InView):
    """All instances of a mesh are drawn or not by one sphere, made when it was first needed."""

    def in_view(self, camera, some, boxes):
        result = super().in_view(camera, some, boxes)
        cells = np.asarray(self.place.cells)[some]
        for cell in np.unique(cells[cells >= 0]):
            home = self.first.object_bounds[some[cells == cell]]
            whole = np.array([[home[:, 0].min(axis=0), home[:, 1].max(axis=0)]])
            result[cells == cell] = sphere_in_view(camera, *spheres(whole))[0]
        return result


@reported("OpenAWE-Project/OpenAWE #38", "box or sphere too small", places.groves)
class OneInstanceForAll(InView):
    """All plants of a patch are drawn or not by the sphere of one of them."""

    def in_view(self, camera, some, boxes):
        result = super().in_view(camera, some, boxes)
        cells = np.asarray(self.place.cells)[some]
        for cell in np.unique(cells[cells >= 0]):
            one = np.flatnonzero(cells == cell)[4:5]
            result[cells == cell] = sphere_in_view(camera, *spheres(boxes[one]))[0]
        return result


@reported("BibliothecaDAO/eternum #4679", "box or sphere too small", places.groves)
class EmptySphereAtTheOrigin(InView):
    """A patch that was empty when its sphere was made keeps a sphere without extent at the
    origin."""

    EMPTY_AT_FIRST = (2, 7, 11)

    def in_view(self, camera, some, boxes):
        result = super().in_view(camera, some, boxes)
        late = np.isin(np.asarray(self.place.cells)[some], self.EMPTY_AT_FIRST)
        result[late] = sphere_in_view(camera, np.zeros((1, 3)), [-1.0])[0]
        return result


@reported("playcanvas/engine #664", "box at rest, too small", partial(places.plaza, growing=True))
class ScaledLaterBoxKept(InView):
    """What is scaled as the game runs keeps the box of its former size."""

    def boxes(self):
        return self.first.object_bounds


class Strewn(InView):
    """Of copies of a mesh: the sphere of the mesh at home, placed."""

    def home(self, some):
        """Of the objects, (k, 3) centres in the world, (k,) radii at home, (k, 3, 3) axes."""
        boxes, worlds = (one[some] for one in self.place.rigs)
        centre, radius = spheres(boxes)
        axes = worlds[:, :3, :3]
        return np.einsum("kij,kj->ki", axes, centre) + worlds[:, :3, 3], radius, axes


@reported("nem0/LumixEngine #1320", "box or sphere too small", partial(places.strewn, "scaled"))
class ScaleForgotten(Strewn):
    """The sphere is where the object is, and as large as its mesh at scale 1."""

    def in_view(self, camera, some, boxes):
        centre, radius, _ = self.home(some)
        return sphere_in_view(camera, centre, radius)


@reported(
    "FlaxEngine/FlaxEngine #3940", "box or sphere too small", partial(places.strewn, "mirrored")
)
class NegativeRadius(Strewn):
    """The radius is multiplied with the greatest scale: negative, where all three are."""

    def in_view(self, camera, some, boxes):
        centre, radius, axes = self.home(some)
        size = np.linalg.norm(axes, axis=1).max(axis=1)
        return sphere_in_view(camera, centre, radius * size * np.sign(np.linalg.det(axes)))


@reported("uberpixel/Rayne #38", "box or sphere too small", places.strewn)
class FourOfEightCorners(Strewn):
    """Of a box that is turned, four corners are, and span the new one."""

    def boxes(self):
        homes, worlds = self.place.rigs
        some = corners(homes)[:, [0, 1, 2, 3]]
        turned = np.einsum("kij,kmj->kmi", worlds[:, :3, :3], some) + worlds[:, None, :3, 3]
        return np.stack([turned.min(axis=1), turned.max(axis=1)], axis=1)


@reported("JamesTKhan/Mundus #157", "box or sphere too small", places.strewn)
class CentreAddedUnturned(Strewn):
    """The box's centre at home is added to the object's place as if it were not turned."""

    def in_view(self, camera, some, boxes):
        homes, worlds = (one[some] for one in self.place.rigs)
        centre, radius = spheres(homes)
        return sphere_in_view(camera, centre + worlds[:, :3, 3], radius)


@reported("GothicVRProject/GothicVR #235, second", "box or sphere too small", places.strewn)
class SphereAboutThePivot(Strewn):
    """The sphere has the mesh's radius, and lies about the object's origin."""

    def in_view(self, camera, some, boxes):
        _, radius, _ = self.home(some)
        return sphere_in_view(camera, self.place.rigs[1][some, :3, 3], radius)


@reported("Unity-Technologies/ScriptableRenderPipeline #3001", "origin in the view", places.strewn)
class PivotInTheView(InView):
    """It is in the view if its origin is."""

    def in_view(self, camera, some, boxes):
        return sphere_in_view(camera, self.place.rigs[1][some, :3, 3], np.zeros(len(some)))


@reported("godotengine/godot #9544", "box or sphere too small", places.hills)
class HeightsInTheShader(InView):
    """Tiles are flat until a shader lifts them, and so are their boxes."""

    def boxes(self):
        boxes = np.array(self.scene.object_bounds)
        boxes[[name.startswith("tile") for name in self.scene.names], :, 1] = 0.0
        return boxes


@reported("tr7zw/EntityCulling #3", "box or sphere too small", partial(places.plaza, turning=True))
class HitBoxForTheModel(Sound):
    """What walks is tested by the box that it is hit by, which its model sticks out of."""

    def boxes(self):
        boxes = np.array(self.scene.object_bounds)
        walks = [name.startswith("walker") for name in self.scene.names]
        centre, half = boxes.mean(axis=1, keepdims=True), np.ptp(boxes, axis=1)[:, None] / 2
        small = np.minimum(half, (0.3, 0.7, 0.3))
        boxes[walks] = np.concatenate([centre - small, centre + small], axis=1)[walks]
        return boxes


@reported("luanti-org/luanti #14580", "box or sphere too small", places.village)
class BlockOfTheCentre(Sound):
    """An object is tested by the block of the map that its centre lies in, whatever sticks out."""

    SIDE = 4.0

    def boxes(self):
        boxes = np.array(self.scene.object_bounds)
        low = np.floor(boxes.mean(axis=1) / self.SIDE) * self.SIDE
        blocks = np.stack([low, low + self.SIDE], axis=1)
        loose = [name.startswith(("cart", "barrel", "lamp", "fence")) for name in self.scene.names]
        boxes[loose] = blocks[loose]
        return boxes


@reported("doceazedo/sprinkles #30", "box or sphere too small", places.village)
class UnitBoxAboutTheCentre(InView):
    """A box of one by one by one about the centre stands for whatever has none of its own."""

    def boxes(self):
        centre = self.scene.object_bounds.mean(axis=1, keepdims=True)
        boxes = np.concatenate([centre - 0.5, centre + 0.5], axis=1)
        boxes[0] = self.scene.object_bounds[0]
        return boxes


@reported("Blecki/dwarfcorp #410", "centre in the view", places.forest)
class CentreOfTheBox(InView):
    """It is in the view if the centre of its box is."""

    def in_view(self, camera, some, boxes):
        return sphere_in_view(camera, boxes.mean(axis=1), np.zeros(len(some)))


@reported("gazebosim/gz-math #85", "one corner in the view", partial(places.village, yfov=0.35))
class NoCornerInside(InView):
    """A box none of whose corners is in the view, and which holds no corner of it, is out."""

    def in_view(self, camera, some, boxes):
        inside = ~outside(camera, corners(boxes)).any(axis=0)
        wide, high = (np.array([-0.5, side - 0.5]) for side in (camera.width, camera.height))
        held = np.zeros(len(some), np.bool_)
        for x, y, depth in np.ndindex(2, 2, 2):
            along = camera.near if depth == 0 else camera.far
            a = 2.0 * (wide[x] + camera.shift_x_px) + 1.0 - camera.width
            b = camera.height - 2.0 * (high[y] + camera.shift_y_px) - 1.0
            way = camera.forward + a * camera.right_step + b * camera.up_step
            corner = camera.eye + along * way
            held |= ((boxes[:, 0] <= corner) & (corner <= boxes[:, 1])).all(axis=1)
        return inside.any(axis=1) | held


@reported("root-project/jsroot #61", "one corner in the view", partial(places.strewn, "scaled"))
class EightPointsContained(InView):
    """A box is in the view if the view contains one of its eight points."""

    def in_view(self, camera, some, boxes):
        return (~outside(camera, corners(boxes)).any(axis=0)).any(axis=1)


@reported("FUSEEProjectTeam/Fusee #652", "box without thickness", places.glasshouse)
class NoThickness(InView):
    """A box that is flat along an axis intersects nothing."""

    def in_view(self, camera, some, boxes):
        return super().in_view(camera, some, boxes) & (np.ptp(boxes, axis=1) > 0).all(axis=1)


@reported("Hubs-Foundation/hubs #946", "corners behind the eye", places.hall)
class AcrossTheNearPlane(InView):
    """What reaches across the near plane is left out."""

    def in_view(self, camera, some, boxes):
        nearest = depths(camera, corners(boxes)).min(axis=1)
        return super().in_view(camera, some, boxes) & (nearest >= camera.near)


@reported("x3dom/x3dom #571", "box across every side", partial(places.village, far=40.0))
class AcrossAllSides(InView):
    """A box that every side of the view cuts is taken for one that is outside."""

    def in_view(self, camera, some, boxes):
        beyond = outside(camera, corners(boxes))
        cut = beyond.any(axis=2) & ~beyond.all(axis=2)
        # Near and far are seldom cut at once.
        return super().in_view(camera, some, boxes) & ~cut[:5].all(axis=0)


@reported("lwjglgamedev/lwjglbook-leg #26", "plane's arithmetic wrong", places.groves)
class DepthTimesX(InView):
    """A plane's third factor is multiplied with the first coordinate, of what moves about."""

    def in_view(self, camera, some, boxes):
        result = super().in_view(camera, some, boxes)
        items = some % 4 == 1
        centre, radius = spheres(boxes[items])
        sides = planes(camera)
        signed = centre[:, [0, 1, 0]] @ sides[:, :3].T + sides[:, 3]
        result[items] = (signed > -radius[:, None]).all(axis=1)
        return result


@reported("pelicanmapping/rocky #189", "a point for the whole", places.globe)
class PointBelowTheHorizon(InView):
    """A tile is below the horizon if one point of it is, for it counts as having no extent."""

    RADIUS = 99.9

    def in_view(self, camera, some, boxes):
        point = boxes.mean(axis=1)
        point *= (100.0 / np.linalg.norm(point, axis=1))[:, None]
        result = super().in_view(camera, some, boxes)
        tiles = np.array([self.scene.names[i].startswith("tile") for i in some])
        return result & ~(tiles & self.below(camera.eye, point))

    def below(self, eye, points):
        """Whether a ball of `RADIUS` at the origin hides points from the eye."""
        ahead = points - eye
        reach = np.linalg.norm(ahead, axis=1)
        along = -(ahead @ eye) / reach
        closest = np.sqrt(np.maximum(eye @ eye - along**2, 0.0))
        return (along > 0) & (along < reach) & (closest < self.RADIUS)
