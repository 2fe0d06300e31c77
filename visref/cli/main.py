"""The command line: parsing and printing only. What it calls lives in the other modules."""

from __future__ import annotations

import argparse
import json
import os
import sys
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from visref.cli import commands
from visref.culler import Culler, Promise
from visref.engines import engine_names
from visref.errors import InputError, NothingToJudge
from visref.inputs import Inputs, open_inputs
from visref.judging.outcome import RunOutcome
from visref.judging.referee import Job, JudgedFrame
from visref.judging.status import Exit
from visref.papers import load_paper, paper_names
from visref.papers import table as papers
from visref.report.tables import HEADINGS, VERDICTS, table_lines
from visref.tables import measure, write_tables
from visref.trials.hardcases_page import culler_summary
from visref.visibility import FrameTruth, ObjectVisibility


class _Out(Console):
    """Standard output. Who stops reading (`| head`) misses the rest and changes no status."""

    def on_broken_pipe(self) -> None:
        self.quiet = True
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


# Names and specs are printed as they are: `:b:` in one is no emoji.
_ERRORS = Console(stderr=True, highlight=False, soft_wrap=True, emoji=False)
# A table in a log or a pipe is not folded to a terminal that is not there.
_OUT = _Out(
    highlight=False, soft_wrap=True, emoji=False, width=None if sys.stdout.isatty() else 200
)


# Statuses of a run that came to no end, clear of every `Exit`: by convention, 128 + SIGINT and
# the EX_SOFTWARE of sysexits.h.
_INTERRUPTED = 130
_BROKE_DOWN = 70


class _Bar:
    """Progress over frames, as a run's listener; silent when standard error is no terminal."""

    def __init__(self, progress: Progress, frames: int | None) -> None:
        self._progress = progress
        self._task = progress.add_task("judging", total=frames)

    def on_truth(self, frame: int, truth: FrameTruth, seen: ObjectVisibility, ms: float) -> None:
        pass

    def on_verdict(self, job: Job, judged: JudgedFrame) -> None:
        pass

    def on_frame_done(self, frame: int) -> None:
        self._progress.advance(self._task)


def _bar() -> Progress:
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        console=_ERRORS,
        transient=True,
        disable=not sys.stderr.isatty(),
    )


