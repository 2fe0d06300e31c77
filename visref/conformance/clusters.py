"""Conformance scenes about units finer than objects, and about several objects drawn as one.

A GPU-driven engine decides about clusters of triangles (meshlets), and an instanced draw about many
objects at once. What the other scenes ask of objects is asked of these here.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from visref.conformance.building import (
    Case,
    Mesh,
    SceneMaker,
    box,
    camera,
    case,
    clusters,
    panel,
    pixel_panel,
    register_in,
    together,
)
from visref.scene import Group

CLUSTERS: list[SceneMaker] = []

_scene = register_in(CLUSTERS)


def _sheet(
    columns: int, rows: int, x: tuple[float, float], y: tuple[float, float], z: float
) -> Mesh:
    """An upright sheet of quads that faces +Z; their triangles go column by column."""
    across, up = np.linspace(*x, columns + 1), np.linspace(*y, rows + 1)
    points = np.array([[a, b, z] for a in across for b in up])
    first = (np.arange(columns)[:, None] * (rows + 1) + np.arange(rows)).reshape(-1)
    a, b, c, d = first, first + rows + 1, first + rows + 2, first + 1
    return points, np.stack([a, b, c, a, c, d], axis=1).reshape(-1, 3)


@_scene(
    "each of a wall's two clusters is drawn where it shows",
    "an object that shows somewhere taken for drawn, whichever of its clusters is",
)
def half_of_a_wall_of_two_clusters(rng: np.random.Generator) -> Case:
    """A screen hides one half of the wall, then the other, then leaves a strip of each."""
    seam = float(rng.uniform(-0.4, 0.4))
    left = _sheet(4, 4, (-6.0, seam), (-4.0, 4.0), -10.0)
    right = _sheet(4, 4, (seam, 6.0), (-4.0, 4.0), -10.0)
    objects = [
        ("wall", together(left, right)),
        ("screen", panel((-2.4, 2.4), (-3.0, 3.0), -4.0)),
        ("behind the wall", box((-1.0, -1.0, -13.0), (1.0, 1.0, -12.0))),
    ]
    # From beside the screen it covers the far half of the wall: eye, screen's edge, seam.
    views = [camera((x, 0.0, 0.0), (x / 3.0, 0.0, -10.0), yfov=0.5) for x in (3.4, -3.4)]
    views.append(camera((0.0, 0.0, 3.0)))
    built = case(objects, views)
    half = len(left[1])
    parts = [range(half), range(half, 2 * half), range(2 * half, 2 * half + 2)]
    parts.append(range(2 * half + 2, built.scene.triangle_count))
    return replace(built, units=clusters(built.scene, parts))


@_scene(
    "of a shell with a hole, the clusters whose backs show through it are drawn",
    "clusters culled by a cone of normals though both sides show, or by their centres",
)
def shell_of_clusters(rng: np.random.Generator) -> Case:
    """Rings of a ball, in clusters of a few quads, the cap at its front missing; a bar before it,
    and a stone inside it."""
    rings, around = 10, 16
    points = []
    for ring in range(rings + 1):
        polar = math.pi * (0.18 + 0.82 * ring / rings)
        radius = 2.0 + 0.05 * float(rng.uniform(-1.0, 1.0))
        for step in range(around):
            turn = 2.0 * math.pi * step / around
            aside = radius * math.sin(polar)
            points.append(
                (aside * math.cos(turn), aside * math.sin(turn), radius * math.cos(polar) - 7.0)
            )
    faces = []
    for ring in range(rings):
        for step in range(around):
            a, b = ring * around + step, ring * around + (step + 1) % around
            faces += [(a, a + around, b + around), (a, b + around, b)]
    objects: list[tuple[str, Mesh]] = [
        ("shell", (np.array(points), np.array(faces))),
        ("stone", box((-0.3, -0.3, -7.6), (0.3, 0.3, -7.0))),
        ("bar", panel((-3.0, -0.2), (-0.6, 0.6), -4.0)),
    ]
    views = [camera(), camera((3.0, 1.0, 0.5), (0.0, 0.0, -7.0)), camera((0.0, 0.3, -6.0))]
    built = case(objects, views)
    starts = [*range(0, len(faces), 8), len(faces), len(faces) + 12]
    ends = [*starts[1:], built.scene.triangle_count]
    parts = [range(a, b) for a, b in zip(starts, ends, strict=True)]
    return replace(built, units=clusters(built.scene, parts))


@_scene(
    "what one of two overlapping clusters shows is drawn",
    "a triangle of several clusters counted to the first of them alone",
)
def overlapping_clusters(rng: np.random.Generator) -> Case:
    """A sheet in clusters of three columns that overlap by one, behind a fence of posts."""
    columns, rows = 12, 3
    objects = [("sheet", _sheet(columns, rows, (-6.0, 6.0), (-3.0, 3.0), -9.0))]
    for number in range(5):
        x = -5.0 + 2.5 * number + float(rng.uniform(-0.3, 0.3))
        objects.append(("post", panel((x - 0.5, x + 0.5), (-4.0, 4.0), -6.0)))
    objects.append(("hidden", box((-1.0, -1.0, -13.0), (1.0, 1.0, -11.0))))
    built = case(objects, [camera(), camera((1.5, 0.2, 1.0))])
    of_column = 2 * rows
    parts: list[range] = [
        range(of_column * first, of_column * min(first + 3, columns))
        for first in range(0, columns - 1, 2)
    ]
    end = of_column * columns
    parts += [range(end + 2 * number, end + 2 * number + 2) for number in range(5)]
    parts.append(range(end + 10, built.scene.triangle_count))
    return replace(built, units=clusters(built.scene, parts))


@_scene(
    "an instanced draw of which a single instance shows is drawn",
    "instances culled by the box of the first, or of the mesh where it was modelled",
)
def instances_of_one_draw(rng: np.random.Generator) -> Case:
    """Posts in two groups behind a wall with a gap; each is an object, a group what an engine may
    draw them by."""
    view = camera()
    post = box((-0.25, -1.5, -0.25), (0.25, 1.5, 0.25))
    objects: list[tuple[str, Mesh]] = [
        ("wall", pixel_panel(view, (-0.5, 43.5), (-0.5, 47.5), 5.0)),
        ("wall", pixel_panel(view, (47.5, 63.5), (-0.5, 47.5), 5.0)),
    ]
    groups = []
    # Of the first group one stands in the gap, of the second none; whole quarters are exact.
    for name, places in (
        ("posts", [*range(-8, 0, 2), 5]),
        ("more posts", [*range(-7, 1, 2)]),
    ):
        first = len(objects)
        for x in places:
            y = float(rng.integers(-4, 5)) / 4.0
            where = np.array([0.75 * x, y, -12.0])
            objects.append((name, (post[0] + where, post[1])))
        groups.append(Group(name, name, tuple(range(first, len(objects)))))
    built = case(objects, [view, camera((0.0, 0.5, 0.25))])
    return replace(built, scene=replace(built.scene, groups=tuple(groups)))
