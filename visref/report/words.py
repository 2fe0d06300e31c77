"""The sentences of a verdict, the same on the page, in JUnit and in Markdown."""

from __future__ import annotations

import os
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path

from visref.culler import RasterTolerance
from visref.findings import Finding, fails_run
from visref.judging.policy import Policy
from visref.judging.status import MAX_UNDECIDED, Exit, Status, decide, run_status
from visref.markdown import code as code
from visref.markdown import plain as plain
from visref.report.summary import CullerSummary
from visref.run_folder.causes import Cause
from visref.run_folder.read import RunFolder
from visref.run_folder.rows import FindingRow, HiddenUnit, LostObject, PolicyFacts, Witness
from visref.wording import counted as counted

HEADLINES = {
    "violation": "Violation",
    "no_violation_found": "No violation found",
    "inconclusive": "Inconclusive",
    "measured": "Measured, not convicted",
}
GLYPHS = {"violation": "✕", "no_violation_found": "✓", "inconclusive": "?", "measured": "~"}

ALL_DECIDED = "Every sample that the verdict hangs on was decided."
# What a sum over frames of objects counts.
COUNTING = (
    "Counts are summed over frames: of objects they are object-frames, an object once for every "
    "frame (and view) in which it is visible."
)


# So many of the ages of misses stand in a line.
_AGES_SHOWN = 8


def count(number: int | None) -> str:
    """An integer with its thousands set apart."""
    return "–" if number is None else f"{number:,}"


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


def frame_of(witness: Witness) -> str:
    """The frame of a witness, and its view where that has a name."""
    return f"frame {witness.frame}" + (f", view {witness.view}" if witness.view else "")


def found_at(finding: Finding | FindingRow) -> str:
    """What a finding is about: its culler, frame and object, as far as it names them."""
    frame = f"frame {finding.frame}" if finding.frame is not None else ""
    return ", ".join(filter(None, (finding.culler, frame, finding.object)))


def ages_line(row: CullerSummary) -> str:
    """The ages of a culler's misses, in a line; empty where none has one."""
    return ages_text(row.ages, row.counts.losing - row.counts.ties)


def ages_text(ages: Mapping[int, int], losing: int) -> str:
    """How many misses are of each age, of so many that lose samples; empty where none has one."""
    if not ages:
        return ""
    parts = [f"{count(number)} at {age}" for age, number in ages.items()]
    more = f", … and {len(parts) - _AGES_SHOWN} more ages" if len(parts) > _AGES_SHOWN else ""
    ageless = losing - sum(ages.values())
    by_right = f"; {count(ageless)} in view by right" if ageless > 0 else ""
    return f"{', '.join(parts[:_AGES_SHOWN])}{more}{by_right}"


def ages_table(rows: Sequence[CullerSummary]) -> tuple[list[str], list[tuple[str, list[int]]]]:
    """Headings, and for each culler whose misses have ages how many there are under each: ages up
    to 3 by themselves, then by powers of two, and last those without one."""
    aged = [row for row in rows if row.ages]
    oldest = max((max(row.ages) for row in aged), default=0)
    ranges = [(age, age) for age in range(min(oldest, 3) + 1)]
    while ranges[-1][1] < oldest:
        low = ranges[-1][1] + 1
        ranges.append((low, 2 * low - 1))
    headings = [f"{low}" if low == high else f"{low}–{high}" for low, high in ranges]
    table = []
    for row in aged:
        ages = row.ages.items()
        numbers = [sum(n for age, n in ages if low <= age <= high) for low, high in ranges]
        table.append((row.culler, [*numbers, row.ageless]))
    return [*headings, "by right"], table


def motion_line(run: RunFolder) -> str:
    """What moved in a run, in a sentence; empty where nothing did."""
    motion = run.manifest.motion
    if motion is None:
        return ""
    if not motion.frames:
        return "Nothing moved in the judged frames."
    moved, appeared, vanished = (
        sum(getattr(one, name) for one in motion.frames)
        for name in ("moved", "appeared", "vanished")
    )
    return (
        f"{counted(motion.objects, 'object')} changed in {counted(len(motion.frames), 'frame')}: "
        f"{counted(moved, 'move')}, {counted(appeared, 'appearance')} and "
        f"{counted(vanished, 'disappearance')} since the frame before."
    )


def moved_in(run: RunFolder, frame: int) -> str:
    """What moved in one frame; empty where nothing did."""
    motion = run.manifest.motion
    for one in motion.frames if motion is not None else ():
        if one.frame == frame:
            told = ((one.moved, "moved"), (one.appeared, "appeared"), (one.vanished, "vanished"))
            return ", ".join(f"{count(number)} {word}" for number, word in told if number)
    return ""


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


def overall(runs: Sequence[RunFolder]) -> tuple[Status, Exit]:
    """The word and the exit status of several runs together, from their records."""
    return (
        run_status(Status(run.verdict.status) for run in runs),
        decide(run.exit for run in runs),
    )


