"""Sheds of planks, ground with holes, an orchard of blocks, and a pond seen in a mirror."""

from __future__ import annotations

from functools import cache

import numpy as np

from tests.causes.reported.places.making import (
    Objects,
    Place,
    heading,
    prism,
    put,
    scene_of,
    views,
)
from visref.camera_path import CameraPath
from visref.conformance.building import Cutout, Mesh, box, case, cut_out, together
from visref.scene import Alpha


@cache
def sheds() -> Place:
    """A lane between sheds whose fronts are planks with gaps between them, and what is in them."""
    rng = np.random.default_rng(47)
    objects: Objects = [("lane", box((-12, -0.3, -50), (12, 0, 12)))]
    for n in range(16):
        side, z = (-1 if n % 2 else 1), 4.0 - 6.0 * (n // 2)
        x = 3.0 * side
        back = x + 4 * side
        objects.append(
            (
                f"shed {n}",
                together(
                    box((min(x, back), 0, z - 0.1), (max(x, back), 2.6, z)),
                    box((min(x, back), 0, z - 5), (max(x, back), 2.6, z - 4.9)),
                    box((back - 0.05, 0, z - 5), (back + 0.05, 2.6, z)),
                    box((min(x, back), 2.6, z - 5), (max(x, back), 2.7, z)),
                ),
            )
        )
        planks, at = [], z - 4.9
        while at < z - 0.1:
            end = min(at + rng.uniform(0.25, 0.5), z - 0.1)
            planks.append(box((x - 0.03, 0, at), (x + 0.03, 2.6, end)))
            # Now and then one is missing.
            at = end + (rng.uniform(0.35, 0.5) if rng.random() < 0.1 else rng.uniform(0.03, 0.09))
        objects.append((f"front {n}", together(*planks)))
        for k in range(8):
            size = rng.uniform((0.3, 0.3, 0.3), (0.9, 1.6, 1.1))
            low = np.array([x + side * rng.uniform(0.4, 2.6), 0, z - rng.uniform(1.3, 4.6)])
            low[0] -= size[0] if side < 0 else 0.0
            objects.append((f"tool {n}-{k}", box(low, low + size)))
    for n in range(20):
        at = (rng.choice((-2.4, 2.4)), 0, rng.uniform(-44, 6))
        objects.append((f"bucket {n}", put(prism(7, 0.2, 0.4), at)))
    t = np.linspace(0, 1, 30)
    eyes = np.stack([0.8 * np.sin(7 * t), np.full(30, 1.6), 5 - 44 * t], axis=1)
    return Place(scene_of(objects), CameraPath(views(eyes, heading(1.0 * np.sin(13 * t), -0.06))))


@cache
def cellars() -> Place:
    """Plots of flat ground, some with a hole in it, over cellars full of things."""
    rng = np.random.default_rng(71)
    objects: Objects = [("bottom", box((-32, -3.6, -32), (32, -3.2, 32)))]
    grid = np.linspace(0, 6, 7)
    index = np.arange(49).reshape(7, 7)
    for i in range(10):
        for k in range(10):
            low = np.array([6.0 * i - 30, 0, 6.0 * k - 30])
            x, z = np.meshgrid(grid, grid, indexing="ij")
            points = np.stack([x.ravel(), np.zeros(49), z.ravel()], axis=1) + low
            kept = np.ones((6, 6), np.bool_)
            if (3 * i + 5 * k) % 4 == 0:
                a, b = rng.integers(1, 4, 2)
                kept[a : a + 2, b : b + 2] = False
                for n in range(4):
                    size = rng.uniform((0.3, 0.5, 0.3), (0.9, 1.8, 0.9))
                    aside = (a + rng.uniform(-0.6, 1.6), -3.2, b + rng.uniform(-0.6, 1.6))
                    at = np.add(low, aside)
                    objects.append((f"chest {i}-{k}-{n}", box(at, at + size)))
            else:
                at = np.add(low, (rng.uniform(1, 5), 0, rng.uniform(1, 5)))
                objects.append((f"bush {i}-{k}", put(prism(6, rng.uniform(0.3, 0.9), 0.9), at)))
            p, q, r, s = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
            faces = np.concatenate([np.stack(e, -1)[kept] for e in ((p, q, r), (p, r, s))])
            objects.append((f"plot {i}-{k}", (points, faces)))
    t = np.linspace(0, 1, 28)
    eyes = np.stack([-20 + 40 * t, 5 + np.sin(9 * t), 24 - 26 * np.sin(3 * t)], axis=1)
    path = CameraPath(views(eyes, heading(1.3 * np.sin(4 * t), -0.7)))
    return Place(scene_of(objects), path)


_SIDE = np.array([[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]])


def leaf_block() -> Mesh:
    """A cube of one each side, whose six sides have vertices of their own."""
    points, faces = [], []
    for axis in range(3):
        for end in (0, 1):
            u, v = (axis + 1) % 3, (axis + 2) % 3
            quad = np.zeros((4, 3))
            quad[:, axis] = end
            quad[:, u], quad[:, v] = [0, 1, 1, 0], [0, 0, 1, 1]
            order = [0, 1, 2, 3] if end else [3, 2, 1, 0]
            faces += [[len(points) * 4 + order[i] for i in c] for c in ((0, 1, 2), (0, 2, 3))]
            points.append(quad)
    return np.concatenate(points), np.array(faces)


@cache
def orchard() -> Place:
    """Trees of cubes on a grid: trunks, a fruit on each, and leaves with holes around the fruit."""
    rng = np.random.default_rng(53)
    objects: Objects = [("soil", box((-30, -1, -40), (30, 0, 14)))]
    leaves: dict[str, Cutout] = {}
    texels = np.kron(rng.random((5, 5)) < 0.5, np.ones((2, 2))).astype(np.uint8) * 255
    mesh, uv = leaf_block(), np.tile(_SIDE, (6, 1))
    for n in range(24):
        x, z = 5 * (n % 6) - 14 + rng.integers(-1, 2), 6 - 9 * (n // 6) - rng.integers(0, 4)
        top = int(rng.integers(1, 4))
        for up in range(top):
            objects.append((f"trunk {n}-{up}", box((x, up, z), (x + 1, up + 1, z + 1))))
        objects.append((f"fruit {n}", box((x, top, z), (x + 1, top + 1, z + 1))))
        for k, way in enumerate(((1, 0, 0), (-1, 0, 0), (0, 0, 1), (0, 0, -1), (0, 1, 0))):
            name = f"leaves {n}-{k}"
            objects.append((name, put(mesh, np.array([x, top, z]) + way)))
            leaves[name] = Cutout(uv, np.roll(texels, n + k, axis=1))
    for n in range(30):
        at = (rng.uniform(-16, 15), 0, rng.uniform(-34, 8))
        objects.append((f"stone {n}", put(prism(5, rng.uniform(0.2, 0.5), 0.5), at)))
    t = np.linspace(0, 1, 28)
    eyes = np.stack([-12 + 24 * t, np.full(28, 1.7), 13 - 12 * np.sin(3 * t)], axis=1)
    cameras = views(eyes, heading(0.7 * np.sin(6 * t), 0.08))
    built = cut_out(case(objects, cameras, alpha=dict.fromkeys(leaves, Alpha.MASK)), leaves)
    return Place(built.scene, CameraPath(cameras))


@cache
def pond() -> Place:
    """What a mirror at the height of the water shows: the eye lies below it, and only what is
    above counts. Lamps, trees and huts stand around, and stones lie below."""
    rng = np.random.default_rng(59)
    objects: Objects = []
    for n in range(12):
        a = 2 * np.pi * n / 12
        low = np.array([34 * np.sin(a) - 8, -0.4, -34 * np.cos(a) - 8])
        objects.append((f"bank {n}", box(low, np.add(low, (16, rng.uniform(0.6, 1.6), 16)))))
    for n in range(60):
        a, r = rng.uniform(0, 2 * np.pi), rng.uniform(20, 70)
        at = (r * np.sin(a), 0.1, -r * np.cos(a))
        tall = rng.uniform(2.0, 7.0)
        if n % 3:
            objects.append((f"tree {n}", put(prism(6, rng.uniform(0.4, 1.3), tall), at)))
        else:
            objects.append((f"hut {n}", put(box((-2, 0, -1.5), (2, 0.5 * tall, 1.5)), at, turn=a)))
    for n in range(40):
        a, r = rng.uniform(0, 2 * np.pi), rng.uniform(6, 50)
        foot = np.array([r * np.sin(a), 0.0, -r * np.cos(a)])
        tall = rng.uniform(1.2, 4.0)
        objects.append((f"pole {n}", put(prism(4, 0.08, tall), foot - (0, 0.5, 0))))
        low = np.add(foot, (-0.25, tall - 0.5, -0.25))
        objects.append((f"lamp {n}", box(low, low + 0.5)))
    for n in range(40):
        low = np.array([rng.uniform(-15, 15), rng.uniform(-3, -1), rng.uniform(-15, 15)])
        objects.append((f"stone {n}", box(low, low + rng.uniform(0.3, 0.9, 3))))
    t = np.linspace(0, 1, 26)
    eyes = np.stack([8 * np.sin(5 * t), -1.2 - 1.2 * np.sin(4 * t) ** 2, 14 - 20 * t], axis=1)
    ahead = heading(0.9 * np.sin(8 * t), 0.12 + 0.06 * np.sin(9 * t))
    cameras = views(eyes, ahead, far=90.0, clip_plane=(0.0, 1.0, 0.0, 0.0))
    return Place(scene_of(objects), CameraPath(cameras))
