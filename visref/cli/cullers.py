"""visref cullers: list cullers, their options and promises."""

from __future__ import annotations

import argparse
from typing import Any, cast

from visref.cli.terminal import OUT
from visref.culler import Culler
from visref.judging.status import Exit
from visref.registry import CULLERS, available, load_entry


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="for programs")


def run(given: argparse.Namespace) -> Exit:
    cullers = [
        (name, cast(type[Culler], load_entry(CULLERS, name, kind="culler")))
        for name in available(CULLERS)
    ]
    if given.json:
        OUT.json([_row(name, culler) for name, culler in cullers])
        return Exit.NO_VIOLATION
    for name, culler in cullers:
        promise = culler.promise
        OUT.line(f"{name}  ({promise.value}: {promise.statement})")
        OUT.line(f"    {culler.summary}")
        for option, about in culler.options.items():
            choices = "|".join(map(str, about.choices)) or type(about.default).__name__
            line = f"    {option}={choices} (default {about.default}): {about.help}"
            OUT.line(line)
    return Exit.NO_VIOLATION


def _row(name: str, culler: type[Culler]) -> dict[str, Any]:
    return {
        "name": name,
        "summary": culler.summary,
        "class": culler.promise.value,
        "promise": culler.promise.statement,
        "options": {
            option: {
                "default": about.default,
                "choices": list(about.choices),
                "help": about.help,
            }
            for option, about in culler.options.items()
        },
    }
