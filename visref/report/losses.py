"""What each culler lost, object by object, as the page tells the worst of it in full."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from visref.report import words
from visref.report.crops import Crop, CropBudget
from visref.report.misses import cause_of, object_misses
from visref.report.summary import CullerSummary
from visref.run_folder.claims import witnesses_about
from visref.run_folder.miss_facts import facts_text
from visref.run_folder.read import RunFolder
from visref.run_folder.rows import LostObject, Witness

# How many objects of a culler the page tells in full; its list has all of them.
MAX_LOST = 8


@dataclass(frozen=True)
class LostView:
    """An object missed by a culler, as the page tells it."""

    lost: LostObject
    why: str
    facts: str
    command: str
    pictured: bool
    crops: tuple[Crop, ...] = ()

    @property
    def worst(self) -> Witness:
        return self.lost.worst


def lost_views(
    run: RunFolder,
    row: CullerSummary,
    pictured: set[tuple[int, str, str]],
    out: Path,
    budget: CropBudget,
) -> list[LostView]:
    listed = row.lost[:MAX_LOST]
    keys = [(lost.worst.frame, lost.worst.view, lost.worst.object) for lost in listed]
    witnesses = witnesses_about(run.folder, run.manifest, row.culler, set(keys))
    missed = object_misses(run, row.culler)
    return [
        LostView(
            lost,
            cause_of(run, row.culler, missed.get(lost.worst.object)),
            facts_text(witnesses.get(key, {}).get("facts", {})),
            words.replay_command(run, lost.worst, out),
            (lost.worst.frame, lost.worst.view, row.culler) in pictured,
            budget.crops(witnesses.get(key)),
        )
        for lost, key in zip(listed, keys, strict=True)
    ]