@contextmanager
def _progress(frames: int | None) -> Iterator[_Bar]:
    with _bar() as progress:
        yield _Bar(progress, frames)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns its exit status (see `visref.judging.status.Exit`)."""
    given = _parser().parse_args(arguments)
    command: Callable[[argparse.Namespace], Exit] = given.command
    try:
        return int(command(given))
    except InputError as error:
        _ERRORS.print(f"error: {error}", markup=False)
        return int(Exit.BAD_INPUT)
    except NothingToJudge as error:
        _ERRORS.print(f"nothing could be judged: {error}", markup=False)
        return int(Exit.NOTHING_JUDGED)
    except KeyboardInterrupt:
        _ERRORS.print(f"interrupted; {given.interrupted}", markup=False)
        return _INTERRUPTED
    except OSError as error:
        # A full disk, say: nobody's bug.
        _ERRORS.print(f"error: {error}", markup=False)
        return int(Exit.BAD_INPUT)
    except Exception:
        # Python's own status for it is 1, which says "violation".
        traceback.print_exc()
        _ERRORS.print("visref broke down: this is a bug in it, not a verdict", markup=False)
        return _BROKE_DOWN


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="visref",
        description="Is your occlusion culler safe, and what does it cost?",
        epilog="Exit status: 0 no violation found, 1 violation, 2 bad input, 3 nothing judged.",
    )
    parser.set_defaults(interrupted="nothing was written")
    commands_ = parser.add_subparsers(required=True, metavar="COMMAND")

    demo = commands_.add_parser("demo", help="judge four cullers on a generated city")
    demo.add_argument("--out", type=Path, default=Path("demo"), metavar="DIR")
    demo.set_defaults(command=_demo)

    truth = commands_.add_parser("truth", help="cast who owns which samples, to a Parquet file")
    _scene_arguments(truth)
    truth.add_argument("--out", type=Path, required=True, metavar="FILE.parquet")
    truth.add_argument(
        "--geometric",
        type=Path,
        metavar="FILE.parquet",
        help="look between the samples too: who is visible anywhere in the image, with a witness",
    )
    truth.set_defaults(command=_truth)

    run = commands_.add_parser("run", help="judge cullers on a scene and a camera path")
    _scene_arguments(run)
    _judging_arguments(run)
    run.add_argument(
        "--culler",
        action="append",
        required=True,
        metavar="NAME[:option=value,…]",
        help="repeat for several; `visref cullers` lists them; module:Class is your own",
    )
    run.add_argument(
        "--image-check",
        action="store_true",
        help="redraw each drawn set by GL and compare it with the unculled picture",
    )
    run.set_defaults(command=_run)

    check = commands_.add_parser("check", help="judge an engine's recorded visible sets")
    _scene_arguments(check)
    _judging_arguments(check)
    check.add_argument(
        "--visible", type=Path, required=True, metavar="FILE", help=".jsonl, .csv or .parquet"
    )
    check.add_argument(
        "--promise", choices=[p.value for p in Promise], default=Promise.CONSERVATIVE.value
    )
    check.add_argument(
        "--raster",
        metavar="snap=PX,depth=BITS",
        help="the engine's rasteriser: greatest vertex snap in pixels, depth buffer bits or float",
    )
    check.set_defaults(command=_check)

    bench = commands_.add_parser("bench", help="speed against error: where to stop paying")
    _scene_arguments(bench)
    bench.add_argument("--out", type=Path, required=True, metavar="DIR")
    # Every engine is measured, against this one.
    bench.set_defaults(command=_bench, engine="exact")

    report = commands_.add_parser("report", help="make a page from run folders")
    report.add_argument(
        "runs", nargs="+", type=Path, metavar="RUN", help="a run folder, or one of `visref bench`"
    )
    report.add_argument("--out", type=Path, required=True, metavar="DIR")
    report.set_defaults(command=_report)

    tables = commands_.add_parser(
        "tables", help="measure the papers' tables again, beside the published numbers"
    )
    tables.add_argument(
        "--paper",
        action="append",
        metavar="NAME",
        help=f"repeat for several; {', '.join(paper_names())} (default: all)",
    )
    tables.add_argument(
        "--frames", type=int, metavar="N", help="so many frames of each path, for a quick look"
    )
    tables.add_argument(
        "--large", action="store_true", help="the 34-million-triangle city too: some 12 GiB"
    )
    tables.add_argument("--threads", type=int, metavar="N", help="default: all cores")
    tables.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="DIR",
        help="goes on with what is there",
    )
    kept = "what was measured is kept, and the same command goes on from there"
    tables.set_defaults(command=_tables, interrupted=kept)

    explain = commands_.add_parser("explain", help="replay a witness from the run folder alone")
    explain.add_argument("run", type=Path, metavar="RUN")
    explain.add_argument("--frame", type=int, required=True, metavar="F")
    explain.add_argument("--object", required=True, metavar="O", help="object id or name")
    explain.add_argument("--culler", metavar="NAME", help="default: every culler that missed it")
    explain.add_argument(
        "--picture", type=Path, metavar="FILE.png", help="default: beside the witness in RUN"
    )
    explain.set_defaults(command=_explain)

    objects = commands_.add_parser("objects", help="list a scene's object ids and names")
    objects.add_argument("scene", metavar="SCENE")
    objects.add_argument("--json", action="store_true", help="for programs")
    objects.set_defaults(command=_objects)

    cullers = commands_.add_parser("cullers", help="list cullers, their options and promises")
    cullers.add_argument("--json", action="store_true", help="for programs")
    cullers.set_defaults(command=_cullers)

    hard = commands_.add_parser(
        "hardcases", help="try engines and cullers on the hard numerical cases"
    )
    hard.add_argument(
        "--engine", action="append", metavar="NAME[:option=value]", help="repeat for several"
    )
    hard.add_argument(
        "--culler", action="append", metavar="NAME[:option=value,…]", help="repeat for several"
    )
    hard.add_argument("--only", action="append", metavar="CASE", help="repeat for several")
    hard.add_argument("--json", action="store_true", help="for programs")
    hard.add_argument("--out", type=Path, metavar="FILE.md", help="write a page as well")
    hard.set_defaults(command=_hardcases)

    doctor = commands_.add_parser("doctor", help="say what works on this machine")
    doctor.set_defaults(command=_doctor)
    return parser


def _scene_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "scene",
        metavar="SCENE",
        help="a file (GLB, glTF, OBJ, PLY, …) or a generated scene (city:scale=0.05)",
    )
    parser.add_argument(
        "--path", metavar="PATH", help="a camera path (JSON), or a glTF file with cameras"
    )
    parser.add_argument("--frames", metavar="A:B:STEP", help="a part of the path, as a slice")
    parser.add_argument(
        "--engine",
        default=commands.DEFAULT_ENGINE,
        metavar="NAME[:option=value]",
        help=f"{', '.join(engine_names())} (default {commands.DEFAULT_ENGINE})",
    )
    parser.add_argument("--threads", type=int, metavar="N", help="default: all cores")
    parser.add_argument(
        "--cull-backfaces",
        action="store_true",
        help="triangles whose material is not double-sided show their front only",
    )
    parser.add_argument(
        "--lenient", action="store_true", help="drop triangles with a NaN or infinite vertex"
    )


def _judging_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="the run folder")
    parser.add_argument(
        "--truth",
        type=Path,
        metavar="FILE",
        help="a truth file, instead of casting again; its engine looks at what was missed",
    )
    parser.add_argument(
        "--pictures", type=int, default=4, metavar="N", help="frames to draw (default 4)"
    )


def _inputs(given: argparse.Namespace) -> Inputs:
    return open_inputs(
        given.scene,
        path=given.path,
        frames=given.frames,
        engine=given.engine,
        threads=given.threads,
        cull_backfaces=given.cull_backfaces,
        lenient=given.lenient,
    )


def _demo(given: argparse.Namespace) -> Exit:
    with _progress(commands.DEMO_FRAMES) as bar:
        outcome, page = commands.demo(given.out, [bar])
    _print_outcome(outcome)
    _OUT.print(
        "\nThe last culler is broken on purpose, so that you see what a violation looks like."
        f"\nThe report: {page}",
        markup=False,
    )
    return Exit.NO_VIOLATION


def _truth(given: argparse.Namespace) -> Exit:
    inputs = _inputs(given)
    with _progress(len(inputs.frames)) as bar:
        summary = commands.cast_truth(inputs, given.out, [bar], geometric=given.geometric)
    _OUT.print(summary, markup=False)
    return Exit.NO_VIOLATION


def _run(given: argparse.Namespace) -> Exit:
    cullers = commands.make_cullers(given.culler)
    return _judge(given, _inputs(given), cullers, image_check=given.image_check)


def _check(given: argparse.Namespace) -> Exit:
    inputs = _inputs(given)
    replay = commands.replay_of(inputs, given.visible, Promise(given.promise), given.raster)
    return _judge(given, inputs, [(given.visible.name, replay)])


def _judge(
    given: argparse.Namespace,
    inputs: Inputs,
    cullers: Sequence[tuple[str, Culler]],
    *,
    image_check: bool = False,
) -> Exit:
    with _progress(len(inputs.frames)) as bar:
        outcome = commands.run(
            inputs,
            cullers,
            given.out,
            truth=given.truth,
            pictures=given.pictures,
            image_check=image_check,
            listeners=[bar],
        )
    _print_outcome(outcome)
    for paper, tables in commands.published_beside(given.out):
        for table in tables:
            _print_beside_published(paper.name, table)
    _OUT.print(f"\nThe run: {given.out}; `visref report {given.out} --out PAGE`", markup=False)
    return outcome.exit


def _bench(given: argparse.Namespace) -> Exit:
    inputs = _inputs(given)
    frames = commands.bench_frames(inputs) if given.frames is None else list(inputs.frames)
    with _progress(len(frames)) as bar:
        lines = commands.bench(inputs, frames, given.out, bar.on_frame_done)
    for line in lines:
        _OUT.print(line, markup=False)
    _OUT.print(f"\nThe page: {given.out / 'bench.html'}", markup=False)
    return Exit.NO_VIOLATION


def _report(given: argparse.Namespace) -> Exit:
    page = commands.report(given.runs, given.out)
    _OUT.print(f"The report: {page}", markup=False)
    return Exit.NO_VIOLATION


class _Steps:
    """Progress over what the papers' tables need."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._bar = progress.add_task("measuring", total=None)

    def begin(self, steps: int) -> None:
        self._progress.update(self._bar, total=steps)

    def task(self, label: str) -> None:
        self._progress.update(self._bar, description=label)

    def advance(self, steps: float) -> None:
        self._progress.advance(self._bar, steps)


