"""Parts that are laid out in pixels: what shows by how much, through what, and before what.

Each builds the objects of one small situation, with something that shows and, mostly, something
that does not. Edges run anywhere between samples.
"""

from __future__ import annotations

import numpy as np

from visref.conformance.building import Cutout, Mesh, together
from visref.scene import Alpha
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

LAYOUTS: Catalogue = {}

# How far an edge is beyond a sample that it covers, in pixels: never on it.
_PAST = Gene(0.02, 0.98)
# The far side of one thing behind another, by depth.
_BEHIND = log(1.003, 3.0)
_CORNER_UV = np.array([[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]])


@register(LAYOUTS, 1.0, x=PLACE, y=PLACE, w=log(0.01, 1.5), h=log(0.01, 1.5), depth=DEPTH,
          lean=log(0.2, 5.0), leans=YES, flag=YES)  # fmt: skip
def panel(stage: Stage, x, y, w, h, depth, lean, leans, flag):  # type: ignore[no-untyped-def]
    """a rectangle anywhere, upright or leaning away"""
    cx, cy = x * stage.width, y * stage.height
    half = w * stage.width / 2, h * stage.height / 2
    right = depth * lean if leans else depth
    mesh = stage.rect((cx - half[0], cx + half[0]), (cy - half[1], cy + half[1]), depth, right)
    stage.put("panel", stage.flagged(mesh, cx, cy, flag))


@register(LAYOUTS, 3.0, x=PLACE, y=PLACE, w=whole(1, 17), h=whole(1, 17), depth=DEPTH, back=_BEHIND,
          side=whole(0, 3), before=_PAST, after=_PAST, out=log(0.02, 3.0), flag=YES)  # fmt: skip
def peek(stage: Stage, x, y, w, h, depth, back, side, before, after, out, flag):  # type: ignore[no-untyped-def]
    """a rectangle rounded inward: something peeks out from behind by a pixel or less"""
    left, top = stage.column(x), stage.row(y)
    right, low = left + w, top + h
    cover = stage.rect((left - before, right + after), (top - before, low + after), depth)
    stage.put("cover", stage.flagged(cover, (left + right) / 2, (top + low) / 2, flag))
    inside = stage.rect((left + 0.2, right - 0.2), (top + 0.2, low - 0.2), depth * back * 1.2)
    stage.put("covered", inside)
    # It owns the next row or column: its edge is `out` beyond those samples.
    sides = [left + 0.3, right - 0.3, top + 0.3, low - 0.3]
    sides[int(side)] = (left - 1 - out, right + 1 + out, top - 1 - out, low + 1 + out)[int(side)]
    stage.put("peeks", stage.rect((sides[0], sides[1]), (sides[2], sides[3]), depth * back))


@register(LAYOUTS, 3.0, at=PLACE, width=log(0.02, 9.0), share=_PAST, upright=YES, depth=DEPTH,
          back=_BEHIND, reach=whole(0, 20), long=Gene(0.05, 1.2), across=PLACE,
          flag=YES)  # fmt: skip
def gap(stage: Stage, at, width, share, upright, depth, back, reach, long, across, flag):  # type: ignore[no-untyped-def]
    """a gap between two walls, down to a small part of a pixel, and things behind it"""
    size, other = (stage.width, stage.height) if upright else (stage.height, stage.width)
    centre = float(min(size - 1, int(at * size)))
    low, high = centre - share * width, centre + (1.0 - share) * width
    middle, half = across * other, long * other / 2

    def place(a: float, b: float, c: float, d: float, z: float) -> Mesh:
        return stage.rect((a, b), (c, d), z) if upright else stage.rect((c, d), (a, b), z)

    sides = (middle - half, middle + half)
    walls = together(place(-2.0, low, *sides, depth), place(high, size + 1.0, *sides, depth))
    flag_x, flag_y = (size * 0.2, middle) if upright else (middle, size * 0.2)
    stage.put("walls", stage.flagged(walls, flag_x, flag_y, flag))
    inner = (middle - half * 0.7, middle + half * 0.7)
    stage.put("in the gap", place(low - reach, high + reach, *inner, depth * back))
    stage.put("beside the gap", place(high + 1.5, high + 6.0, *inner, depth * back * 1.1))


