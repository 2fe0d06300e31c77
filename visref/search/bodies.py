"""Parts that stand in space: solids about the eye, across the near plane, nested, touching."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from visref.conformance.building import Mesh, box, panel, together
from visref.search.kinds import (
    DEPTH,
    PLACE,
    SEED,
    YES,
    Catalogue,
    Gene,
    Stage,
    log,
    register,
    whole,
)

BODIES: Catalogue = {}

_WIDE = Gene(-0.2, 1.2)


def _about_y(angle: float) -> NDArray[np.float64]:
    """(3, 3) that turns rows of points about the upright axis."""
    s, c = math.sin(angle), math.cos(angle)
    return np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])


@register(BODIES, 1.5, x=_WIDE, y=_WIDE, depth=DEPTH, a=log(0.02, 0.6), b=log(0.02, 0.6),
          c=log(0.02, 0.6), one=YES, far=YES)  # fmt: skip
def solid(stage: Stage, x, y, depth, a, b, c, one, far):  # type: ignore[no-untyped-def]
    """a box anywhere, in part beyond the image's sides"""
    centre = stage.space(x, y, depth)
    half = np.array([a, b, c]) * depth
    stage.put("solid", box(centre - half, centre + half), one_sided=bool(one and far))


@register(BODIES, 1.5, count=whole(4, 60), seed=SEED, near=log(2.0, 12.0), far=log(1.5, 4.0),
          size=log(0.02, 0.3))  # fmt: skip
def crowd(stage: Stage, count, seed, near, far, size):  # type: ignore[no-untyped-def]
    """many boxes, one before the other"""
    rng = np.random.default_rng(int(seed))
    for _ in range(int(count)):
        depth = near * float(rng.uniform(1.0, far))
        x, y = rng.uniform(-0.1, 1.1, 2)
        centre = stage.space(x, y, depth)
        half = rng.uniform(0.2, 1.0, 3) * size * depth
        stage.put("one of a crowd", box(centre - half, centre + half))


@register(BODIES, 1.5, reach=log(0.3, 30.0), squash=log(0.2, 1.0), gate=YES, aside=Gene(-0.9, 0.9),
          content=whole(0, 6), seed=SEED, one=YES)  # fmt: skip
def around_the_eye(stage: Stage, reach, squash, gate, aside, content, seed, one):  # type: ignore[no-untyped-def]
    """the eye inside a box, or inside the box of something that is open"""
    rng = np.random.default_rng(int(seed))
    half = reach * np.array([1.0, squash, 1.0])
    middle = half * (aside, aside / 2, -aside)
    if gate:
        thin = 0.12 * reach
        low, high = middle - half, middle + half
        a = box((low[0], low[1], low[2]), (low[0] + thin, high[1], low[2] + thin))
        b = box((high[0] - thin, low[1], high[2] - thin), high)
        stage.put("gate", together(a, b))
    else:
        stage.put("hall", box(middle - half, middle + half), one_sided=bool(one))
    for _ in range(int(content)):
        centre = middle + half * rng.uniform(-0.8, 0.8, 3)
        size = 0.1 * reach * rng.uniform(0.3, 1.0, 3)
        stage.put("content", box(centre - size, centre + size))
    beyond = stage.space(0.5, 0.5, 2.5 * reach)
    stage.put("beyond", box(beyond - 0.2 * reach, beyond + 0.2 * reach))


@register(BODIES, 2.5, side=whole(0, 3), aside=log(0.05, 8.0), thick=log(0.02, 1.0),
          far=log(1.0, 60.0), behind=log(0.05, 30.0), door=YES, width=log(0.1, 4.0),
          at=log(2.0, 12.0), yaw=Gene(-1.6, 1.6), turns=YES)  # fmt: skip
def beam(  # type: ignore[no-untyped-def]
    stage: Stage, side, aside, thick, far, behind, door, width, at, yaw, turns
):
    """something long beside the eye, from before the near plane to behind the eye"""
    axis, sign = int(side) % 2, 1.0 if side < 2 else -1.0
    low, high = np.full(3, -width), np.full(3, width)
    low[axis], high[axis] = sorted((sign * aside, sign * (aside + thick)))
    low[2], high[2] = -far, behind
    points, faces = box(low, high)
    if turns:
        points = points @ _about_y(yaw)
    stage.put("beam", (points, faces))
    if door:
        # Hides where the beam's ends, and the mirror images of those behind the eye, project.
        door_at = min(at, far * 0.9)
        reach = 0.4 * door_at
        stage.put("door", panel((-reach, reach), (-0.8 * reach, 0.8 * reach), -door_at))
        half = np.array([0.5 * reach, 0.25 * reach, 0.6 * reach])
        behind_it = np.array([0.0, 0.0, -1.75 * door_at])
        stage.put("behind the door", box(behind_it - half, behind_it + half))


