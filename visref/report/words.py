"""The sentences of a verdict, the same on the page, in JUnit and in Markdown."""

from __future__ import annotations

import os
import re
import shlex
from collections.abc import Sequence
from pathlib import Path

from visref.judging.status import Exit, decide
from visref.report.summary import CullerSummary
from visref.run_folder.causes import Cause
from visref.run_folder.read import RunFolder
from visref.run_folder.rows import Witness
from visref.wording import counted as counted

HEADLINES = {
    "violation": "Violation",
    "no_violation_found": "No violation found",
    "inconclusive": "Inconclusive",
    "measured": "Measured, not convicted",
}
GLYPHS = {"violation": "✕", "no_violation_found": "✓", "inconclusive": "?", "measured": "~"}

_MARKDOWN = re.compile(r"([\\`*_{}\[\]<>|#&~])")


def plain(text: str) -> str:
    """Text that Markdown and HTML leave alone."""
    return _MARKDOWN.sub(r"\\\1", " ".join(text.split()))


def count(number: int) -> str:
    """An integer with its thousands set apart."""
    return f"{number:,}"


def percent(share: float | None) -> str:
    """A share in per cent with three significant digits, and never a zero that is none."""
    if share is None:
        return "–"
    if share == 0.0:
        return "0 %"
    value = 100.0 * share
    if value < 0.001:
        return "< 0.001 %"
    # A share just below the whole must not read as the whole.
    if 99.95 <= value < 100.0:
        return "> 99.9 %"
    digits = 0 if value >= 100 else 1 if value >= 10 else 2 if value >= 1 else 3
    return f"{value:,.{digits}f} %"


def quantity(value: float | None) -> str:
    """A mean or a time with about three significant digits."""
    if value is None:
        return "–"
    if value == 0.0:
        return "0"
    if value < 0.001:
        return "< 0.001"
    digits = 0 if value >= 100 or value == int(value) else 1 if value >= 10 else 2
    return f"{value:,.{3 if value < 1 and value != int(value) else digits}f}"


def large(value: float | None) -> str:
    """A count that may be in the millions, to three significant digits."""
    if value is not None and value >= 1e6:
        power, letter = (1e9, "G") if value >= 1e9 else (1e6, "M")
        return f"{quantity(value / power)} {letter}"
    return quantity(value)


# Each cause of `visref.run_folder.causes` in a word or two, and in a sentence.
CAUSES = {
    Cause.OUTSIDE: ("outside the view", "its box shows nowhere in the image"),
    Cause.BOX: (
        "box larger than object",
        "its box, unlike itself, shows in the finished image: no question about boxes spares it",
    ),
    Cause.ORDER: (
        "occluder drawn later",
        "its box is hidden in the finished image, and was not yet when the depth buffer was asked",
    ),
    Cause.COARSE: (
        "test too coarse",
        "its box was hidden when it was asked about, and the answer was “visible”: a tile, a "
        "texel or an inflated box",
    ),
    Cause.SKIPPED: (
        "query skipped",
        "its box was hidden already, and it was drawn without asking",
    ),
    Cause.HIDDEN: (
        "hidden, culler silent",
        "its box is hidden in the finished image; the culler does not tell when it asked",
    ),
}


def path_from(out: Path, folder: Path) -> str:
    """A folder as the files in `out` name it."""
    return os.path.relpath(folder.resolve(), out.resolve())


def replay_command(run: RunFolder, lost: Witness, out: Path) -> str:
    """The command that replays a lost object's witness, started in `out`."""
    where = ("--frame", str(lost.frame), "--object", str(lost.object))
    return shlex.join(["visref", "explain", path_from(out, run.folder), *where])


def rates_line(row: CullerSummary) -> str:
    """A culler's error rates in a line."""
    return ", ".join(f"{rate.name} {percent(share)}" for rate, share in row.rates.named())


def causes_line(row: CullerSummary) -> str:
    """Why a culler drew what is superfluous, the commonest cause first; empty if unexplained."""
    explained = sum(row.causes.values())
    if not explained:
        return ""
    order = sorted(row.causes, key=lambda cause: -row.causes[cause])
    parts = [
        f"{CAUSES[Cause(cause)][0]} {percent(row.causes[cause] / explained)}" for cause in order
    ]
    return f"{', '.join(parts)} (of {counted(explained, row.unit_kind)} explained)"


