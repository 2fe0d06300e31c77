"""N-buffer culling misses nothing where its memory counts: every camera stands for three frames.

A culler that remembers draws all in view in its first frame, so a path of one frame says nothing
of it. In the second frame all that is in view is an occluder and is tested against the depth of
all, its own too; in the third only what passed is drawn.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, find, given, settings
from hypothesis import strategies as st

from tests.mutants.harness import Method, mutant_named
from tests.mutants.n_buffer.methods import ALL
from tests.support import strategies
from tests.support.shares import examples, share
from visref.camera_path import CameraPath
from visref.conformance.scenes import Case
from visref.conformance.suite import SCENES, case, exact_truths, judge_on
from visref.trials.hardcases import read_cases
from visref.visibility import FrameTruth

pytestmark = [pytest.mark.gl, pytest.mark.slow]

FRAMES = 3
QUIET = settings(derandomize=True, deadline=None, suppress_health_check=list(HealthCheck))


def problems_while_standing(
    make, built: Case, truths: Sequence[FrameTruth] | None = None
) -> tuple[str, ...]:
    """What is wrong where each camera of a case stands for three frames."""
    of_view = iter(exact_truths(built) if truths is None else truths)
    by_frame = [[next(of_view) for _ in frame.cameras] for frame in built.path.frames]
    places = [place for place in range(len(built.path)) for _ in range(FRAMES)]
    standing = CameraPath(tuple(built.path.frames[place] for place in places))
    held = replace(built, path=standing)
    return judge_on(make, held, [truth for place in places for truth in by_frame[place]])[0]


@cache
def conformance_case(name: str) -> tuple[Case, tuple[FrameTruth, ...]]:
    built = Case(*case(name))
    return built, exact_truths(built)


@cache
def hard_cases() -> dict[str, tuple[Case, tuple[FrameTruth, ...]]]:
    """Those that load, with their exact truths."""
    with tempfile.TemporaryDirectory() as folder:
        loaded = [
            (hard.name, Case(hard.load(), hard.path))
            for hard in read_cases(Path(folder))
            if not hard.error
        ]
    return {name: (built, exact_truths(built)) for name, built in loaded}


@pytest.mark.parametrize("at", range(len(ALL)), ids=list(map(str, ALL)))
def test_nothing_is_missed_on_any_conformance_scene_that_stands_still(at: int) -> None:
    """On a share of them, another for each method."""
    for made in share([made for made in SCENES if not made.moves], at):
        built, truths = conformance_case(made.name)
        assert problems_while_standing(ALL[at].make, built, truths) == (), made.name


@pytest.mark.parametrize("at", range(len(ALL)), ids=list(map(str, ALL)))
def test_nothing_is_missed_in_any_hard_case(at: int) -> None:
    """On a share of them, another for each method."""
    assert len(hard_cases()) >= 50
    for name, known in share(list(hard_cases().items()), at):
        assert problems_while_standing(ALL[at].make, *known) == (), name


@settings(QUIET, max_examples=examples(100))
@given(built=strategies.cases(), method=st.sampled_from(ALL))
def test_nothing_is_missed_that_hypothesis_puts_in_view(built: Case, method: Method) -> None:
    assert problems_while_standing(method.make, built) == ()


@pytest.mark.parametrize(
    "found",
    [
        "G10-TwoCornersTransformed-n-buffer-gpu",
        "G2-QueryWithTheEyeInside-n-buffer-query",
        "U1-NearestForFarthest-n-buffer-four",
        "U7-UnclippedQuery-n-buffer-tree",
    ],
)
def test_a_standing_camera_convicts_the_broken(found: str) -> None:
    """Or the properties above would hold of anything."""
    mutant = mutant_named(found)

    def convicted(built: Case) -> bool:
        problems = problems_while_standing(mutant.make, built)
        return any(problem.startswith("MISSED_OBJECT") for problem in problems)

    few = settings(QUIET, max_examples=60, phases=[Phase.generate], database=None)
    find(strategies.cases(), convicted, settings=few)
