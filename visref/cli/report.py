"""visref report: make a page from run folders."""

from __future__ import annotations

import argparse
from pathlib import Path

from visref.cli.manners import add_json
from visref.cli.terminal import OUT
from visref.doing import doing
from visref.errors import InputError
from visref.judging.status import Exit
from visref.report.bench_folder import is_bench
from visref.report.board import write_board
from visref.report.run_tables import write_run_tables
from visref.report.words import overall
from visref.report.writing import write_report
from visref.run_folder.read import read_run


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "runs", nargs="+", type=Path, metavar="RUN", help="a run folder, or one of `visref bench`"
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help="a page, JUnit XML and Markdown")
    parser.add_argument(
        "--scene",
        metavar="SCENE",
        help="the scene that the run judged, a file or a generated one: the page gets a view of it "
        "in three dimensions, with each frame's culling frozen",
    )
    parser.add_argument(
        "--tables",
        type=Path,
        metavar="DIR",
        help="tables of the runs as Markdown, LaTeX and CSV",
    )
    parser.add_argument(
        "--board",
        type=Path,
        metavar="FILE.md",
        help="one table of all methods on all scenes, a run being a scene",
    )
    add_json(parser, "print what was written, and the status, for programs")


def run(given: argparse.Namespace) -> Exit:
    if given.out is None and given.tables is None and given.board is None:
        raise InputError("there is nowhere to write to", fix="give --out, --tables or --board")
    if given.scene is not None and given.out is None:
        raise InputError("--scene adds a view to the page", fix="give --out too")
    page = None
    if given.out is not None:
        with doing("writing the page"):
            page = write_report(given.runs, given.out, scene=given.scene)
    whole = given.tables is not None or given.board is not None
    folders = [folder for folder in given.runs if not is_bench(folder)]
    runs = [read_run(folder, objects=whole) for folder in folders]
    tables = [] if given.tables is None else list(write_run_tables(runs, given.tables))
    if given.board is not None:
        write_board(runs, given.board)
    status, exit_ = overall(runs)
    if given.json:
        said = {"status": status, "exit_status": int(exit_), "tables": [str(one) for one in tables]}
        files = {"page": page, "board": given.board}
        OUT.json(said | {name: None if file is None else str(file) for name, file in files.items()})
    for file in tables:
        OUT.remark(f"The tables: {file}")
    if given.board is not None:
        OUT.remark(f"The board: {given.board}")
    if page is not None:
        OUT.remark(f"The report: {page}. Next: open it in a browser")
    return exit_