def _tables(given: argparse.Namespace) -> Exit:
    names = list(dict.fromkeys(given.paper or paper_names()))
    papers = [load_paper(name) for name in names]
    with _bar() as progress:
        measured = measure(
            papers,
            given.out,
            _Steps(progress),
            frames=given.frames,
            large=given.large,
            threads=given.threads,
        )
    page, status = write_tables(measured)
    for label, why in measured.failures.items():
        _ERRORS.print(f"not measured: {label}: {why}", markup=False)
    _OUT.print((given.out / "trends.md").read_text(encoding="utf-8"), markup=False, end="")
    _OUT.print(f"\nThe tables: {page}", markup=False)
    return status


def _explain(given: argparse.Namespace) -> Exit:
    lines, holds = commands.explain_witness(
        given.run, given.frame, given.object, given.culler, given.picture
    )
    for line in lines:
        _OUT.print(line, markup=False)
    return Exit.NO_VIOLATION if holds else Exit.VIOLATION


def _objects(given: argparse.Namespace) -> Exit:
    rows = commands.list_objects(given.scene)
    if given.json:
        _OUT.print_json(json.dumps(rows))
        return Exit.NO_VIOLATION
    table = Table("id", "name", "triangles", box=None)
    for row in rows:
        table.add_row(str(row["id"]), escape(str(row["name"])), str(row["triangles"]))
    _OUT.print(table)
    return Exit.NO_VIOLATION


