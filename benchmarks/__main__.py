"""Measure, write the JSON and make the page: `python -m benchmarks [--only NAME …]`."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import pytest

from benchmarks.page import HISTORY, PAGE, page, tables

FOLDER = Path(__file__).parent
# What is not among the benchmarks of `make bench`, for it takes long: only by its name.
LONG = "table"


def arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument(
        "--only",
        action="append",
        metavar="NAME",
        help="benchmarks whose names hold this (cast, run, check, …); the tables are printed, and"
        " history and page stay as they are; repeat for several",
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="default: in the history")
    parser.add_argument("--page", action="store_true", help="make the page anew, measure nothing")
    parser.add_argument("--quick", action="store_true", help="tiny inputs, one round: a rehearsal")
    parser.add_argument("--scene", type=Path, help="run and check this file, not a generated scene")
    parser.add_argument("--before", type=Path, help="`visref` of another checkout, to compare with")
    return parser


def main(words: list[str] | None = None) -> int:
    given = arguments().parse_args(words)
    if given.page:
        PAGE.write_text(page(sorted(HISTORY.glob("*.json"))), encoding="utf-8")
        return 0
    partly = bool(given.only or given.quick or given.scene)
    file = given.json or FOLDER.parent / "bench-out" / "benchmarks.json"
    file.parent.mkdir(parents=True, exist_ok=True)
    chosen = " or ".join(given.only or [f"not {LONG}"])
    options = ["-c", str(FOLDER / "pytest.ini"), "--rootdir", str(FOLDER.parent), str(FOLDER)]
    options += ["-q", "-rs", "-k", chosen]
    options += ["--benchmark-columns=median,rounds", f"--benchmark-json={file.resolve()}"]
    options += ["--quick"] if given.quick else []
    for name in ("scene", "before"):
        value = getattr(given, name)
        options += [f"--{name}", str(value.resolve())] if value else []
    status = int(pytest.main(options))
    if status:
        return status
    measured = json.loads(file.read_text(encoding="utf-8"))
    if partly or given.json:
        print("\n".join(tables(measured)))
        return 0
    commit = str(measured["commit_info"].get("id"))[:12]
    kept = HISTORY / f"{measured['datetime'][:19].replace(':', '')}-{commit}.json"
    kept.write_text(json.dumps(measured, indent=1) + "\n", encoding="utf-8")
    PAGE.write_text(page(sorted(HISTORY.glob("*.json"))), encoding="utf-8")
    print(f"{kept.name} and {PAGE.name} are written")
    return 0


if __name__ == "__main__":
    sys.exit(main())