def decided(owned: int | None, undecided: int | None, *, rounded: bool = False) -> str:
    """How much of what a verdict hangs on was decided, in a sentence; empty where that was not
    counted. `rounded`: rounding to float32 left samples open too."""
    if not owned or undecided is None:
        return ""
    if not undecided:
        return ALL_DECIDED
    what = "alpha masks or rounded vertices" if rounded else "alpha masks"
    return (
        f"{percent(undecided / owned)} of the {counted(owned, 'owned sample')} hang on {what}: "
        "undecided, they neither clear nor convict."
    )


def why_inconclusive(
    *,
    frames: int,
    visible: int,
    owned: int | None,
    undecided: int | None,
    failed: bool,
    unsteady: bool,
    max_undecided: float,
    misaligned: bool = False,
) -> str:
    """Why a verdict says nothing, in a sentence."""
    if misaligned:
        return "The recording fits another input (MISALIGNED), so nothing is concluded from it."
    if not frames:
        return "It judged no frame; see the findings."
    if failed:
        return "Then it broke down; see the findings."
    if owned and undecided and undecided >= owned:
        return "Nothing is decided, so nothing was judged."
    if not visible:
        return (
            f"No object is visible in any of its {counted(frames, 'frame')}, so nothing was judged."
        )
    if owned and undecided and undecided > max_undecided * owned:
        return f"That is more than the {percent(max_undecided)} that may stay undecided."
    if unsteady:
        return "Asked again, it answered otherwise: it is not deterministic; see the findings."
    return "See the findings."


def culler_sentence(row: CullerSummary) -> str:
    """What was found of one culler, for an engineer who reads nothing else."""
    counts = row.counts
    # What is to be mended in the input comes before what was found by it.
    parts = [row.other_input]
    if row.frames and counts.visible:
        parts += [*_found(row), _cleared(row)]
    if counts.undecided:
        parts.append(f"{_objects(row, counts.undecided)} may be visible, and stay undecided.")
    parts.append(decided(counts.owned_samples, counts.undecided_samples, rounded=row.rounded))
    if row.status is Status.INCONCLUSIVE:
        parts.append(
            why_inconclusive(
                frames=row.frames,
                visible=counts.visible,
                owned=counts.owned_samples,
                undecided=counts.undecided_samples,
                failed=row.failed,
                unsteady=row.unsteady,
                max_undecided=row.max_undecided,
                misaligned=row.misaligned,
            )
        )
    elif row.unsteady:
        parts.append("Asked again, it answered otherwise: it is not deterministic.")
    if row.status is Status.MEASURED:
        parts.append("It promises nothing, so this is a measurement and no praise.")
    return " ".join(filter(None, parts))


def _found(row: CullerSummary) -> list[str]:
    """What was lost, and what was drawn against the promise, in sentences."""
    counts, frames = row.counts, counted(row.frames, "frame")
    found = []
    visible = _objects(row, counts.visible, "visible ")
    if counts.superfluous_confirmed:
        times = counted(counts.superfluous_confirmed, "time")
        found.append(
            f"{times} a hidden {row.unit_kind} was drawn ({count(len(row.hidden))} different), "
            f"which the promise ‘{row.promise}’ forbids."
        )
    if counts.confirmed:
        found.append(f"Of {visible}, {_lost(row)}.")
    elif counts.losing:
        found.append(f"No confirmed loss among {visible}, in {frames}.")
    elif counts.partly_missed is None:
        found.append(
            f"None of {visible} was missed in full, in {frames}. Whether parts were lost is not in "
            "this record, which is of version 1."
        )
    else:
        whole = (
            f"Each of {visible}" if counts.visible > 1 else f"The one {visible.split(' ', 1)[1]}"
        )
        certain = " for certain" if counts.undecided_samples else ""
        found.append(f"{whole} was drawn wherever it is seen{certain}, in {frames}.")
    return found


def _cleared(row: CullerSummary) -> str:
    """What was missed and is no violation, and by what it is excused."""
    counts = row.counts
    excused = (
        f"{count(counts.within_raster_tolerance)} within {tolerance(row.raster)}"
        f"{lost_by_it(row.excused_samples)}"
    )
    cleared = [
        counted(counts.ties, "tie") if counts.ties else "",
        excused if counts.within_raster_tolerance else "",
        accepted(counts.small, counts.late, counts.waived),
    ]
    return f"Cleared: {', '.join(filter(None, cleared))}." if any(cleared) else ""


def accepted(small: int, late: int, waived: int) -> str:
    """The misses that a policy accepts, by kind; empty where there are none."""
    kinds = ((small, "small"), (late, "late"), (waived, "waived"))
    return ", ".join(f"{count(number)} {word}" for number, word in kinds if number)


def policy_line(policy: Policy | PolicyFacts | None) -> str:
    """What was accepted beforehand, in a sentence; empty without a policy."""
    if policy is None or not policy.sha256:
        return ""
    said = []
    if policy.min_samples:
        said.append(f"small is what loses fewer than {counted(policy.min_samples, 'sample')}")
    if policy.latency_frames:
        frames = counted(policy.latency_frames, "frame")
        said.append(f"late is what came into view less than {frames} before")
    if policy.waivers:
        said.append(f"{counted(len(policy.waivers), 'waiver')} asked on {policy.today}")
    if policy.max_undecided != MAX_UNDECIDED:
        said.append(f"{percent(policy.max_undecided)} may stay undecided")
    if policy.severities:
        said.append(f"{counted(len(policy.severities), 'severity', 'severities')} changed")
    name = Path(policy.source).name
    return f"Judged by the policy {name}: {'; '.join(said) or 'it accepts nothing'}."


