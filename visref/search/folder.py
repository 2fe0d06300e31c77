"""What a search leaves on disk, and goes on from.

corpus/state.json    what is searched, how many trials were made, and what they showed
corpus/000123.json   a trial that showed something new
faults/001/          a fault, the smallest scene that shows it
summary.json         trials, violations and faults; the same bytes for the same trials
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

from visref.errors import InputError
from visref.files import map_file, parse_json, replacing_file
from visref.judging.status import Exit
from visref.promise import Promise
from visref.run_folder.json_fields import Fields
from visref.search.judging import Kind, Violation
from visref.search.stream import Kept, Source, Stream
from visref.search.violation_file import read_violation, violation_json

G = TypeVar("G")

CORPUS, FAULTS, SUMMARY, STATE = "corpus", "faults", "summary.json", "state.json"
SUMMARY_FORMAT = "visref-fuzz"
_STATE_FORMAT, _TRIAL_FORMAT = "visref-fuzz-state", "visref-fuzz-trial"
_VERSION = 1
_FAULT = re.compile(rf"({FAULTS}/[0-9]{{3,}})?")
_FIX = "name a folder that `visref fuzz` wrote, or a new one"


@dataclass(frozen=True)
class Key:
    """What makes two violations one fault: what was done to an object, and why. Where no cause is
    known, whether all of the object was lost or a part, and how much: one sample, few or many."""

    kind: str
    cause: str
    how: str = ""

    @classmethod
    def among(cls, violation: Violation, known: Iterable[Key]) -> Key:
        """The first of some keys whose cause explains the violation, or else its own: small scenes
        seldom tell one cause from all others."""
        own = cls.of(violation)
        for one in known:
            if one.kind == own.kind and one.cause in violation.causes:
                return one
        return own

    @classmethod
    def of(cls, violation: Violation) -> Key:
        what = "superfluous" if violation.kind is Kind.SUPERFLUOUS else "missed"
        if violation.cause:
            # Whether all was lost or a part then hangs on the scene, not on the fault.
            return cls(what, violation.cause)
        samples = violation.samples
        much = (
            "one sample" if samples == 1 else "few samples" if samples <= _FEW else "many samples"
        )
        return cls(what, "", f"{violation.kind}, {much}")


# Samples of an object that a small error of rounding loses, at most.
_FEW = 8


@dataclass
class Fault:
    """A distinct fault: the first trial that showed it, with its genome in JSON values and those
    of the trials judged before it in the same run; the violation there, and in its smallest scene
    once there is one; in how many trials it was seen, of those whose causes were looked for, where
    further ones count for the first of their key. `folder`: where that scene is, "" until there
    is one, and the same for faults that come out alike; `structure`: what that scene is made of;
    `note`: why there is none."""

    key: Key
    trial: int
    genome: Any
    before: list[Any]
    violation: Violation
    trials: int = 1
    folder: str = ""
    structure: str = ""
    objects: int = 0
    triangles: int = 0
    note: str = ""

    @property
    def alike(self) -> tuple[str, str, str]:
        """What shrunk faults share that are one."""
        return self.key.kind, self.key.cause, self.structure


@dataclass
class Tally:
    """How many trials there were; `judged`: those in which something was visible and decided;
    `skipped`: of which no case could be made, or for which the culler is not; `broke_down`: in
    which the culler did, `failed` how it did first and `failed_in` in which trial; `violating`:
    with a violation; `violations`: objects, or units drawn for nothing, over all frames and
    views."""

    trials: int = 0
    judged: int = 0
    skipped: int = 0
    broke_down: int = 0
    violating: int = 0
    violations: int = 0
    failed: str = ""
    failed_in: int = -1
    promise: str = Promise.CONSERVATIVE.value


@dataclass(eq=False)
class SearchFolder:
    """A search's folder. `asked`: what is searched, in JSON values: who goes on must ask the
    same."""

    out: Path
    asked: dict[str, Any]
    tally: Tally = field(default_factory=Tally)
    faults: list[Fault] = field(default_factory=list)
    _written: int = 0

    @property
    def exit(self) -> Exit:
        """Of the search so far."""
        if self.faults:
            return Exit.VIOLATION
        if self.tally.broke_down or not self.tally.judged:
            return Exit.NOTHING_JUDGED
        return Exit.NO_VIOLATION

    @property
    def distinct(self) -> list[Fault]:
        """The faults, those that came out alike as the first of them, seen in the trials of all.
        Trials that show it twice count twice."""
        found: dict[Any, Fault] = {}
        for number, one in enumerate(self.faults):
            first = found.get(key := one.folder or number)
            found[key] = one if first is None else replace(first, trials=first.trials + one.trials)
        return list(found.values())

    # Reading.

    def open(self, stream: Stream[Any], source: Source[Any]) -> None:
        """Go on where an earlier search stopped, if there was one. Raises InputError where the
        folder holds anything else."""
        state = self.out / CORPUS / STATE
        if not state.is_file():
            if self.out.exists() and (not self.out.is_dir() or any(self.out.iterdir())):
                raise InputError(
                    "cannot write here: what stands there is no search",
                    source=str(self.out),
                    fix="name a new folder",
                )
            return
        fields = _fields(state, _STATE_FORMAT)
        if fields.free("asked") != self.asked:
            raise InputError(
                "another search was begun in this folder",
                source=str(state),
                fix="ask for the same, or name a new folder",
            )
        self.tally = Tally(
            **{name: _whole(fields, name) for name in _TALLY},
            failed=fields.text("failed"),
            failed_in=fields.whole("failed_in", least=-1),
            promise=fields.text("promise", among=tuple(Promise)),
        )
        stream.hits = Counter(_counts(fields.inner("hits")))
        stream.hits_then = Counter(_counts(fields.inner("hits_then")))
        stream.round_at = fields.whole("round_at")
        for number in fields.whole_list("kept"):
            stream.kept.append(_read_kept(self.out / CORPUS / _name(number), number, source))
        self.faults = [_read_fault(one) for one in fields.each("faults")]
        self._written = len(stream.kept)

    # Writing.

    def write(self, stream: Stream[Any], source: Source[Any]) -> None:
        """Write what is new, then the state, which says that it is whole, then the summary."""
        for one in stream.kept[self._written :]:
            row = {
                "format": _TRIAL_FORMAT,
                "version": _VERSION,
                "trial": one.trial,
                "genome": source.written(one.genome),
                "features": list(one.features),
            }
            _write(self.out / CORPUS / _name(one.trial), row)
        self._written = len(stream.kept)
        state = {
            "format": _STATE_FORMAT,
            "version": _VERSION,
            "asked": self.asked,
            **asdict(self.tally),
            "kept": [one.trial for one in stream.kept],
            "round_at": stream.round_at,
            "hits": dict(sorted(stream.hits.items())),
            "hits_then": dict(sorted(stream.hits_then.items())),
            "faults": [_fault_json(one) for one in self.faults],
        }
        _write(self.out / CORPUS / STATE, state)
        _write(self.out / SUMMARY, self.summary())

    def summary(self) -> dict[str, Any]:
        """`summary.json`."""
        tally = asdict(self.tally)
        return {
            "format": SUMMARY_FORMAT,
            "version": _VERSION,
            "asked": self.asked,
            "exit_status": int(self.exit),
            **tally,
            "faults": [
                {
                    "folder": one.folder,
                    "kind": one.key.kind,
                    "cause": one.key.cause,
                    "structure": one.structure,
                    "trial": one.trial,
                    "trials": one.trials,
                    "objects": one.objects,
                    "triangles": one.triangles,
                    "note": one.note,
                    "violation": violation_json(one.violation),
                }
                for one in self.distinct
            ],
        }


_TALLY = ("trials", "judged", "skipped", "broke_down", "violating", "violations")


def read_summary(value: Any, source: str = SUMMARY) -> dict[str, Any]:
    """`summary.json`, checked field by field. Raises InputError naming the place."""
    fields = Fields(value, source, _FIX)
    _check_format(fields, SUMMARY_FORMAT)
    fields.free("asked")
    if fields.whole("exit_status") not in (0, 1, 3):
        raise fields.error("it is no status of a search", "exit_status")
    for name in _TALLY:
        _whole(fields, name)
    fields.text("failed")
    fields.whole("failed_in", least=-1)
    fields.text("promise", among=tuple(Promise))
    for one in fields.each("faults"):
        one.text("folder", like=_FAULT)
        one.text("kind", among=("missed", "superfluous"))
        one.text("cause")
        one.text("structure")
        one.text("note")
        for name in ("trial", "objects", "triangles"):
            _whole(one, name)
        one.whole("trials", least=1)
        read_violation(one.inner("violation"))
    found: dict[str, Any] = fields.plain()
    return found


def _write(file: Path, value: Any) -> None:
    with replacing_file(file, begins=b"{") as beside:
        beside.write_text(json.dumps(value, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def _fields(file: Path, form: str) -> Fields:
    try:
        value = parse_json(map_file(file).tobytes())
    except InputError as error:
        raise error.at(source=str(file)) from error
    fields = Fields(value, str(file), _FIX)
    _check_format(fields, form)
    return fields


def _check_format(fields: Fields, form: str) -> None:
    fields.text("format", among=(form,))
    if fields.whole("version") != _VERSION:
        raise fields.error(f"this visref reads version {_VERSION}", "version")


def _name(trial: int) -> str:
    return f"{trial:06d}.json"


def _whole(fields: Fields, name: str) -> int:
    return fields.whole(name)


def _counts(fields: Fields) -> dict[str, int]:
    return {name: fields.whole(name, least=1) for name in fields.plain()}


def _read_kept(file: Path, number: int, source: Source[G]) -> Kept[G]:
    fields = _fields(file, _TRIAL_FORMAT)
    if fields.whole("trial") != number:
        raise fields.error("it is another trial's", "trial")
    try:
        genome = source.read(fields.free("genome"))
    except InputError as error:
        raise error.at(source=str(file), place="genome") from error
    return Kept(number, genome, fields.text_list("features"))


def _fault_json(fault: Fault) -> dict[str, Any]:
    return {
        **vars(fault),
        "key": vars(fault.key),
        "violation": violation_json(fault.violation),
    }


def _read_fault(fields: Fields) -> Fault:
    key = fields.inner("key")
    plain = fields.plain()
    if not isinstance(plain.get("before"), list):
        raise fields.error("it is no list", "before")
    return Fault(
        Key(key.text("kind"), key.text("cause"), key.text("how")),
        fields.whole("trial"),
        fields.free("genome"),
        plain["before"],
        read_violation(fields.inner("violation")),
        fields.whole("trials", least=1),
        fields.text("folder", like=_FAULT),
        fields.text("structure"),
        fields.whole("objects"),
        fields.whole("triangles"),
        fields.text("note"),
    )
