"""Random cases: edges run through samples, surfaces coincide, planes lie just at near and far."""

from __future__ import annotations

import math
import random
from fractions import Fraction as Q
from functools import cache
from itertools import permutations, product
from typing import Any

from tests.fuzz_verdicts.case import (
    CLAMP,
    MIRROR,
    REPEAT,
    Case,
    Mask,
    Matrix,
    Part,
    determinant,
    multiply,
)

PROMISES = ("conservative", "exact", "aggressive", "approximate")


def turns(*, mirrored: bool) -> list[Matrix]:
    """The axes exchanged and reversed: the 24 rotations of a cube, or its 24 reflections."""
    result = []
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        m = [[signs[i] * (order[i] == j) for j in range(3)] + [0.0] for i in range(3)]
        m.append([0.0, 0.0, 0.0, 1.0])
        if (determinant(m) < 0) == mirrored:
            result.append(m)
    return result


# Where a thing stands again: the same place, its plane, or so near that only float64 sees it.
LITTLE = 2.0**-18
BESIDE = ((0, 0, 0), (0, 0, 0), (0.5, 0, 0), (0, 1, 0), (0, 0, LITTLE), (LITTLE, -LITTLE, LITTLE))
TURNS, MIRRORS = turns(mirrored=False), turns(mirrored=True)


@cache
def yfov_of(tangent: float) -> float | None:
    """An angle with tan(yfov / 2) exactly this in float64, if there is one."""
    angle = 2.0 * math.atan(tangent)
    for _ in range(4):
        angle = math.nextafter(angle, 0.0)
    for _ in range(9):
        if math.tan(angle / 2) == tangent:
            return angle
        angle = math.nextafter(angle, 4.0)
    return None


def random_case(seed: int) -> Case:
    rng = random.Random(seed)
    scale, origin = rng.choice(
        [(1.0, 0.0)] * 5 + [(1.0, 6.4e6), (1.0, 1.5e8), (8192.0, 1e5), (2.0**-6, 0.0)]
    )
    far_out = [origin * rng.choice((1.0, -1.0, 0.5, 0.0)) for _ in range(3)]
    if origin:
        far_out[rng.randrange(3)] = origin
    turn = rng.choice(MIRRORS if rng.random() < 0.2 else TURNS[:1])
    root = [[x * scale for x in row[:3]] + [far_out[i]] for i, row in enumerate(turn[:3])]
    root.append([0.0, 0.0, 0.0, 1.0])
    objects = [(f"o{i}", random_node(rng), random_parts(rng)) for i in range(rng.randint(3, 8))]
    for again in range(rng.choice((0, 1, 1, 2, 3))):  # or at least in the same plane: ties
        name, matrix, parts = rng.choice(objects)
        moved = multiply(matrix, shifted(rng.choice(BESIDE)))
        if rng.random() < 0.5:
            parts = random_parts(rng, parts[0].positions, parts[0].faces)
        objects.insert(rng.randrange(len(objects) + 1), (f"{name}x{again}", moved, parts))
    case = Case(seed, root, objects, [], rng.random() < 0.4, rng.choice(PROMISES))
    case.frames = [random_camera(rng, case, scale, far_out) for _ in range(rng.randint(1, 2))]
    count = len(case.triangles)
    if rng.random() < 0.6 and count:
        order = rng.sample(range(count), count)
        cuts = sorted(rng.choices(range(count + 1), k=rng.randint(0, 4)))
        case.units = [order[i:j] for i, j in zip([0, *cuts], [*cuts, count], strict=True)]
        for _ in range(rng.randint(0, 3)):  # overlapping ones
            case.units.append(rng.sample(range(count), rng.randint(0, min(3, count))))
    units = range(len(case.unit_lists))
    share = rng.choice((0.0, 0.3, 0.6, 0.85, 0.85, 1.0))
    case.drawn = [[u for u in units if rng.random() < share] for _ in case.frames]
    return case


def shifted(by: tuple[float, ...]) -> Matrix:
    return [[float(i == j) for j in range(3)] + [float(by[i])] for i in range(3)] + [
        [0.0, 0.0, 0.0, 1.0]
    ]


def random_node(rng: random.Random) -> Matrix:
    if rng.random() < 0.3:
        return shifted((0, 0, 0))
    turn = rng.choice(MIRRORS if rng.random() < 0.4 else TURNS)
    size = rng.choice((0.5, 1.0, 1.0, 2.0))
    grown = [[x * size for x in row] for row in turn[:3]] + [turn[3]]
    return multiply(shifted(tuple(rng.randint(-2, 2) for _ in range(3))), grown)


def random_parts(rng: random.Random, positions: Any = None, faces: Any = None) -> list[Part]:
    parts = []
    for _ in range(rng.choice((1, 1, 1, 2))):
        if positions is None:
            points, triangles = random_shape(rng)
        else:
            points, triangles = positions, faces
        kind = rng.choice(("opaque",) * 4 + ("mask",) * 4 + ("blend",) * 2)
        part = Part(points, triangles, kind, rng.random() < 0.5)
        if kind == "blend":
            part.transmission = rng.random() < 0.5
        if kind == "mask":
            add_mask(rng, part)
        parts.append(part)
    return parts