def failing_lines(run: RunFolder) -> list[str]:
    """What makes a run a violation by itself, whatever its cullers are: a line per finding."""
    return [
        f"{finding.code}: {finding.message}"
        for finding in run.verdict.findings
        if fails_run(finding.code, finding.severity)
    ]


def tolerance(raster: RasterTolerance | None) -> str:
    """The tolerance that a culler's rasteriser declares; None where it is not recorded."""
    if raster is None:
        return "the rasteriser's tolerance"
    return f"the rasteriser's tolerance ({declared(raster)})"


def lost_by_it(samples: int | None) -> str:
    """How many samples a tolerance excused, to stand behind it; None where it is not recorded."""
    return "" if samples is None else f" with {counted(samples, 'sample')} lost"


def declared(raster: RasterTolerance) -> str:
    """A declared tolerance in words."""
    depth = "float depth" if raster.depth_bits is None else f"{raster.depth_bits} bits of depth"
    return f"snap {quantity(raster.snap_px)} px, {depth}"


def _objects(row: CullerSummary, number: int, adjective: str = "") -> str:
    """A count of objects, each once for every drawn set that was judged."""
    return counted(number, f"{adjective}object" if row.cells == 1 else f"{adjective}object-frame")


def missed_in(lost: LostObject) -> str:
    """How an object was missed: in full, in part, or now so and now so."""
    if not lost.partly:
        return "missed"
    if lost.partly == lost.misses:
        return "partly missed"
    return f"missed, in {lost.partly} of {lost.misses} cases partly"


def hidden_name(row: CullerSummary, one: HiddenUnit) -> str:
    return one.name or f"{row.unit_kind} {one.unit}"


def hidden_line(one: HiddenUnit) -> str:
    """What exact arithmetic found of a unit that was drawn against the promise."""
    text = f"drawn though hidden in {counted(one.frames, 'frame')}; frame {one.frame}"
    text += f", view {one.view}: " if one.view else ": "
    if one.occluder is None:
        return f"{text}it covers no sample"
    return (
        f"{text}hidden at all {counted(one.samples, 'sample')} that it covers, nearest by triangle "
        f"{one.occluder} of ‘{one.occluder_name}’, at pixel ({one.x}, {one.y})"
    )


def _lost(row: CullerSummary) -> str:
    """What of the visible objects was lost."""
    counts = row.counts
    in_full = counts.confirmed - row.partly_confirmed
    said = []
    for number, word in ((in_full, "missed"), (row.partly_confirmed, "partly missed")):
        if number:
            said.append(f"{count(number)} {'was' if number == 1 else 'were'} {word}")
    where = ""
    if row.cells > 1:
        where = (
            f"{counted(len(row.lost), 'different object')} in {count(row.frames_with_miss)} of "
            f"{counted(row.frames, 'frame')}, "
        )
    # Where nothing of the visibility buffer is lost, glass is.
    lost = (
        counted(counts.missed_pixels, "sample")
        if counts.missed_pixels
        else f"{counted(sum(one.samples for one in row.lost), 'sample')} of glass"
    )
    return f"{' and '.join(said)}: {where}{lost} lost"


def run_sentence(run: RunFolder, rows: Sequence[CullerSummary]) -> str:
    """A run's verdict in one sentence, and what fails it besides."""
    failing = failing_lines(run)
    more = f" And {len(failing) - 1} more." if len(failing) > 1 else ""
    said = f"The run fails by {failing[0]}.{more}" if failing else ""
    return " ".join(filter(None, (said, _cullers_sentence(run, rows))))


def _cullers_sentence(run: RunFolder, rows: Sequence[CullerSummary]) -> str:
    frames = counted(len(run.frame_numbers), "frame")
    guilty = [row for row in rows if row.status is Status.VIOLATION]
    open_ = [row for row in rows if row.status is Status.INCONCLUSIVE]
    if guilty:
        if len(rows) == 1:
            return culler_sentence(guilty[0])
        named = ", ".join(f"‘{row.culler}’" for row in guilty[:3])
        more = f" and {len(guilty) - 3} more" if len(guilty) > 3 else ""
        return (
            f"{len(guilty)} of {counted(len(rows), 'culler')} broke "
            f"{'its promise' if len(guilty) == 1 else 'their promises'}: {named}{more}."
        )
    if not rows:
        return "No culler was judged."
    if open_:
        if len(rows) == 1:
            return culler_sentence(open_[0])
        return f"{len(open_)} of {len(rows)} cullers could not be judged, or not to the end."
    if len(rows) == 1:
        return culler_sentence(rows[0])
    if all(row.status is Status.MEASURED for row in rows):
        return f"{len(rows)} cullers that promise nothing were measured, in {frames}."
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
