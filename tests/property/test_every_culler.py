"""No installed culler, with any option, misses a visible object: not on the conformance
suite's scenes, not on scenes that hypothesis finds."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, find, given, settings
from hypothesis import strategies as st

from tests.mutants.harness import mutant_named
from tests.support import strategies
from tests.support.shares import examples, share
from visref.camera import Camera, look_at
from visref.camera_path import CameraPath
from visref.conformance import assert_conforms, conformance_checks, exact_truths, judge_on
from visref.conformance.scenes import Case
from visref.culler import Culler, Option
from visref.engines.embree import EmbreeEngine
from visref.errors import InputError
from visref.formats import load_scene
from visref.judging.referee import Referee
from visref.registry import CULLERS, available
from visref.scene import Scene
from visref_datasets_gen.angio import angio
from visref_datasets_gen.city import city
from visref_datasets_gen.dataset import scene_of

pytestmark = [pytest.mark.gl, pytest.mark.slow]


REAL_MODEL = Path("/usr/share/assimp/models/glTF2/2CylinderEngine-glTF-Binary/2CylinderEngine.glb")

CLASSES: dict[str, type[Culler]] = {
    name: point.load() for name, point in available(CULLERS).items()
}


@dataclass(frozen=True)
class Variant:
    """A culler with some of its options away from their defaults."""

    name: str
    chosen: tuple[tuple[str, object], ...] = ()

    def make(self) -> Culler:
        return CLASSES[self.name](**dict(self.chosen))

    def accepted(self) -> bool:
        """Whether the culler takes these options together; it must say so if it does not."""
        try:
            self.make().close()
        except InputError:
            return False
        return True

    def __str__(self) -> str:
        return f"{self.name}:{','.join(f'{k}={v}' for k, v in self.chosen)}".rstrip(":")


def values(option: Option) -> tuple:
    """All that an option may be, where that is a short list; else its default."""
    if isinstance(option.default, bool):
        return (False, True)
    return option.choices or (option.default,)


def one_at_a_time() -> list[Variant]:
    """Each culler as it comes, and with each option away from its default."""
    found = []
    for name, culler in CLASSES.items():
        found.append(Variant(name))
        for key, option in culler.options.items():
            others = [value for value in values(option) if value != option.default]
            found += [Variant(name, ((key, value),)) for value in others]
    return [variant for variant in found if variant.accepted()]


def all_combinations(name: str) -> list[Variant]:
    options = CLASSES[name].options
    choices = itertools.product(*map(values, options.values()))
    return [Variant(name, tuple(zip(options, chosen, strict=True))) for chosen in choices]


COMBINATIONS = [all_combinations(name) for name in CLASSES]

# One seed for the same examples everywhere; GL is slow to start, and drawing is no fault.
QUIET = settings(derandomize=True, deadline=None, suppress_health_check=list(HealthCheck))


VARIANTS = one_at_a_time()


@pytest.mark.parametrize("at", range(len(VARIANTS)), ids=list(map(str, VARIANTS)))
def test_culler_conforms_with_each_option(at):
    """As it comes to the whole catalogue, with an option away from its default to a share."""
    variant, checks = VARIANTS[at], conformance_checks()
    assert_conforms(variant.make, checks=share(checks, at) if variant.chosen else checks)


@settings(
    max_examples=examples(60),
    derandomize=True,
    deadline=None,
    suppress_health_check=list(HealthCheck),
)
@given(
    built=strategies.cases(),
    variants=st.tuples(*map(st.sampled_from, COMBINATIONS)),
)
def test_no_culler_misses_what_hypothesis_puts_in_view(built, variants):
    truths = exact_truths(built)
    for variant in filter(Variant.accepted, variants):
        problems, _ = judge_on(variant.make, built, truths)
        assert problems == (), str(variant)


def orbit(scene: Scene) -> CameraPath:
    """Around a scene, from outside and from within."""
    low, high = scene.core_bounds
    middle, reach = 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))
    aside = np.array([(1.0, 0.4, 1.2), (-1.1, 0.2, 0.3), (0.1, -1.0, 0.2), (0.05, 0.02, 0.1)])
    return CameraPath(
        tuple(
            Camera(look_at(middle + reach * way, middle), 160, 120, 0.01 * reach, yfov=1.0)
            for way in aside
        )
    )


def larger(name: str) -> tuple[Scene, CameraPath]:
    """A generated scene with its path, or a file with cameras around it."""
    if name == "city":
        made = city(scale=0.01, frames=4)
        return scene_of(made), made.path.resized(160, 120)
    if name == "angio":
        made = angio(scale=0.02, frames=4)
        return scene_of(made), made.path.resized(160, 120)
    if not REAL_MODEL.exists():
        pytest.skip("Debian's assimp-testmodels is not installed")
    scene = load_scene(REAL_MODEL)
    return scene, orbit(scene)


@pytest.mark.parametrize("name", ["city", "angio", "engine"])
def test_no_culler_misses_anything_in_generated_and_real_scenes(name):
    scene, path = larger(name)
    referee = Referee(scene, lambda: EmbreeEngine(scene))
    cullers = [(str(variant), variant.make()) for variant in one_at_a_time()]
    outcome = referee.run(path, range(len(path)), cullers)
    for record in outcome.cullers:
        assert record.totals.violations == 0, record.spec
        assert not record.failed, record.spec
        assert record.totals.visible > 0


@pytest.mark.parametrize(
    "found",
    [
        "G2-QueryWithTheEyeInside-occlusion-query",
        "G10-MirroredCornersUnsorted-occlusion-query",
        "G14-UnfinishedQueryReadAsZero-occlusion-query",
        "U1-DepthMaskLeftOn-occupancy-map",
        "U2-ResultsShiftedByOne-occupancy-map",
    ],
)
def test_hypothesis_scenes_convict_the_broken(found):
    """Or the property above would hold of anything."""
    mutant = mutant_named(found)

    def convicted(built: Case) -> bool:
        problems, _ = judge_on(mutant.make, built, exact_truths(built))
        return any(problem.startswith("MISSED_OBJECT") for problem in problems)

    few = settings(QUIET, max_examples=60, phases=[Phase.generate], database=None)
    find(strategies.cases(), convicted, settings=few)
