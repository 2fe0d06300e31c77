"""Reading back what `visref bench` wrote: its advice and its plot, for a report's page."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from visref.errors import InputError
from visref.files import FolderKind
from visref.run_folder.json_fields import Fields
from visref.run_folder.layout import REPORT

MARKER = "bench.json"
PLOT = "bench.svg"
FORMAT = "visref-bench"


def _wrote(record: Any) -> Sequence[str] | None:
    """Of a bench's record, patterns of all files that visref writes into its folder."""
    if not isinstance(record, dict) or record.get("format") != FORMAT:
        return None
    return [r"bench\.(json|svg|png|md|html|csv)", *map(re.escape, REPORT)]


BENCH_FOLDER = FolderKind(MARKER, _wrote)


@dataclass(frozen=True)
class BenchFolder:
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


def read_bench(folder: Path) -> BenchFolder:
    """Read a bench folder. Raises InputError if a file of it is missing or spoilt."""
    source = str(folder / MARKER)
    fix = "give a folder that `visref bench` wrote"
    try:
        found = json.loads((folder / MARKER).read_text(encoding="utf-8"))
        svg = (folder / PLOT).read_bytes()
    except (OSError, ValueError) as error:
        raise InputError(f"cannot read it: {error}", source=source, fix=fix) from error
    known = isinstance(found, dict) and found.get("format") == FORMAT
    if not known or found.get("version") != 1:
        raise InputError("this is no bench (format visref-bench, version 1)", source=source,
                         fix=fix)  # fmt: skip
    fields = Fields(found, source, fix)
    try:
        says = tuple(map(str, found["says"]))
        frames = len(found["path"]["frames"])
    except (KeyError, TypeError) as error:
        raise fields.error(f"it lacks {error}") from error
    scene = Path(fields.inner("scene").text("source")).name
    return BenchFolder(folder, says, scene, frames, fields.inner("machine").plain(), svg)
