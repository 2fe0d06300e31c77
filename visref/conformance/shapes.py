"""Conformance scenes built around what an object is: a sample, a sliver, nothing at all."""

from __future__ import annotations

import numpy as np

from visref.conformance.building import (
    Case,
    Mesh,
    SceneMaker,
    box,
    camera,
    case,
    panel,
    pixel_panel,
    pixel_point,
    register_in,
    together,
)

SHAPES: list[SceneMaker] = []

_scene = register_in(SHAPES)


@_scene("an object of a single sample is drawn", "threshold above one sample, small objects cut")
def objects_of_one_sample(rng: np.random.Generator) -> Case:
    view = camera()
    wall = pixel_panel(view, (-1.0, 40.2), (-1.0, 48.0), 20.0)
    flag = pixel_panel(view, (0.6, 0.8), (0.6, 0.8), 1.0)
    objects = [("wall", together(wall, flag))]
    for _ in range(40):
        x, y = float(rng.integers(2, 62)), float(rng.integers(2, 46))
        r = rng.uniform(0.1, 0.4)
        depth = float(rng.choice([6.0, 12.0, 30.0]))
        objects.append(("dot", pixel_panel(view, (x - r, x + r), (y - r, y + r), depth)))
    return case(objects, [view])


@_scene("slivers are drawn where they own a sample", "thin objects dropped")
def slivers(rng: np.random.Generator) -> Case:
    view = camera()
    objects = [
        ("shield", panel((-2.0, 0.5), (-1.5, 0.8), -6.0)),
        ("backdrop", panel((-30.0, 30.0), (-20.0, 20.0), -30.0)),
    ]
    for _ in range(30):
        a, b = rng.uniform((2.0, 2.0), (62.0, 46.0), (2, 2))
        across = np.array([a[1] - b[1], b[0] - a[0]])
        c = a + across / np.linalg.norm(across) * rng.uniform(0.02, 0.3)
        depth = rng.choice([4.0, 10.0, 20.0])
        points = np.array([pixel_point(view, p[0], p[1], depth) for p in (a, b, c)])
        objects.append(("sliver", (points, np.array([[0, 1, 2]]))))
    return case(objects, [view, camera((0.5, 0.3, 2.0))])


@_scene("a scene without objects draws nothing and breaks nothing", "division by no objects")
def empty_scene(rng: np.random.Generator) -> Case:
    return case([], [camera(), camera((1.0, 0.0, 0.0))])


@_scene("objects without area or triangles harm nobody", "infinite or inverted boxes")
def objects_without_triangles(rng: np.random.Generator) -> Case:
    nothing: Mesh = (np.zeros((0, 3)), np.zeros((0, 3), np.int64))
    point: Mesh = (np.full((3, 3), -5.0), np.array([[0, 1, 2]]))
    objects = [
        ("nothing", nothing),
        ("seen", box((-1.0, -1.0, -6.0), (1.0, 1.0, -4.0))),
        ("point", point),
        ("edge-on", (np.array([[0.0, 0.0, -3.0], [0, 0, -4], [0, 1, -4]]), np.array([[0, 1, 2]]))),
        ("nothing", nothing),
        ("one triangle", (np.array([[2.0, 0, -5], [3, 0, -5], [2, 1, -5]]), np.array([[0, 1, 2]]))),
    ]
    return case(objects, [camera()])
