"""Truth files of parts of a path, as one."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from visref.errors import InputError
from visref.files import refuse_inputs, replacing_file
from visref.recordings.truth_file import TRUTH_BEGINS
from visref.recordings.truth_reading import TruthRows, read_rows, write_joined

_SAME = {
    "scene": "of another scene",
    "path": "of another path",
    "engine": "cast by another engine",
    "exact": "cast by another engine",
    "ties_complete": "cast by another engine",
}


def merge_truths(files: Sequence[Path], out: Path) -> int:
    """Write the truth of all files to `out`, as `visref truth` writes it of all their frames; how
    many frames that is. Raises InputError where they do not belong together."""
    parts = [read_rows(file) for file in files]
    check_truths(parts)
    refuse_inputs(out, files)
    parts.sort(key=lambda part: part.facts["frames"][:1])
    for one, other in pairwise(parts):
        last, first = one.facts["frames"][-1:], other.facts["frames"][:1]
        if last >= first:
            raise InputError(
                f"its frames overlap with those of {one.file}, or lie between them",
                source=str(other.file),
                fix="cast parts that follow each other, with --frames A:B",
            )
    with replacing_file(out, begins=TRUTH_BEGINS) as beside:
        write_joined(beside, parts)
    return len({frame for part in parts for frame in part.facts["frames"]})


def check_truths(parts: Sequence[TruthRows]) -> None:
    """Raises InputError unless all are of one scene and path, cast by one engine."""
    first = parts[0]
    for part in parts[1:]:
        for name, problem in _SAME.items():
            if part.facts[name] != first.facts[name]:
                raise InputError(
                    f"it is {problem} than {first.file}",
                    source=str(part.file),
                    fix="merge truths of one scene, path and engine",
                )
