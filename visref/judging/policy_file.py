"""Policies as files: TOML, read and written. `docs/policy.md` says what each field means.

What is refused here is what the schema `policy` in `visref.schemas` refuses; a test holds the two
together. Fields that nobody here knows are passed over, with a finding.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, date, datetime
from glob import escape
from itertools import groupby
from pathlib import Path
from types import MappingProxyType
from typing import Any

from visref.errors import InputError
from visref.files import read_toml
from visref.findings import Code, Finding, Severity
from visref.judging.judge import MissKind
from visref.judging.outcome import RunOutcome
from visref.judging.policy import Policy, Span, Waiver
from visref.scene import Scene
from visref.wording import did_you_mean

FIX = "see docs/policy.md"
# Stands first in a policy that `adopted` made.
ADOPTED = (
    "# What was missed when this policy was made. Each entry wants a reason: without one the\n"
    "# policy is refused. Take out what is to be mended instead, and give the rest a day on which\n"
    "# it expires (expires = 2030-01-31).\n"
)
# A first adoption of a large engine waives some thousands of objects.
_MOST_BYTES = 1 << 24
_MOST = 1_000_000_000
_SPAN = re.compile(
    "(?P<one>[0-9]{1,9})|(?P<start>[0-9]{0,9}):(?P<stop>[0-9]{0,9})(:(?P<step>[1-9][0-9]{0,8})?)?"
)
_DAY = re.compile("[0-9]{4}-[0-9]{2}-[0-9]{2}")
_KNOWN = ("latency_frames", "min_samples", "max_undecided", "severities", "waive")
_KNOWN_OF_A_WAIVER = ("object", "frames", "culler", "reason", "expires")


def read_policy(file: Path | str, *, today: date | None = None) -> Policy:
    """The policy in a TOML file. `today`: the day on which it is asked, by default the clock's, in
    UTC. Raises InputError naming the file and the place in it."""
    file = Path(file)
    try:
        data, value = read_toml(file, _MOST_BYTES, "a policy")
        policy = policy_of(value)
    except InputError as error:
        raise error.at(source=str(file)) from error
    digest = hashlib.sha256(data).hexdigest()
    day = today or datetime.now(UTC).date()
    return Policy(**{**vars(policy), "today": day, "source": str(file), "sha256": digest})


def policy_of(value: object) -> Policy:
    """The policy from parsed TOML, or JSON. Raises InputError naming the place."""
    if not isinstance(value, dict):
        raise InputError("this is no table", fix=FIX)
    remarks = [*_unknown(value, _KNOWN, "")]
    waivers = value.get("waive", [])
    if not isinstance(waivers, list) or not all(isinstance(one, dict) for one in waivers):
        raise InputError("it is no list of tables: write [[waive]]", place="waive", fix=FIX)
    for place, one in enumerate(waivers):
        remarks += _unknown(one, _KNOWN_OF_A_WAIVER, f"waive[{place}]")
    severities, unknown = _severities(value.get("severities", {}))
    share = value.get("max_undecided", 0.5)
    if isinstance(share, bool) or not isinstance(share, (int, float)) or not 0 <= share <= 1:
        raise InputError("it is no share from 0 to 1", place="max_undecided", fix=FIX)
    return Policy(
        latency_frames=_whole(value, "latency_frames"),
        min_samples=_whole(value, "min_samples"),
        max_undecided=float(share),
        waivers=tuple(_waiver(one, f"waive[{place}]") for place, one in enumerate(waivers)),
        severities=severities,
        remarks=(*remarks, *unknown),
    )


def _unknown(value: Mapping[str, Any], known: Sequence[str], place: str) -> Iterable[Finding]:
    for name in value:
        if name not in known:
            at = f"{place}.{name}" if place else name
            yield Finding(Code.FIELD_IGNORED, f"the policy's '{at}'; {did_you_mean(name, known)}")


def _severities(value: Any) -> tuple[Mapping[Code, Severity], list[Finding]]:
    if not isinstance(value, dict):
        raise InputError("it is no table", place="severities", fix=FIX)
    found: dict[Code, Severity] = {}
    unknown = []
    for name, level in value.items():
        place = f"severities.{name}"
        if not isinstance(level, str) or level not in tuple(Severity):
            fix = f"write one of {', '.join(Severity)}"
            raise InputError("it is no severity", place=place, fix=fix)
        if name not in Code.__members__:
            meant = did_you_mean(name, Code.__members__, "see docs/findings.md")
            unknown.append(Finding(Code.FIELD_IGNORED, f"the policy's '{place}'; {meant}"))
            continue
        code = Code[name]
        if code.rule.severity is Severity.ERROR and level != Severity.ERROR:
            raise InputError(
                "what fails a run is not made less than an error",
                place=place,
                fix="accept a miss by [[waive]], with its reason",
            )
        found[code] = Severity(level)
    return MappingProxyType(found), unknown


def _waiver(value: Mapping[str, Any], place: str) -> Waiver:
    pattern = _text(value, "object", place)
    culler = _text(value, "culler", place) if "culler" in value else "*"
    if not _text(value, "reason", place, may_be_empty=True).strip():
        raise InputError(
            "the reason is empty",
            place=f"{place}.reason",
            fix=f"say why the misses of '{pattern}' are accepted",
        )
    return Waiver(
        pattern,
        value["reason"],
        _spans(value["frames"], f"{place}.frames") if "frames" in value else (),
        culler,
        _day(value["expires"], f"{place}.expires") if "expires" in value else None,
    )


def _text(value: Mapping[str, Any], name: str, place: str, *, may_be_empty: bool = False) -> str:
    found = value.get(name)
    if not isinstance(found, str) or not (found or may_be_empty):
        problem = "it is missing" if name not in value else "it is no text, or an empty one"
        raise InputError(problem, place=f"{place}.{name}", fix=FIX)
    return found


def _whole(value: Mapping[str, Any], name: str) -> int:
    found = value.get(name, 0)
    if isinstance(found, bool) or not isinstance(found, int) or not 0 <= found <= _MOST:
        raise InputError(f"it is no whole number from 0 to {_MOST}", place=name, fix=FIX)
    return found


def _spans(value: Any, place: str) -> tuple[Span, ...]:
    """Frames: a number, a slice as of --frames, or a list of these."""
    each = value if isinstance(value, list) else [value]
    if not each:
        raise InputError("it names no frame", place=place, fix="leave it out for all frames")
    return tuple(_span(one, place) for one in each)


def _span(value: Any, place: str) -> Span:
    fix = 'write a frame\'s number, "A:B" or "A:B:STEP" (B is the first that is not meant)'
    if isinstance(value, int) and not isinstance(value, bool) and 0 <= value < _MOST:
        return Span(value, value + 1)
    match = _SPAN.fullmatch(value) if isinstance(value, str) else None
    if match is None:
        raise InputError("it is no frame and no slice of frames", place=place, fix=fix)
    if match["one"]:
        return Span(int(match["one"]), int(match["one"]) + 1)
    start = int(match["start"] or 0)
    stop = int(match["stop"]) if match["stop"] else None
    if stop is not None and stop <= start:
        raise InputError(f"'{value}' names no frame", place=place, fix=fix)
    return Span(start, stop, int(match["step"] or 1))


def _day(value: Any, place: str) -> date:
    if isinstance(value, date) and not isinstance(value, datetime):
        return value
    try:
        return day_of(value if isinstance(value, str) else "")
    except ValueError as error:
        raise InputError("it is no day", place=place, fix="write YYYY-MM-DD") from error


def day_of(text: str) -> date:
    """A day as YYYY-MM-DD. Raises ValueError for anything else."""
    if not _DAY.fullmatch(text):
        raise ValueError(text)
    return date.fromisoformat(text)


def to_toml(policy: Policy) -> str:
    """A policy as the text of a file: what `read_policy` reads back, remarks and the day aside."""
    lines = [
        f"latency_frames = {policy.latency_frames}",
        f"min_samples = {policy.min_samples}",
        f"max_undecided = {policy.max_undecided!r}",
    ]
    if policy.severities:
        lines += ["", "[severities]"]
        lines += [f'{code.value} = "{level.value}"' for code, level in policy.severities.items()]
    for waiver in policy.waivers:
        lines += ["", "[[waive]]", f"object = {_quoted(waiver.object)}"]
        if waiver.frames:
            lines.append(f"frames = [{', '.join(_span_text(span) for span in waiver.frames)}]")
        if waiver.culler != "*":
            lines.append(f"culler = {_quoted(waiver.culler)}")
        lines.append(f"reason = {_quoted(waiver.reason)}")
        if waiver.expires is not None:
            lines.append(f"expires = {waiver.expires.isoformat()}")
    return "\n".join(lines) + "\n"


def _span_text(span: Span) -> str:
    text = str(span)
    return text if text.isdecimal() else _quoted(text)


def _quoted(text: str) -> str:
    """A basic string of TOML, whose escapes are JSON's."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def adopted(policy: Policy, outcome: RunOutcome, scene: Scene) -> Policy:
    """The policy with a waiver more for each object that has confirmed misses, and no reason yet:
    whoever accepts them says why. `policy`: what was judged by."""
    frames: dict[int, set[int]] = {}
    for record in outcome.cullers:
        if not record.promise.convicts:
            continue
        for row in record.frames:
            misses = row.verdict.misses
            for obj in misses.columns.object[misses.are(MissKind.CONFIRMED)].tolist():
                frames.setdefault(obj, set()).add(row.frame)
    fresh = tuple(
        Waiver(escape(scene.names[index]), "", spans_of(frames[index])) for index in sorted(frames)
    )
    return Policy(**{**vars(policy), "waivers": (*policy.waivers, *fresh)})


def spans_of(frames: Iterable[int]) -> tuple[Span, ...]:
    """Frames, by number, as few spans of neighbours, ascending."""
    runs = groupby(enumerate(sorted(set(frames))), key=lambda pair: pair[1] - pair[0])
    spans = []
    for _, run in runs:
        numbers = [number for _, number in run]
        spans.append(Span(numbers[0], numbers[-1] + 1))
    return tuple(spans)
