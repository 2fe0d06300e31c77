"""What `visref tables` writes, from what is on disk alone: a page, Markdown, LaTeX and CSV.

tables.html    self-contained
tables.md      the same tables and verdicts
claims.md      the papers' claims, what they claim, what is found here, and the grade
summary.md     how many of them hold: a few lines for a README
tables.tex     for \\input; needs booktabs and array
tables.csv     every row of every table, numbers in full
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from visref.errors import InputError
from visref.files import replacing_file
from visref.judging.status import Exit, Status, decide, run_status
from visref.papers import NO_NUMBERS, Paper
from visref.papers.contents import Claim, Grade, Table
from visref.papers.estimates import CONFIDENCE, resampling
from visref.provenance import machine, versions
from visref.report import words
from visref.report.environment import page_environment
from visref.report.summary import RATES, CullerSummary, definitions, summarise
from visref.report.tables import (
    CLAIM_HEADINGS,
    claim_cells,
    table_csv,
    table_latex,
    table_markdown,
    table_view,
)
from visref.run_folder.read import RunFolder
from visref.tables.runs import PaperRuns

VERDICT_HEADINGS = (
    "scene and size", "culler", "declares itself", "frames", "visible", "missed", "partly missed",
    "violations",
    *(rate.name for rate in RATES),
)  # fmt: skip
_DEFINED = (
    f"{definitions()} Violations are what a promise forbids: of conservative and exact cullers "
    "what is missed, in full or in part, of exact and aggressive ones what is drawn though hidden."
)


_GRADES = (
    "A claim *holds* where the published figure is reached or passed, by the whole interval; it "
    "holds *in direction* where the order is right and that figure is not reached; it is *open* "
    "where the interval straddles the line that decides. Intervals are of "
    f"{100 * CONFIDENCE:.0f} %, from a block bootstrap over frames; figures without one are no "
    "figures of frames. What is *derived* is not printed, and follows by arithmetic from what is."
)


@dataclass(frozen=True, eq=False)
class PaperView:
    """One paper's part: its tables, and the judged runs behind them."""

    paper: Paper
    tables: list[Table]
    runs: list[tuple[RunFolder, list[CullerSummary]]]
    failures: list[tuple[str, str]]

    @property
    def claims(self) -> list[Claim]:
        """The paper's, of all its tables."""
        return [claim for table in self.tables for claim in table.claims]

    def verdict_cells(self) -> list[tuple[str, ...]]:
        """The verdicts' table, text by text, as `VERDICT_HEADINGS`."""
        return [
            (
                f"{run.scene_name}, {run.resolution()}",
                row.culler,
                row.promise,
                words.count(row.frames),
                words.count(row.counts.visible),
                words.count(row.counts.missed),
                words.count(row.counts.partly_missed),
                words.count(row.counts.violations),
                *(words.percent(share) for _, share in row.rates.named()),
            )
            for run, rows in self.runs
            for row in rows
        ]


def write_tables(done: PaperRuns) -> tuple[Path, Exit]:
    """Write the files into the folder of the runs; returns the page's path and the status.

    The status is that of all judged runs together, and at best "nothing judged" where
    something could not be measured.
    """
    with resampling(done.seed):
        return _write_tables(done)


def _write_tables(done: PaperRuns) -> tuple[Path, Exit]:
    views = [_view(done, paper) for paper in done.papers]
    runs = [run for view in views for run, _ in view.runs]
    status = decide([run.exit for run in runs] + [Exit.NOTHING_JUDGED for _ in done.failures])
    page = done.out / "tables.html"
    for file, text in (
        (page, _page(done, views, runs, status)),
        (done.out / "tables.md", _markdown(done, views)),
        (done.out / "claims.md", _claims(views)),
        (done.out / "summary.md", _summary(done, views)),
        (done.out / "tables.tex", _latex(done, views)),
        (done.out / "tables.csv", _csv(views)),
    ):
        with replacing_file(file) as beside:
            beside.write_text(text, encoding="utf-8")
    return page, status


def _view(done: PaperRuns, paper: Paper) -> PaperView:
    results = done.results(paper)
    found = (results.run(judged.key) for judged in paper.runs)
    runs = [run for run in found if run is not None]
    try:
        tables = paper.tables(results)
    except InputError:
        raise
    except NO_NUMBERS as error:
        raise InputError(
            f"the numbers on file give no table ({type(error).__name__}: {error})",
            source=str(results.folder),
            fix="remove it, and run again",
        ) from error
    return PaperView(
        paper,
        tables,
        [(run, [summarise(run, culler) for culler in run.cullers]) for run in runs],
        [
            (label.partition("/")[2], why)
            for label, why in done.failures.items()
            if label.startswith(f"{paper.name}/")
        ],
    )


def headline(views: Sequence[PaperView]) -> str:
    """How many of the papers' claims hold, of those measured."""
    claims = [claim for view in views for claim in view.claims]
    return counted_grades(claims, hold=" of the papers hold here")


