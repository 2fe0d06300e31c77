"""A summary in Markdown, short enough for a CI page."""

from __future__ import annotations

from collections.abc import Sequence

from visref.measures import Measures, measure
from visref.report import words
from visref.run_record import RunRecord

_MAX_LOST = 5


def markdown_summary(runs: Sequence[RunRecord]) -> str:
    """The verdict, a table of the cullers, and the worst losses of each run."""
    status = words.overall(runs).status
    lines = [f"# {words.GLYPHS[status]} {words.HEADLINES[status]}"]
    for run in runs:
        lines += ["", *_run_lines(run)]
    return "\n".join(lines) + "\n"


def _run_lines(run: RunRecord) -> list[str]:
    rows = [measure(run, culler) for culler in run.cullers]
    lines = [
        f"**{words.plain(run.scene_name)}**: {words.plain(words.run_sentence(run, rows))}",
        "",
        "| culler | verdict | missed / visible | samples lost | superfluous / drawn "
        "| triangles drawn | ms a frame |",
        "|---|---|--:|--:|--:|--:|--:|",
    ]
    for row in rows:
        counts = row.counts
        cells = [
            words.plain(row.culler),
            f"{words.GLYPHS[words.label(row)]} {words.HEADLINES[words.label(row)].lower()}",
            f"{words.count(counts['missed'])} / {words.count(counts['visible'])}",
            words.count(counts["missed_pixels"]),
            f"{words.count(counts['superfluous'])} / {words.count(counts['drawn'])}",
            words.percent(row.triangle_share),
            words.quantity(row.ms_median),
        ]
        lines.append(f"| {' | '.join(cells)} |")
    for row in rows:
        if row.lost:
            lines += ["", *_loss_lines(row)]
    lines += ["", " ".join(["Counts are summed over frames.", *words.not_claimed(run)])]
    return lines


def _loss_lines(row: Measures) -> list[str]:
    lines = [f"Lost by {words.plain(row.culler)}:", ""]
    for lost in row.lost[:_MAX_LOST]:
        worst = lost.worst
        lines.append(
            f"- {words.plain(worst['name'])}: {words.counted(lost.pixels, 'sample')} over "
            f"{words.counted(lost.frames, 'frame')} (frame {worst['frame']}, pixel "
            f"{worst['x']}, {worst['y']}, depth {worst['depth']:.6g})"
        )
    if len(row.lost) > _MAX_LOST:
        lines.append(f"- … and {len(row.lost) - _MAX_LOST} more objects")
    return lines
