"""The fuzz can fail: readers with planted faults are caught, each by its own kind."""

from __future__ import annotations

import gc
import json
import os
import socket
import subprocess
import sys
import time
import warnings
from dataclasses import replace
from pathlib import Path

import pytest

from tests.fuzz import __main__ as program
from tests.fuzz import rewrite, spoil
from tests.fuzz.find import TARGETS, Case, find, replay, run_case
from tests.fuzz.limits import Folders, Limits, MiB
from tests.fuzz.target import Target, command
from visref.errors import InputError

LIMITS = Limits(seconds=0.3, wall=0.6, memory=64 * MiB, ceiling=256 * MiB)
GOOD = json.dumps({"size": 3, "names": ["a", "b"], "unit": 1.0}).encode()


def checked(data: bytes) -> dict:
    """What a good reader does: it checks every field."""
    try:
        found = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise InputError("not JSON") from error
    if not isinstance(found, dict):
        raise InputError("not an object")
    size = found.get("size")
    if isinstance(size, bool) or not isinstance(size, int) or not 0 <= size < 100:
        raise InputError("size is not one")
    names = found.get("names")
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise InputError("names are not texts")
    return {"size": size, "names": names}


def reads_well(file, folders):
    return checked(file.read_bytes())


def leaves_a_key_unchecked(file, folders):
    try:
        found = json.loads(file.read_bytes())
    except (ValueError, RecursionError) as error:
        raise InputError("not JSON") from error
    if not isinstance(found, dict):
        raise InputError("not an object")
    return found["size"]


def hangs(file, folders):
    if b"-1" in file.read_bytes():
        while True:
            pass
    return reads_well(file, folders)


def waits(file, folders):
    if b"-1" in file.read_bytes():
        time.sleep(30)
    return reads_well(file, folders)


def catches_everything_and_goes_on(file, folders):
    while b"-1" in file.read_bytes():
        try:
            time.sleep(30)
        except Exception:
            continue
    return reads_well(file, folders)


def allocates(file, folders):
    found = checked(file.read_bytes())
    return len(b"x" * (100 * MiB if found["size"] > 3 else 3))


def asks_for_more_than_there_is(file, folders):
    found = checked(file.read_bytes())
    try:
        return bytes(2**40 if found["size"] > 3 else 3)
    except MemoryError as error:
        raise InputError("it needs more memory than there is") from error


def writes_where_a_name_says(file, folders):
    for name in checked(file.read_bytes())["names"]:
        try:
            (folders.out / name).write_text("x")
        except (OSError, ValueError) as error:
            raise InputError("cannot write") from error
    return True


def reads_what_a_name_says(file, folders):
    for name in checked(file.read_bytes())["names"]:
        try:
            Path(name).read_text(errors="replace")
        except (OSError, ValueError):
            continue
    return True


def removes_by_descriptor(file, folders):
    found = checked(file.read_bytes())
    if found["size"] != 3:
        # As shutil does it: a name alone, and the folder that it is in.
        at = os.open(folders.secret.parent, os.O_RDONLY)
        try:
            os.unlink("no such file", dir_fd=at)
        except OSError as error:
            raise InputError("cannot remove it") from error
        finally:
            os.close(at)
    return found


def changes_its_input(file, folders):
    found = checked(file.read_bytes())
    if found["size"] != 3:
        # As a library that Python's events know nothing of.
        subprocess.run([sys.executable, "-c", f"open({str(file)!r}, 'a').write(' ')"], check=True)
    return found


def starts_a_program(file, folders):
    found = checked(file.read_bytes())
    if found["size"] != 3:
        subprocess.run(["true"], check=True)
    return found


def asks_the_network(file, folders):
    found = checked(file.read_bytes())
    if found["size"] != 3:
        with socket.socket() as out:
            out.connect(("127.0.0.1", 9))
    return found


def warns(file, folders):
    found = checked(file.read_bytes())
    if found["size"] != 3:
        warnings.warn("odd", stacklevel=1)
    return found


def refuses_in_two_lines(file, folders):
    try:
        return reads_well(file, folders)
    except InputError:
        raise _TwoLines("first\nsecond") from None


class _TwoLines(InputError):
    def __str__(self) -> str:
        return self.problem


def depends_on_the_order_of_keys(file, folders):
    checked(file.read_bytes())
    return next(iter(json.loads(file.read_bytes())))


def target(read, **more) -> Target:
    return Target("planted", "case.json", lambda: {"good": GOOD}, spoil.json_text, read,
                  rewrite.with_unknown, limits=LIMITS, **more)  # fmt: skip


@pytest.fixture
def folders(tmp_path):
    return Folders(tmp_path)


def test_garbage_is_collected_between_cases(folders):
    def collects(file, folders):
        return gc.isenabled()

    assert run_case(target(collects), Case(GOOD), folders) == (False, None)
    assert gc.isenabled()


def is_found(kind, read, folders):
    """Whether some of the first rounds finds a fault of this kind."""
    return any(
        kind in find(target(read), folders, seed=seed, cases=40, shrink_s=1.0) for seed in range(25)
    )