@register(BODIES, 0.8, x=PLACE, y=PLACE, before=log(0.2, 0.99), after=log(1.01, 3.0),
          size=log(0.02, 1.0))  # fmt: skip
def across_near(stage: Stage, x, y, before, after, size):  # type: ignore[no-untyped-def]
    """small things across the near plane"""
    near = max(stage.view.near, 1e-3)
    low, high = stage.space(x, y, near * after), stage.space(x, y, near * before)
    half = size * near * np.array([1.0, 1.0, 0.0])
    mid = (low + high) / 2
    stage.put("across near", box(
        np.minimum(np.minimum(low, high), mid - half), np.maximum(np.maximum(low, high), mid + half)
    ))  # fmt: skip


@register(BODIES, 0.8, x=PLACE, y=PLACE, depth=DEPTH, size=log(0.05, 0.5), count=whole(2, 4),
          shrink=Gene(0.3, 1.0))  # fmt: skip
def nested(stage: Stage, x, y, depth, size, count, shrink):  # type: ignore[no-untyped-def]
    """boxes in boxes, the last of the same size perhaps"""
    centre = stage.space(x, y, depth)
    for number in range(int(count)):
        half = size * depth * shrink**number
        stage.put("nested", box(centre - half, centre + half))


@register(BODIES, 1.0, depth=DEPTH, columns=whole(2, 9), rows=whole(1, 5), missing=whole(0, 44),
          size=log(0.05, 0.4), back=log(1.3, 3.0), one=YES)  # fmt: skip
def bricks(stage: Stage, depth, columns, rows, missing, size, back, one):  # type: ignore[no-untyped-def]
    """touching boxes, one missing, and something behind"""
    side = size * depth
    for column in range(int(columns)):
        for row in range(int(rows)):
            if column * int(rows) + row == int(missing):
                continue
            low = np.array([side * (column - columns / 2), side * (row - rows / 2), -depth])
            stage.put("brick", box(low, low + side), one_sided=bool(one))
    half = side * np.array([columns, rows, 0.0]) * 0.4
    behind = np.array([0.0, 0.0, -depth * back])
    stage.put("behind bricks", box(behind - half - (0, 0, 0.1 * depth * (back - 1)), behind + half))


@register(BODIES, 1.0, angle=Gene(0.1, 3.0), x=PLACE, y=PLACE, depth=DEPTH, size=log(0.05, 0.4),
          long=log(1.0, 8.0), mirrored=YES, pole=Gene(0.05, 0.9), axis=whole(0, 2),
          flag=YES)  # fmt: skip
def turned(stage: Stage, angle, x, y, depth, size, long, mirrored, pole, axis, flag):  # type: ignore[no-untyped-def]
    """something turned or mirrored that shows beyond a pole before it"""
    half = size * depth
    points, faces = box((-half, -half / long, -0.02 * half), (half, half / long, 0.02 * half))
    j, k = (int(axis) + 1) % 3, (int(axis) + 2) % 3
    turn = np.eye(3)
    turn[j, j] = turn[k, k] = math.cos(angle)
    turn[j, k], turn[k, j] = -math.sin(angle), math.sin(angle)
    points = points @ turn.T
    if mirrored:
        points[:, 0], faces = -points[:, 0], faces[:, ::-1]
    centre = stage.space(x, y, depth)
    stage.put("turned", (points + centre, faces))
    front = stage.space(x, y, depth * 0.7)
    width = 0.7 * half * pole * np.array([1.0, 20.0, 0.0])
    low, high = front - width, front + width
    mesh = panel((low[0], high[0]), (low[1], high[1]), float(front[2]))
    at = x * stage.width, y * stage.height
    stage.put("pole", stage.flagged(mesh, *at, flag))


