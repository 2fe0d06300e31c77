"""visref doctor: say what works on this machine."""

from __future__ import annotations

import argparse

from visref.cli.terminal import OUT
from visref.judging.status import Exit
from visref.trials.doctor import doctor


def add_arguments(parser: argparse.ArgumentParser) -> None:
    pass


def run(given: argparse.Namespace) -> Exit:
    works = False
    for check in doctor():
        mark = f"{'ok' if check.works else check.otherwise:7}"
        works = works or (check.works and check.is_engine)
        OUT.line(f"{mark} {check.name}: {check.detail}")
    return Exit.NO_VIOLATION if works else Exit.NOTHING_JUDGED
