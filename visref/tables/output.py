"""What `visref tables` writes, from the records alone: a page, Markdown, LaTeX and CSV.

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

from visref.files import replacing_file
from visref.judging.status import Exit, decide
from visref.papers import Paper
from visref.papers.table import Table
from visref.report import words
from visref.report.environment import page_environment
from visref.report.summary import RATES, Measures, definitions, measure
from visref.report.tables import (
    VERDICTS,
    table_csv,
    table_latex,
    table_markdown,
    table_view,
)
from visref.run_folder.read import RunRecord
from visref.run_folder.write import machine, versions
from visref.tables.recording import Measured

VERDICT_HEADINGS = (
    "scene and size", "culler", "declares itself", "frames", "visible", "missed", "violations",
    *(rate.name for rate in RATES),
)  # fmt: skip
_DEFINED = f"{definitions()} Violations are misses of a culler that declares itself conservative."


@dataclass(frozen=True, eq=False)
class PaperView:
    """One paper's part: its tables, and the judged walks behind them."""

    paper: Paper
    tables: list[Table]
    walks: list[tuple[RunRecord, list[Measures]]]
    failures: list[tuple[str, str]]

    def verdict_cells(self) -> list[tuple[str, ...]]:
        """The verdicts' table, text by text, as `VERDICT_HEADINGS`."""
        return [
            (
                f"{run.scene_name}, {run.resolution()}",
                row.culler,
                row.promise,
                words.count(row.frames),
                words.count(row.counts["visible"]),
                words.count(row.counts["missed"]),
                words.count(row.counts["violations"]),
                *(words.percent(share) for _, share in row.rates.named()),
            )
            for run, rows in self.walks
            for row in rows
        ]


def write_tables(measured: Measured) -> tuple[Path, Exit]:
    """Write the files into the measured folder; returns the page's path and the status.

    The status is that of all judged walks together, and at best "nothing judged" where
    something could not be measured.
    """
    views = [_view(measured, paper) for paper in measured.papers]
    runs = [run for view in views for run, _ in view.walks]
    status = decide([run.exit for run in runs] + [Exit.NOTHING_JUDGED for _ in measured.failures])
    page = measured.out / "tables.html"
    for file, text in (
        (page, _page(measured, views, runs, status)),
        (measured.out / "tables.md", _markdown(measured, views)),
        (measured.out / "trends.md", _trends(views)),
        (measured.out / "tables.tex", _latex(measured, views)),
        (measured.out / "tables.csv", _csv(views)),
    ):
        with replacing_file(file) as beside:
            beside.write_text(text, encoding="utf-8")
    return page, status


def _view(measured: Measured, paper: Paper) -> PaperView:
    records = measured.records(paper)
    found = (records.run(walk.key) for walk in paper.walks)
    runs = [run for run in found if run is not None]
    return PaperView(
        paper,
        paper.tables(records),
        [(run, [measure(run, culler) for culler in run.cullers]) for run in runs],
        [
            (label.partition("/")[2], why)
            for label, why in measured.failures.items()
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


def _sampling(measured: Measured) -> str:
    frames = measured.frames
    of = "every frame" if frames is None else f"{words.counted(frames, 'frame')} at most"
    return f"{of} of each camera path"


def _verdict_line(runs: Sequence[RunRecord]) -> str:
    cullers = sum(len(run.cullers) for run in runs)
    violations = sum(v["violations"] for run in runs for v in run.verdict["cullers"].values())
    return (
        f"{words.counted(cullers, 'culler')} judged on {words.counted(len(runs), 'walk')}, "
        f"{words.counted(violations, 'violation')}"
    )


def _page(
    measured: Measured, views: Sequence[PaperView], runs: Sequence[RunRecord], status: Exit
) -> str:
    environment = page_environment("visref.tables")
    scenes = {run.manifest["scene"]["source"]: run.manifest["scene"]["sha256"] for run in runs}
    return environment.get_template("tables.html.j2").render(
        headline=headline(views),
        verdict=_verdict_line(runs),
        status=status.status,
        exit_status=int(status),
        sampling=_sampling(measured),
        views=[(view, [table_view(table) for table in view.tables]) for view in views],
        verdict_headings=VERDICT_HEADINGS,
        defined=_DEFINED,
        scenes=sorted(scenes.items()),
        machine=machine(),
        versions=versions(),
    )


def _markdown(measured: Measured, views: Sequence[PaperView]) -> str:
    lines = [
        "# The papers' tables, measured again",
        "",
        f"{headline(views)}. On {_sampling(measured)}. {_DEFINED}",
        "",
        _trends(views),
    ]
    for view in views:
        lines += [f"## {words.plain(view.paper.title)}", ""]
        for key, why in view.failures:
            lines += [f"Not measured: {words.plain(key)}: {words.plain(why)}", ""]
        for table in view.tables:
            lines += [table_markdown(table)]
        if view.walks:
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


def _latex(measured: Measured, views: Sequence[PaperView]) -> str:
    parts = [f"% {headline(views)}. On {_sampling(measured)}."]
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
