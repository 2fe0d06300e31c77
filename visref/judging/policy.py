"""What a user has decided to accept: from misses as they were found, and a policy, to kinds.

A pure pass: the kind of a miss hangs on the miss, its frame, its culler and the policy alone, never
on the clock, on other misses or on what came before; and a record that has been through it may go
through it again, with the same policy or another. Whether a waiver is stale hangs on the whole run
besides, and on a date: `visref.judging.stale`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from datetime import date
from fnmatch import fnmatchcase, translate
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.findings import Code, Finding, Severity
from visref.judging.judge import FrameVerdict, violations
from visref.judging.misses import CODES, Misses, MissKind
from visref.judging.names import Names
from visref.judging.status import MAX_UNDECIDED
from visref.promise import Promise

# What a policy decides: these are one kind before it, a confirmed miss.
_OPEN = [
    CODES[kind] for kind in (MissKind.CONFIRMED, MissKind.SMALL, MissKind.LATE, MissKind.WAIVED)
]
# What makes a text a pattern of `fnmatch`.
_WILD = frozenset("*?[")


@dataclass(frozen=True)
class Span:
    """Frames by number, as a slice counts: `start`, and every `step`-th after it before `stop`
    (None: without end)."""

    start: int = 0
    stop: int | None = None
    step: int = 1

    def covers(self, frame: int) -> bool:
        before_end = self.stop is None or frame < self.stop
        return frame >= self.start and before_end and (frame - self.start) % self.step == 0

    def __str__(self) -> str:
        """As a policy's file says it."""
        if self.stop == self.start + 1:
            return str(self.start)
        stop = "" if self.stop is None else str(self.stop)
        return f"{self.start}:{stop}" + (f":{self.step}" if self.step > 1 else "")


@dataclass(frozen=True)
class Waiver:
    """An accepted miss: `object` and `culler` are patterns as `fnmatch` has them, case and all, of
    an object's name or path and of a culler's name; `frames` empty: all. `expires`: the last day
    on which it is not stale."""

    object: str
    reason: str
    frames: tuple[Span, ...] = ()
    culler: str = "*"
    expires: date | None = None

    def covers(self, frame: int) -> bool:
        return not self.frames or any(span.covers(frame) for span in self.frames)

    def is_for(self, culler: str) -> bool:
        return fnmatchcase(culler, self.culler)

    def to_json(self) -> dict[str, Any]:
        return {
            "object": self.object,
            "reason": self.reason,
            "frames": [str(span) for span in self.frames],
            "culler": self.culler,
            "expires": None if self.expires is None else self.expires.isoformat(),
        }


@dataclass(frozen=True)
class Policy:
    """What is accepted, and on which day it was asked. The default accepts nothing.

    `latency_frames`: a miss of a lower age is late. `min_samples`: an object that loses fewer
    decided samples in a cell is small. `max_undecided`: above this share of the owned samples a
    verdict says nothing. `severities`: of findings, by code, in place of the catalogue's.
    `source` and `sha256`: of its file, `remarks` what a reader of that should know.
    """

    latency_frames: int = 0
    min_samples: int = 0
    max_undecided: float = MAX_UNDECIDED
    waivers: tuple[Waiver, ...] = ()
    severities: Mapping[Code, Severity] = field(default_factory=lambda: MappingProxyType({}))
    today: date | None = None
    source: str = ""
    sha256: str = ""
    remarks: tuple[Finding, ...] = ()

    def __getstate__(self) -> dict[str, Any]:
        # A proxy cannot be pickled.
        return {**vars(self), "severities": dict(self.severities)}

    def severity_of(self, code: Code) -> Severity:
        return self.severities.get(code, code.rule.severity)

    def to_json(self) -> dict[str, Any]:
        """As it stands in manifest.json."""
        return {
            "source": self.source,
            "sha256": self.sha256,
            "today": None if self.today is None else self.today.isoformat(),
            "latency_frames": self.latency_frames,
            "min_samples": self.min_samples,
            "max_undecided": self.max_undecided,
            "severities": {code.value: level.value for code, level in self.severities.items()},
            "waive": [waiver.to_json() for waiver in self.waivers],
        }


class Accepting:
    """A policy on the objects of one scene."""

    def __init__(self, policy: Policy, scene: Names) -> None:
        self.policy = policy
        self._scene = scene
        # A waiver by its place in the policy: plain names apart, of which there may be thousands.
        self._plain: dict[str, list[int]] = {}
        self._patterns: list[tuple[int, re.Pattern[str]]] = []
        for place, waiver in enumerate(policy.waivers):
            if _WILD.isdisjoint(waiver.object):
                self._plain.setdefault(waiver.object, []).append(place)
            else:
                self._patterns.append((place, re.compile(translate(waiver.object))))
        # By object, the waivers that name it: patterns are tried once for each that is missed.
        self._naming: dict[int, tuple[int, ...]] = {}

    def kinds(self, misses: Misses, frame: int, culler: str) -> NDArray[np.int8]:
        """What misses of this frame are put down to, (k,) places in `KINDS`: a tie and what is
        within the raster's tolerance stay, of the rest the first that holds of small, late, waived,
        confirmed."""
        columns, policy = misses.columns, self.policy
        open_ = np.isin(columns.kind, _OPEN)
        small = columns.samples < policy.min_samples
        late = (columns.age >= 0) & (columns.age < policy.latency_frames)
        kinds = np.where(open_, CODES[MissKind.CONFIRMED], columns.kind).astype(np.int8)
        kinds[open_ & small] = CODES[MissKind.SMALL]
        kinds[open_ & ~small & late] = CODES[MissKind.LATE]
        if policy.waivers:
            for place in np.flatnonzero(open_ & ~small & ~late):
                if next(self.waiving(int(columns.object[place]), frame, culler), None) is not None:
                    kinds[place] = CODES[MissKind.WAIVED]
        return kinds

    def verdict(
        self, verdict: FrameVerdict, promise: Promise, frame: int, culler: str
    ) -> FrameVerdict:
        """A culler's verdict on a frame, with its misses by kind and counted so."""
        if not verdict.misses:
            return verdict
        misses = verdict.misses.with_columns(kind=self.kinds(verdict.misses, frame, culler))
        confirmed = misses.number_of(MissKind.CONFIRMED)
        counts = replace(
            verdict.counts,
            small=misses.number_of(MissKind.SMALL),
            late=misses.number_of(MissKind.LATE),
            waived=misses.number_of(MissKind.WAIVED),
            confirmed=confirmed,
            violations=violations(promise, confirmed, len(verdict.confirmed_superfluous)),
        )
        return replace(verdict, misses=misses, counts=counts)

    def waiving(self, index: int, frame: int, culler: str) -> Iterator[int]:
        """The waivers, by place, that name an object's miss in a frame."""
        if index not in self._naming:
            texts = {self._scene.names[index], self._scene.paths[index]}
            found = {place for text in texts for place in self._plain.get(text, ())}
            found |= {place for place, like in self._patterns if any(map(like.match, texts))}
            self._naming[index] = tuple(sorted(found))
        for place in self._naming[index]:
            waiver = self.policy.waivers[place]
            if waiver.covers(frame) and waiver.is_for(culler):
                yield place