@register(BODIES, 0.8, depth=DEPTH, size=log(0.1, 0.5), count=whole(1, 6), reach=Gene(1.02, 1.8),
          flag=YES)  # fmt: skip
def pierced_body(stage: Stage, depth, size, count, reach, flag):  # type: ignore[no-untyped-def]
    """objects that pierce each other, and one that is swallowed"""
    centre, half = stage.space(0.5, 0.5, depth), size * depth
    core = box(centre - half, centre + half)
    stage.put("core", stage.flagged(core, stage.width / 2, stage.height / 2, flag))
    stage.put("swallowed", box(centre - 0.7 * half, centre + 0.7 * half))
    for number in range(int(count)):
        low, high = np.full(3, -0.25 * half), np.full(3, 0.25 * half)
        axis, sign = number % 3, 1.0 if number < 3 else -1.0
        low[axis], high[axis] = sorted((0.0, sign * reach * half))
        stage.put("spike", box(centre + low, centre + high))


@register(BODIES, 0.8, level=log(0.02, 5.0), reach=log(10.0, 1e5), stones=whole(0, 8), seed=SEED,
          steep=YES)  # fmt: skip
def ground(stage: Stage, level, reach, stones, seed, steep):  # type: ignore[no-untyped-def]
    """a huge triangle below the eye, stones on it, and what is buried"""
    rng = np.random.default_rng(int(seed))
    corners = np.array([[-reach, -level, reach], [reach, -level, reach], [0.0, -level, -2 * reach]])
    if steep:
        corners[:, 1] += 0.02 * corners[:, 0]
    stage.put("ground", (corners, np.array([[0, 1, 2]])))
    for _ in range(int(stones)):
        x, z, size = rng.uniform(-8.0, 8.0), -rng.uniform(2.0, 30.0), rng.uniform(0.05, 1.0)
        stage.put("stone", box((x - size, -level, z - size), (x + size, size - level, z + size)))
        deep = -level - 2 * size
        stage.put("buried", box((x, deep, z), (x + size, deep + 1.7 * size, z + size)))


@register(BODIES, 1.0, shape=whole(0, 4), depth=DEPTH)
def nothing(stage: Stage, shape, depth):  # type: ignore[no-untyped-def]
    """objects without triangles, of one point, edge-on or flat"""
    at = stage.space(0.5, 0.5, depth)
    flat = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, -1.0]])
    one = np.array([[0, 1, 2]])
    none: Mesh = (np.zeros((0, 3)), np.zeros((0, 3), np.int64))
    line = np.array([[0.0, 0.0, 0.0], [1.0, 0.5, 0.0], [2.0, 1.0, 0.0]])
    meshes: list[Mesh] = [none, (np.tile(at, (3, 1)), one), (flat * (1, 1, depth), one),
                          (at + line, one), none]  # fmt: skip
    stage.put("nothing", meshes[int(shape)])


@register(BODIES, 1.5, layers=whole(1, 4), side=whole(1, 4), seed=SEED, level=log(0.3, 4.0),
          rough=log(0.02, 0.5), ceiling=YES, torn=Gene(0.0, 0.4))  # fmt: skip
def torn_layers(stage: Stage, layers, side, seed, level, rough, ceiling, torn):  # type: ignore[no-untyped-def]
    """rough sheets of many triangles, one under the other, with quads missing"""
    rng = np.random.default_rng(int(seed))
    count = 5
    for layer in range(int(layers)):
        y = level * (layer + 1) * (1.0 if ceiling else -1.0)
        for i in range(int(side)):
            for j in range(int(side)):
                grid = np.empty((count, count, 3))
                x = 4.0 * (i - side / 2)
                grid[..., 0] = np.linspace(x, x + 4.0, count)[:, None]
                grid[..., 2] = np.linspace(-4.0 * j - 1.0, -4.0 * j - 5.0, count)[None]
                grid[..., 1] = y + rng.uniform(-rough, rough, (count, count))
                first = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).reshape(-1)
                first = first[rng.random(len(first)) >= torn]
                a, b, c, d = first, first + 1, first + count + 1, first + count
                faces = np.stack([a, b, c, a, c, d], axis=1).reshape(-1, 3)
                stage.put("tile", (grid.reshape(-1, 3), faces))


