"""What is said of a recording that fits another path than the one given."""

from __future__ import annotations

from visref.alignment.search import Alignment, Known, best_alignment
from visref.camera_path import CameraPath
from visref.engines import TruthEngine
from visref.findings import Code, Finding
from visref.recordings.visible_sets import VisibleSets
from visref.timeline import Timeline
from visref.wording import counted


def misaligned(
    name: str,
    timeline: Timeline,
    path: CameraPath,
    recorded: VisibleSets,
    *,
    threads: int | None = None,
    lent: TruthEngine | None = None,
    known: Known | None = None,
) -> tuple[Finding | None, bool]:
    """The finding about a recording, `name` in reports, if there is one; and whether it can only be
    the input, since no engine errs that way by itself. `lent`, `known`: as of `best_alignment`."""
    found = best_alignment(timeline, path, recorded, threads=threads, lent=lent, known=known)
    if found is None:
        return None, False
    return Finding(Code.MISALIGNED, sentence(found), name), not found.hypothesis.engine


def sentence(found: Alignment) -> str:
    """Both agreements, the reading that fits, and the fix."""
    what = found.hypothesis
    text = (
        f"{percent(found.agreement)} if {what.reading}, {percent(found.as_given)} as given "
        f"({counted(found.frames, 'frame')} looked at): {what.fix}"
    )
    return f"{text}. Or {what.engine}" if what.engine else text


def percent(score: float) -> str:
    """Matthews' correlation in whole percent, and never rounded up to 100 nor below 0."""
    return f"{int(100.0 * max(score, 0.0))} %"
