"""The board: many methods on many scenes in one table, from run folders alone.

A run is a scene. In each, all methods were asked about the same frames in turn, so their times are
told as quotients within that run; between runs nothing is divided.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from visref.errors import InputError
from visref.files import refuse_inputs, replacing_file
from visref.report import words
from visref.report.run_tables import Grid, grid_markdown
from visref.report.savings import kind_of
from visref.report.summary import CullerSummary, summarise
from visref.run_folder.read import RunFolder

BASELINE = "frustum"
INTRODUCTION = """\
# The board

Methods by what they lose and what they cost, on several scenes: made by `visref report RUN …
--board FILE.md` of run folders, a scene each.

## Rules
"""
RULES = f"""\
- **The same for all.** Every method is asked about the same frames of the same scene at the same
  size, one after the other within each frame, in one process. Options are the defaults, or those
  that the row names; none is chosen for a scene.
- **It may** look at the scene as long as it likes before the first frame, remember earlier frames,
  and is told when something moves, appears or vanishes, and when the camera cuts.
- **It may not** see the truth, the frames to come, or what another method drew.
- **It declares a promise** beforehand. *Conservative* and *exact* ones may not lose a sample: what
  they lose is a violation. *Approximate* ones promise nothing; what they lose is counted as missed,
  with its greatest age: for how many frames it had been in view.
- **Time** is that of deciding and drawing, the median over frames after the first, over that of
  `{BASELINE}` in the same run; the first frame pays for what is compiled or made once.
- **Drawn for nothing** is the share of what a method drew, unit by unit, that shows in no sample.
"""


@dataclass(frozen=True)
class Entry:
    """One method in one run. `misses`: that lose samples; `oldest`: the greatest age of one, in
    frames, None where none has one; `time`: over the baseline's, None where either was not
    measured."""

    row: CullerSummary
    misses: int
    oldest: int | None
    time: float | None


# How a board begins: what is none is never replaced.
_BEGINS = b"# The board\n"


def write_board(runs: Sequence[RunFolder], out: Path) -> None:
    """Write the board as Markdown. Raises InputError where no run is given, two are of one name, or
    `out` cannot be written to, is in a run's folder, or is a file that is no board."""
    if not runs:
        raise InputError("no run folder was given", fix="name one that `visref run` wrote")
    refuse_inputs(out, [file for run in runs for file in run.folder.rglob("*")])
    for run in runs:
        if out.resolve().is_relative_to(run.folder.resolve()):
            raise InputError(
                "a board in a run's folder is none of its files",
                source=str(out),
                fix="name another place",
            )
    with replacing_file(out, begins=_BEGINS) as beside:
        beside.write_text(board_markdown(runs), encoding="utf-8")


def board_markdown(runs: Sequence[RunFolder]) -> str:
    """Rules, a table over all runs, and one for each. The same runs give the same bytes."""
    names = [run.folder.name for run in runs]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(f"two runs are named {twice}", fix="name the folders apart")
    entries = {run.folder.name: _entries(run) for run in runs}
    over_all = grid_markdown(_over_all(entries), level=2)
    of_each = [grid_markdown(_of_run(run, entries[run.folder.name])) for run in runs]
    return "\n".join([INTRODUCTION, RULES, over_all, *of_each])


def _entries(run: RunFolder) -> dict[str, Entry]:
    rows = {culler: summarise(run, culler) for culler in run.cullers}
    base = next((row.ms_median for name, row in rows.items() if kind_of(name) == BASELINE), None)
    return {culler: _entry(row, base) for culler, row in rows.items()}


def _entry(row: CullerSummary, base: float | None) -> Entry:
    return Entry(
        row,
        row.counts.losing - row.counts.ties,
        max(row.ages, default=None),
        row.ms_median / base if row.ms_median is not None and base else None,
    )


def _over_all(entries: Mapping[str, Mapping[str, Entry]]) -> Grid:
    methods = list(dict.fromkeys(name for of_run in entries.values() for name in of_run))
    rows = []
    for method in methods:
        found = [of_run[method] for of_run in entries.values() if method in of_run]
        judged = [one for one in found if not one.row.failed]
        rows.append(
            (
                method,
                found[0].row.promise.value,
                _of(len(judged), len(entries)),
                _of(sum(one.row.counts.violations > 0 for one in judged), len(judged)),
                _of(sum(one.misses > 0 for one in judged), len(judged)),
                words.count(_oldest(judged)),
                *(
                    show(_median(judged, value))
                    for value, show in (
                        (lambda one: one.row.superfluous_share, words.percent),
                        (lambda one: one.row.triangle_share, words.percent),
                        (lambda one: one.row.queries, words.quantity),
                        (lambda one: one.time, _times),
                    )
                ),
            )
        )
    headings = (
        "method", "promise", "scenes", "with violations", "with misses", "oldest miss",
        "drawn for nothing", "triangles", "queries a frame", f"time over {BASELINE}",
    )  # fmt: skip
    title = f"All scenes ({len(entries)}): counts, and medians over scenes"
    return Grid(title, headings, tuple(rows))


def _of_run(run: RunFolder, entries: Mapping[str, Entry]) -> Grid:
    rows = tuple(
        (
            method,
            words.HEADLINES[one.row.status].lower(),
            words.count(one.row.counts.violations),
            words.count(one.misses),
            words.count(one.row.counts.missed_pixels),
            words.count(one.oldest),
            words.percent(one.row.superfluous_share),
            words.percent(one.row.triangle_share),
            words.quantity(one.row.queries),
            _times(one.time),
        )
        for method, one in entries.items()
    )
    frames = words.counted(len(run.frame_numbers), "frame")
    moving = "moving" if run.manifest.motion is not None else "still"
    title = ", ".join(
        (
            run.folder.name,
            run.scene_name,
            f"{words.large(run.manifest.scene.triangles)} triangles",
            f"{words.large(run.manifest.scene.objects)} objects",
            moving,
            frames,
            run.resolution(),
        )
    )
    headings = (
        "method", "verdict", "violations", "missed", "samples lost", "oldest miss",
        "drawn for nothing", "triangles", "queries a frame", f"time over {BASELINE}",
    )  # fmt: skip
    return Grid(title, headings, rows)


def _median(entries: Sequence[Entry], value: Callable[[Entry], float | None]) -> float | None:
    found = [one for one in map(value, entries) if one is not None]
    return statistics.median(found) if found else None


def _of(count: int, all_: int) -> str:
    return f"{count} of {all_}"


def _oldest(entries: Sequence[Entry]) -> int | None:
    return max((one.oldest for one in entries if one.oldest is not None), default=None)


def _times(value: float | None) -> str:
    return f"{value:.2f}" if value is not None else "–"