def _cullers(given: argparse.Namespace) -> Exit:
    rows = commands.list_cullers()
    if given.json:
        _OUT.print_json(json.dumps(rows))
        return Exit.NO_VIOLATION
    for row in rows:
        _OUT.print(f"{row['name']}  ({row['class']}: {row['promise']})", markup=False)
        _OUT.print(f"    {row['summary']}", markup=False)
        for name, option in row["options"].items():
            choices = "|".join(map(str, option["choices"])) or type(option["default"]).__name__
            line = f"    {name}={choices} (default {option['default']}): {option['help']}"
            _OUT.print(line, markup=False)
    return Exit.NO_VIOLATION


def _hardcases(given: argparse.Namespace) -> Exit:
    with _progress(len(given.only or ()) or None) as bar:
        table = commands.hard_cases(
            given.engine,
            given.culler,
            only=given.only,
            out=given.out,
            on_case=lambda name: bar.on_frame_done(0),
        )
    if given.json:
        _OUT.print_json(json.dumps(table.to_json()))
        return table.exit
    shown = Table(box=None, pad_edge=False)
    for heading in ("case", *table.engines, *(["cullers"] if table.cullers else [])):
        shown.add_column(heading, no_wrap=heading == "case", overflow="fold")
    for case in table.cases:
        cells = [str(table.cells[case.name][spec]) for spec in table.engines]
        cullers = [culler_summary(table, case.name)] if table.cullers else []
        shown.add_row(*map(escape, [case.name, *cells, *cullers]))
    _OUT.print(shown)
    for reason in table.reasons():
        _OUT.print(reason, markup=False)
    return table.exit


def _doctor(given: argparse.Namespace) -> Exit:
    works = False
    for check in commands.doctor():
        mark = f"{'ok' if check.works else check.otherwise:7}"
        works = works or (check.works and check.is_engine)
        _OUT.print(f"{mark} {check.name}: {check.detail}", markup=False)
    return Exit.NO_VIOLATION if works else Exit.NOTHING_JUDGED


def _print_outcome(outcome: RunOutcome) -> None:
    table = Table(box=None, pad_edge=False)
    table.add_column("culler", overflow="fold")
    for heading in ("frames", "visible", "drawn", "superfluous", "missed", "violations", "verdict"):
        table.add_column(heading, justify="right", no_wrap=True)
    for record in outcome.cullers:
        totals = record.totals
        table.add_row(
            escape(record.spec),
            str(len(record.frames)),
            str(totals.visible),
            str(totals.drawn),
            str(totals.superfluous),
            str(totals.missed),
            str(totals.violations),
            "FAILED" if record.failed else record.status.replace("_", " "),
        )
    _OUT.print(table)
    shown = [f for f in outcome.findings if f.rule.severity in ("error", "warning")]
    for finding in shown[:10]:
        where = ", ".join(
            str(part)
            for part in (
                finding.culler,
                f"frame {finding.frame}" if finding.frame is not None else "",
                finding.object,
            )
            if part
        )
        # A plug-in's error may bring lines of its own.
        message = " ".join(finding.message.split())
        _OUT.print(f"{finding.code}: {where}: {message}", markup=False)
    if len(shown) > 10:
        _OUT.print(f"… and {len(shown) - 10} more findings in verdict.json", markup=False)


def _print_beside_published(name: str, of_paper: papers.Table) -> None:
    table = Table(box=None, pad_edge=False)
    for heading in HEADINGS[:4]:
        table.add_column(heading, justify="left" if heading == HEADINGS[0] else "right")
    for line in table_lines(of_paper):
        table.add_row(*(escape(cell) for cell in line.cells[:4]))
    _OUT.print(f"\n{of_paper.title} ({name}, {of_paper.source})", markup=False)
    _OUT.print(table)
    for trend in of_paper.trends:
        glyph, words = VERDICTS[trend.holds]
        _OUT.print(f"{glyph} {trend.claim}: {words}", markup=False)


if __name__ == "__main__":
    sys.exit(main())
