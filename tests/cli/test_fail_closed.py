"""Statuses 0 and 1 are a verdict's; whatever else ends the program has another."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from tests.cli.test_cli import record, write_scene
from visref.cli import check
from visref.cli.main import main

# What a library may do as it is imported. Numba raises where it finds no place for its cache.
IMPORTED = {
    "raises": "raise RuntimeError('cannot cache function: no locator available')",
    "leaves": "import sys; sys.exit(0)",
    "interrupts": "raise KeyboardInterrupt",
    "kills": "import os, signal; os.kill(os.getpid(), signal.SIGTERM)",
}
STATUS = {"raises": 70, "leaves": 70, "interrupts": 130, "kills": -15}


@pytest.mark.parametrize("how", IMPORTED)
@pytest.mark.parametrize("library", ["argparse", "rich", "numba"])
def test_whatever_a_library_does_as_it_is_imported_is_no_verdict(how, library, tmp_path):
    scene, path = write_scene(tmp_path)
    drawn = record(tmp_path, ["front"], ["front"])
    arguments = ["check", scene, "--path", path, "--visible", drawn, "--out", str(tmp_path / "o")]
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / f"{library}.py").write_text(IMPORTED[how] + "\n")
    program = (
        f"import sys; sys.path.insert(0, {str(tmp_path / 'lib')!r})\n"
        "for name in [name for name in sys.modules if name.startswith('argparse')]:\n"
        "    del sys.modules[name]\n"
        "from visref.cli.entry import main\n"
        "sys.exit(main())\n"
    )
    ran = subprocess.run(
        [sys.executable, "-P", "-c", program, *arguments], capture_output=True, text=True
    )
    assert ran.returncode == STATUS[how], ran.stderr
    if how == "interrupts":
        assert len(ran.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    "error", [SystemExit(0), SystemExit(1), SystemExit(None), GeneratorExit(), MemoryError()]
)
def test_whatever_a_command_raises_is_no_verdict(error, tmp_path, monkeypatch, capsys):
    def leaves(*_, **__):
        raise error

    monkeypatch.setattr(check, "inputs_of", leaves)
    scene, path = write_scene(tmp_path)
    drawn = record(tmp_path, ["front"], ["front"])
    arguments = ["check", scene, "--path", path, "--visible", drawn, "--out", str(tmp_path / "o")]
    assert main(arguments) == 70
    assert "this is a bug in it, not a verdict" in capsys.readouterr().err


def test_the_status_survives_a_standard_output_that_is_gone(tmp_path):
    """Python itself would end with status 120 where it cannot flush."""
    scene, path = write_scene(tmp_path)
    drawn = record(tmp_path, ["front"], ["front"])
    command = [sys.executable, "-m", "visref", "check", scene, "--path", path]
    command += ["--visible", drawn, "--out", str(tmp_path / "o"), "--pictures", "0"]
    with open("/dev/full", "w") as full:
        ran = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True)
    assert ran.returncode == 1, ran.stderr
    assert (tmp_path / "o" / "verdict.json").is_file()
    reading, writing = os.pipe()
    os.close(reading)
    ran = subprocess.run(command, stdout=writing, stderr=subprocess.PIPE, text=True)
    os.close(writing)
    assert ran.returncode == 1, ran.stderr


def test_help_and_wrong_arguments_keep_their_statuses():
    for arguments, status in ((["--help"], 0), (["run", "--help"], 0), (["run"], 2), (["?"], 2)):
        with pytest.raises(SystemExit) as left:
            main(arguments)
        assert left.value.code == status
