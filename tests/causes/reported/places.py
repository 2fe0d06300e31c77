"""Where the reported faults are tried: a village, a hall, a plaza full of people, and others, each
with a way through it that walks and turns.

Each is made once, whoever asks for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from visref.camera import Camera, look_at
from visref.camera_path import CameraPath, Frame
from visref.conformance.building import Cutout, Mesh, box, case, cut_out, panel, together
from visref.conformance.moving import Bending, about, bent, moved, rigged
from visref.formats.placed import transformed
from visref.inputs import open_scene
from visref.rig import Rig
from visref.scene import Alpha, Float64, Group, Scene

WIDTH, HEIGHT = 192, 120

Objects = list[tuple[str, Mesh]]


@dataclass(frozen=True, eq=False)
class Place:
    """`rigs`: of a place whose objects are copies of a few meshes, each one's box at home,
    (n, 2, 3), and world_from_object, (n, 4, 4). `cells`: by object, the cell that it belongs to,
    -1 for none."""

    scene: Scene
    path: CameraPath
    rigs: tuple[Float64, Float64] | None = None
    cells: Sequence[int] = ()


def views(eyes, ahead, **lens) -> list[Camera]:
    """A camera at each eye, (n, 3), that looks along `ahead`, (n, 3)."""
    values = {"width": WIDTH, "height": HEIGHT, "near": 0.2, "far": 300.0, "yfov": 0.95, **lens}
    if "ymag" in values:
        del values["yfov"]
    return [Camera(look_at(e, e + a), **values) for e, a in zip(eyes, ahead, strict=True)]


def heading(angles, dip=0.0) -> Float64:
    """(n, 3): level directions, 0 along -Z and growing to the right, that dip by so much."""
    angles = np.asarray(angles, float)
    dips = np.broadcast_to(dip, angles.shape)
    return np.stack([np.sin(angles), dips, -np.cos(angles)], axis=1)


def scene_of(objects: Objects) -> Scene:
    return Scene.from_objects([(name, *mesh) for name, mesh in objects], source="reported")


def put(mesh: Mesh, at, *, turn=0.0, size=1.0) -> Mesh:
    """A mesh turned about the upright, scaled and moved."""
    points, faces = mesh
    c, s = np.cos(turn), np.sin(turn)
    return (points * size) @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]) + at, faces


def prism(sides: int, radius: float, height: float) -> Mesh:
    """A closed upright prism on the ground."""
    a = 2 * np.pi * np.arange(sides) / sides
    ring = np.stack([radius * np.cos(a), np.zeros(sides), -radius * np.sin(a)], axis=1)
    points = np.concatenate([ring, np.add(ring, (0, height, 0)), [(0, 0, 0), (0, height, 0)]])
    faces = []
    for i in range(sides):
        j = (i + 1) % sides
        faces += [(i, j, sides + j), (i, sides + j, sides + i)]
        faces += [(2 * sides, j, i), (2 * sides + 1, sides + i, sides + j)]
    return points, np.array(faces)


# The village.


def _village() -> Objects:
    rng = np.random.default_rng(41)
    objects: Objects = [("ground", box((-45, -0.4, -45), (45, 0, 45)))]
    for i in range(7):
        for k in range(7):
            if (i, k) in {(3, 3), (1, 4)}:
                continue
            x, z = 11.0 * (i - 3) - 5.5, 11.0 * (k - 3) - 5.5
            wide, deep, tall = rng.uniform((4.5, 4.5, 2.8), (7.4, 7.4, 7.0))
            low = np.array([x - wide / 2, 0, z - deep / 2])
            objects.append((f"house {i}-{k}", box(low, np.add(low, (wide, tall, deep)))))
            roof = prism(4, 0.72 * max(wide, deep), 0.5)
            objects.append((f"roof {i}-{k}", put(roof, (x, tall, z), turn=np.pi / 4)))
            objects.append((f"chimney {i}-{k}", box((x, tall, z), (x + 0.6, tall + 1.7, z + 0.5))))
            objects.append(
                (f"fence {i}-{k}", box(np.add(low, (-0.9, 0, -0.9)), np.add(low, (wide, 1, -0.85))))
            )
    for n in range(110):
        along, aside = rng.uniform(-36, 36), rng.choice((-1.4, 1.4)) + rng.uniform(-0.3, 0.3)
        street = 11.0 * rng.integers(-3, 3)
        x, z = (street + aside, along) if n % 2 else (along, street + aside)
        if n % 5 == 0:
            objects.append((f"lamp {n}", put(prism(6, 0.09, 3.4), (x, 0, z))))
        elif n % 5 == 1:
            objects.append((f"cart {n}", put(box((-1, 0.3, -0.5), (1, 1.1, 0.5)), (x, 0, z))))
        else:
            objects.append((f"barrel {n}", put(prism(7, 0.35, 0.9), (x, 0, z))))
    return objects


def _street(frames: int = 30) -> tuple[Float64, Float64]:
    """Up a street, round a corner with a look back, and down a lane."""
    t = np.linspace(0, 1, frames)
    z = np.where(t < 0.55, 30 - 52 * t, 30 - 52 * 0.55)
    x = np.where(t < 0.55, 0.1, 0.1 + 44 * (t - 0.55))
    turn = np.interp(t, [0, 0.2, 0.4, 0.55, 0.7, 0.85, 1], [0, 0.5, -0.45, 0.2, 1.6, 2.2, 1.1])
    eyes = np.stack([x, np.full(frames, 1.7), z], axis=1)
    return eyes, heading(turn, -0.04)


@cache
def village(frames: int = 30, **lens) -> Place:
    return Place(scene_of(_village()), CameraPath(views(*_street(frames), **lens)))


@cache
def village_from_above(rolled: bool = False, zoomed: bool = False) -> Place:
    """The village in an orthographic map that pans, and turns or zooms."""
    n = 24
    t = np.linspace(0, 1, n)
    eyes = np.stack([-18 + 34 * t, np.full(n, 55.0), 34 - 22 * t], axis=1)
    made = []
    for k, one in enumerate(views(eyes, np.tile([0, -0.85, -0.53], (n, 1)), ymag=9.0, far=200.0)):
        if rolled:
            one = replace(one, world_from_camera=_rolled(one.world_from_camera, 0.06 * k))
        made.append(replace(one, ymag=9.0 + 0.2 * k) if zoomed else one)
    return Place(scene_of(_village()), CameraPath(made))


def _rolled(pose: Float64, angle: float) -> Float64:
    c, s = np.cos(angle), np.sin(angle)
    result = pose.copy()
    result[:3, :3] = pose[:3, :3] @ [[c, -s, 0], [s, c, 0], [0, 0, 1]]
    return result


@cache
def village_with(change: str) -> Place:
    """The village along its street: "zoomed" out, in a "resized" window, banking to and "fro", by a
    camera that "stands" and looks about, or that "jumps" and then waits."""
    made = views(*_street(30))
    if change == "zoomed":
        made = [replace(one, yfov=0.5 + 0.022 * k) for k, one in enumerate(made)]
    elif change == "resized":
        wide = [replace(one, width=120, height=120) for one in made[:8]]
        made = wide + [replace(one, width=216, height=108) for one in made[8:]]
    elif change == "fro":
        made = [
            replace(one, world_from_camera=_rolled(one.world_from_camera, 0.7 * np.sin(0.5 * k)))
            for k, one in enumerate(made)
        ]
    elif change == "stands":
        eyes, _ = _street(30)
        stops = np.repeat(eyes[[0, 9, 15, 21, 27]], 6, axis=0)
        made = views(stops, heading(np.tile(0.32 * np.arange(6), 5) - 0.4, -0.04))
    elif change == "jumps":
        eyes, ahead = _street(30)
        order = np.repeat([2, 20, 8, 26, 12, 29], 4)
        step = np.tile([0.0, 0.0, 0.0, 0.6], 6)
        made = views(eyes[order] + step[:, None] * np.array([0.3, 0, -1]), ahead[order])
        made = [replace(one, cut=k % 4 == 0 and k > 0) for k, one in enumerate(made)]
    return Place(scene_of(_village()), CameraPath(made))


@cache
def village_twice(eyes: str = "split") -> Place:
    """The village in two views: a "split" screen of two players, or a "headset" whose lenses are
    shifted outward; or with a "mirror", which looks back, or a "probe" that hangs above."""
    at, ahead = _street(28)
    frames = []
    for k in range(len(at)):
        right = np.cross(ahead[k], (0, 1, 0))
        right /= np.linalg.norm(right)
        first = {"width": 132, "height": 120}
        if eyes == "headset":
            left = at[k] - 0.032 * right
            one, two = views([left, at[k] + 0.032 * right], [ahead[k]] * 2, yfov=1.5, **first)
            one = replace(one, shift_x_px=-17.0, shift_y_px=5.0)
            two = replace(two, shift_x_px=17.0, shift_y_px=5.0)
        elif eyes == "mirror":
            one, two = views([at[k], at[k] + 0.5 * right], [ahead[k], (1, 1, -1) * -ahead[k]])
            two = replace(two, width=96, height=60)
        elif eyes == "probe":
            one, two = views([at[k], at[k] + (0, 5.5, 0)], [ahead[k], ahead[k] - (0, 0.3, 0)])
            two = replace(two, width=96, height=60)
        else:
            other = (k + 11) % len(at)
            one, two = views([at[k], at[other]], [ahead[k], ahead[other]], **first)
        names = ("main", eyes) if eyes in ("mirror", "probe") else ("left", "right")
        frames.append(
            Frame(tuple(replace(c, view=n) for c, n in zip((one, two), names, strict=True)))
        )
    return Place(scene_of(_village()), CameraPath(frames))


@cache
def far_village() -> Place:
    """The village a hundred thousand kilometres out, on a grid that float64 still holds finely."""
    near = village()
    origin = np.array([2.0**27, 0.0, -(2.0**26)])
    scene = replace(near.scene, origin=origin)
    cameras = []
    for one in near.path.cameras:
        pose = one.world_from_camera.copy()
        pose[:3, 3] += origin
        cameras.append(replace(one, world_from_camera=pose))
    return Place(scene, CameraPath(cameras))


# The hall.


@cache
def hall(**lens) -> Place:
    """Rooms of a warehouse in a row and beside each other, with doors, racks, pillars and goods."""
    rng = np.random.default_rng(8)
    objects: Objects = [
        ("floor", box((0, -0.3, 0), (48, 0, 36))),
        ("ceiling", box((0, 4.2, 0), (48, 4.5, 36))),
        ("north wall", box((0, 0, -0.3), (48, 4.2, 0))),
        ("south wall", box((0, 0, 36), (48, 4.2, 36.3))),
        ("west wall", box((-0.3, 0, 0), (0, 4.2, 36))),
        ("east wall", box((48, 0, 0), (48.3, 4.2, 36))),
    ]
    cells = [-1] * len(objects)

    def add(name: str, mesh: Mesh, cell: int) -> None:
        objects.append((name, mesh))
        cells.append(cell)

    for i in range(4):
        for k in range(3):
            x, z, cell = 12.0 * i, 12.0 * k, 3 * i + k
            gap = rng.uniform(2.0, 8.0)
            if i:
                ends = ((z, z + gap), (z + gap + 1.8, z + 12))
                walls = [box((x - 0.1, 0, a), (x + 0.1, 4.2, b)) for a, b in ends]
                add(f"wall {i}-{k} x", together(*walls), -1)
            if k:
                ends = ((x, x + gap), (x + gap + 1.8, x + 12))
                walls = [box((a, 0, z - 0.1), (b, 4.2, z + 0.1)) for a, b in ends]
                add(f"wall {i}-{k} z", together(*walls), -1)
            for n in range(3):
                at = np.array([x + 2.2 + 3.1 * n, 0, z + rng.uniform(1.5, 6.5)])
                rack = [box((0, y, 0), (0.9, y + 0.08, 3.4)) for y in (0.1, 1.1, 2.1, 3.0)]
                add(f"rack {cell}-{n}", put(together(*rack), at), cell)
                for shelf in range(4):
                    up = (0.18, 1.18, 2.18, 3.08)[shelf]
                    low = at + np.array([0.15, up, rng.uniform(0.1, 2.4)])
                    size = rng.uniform((0.3, 0.25, 0.3), (0.6, 0.7, 0.9))
                    add(f"goods {cell}-{n}-{shelf}", box(low, low + size), cell)
            for n in range(4):
                at = np.array([x + rng.uniform(1, 11), 0, z + rng.uniform(9.0, 11.3)])
                add(f"crate {cell}-{n}", box(at, at + rng.uniform(0.4, 1.1, 3)), cell)
    t = np.linspace(0, 1, 30)
    x = np.interp(t, [0, 0.4, 0.7, 1], [2, 20, 28, 45])
    z = np.interp(t, [0, 0.4, 0.7, 1], [11, 8.6, 20.5, 22])
    turn = np.interp(t, [0, 0.2, 0.4, 0.6, 0.8, 1], [1.6, 0.9, 2.0, 3.0, 1.4, 0.4])
    eyes = np.stack([x, np.full(30, 1.75), z], axis=1)
    path = CameraPath(views(eyes, heading(turn, -0.07), **{"yfov": 1.05, **lens}))
    return Place(scene_of(objects), path, cells=cells)


# What moves.


@cache
def plaza(*, leaving: bool = False, turning: bool = False, growing: bool = False) -> Place:
    """People walk in rings about columns and kiosks, as a camera strolls by. `leaving`: kiosks are
    taken down one by one, and people come. `turning`: what walks are long carts. `growing`: what
    stands there are balloons that are blown up."""
    rng = np.random.default_rng(23)
    objects: Objects = [("pavement", box((-40, -0.3, -40), (40, 0, 40)))]
    for n in range(22):
        a = 2 * np.pi * n / 22
        at = (19 * np.sin(a), 0, 19 * np.cos(a))
        objects.append((f"column {n}", put(prism(8, 0.55, 6.0), at)))
    for n in range(14):
        x, z = rng.uniform(-14, 14, 2)
        kiosk = box((-1.6, 0, -1.2), (1.6, 2.7, 1.2))
        objects.append((f"kiosk {n}", put(kiosk, (x, 0, z), turn=rng.uniform(0, 3))))
    walkers = []
    for n in range(70):
        radius, start = rng.uniform(4, 26), rng.uniform(0, 6.3)
        pace = rng.uniform(0.03, 0.11) * rng.choice((-1, 1))
        length = rng.uniform(1.0, 2.2) if turning else rng.uniform(0.15, 0.25)
        tall = rng.uniform(0.35, 0.6) if growing else rng.uniform(1.4, 1.9)
        where = np.array([radius * np.sin(start), 0, radius * np.cos(start)])
        figure = box((-0.22, 0.0, -length), (0.22, tall, length))
        objects.append((f"walker {n}", put(figure, where)))
        walkers.append((f"walker {n}", pace, where))
    eyes = np.stack([np.linspace(-9, 12, 28), np.full(28, 1.7), np.linspace(24, 9, 28)], axis=1)
    cameras = views(eyes, heading(0.2 + 0.55 * np.sin(0.33 * np.arange(28)), -0.03))
    frames = []
    for k, one in enumerate(cameras):
        poses = {}
        for name, pace, where in walkers:
            if growing:
                size = np.diag([*(3 * [1 + 0.13 * k * (abs(pace) / 0.07)]), 1.0])
                poses[name] = moved(*where) @ size @ moved(*-where)
            else:
                poses[name] = about((0.0, 0.0, 0.0), pace * k, axis=1)
        gone = [f"kiosk {n}" for n in range(14) if k > 3 + 1.6 * n]
        gone += [f"walker {n}" for n in range(70) if n % 3 == 0 and k < 2 + n / 3]
        absent = tuple(gone) if leaving else ()
        frames.append(Frame((one,), world_from_object=poses, absent=absent))
    return Place(scene_of(objects), CameraPath(frames))


@cache
def passages() -> Place:
    """Behind a row of gates, which slide up and down, lie shops full of things."""
    rng = np.random.default_rng(77)
    objects: Objects = [("road", box((-40, -0.3, -22), (40, 0, 14)))]
    gates = []
    for n in range(10):
        x = 6.0 * n - 30
        objects.append((f"pier {n}", box((x - 1.2, 0, -6), (x + 1.2, 4, -4))))
        objects.append((f"lintel {n}", box((x + 1.2, 2.9, -6), (x + 4.8, 4, -4))))
        objects.append((f"gate {n}", box((x + 1.1, 0, -5.1), (x + 4.9, 3.1, -4.9))))
        gates.append(f"gate {n}")
        for m in range(9):
            low = np.array([x + rng.uniform(0.3, 5), 0, -6.5 - rng.uniform(0, 5)])
            size = rng.uniform((0.3, 0.3, 0.3), (0.9, 2.0, 0.9))
            objects.append((f"ware {n}-{m}", box(low, low + size)))
    eyes = np.stack([np.linspace(-24, 22, 28), np.full(28, 1.7), np.full(28, 4.0)], axis=1)
    cameras = views(eyes, heading(0.5 * np.sin(0.4 * np.arange(28))))
    frames = []
    for k, one in enumerate(cameras):
        up = 1.5 - 1.5 * np.cos(0.45 * (k - 1.3 * np.arange(10)) - 0.4)
        poses = {name: moved(y=float(height)) for name, height in zip(gates, up, strict=True)}
        frames.append(Frame((one,), world_from_object=poses))
    return Place(scene_of(objects), CameraPath(frames))


@cache
def reed_bed() -> Place:
    """Reeds that grow and bend far out of their places, between walls, and a walk along them."""
    rng = np.random.default_rng(5)
    objects: Objects = [("bank", box((-30, -0.5, -30), (30, 0, 12)))]
    for n in range(12):
        low = np.array([rng.uniform(-24, 24), 0, rng.uniform(-20, 0)])
        objects.append((f"wall {n}", box(low, low + rng.uniform((1, 0.6, 0.3), (5, 1.8, 0.8)))))
    reeds = []
    for n in range(60):
        at = np.array([rng.uniform(-24, 24), 0, rng.uniform(-22, 4)])
        steps = np.linspace(0, 1.4, 8)
        points = np.array([[side, y, 0.0] for y in steps for side in (-0.09, 0.09)]) + at
        faces = [f for k in range(0, 14, 2) for f in ((k, k + 1, k + 3), (k, k + 3, k + 2))]
        reeds.append(len(objects))
        objects.append((f"reed {n}", (points, np.array(faces))))
    ways = rng.uniform(-1.6, 1.6, len(reeds))
    positions = [points.astype(np.float32) for _, (points, _) in objects]
    grown = {at: bent(positions[at], way) for at, way in zip(reeds, ways, strict=True)}
    scene = rigged(scene_of(objects), positions, Bending(positions, grown))
    eyes = np.stack([np.linspace(-14, 14, 26), np.full(26, 1.6), np.full(26, 9.0)], axis=1)
    cameras = views(eyes, heading(0.6 * np.sin(0.5 * np.arange(26)), -0.05))
    frames = [Frame((one,), time_s=0.16 * k) for k, one in enumerate(cameras)]
    return Place(scene, CameraPath(frames))


@cache
def avenue(*, by_distance: bool = True) -> Place:
    """An avenue of trees, each with three levels of detail that follow one another with the
    distance, as a camera goes along it. Not `by_distance`: by their size in a zooming camera."""
    rng = np.random.default_rng(31)
    objects: Objects = [("road", box((-8, -0.3, -90), (8, 0, 15)))]
    groups, centres = [], []
    for n in range(44):
        x, z = (4.5 if n % 2 else -4.5) + rng.uniform(-1, 1), 4.0 - 2.0 * n
        height = rng.uniform(3.0, 6.0)
        levels = []
        for level, sides in enumerate((9, 6, 3)):
            trunk, crown = prism(sides, 0.2, height), prism(sides, 1.1, 0.55 * height)
            mesh = together(trunk, put(crown, (0, 0.45 * height, 0)))
            levels.append((len(objects),))
            objects.append((f"tree {n} level {level}", put(mesh, (x, 0, z))))
        every = tuple(one for level in levels for one in level)
        groups.append(Group(f"tree {n}", f"tree {n}", every, levels=tuple(levels)))
        centres.append((x, height / 2, z))
    for n in range(20):
        low = np.array([rng.uniform(-7, 7), 0, rng.uniform(-80, 5)])
        objects.append((f"bench {n}", box(low, np.add(low, (0.5, 0.5, 1.4)))))
    scene = scene_of(objects)
    positions = [points.astype(np.float32) for _, (points, _) in objects]
    starts = np.cumsum([0, *map(len, positions)])
    worlds = np.tile(np.eye(4), (len(objects), 1, 1))
    # Coarser levels are absent at rest.
    coarse = np.zeros(len(objects), np.bool_)
    for group in groups:
        for level in group.levels[1:]:
            coarse[list(level)] = True
    rig = Rig(positions, np.arange(len(objects)), worlds, starts, triangles=scene.triangles)
    scene = replace(scene, groups=tuple(groups), rig=rig, absent=coarse)
    eyes = np.stack([0.8 * np.sin(np.arange(28)), np.full(28, 1.7), 12 - 1.7 * np.arange(28)], 1)
    cameras = views(eyes, heading(0.25 * np.sin(0.45 * np.arange(28))))
    if not by_distance:
        cameras = [replace(one, yfov=1.05 - 0.028 * k) for k, one in enumerate(cameras)]
    frames = []
    for one in cameras:
        away = np.linalg.norm(np.array(centres) - one.eye, axis=1)
        levels = {f"tree {n}": int(level) for n, level in enumerate(level_of(one, away))}
        frames.append(Frame((one,), levels=levels))
    return Place(scene, CameraPath(frames))


# The levels of the avenue's trees end at so many metres in a view of 0.95 radians.
LEVEL_ENDS = (14.0, 32.0)


def level_of(camera: Camera, away: Float64) -> Float64:
    """(n,) the level of a tree at each distance, as large as it is in this camera's view."""
    scale = np.tan(camera.yfov / 2) / np.tan(0.95 / 2)
    return np.searchsorted(LEVEL_ENDS, away * scale)