@register(LAYOUTS, 2.0, x=PLACE, y=PLACE, w=log(0.05, 0.7), h=log(0.05, 0.7), depth=DEPTH,
          back=log(1.05, 4.0), over=Gene(0.0, 4.0), crates=whole(1, 8), seed=SEED)  # fmt: skip
def doorway(stage: Stage, x, y, w, h, depth, back, over, crates, seed):  # type: ignore[no-untyped-def]
    """an opening in a wall, a door before it, and crates behind: what shows when the door moves"""
    rng = np.random.default_rng(int(seed))
    cx, cy = x * stage.width, y * stage.height
    half = w * stage.width / 2, h * stage.height / 2
    left, right, top, low = cx - half[0], cx + half[0], cy - half[1], cy + half[1]
    door = stage.rect((left - over, right + over), (top - over, low + over), depth * 0.99)
    stage.put("door", door)
    for number in range(int(crates)):
        at = rng.uniform((left, top), (right, low))
        size = rng.uniform(0.1, 0.5) * min(half)
        sides = (at[0] - size, at[0] + size), (at[1] - size, at[1] + size)
        stage.put("crate", stage.rect(*sides, depth * back * (1.0 + 0.01 * number)))
    wide, high = (-2.0, stage.width + 1.0), (-2.0, stage.height + 1.0)
    parts = [((wide[0], left), high), ((right, wide[1]), high)]
    parts += [((left, right), (high[0], top)), ((left, right), (low, high[1]))]
    # What would be the wrong way round is no part of the wall.
    kept = [part for part in parts if part[0][0] < part[0][1] and part[1][0] < part[1][1]]
    if kept:
        stage.put("wall", together(*(stage.rect(*part, depth) for part in kept)))


@register(LAYOUTS, 2.0, first=Gene(0.0, 8.0), period=log(1.2, 17.0), solid=Gene(0.3, 0.95),
          upright=YES, depth=DEPTH, back=_BEHIND, x=PLACE, y=PLACE, w=log(0.02, 1.2),
          h=log(0.02, 1.2), many=YES)  # fmt: skip
def sieve(stage: Stage, first, period, solid, upright, depth, back, x, y, w, h, many):  # type: ignore[no-untyped-def]
    """many slits: cells of a coarse map that are covered but for one"""
    size, other = (stage.width, stage.height) if upright else (stage.height, stage.width)
    strips: list[Mesh] = []
    at = first - period - 1.0
    while at < size and len(strips) < 64:
        ends, long = (at, at + solid * period), (-2.0, other + 1.0)
        sides = (ends, long) if upright else (long, ends)
        strips.append(stage.rect(sides[0], sides[1], depth))
        at += period
    if strips:
        stage.put("sieve", together(*strips))
    places = [(x, y)]
    if many:
        places = [((x + i / 5) % 1.0, (y + j / 4) % 1.0) for i in range(5) for j in range(4)]
    for number, (px, py) in enumerate(places):
        cx, cy = px * stage.width, py * stage.height
        across = (cx - w * stage.width / 2, cx + w * stage.width / 2)
        down = (cy - h * stage.height / 2, cy + h * stage.height / 2)
        stage.put("behind the sieve", stage.rect(across, down, depth * back * (1 + 0.01 * number)))


@register(LAYOUTS, 4.0, count=whole(1, 12), seed=SEED, depth=DEPTH, back=log(1.2, 8.0),
          slope=log(0.3, 4.0), before=log(1e-5, 0.3), power=YES, corner=whole(0, 4),
          hole=Gene(0.1, 0.49))  # fmt: skip
