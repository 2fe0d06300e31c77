"""The oracles that catch mutants see what they should, and no more."""

from __future__ import annotations

import pytest

from tests.mutants.harness import mutant_named, watch
from tests.mutants.lazy_grid.contract import replay
from tests.mutants.lazy_grid.mutants import ALL
from tests.mutants.occupancy_map.mutants import FIVE
from visref.conformance.scenes import box, camera, case, panel
from visref.engines.exact import ExactEngine
from visref.judging.referee import Referee
from visref.scene import Alpha

pytestmark = pytest.mark.gl


def test_watched_scenes_fill_all_five_lists():
    """Drawn, outside and sure shapes come up too, or a contract would be vacuous."""
    lists, sure = set(), 0
    for scene, cameras in FIVE.suite.watched_scenes():
        for trace in watch(FIVE, scene, cameras):
            (event,) = trace.of("lists")
            lists |= set(event["list_of"].tolist())
            sure += int(event["sure"].sum())
    assert lists == {-1, 0, 1, 2, 3, 4, 5}
    assert sure > 0


@pytest.mark.parametrize("method", ALL, ids=str)
def test_watched_scenes_test_boxes_against_the_grid(method):
    for scene, cameras in method.suite.watched_scenes():
        assert sum(replay(trace).tests for trace in watch(method, scene, cameras)) > 20


def test_alpha_cut_occluder_leaves_doubt_and_no_conviction():
    """G13's other half: behind an alpha-cut surface whose texture nobody looks at, a sample is
    undecided, so the mutant's loss is counted there and convicts nobody."""
    fenced = case(
        [
            ("fence", panel((-2.0, 2.0), (-2.0, 2.0), -4.0)),
            ("behind it", box((-1.0, -1.0, -8.0), (1.0, 1.0, -6.0))),
            ("beside it", box((4.0, -1.0, -8.0), (5.0, 1.0, -6.0))),
        ],
        [camera(width=32, height=16)],
        alpha={"fence": Alpha.MASK},
    )
    scene, path = fenced.scene, fenced.path
    mutant = mutant_named("G13-GlassOccludes-occlusion-query")
    for subject, undecided in ((mutant, True), (mutant.method, False)):
        referee = Referee(scene, lambda: ExactEngine(scene))
        outcome = referee.run(path, range(len(path)), [("fence", subject.make())])
        totals = outcome.cullers[0].totals
        assert totals.violations == 0
        assert (totals.undecided > 0) == undecided
