"""An interrupt at any moment, that of importing included, is one line and status 130."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time

import pytest

from tests.cli.test_cli import write_scene

MOMENTS = 8

# What Python does before it comes to visref is Python's: an interrupt there is told by itself.
PROGRAM = """
import runpy, sys, visref
sys.argv[0] = "visref"
print("begun", flush=True)
runpy.run_module("visref", run_name="__main__", alter_sys=True)
"""


def started(arguments: list[str]) -> subprocess.Popen[str]:
    """A process that is about to begin with visref."""
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # A shell that runs tests in the background ignores the signal, and so would its children.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "begun\n"
    return process


@pytest.mark.slow
@pytest.mark.parametrize("command", ["objects", "run"])
def test_an_interrupt_at_a_random_moment_is_quiet(tmp_path, command):
    scene, path = write_scene(tmp_path)
    run = ["run", scene, "--path", path, "--culler", "frustum", "--pictures", "0", "--out"]

    def arguments(number: int) -> list[str]:
        return ["objects", scene] if command == "objects" else [*run, str(tmp_path / f"{number}")]

    chance = random.Random(14)
    # The first compiles what is not compiled yet, and takes longer than any after it.
    for number in (-2, -1):
        began = time.monotonic()
        _, error = started(arguments(number)).communicate()
        whole = time.monotonic() - began
        assert error == ""
    interrupted = 0
    for number in range(MOMENTS):
        process = started(arguments(number))
        time.sleep(chance.uniform(0.0, whole))
        met = process.poll() is None
        if met:
            os.kill(process.pid, signal.SIGINT)
        _, error = process.communicate()
        # Of a process that dies by the signal a shell says 130, too.
        stopped = process.returncode in (130, -signal.SIGINT)
        assert process.returncode == 0 or (met and stopped), (process.returncode, error)
        assert len(error.splitlines()) <= 1, error
        assert "Traceback" not in error
        interrupted += stopped
        # A run is whole or not there.
        out = tmp_path / f"{number}"
        assert not out.exists() or (out / "verdict.json").exists()
    # The moments lie within the run: most must have met it.
    assert interrupted >= MOMENTS // 4
