"""Every cause that is named has a frame with a picture."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from tests.merging.scenes import FRAMES, cullers, stereo, switched
from tests.run_folder.test_picture_plan import misses
from visref.causes.evidence import convicted
from visref.causes.pictured import without_picture
from visref.judging.causes import CausesFound, Named
from visref.picking import evenly_picked
from visref.run_folder.picture_plan import PicturePlan
from visref.run_folder.read import read_run
from visref.runs import judge_to_folder


def records(lost):
    """By frame and view, of each object the samples that it lost."""
    return [
        SimpleNamespace(frame=frame, view=view, verdict=SimpleNamespace(misses=misses(its)))
        for (frame, view), its in lost.items()
    ]


def found(named):
    return CausesFound(
        {place: tuple(Named(cause, 1.0) for cause in causes) for place, causes in named.items()}
    )


LOST = records(
    {
        (1, ""): {0: 9, 1: 2},
        (2, ""): {0: 3, 1: 7},
        (5, ""): {0: 5, 1: 7},
        (8, ""): {2: 1},
    }
)
NAMED = found(
    {
        (1, "", 0): ["near-larger"],
        (2, "", 0): ["near-larger", "list-full"],
        (2, "", 1): ["old-pose"],
        (5, "", 1): ["old-pose"],
        (8, "", 2): ["list-full", "near-larger"],
    }
)


def test_of_a_cause_without_a_picture_the_frame_that_loses_most_is_wanted():
    # The first of two frames that lose as much, and by what the likeliest cause explains.
    assert without_picture(NAMED, LOST, lambda at: False) == [(1, ""), (2, ""), (8, "")]


def test_a_cause_that_a_picture_shows_wants_no_other():
    assert without_picture(NAMED, LOST, lambda at: at == (5, "")) == [(1, ""), (8, "")]
    # Frame 2 shows both.
    assert without_picture(NAMED, LOST, lambda at: at in [(2, ""), (8, "")]) == []
    assert without_picture(CausesFound(), LOST, lambda at: False) == []


def drawn(folder):
    return {
        (one.culler, one.frame, one.view): one.files for one in read_run(folder).manifest.pictures
    }


def named_by_frame(evidence, records, *others):
    """In place of the search: a cause for even frames, and another for odd ones."""
    for record in records:
        causes = Named("old-pose", 0.5), Named("list-full", 0.5)
        named = {
            (one.frame, one.view, int(obj)): (causes[one.frame % 2],)
            for one in record.frames
            for obj in convicted(one.verdict)
        }
        record.causes = CausesFound(named, frozenset(named))


@pytest.mark.parametrize(
    ("kind", "inputs", "frames"),
    [("objects", switched, FRAMES), ("units", switched, FRAMES), ("views", stereo, 5)],
)
def test_what_is_painted_once_causes_are_known_is_what_was_painted_at_first(
    kind, inputs, frames, tmp_path, monkeypatch
):
    monkeypatch.setattr("visref.shares.find_causes", named_by_frame)
    judge_to_folder(inputs(), cullers(kind), tmp_path / "all", pictures=frames)
    monkeypatch.setattr(PicturePlan, "wanted", lambda self, spec: frozenset())
    judge_to_folder(inputs(), cullers(kind), tmp_path / "few", pictures=1)
    every, few = drawn(tmp_path / "all"), drawn(tmp_path / "few")
    (planned,) = evenly_picked(frames, 1).tolist()
    more = {place: files for place, files in few.items() if place[1] != planned}
    rows = [
        (row["culler"], row["cause"], row["frame"])
        for row in read_run(tmp_path / "few").objects.to_pylist()
        if row["pixels"] is not None and row["cause"] is not None
    ]
    assert rows
    shown = {(culler, frame) for culler, frame, _ in few}
    for culler, cause in {one[:2] for one in rows}:
        frames_of = {row[2] for row in rows if row[:2] == (culler, cause)}
        assert any((culler, frame) in shown for frame in frames_of), (culler, cause)
    assert more
    for place, files in more.items():
        assert files == every[place]
        for name in files.values():
            assert (tmp_path / "few" / name).read_bytes() == (tmp_path / "all" / name).read_bytes()


def test_who_wants_no_pictures_gets_none(tmp_path):
    judge_to_folder(switched(), cullers("objects"), tmp_path / "run", pictures=0)
    assert drawn(tmp_path / "run") == {}
