"""Reading back what `visref bench` wrote: its advice and its plot, for a report's page."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from visref.errors import InputError
from visref.files import FolderKind
from visref.run_folder.inside import json_inside, read_inside
from visref.run_folder.json_fields import Fields
from visref.run_folder.layout import REPORT

MARKER = "bench.json"
PLOT = "bench.svg"
FIX = "give a folder that `visref bench` wrote"
# An XML declaration and a document type may stand before the first element.
_SVG_HEAD = 1024
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
    top = Fields(json_inside(folder, MARKER, FIX), source, FIX)
    known = top.has("format") and top.text("format") == FORMAT
    if not known or top.whole("version") != 1:
        raise top.error("this is no bench (format visref-bench, version 1)")
    says = top.text_list("says")
    if not says:
        raise top.error("it says nothing", "says")
    machine = top.inner("machine")
    machine.text("processor")
    for name in ("cores", "threads"):
        if not machine.is_null(name):
            machine.whole(name, least=1)
    frames = len(top.inner("path").whole_list("frames"))
    scene = Path(top.inner("scene").text("source")).name
    svg = read_inside(folder, PLOT, FIX)
    # As an image a plot cannot act; that it is one keeps other files out of a page.
    if b"<svg" not in svg[:_SVG_HEAD]:
        raise InputError("this is no SVG", source=str(folder / PLOT), fix=FIX)
    return BenchFolder(folder, says, scene, frames, machine.plain(), svg)
