"""Solids as CAD systems tessellate them: rounded boxes, shells, sweeps, gears, screws, springs.

Every function returns a closed `Soup` that faces outward. `fine` multiplies how many chords a
curve has, as a finer chord tolerance does; what is flat stays as it is.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from visref_datasets_gen.shapes import Float64, Soup, box, fans, loft, merge, moved, ring


def chords(count: float, fine: float, least: int = 5) -> int:
    """How many chords a curve of `count` at fineness 1 has."""
    return max(least, round(count * fine))


def outward(soup: Soup) -> Soup:
    """A closed soup with its faces turned outward, by the sign of its volume."""
    vertices, faces = soup
    a, b, c = vertices[faces].transpose(1, 0, 2)
    volume = float((np.cross(a, b) * c).sum())
    return soup if volume > 0.0 else (vertices, faces[:, ::-1])


def looped(rings: Any) -> Soup:
    """A solid like a torus: (s, k, 3) closed rings, the last joined to the first."""
    rings = np.asarray(rings, np.float64)
    return outward(loft(np.concatenate([rings, rings[:1]]), caps=""))


def sections(rings: Any) -> Soup:
    """A solid through (s, k, 3) closed, convex and planar rings, flat at both ends."""
    return outward(loft(rings))


def thick(outer: Any, inner: Any) -> Soup:
    """The solid between two (m, n, 3) sheets, closed along their four rims."""
    outer, inner = (np.asarray(sheet, np.float64) for sheet in (outer, inner))
    ends = [
        np.stack([outer[row, :-1], outer[row, 1:], inner[row, 1:], inner[row, :-1]], axis=1)
        for row in (0, -1)
    ]
    around = loft(np.concatenate([outer, inner[:, ::-1]], axis=1), caps="")
    return outward(merge([around, fans(ends[0][:, ::-1]), fans(ends[1])]))


def revolved(profile: Any, sides: int) -> Soup:
    """A solid of revolution about y, from (s, 2) pairs of radius and height, flat at its ends."""
    return sections(_around(profile, sides))


def annulus(profile: Any, sides: int) -> Soup:
    """A ring about y whose section is the closed (s, 2) profile of radius and height."""
    return looped(_around(profile, sides))


def _around(profile: Any, sides: int) -> Float64:
    circle = ring(1.0, sides)
    radius, height = np.asarray(profile, np.float64).T[:, :, None]
    x, z = radius * circle[:, 0], -radius * circle[:, 1]
    return np.stack([x, np.broadcast_to(height, x.shape), z], axis=2)


def torus(radius: float, wire: float, fine: float) -> Soup:
    """A torus about y."""
    section = np.add(ring(wire, chords(14, fine)), (radius, 0.0))
    return annulus(section, chords(56, fine, 8))


def rod(radius: float, length: float, fine: float, sides: float = 24) -> Soup:
    """A cylinder on y = 0, its edges bevelled."""
    bevel = min(0.25 * radius, 0.2 * length)
    profile = [(radius - bevel, 0.0), (radius, bevel), (radius, length - bevel),
               (radius - bevel, length)]  # fmt: skip
    return revolved(profile, chords(sides, fine))


def rounded_rectangle(half_x: float, half_z: float, radius: float, corner: int) -> Float64:
    """(4 * corner, 2) points, counter-clockwise, `corner` to each quarter circle."""
    angle = (np.arange(4)[:, None] + np.linspace(0.0, 1.0, corner)) * math.pi / 2
    centre = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * [half_x - radius, half_z - radius]
    arcs = radius * np.stack([np.cos(angle), np.sin(angle)], axis=2)
    return np.asarray((centre[:, None] + arcs).reshape(-1, 2))


# Where a fillet ends in the flat face, radians short of it: its last corner keeps a radius.
_FILLET_END = 0.25


def rounded_box(low: Any, high: Any, radius: float, fine: float) -> Soup:
    """A box whose edges are all rounded."""
    low, high = np.asarray(low, np.float64), np.asarray(high, np.float64)
    angle = np.linspace(_FILLET_END, math.pi / 2, chords(5, fine, 2))
    inset, rise = radius * (1.0 - np.sin(angle)), radius * (1.0 - np.cos(angle))
    return sections(
        _upright(
            low,
            high,
            np.concatenate([inset, inset[::-1]]),
            np.concatenate([low[1] + rise, high[1] - rise[::-1]]),
            radius,
            fine,
        )
    )


def open_box(low: Any, high: Any, wall: float, radius: float, fine: float) -> Soup:
    """A box without a lid on its upper side, its walls `wall` thick, its upright and lower
    edges rounded."""
    low, high = np.asarray(low, np.float64), np.asarray(high, np.float64)
    angle = np.linspace(_FILLET_END, math.pi / 2, chords(6, fine, 2))
    inset, rise = radius * (1.0 - np.sin(angle)), radius * (1.0 - np.cos(angle))
    outside = _upright(
        low, high, np.append(inset, 0.0), np.append(low[1] + rise, high[1]), radius, fine
    )
    shrink = np.array([wall, 0.0, wall])
    inside = _upright(
        low + shrink,
        high - shrink,
        np.append(inset, 0.0),
        np.append(low[1] + wall + rise, high[1]),
        radius,
        fine,
    )
    return sections(np.concatenate([outside, inside[::-1]]))


def _upright(
    low: Float64, high: Float64, inset: Float64, height: Float64, radius: float, fine: float
) -> Float64:
    """(s, k, 3) rounded rectangles across y, each pulled in by `inset` at its height."""
    corner = chords(5, fine, 2)
    half, middle = (high - low) / 2.0, (high + low) / 2.0
    rings = []
    for pull, y in zip(inset.tolist(), height.tolist(), strict=True):
        # No less than a sliver of the radius, so that corners keep their points apart.
        round_ = max(radius - pull, 0.2 * radius)
        flat = rounded_rectangle(half[0] - pull, half[2] - pull, round_, corner)
        rings.append(np.stack([flat[:, 0] + middle[0], np.full(len(flat), y),
                               middle[2] - flat[:, 1]], axis=1))  # fmt: skip
    return np.array(rings)


def framed(outer: Any, hole: Any, low: float, high: float) -> Soup:
    """A plate across y from `low` to `high` with a hole: (k, 2) outlines in x and z, point
    for point across from each other."""
    rings = [
        np.stack([line[:, 0], np.full(len(line), y), -line[:, 1]], axis=1)
        for line, y in ((outer, low), (outer, high), (hole, high), (hole, low))
    ]
    return looped(rings)


def square_to_circle(
    half_x: float, half_z: float, radius: float, fine: float
) -> tuple[Float64, Float64]:
    """The outlines of a rectangular plate with a round hole, for `framed`: (k, 2) float64
    each, points on the same rays, the rectangle's corners among them."""
    angles = 2.0 * math.pi * np.arange(4 * chords(16, fine, 3)) / (4 * chords(16, fine, 3))
    corner = math.atan2(half_z, half_x)
    for exact in (corner, math.pi - corner, math.pi + corner, 2.0 * math.pi - corner):
        angles[np.abs(angles - exact).argmin()] = exact
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    reach = np.minimum(
        half_x / np.maximum(np.abs(circle[:, 0]), 1e-9),
        half_z / np.maximum(np.abs(circle[:, 1]), 1e-9),
    )
    return circle * reach[:, None], radius * circle


