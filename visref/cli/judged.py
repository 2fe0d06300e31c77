"""A judged run on the terminal: what `demo`, `run` and `check` print."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from rich.markup import escape
from rich.table import Table

from visref.cli.terminal import OUT, frame_bar
from visref.culler import Culler
from visref.inputs import Inputs
from visref.judging.outcome import RunOutcome
from visref.judging.status import Exit
from visref.papers import contents as papers
from visref.papers import tables_beside
from visref.report.tables import HEADINGS, VERDICTS, table_lines
from visref.run_folder.read import read_run
from visref.runs import judge_to_folder

FINDINGS_SHOWN = 10


def judge(
    given: argparse.Namespace,
    inputs: Inputs,
    cullers: Sequence[tuple[str, Culler]],
    *,
    image_check: bool = False,
) -> Exit:
    """Judge by the judging arguments, print the verdict and the papers' numbers beside ours."""
    with frame_bar(len(inputs.frames)) as bar:
        outcome = judge_to_folder(
            inputs,
            cullers,
            given.out,
            truth=given.truth,
            pictures=given.pictures,
            image_check=image_check,
            listeners=[bar],
        )
    print_outcome(outcome)
    for paper, tables in tables_beside(read_run(given.out, objects=False)):
        for table in tables:
            _print_beside_published(paper.name, table)
    OUT.print(f"\nThe run: {given.out}; `visref report {given.out} --out PAGE`", markup=False)
    return outcome.exit


def print_outcome(outcome: RunOutcome) -> None:
    """A row for each culler, then the first findings."""
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
    OUT.print(table)
    shown = [f for f in outcome.findings if f.rule.severity in ("error", "warning")]
    for finding in shown[:FINDINGS_SHOWN]:
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
        OUT.print(": ".join(filter(None, (finding.code, where, message))), markup=False)
    if len(shown) > FINDINGS_SHOWN:
        rest = len(shown) - FINDINGS_SHOWN
        OUT.print(f"… and {rest} more findings in verdict.json", markup=False)


def _print_beside_published(name: str, of_paper: papers.Table) -> None:
    table = Table(box=None, pad_edge=False)
    for heading in HEADINGS[:4]:
        table.add_column(heading, justify="left" if heading == HEADINGS[0] else "right")
    for line in table_lines(of_paper):
        table.add_row(*(escape(cell) for cell in line.cells[:4]))
    OUT.print(f"\n{of_paper.title} ({name}, {of_paper.source})", markup=False)
    OUT.print(table)
    for trend in of_paper.trends:
        glyph, words = VERDICTS[trend.holds]
        OUT.print(f"{glyph} {trend.claim}: {words}", markup=False)
