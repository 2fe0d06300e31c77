"""The quickest of several rounds is a job's own time."""

from __future__ import annotations

import time

import pytest

from visref_experiments.timing import quickest_ms


@pytest.mark.gl
def test_no_job_pays_for_the_job_before_it() -> None:
    """A job that another ran before takes ten milliseconds more, as with caches gone cold."""
    last: list[str] = [""]
    calls: dict[str, int] = {"first": 0, "second": 0}

    def job(name: str) -> None:
        calls[name] += 1
        if last[0] != name:
            time.sleep(0.01)
        last[0] = name

    times = quickest_ms(lambda: job("first"), lambda: job("second"), rounds=3)
    assert max(times) < 5.0
    assert calls == {"first": 6, "second": 6}