def swept(path: Any, section: Any) -> Soup:
    """A section, (k, 2) counter-clockwise points or a circle's radius and chords, along a
    (s, 3) path, turned no more than the path turns; flat at both ends."""
    return sections(_along(np.asarray(path, np.float64), np.asarray(section, np.float64)))


def _along(path: Float64, section: Float64) -> Float64:
    forward = np.gradient(path, axis=0)
    forward /= np.linalg.norm(forward, axis=1)[:, None]
    side = np.cross(forward[0], np.eye(3)[np.argmin(np.abs(forward[0]))])
    rings = []
    for at, way in zip(path, forward, strict=True):
        side = side - (side @ way) * way
        side /= np.linalg.norm(side)
        rings.append(at + section[:, :1] * side + section[:, 1:] * np.cross(way, side))
    return np.array(rings)


def curve(corners: Any, count: int) -> Float64:
    """(count, 3) points of a Catmull-Rom spline through the corners, its first and last too."""
    points = np.asarray(corners, np.float64)
    points = np.concatenate([2 * points[:1] - points[1:2], points, 2 * points[-1:] - points[-2:-1]])
    t = np.linspace(0.0, len(points) - 3, count)
    at = np.minimum(t.astype(np.int64), len(points) - 4)
    t = (t - at)[:, None]
    p0, p1, p2, p3 = (points[at + k] for k in range(4))
    return np.asarray(
        0.5 * (2 * p1 + (p2 - p0) * t + (2 * p0 - 5 * p1 + 4 * p2 - p3) * t**2
               + (3 * p1 - p0 - 3 * p2 + p3) * t**3)
    )  # fmt: skip