# What is placed.


@cache
def strewn(kind: str = "turned") -> Place:
    """Copies of a few long meshes, "turned", "scaled" or "mirrored" into place among walls, with
    their origin at one end."""
    rng = np.random.default_rng(12)
    objects: Objects = [("ground", box((-40, -0.4, -60), (40, 0, 20)))]
    homes, worlds = [objects[0][1]], [np.eye(4)]
    for _ in range(16):
        low = np.array([rng.uniform(-22, 22), 0, rng.uniform(-45, 4)])
        mesh = box(low, low + rng.uniform((2, 1.5, 0.3), (6, 3.2, 0.8)))
        objects.append(("wall", mesh))
        homes.append(mesh)
        worlds.append(np.eye(4))
    meshes = (
        box((0, 0, 0), (3.6, 0.5, 0.4)),
        box((0, 0, -1.9), (0.5, 0.9, 1.2)),
        put(prism(5, 0.35, 2.6), (0.9, 0, 0.4)),
    )
    for n in range(140):
        home = meshes[n % 3]
        size = np.ones(3)
        if kind == "scaled":
            size = np.exp(rng.uniform(np.log(0.5), np.log((4.0, 2.0, 4.5))))
        if kind == "mirrored":
            size = np.array([-1.0, 1.0, 1.0]) * rng.uniform(0.8, 1.3)
        a = rng.uniform(0, 2 * np.pi)
        world = moved(rng.uniform(-22, 22), 0.0, rng.uniform(-48, 6))
        world = world @ about((0.0, 0.0, 0.0), a, axis=1) @ np.diag([*size, 1.0])
        points, _ = transformed(world[None], home[0].astype(np.float32), np.zeros(3))
        faces = home[1][:, ::-1] if np.linalg.det(world[:3, :3]) < 0 else home[1]
        objects.append((f"piece {n}", (points[0], faces)))
        homes.append(home)
        worlds.append(world)
    scene = scene_of(objects)
    positions = [np.asarray(points, np.float32) for points, _ in homes]
    starts = np.cumsum([0, *map(len, positions)])
    rig = Rig(positions, np.arange(len(homes)), np.array(worlds), starts)
    boxes = np.array([[points.min(axis=0), points.max(axis=0)] for points in positions], float)
    t = np.linspace(0, 1, 28)
    eyes = np.stack([-6 + 12 * t, np.full(28, 1.7), 12 - 34 * t], axis=1)
    path = CameraPath(views(eyes, heading(0.9 * np.sin(7 * t), -0.08)))
    return Place(replace(scene, rig=rig), path, rigs=(boxes, np.array(worlds)))


