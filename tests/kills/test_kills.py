"""Killing a run, at whatever moment, loses nothing and leaves nothing behind. `make soak` kills 200
(`docs/soak.md`); here are the first of them."""

from __future__ import annotations

import subprocess
import sys

import pytest

COUNT, SEED, AT_ONCE = 5, 0, 3


@pytest.mark.slow
def test_killed_runs_lose_nothing_and_the_next_leaves_nothing_behind():
    # In a process of its own: it forks, and here others have started threads.
    done = subprocess.run(
        [sys.executable, "-m", "tests.kills", *map(str, (COUNT, SEED, AT_ONCE))],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"{COUNT} kills, 0 differences" in done.stdout
