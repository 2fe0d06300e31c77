"""What an engine's author declares: what it is made for, and which cases it is known to fail.

    can = ["moving", "views"]

    [[expect]]
    case = "glass"
    reason = "windows are drawn in a pass of their own, which is not recorded yet"

A case that is expected to fail and passes is an error, so that the list never outlives its reasons.
"""

from __future__ import annotations

import tomllib
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from visref.conformance.classes import CLASSES, checked_classes
from visref.errors import InputError
from visref.files import map_file
from visref.recordings.names import shown_name
from visref.wording import did_you_mean

# So much of a name may be near another.
_SHOWN = 200


@dataclass(frozen=True)
class Declared:
    """`can`: the classes of cases that the engine is made for, None for all. `reasons`: by case,
    why it is expected to fail."""

    can: frozenset[str] | None = None
    reasons: Mapping[str, str] = field(default_factory=dict)

    def lacks(self, classes: Collection[str]) -> list[str]:
        """Those of a case's classes that the engine is not made for, in their order."""
        return [] if self.can is None else [name for name in classes if name not in self.can]


def can_of(text: str) -> frozenset[str]:
    """The classes of `--can`: names with commas between; `plain` alone for none. Raises
    InputError."""
    if text == "plain":
        return frozenset()
    return checked_classes(text.split(","), f"--can {text}")


def read_declared(file: Path, cases: Collection[str]) -> Declared:
    """Read such a file. `cases`: the names that there are. Raises InputError for anything else
    than what stands above, for a case that there is not, one named twice, and one without a reason.
    """
    try:
        return _declared(_parsed(file), cases)
    except InputError as error:
        raise error.at(source=str(file)) from error


def _parsed(file: Path) -> Mapping[str, Any]:
    try:
        return tomllib.loads(map_file(file).tobytes().decode("utf-8"))
    except UnicodeDecodeError as error:
        raise InputError("this is not UTF-8 text", fix="check that it is the right file") from error
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise InputError(f"not valid TOML: {error}", fix="mend the syntax there") from error


def _declared(top: Mapping[str, Any], cases: Collection[str]) -> Declared:
    _known(top, ("can", "expect"), "")
    can = None
    if "can" in top:
        listed = top["can"]
        if not isinstance(listed, list) or not all(isinstance(name, str) for name in listed):
            raise InputError(
                "it is no list of classes", place="can", fix=f"known are {', '.join(CLASSES)}"
            )
        try:
            can = checked_classes(listed, "")
        except InputError as error:
            raise error.at(place="can") from error
    entries = top.get("expect", [])
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise InputError("it is no list of tables", place="expect", fix="write [[expect]]")
    reasons: dict[str, str] = {}
    for number, entry in enumerate(entries):
        try:
            case, reason = _expectation(entry, cases)
            if case in reasons:
                raise InputError(f"case '{case}' stands there twice", fix="keep one")
        except InputError as error:
            raise error.at(place=f"expect[{number}]") from error
        reasons[case] = reason
    return Declared(can, reasons)


def _expectation(entry: Mapping[str, Any], cases: Collection[str]) -> tuple[str, str]:
    _known(entry, ("case", "reason"), "")
    case, reason = entry.get("case"), entry.get("reason")
    if not isinstance(case, str):
        raise InputError("it names no case", fix='write case = "glass"')
    if case not in cases:
        near = did_you_mean(case[:_SHOWN], cases)
        raise InputError(f"there is no case {shown_name(case)}", fix=near)
    if not isinstance(reason, str) or not reason.strip():
        raise InputError(f"case '{case}' has no reason", fix="say why it fails")
    return case, " ".join(reason.split())


def _known(table: Mapping[str, Any], names: tuple[str, ...], place: str) -> None:
    for key in table:
        if key not in names:
            near = did_you_mean(key[:_SHOWN], names)
            raise InputError(f"unknown key {shown_name(key)}", place=place, fix=near)