@cache
def groves() -> Place:
    """Meadow plants in patches, each patch an instanced mesh: `cells` says which."""
    rng = np.random.default_rng(19)
    objects: Objects = [("meadow", box((-40, -0.3, -60), (40, 0, 20)))]
    cells = [-1]
    for n in range(10):
        low = np.array([rng.uniform(-25, 25), 0, rng.uniform(-45, 6)])
        objects.append((f"rock {n}", box(low, low + rng.uniform(0.8, 3.0, 3))))
        cells.append(-1)
    for patch in range(18):
        centre = np.array([rng.uniform(-24, 24), 0, rng.uniform(-46, 6)])
        for n in range(10):
            at = centre + rng.uniform((-5, 0, -5), (5, 0, 5))
            plant = prism(5, rng.uniform(0.2, 0.5), rng.uniform(0.6, 1.8))
            objects.append((f"plant {patch}-{n}", put(plant, at)))
            cells.append(patch)
    t = np.linspace(0, 1, 28)
    eyes = np.stack([8 * np.sin(4 * t), np.full(28, 1.8), 14 - 40 * t], axis=1)
    path = CameraPath(views(eyes, heading(0.8 * np.sin(6 * t), -0.1)))
    return Place(scene_of(objects), path, cells=cells)


@cache
def moving_groves() -> Place:
    """The meadow of which patches drift about, every plant with its patch."""
    still = groves()
    rng = np.random.default_rng(3)
    drift = rng.uniform((-1.1, 0, -0.6), (1.1, 0, 0.6), (18, 3))
    names = still.scene.names
    frames = []
    for k, one in enumerate(still.path.cameras):
        poses = {
            names[i]: moved(*(k * drift[cell])) for i, cell in enumerate(still.cells) if cell >= 0
        }
        frames.append(Frame((one,), world_from_object=poses))
    return Place(still.scene, CameraPath(frames), cells=still.cells)