def random_shape(rng: random.Random) -> tuple[list[tuple[float, ...]], list[tuple[int, ...]]]:
    def number() -> float:
        return rng.choice((rng.randint(-4, 4), rng.randint(-8, 8) / 2))

    axis, plane = rng.randrange(3), number()

    def flat(x: float, y: float) -> tuple[float, ...]:
        point = [x, y]
        point.insert(axis, plane)
        return tuple(float(v) for v in point)

    kind = rng.choice(("loose", "quad", "wall") * 2 + ("junction", "sliver", "roof"))
    if kind == "loose":
        count = rng.randint(1, 3)
        return [tuple(float(number()) for _ in range(3)) for _ in range(3 * count)], [
            (3 * i, 3 * i + 1, 3 * i + 2) for i in range(count)
        ]
    x0, y0 = number(), number()
    x1, y1 = x0 + rng.randint(2, 8), y0 + rng.randint(2, 8)
    if kind == "wall":
        x0, y0, x1, y1 = -8, -8, 8, 8
    square = [flat(x0, y0), flat(x1, y0), flat(x1, y1), flat(x0, y1)]
    if kind == "junction":  # one long triangle against two whose corner meets its edge
        square.append(flat((x0 + x1) / 2, (y0 + y1) / 2))
        return square, [(0, 1, 2), (0, 4, 3), (4, 2, 3)]
    if kind == "sliver":  # degenerate ones among the others
        return square, [(0, 1, 2), (0, 0, 2), (0, 2, 3), (1, 1, 1)]
    if kind == "roof":  # two that meet in an edge, tilted
        point = list(square[3])
        point[axis] += rng.choice((-2.0, 1.0, 3.0))
        square[3] = tuple(point)
    return square, [(0, 1, 2), (0, 2, 3)]


def add_mask(rng: random.Random, part: Part) -> None:
    values = rng.choice(((0, 255), (0, 255), (0, 60, 130, 190, 255), (255,), (0,)))
    width, height = rng.choice((1, 2, 4, 8)), rng.choice((1, 2, 3, 4))
    texels = tuple(tuple(rng.choice(values) for _ in range(width)) for _ in range(height))
    textured = rng.random() < 0.9
    part.mask = Mask(
        texels if textured else ((255,),),
        rng.random() < 0.5,
        (rng.choice((REPEAT, MIRROR, CLAMP)), rng.choice((REPEAT, MIRROR, CLAMP))),
        rng.choice((1.0, 1.0, 0.75, 0.25)),
        rng.choice((0.3125, 0.5, 0.6875)),
        textured,
    )
    step = rng.choice((0.03125, 0.0625, 0.125, 0.25, 0.5))
    off = rng.choice((0.0, 0.015625, 0.0703125))
    axes = rng.sample(range(3), 2)
    part.uv = [(p[axes[0]] * step + off, p[axes[1]] * step - off) for p in part.positions]
    if rng.random() < 0.3:
        part.stretch = (rng.choice((2.0, -1.0, 0.5)), rng.choice((1.0, 4.0)), 0.25, -0.375)
    if rng.random() < 0.15:
        # 1 at a corner of each triangle: none is left out for its vertex alphas.
        firsts = {face[0] for face in part.faces}
        part.vertex_alpha = [
            1.0 if i in firsts else rng.choice((1.0, 0.75)) for i in range(len(part.positions))
        ]


def random_camera(
    rng: random.Random, case: Case, scale: float, far_out: list[float]
) -> dict[str, Any]:
    """Along an axis as a rule, from without or within."""
    width, height = rng.randint(6, 16), rng.choice((5, 6, 8, 12))
    turn = rng.choice(TURNS)
    back = [row[2] for row in turn[:3]]
    away = rng.choice((2.0, 4.0, 6.0, 8.0, 8.0))
    eye = [
        (back[i] * away + (rng.choice((0, 0, 1, 0.5)) if not back[i] else 0)) * scale + far_out[i]
        for i in range(3)
    ]
    if rng.random() < 0.15:  # aslant
        c, s = rng.choice(((0.6, 0.8), (0.8, -0.6), (12 / 13, 5 / 13)))
        turn = multiply(
            turn, [[c, 0.0, s, 0.0], [0.0, 1.0, 0.0, 0.0], [-s, 0.0, c, 0.0], [0.0, 0.0, 0.0, 1.0]]
        )
        eye = [turn[i][2] * 8.0 * scale + far_out[i] for i in range(3)]
    camera: dict[str, Any] = {
        "world_from_camera": [[*turn[i][:3], eye[i]] for i in range(3)] + [[0.0, 0.0, 0.0, 1.0]],
        "width": width,
        "height": height,
    }
    straight = rng.random() < 0.3
    if straight:
        camera["ymag"] = height * rng.choice((0.25, 0.5, 0.75)) * scale
    else:
        exact = yfov_of(height * rng.choice((0.0625, 0.125, 0.25)))
        camera["yfov"] = exact if exact and rng.random() < 0.9 else rng.uniform(0.4, 2.0)
    if rng.random() < 0.3:
        camera["shift_x_px"] = rng.choice((0.5, -0.25, 1.0, 3.0, 0.0))
        camera["shift_y_px"] = rng.choice((0.5, 0.125, -2.0))
    # Exactly at what is there: the depths of corners.
    forward = [-turn[i][2] for i in range(3)]
    depths = sorted(
        {
            float(sum(Q(forward[i]) * (v[i] - Q(eye[i])) for i in range(3)))
            for t in case.triangles
            for v in t.corners
        }
    )
    depths = [d for d in depths if d > 0.0]
    camera["near"], camera["far"] = 0.125 * scale, None
    if depths and rng.random() < 0.4:
        camera["near"] = rng.choice(depths[: len(depths) // 2 + 1])
    if depths and rng.random() < 0.4:
        camera["far"] = rng.choice(depths[len(depths) // 2 :])
    if camera["far"] is not None and camera["far"] <= camera["near"]:
        camera["far"] = camera["near"] + 4.0 * scale
    return camera