PLANTED = {
    leaves_a_key_unchecked: "KeyError in test_fuzz_sees.leaves_a_key_unchecked",
    hangs: "too long",
    waits: "too long",
    catches_everything_and_goes_on: "too long",
    allocates: "too much memory",
    asks_for_more_than_there_is: "too much memory, test_fuzz_sees.asks_for_more_than_there_is",
    writes_where_a_name_says: "writes outside (open)",
    reads_what_a_name_says: "reads outside",
    removes_by_descriptor: "writes outside (os.remove)",
    changes_its_input: "changes its input",
    starts_a_program: "starts 'true'",
    asks_the_network: "socket.connect",
    warns: "UserWarning in test_fuzz_sees.warns",
    refuses_in_two_lines: "refusal is not one line, test_fuzz_sees.refuses_in_two_lines",
    depends_on_the_order_of_keys: "reads the same otherwise",
}


@pytest.mark.slow
@pytest.mark.parametrize("read", PLANTED, ids=lambda read: read.__name__)
def test_a_planted_fault_is_found(read, folders):
    assert is_found(PLANTED[read], read, folders)


def test_a_good_reader_has_no_fault(folders):
    assert find(target(reads_well), folders, seed=0, cases=300) == {}


def test_the_limits_are_gone_afterwards(folders):
    _, fault = run_case(target(hangs), Case(b"-1"), folders)
    assert fault.kind == "too long"
    assert len(b"x" * LIMITS.ceiling) == LIMITS.ceiling
    (folders.inside / "x").write_text("outside of a case anybody may write")


def test_errors_that_name_each_other_have_an_end(folders):
    def refuses(file, folders):
        first, second = InputError("first"), InputError("second")
        first.__context__, second.__context__ = second, first
        raise first

    assert run_case(target(refuses), Case(GOOD), folders) == (None, None)


def test_what_is_found_is_minimised(folders):
    found = find(target(leaves_a_key_unchecked), folders, seed=0, cases=300)
    (one,) = found.values()
    assert len(one.case.data) <= len(GOOD)


def test_a_kind_that_is_known_is_no_news(folders):
    planted, kind = target(warns), PLANTED[warns]
    assert kind in find(planted, folders, seed=0, cases=100)
    assert not find(planted, folders, seed=0, cases=100, known={kind})


def test_the_same_seed_gives_the_same_cases(folders):
    def cases():
        seen = []

        def noted(target, case, folders):
            seen.append(case)
            return None, None

        find(TARGETS["glb"], folders, seed=5, cases=30, run=noted)
        return seen

    assert cases() == cases()


def test_a_found_case_is_found_again_from_its_file(folders, tmp_path):
    for read in (leaves_a_key_unchecked, depends_on_the_order_of_keys):
        planted = target(read)
        found = find(planted, folders, seed=0, cases=300)
        for kind, one in found.items():
            file = one.write(tmp_path / "corpus", ".json")
            assert replay(planted, file, folders).kind == kind
            assert replay(target(reads_well), file, folders) is None


def test_a_command_that_breaks_down_is_named_by_its_last_frame(folders, monkeypatch):
    def breaks(given):
        return {}["no such key"]

    monkeypatch.setattr("visref.cli.objects.run", breaks)
    spoilt = target(lambda file, folders: command(["objects", "x.glb"]))
    _, fault = run_case(spoilt, Case(GOOD), folders)
    assert fault.kind.startswith("status 70: KeyError in ")


def test_text_that_drives_a_terminal_is_seen(folders, monkeypatch):
    def drives(given):
        sys.stdout.write("\x1b[31m")
        return 0

    monkeypatch.setattr("visref.cli.objects.run", drives)
    planted = target(lambda file, folders: command(["objects", "x"]))
    _, fault = run_case(planted, Case(GOOD), folders)
    assert fault.kind == "prints '\\x1b'"


@pytest.mark.slow
def test_the_program_says_what_it_found_and_how_to_see_it_again(monkeypatch, capsys, tmp_path):
    planted = replace(target(leaves_a_key_unchecked), name="planted")
    monkeypatch.setitem(program.TARGETS, "planted", planted)
    monkeypatch.setattr(program, "CORPUS", tmp_path / "corpus")
    monkeypatch.setattr(program, "GROWING", tmp_path / "growing")
    assert program.main(["planted", "3", str(tmp_path / "current")]) == 1
    line = capsys.readouterr().out.strip()
    file = Path(line.split()[-1])
    assert line.startswith("planted: KeyError in ")
    assert f"python -m tests.fuzz planted {file}" in line
    # Cases that made a new step are kept; visref's readers were not asked here.
    assert (tmp_path / "growing" / "planted").is_dir()
    assert program.main(["planted", str(file)]) == 1
    assert "KeyError" in capsys.readouterr().out


@pytest.mark.slow
def test_a_reader_that_kills_the_process_is_found(monkeypatch, capfd, tmp_path):
    monkeypatch.setattr(program, "CORPUS", tmp_path / "corpus")
    dies = tmp_path / "python"
    dies.write_text('#!/bin/sh\nfor last; do :; done\nprintf spoilt > "$last"\nkill -SEGV $$\n')
    dies.chmod(0o755)
    monkeypatch.setattr(program.sys, "executable", os.fspath(dies))
    assert program.main(["glb", "1"]) == 1
    assert "glb: dies of signal 11: " in capfd.readouterr().out
    (file,) = (tmp_path / "corpus" / "glb").iterdir()
    assert file.read_bytes() == b"spoilt"
