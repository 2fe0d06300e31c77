"""The small scenes that convict broken cPLPs."""

from __future__ import annotations

from typing import Any

import numpy as np

from tests.mutants.plp.contract import SUITE
from tests.support.culling_scenes import box as solid
from visref.conformance.scenes import Case, camera, case


def boxes_beyond(rng: np.random.Generator, count: int = 60) -> list[tuple[str, Any]]:
    made = []
    for k in range(count):
        centre = rng.uniform((-6, -5, -22), (6, 5, -8))
        made.append((f"box{k}", solid(tuple(centre), rng.uniform(0.1, 0.5))))
    return made


@SUITE.scene("draws boxes that lie far before an eye outside all cells")
def seen_from_outside(rng: np.random.Generator) -> Case:
    views = [
        camera(eye=(0.0, 0.0, 8.0), target=(0.0, 0.0, -15.0), width=100, height=70),
        camera(eye=(30.0, 20.0, 0.0), target=(0.0, 0.0, -15.0), width=100, height=70),
    ]
    return case(boxes_beyond(rng), views)


@SUITE.scene("draws what stands in the last rows and columns, frame after frame")
def border_of_a_large_image(rng: np.random.Generator) -> Case:
    def crowd(x: tuple[float, float], y: tuple[float, float], name: str) -> list[tuple[str, Any]]:
        return [
            (f"{name}{k}", solid((rng.uniform(*x), rng.uniform(*y), rng.uniform(-12, -8)), 0.12))
            for k in range(14)
        ]

    straight = camera(width=100, height=70, yfov=1.0)
    aside = camera(target=(6.0, 0.0, -8.0), width=100, height=70, yfov=1.0)
    objects = [*crowd((5.0, 7.0), (-4, 4), "right"), *crowd((-5, 5), (3.2, 4.6), "top")]
    return case(objects, [straight, aside, straight])
