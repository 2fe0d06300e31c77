"""Compiled kernels: kept where they can be, and never taken for those of other source."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest

import visref.compiled
from visref.compiled import cache_folder, interrupts_held

ROOT = Path(visref.compiled.__file__).parent

# A kernel that takes a function and a constant from another file; says what it gives, and whether
# it had to be compiled.
CALLED = (
    "from visref.compiled import njit\nSTEP = {step}\n@njit()\ndef called(x):\n    return x + 1\n"
)
CALLER = """
    from visref.compiled import njit
    from visref_kernels_of_a_test.called import STEP, called

    @njit()
    def caller(x):
        return called(x) + STEP

    if __name__ != "__main__":
        given = caller(1)
        print(given, sum(caller.stats.cache_misses.values()))
"""


def package_in(place: Path) -> Path:
    folder = place / "source" / "visref_kernels_of_a_test"
    folder.mkdir(parents=True)
    (folder / "__init__.py").write_text("", encoding="utf-8")
    (folder / "called.py").write_text(CALLED.format(step=10), encoding="utf-8")
    (folder / "caller.py").write_text(textwrap.dedent(CALLER), encoding="utf-8")
    return folder


@pytest.fixture
def package(tmp_path):
    return package_in(tmp_path)


@pytest.fixture(scope="module")
def filled(tmp_path_factory):
    """A package and the cache that it has filled; both stay as they are."""
    place = tmp_path_factory.mktemp("filled")
    package, cache = package_in(place), place / "cache"
    assert called(package, cache) == ["12", "1"]
    assert called(package, cache) == ["12", "0"]
    return package, cache


def called(package: Path, cache: Path, **environment: str) -> list[str]:
    paths = os.pathsep.join([str(package.parent), str(ROOT.parent), *sys.path])
    done = subprocess.run(
        [sys.executable, "-c", "import visref_kernels_of_a_test.caller"],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONPATH": paths, "NUMBA_CACHE_DIR": str(cache), **environment},
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return done.stdout.split()


def test_a_kernel_is_compiled_once_and_again_when_what_it_calls_was_edited(package, tmp_path):
    cache = tmp_path / "cache"
    assert called(package, cache) == ["12", "1"]
    assert called(package, cache) == ["12", "0"]
    (package / "called.py").write_text(CALLED.format(step=20), encoding="utf-8")
    assert called(package, cache) == ["22", "1"]
    # And back: what was compiled of the first source is still there.
    (package / "called.py").write_text(CALLED.format(step=10), encoding="utf-8")
    assert called(package, cache) == ["12", "0"]


@pytest.mark.parametrize("kind", ["*.nbi", "*.nbc"])
@pytest.mark.parametrize("spoilt", [b"", b"\x80\x04", b"cvisref\nNoSuchName\n."])
def test_a_spoilt_cache_costs_a_compilation_and_is_mended(filled, tmp_path, kind, spoilt):
    package, kept = filled
    cache = tmp_path / "cache"
    shutil.copytree(kept, cache)
    files = list(cache.rglob(kind))
    assert files
    for file in files:
        file.write_bytes(spoilt)
    assert called(package, cache) == ["12", "1"]
    assert called(package, cache) == ["12", "0"]


def test_where_there_is_no_place_there_is_no_cache_and_no_error(package, tmp_path):
    (tmp_path / "file").write_text("not a folder", encoding="utf-8")
    assert called(package, tmp_path / "file") == ["12", "1"]
    assert called(package, tmp_path / "file") == ["12", "1"]


def test_compiled_without_a_compiler(package, tmp_path):
    program = "import visref_kernels_of_a_test.called as c; print(c.called(1))"
    paths = os.pathsep.join([str(package.parent), *sys.path])
    environment = {**os.environ, "PYTHONPATH": paths, "NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, env=environment
    )
    assert done.stdout == "2\n"


def test_folders_of_older_source_do_not_pile_up(tmp_path, monkeypatch):
    monkeypatch.setattr(visref.compiled, "_bases", lambda: iter([tmp_path]))
    for day in range(20):
        old = tmp_path / f"visref.kernels-{day:032x}"
        old.mkdir()
        os.utime(old, (day, day))
    other = tmp_path / f"visref.kernels_of_another-{0:032x}"
    other.mkdir()
    new = cache_folder.__wrapped__("visref.kernels", ROOT / "kernels.py")
    assert new is not None
    left = {folder.name for folder in tmp_path.iterdir()}
    assert left == {new.name, other.name, *(f"visref.kernels-{day:032x}" for day in range(13, 20))}


def test_every_kernel_of_this_project_is_compiled_here():
    from importlib.util import find_spec

    tops = ("visref", "visref_culling", "visref_experiments", "visref_datasets_gen")
    guilty = []
    for top in tops:
        spec = find_spec(top)
        assert spec is not None
        assert spec.origin is not None
        for file in Path(spec.origin).parent.rglob("*.py"):
            text = file.read_text(encoding="utf-8")
            if file != ROOT / "compiled.py" and ("numba.njit" in text or "numba.jit" in text):
                guilty.append(str(file))
    assert guilty == []


def test_an_interrupt_while_a_kernel_is_loaded_takes_effect_afterwards():
    passed = []
    with pytest.raises(KeyboardInterrupt), interrupts_held():
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.01)
        passed.append(True)
    assert passed
    with interrupts_held():
        pass
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
