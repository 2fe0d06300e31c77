"""visref batch: many scenes, paths and cullers, from one file."""

from __future__ import annotations

import argparse
from contextlib import ExitStack
from pathlib import Path

from visref.batch import Ended, Run, read_batch, run_jobs, write_results
from visref.batch.results import HEADINGS
from visref.batch.running import BATCH_FOLDER, PAGE, RECORD
from visref.cli.arguments import add_dask_arguments
from visref.cli.manners import MANNERS
from visref.cli.terminal import ERRORS, OUT
from visref.errors import InputError
from visref.files import make_folder, refuse_inputs
from visref.numerals import whole_number
from visref.report.words import GLYPHS
from visref.run_folder.inside import json_inside
from visref.wording import counted

_SAID = {0: "no violation found", 1: "violation", 3: "nothing could be judged"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=Path, metavar="FILE", help="what to run (TOML)")
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="continues with what is there"
    )
    parser.add_argument(
        "--workers",
        type=whole_number,
        metavar="N",
        help="processes for each run; with --dask local, of the cluster",
    )
    add_dask_arguments(parser)
    parser.add_argument(
        "--jobs",
        type=whole_number,
        metavar="N",
        help="runs at a time (default 1; 2 on a cluster, so that it never waits for one)",
    )
    parser.add_argument("--json", action="store_true", help="print batch.json, and no table")
    kept = "what was judged is kept, and the same command continues from there"
    parser.set_defaults(interrupted=kept)


def run(given: argparse.Namespace) -> int:
    jobs = read_batch(given.file)
    for name in ("jobs", "workers", "dask_frames"):
        if (number := getattr(given, name)) is not None and number < 1:
            problem = f"--{name.replace('_', '-')} is {number}"
            raise InputError(problem, fix="give 1 or more")
    _check_out(given.out, given.file)
    out = given.out.resolve()
    done = 0

    def on_ended(ended: Ended) -> None:
        nonlocal done
        done += 1
        said = ended.error or _SAID.get(ended.status, f"status {ended.status}")
        if not MANNERS.quiet:
            (ERRORS if given.json else OUT).line(f"[{done}/{len(jobs)}] {ended.job.name}: {said}")

    with ExitStack() as closing:
        more = _more(given, closing)
        at_once = given.jobs or (1 if given.dask is None else 2)
        run = Run(given.file.resolve().parent, out, more, min(at_once, len(jobs)))
        results = write_results(run_jobs(jobs, run, on_ended), run)
    if given.json:
        OUT.json(results.record)
        return results.status
    OUT.line()
    OUT.table(HEADINGS, results.rows, left=("job", "culler", "verdict"))
    without = sum(not job["cullers"] for job in results.record["jobs"])
    if without:
        OUT.line(
            f"{GLYPHS['violation']} {counted(without, 'run')} came to no verdict; what each said "
            f"is in {given.out / 'logs'}"
        )
    OUT.remark()
    OUT.remark(f"The page: {given.out / PAGE}. Next: open it in a browser")
    return results.status


def _more(given: argparse.Namespace, closing: ExitStack) -> tuple[str, ...]:
    """Arguments of each run. A cluster of our own is one for all, until `closing`."""
    if given.dask is None:
        for name in ("dask_scene", "dask_frames"):
            if getattr(given, name) is not None:
                option = f"--{name.replace('_', '-')}"
                raise InputError(f"{option} is given, and no --dask", fix="give both, or neither")
        return () if given.workers is None else (f"--workers={given.workers}",)
    # Dask is imported only where it is asked for.
    from visref.cluster import LOCAL, connected
    from visref.threads import available_threads

    workers = given.workers
    if given.dask == LOCAL and workers is None:
        workers = available_threads()
    client = closing.enter_context(connected(given.dask, workers))
    address = client.scheduler.address if given.dask == LOCAL else given.dask
    more = [f"--dask={address}"]
    if given.dask_scene is not None:
        more.append(f"--dask-scene={given.dask_scene}")
    if given.dask_frames is not None:
        more.append(f"--dask-frames={given.dask_frames}")
    return tuple(more)


def _check_out(out: Path, file: Path) -> None:
    """Make the batch's folder, or go on in one. Raises InputError where it is another's."""
    refuse_inputs(out, [file])
    make_folder(out)
    if not any(out.iterdir()):
        return
    if (out / RECORD).exists():
        record = json_inside(out, RECORD, "name another folder")
        if BATCH_FOLDER.wrote(record) is not None:
            return
    elif {one.name for one in out.iterdir()} <= {"runs", "pages", "stamps", "logs"}:
        # A batch that was ended before its first one had come to its end.
        return
    raise InputError(
        "cannot write here: it holds what is no batch", source=str(out), fix="name a new folder"
    )
