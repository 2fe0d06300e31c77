"""visref scenes: list the scenes that can be generated, and their options."""

from __future__ import annotations

import argparse
import inspect
import sys
from collections.abc import Callable
from typing import Any, cast

from visref.cli.manners import add_json
from visref.cli.terminal import ERRORS, OUT
from visref.generators import options_of
from visref.judging.status import Exit
from visref.registry import SCENES, available, load_entry


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_json(parser)


def run(given: argparse.Namespace) -> Exit:
    scenes = [
        _row(name, cast(Callable[..., Any], load_entry(SCENES, name, kind="scene")))
        for name in available(SCENES)
    ]
    if given.json:
        OUT.json(scenes)
        return Exit.NO_VIOLATION
    for scene in scenes:
        options = ",".join(f"{name}={value}" for name, value in scene["options"].items())
        OUT.line(f"{scene['name']}:{options}" if options else scene["name"])
        OUT.line(f"    {scene['summary']}")
        OUT.line(f"    {scene['size']}")
    # A listing goes on to other programs too.
    ERRORS.remark(
        "Options are shown with their defaults. Next: `visref run city:scale=0.05 --culler "
        "frustum --out run`, or write one: `python -m visref_datasets_gen city --out data`"
    )
    return Exit.NO_VIOLATION


def _row(name: str, make: Callable[..., Any]) -> dict[str, Any]:
    about = inspect.getdoc(sys.modules[make.__module__]) or ""
    return {
        "name": name,
        "summary": _first_line(about),
        "size": _first_paragraph(inspect.getdoc(make) or ""),
        "options": {option: one.default for option, one in options_of(make).items()},
    }


def _first_paragraph(text: str) -> str:
    """Without what it raises, which is for programmers."""
    return " ".join(text.partition("\n\n")[0].split()).partition(" Raises ")[0]


def _first_line(text: str) -> str:
    return text.partition("\n")[0]
