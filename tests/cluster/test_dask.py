"""A run on a Dask cluster leaves the bytes of one process, whatever becomes of its workers."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import sys
import threading
from collections import Counter

import pytest

from tests.cluster.scenes import Ends, Making, MakingEnds, mark
from tests.merging.scenes import FRAMES, Forgets, cullers, stereo, switched
from tests.merging.test_merge import POLICIES
from tests.support.same_bytes import differing
from visref.cluster import connected, judging_on_dask
from visref.cluster.running import _cut, _frames_each
from visref.errors import InputError, Unfinished
from visref.picking import Stretch
from visref.runs import judge_to_folder, truth_to_file
from visref.workers import judging_at_once

pytestmark = pytest.mark.slow

COMMAND = {"scene": "squares", "cullers": "some"}


@pytest.fixture(scope="module")
def client():
    pytest.importorskip("distributed")
    with connected("local", 2) as found:
        yield found


def by_dask(client, out, anew, inputs=switched, frames_each=2, **given):
    """The run folder of a cluster, and the frames that were told."""
    told = []
    run = judging_on_dask(inputs(), anew, out, client, frames_each=frames_each, **given)
    with run as going:
        before = going.before
        going.finish(told.append)
    return told, before


@pytest.mark.parametrize(
    ("kind", "inputs", "frames_each", "sent"),
    [("objects", switched, 2, True), ("broken", switched, 4, False), ("units", switched, 1, True),
     ("views", stereo, None, False)],
)  # fmt: skip
def test_a_cluster_leaves_the_bytes_of_one_worker_and_of_two(
    kind, inputs, frames_each, sent, client, tmp_path
):
    given = {"policy": POLICIES["late"], "pictures": 2, "repeat": 2}
    opening = None if sent else inputs
    judge_to_folder(inputs(), cullers(kind), tmp_path / "one", anew=Making(kind), **given)
    with judging_at_once(inputs(), Making(kind), tmp_path / "two", workers=2, **given) as going:
        going.finish(lambda frame: None)
    told, _ = by_dask(
        client, tmp_path / "dask", Making(kind), inputs, frames_each, opening=opening, **given
    )
    assert differing(tmp_path / "one", tmp_path / "two") == []
    assert differing(tmp_path / "one", tmp_path / "dask") == []
    assert sorted(told) == list(inputs().frames)
    assert sorted(os.listdir(tmp_path)) == ["dask", "one", "two"]


@pytest.mark.parametrize("sent", [True, False])
def test_a_truth_file_goes_to_the_workers(sent, client, tmp_path):
    truth = tmp_path / "truth.parquet"
    truth_to_file(switched(), truth)
    judge_to_folder(switched(), cullers("units"), tmp_path / "one", truth=truth)
    by_dask(
        client, tmp_path / "dask", Making("units"), truth=truth, opening=None if sent else switched
    )
    assert differing(tmp_path / "one", tmp_path / "dask") == []


def test_what_a_lost_worker_had_is_judged_by_another(client, tmp_path):
    judge_to_folder(switched(), [("forgets", Forgets()), ("ends", Forgets())], tmp_path / "one")
    marks = mark(tmp_path / "marks", times=1)
    by_dask(client, tmp_path / "dask", MakingEnds(marks))
    assert os.listdir(marks) == []
    assert differing(tmp_path / "one", tmp_path / "dask") == []


def losing_what_was_said(client, monkeypatch, go=1):
    """From now on one task is done, and its worker lost before anybody has what it said: the first
    whose stretch is given to a worker for so many times. What became of such a task then."""
    gather, given, became = client.gather, Counter(), []

    async def late(future, **how):
        what = future.key.rpartition("-")[0]
        given[what] += 1
        meant = given[what] == go
        while meant and future.status == "pending":
            await asyncio.sleep(0.01)
        if meant and not became and future.status == "finished":
            became.append(None)
            [holder] = (await client.who_has([future]))[future.key]
            pids = await client.run(os.getpid, workers=[holder])
            os.kill(pids[holder], signal.SIGKILL)
            while future.status == "finished":
                await asyncio.sleep(0)
            became[0] = future.status
        return await gather(future, **how)

    monkeypatch.setattr(client, "gather", late)
    return became


@pytest.mark.parametrize("frames_each", [None, 2])
def test_what_is_lost_before_it_is_fetched_is_found_again(
    frames_each, client, tmp_path, monkeypatch
):
    judge_to_folder(switched(), cullers("units"), tmp_path / "one")
    became = losing_what_was_said(client, monkeypatch)
    told, _ = by_dask(client, tmp_path / "dask", Making("units"), frames_each=frames_each)
    assert became == ["lost"]
    assert sorted(told) == list(switched().frames)
    assert differing(tmp_path / "one", tmp_path / "dask") == []


def test_a_suspect_whose_worker_is_lost_once_it_ended_well_is_not_convicted(
    client, tmp_path, monkeypatch
):
    dask = pytest.importorskip("dask")
    allowed = dask.config.get("distributed.scheduler.allowed-failures")
    judge_to_folder(switched(), [("forgets", Forgets()), ("ends", Forgets())], tmp_path / "one")
    became = losing_what_was_said(client, monkeypatch, go=2)
    marks = mark(tmp_path / "marks", times=allowed + 1)
    by_dask(client, tmp_path / "dask", MakingEnds(marks))
    assert os.listdir(marks) == []
    assert became == ["lost"]
    assert differing(tmp_path / "one", tmp_path / "dask") == []


def test_a_part_that_ends_each_worker_is_named_with_its_culler_and_the_rest_is_kept(
    client, tmp_path
):
    marks = mark(tmp_path / "marks", times=99)
    out = tmp_path / "dask"
    named = r"frames 3 to 4: each worker.*'ends' is asked in frame 3"
    with pytest.raises(Unfinished, match=named):
        by_dask(client, out, MakingEnds(marks), command=COMMAND)
    assert not out.exists()
    for one in marks.iterdir():
        one.unlink()
    told, before = by_dask(client, out, MakingEnds(marks), command=COMMAND)
    assert (sorted(told), before) == ([3, 4], FRAMES - 2)
    judge_to_folder(switched(), [("forgets", Forgets()), ("ends", Forgets())], tmp_path / "one")
    assert differing(tmp_path / "one", out) == []


class _Odd:
    """Makes no culler, and says why."""

    def __call__(self):
        raise InputError("it is odd", fix="mend it", source="x")


def test_what_a_worker_refuses_is_refused(client, tmp_path):
    with pytest.raises(InputError, match="x: it is odd"):
        by_dask(client, tmp_path / "dask", _Odd())
    assert os.listdir(tmp_path) == []


def test_a_worker_that_reads_another_scene_is_named(client, tmp_path):
    with pytest.raises(InputError, match=r"worker on .* finds another path there"):
        by_dask(client, tmp_path / "dask", Making("units"), opening=stereo)


def test_a_worker_with_other_code_is_named(client, tmp_path, monkeypatch):
    monkeypatch.setattr("visref.cluster.running.code_of", lambda name: "another")
    with pytest.raises(InputError, match=r"worker on .* has other code of 'visref'"):
        by_dask(client, tmp_path / "dask", Making("units"))


def test_what_cannot_be_sent_is_refused(client, tmp_path):
    held = threading.Lock()
    with pytest.raises(InputError, match="cannot be sent"):
        by_dask(client, tmp_path / "dask", lambda: held)


@pytest.mark.parametrize(
    ("address", "problem"),
    [("tcp://127.0.0.1:1", "no scheduler answers"), ("nonsense", "no address"),
     ("tcp://127.0.0.1:x", "no address")],
)  # fmt: skip
def test_an_address_without_a_scheduler_is_refused_in_a_line(address, problem):
    with pytest.raises(InputError, match=problem), connected(address):
        pass


def test_without_dask_the_way_to_install_it_is_said(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"pip install 'visref\[dask\]'"), connected("local"):
        pass


def test_who_looks_back_further_gets_longer_parts():
    assert _frames_each(10_000, 4, 0) == 100
    assert _frames_each(100, 2, 0) == 13
    assert _frames_each(100, 2, 10) == 40
    assert _frames_each(100, 2, None) == 50
    assert _frames_each(9, 100, 0) == 8


def test_parts_are_of_about_the_same_length_and_go_over_no_gap():
    left = [0, 1, 2, 3, 4, 7, 8]
    assert _cut(left, 4) == [Stretch(0, 2), Stretch(2, 5), Stretch(7, 9)]
    assert _cut([], 4) == []


def test_who_ends_its_process_does_not_without_a_mark(tmp_path):
    ends = Ends()
    ends.marks = mark(tmp_path / "marks", times=0)
    judge_to_folder(switched(), [("ends", ends)], tmp_path / "one")
    verdict = json.loads((tmp_path / "one" / "verdict.json").read_text())
    assert verdict["cullers"]["ends"]["frames"] == FRAMES
