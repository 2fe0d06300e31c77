"""Waivers that nothing needs any more: they would hide the next fault."""

from __future__ import annotations

from collections.abc import Sequence

from visref.findings import Code, Finding
from visref.judging.outcome import CullerRecord
from visref.judging.policy import Accepting, Waiver
from visref.wording import counted


def policy_findings(
    accepting: Accepting, records: Sequence[CullerRecord], frames: Sequence[int]
) -> list[Finding]:
    """What a whole run says of its policy: the remarks of its reader, and stale waivers. `frames`:
    the numbers of the path's."""
    policy = accepting.policy
    found = list(policy.remarks)
    used = _used(accepting, records)
    for place, waiver in enumerate(policy.waivers):
        today = policy.today
        if waiver.expires is not None and today is not None and today > waiver.expires:
            why = f"it expired on {waiver.expires.isoformat()}"
        else:
            why = "" if place in used else _unneeded(waiver, records, frames)
        if why:
            text = f"waive[{place}] (object '{waiver.object}'): {why}"
            found.append(Finding(Code.STALE_WAIVER, text))
    return found


def _unneeded(waiver: Waiver, records: Sequence[CullerRecord], frames: Sequence[int]) -> str:
    """Why a waiver that names no miss is stale; empty where it is not: what was not judged, or not
    by every culler that it is for, may yet have what it names."""
    its = [record for record in records if waiver.is_for(record.spec)]
    covered = {frame for frame in frames if waiver.covers(frame)}
    if not its or not all(record.judged_whole(covered) for record in its):
        return ""
    if not covered:
        return "the path has none of the frames that it covers"
    judged = counted(len(covered), "frame")
    return f"every frame that it covers was judged ({judged}), and it names no miss"


def _used(accepting: Accepting, records: Sequence[CullerRecord]) -> set[int]:
    """The waivers, by place, that name a miss, of whatever kind."""
    if not accepting.policy.waivers:
        return set()
    return {
        place
        for record in records
        for row in record.frames
        for obj in row.verdict.misses.columns.object.tolist()
        for place in accepting.waiving(obj, row.frame, record.spec)
    }
