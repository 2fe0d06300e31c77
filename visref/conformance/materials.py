"""Conformance scenes built around materials: glass, alpha masks, sides."""

from __future__ import annotations

import numpy as np

from visref.conformance.building import (
    Case,
    SceneMaker,
    box,
    camera,
    case,
    panel,
    register_in,
)
from visref.scene import Alpha

MATERIALS: list[SceneMaker] = []

_scene = register_in(MATERIALS)


@_scene("what lies behind glass is drawn, and the glass too", "transparent occluder")
def glass(rng: np.random.Generator) -> Case:
    objects = [
        ("window", panel((-2.0, 2.0), (-1.5, 1.5), -4.0)),
        ("wall", panel((2.0, 6.0), (-3.0, 3.0), -4.5)),
        ("hidden", box((3.0, -1.0, -8.0), (4.0, 1.0, -7.0))),
        ("glass behind the wall", panel((2.6, 4.0), (-1.0, 1.0), -6.0)),
        ("mesh fence", panel((-6.0, -2.4), (-3.0, 0.0), -4.2)),
    ]
    for _ in range(6):
        centre = rng.uniform((-2.0, -1.0, -12.0), (1.0, 1.0, -6.0))
        objects.append(("vase", box(centre - 0.4, centre + 0.4)))
    materials = {
        "window": Alpha.BLEND,
        "glass behind the wall": Alpha.BLEND,
        "mesh fence": Alpha.MASK,
    }
    return case(objects, [camera(), camera((1.0, 0.4, 1.0))], alpha=materials)


@_scene("a one-sided wall seen from behind hides nothing", "back faces as occluders")
def one_sided_walls(rng: np.random.Generator) -> Case:
    corners, faces = panel((-3.0, 3.0), (-2.0, 2.0), -5.0)
    objects = [
        ("away", (corners, faces[:, ::-1])),
        ("facing", panel((3.0, 8.0), (-3.0, 3.0), -6.0)),
        ("shell", box((-1.0, -1.0, -12.0), (1.0, 1.0, -9.0))),
        ("in the shell", box((-0.3, -0.3, -11.0), (0.3, 0.3, -10.0))),
        ("seen", box((-3.0, -1.0, -9.0), (-1.5, 1.0, -8.0))),
        ("hidden", box((4.0, -1.0, -9.0), (5.0, 1.0, -8.0))),
    ]
    views = [
        camera(),
        camera((0.0, 0.0, -20.0), (0.0, 0.0, 0.0)),
        camera((0.0, 0.6, -9.5), (0.0, 0.3, -14.0)),
    ]
    views.append(camera((0.0, 0.6, -11.4), (0.0, 0.0, 0.0)))
    return case(objects, views, one_sided=("away", "facing", "shell"))
