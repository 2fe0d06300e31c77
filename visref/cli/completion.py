"""visref completion: let the shell complete visref's commands and options, through argcomplete.

The shell asks visref itself, so that what is installed beside it (cullers, engines, scenes) is
offered too.
"""

from __future__ import annotations

import argparse
import os
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

from visref.cli.terminal import OUT
from visref.errors import InputError
from visref.judging.status import Exit
from visref.registry import CULLERS, ENGINES, SCENES, available

SHELLS = {
    "bash": 'eval "$(visref completion bash)"   # in ~/.bashrc',
    "zsh": 'eval "$(visref completion zsh)"   # in ~/.zshrc',
    "fish": "visref completion fish > ~/.config/fish/completions/visref.fish",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("shell", choices=list(SHELLS))
    parser.epilog = "; ".join(f"{shell}: {line}" for shell, line in SHELLS.items())


def run(given: argparse.Namespace) -> Exit:
    OUT.lines(_argcomplete().shellcode(["visref"], shell=given.shell))
    return Exit.NO_VIOLATION


def complete(parser_of: Callable[[str | None], argparse.ArgumentParser]) -> int:
    """Answer the shell, which asks by environment variables as argcomplete has it; never returns
    where it asks rightly. `parser_of`: what `visref.cli.main` parses a command with."""
    line = os.environ.get("COMP_LINE", "")[: int(os.environ.get("COMP_POINT", "0"))]
    try:
        words = shlex.split(line)
    except ValueError:  # a quotation mark that is still open
        words = line.split()
    if not line.endswith(" "):
        words = words[:-1]
    asked = next((word for word in words[1:] if not word.startswith("-")), None)
    parser = parser_of(asked)
    for action in _actions(parser):
        if action.dest in _OFFERED:
            action.completer = _Offered(_OFFERED[action.dest])  # type: ignore[attr-defined]
    _argcomplete().autocomplete(parser)
    return Exit.BAD_INPUT


def _argcomplete() -> Any:
    try:
        import argcomplete
    except ImportError as error:
        raise InputError(
            "argcomplete is not installed", fix="install it with `pip install argcomplete`"
        ) from error
    return argcomplete


def _actions(parser: argparse.ArgumentParser) -> list[argparse.Action]:
    found = []
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                found += _actions(command)
        else:
            found.append(action)
    return found


# What is found by name, by the argument's.
_OFFERED = {"culler": CULLERS, "engine": ENGINES, "scene": SCENES}


class _Offered:
    """The installed names of a group; of scenes, files too."""

    def __init__(self, group: str) -> None:
        self._group = group

    def __call__(self, prefix: str, **_: Any) -> list[str]:
        names = [name for name in available(self._group) if name.startswith(prefix)]
        return names + _files(prefix) if self._group == SCENES else names


def _files(prefix: str) -> list[str]:
    folder, _, start = prefix.rpartition("/")
    where = Path(f"{folder}/" if "/" in prefix else ".")
    if not where.is_dir():
        return []
    before = f"{folder}/" if "/" in prefix else ""
    return [
        f"{before}{one.name}{'/' if one.is_dir() else ''}"
        for one in sorted(where.iterdir())
        if one.name.startswith(start)
    ]
