"""What a page shows, run as it stands there: its fenced blocks, in their order, in one folder."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

# What installs, or needs what only installing brings: `test_installed.py` tries it.
_INSTALLS = ("pip ", "pipx ", "uv ", "uvx ", "podman ", "make ")
_FENCE = re.compile(r"^( *)```(\w*)\n(.*?)^\1```", re.DOTALL | re.MULTILINE)
_STATUS = re.compile(r"\s+# exit status (\d+)$")


@dataclass(frozen=True)
class Block:
    language: str
    text: str


@dataclass(frozen=True)
class Line:
    """A command as a page shows it, and the exit status that it says there."""

    command: str
    status: int


def blocks(page: str) -> list[Block]:
    """Every fenced block of a page, without the indentation of a list that it is in."""
    found = []
    for indent, language, text in _FENCE.findall(page):
        lines = [line.removeprefix(indent) for line in text.splitlines()]
        found.append(Block(language, "\n".join(lines) + "\n"))
    return found


def lines(block: Block) -> list[Line]:
    """The commands of a `sh` block that are to be run: one on each line, and not what installs."""
    found = []
    for line in block.text.splitlines():
        status = _STATUS.search(line)
        command = line[: status.start()] if status else line
        if command and not command.startswith(_INSTALLS):
            found.append(Line(command, int(status[1]) if status else 0))
    return found


def run(page: str, folder: Path, languages: tuple[str, ...] = ("sh", "python")) -> list[str]:
    """Run a page's blocks in a folder; returns the commands, each of which ended as the page says.

    Raises AssertionError for the first that ended otherwise, or had something to say of a fault.
    """
    here = str(Path(sys.executable).parent)
    environment = {**os.environ, "PATH": os.pathsep.join([here, os.environ["PATH"]])}
    ran = []
    for block in blocks(page):
        if block.language not in languages:
            continue
        python = [Line(f"python - <<'PY'\n{block.text}PY", 0)]
        for line in lines(block) if block.language == "sh" else python:
            done = subprocess.run(
                ["bash", "-c", line.command],
                cwd=folder,
                env=environment,
                capture_output=True,
                text=True,
                check=False,
            )
            said = f"{line.command}\n{done.stdout}\n{done.stderr}"
            assert done.returncode == line.status, said
            assert "Traceback" not in done.stderr, said
            ran.append(line.command)
    return ran
