"""A run that is killed goes on to the bytes of one that nobody killed. `make soak` kills 30
(`docs/soak.md`); here are the first of them."""

from __future__ import annotations

import subprocess
import sys

import pytest

COUNT, SEED = 3, 0


@pytest.mark.slow
def test_killed_runs_go_on_to_the_same_bytes():
    # In a process of its own: it forks, and here others have started threads.
    done = subprocess.run(
        [sys.executable, "-m", "tests.kills", "going-on", *map(str, (COUNT, SEED))],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"{COUNT} kills, 0 differences" in done.stdout