def tube(corners: Any, radius: float, fine: float, *, bends: float = 24, sides: float = 12) -> Soup:
    """A round bar along a spline through the corners."""
    path = curve(corners, chords(bends, fine, 3))
    return swept(path, ring(radius, chords(sides, fine)))


def spring(radius: float, wire: float, length: float, turns: float, fine: float) -> Soup:
    """A helical spring about y, on y = 0."""
    t = np.linspace(0.0, 1.0, chords(16 * turns, fine, 12))
    angle = 2.0 * math.pi * turns * t
    path = np.stack([radius * np.cos(angle), wire + (length - 2 * wire) * t,
                     radius * np.sin(angle)], axis=1)  # fmt: skip
    return swept(path, ring(wire, chords(8, fine, 4)))


def screw(radius: float, length: float, fine: float) -> Soup:
    """A pan-headed screw whose shank points to -y and whose head rests on y = 0, with a round
    recess and a threaded shank (its grooves are rings)."""
    head, tall = 1.9 * radius, 1.2 * radius
    grooves = chords(9, fine, 3)
    thread = np.linspace(-length, -0.05 * length, 2 * grooves)
    shank = [(radius * (0.78 if k % 2 else 1.0), y) for k, y in enumerate(thread.tolist())]
    dome = np.linspace(0.0, 0.42 * math.pi, chords(5, fine, 2))
    cap = [(head * math.cos(a), tall * (0.35 + 0.65 * math.sin(a))) for a in dome.tolist()]
    recess = [(0.3 * head, tall * 0.98), (0.22 * head, 0.4 * tall)]
    profile = [(0.3 * radius, -length - radius), *shank, (radius, 0.0), (head, 0.0), *cap, *recess]
    return revolved(profile, chords(22, fine, 6))


def nut(radius: float, height: float, fine: float) -> Soup:
    """A hexagonal nut about y on y = 0, its corners bevelled, its thread in rings."""
    sides = 6 * chords(4, fine, 1)
    angle = 2.0 * math.pi * np.arange(sides) / sides
    flat = math.cos(math.pi / 6) / np.cos((angle + math.pi / 6) % (math.pi / 3) - math.pi / 6)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    grooves = chords(6, fine, 2)
    bore = [(0.5 - 0.05 * (k % 2), y) for k, y in enumerate(np.linspace(1, 0, 2 * grooves))]
    rings = []
    for share, y, hexagon in [(0.9, 0.0, 1), (1.0, 0.12, 1), (1.0, 0.88, 1), (0.9, 1.0, 1),
                              *((r, y, 0) for r, y in bore)]:  # fmt: skip
        line = radius * share * (circle * flat[:, None] if hexagon else circle)
        rings.append(np.stack([line[:, 0], np.full(sides, y * height), -line[:, 1]], axis=1))
    return looped(rings)


def gear(radius: float, teeth: int, height: float, bore: float, fine: float) -> Soup:
    """A spur gear about y on y = 0."""
    a_tooth = 2 * chords(4, fine, 2)
    phase = np.arange(teeth * a_tooth) / a_tooth % 1.0
    depth = 2.2 * radius / teeth
    rise = np.clip(2.5 * np.sin(2.0 * math.pi * phase), -1.0, 1.0)
    circle = ring(1.0, teeth * a_tooth)
    return framed((radius + depth * rise)[:, None] * circle, bore * circle, 0.0, height)


