"""visref doctor: say what works on this machine."""

from __future__ import annotations

import argparse
from dataclasses import asdict

from visref.cli.manners import GREEN, YELLOW, add_json
from visref.cli.terminal import OUT, progress
from visref.judging.status import Exit
from visref.trials.doctor import doctor


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_json(parser)


def run(given: argparse.Namespace) -> Exit:
    with progress() as shown:
        shown.add_task("trying what is installed", total=None)
        checks = doctor()
    works = any(check.works and check.is_engine for check in checks)
    if given.json:
        OUT.json([asdict(check) for check in checks])
        return Exit.NO_VIOLATION if works else Exit.NOTHING_JUDGED
    for check in checks:
        mark = "ok" if check.works else check.otherwise
        colour = GREEN if check.works else YELLOW
        OUT.line(f"{mark:7} {check.name}: {check.detail}", colour=colour, of=mark)
    if works:
        OUT.remark("Next: `visref demo`, which judges four cullers on a generated city")
    return Exit.NO_VIOLATION if works else Exit.NOTHING_JUDGED
