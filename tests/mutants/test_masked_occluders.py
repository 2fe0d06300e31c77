"""G13 on masks whose textures are known: every method that takes a leaf for a wall is convicted."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from tests.mutants.harness import Mutant, suites
from visref.conformance.building import box, camera, case, panel
from visref.culler import Culler
from visref.engines.exact import ExactEngine
from visref.judging.referee import Referee
from visref.masks.materials import MaskMaterial, Sampler
from visref.masks.store import Masks
from visref.masks.textures import AlphaImage
from visref.scene import Alpha

pytestmark = [pytest.mark.gl, pytest.mark.slow]

MUTANTS = [m for suite in suites().values() for m in suite.mutants if m.id == "G13"]


@cache
def behind_a_fence():
    """A card across the image with a large hole in the middle, and behind it what a step aside
    reveals: a row of boxes, most of them seen through the hole."""
    objects = [("fence", panel((-30.0, 30.0), (-9.0, 9.0), -4.0))]
    objects += [
        (f"box at {x}", box((x - 0.4, -0.4, -9.0), (x + 0.4, 0.4, -8.2)))
        for x in np.arange(-6.0, 6.1, 1.5)
    ]
    views = [camera((5.0, 0.0, 0.0), (5.0, 0.0, -9.0)), camera((0.0, 0.0, 0.0), (0.0, 0.0, -9.0))]
    built = case(objects, views * 2, alpha={"fence": Alpha.MASK})
    row = np.full(built.scene.triangle_count, -1)
    row[:2] = [0, 1]
    texels = np.full((8, 8), 255, np.uint8)
    texels[1:7, 1:7] = 0
    masks = Masks.build(
        row,
        np.zeros(2),
        np.array([[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]])[objects[0][1][1]],
        np.ones((2, 3)),
        [MaskMaterial(0, Sampler(nearest=True))],
        [AlphaImage(texels, 255)],
    )
    return replace(built.scene, masks=masks), built.path


def violations(culler: Culler) -> tuple[int, int]:
    scene, path = behind_a_fence()
    referee = Referee(scene, lambda: ExactEngine(scene))
    totals = referee.run(path, range(len(path)), [("culler", culler)]).cullers[0].totals
    return totals.violations, totals.missed_pixels


@pytest.mark.parametrize("mutant", MUTANTS, ids=str)
def test_a_method_that_takes_a_mask_for_a_wall_is_convicted(mutant: Mutant):
    found, lost = violations(mutant.make())
    assert found > 0
    assert lost > 0


@pytest.mark.parametrize(
    "method", list({str(m.method): m.method for m in MUTANTS}.values()), ids=str
)
def test_the_sound_method_sees_through_the_holes(method):
    assert violations(method.make()) == (0, 0)