# The ground.


def height(x, z) -> Float64:
    """Of the hills, at any place."""
    ridge = 7 * np.exp(-((x - 8 * np.sin(z / 17)) ** 2) / 60) + 9 * np.exp(-((z + 25) ** 2) / 40)
    peaks = 5 * np.maximum(0, np.sin(x / 3.1) * np.sin(z / 3.7)) ** 3
    return ridge * (0.6 + 0.4 * np.sin(x / 9)) + peaks


@cache
def hills() -> Place:
    """A hundred and sixty-nine tiles of hilly ground, with huts, and a low flight over it."""
    objects: Objects = []
    steps = np.linspace(0, 8.0, 9)
    grid = np.array([[i * 9 + j, i * 9 + j + 1] for i in range(8) for j in range(8)])
    faces = np.concatenate([[(a, b, b + 9), (a, b + 9, a + 9)] for a, b in grid])
    for i in range(13):
        for k in range(13):
            x, z = np.meshgrid(8.0 * (i - 6.5) + steps, 8.0 * (k - 8.5) + steps)
            points = np.stack([x.ravel(), height(x, z).ravel(), z.ravel()], axis=1)
            objects.append((f"tile {i}-{k}", (points, faces[:, ::-1])))
    rng = np.random.default_rng(2)
    for n in range(40):
        x, z = rng.uniform(-45, 45), rng.uniform(-60, 28)
        y = float(height(x, z)) - 0.3
        objects.append((f"hut {n}", box((x, y, z), (x + 2, y + 1.9, z + 1.6))))
    t = np.linspace(0, 1, 28)
    x, z = 12 * np.sin(3 * t), 30 - 48 * t
    eyes = np.stack([x, height(x, z) + 2.4, z], axis=1)
    path = CameraPath(views(eyes, heading(0.8 * np.sin(5 * t), 0.08)))
    return Place(scene_of(objects), path)


