"""Whose each part of a frame's pictures is, as the page's script looks it up under the pointer."""

from __future__ import annotations

from collections.abc import Mapping, Set
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from PIL import Image

from visref.recordings.truth_reading import read_rows
from visref.report.packed import run_lengths
from visref.run_folder.facts import FIX
from visref.run_folder.inside import file_inside
from visref.run_folder.layout import TRUTH
from visref.run_folder.owners import owners_of
from visref.run_folder.read import RunFolder
from visref.wording import legible

# How many cells a map has along each side at most: as fine as a pointer can tell on a page.
MAP_SIDE = 480


class ObjectNames:
    """The names of what is visible in some frames of a run, by its truth; where that is of version
    1, or is not in the folder, nothing has a name."""

    def __init__(self, run: RunFolder, frames: Set[int]) -> None:
        self._table: pa.Table | None = None
        if frames and run.manifest.version >= 2 and (run.folder / TRUTH).is_file():
            wanted = pa.array(sorted(frames), pa.int32())
            truth = read_rows(file_inside(run.folder, TRUTH, FIX))
            groups = [one.filter(pc.is_in(one["frame"], wanted)) for one in truth.tables()]
            self._table = pa.concat_tables(groups) if groups else None

    def of(self, frame: int, view: str) -> dict[int, str]:
        """By id, the names of what is visible there."""
        if self._table is None:
            return {}
        table = self._table
        mine = pc.and_(pc.equal(table["frame"], frame), pc.equal(table["view"], view))
        rows = table.filter(mine)
        return dict(zip(rows["object"].to_pylist(), rows["name"].to_pylist(), strict=True))


def owner_map(picture: Image.Image, names: Mapping[int, str]) -> dict[str, Any]:
    """`width`, `height`; `names` of objects, of which -1 is the background's; and `runs`, row by
    row: so many cells of the object at that place among `names`, and so on."""
    owner = owners_of(picture)
    step = -(-max(owner.shape) // MAP_SIDE)
    owner = owner[step // 2 :: step, step // 2 :: step]
    objects, place = np.unique(owner, return_inverse=True)
    return {
        "width": owner.shape[1],
        "height": owner.shape[0],
        "names": [
            "background" if obj < 0 else legible(names.get(obj, f"object {obj}"))
            for obj in objects.tolist()
        ],
        "runs": run_lengths(place.reshape(-1)),
    }