@register(BODIES, 1.0, columns=whole(1, 40), rows=whole(1, 8), depth=DEPTH, w=log(0.1, 2.0),
          h=log(0.1, 2.0), posts=whole(0, 6), post=log(0.01, 0.2), bent=Gene(0.0, 1.0))  # fmt: skip
def sheet(stage: Stage, columns, rows, depth, w, h, posts, post, bent):  # type: ignore[no-untyped-def]
    """an object of many triangles, of which posts hide some: clusters"""
    across, up = np.linspace(-0.5, 0.5, int(columns) + 1), np.linspace(-0.5, 0.5, int(rows) + 1)
    size = stage.width * stage.pixel(depth) * w, stage.height * stage.pixel(depth) * h
    points = np.array([[a * size[0], b * size[1], -depth * (1 + bent * a * a)]
                       for a in across for b in up])  # fmt: skip
    n = int(rows) + 1
    first = (np.arange(int(columns))[:, None] * n + np.arange(int(rows))).reshape(-1)
    a, b, c, d = first, first + n, first + n + 1, first + 1
    stage.put("sheet", (points, np.stack([a, b, c, a, c, d], axis=1).reshape(-1, 3)))
    for number in range(int(posts)):
        x = ((number + 0.37) / posts) * stage.width
        half = post * stage.width / 2
        stage.put("post", stage.rect((x - half, x + half), (-1.0, stage.height), 0.7 * depth))


@register(BODIES, 1.0, side=YES, depth=DEPTH, near=log(0.05, 1.0), far=log(1.0, 4.0),
          show=log(0.5, 20.0), screen=YES, tall=log(0.05, 1.0))  # fmt: skip
def wall_aside(stage: Stage, side, depth, near, far, show, screen, tall):  # type: ignore[no-untyped-def]
    """a large object at the image's edge, most of it outside, its middle too"""
    sign = 1.0 if side else -1.0
    edge = stage.width - 1.0 - show if side else show
    x = float(stage.space((edge + 0.5) / stage.width, 0.5, depth)[0])
    far_x = x + sign * depth * far
    low, high = sorted((x, far_x))
    half = tall * depth * 0.5
    stage.put("aside", box((low, -half, -depth * (1 + 0.2 * near)), (high, half, -depth)))
    if screen:
        end = stage.rect((-1.0, stage.width), (-1.0, stage.height), depth * (1 + near))
        stage.put("behind all", end)


@register(BODIES, 1.2, yaw=Gene(0.2, 1.4), side=YES, away=log(2.0, 15.0), long=log(2.0, 20.0),
          start=Gene(-1.0, 1.0), screen=Gene(0.5, 1.2), tall=log(0.1, 3.0), flag=YES)  # fmt: skip
def slanting_wall(stage: Stage, yaw, side, away, long, start, screen, tall, flag):  # type: ignore[no-untyped-def]
    """a wall that comes nearer towards the image's edge, all but that end behind a screen: its
    nearest point by distance is not its nearest by depth"""
    sign = 1.0 if side else -1.0
    low = (start * away - long / 2, -tall, -away - 0.3)
    points, faces = box(low, (low[0] + long, tall, -away))
    points = points @ _about_y(sign * yaw)
    stage.put("slanting", (points, faces))
    near = float(-points[:, 2].max())
    depth = max(screen * away, 1.1 * stage.view.near, near * 1.05)
    cover = stage.rect((-1.0, stage.width), (-1.0, stage.height), depth)
    stage.put("screen", stage.flagged(cover, stage.width / 2, 2.0, flag))


@register(BODIES, 1.2, seed=SEED, side=whole(2, 4), level=Gene(0.5, 3.0), pitch=log(3.0, 9.0))
def houses(stage: Stage, seed, side, level, pitch):  # type: ignore[no-untyped-def]
    """houses along streets, before and behind the eye"""
    rng = np.random.default_rng(int(seed))
    reach = 6 * pitch
    stage.put("ground", box((-reach, -level - 1.0, -reach), (reach, -level, reach)))
    n = int(side)
    for i in range(-n // 2, n - n // 2):
        for j in range(-1, n):
            centre = np.array([pitch * (i + 0.5), -level, -pitch * (j + 0.5)])
            half = pitch * rng.uniform(0.15, 0.44, 3) * (1.0, 0.0, 1.0)
            height = np.array([0.0, pitch * rng.uniform(0.2, 1.2), 0.0])
            stage.put("house", box(centre - half, centre + half + height))