@cache
def globe() -> Place:
    """Tiles of a rough globe, and towers on it, from an orbit low above it. Its radius is 100."""
    rng = np.random.default_rng(6)
    objects: Objects = []

    def point(lat, lon):
        r = 100 + 1.2 * np.sin(9 * lat) * np.cos(7 * lon)
        return np.stack(
            [r * np.cos(lat) * np.sin(lon), r * np.sin(lat), r * np.cos(lat) * np.cos(lon)], -1
        )

    n = 4
    index = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = np.concatenate(
        [np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)]
    )
    for i in range(12):
        for k in range(20):
            lats = np.linspace(-1.5 + 0.25 * i, -1.5 + 0.25 * (i + 1), n + 1)
            lons = np.linspace(0.1 * np.pi * k, 0.1 * np.pi * (k + 1), n + 1)
            lat, lon = np.meshgrid(lats, lons, indexing="ij")
            objects.append((f"tile {i}-{k}", (point(lat, lon).reshape(-1, 3), faces)))
    for k in range(60):
        foot = point(np.array(rng.uniform(-0.5, 0.5)), np.array(rng.uniform(-1.2, 1.8)))
        up = foot / np.linalg.norm(foot)
        east = np.cross((0, 1, 0), up)
        basis = np.stack([east / np.linalg.norm(east), up, np.cross(east, up)])
        points, tower = box((-0.8, -1, -0.8), (0.8, rng.uniform(2, 7), 0.8))
        objects.append((f"tower {k}", (points @ basis + foot, tower)))
    t = np.linspace(0, 1, 26)
    lat, lon = 0.3 * np.sin(4 * t), -0.6 + 1.2 * t
    eyes = 1.07 * point(lat, lon)
    ahead = point(lat + 0.1 * np.cos(9 * t), lon + 0.35) - eyes
    return Place(scene_of(objects), CameraPath(views(eyes, ahead, near=0.5)))


