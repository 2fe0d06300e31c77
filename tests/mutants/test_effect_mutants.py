"""Every broken effect is convicted by the image protocol on a scene that the sound one passes."""

from __future__ import annotations

import inspect

import pytest

from tests.mutants import bad_effects
from tests.support.effect_scenes import (
    eye_in_shadow,
    flat,
    particle_verdict,
    pedestals,
    shadow_verdict,
    snowfall,
)
from visref_culling.n_buffer.particles import Particles
from visref_culling.shadow_volumes import ShadowVolumes

pytestmark = pytest.mark.gl

# Classes that mutants are made of.
BASES = {"EditedParticles", "EditedCasters", "OtherDepthTest"}

STAGES = {
    "pedestals": lambda: pedestals(2),
    "coarse": lambda: pedestals(2, lexels=5),
    "flat": flat,
    "eye_in_shadow": eye_in_shadow,
}
# Where it is not the pedestals.
STAGE_OF = {
    "NoFootprint": "flat",
    "LastRowLeftOut": "coarse",
    "CountedInFront": "eye_in_shadow",
}


def mutants_of(method):
    return [
        pytest.param(made, id=name)
        for name, made in vars(bad_effects).items()
        if inspect.isclass(made)
        and issubclass(made, method)
        and made is not method
        and name not in BASES
    ]


@pytest.mark.parametrize("stage", STAGES)
def test_sound_volumes_pass_where_mutants_fail(stage):
    assert shadow_verdict(STAGES[stage]()).status == "no_violation_found"


@pytest.mark.parametrize("mutant", mutants_of(ShadowVolumes))
def test_broken_shadow_volumes_are_convicted(mutant):
    made = STAGES[STAGE_OF.get(mutant.__name__, "pedestals")]()
    verdict = shadow_verdict(made, mutant)
    assert verdict.status == "violation"
    assert verdict.lost + verdict.extra > 0


def test_sound_particles_pass_where_mutants_fail():
    assert particle_verdict(*snowfall(1)).status == "no_violation_found"


@pytest.mark.parametrize("mutant", mutants_of(Particles))
def test_broken_particles_are_convicted(mutant):
    verdict = particle_verdict(*snowfall(1), mutant)
    assert verdict.status == "violation"
    assert verdict.lost > 0
