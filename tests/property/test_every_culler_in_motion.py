"""No installed culler that may move misses anything in scenes that hypothesis moves: rigid moves,
deformations, absences, appearances, cuts, two views, clip planes."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, find, given, settings
from hypothesis import strategies as st

from tests.mutants.harness import mutant_named
from tests.property.test_every_culler import CLASSES, COMBINATIONS, Variant
from tests.support import strategies
from tests.support.shares import examples
from visref.camera import Camera
from visref.camera_path import CameraPath, Frame
from visref.conformance import exact_truths, judge_on
from visref.conformance.moving import about, moved, rigged
from visref.conformance.scenes import Case, case
from visref.rig import Moment

pytestmark = [pytest.mark.gl, pytest.mark.slow]

MOVING = [
    (name, variants)
    for name, variants in zip(CLASSES, COMBINATIONS, strict=True)
    if CLASSES[name]().moves
]
QUIET = settings(derandomize=True, deadline=None, suppress_health_check=list(HealthCheck))


class Squashed:
    """As `visref.rig.Motion`: objects whose vertices are pulled about by their own places."""

    clips = ("squashed",)
    digest = "squashed"

    def __init__(self, positions, chosen):
        self.positions, self.skinned = positions, chosen

    def affected(self, clip):
        return self.skinned

    def at(self, clip, time_s):
        objects = np.flatnonzero(self.skinned)
        # By half units, so that ties stay ties.
        posed = {
            int(k): self.positions[k]
            + 0.5 * np.rint(time_s * np.sin(7.0 * self.positions[k][:, ::-1]))
            for k in objects
        }
        return Moment(objects, np.tile(np.eye(4), (len(objects), 1, 1)), posed)


def matrices() -> st.SearchStrategy[np.ndarray]:
    half = strategies.coordinate
    translations = st.builds(moved, half, half, half)
    turns = st.builds(
        lambda quarter, axis, centre: (
            np.rint(about((0, 0, 0), quarter * math.pi / 2, axis=axis)) @ moved(*centre)
        ),
        st.integers(0, 3),
        st.integers(0, 2),
        strategies.point,
    )
    odd = st.builds(
        lambda angle, axis, x: moved(x=x) @ about((0, 0, -4), angle, axis=axis),
        st.floats(-3.0, 3.0).filter(lambda a: abs(a) > 1e-3),
        st.integers(0, 2),
        half,
    )
    mirror = st.just(np.diag([-1.0, 1.0, 1.0, 1.0]))
    return st.one_of(translations, turns, odd, mirror)


@st.composite
def planes(draw) -> tuple[float, float, float, float] | None:
    if draw(st.integers(0, 3)):
        return None
    normal = draw(st.tuples(*[st.sampled_from((-1.0, 0.0, 1.0))] * 3).filter(any))
    return (*normal, draw(strategies.coordinate))


@st.composite
def moving_cases(draw) -> Case:
    own = draw(st.lists(strategies.meshes, min_size=2, max_size=8))
    objects = [(f"object {k}", mesh) for k, mesh in enumerate(own)]
    targets = [mesh[0].mean(axis=0) for mesh in own if len(mesh[0])]
    names = st.sampled_from([name for name, _ in objects])
    views = draw(st.sampled_from([("",), ("left", "right")]))
    frames = []
    for _ in range(draw(st.integers(2, 4))):
        cut = draw(st.booleans())
        cameras: list[Camera] = [
            replace(
                draw(strategies.cameras(targets)), view=view, cut=cut, clip_plane=draw(planes())
            )
            for view in views
        ]
        frames.append(
            Frame(
                tuple(cameras),
                time_s=draw(st.sampled_from([0.0, 1.0, 2.0])),
                world_from_object=draw(st.dictionaries(names, matrices(), max_size=4)),
                absent=tuple(draw(st.sets(names, max_size=4))),
            )
        )
    scene = case(objects, [frames[0].cameras[0]]).scene
    positions = [np.asarray(points, np.float64) for points, _ in own]
    chosen = np.array([len(p) > 0 and draw(st.integers(0, 3)) == 0 for p in positions])
    scene = rigged(scene, positions, Squashed(positions, chosen))
    return Case(scene, CameraPath(frames, "hypothesis"))


@settings(
    max_examples=examples(60),
    derandomize=True,
    deadline=None,
    suppress_health_check=list(HealthCheck),
)
@given(
    built=moving_cases(),
    variants=st.tuples(*(st.sampled_from(variants) for _, variants in MOVING)),
)
def test_no_culler_misses_what_hypothesis_moves_into_view(built, variants):
    truths = exact_truths(built)
    for variant in filter(Variant.accepted, variants):
        problems, _ = judge_on(variant.make, built, truths)
        assert problems == (), str(variant)


@pytest.mark.parametrize(
    "found",
    [
        "M1-BoxesAtRest-occlusion-query",
        "M2-BoxesOfTheFrameBefore-occlusion-query",
        "M3-DepthAtItsOldPlace-occlusion-query",
        "M5-NoEntryForWhatAppears-occlusion-query",
    ],
)
def test_hypothesis_scenes_convict_what_is_not_brought_up_to_date(found):
    """Or the property above would hold of anything. (M4 and G15 take hypothesis a minute to find;
    the mutants' own scenes convict them.)"""
    mutant = mutant_named(found)

    def convicted(built: Case) -> bool:
        problems, _ = judge_on(mutant.make, built, exact_truths(built))
        return any(problem.startswith("MISSED_OBJECT") for problem in problems)

    few = settings(QUIET, max_examples=800, phases=[Phase.generate], database=None)
    find(moving_cases(), convicted, settings=few)
