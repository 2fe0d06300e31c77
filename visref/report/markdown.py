"""A summary in Markdown, short enough for a CI page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from visref.papers import tables_beside
from visref.report import words
from visref.report.bench_folder import BenchFolder
from visref.report.misses import cause_of, object_misses, why_lines
from visref.report.run_tables import grid_markdown, savings_grid
from visref.report.savings import savings
from visref.report.summary import RATES, CullerSummary, summarise
from visref.report.tables import table_markdown
from visref.run_folder.read import RunFolder

_MAX_LOST = 5

# How a file of ours begins, so that another is never replaced by it. A page of a CI server may hold
# what other tools wrote, too.
TITLE = "# visref: "


def markdown_summary(runs: Sequence[RunFolder], benches: Sequence[BenchFolder], out: Path) -> str:
    """The verdict, a table of the cullers, and the worst losses of each run. `out` is the folder
    it will stand in: replay commands start there."""
    status, _ = words.overall(runs)
    lines = [f"{TITLE}{words.GLYPHS[status]} {words.HEADLINES[status]}"]
    for run in runs:
        lines += ["", *_run_lines(run, out)]
    for bench in benches:
        headline, *sentences = map(words.plain, bench.says)
        lines += ["", f"**Speed against error, {words.plain(bench.scene)}**: {headline}. "
                  f"{' '.join(sentences)}"]  # fmt: skip
    return "\n".join(lines) + "\n"


def markdown_of_failure(name: str, line: str) -> str:
    """The summary of a command that came to no verdict: its name, and what it said."""
    return f"{TITLE}✕ no verdict\n\n{words.code(f'visref {name}')}: {words.plain(line)}\n"


def _run_lines(run: RunFolder, out: Path) -> list[str]:
    rows = [summarise(run, culler) for culler in run.cullers]
    headings = [
        "culler", "verdict", "missed + partly / visible", "samples lost", "superfluous / drawn",
        *(rate.name for rate in RATES), "undecided", "triangles drawn", "ms a frame",
    ]  # fmt: skip
    lines = [
        f"**{words.plain(run.scene_name)}**: {words.plain(words.run_sentence(run, rows))}",
        "",
        f"| {' | '.join(headings)} |",
        "|---|---|" + "--:|" * (len(headings) - 2),
    ]
    for row in rows:
        counts = row.counts
        cells = [
            words.plain(row.culler),
            f"{words.GLYPHS[row.status]} {words.HEADLINES[row.status].lower()}",
            f"{words.count(counts.missed)} + {words.count(counts.partly_missed)} / "
            f"{words.count(counts.visible)}",
            words.count(counts.missed_pixels),
            f"{words.count(counts.superfluous)} / {words.count(counts.drawn)}",
            *(words.percent(share) for _, share in row.rates.named()),
            words.percent(row.undecided_share),
            words.percent(row.triangle_share),
            words.quantity(row.ms_median),
        ]
        lines.append(f"| {' | '.join(cells)} |")
    if (found := savings(run)) is not None:
        frames = words.counted(found.frames, "frame")
        lines += ["", grid_markdown(savings_grid(found, frames)).rstrip()]
    for row in rows:
        if why := why_lines(run.verdict.cullers[row.culler].causes):
            lines += ["", f"Why {words.plain(row.culler)} missed them:", ""]
            lines += [f"- {words.plain(line)}" for line in why]
        if row.lost:
            lines += ["", *_loss_lines(run, row, out)]
        if row.hidden:
            lines += ["", *_hidden_lines(row)]
    if len(rows) > 1:
        lines.append("")
        lines += [
            f"- {words.plain(row.culler)}: {words.plain(words.culler_sentence(row))}"
            for row in rows
        ]
    ages = [
        f"- {words.plain(row.culler)}: {words.plain(line)}"
        for row in rows
        if (line := words.ages_line(row))
    ]
    if ages:
        lines += ["", "Misses by age, in frames since what is missed came into view:", "", *ages]
    if policy := words.policy_line(run.manifest.policy):
        lines += ["", words.plain(policy)]
    if failing := words.failing_lines(run):
        lines += ["", "The run is a violation by this, whatever its cullers are:", ""]
        lines += [f"- {words.plain(line)}" for line in failing]
    if moved := words.motion_line(run):
        lines += ["", words.plain(moved)]
    causes = [
        f"- {words.plain(row.culler)}: {words.plain(line)}"
        for row in rows
        if (line := words.causes_line(row))
    ]
    if causes:
        lines += ["", "Superfluous by cause:", "", *causes]
    for paper, tables in tables_beside(run):
        lines += ["", f"## Beside {words.plain(paper.title)}"]
        for table in tables:
            lines += ["", table_markdown(table).rstrip()]
    lines += ["", " ".join([words.COUNTING, *words.not_claimed(run)])]
    return lines


def _loss_lines(run: RunFolder, row: CullerSummary, out: Path) -> list[str]:
    lines = [f"Lost by {words.plain(row.culler)}:", ""]
    missed = object_misses(run, row.culler)
    for lost in row.lost[:_MAX_LOST]:
        worst = lost.worst
        lines.append(
            f"- {words.plain(worst.name)}, {words.missed_in(lost)}: "
            f"{words.counted(lost.samples, 'sample')} over "
            f"{words.counted(lost.frames, 'frame')} ({words.plain(words.frame_of(worst))}, pixel "
            f"{worst.x}, {worst.y}, depth {worst.depth:.6g})"
        )
        if cause := cause_of(run, row.culler, missed.get(worst.object)):
            lines[-1] += f": {words.plain(cause)}"
    if len(row.lost) > _MAX_LOST:
        lines.append(f"- … and {len(row.lost) - _MAX_LOST} more objects")
    lines += [
        "",
        f"Replay the worst: {words.code(words.replay_command(run, row.lost[0].worst, out))}",
    ]
    return lines


def _hidden_lines(row: CullerSummary) -> list[str]:
    lines = [f"Drawn by {words.plain(row.culler)} against its promise ‘{row.promise}’:", ""]
    lines += [
        f"- {words.plain(words.hidden_name(row, one))}: {words.plain(words.hidden_line(one))}"
        for one in row.hidden[:_MAX_LOST]
    ]
    if len(row.hidden) > _MAX_LOST:
        lines.append(f"- … and {len(row.hidden) - _MAX_LOST} more {row.unit_kind}s")
    return lines
