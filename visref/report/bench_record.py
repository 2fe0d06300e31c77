"""Reading back what `visref bench` wrote: its advice and its plot, for a report's page."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from visref.errors import InputError

MARKER = "bench.json"
PLOT = "bench.svg"


@dataclass(frozen=True)
class BenchRecord:
    """A bench folder: `says` its headline and sentences, `scene` by name, `svg` the plot."""

    folder: Path
    says: tuple[str, ...]
    scene: str
    frames: int
    machine: dict[str, Any]
    svg: bytes


def is_bench(folder: Path) -> bool:
    """Whether `visref bench` wrote this folder."""
    return (folder / MARKER).is_file()


def read_bench(folder: Path) -> BenchRecord:
    """Read a bench folder. Raises InputError if a file of it is missing or spoilt."""
    source = str(folder / MARKER)
    fix = "give a folder that `visref bench` wrote"
    try:
        record = json.loads((folder / MARKER).read_text(encoding="utf-8"))
        svg = (folder / PLOT).read_bytes()
    except (OSError, ValueError) as error:
        raise InputError(f"cannot read it: {error}", source=source, fix=fix) from error
    known = isinstance(record, dict) and record.get("format") == "visref-bench"
    if not known or record.get("version") != 1:
        raise InputError("this is no bench (format visref-bench, version 1)", source=source,
                         fix=fix)  # fmt: skip
    scene = Path(record["scene"]["source"]).name
    frames = len(record["path"]["frames"])
    return BenchRecord(folder, tuple(record["says"]), scene, frames, record["machine"], svg)