def counted_grades(claims: Sequence[Claim], *, hold: str = " hold") -> str:
    """So many of so many hold, and what the others do."""
    count = Counter(claim.grade for claim in claims)
    left = count.pop(Grade.UNMEASURED, 0)
    text = f"{words.count(count[Grade.HOLDS])} of {words.counted(count.total(), 'claim')}"
    text += hold
    others = [
        f"{words.count(number)} {said}"
        for number, said in (
            (count[Grade.IN_DIRECTION], "in direction"),
            (count[Grade.FAILS], "not"),
            (count[Grade.OPEN], "open"),
            (left, "not measured"),
        )
        if number
    ]
    return ", ".join([text, *others])


def _sampling(done: PaperRuns) -> str:
    frames = done.frames
    of = "every frame" if frames is None else f"{words.counted(frames, 'frame')} at most"
    text = f"{of} of each camera path"
    if done.shift and frames is not None:
        text += f", moved by {done.shift:+.2f} of the way from one to the next"
    return f"{text}, scenes of seed {done.seed}" if done.seed else text


def _verdict_line(runs: Sequence[RunFolder]) -> str:
    cullers = sum(len(run.cullers) for run in runs)
    violations = sum(v.violations for run in runs for v in run.verdict.cullers.values())
    return (
        f"{words.counted(cullers, 'culler')} judged on {words.counted(len(runs), 'walk')}, "
        f"{words.counted(violations, 'violation')}"
    )


def _page(
    done: PaperRuns, views: Sequence[PaperView], runs: Sequence[RunFolder], status: Exit
) -> str:
    environment = page_environment("visref.tables")
    scenes = {run.manifest.scene.source: run.manifest.scene.sha256 for run in runs}
    return environment.get_template("tables.html.j2").render(
        headline=headline(views),
        verdict=_verdict_line(runs),
        status=run_status(
            [Status(run.verdict.status) for run in runs]
            + [Status.INCONCLUSIVE for _ in done.failures]
        ),
        exit_status=int(status),
        sampling=_sampling(done),
        views=[(view, [table_view(table) for table in view.tables]) for view in views],
        verdict_headings=VERDICT_HEADINGS,
        defined=_DEFINED,
        scenes=sorted(scenes.items()),
        machine=machine(),
        versions=versions(),
    )


def _markdown(done: PaperRuns, views: Sequence[PaperView]) -> str:
    lines = [
        "# The papers' tables, measured again",
        "",
        _summary(done, views),
        _DEFINED,
        "",
        _GRADES,
        "",
        _claims(views),
    ]
    for view in views:
        lines += [f"## {words.plain(view.paper.title)}", ""]
        for key, why in view.failures:
            lines += [f"Not measured: {words.plain(key)}: {words.plain(why)}", ""]
        for table in view.tables:
            lines += [table_markdown(table)]
        if view.runs:
            lines += ["### Verdicts", "", f"| {' | '.join(VERDICT_HEADINGS)} |"]
            lines.append("|---|---|---|" + "--:|" * (len(VERDICT_HEADINGS) - 3))
            lines += [
                f"| {' | '.join(map(words.plain, cells))} |" for cells in view.verdict_cells()
            ]
            lines.append("")
    return "\n".join(lines)


def _claims(views: Sequence[PaperView]) -> str:
    """The papers' claims, and those of ours apart."""
    theirs = _claims_table(views, lambda table: table.claims)
    own = _claims_table(views, lambda table: table.own)
    return f"{theirs}\nClaims of ours, in no count above:\n\n{own}"


def _claims_table(views: Sequence[PaperView], claims_of: Callable[[Table], Sequence[Claim]]) -> str:
    lines = [f"| {' | '.join(CLAIM_HEADINGS)} |", "|---|---|--:|--:|--:|---|"]
    for view in views:
        for table in view.tables:
            for claim in claims_of(table):
                cells = claim_cells(claim, f"{view.paper.name}, {table.source}")
                lines.append(f"| {' | '.join(map(words.plain, cells))} |")
    return "\n".join(lines) + "\n"


def _summary(done: PaperRuns, views: Sequence[PaperView]) -> str:
    """The headline, and a line per paper."""
    lines = [f"{headline(views)}. On {_sampling(done)}.", ""]
    lines += [f"- {words.plain(view.paper.title)}: {counted_grades(view.claims)}" for view in views]
    return "\n".join(lines) + "\n"


def _latex(done: PaperRuns, views: Sequence[PaperView]) -> str:
    parts = [f"% {headline(views)}. On {_sampling(done)}."]
    for view in views:
        parts.append(f"% {view.paper.title}")
        parts += [table_latex(table) for table in view.tables]
    return "\n".join(parts) + "\n"


def _csv(views: Sequence[PaperView]) -> str:
    """The papers' rows, with the paper's name before each."""
    lines: list[str] = []
    for view in views:
        head, *rows = table_csv(*view.tables).splitlines()
        lines = lines or [f"paper,{head}"]
        lines += [f"{view.paper.name},{row}" for row in rows]
    return "\n".join(lines) + "\n"