# Materials.


_UV = np.array([[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]])


@cache
def glasshouse() -> Place:
    """Glass walls and pools between plants and benches, lattices, and solid walls."""
    rng = np.random.default_rng(14)
    objects: Objects = [("floor", box((-25, -0.3, -40), (25, 0, 14)))]
    glass, lattices = [], {}
    texels = np.kron(rng.random((6, 6)) < 0.45, np.ones((2, 2))).astype(np.uint8) * 255
    for n in range(26):
        x, z = rng.uniform(-20, 16), rng.uniform(-32, 4)
        wide = rng.uniform(2, 5)
        if n % 2:
            glass.append(f"pane {n}")
            objects.append((glass[-1], panel((x, x + wide), (0, 2.8), z)))
        else:
            lattices[f"lattice {n}"] = Cutout(_UV, np.roll(texels, n, axis=1))
            objects.append((f"lattice {n}", panel((x, x + wide), (0.1, 2.4), z)))
    for n in range(6):
        x, z = rng.uniform(-20, 16), rng.uniform(-28, 2)
        objects.append((f"wall {n}", box((x, 0, z), (x + 3, 2.6, z + 0.2))))
    for n in range(120):
        at = (rng.uniform(-21, 21), 0, rng.uniform(-36, 5))
        if n % 3:
            plant = prism(5, rng.uniform(0.15, 0.4), rng.uniform(0.5, 1.6))
        else:
            plant = box((0, 0, 0), rng.uniform((0.3, 0.3, 0.3), (1.2, 0.6, 0.6)))
        objects.append((f"plant {n}", put(plant, at)))
    t = np.linspace(0, 1, 24)
    eyes = np.stack([-9 + 19 * t, np.full(24, 1.6), 11 - 12 * t], axis=1)
    cameras = views(eyes, heading(0.55 * np.sin(6 * t), -0.05))
    alpha = dict.fromkeys(glass, Alpha.BLEND) | dict.fromkeys(lattices, Alpha.MASK)
    built = cut_out(case(objects, cameras, alpha=alpha), lattices)
    return Place(built.scene, CameraPath(cameras))


