"""What `visref tables` writes, from what is on disk alone: a page, Markdown, LaTeX and CSV.

tables.html    self-contained
tables.md      the same tables and verdicts
trends.md      the papers' claims, and whether they hold here: a few lines for a README
tables.tex     for \\input; needs booktabs and array
tables.csv     every row of every table, numbers in full
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from visref.errors import InputError
from visref.files import replacing_file
from visref.judging.status import Exit, Status, decide, run_status
from visref.papers import NO_NUMBERS, Paper
from visref.papers.contents import Table
from visref.provenance import machine, versions
from visref.report import words
from visref.report.environment import page_environment
from visref.report.summary import RATES, CullerSummary, definitions, summarise
from visref.report.tables import (
    VERDICTS,
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


@dataclass(frozen=True, eq=False)
class PaperView:
    """One paper's part: its tables, and the judged runs behind them."""

    paper: Paper
    tables: list[Table]
    runs: list[tuple[RunFolder, list[CullerSummary]]]
    failures: list[tuple[str, str]]

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
    views = [_view(done, paper) for paper in done.papers]
    runs = [run for view in views for run, _ in view.runs]
    status = decide([run.exit for run in runs] + [Exit.NOTHING_JUDGED for _ in done.failures])
    page = done.out / "tables.html"
    for file, text in (
        (page, _page(done, views, runs, status)),
        (done.out / "tables.md", _markdown(done, views)),
        (done.out / "trends.md", _trends(views)),
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
    found = [trend for view in views for table in view.tables for trend in table.trends]
    measured = [trend for trend in found if trend.holds is not None]
    holding = sum(1 for trend in measured if trend.holds)
    text = f"{holding} of {words.counted(len(measured), 'claim')} of the papers hold here"
    left = len(found) - len(measured)
    return f"{text}, {words.count(left)} not measured" if left else text


def _sampling(done: PaperRuns) -> str:
    frames = done.frames
    of = "every frame" if frames is None else f"{words.counted(frames, 'frame')} at most"
    return f"{of} of each camera path"


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
        f"{headline(views)}. On {_sampling(done)}. {_DEFINED}",
        "",
        _trends(views),
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


def _trends(views: Sequence[PaperView]) -> str:
    lines = ["| claim | where | here |", "|---|---|---|"]
    for view in views:
        for table in view.tables:
            for trend in table.trends:
                cells = (
                    trend.claim,
                    f"{view.paper.name}, {table.source}",
                    " ".join(VERDICTS[trend.holds]),
                )
                lines.append(f"| {' | '.join(map(words.plain, cells))} |")
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
