"""A user who may write nowhere: no home, a package of root's, a `/tmp` that is closed.

Permissions mean nothing to root, whom CI may be; so the commands run as another user then.
"""

from __future__ import annotations

import os
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.test_cli import record, write_scene
from visref.warming import place as kernels

NOBODY = 65534


@pytest.fixture
def place(tmp_path):
    """A scene that anybody may read, an output folder that anybody may write, and a closed one."""
    scene, path = write_scene(tmp_path)
    visible = record(tmp_path, ["front", "beside"], ["front", "beside"])
    (tmp_path / "out").mkdir()
    (tmp_path / "out").chmod(0o777)
    (tmp_path / "closed").mkdir()
    (tmp_path / "closed").chmod(0o555)
    folder = tmp_path
    while folder != folder.parent and folder.stat().st_uid == os.getuid():
        folder.chmod(folder.stat().st_mode | stat.S_IXOTH | stat.S_IROTH)
        folder = folder.parent
    yield tmp_path, scene, path, visible
    (tmp_path / "closed").chmod(0o755)


def as_nobody(
    folder: Path, *arguments: str, cache: Path | None = None
) -> subprocess.CompletedProcess[str]:
    """visref as a user who can write to `folder/out` and nowhere else. `cache`: of compiled
    kernels, which that user can read; without one nothing is kept."""
    kept = ("PATH", "LANG", "PYTHONPATH", "VIRTUAL_ENV", "LD_LIBRARY_PATH")
    environment = {name: os.environ[name] for name in kept if name in os.environ}
    environment |= {
        "HOME": "/nonexistent",
        "TMPDIR": str(folder / "closed"),
        "TEMP": str(folder / "closed"),
        # The folders of the machine are open to anybody, and would be taken instead.
        "PYTHONDONTWRITEBYTECODE": "1",
        # Where the test's own user owns the package, it is closed by telling another place.
        "NUMBA_CACHE_DIR": str(cache or folder / "closed"),
    }
    if cache is not None:
        # Numba says then what it loads and what it keeps.
        environment["NUMBA_DEBUG_CACHE"] = "1"
    # The interpreter may lie in root's home: reading is left to the other user, writing is not.
    other = [
        "setpriv", f"--reuid={NOBODY}", f"--regid={NOBODY}", "--clear-groups",
        "--inh-caps=-all,+dac_read_search", "--ambient-caps=-all,+dac_read_search",
        "--bounding-set=-all,+dac_read_search",
    ]  # fmt: skip
    become = other if os.getuid() == 0 else []
    return subprocess.run(
        [*become, sys.executable, "-c", PROGRAM, *arguments],
        capture_output=True,
        text=True,
        check=False,
        cwd=folder / "out",
        env=environment,
    )


# The folders that libraries fall back to beside TMPDIR are taken away as well.
PROGRAM = """
import sys, tempfile, os
tempfile._candidate_tempdir_list = lambda: [os.environ["TMPDIR"]]
sys.argv[0] = "visref"
from visref.cli.main import main
sys.exit(main())
"""


def ended(done: subprocess.CompletedProcess[str], *statuses: int) -> None:
    """It worked, or it is one line and status 2."""
    if done.returncode == 2 and 2 not in statuses:
        assert len(done.stderr.splitlines()) == 1, done.stderr
    else:
        assert done.returncode in statuses, done.stdout + done.stderr
        assert done.stderr == ""
    assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_who_may_write_nowhere_else_gets_every_verdict(place):
    folder, scene, path, visible = place
    judging = ["--path", path, "--frames", "0:1"]
    ended(as_nobody(folder, "--help"), 0)
    ended(as_nobody(folder, "objects", scene), 0)
    run = as_nobody(folder, "run", scene, *judging, "--culler", "frustum", "--out", "run")
    assert run.returncode == 0, run.stderr
    # A cache that somebody else has filled is read.
    cache = folder / "cache"
    shutil.copytree(kernels(), cache / "visref")
    for one in (cache, *cache.rglob("*")):
        one.chmod(0o555 if one.is_dir() else 0o444)
    recorded = ["--visible", visible, "--out", "check"]
    checked = as_nobody(folder, "check", scene, *judging, *recorded, cache=cache)
    for one in (cache, *cache.rglob("*")):
        one.chmod(0o755)
    assert checked.returncode in (0, 2), checked.stderr
    assert "[cache] data loaded from" in checked.stdout
    assert "[cache] data saved to" not in checked.stdout
    ended(as_nobody(folder, "report", "run", "--out", "page"), 0)
    ended(as_nobody(folder, "explain", "run", "--frame", "0", "--object", "front"), 0)
