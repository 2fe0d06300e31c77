"""A run's files are the same bytes whether or not samples are walked where all that is seen was
drawn: what looks at samples anyway (pictures, margins, witnesses, causes, image checks, what a
promise forbids) finds what it would have found."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import pytest

from tests.merging.scenes import Moving, cullers, stereo, switched
from tests.support.report_runs import triangle_units
from tests.support.same_bytes import differing
from visref.culler import Promise
from visref.judging import settle as settling
from visref.judging.holders import UnitsSeen
from visref.judging.policy import Policy
from visref.judging.referee import Referee
from visref.runs import judge_to_folder


class All(Moving):
    """Draws all that is there."""

    memory = 0


class AllJointly(All):
    """Draws all that is there, for all views at once."""

    joint = True

    def cull_joint(self, cameras):
        return self.cull(cameras[0])


class Exactly(AllJointly):
    """Draws all, and promises that nothing is superfluous."""

    promise = Promise.EXACT


class Finely(All):
    """Draws all, half by half."""

    units = triangle_units()

    def draw(self, camera):
        there = set(self.there.tolist())
        return [unit for unit in range(12) if unit // 2 in there]


class Keeps:
    """An image check that keeps the triangles it is told."""

    def __init__(self) -> None:
        self.told: list[list[bool]] = []

    def pixels_differ(self, camera, drawn) -> int:
        self.told.append(drawn.tolist())
        return int(drawn.sum())


def walked_through(patch: pytest.MonkeyPatch) -> None:
    """Have every sample of every frame walked."""
    of = UnitsSeen.of
    patch.setattr(UnitsSeen, "of", lambda *given: replace(of(*given), all_drawn=False))


def counting(patch: pytest.MonkeyPatch) -> Counter[str]:
    """How many frames are walked, and how many are not."""
    met: Counter[str] = Counter()
    looked_at, walk = settling._looked_at, settling.walk_samples

    def walks(*given):
        met["walked"] += 1
        return walk(*given)

    def looks(*given):
        met["looked at"] += 1
        return looked_at(*given)

    patch.setattr(settling, "walk_samples", walks)
    patch.setattr(settling, "_looked_at", looks)
    return met


def made(kind: str):
    if kind == "clean":
        return [(one.__name__, one()) for one in (All, Finely, Exactly)]
    if kind == "clean views":
        return [(one.__name__, one()) for one in (All, AllJointly, Exactly, Finely)]
    return cullers(kind)


@pytest.mark.parametrize(
    ("kind", "inputs"),
    [
        ("clean", switched),
        ("clean views", stereo),
        pytest.param("objects", switched, marks=pytest.mark.slow),
        pytest.param("broken", switched, marks=pytest.mark.slow),
        pytest.param("units", switched, marks=pytest.mark.slow),
        pytest.param("views", stereo, marks=pytest.mark.slow),
    ],
)
def test_a_run_leaves_the_same_bytes_by_either_way(kind, inputs, tmp_path, monkeypatch):
    given = {"pictures": 3, "policy": Policy(latency_frames=2)}
    met = counting(monkeypatch)
    judge_to_folder(inputs(), made(kind), tmp_path / "quick", **given)
    quick = dict(met)
    with monkeypatch.context() as patch:
        met.clear()
        walked_through(patch)
        judge_to_folder(inputs(), made(kind), tmp_path / "walked", **given)
    assert differing(tmp_path / "quick", tmp_path / "walked") == []
    assert met["walked"] == met["looked at"]
    if kind.startswith("clean"):
        assert "walked" not in quick
    else:
        assert 0 < quick["walked"] < quick["looked at"]


def test_an_image_check_is_told_the_same_triangles_by_either_way(monkeypatch):
    def told():
        inputs, check = switched(), Keeps()
        referee = Referee(
            inputs.scene, inputs.make_engine, image_check=check, timeline=inputs.timeline
        )
        outcome = referee.run(inputs.path, inputs.frames, made("clean"))
        rows = [row for record in outcome.cullers for row in record.frames]
        differ = [row.image_pixels_differ for row in rows]
        assert differ == [row.triangles_drawn for row in rows]
        return check.told, differ

    met = counting(monkeypatch)
    quick = told()
    assert "walked" not in met
    walked_through(monkeypatch)
    assert told() == quick
    assert len({tuple(one) for one in quick[0]}) > 1
    assert met["walked"] > 0