@cache
def lake() -> Place:
    """A lake, whose water is glass, with wrecks under it and posts in it; one looks down."""
    rng = np.random.default_rng(15)
    objects: Objects = [
        ("bed", box((-30, -5, -40), (30, -4.5, 20))),
        ("shore", box((-40, -5, 12), (40, 0.3, 24))),
    ]
    water = []
    for i in range(6):
        for k in range(6):
            water.append(f"water {i}-{k}")
            x, z = 10.0 * (i - 3), 8.0 * (k - 4) - 4
            flat = np.array([[x, 0, z], [x, 0, z + 8], [x + 10, 0, z + 8], [x + 10, 0, z]])
            objects.append((water[-1], (flat, np.array([[0, 1, 2], [0, 2, 3]]))))
    for n in range(70):
        x, z = rng.uniform(-27, 26), rng.uniform(-36, 10)
        if n % 5 == 0:
            objects.append((f"post {n}", put(prism(6, 0.2, 6.0), (x, -4.5, z))))
        else:
            size = rng.uniform((0.4, 0.3, 0.4), (2.0, 1.2, 2.0))
            low = np.array([x, rng.uniform(-4.5, -1.5), z])
            objects.append((f"wreck {n}", box(low, low + size)))
    t = np.linspace(0, 1, 15)
    eyes = np.stack([-12 + 22 * t, 2.5 + np.sin(5 * t), 16 - 14 * t], axis=1)
    cameras = views(eyes, heading(0.5 * np.sin(6 * t), -0.45))
    built = case(objects, cameras, alpha=dict.fromkeys(water, Alpha.BLEND))
    return Place(built.scene, CameraPath(cameras))


@cache
def forest() -> Place:
    """A generated wood of leaf cards, and a walk of our own in it."""
    scene, path, _ = open_scene("forest:scale=0.03,seed=4")
    assert path is not None
    made = []
    for k, one in enumerate(path.cameras[::3]):
        pose = one.world_from_camera.copy()
        c, s = np.cos(0.25 * k), np.sin(0.25 * k)
        pose[:3, :3] = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) @ pose[:3, :3]
        made.append(replace(one, world_from_camera=pose, width=160, height=100, cut=False))
    return Place(scene, CameraPath(made))
