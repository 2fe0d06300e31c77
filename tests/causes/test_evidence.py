"""What a run keeps of every answer, to say at its end why things were missed."""

from __future__ import annotations

import tracemalloc

import numpy as np

from visref.causes.evidence import Answer, Evidence
from visref.causes.search import _covering
from visref.culler import QueryStats
from visref.judging.judge import Counts, FrameVerdict
from visref.judging.misses import Miss, Misses, MissKind
from visref.judging.outcome import FrameRecord
from visref.recordings.spool import Spool
from visref.scene import Units

COUNT = 20_000


def test_of_every_answer_what_was_drawn_and_missed_is_kept_on_disk():
    """Of 20 frames no more than of 2, but for a kilobyte each: the numbers take 120 kB a frame."""
    units = Units(np.arange(COUNT + 1), np.arange(COUNT, dtype=np.int32), "object")
    (one,) = Misses.of([Miss(0, MissKind.CONFIRMED, 3, 9, 0, 0, 1.0)])
    columns = Misses.of([one]).columns
    repeated = type(columns)(*(np.repeat(column, COUNT // 2) for column in columns))

    def lost(frame: int) -> np.ndarray:
        return np.arange(frame % 2, COUNT, 2, dtype=np.int32)

    def record(frame: int) -> FrameRecord:
        verdict = FrameVerdict(Counts(), Misses(repeated._replace(object=lost(frame))))
        return FrameRecord(frame, "", 4, verdict, QueryStats(), 0)

    def held(frames: int) -> int:
        evidence = Evidence()
        # Until it is more than is held in memory.
        for frame in range(1000):
            evidence.add("before", units, record(frame), lost(frame + 1)[::-1])
        tracemalloc.start()
        for frame in range(frames):
            evidence.add("one", units, record(frame), lost(frame + 1)[::-1])
        size, _ = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        answers = evidence.answers["one"]
        assert answers.lossy == answers.every
        for frame, answer in enumerate(answers.every):
            assert answer.missed.tolist() == lost(frame).tolist()
            assert np.flatnonzero(answer.drawn(COUNT)).tolist() == lost(frame + 1).tolist()
        return size

    assert held(20) - held(2) < 18 * 1024


def test_the_answers_looked_at_lose_between_them_as_many_objects_as_they_can():
    rng, spool = np.random.default_rng(5), Spool()
    for _ in range(20):
        missed = [np.unique(rng.integers(0, 40, rng.integers(1, 6))) for _ in range(12)]
        answers = [
            Answer.of(frame, "", np.zeros(0, np.int32), one.astype(np.int32), spool)
            for frame, one in enumerate(missed)
        ]
        picked = [answer.frame for answer in _covering(answers, 6)]
        assert picked == sorted(set(picked))
        # Beside those evenly picked each is one that adds the most to them, by a plain search.
        known = {0, 5, 11}
        covered = {obj for frame in known for obj in missed[frame].tolist()}
        wanted = set(known)
        while len(wanted) < 6:
            gains = [len(set(one.tolist()) - covered) for one in missed]
            if not max(gains):
                break
            best = gains.index(max(gains))
            wanted.add(best)
            covered |= set(missed[best].tolist())
        assert set(picked) == wanted