def finned(low: Any, high: Any, fins: int, base: float, share: float = 0.4) -> Soup:
    """A heat sink: `fins` plates across x on a base of a height, as closed boxes."""
    low, high = np.asarray(low, np.float64), np.asarray(high, np.float64)
    pitch = (high[0] - low[0]) / fins
    plates = [
        box([low[0] + k * pitch, low[1] + base / 2, low[2]],
            [low[0] + (k + share) * pitch, high[1], high[2]])
        for k in range(fins)
    ]  # fmt: skip
    return merge([box(low, [high[0], low[1] + base, high[2]]), *plates])


def perforated(radius: float, pitch: float, thick_: float, fine: float) -> Soup:
    """A round sheet across y with a round hole in every square of a grid."""
    count = math.ceil(radius / pitch)
    at = (np.arange(-count, count) + 0.5) * pitch
    x, z = (grid.ravel() for grid in np.meshgrid(at, at))
    kept = np.hypot(x, z) < radius - 0.72 * pitch
    cells = np.stack([x[kept], z[kept]], axis=1)
    # Corners of the squares are among the points.
    sides = 8 * chords(1, fine, 1)
    angle = 2.0 * math.pi * np.arange(sides) / sides
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    # Squares meet point for point: their outline has the circle's points, on the square.
    square = circle / np.abs(circle).max(axis=1)[:, None]
    outlines = {name: cells[:, None] + line for name, line in (
        ("square", 0.5 * pitch * square), ("hole", 0.34 * pitch * circle))}  # fmt: skip
    rings = []
    for name, y in (("square", 0.0), ("square", thick_), ("hole", thick_), ("hole", 0.0)):
        line = outlines[name]
        rings.append(np.stack([line[..., 0], np.full(line.shape[:2], y), -line[..., 1]], axis=2))
    grid = np.stack(rings, axis=1)  # cell, ring, point
    here = np.arange(sides)
    after = (here + 1) % sides
    keys = {(int(i), int(j)) for i, j in np.round(cells / pitch - 0.5).astype(int)}
    parts = []
    for row in range(4):
        near, far = grid[:, row], grid[:, (row + 1) % 4]
        quad = np.stack([near[:, here], near[:, after], far[:, after], far[:, here]], axis=2)
        if row == 0:
            # Between two squares there is no wall.
            middle = (square[here] + square[after]) / 2.0
            step = np.where(np.abs(middle) > 0.999, np.sign(middle), 0.0).astype(int)
            places = np.round(cells / pitch - 0.5).astype(int)
            wall = np.array([[(i + di, j + dj) not in keys for di, dj in step.tolist()]
                             for i, j in places.tolist()])  # fmt: skip
            quad = quad[wall]
        parts.append(quad.reshape(-1, 4, 3))
    return outward(fans(np.concatenate(parts)))


def cylinder_x(radius: float, low: float, high: float, fine: float, sides: float = 32) -> Soup:
    """A bevelled cylinder about x."""
    vertices, faces = moved(rod(radius, high - low, fine, sides), (0.0, low, 0.0))
    return vertices[:, [1, 2, 0]], faces


def knurled(radius: float, height: float, ridges: int, fine: float) -> Soup:
    """A knob about y on y = 0, ridged along its sides, rounded at its upper edge."""
    a_ridge = chords(6, fine, 3)
    angle = 2.0 * math.pi * np.arange(ridges * a_ridge) / (ridges * a_ridge)
    ridge = 1.0 + 0.03 * np.sin(ridges * angle)
    circle = np.stack([np.cos(angle), -np.sin(angle)], axis=1)
    rings = []
    for share, y, rough in ((0.98, 0.0, 0), (1.0, 0.05, 1), (1.0, 0.85, 1), (0.97, 0.94, 0),
                            (0.9, 1.0, 0)):  # fmt: skip
        line = radius * share * (circle * ridge[:, None] if rough else circle)
        rings.append(np.stack([line[:, 0], np.full(len(line), y * height), line[:, 1]], axis=1))
    return sections(rings)