def overall(runs: Sequence[RunFolder]) -> Exit:
    """The status of several runs together."""
    return decide(run.exit for run in runs)


def label(row: CullerSummary) -> str:
    """The key of a culler's headline: its status, or `measured` where it missed something that
    it never promised to draw, which a tick would belie."""
    return "measured" if row.status != "violation" and row.counts.confirmed else row.status


def culler_sentence(row: CullerSummary) -> str:
    """What was found of one culler, for an engineer who reads nothing else."""
    counts = row.counts
    frames = counted(row.frames, "frame")
    if not row.frames:
        return "It judged no frame; see the findings."
    if not counts.visible:
        return f"No object is visible in any of its {frames}, so nothing was judged."
    confirmed = counts.confirmed
    if confirmed:
        verb = "was" if confirmed == 1 else "were"
        text = (
            f"{count(confirmed)} of {count(counts.visible)} visible objects {verb} not drawn"
            f" ({_distinct(row)}; {counted(counts.missed_pixels, 'sample')} lost)."
        )
        if not row.convicts:
            text += f" It declares itself {row.promise}."
    else:
        text = (
            f"Each of {counted(counts.visible, 'visible object')} was drawn, in {frames}."
            if not counts.missed
            else f"No confirmed miss among {counted(counts.visible, 'visible object')} in {frames}."
        )
    cleared = [
        counted(counts.ties, "tie") if counts.ties else "",
        f"{count(counts.within_raster_tolerance)} within the rasteriser's tolerance"
        if counts.within_raster_tolerance
        else "",
    ]
    if any(cleared):
        text += f" Cleared: {' and '.join(filter(None, cleared))}."
    if counts.undecided:
        text += f" Undecided: {count(counts.undecided)}."
    if row.status == "inconclusive":
        text += " Then it broke down; see the findings."
    return text


def _distinct(row: CullerSummary) -> str:
    return (
        f"{counted(len(row.lost), 'different object')} in {counted(row.frames_with_miss, 'frame')}"
        f" of {count(row.frames)}"
    )


def run_sentence(run: RunFolder, rows: Sequence[CullerSummary]) -> str:
    """A run's verdict in one sentence."""
    frames = counted(len(run.frame_numbers), "frame")
    guilty = [row for row in rows if row.status == "violation"]
    open_ = [row for row in rows if row.status == "inconclusive"]
    if guilty:
        if len(rows) == 1:
            return culler_sentence(guilty[0])
        named = ", ".join(f"‘{row.culler}’" for row in guilty[:3])
        more = f" and {len(guilty) - 3} more" if len(guilty) > 3 else ""
        return (
            f"{len(guilty)} of {counted(len(rows), 'culler')} left out visible objects that it "
            f"promised to draw: {named}{more}."
        )
    if not rows:
        return "No culler was judged."
    if open_:
        if len(rows) == 1:
            return culler_sentence(open_[0])
        return f"{len(open_)} of {len(rows)} cullers could not be judged, or not to the end."
    if len(rows) == 1:
        return culler_sentence(rows[0])
    return f"None of {len(rows)} cullers broke its promise, in {frames}."


def not_claimed(run: RunFolder) -> list[str]:
    """What a reader must not take from the verdict, by the engine that cast the truth."""
    engine = run.manifest.engine
    if not run.frame_numbers:
        return ["No frame was judged, so nothing is claimed at all."]
    claims = [
        f"Only the samples (pixel centres) of {counted(len(run.frame_numbers), 'frame')} at "
        f"{run.resolution()} were judged: not what lies between them, nor other views."
    ]
    if run.manifest.exact:
        claims.append(
            "The truth is exact: the owner of every sample was decided in exact arithmetic, so "
            "every miss and every tie at these samples is listed."
        )
        return claims
    if run.manifest.exact is None:
        cast = f"The truth was cast by ‘{engine}’; whether that is exact is not recorded. Each"
    else:
        cast = f"The truth was cast by ‘{engine}’ in floating point, and each"
    claims.append(
        f"{cast} violation was decided again in exact arithmetic, so each is real. What the "
        "engine itself did not hit stays unseen: no violation found is not a proof of safety. "
        "`--engine exact` lists every miss and every tie."
    )
    return claims
