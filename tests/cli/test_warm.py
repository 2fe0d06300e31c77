"""`visref warm`: what it compiled is not compiled again, and it knows what is left to do."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import visref
from tests.cli.test_cli import record, write_scene
from visref.cli.main import main

# Runs a command line; the last line says how many functions numba compiled for it.
COUNTING = """
import sys
from numba.core import event
from visref.cli.main import main
with event.install_recorder("numba:compile") as compiled:
    status = main(sys.argv[1:])
print(status, sum(one.is_start for _, one in compiled.buffer))
"""
LEFT = "from visref.warming import PARTS, holds; print(*(p for p in PARTS if not holds(p)))"


def said(*words: str, cache: Path | None = None) -> str:
    environment = dict(os.environ)
    if cache is not None:
        environment["NUMBA_CACHE_DIR"] = str(cache)
    done = subprocess.run(
        [sys.executable, *words], capture_output=True, text=True, check=False, env=environment
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def warmed():
    """The folder of all kernels after `visref warm`, which `make test` has run."""
    said("-m", "visref", "warm")
    return Path(said("-c", "from visref.warming import place; print(place())").strip())


@pytest.fixture
def copied(warmed, tmp_path):
    shutil.copytree(warmed, tmp_path / "cache" / "visref")
    return tmp_path / "cache"


def compiled_by_a_check_with_a_miss(folder: Path, cache: Path | None = None) -> int:
    scene, path = write_scene(folder)
    visible = record(folder, ["beside"], ["front", "beside"])
    line = ["check", scene, "--path", path, "--visible", visible, "--out", str(folder / "run")]
    *_, last = said("-c", COUNTING, *line, "--no-summary", cache=cache).splitlines()
    status, count = map(int, last.split())
    assert status == 1
    return count


def test_a_check_with_a_miss_compiles_nothing_after_it(warmed, tmp_path):
    assert compiled_by_a_check_with_a_miss(tmp_path) == 0


def test_what_was_compiled_and_is_gone_is_compiled_again_and_known_to_be_left(copied, tmp_path):
    assert said("-c", LEFT, cache=copied).split() == []
    for file in copied.glob("visref/visref.run_folder.along-*/*.nbc"):
        file.unlink()
    # The part that judges, and whatever else had loaded that module.
    assert "judging" in said("-c", LEFT, cache=copied).split()
    assert compiled_by_a_check_with_a_miss(tmp_path, copied) > 0


@pytest.mark.parametrize("spoilt", ["", "{", "[]", '{"made_by": []}', "other source"])
def test_a_record_that_is_spoilt_or_of_other_source_leaves_its_part_to_do(copied, spoilt):
    file = copied / "visref" / "warm-walking.json"
    if spoilt == "other source":
        kept = json.loads(file.read_bytes())
        name, files = kept["kernels"]["visref.paths.clearance"]
        kept["kernels"]["visref.paths.clearance"] = [name.replace("-", "-0"), files]
        spoilt = json.dumps(kept)
    file.write_text(spoilt, encoding="utf-8")
    assert said("-c", LEFT, cache=copied).split() == ["walking"]


def test_a_second_time_there_is_nothing_to_do(warmed):
    assert said("-m", "visref", "warm") == f"all is compiled already: {warmed}\n"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--jobs", "0"], "error: --jobs is 0; give 1 or more"),
        (["--part", "exact", "--json"], "error: --json and --part; leave one out"),
        (["--part", "exakt"], "error: no part is named 'exakt'; did you mean 'exact'?"),
    ],
)
def test_wrong_input_is_told(words, message, capsys):
    assert main(["warm", *words]) == 2
    assert capsys.readouterr().err.startswith(message)


@pytest.mark.parametrize("part", [[], ["--part", "walking"]])
def test_where_nothing_can_be_kept_it_says_so(part, tmp_path):
    (tmp_path / "cache").write_text("no folder", encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-m", "visref", "warm", *part],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")},
    )
    assert done.returncode == 2
    assert done.stderr.startswith("error: NUMBA_CACHE_DIR: compiled kernels can be kept nowhere")


def test_a_part_that_this_machine_cannot_do_is_told_and_the_others_are_done(
    tmp_path, monkeypatch, capsys
):
    from visref.cli import warm

    # Parts in processes of this test's own: one cannot be done, one breaks down, one is done.
    ends = {"no GL": "print('no OpenGL', file=sys.stderr); sys.exit(3)", "done": "pass"}
    monkeypatch.setattr(warm, "PARTS", dict.fromkeys(ends))
    monkeypatch.setattr(warm, "holds", lambda name: False)
    monkeypatch.setattr(
        warm, "_line", lambda name: [sys.executable, "-c", f"import sys; {ends[name]}"]
    )
    assert main(["warm", "--jobs", "1"]) == 0
    told = capsys.readouterr()
    assert told.err == "no GL is left out: no OpenGL\n"
    assert "done: 0 s\n" in told.out
    assert main(["warm", "--jobs", "1", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["parts"] == [
        {"part": "no GL", "new": True, "left_out_because": "no OpenGL"},
        {"part": "done", "new": True, "left_out_because": None},
    ]
    ends["broken"] = "sys.exit(70)"
    monkeypatch.setattr(warm, "PARTS", dict.fromkeys(ends))
    assert main(["warm", "--jobs", "2"]) == 70
    assert "broken is left out: it ended with status 70\n" in capsys.readouterr().err


# Imports what a run imports; the last line says of how many modules Python compiled the source.
IMPORTING = """
import builtins, sys
compile, count = builtins.compile, 0
def counted(source, name, *more, **options):
    global count
    count += str(name).endswith(".py")
    return compile(source, name, *more, **options)
builtins.compile = counted
import visref.cli.run, visref_culling.baselines
print(count)
"""


def compiled_by_imports(prefix: Path) -> int:
    """As in a container that keeps no bytecode. `prefix`: where it is kept all the same."""
    environment = {"PYTHONPYCACHEPREFIX": str(prefix), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        [sys.executable, "-c", IMPORTING],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, **environment},
    )
    return int(done.stdout)


def warmed_with(prefix: Path) -> subprocess.CompletedProcess[str]:
    environment = {"PYTHONPYCACHEPREFIX": str(prefix), "PYTHONDONTWRITEBYTECODE": "1"}
    return subprocess.run(
        [sys.executable, "-m", "visref", "warm"],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, **environment},
    )


def test_bytecode_is_kept_where_python_itself_keeps_none(warmed, tmp_path):
    ours = len(list(Path(visref.__file__).parent.rglob("*.py")))
    before = compiled_by_imports(tmp_path)
    assert before > 100
    assert warmed_with(tmp_path).returncode == 0
    # Of other packages the parts keep it, and those had been run.
    after = compiled_by_imports(tmp_path)
    assert len([file for file in tmp_path.rglob("*.pyc") if "visref" in str(file)]) >= ours
    assert before - after > 100


def test_where_bytecode_cannot_be_kept_nothing_else_fails(warmed, tmp_path):
    (tmp_path / "file").write_text("no folder", encoding="utf-8")
    done = warmed_with(tmp_path / "file")
    assert (done.returncode, done.stderr) == (0, "")


def test_a_part_keeps_the_bytecode_of_all_that_it_loaded(tmp_path, monkeypatch):
    from visref.warming import keep_loaded

    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "of_another.py").write_text("x = 1\n", encoding="utf-8")
    import of_another

    Path(of_another.__cached__).unlink(missing_ok=True)
    keep_loaded()
    assert Path(of_another.__cached__).exists()