def pierced_wall(stage: Stage, count, seed, depth, back, slope, before, power, corner, hole):  # type: ignore[no-untyped-def]
    """a wall with holes of a pixel, before panels that show at one corner of theirs only, just
    before a slanted backing"""
    rng = np.random.default_rng(int(seed))
    width, height = stage.width, stage.height
    holes = {}
    for number in range(int(count)):
        w, h = (int(v) for v in rng.integers(0, 24, 2))
        if power:
            # One more than a power of two: what is counted one short loses the last.
            w, h = (int(2 ** int(v)) for v in rng.integers(0, 6, 2))
        x, y = int(rng.integers(width)), int(rng.integers(height))
        ends = (x, x + w, x, x + w, x + w // 2), (y, y + h, y + h, y, y + h // 2)
        which = int(corner) if number % 2 else int(rng.integers(5))
        at = (ends[0][which], ends[1][which])
        if 0 <= at[0] < width and 0 <= at[1] < height:
            holes[at] = (x, x + w, y, y + h)
    rows: list[int] = sorted({y for _, y in holes})
    parts = []
    last = -3.0
    for y in rows:
        parts.append(stage.rect((-3.0, width + 2.0), (last, y - hole), depth))
        columns = sorted(x for x, row in holes if row == y)
        edges = [-3.0, *(side for x in columns for side in (x - hole, x + hole)), width + 2.0]
        for left, right in zip(edges[::2], edges[1::2], strict=True):
            parts.append(stage.rect((left, right), (y - hole, y + hole), depth))
        last = y + hole
    parts.append(stage.rect((-3.0, width + 2.0), (last, height + 2.0), depth))
    stage.put("wall", together(*parts))
    near, far = depth * back, depth * back * slope
    # Behind the wall everywhere.
    near, far = max(near, depth * 1.01), max(far, depth * 1.01)
    left, right = -8.0, width + 8.0
    stage.put("backing", stage.rect((left, right), (-8.0, height + 8.0), near, far))
    for (x, _), (x0, x1, y0, y1) in holes.items():
        share = (x - left) / (right - left)
        # Of a plane, the reciprocal of depth is linear over the image.
        plane = 1.0 / ((1.0 - share) / near + share / far)
        if not stage.view.is_perspective:
            plane = (1.0 - share) * near + share * far
        at = max(plane * (1.0 - before), depth * 1.001)
        mesh = stage.rect((x0 - 0.3, x1 + 0.3), (y0 - 0.3, y1 + 0.3), at)
        stage.put("behind a hole", mesh)


@register(LAYOUTS, 1.5, count=whole(1, 40), seed=SEED, depth=DEPTH, size=log(0.02, 0.45),
          wall=YES, border=YES)  # fmt: skip
def dots(stage: Stage, count, seed, depth, size, wall, border):  # type: ignore[no-untyped-def]
    """objects of a single sample, in the middle or along the border"""
    rng = np.random.default_rng(int(seed))
    for _ in range(int(count)):
        x, y = (float(rng.integers(side)) for side in (stage.width, stage.height))
        if border and rng.random() < 0.7:
            if rng.random() < 0.5:
                x = float(rng.choice([0, stage.width - 1]))
            else:
                y = float(rng.choice([0, stage.height - 1]))
        r = size * rng.uniform(0.5, 1.0, 4)
        sides = (x - r[0], x + r[1]), (y - r[2], y + r[3])
        stage.put("dot", stage.rect(*sides, depth * rng.uniform(0.5, 1.0)))
    if wall:
        whole_view = stage.rect((-1.0, stage.width), (-1.0, stage.height), depth * 1.1)
        stage.put("wall", whole_view)


@register(LAYOUTS, 1.0, count=whole(90, 400), seed=SEED, depth=DEPTH, behind=whole(0, 20))
def hundreds(stage: Stage, count, seed, depth, behind):  # type: ignore[no-untyped-def]
    """hundreds of objects: numbers of a byte, lists with an end"""
    rng = np.random.default_rng(int(seed))
    stage.put("wall", stage.rect((-1.0, stage.width), (-1.0, stage.height), depth))
    for number in range(int(count)):
        x, y = rng.uniform((0.0, 0.0), (stage.width, stage.height))
        r = rng.uniform(0.2, 1.2)
        at = depth * (1.2 if number < behind else 0.9)
        stage.put("dot", stage.rect((x - r, x + r), (y - r, y + r), at))


@register(LAYOUTS, 0.8, count=whole(1, 12), seed=SEED, depth=DEPTH, thick=log(0.02, 0.8))
def slivers(stage: Stage, count, seed, depth, thick):  # type: ignore[no-untyped-def]
    """slivers: triangles that are all but lines"""
    rng = np.random.default_rng(int(seed))
    for _ in range(int(count)):
        a, b = rng.uniform((0.0, 0.0), (stage.width, stage.height), (2, 2))
        across = np.array([a[1] - b[1], b[0] - a[0]])
        c = a + across / max(float(np.linalg.norm(across)), 1e-9) * thick
        stage.put("sliver", stage.triangle([tuple(a), tuple(b), tuple(c)], depth))


@register(LAYOUTS, 1.5, x=PLACE, y=PLACE, size=Gene(6.0, 30.0), sheets=whole(1, 12), depth=DEPTH,
          step=log(0.005, 0.1), corner=whole(0, 3), out=Gene(0.1, 0.5),
          show=log(0.3, 6.0))  # fmt: skip
def stack(stage: Stage, x, y, size, sheets, depth, step, corner, out, show):  # type: ignore[no-untyped-def]
    """sheets that each cover half of a rectangle, the same half, and what shows beside them"""
    left, top = x * stage.width - size / 2, y * stage.height - size / 2
    right, low = left + size, top + size
    corners = [(left, top), (right, top), (right, low), (left, low)]
    k = int(corner)
    three = [corners[k], corners[k - 1], corners[(k + 1) % 4]]
    for sheet in range(int(sheets)):
        stage.put("sheet", stage.triangle(three, depth * (1.0 + step * sheet)))
    free = corners[(k + 2) % 4]
    middle = ((left + right) / 2, (top + low) / 2)
    cx, cy = (f + out * (m - f) for f, m in zip(free, middle, strict=True))
    back = depth * (1.0 + step * (sheets + 1)) * 1.05
    stage.put("beside", stage.rect((cx - show, cx + show), (cy - show, cy + show), back))
    one, other = three[0], middle
    hx, hy = (0.7 * a + 0.3 * b for a, b in zip(one, other, strict=True))
    stage.put("hidden", stage.rect((hx - 1, hx + 1), (hy - 1, hy + 1), back))


@register(LAYOUTS, 1.5, x=PLACE, y=PLACE, w=log(0.03, 1.2), h=log(0.03, 1.2), depth=log(1.5, 170.0),
          before=log(1e-6, 0.1), count=whole(1, 8), lean=log(0.2, 5.0), leans=YES,
          flag=YES)  # fmt: skip
def posters(stage: Stage, x, y, w, h, depth, before, count, lean, leans, flag):  # type: ignore[no-untyped-def]
    """posters just before a wall, by less than a coarse depth tells apart; and just behind it"""
    right = depth * lean if leans else depth
    ends = (-2.0, stage.width + 1.0)
    wall = stage.rect(ends, (-2.0, stage.height + 1.0), depth, right)
    stage.put("wall", stage.flagged(wall, stage.width / 2, stage.height / 2, flag))
    cx, cy = x * stage.width, y * stage.height
    half = w * stage.width / 2, h * stage.height / 2
    for number in range(int(count)):
        at = (cx + number * 7.3) % stage.width
        share = (at - ends[0]) / (ends[1] - ends[0])
        plane = 1.0 / ((1.0 - share) / depth + share / right)
        if not stage.view.is_perspective:
            plane = (1.0 - share) * depth + share * right
        by = before * 3.0**number
        side = (at - half[0], at + half[0]), (cy - half[1], cy + half[1])
        stage.put("poster", stage.rect(*side, plane * max(1.0 - by, 0.3)))
        if number % 2 == 0:
            stage.put("behind the wall", stage.rect(*side, plane * (1.0 + by) * 1.001))


@register(LAYOUTS, 1.5, inset=Gene(0.05, 2.5), depth=DEPTH, back=_BEHIND, sides=whole(1, 15),
          out=log(0.02, 2.0), at=PLACE, long=log(0.02, 0.9), flag=YES)  # fmt: skip
def border(stage: Stage, inset, depth, back, sides, out, at, long, flag):  # type: ignore[no-untyped-def]
    """what shows in the first or last rows and columns, and a little beyond the image"""
    w, h = stage.width - 1.0, stage.height - 1.0
    screen = stage.rect((inset, w - inset), (inset, h - inset), depth)
    stage.put("screen", stage.flagged(screen, w / 2, h / 2, flag))
    along = [(at * size, at * size + long * size) for size in (h, w)]
    deep = depth * back
    places = [
        ((-out, 0.3 + inset), along[0]),
        ((w - 0.3 - inset, w + out), along[0]),
        (along[1], (-out, 0.3 + inset)),
        (along[1], (h - 0.3 - inset, h + out)),
    ]
    for number, (x, y) in enumerate(places):
        if int(sides) >> number & 1:
            stage.put("at the border", stage.rect(x, y, deep))


@register(LAYOUTS, 1.4, which=whole(0, 7), x=PLACE, y=PLACE, w=log(0.02, 1.5), h=log(0.02, 1.5))
def at_the_limits(stage: Stage, which, x, y, w, h):  # type: ignore[no-untyped-def]
    """on the near or the far plane, a little before it, and beyond"""
    near, far = stage.view.near, stage.view.far
    far = far if np.isfinite(far) else 1.0e4
    depths = [near, 0.6 * near, 1.02 * near, far, 1.1 * far, 0.98 * far, 2.0 * far, 0.5 * far]
    cx, cy = x * stage.width, y * stage.height
    half = w * stage.width / 2, h * stage.height / 2
    sides = (cx - half[0], cx + half[0]), (cy - half[1], cy + half[1])
    stage.put("at the limit", stage.rect(*sides, depths[int(which)]))


@register(LAYOUTS, 1.0, x=PLACE, y=PLACE, w=log(0.05, 0.8), h=log(0.05, 0.8), depth=DEPTH,
          dx=Gene(-0.5, 0.5), count=whole(1, 4))  # fmt: skip
def twins(stage: Stage, x, y, w, h, depth, dx, count):  # type: ignore[no-untyped-def]
    """objects at one depth, the same or overlapping: ties"""
    cx, cy = x * stage.width, y * stage.height
    half = w * stage.width / 2, h * stage.height / 2
    down = (cy - half[1], cy + half[1])
    for number in range(int(count) + 1):
        at = cx + dx * (number // 2) * stage.width / 4
        stage.put("twin", stage.rect((at - half[0], at + half[0]), down, depth))
    stage.put("behind", stage.rect((cx - half[0] / 2, cx + half[0] / 2), down, depth * 1.5))


@register(LAYOUTS, 2.0, x=PLACE, y=PLACE, w=log(0.05, 1.2), h=log(0.05, 1.2), depth=DEPTH,
          back=log(1.01, 4.0), wall=YES, flag=YES)  # fmt: skip
def glass(stage: Stage, x, y, w, h, depth, back, wall, flag):  # type: ignore[no-untyped-def]
    """glass, what is behind it, and glass behind a wall"""
    cx, cy = x * stage.width, y * stage.height
    half = w * stage.width / 2, h * stage.height / 2
    sides = (cx - half[0], cx + half[0]), (cy - half[1], cy + half[1])
    pane = stage.flagged(stage.rect(*sides, depth), cx, cy, flag)
    stage.put("glass", pane, alpha=Alpha.BLEND)
    inner = (cx - 0.6 * half[0], cx + 0.3 * half[0]), (cy - 0.6 * half[1], cy + 0.3 * half[1])
    stage.put("behind glass", stage.rect(*inner, depth * back))
    if wall:
        stage.put("wall", stage.rect((cx, cx + 2 * half[0]), (cy, cy + half[1]), depth * 0.98))
        stage.put("glass", stage.rect((cx - 1.0, cx + 1.0), (cy - 1.0, cy + 1.0), depth * back),
                  alpha=Alpha.BLEND)  # fmt: skip


@register(LAYOUTS, 1.5, x=PLACE, y=PLACE, w=log(0.1, 1.2), h=log(0.1, 1.2), depth=DEPTH,
          back=log(1.01, 3.0), columns=whole(1, 6), rows=whole(1, 6), seed=SEED)  # fmt: skip
def card(stage: Stage, x, y, w, h, depth, back, columns, rows, seed):  # type: ignore[no-untyped-def]
    """an alpha mask, and what shows through its holes or is hidden by its leaves"""
    rng = np.random.default_rng(int(seed))
    texels = ((rng.random((int(rows), int(columns))) < 0.5) * np.uint8(255)).astype(np.uint8)
    left, top = x * stage.width - w * stage.width / 2, y * stage.height - h * stage.height / 2
    size = np.array([w * stage.width, h * stage.height])
    mesh = stage.rect((left, left + size[0]), (top, top + size[1]), depth)
    stage.put("card", mesh, alpha=Alpha.MASK, cutout=Cutout(_CORNER_UV, texels))
    for _ in range(int(rng.integers(1, 9))):
        at = rng.integers((0, 0), (int(columns), int(rows))) + 0.5
        cx, cy = np.array([left, top]) + size * at / (columns, rows)
        half = 0.4 * size / (columns, rows)
        sides = (cx - half[0], cx + half[0]), (cy - half[1], cy + half[1])
        stage.put("behind the card", stage.rect(*sides, depth * back * rng.uniform(1.0, 1.3)))


@register(LAYOUTS, 1.6, x=PLACE, y=PLACE, w=log(0.05, 1.0), h=log(0.05, 1.0), depth=DEPTH,
          away=YES, back=_BEHIND)  # fmt: skip
def one_sided(stage: Stage, x, y, w, h, depth, away, back):  # type: ignore[no-untyped-def]
    """a one-sided wall, seen from its front or from behind, and what is behind it"""
    cx, cy = x * stage.width, y * stage.height
    half = w * stage.width / 2, h * stage.height / 2
    sides = (cx - half[0], cx + half[0]), (cy - half[1], cy + half[1])
    points, faces = stage.rect(*sides, depth)
    stage.put("one-sided", (points, faces[:, ::-1] if away else faces), one_sided=True)
    inner = (cx - 0.6 * half[0], cx + 0.6 * half[0]), (cy - 0.6 * half[1], cy + 0.6 * half[1])
    stage.put("behind one side", stage.rect(*inner, depth * back))


@register(LAYOUTS, 1.4, side=YES, depth=DEPTH, long=log(1.1, 4.0), along=Gene(0.3, 1.4),
          turned=YES)  # fmt: skip
def side_wall(stage: Stage, side, depth, long, along, turned):  # type: ignore[no-untyped-def]
    """a one-sided wall almost along the view, at the side of the image"""
    sign = 1.0 if side else -1.0
    half = 0.42 * stage.width * stage.pixel(depth)
    # Along the ray to its near end where `along` is 1, along the axis where it is 0.
    far = half * (1.0 + (long - 1.0) * along)
    z, x = -depth * np.array([1.0, long, long, 1.0]), sign * np.array([half, far, far, half])
    y = half * 0.5 * np.array([-1.0, -1.0, 1.0, 1.0])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    mesh = (np.stack([x, y, z], axis=1), faces[:, ::-1] if turned else faces)
    stage.put("side wall", mesh, one_sided=True)
