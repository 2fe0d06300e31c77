"""The page: what it shows of each run, chosen here and laid out by the template."""

from __future__ import annotations

import base64
import re
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from markupsafe import Markup

from visref.findings import Code, Rule, Severity, rule_of
from visref.judging.status import Status
from visref.papers import tables_beside
from visref.picking import evenly_picked
from visref.report import words
from visref.report.bench_folder import BenchFolder
from visref.report.crops import Crop, CropBudget
from visref.report.embedded import data_uri
from visref.report.environment import page_environment
from visref.report.misses import cause_of, object_misses, why_lines
from visref.report.plots import STYLES, Plot, Series, on_scale
from visref.report.run_tables import shares_text, value_text
from visref.report.savings import savings
from visref.report.summary import (
    NO_FPR_PX,
    RATES,
    CullerSummary,
    best,
    of_frames,
    summarise,
)
from visref.report.tables import table_view
from visref.run_folder.causes import Cause
from visref.run_folder.claims import witnesses_about
from visref.run_folder.layout import COUNTS, MAX_MARGIN_PX
from visref.run_folder.miss_facts import facts_text
from visref.run_folder.read import RunFolder
from visref.run_folder.rows import FindingRow, FrameRow, LostObject, PictureSet, Witness
from visref.wording import legible

# How much of a long list the page carries; the tables in the run folder have the rest.
MAX_LOST = 8
MAX_FINDINGS = 8
MAX_SUPERFLUOUS = 5
MAX_MOVED = 10
# Pictures are most of the page's weight: about 100 kB each.
MAX_FRAMES = 12

_VIEWS = {
    "picture": "The scene",
    "drawn": "Who was drawn, and for what",
    "ids": "Objects",
    "errors": "Missed samples",
}


@dataclass(frozen=True)
class Cell:
    """One number of the page's table of cullers: its column, its text, and whether it is the best
    of the safe cullers."""

    column: str
    text: str
    note: str = ""
    best: bool = False
    alarm: bool = False


@dataclass(frozen=True)
class Column:
    """A column of the page's table of cullers."""

    name: str
    title: str
    hint: str
    group: str


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


@dataclass(frozen=True)
class Picture:
    """An image of a frame: what it shows, in words, and the bytes."""

    what: str
    title: str
    uri: str


@dataclass(frozen=True)
class CullerView:
    """One culler's part of a frame of the browser. `row` is that of its drawn set, which is for all
    views of the frame where it is `joint`."""

    number: int
    culler: str
    row: FrameRow
    joint: bool
    pictures: dict[str, Picture]


@dataclass(frozen=True)
class FrameView:
    """A view of a frame in the browser: pictures that all cullers share, and each culler's own.
    `moved`: what moved since the frame before, in words."""

    frame: int
    view: str
    moved: str
    shared: dict[str, Picture]
    cullers: list[CullerView]

    @property
    def title(self) -> str:
        return f"Frame {self.frame}" + (f", view {legible(self.view)}" if self.view else "")

    @property
    def visible(self) -> int | None:
        """Objects that are visible in this view; None where no culler's set was for it alone."""
        return next((one.row.visible for one in self.cullers if not one.joint), None)


@dataclass(frozen=True)
class FindingGroup:
    """The findings of one code."""

    rule: Rule
    findings: list[FindingRow]
    left_out: int

    @property
    def total(self) -> int:
        return len(self.findings) + self.left_out


# Findings that have a section of their own: the end of its id, and its heading.
_ELSEWHERE: dict[str, tuple[str, str]] = {
    Code.MISSED_OBJECT: ("lost", "What was lost"),
    Code.MISSED_DECLARED: ("lost", "What was lost"),
    Code.DRAWN_HIDDEN: ("hidden", "Drawn against the promise"),
}
_COLUMNS = (
    Column("visible", "visible", "object-frames that own a sample", "sums over frames"),
    Column("drawn", "drawn", "units in the final image's draw list", "sums over frames"),
    Column("superfluous", "superfluous", "drawn, and nothing of it visible", "sums over frames"),
    Column("missed", "missed", "visible, and shown nowhere", "sums over frames"),
    Column("partly_missed", "partly missed", "shown somewhere, lost elsewhere",
           "sums over frames"),
    Column("missed_pixels", "samples lost", "nothing at the nearest depth drawn",
           "sums over frames"),
    # What is partly missed has its share below it.
    *(Column(rate.key, rate.name, rate.meaning, "rates") for rate in RATES
      if rate.key != "partly"),
    Column("undecided_share", "undecided", "share of the owned samples on which the verdict hangs "
           "and which nobody can decide", "rates"),
    Column("queries", "queries", "mean, asked of the depth buffer", "per frame"),
    Column("batches", "batches", "mean, waits for answers (stalls)", "per frame"),
    Column("query_fragments", "query fragments", "mean, samples that query geometry covers",
           "per frame"),
    Column("triangle_share", "triangles drawn", "mean share of the scene", "per frame"),
    Column("ms_median", "ms", "median of the culler's call", "per frame"),
)  # fmt: skip


# The first column of each group.
_STARTS = [next(c.name for c in _COLUMNS if c.group == group)
           for group in dict.fromkeys(c.group for c in _COLUMNS)]  # fmt: skip


def page_html(runs: Sequence[RunFolder], benches: Sequence[BenchFolder], out: Path) -> str:
    """The whole page. `out` is the folder it will stand in: replay commands start there."""
    environment = page_environment("visref.report")
    environment.filters |= {
        "percent": words.percent,
        "quantity": words.quantity,
        "amount": value_text,
        "shares": shares_text,
        "code": _code,
        "breakable": _breakable,
    }
    status, exit_ = words.overall(runs)
    budget = CropBudget()
    views = [_run_view(run, index, out, budget) for index, run in enumerate(runs)]
    return environment.get_template("report.html.j2").render(
        status=status,
        exit_status=int(exit_),
        headlines=words.HEADLINES,
        glyphs=words.GLYPHS,
        runs=views,
        starts=_STARTS,
        rates=RATES,
        no_fpr_px=NO_FPR_PX,
        causes=words.CAUSES,
        max_moved=MAX_MOVED,
        max_margin=MAX_MARGIN_PX,
        words=words,
        elsewhere=_ELSEWHERE,
        benches=[_bench_view(bench, out) for bench in benches],
        styles=STYLES,
    )


def _code(text: str) -> Markup:
    """Prose with `code` in backticks, as HTML."""
    pieces = text.split("`")
    return Markup("").join(
        Markup("<code>{}</code>").format(piece) if index % 2 else piece
        for index, piece in enumerate(pieces)
    )


def _breakable(name: str) -> Markup:
    """A name that may be broken after its punctuation."""
    return Markup("<wbr>").join(re.split(r"(?<=[.:,=_-])", legible(name)))


def _run_view(run: RunFolder, index: int, out: Path, budget: CropBudget) -> dict[str, Any]:
    rows = [summarise(run, culler) for culler in run.cullers]
    frames, frames_left_out = _frame_views(run)
    pictured = {(view.frame, view.view, one.culler) for view in frames for one in view.cullers}
    return {
        "id": f"run{index}",
        "run": run,
        "status": run.verdict.status,
        "sentence": words.run_sentence(run, rows),
        "not_claimed": words.not_claimed(run),
        "rows": [(number, row, words.culler_sentence(row)) for number, row in enumerate(rows)],
        "columns": (columns := _columns(rows)),
        "cells": _cells(rows, columns),
        "savings": savings(run),
        "why": {
            culler: lines
            for culler in run.cullers
            if (lines := why_lines(run.verdict.cullers[culler].causes))
        },
        "lost": [
            (row, _lost_views(run, row, pictured, out, budget))
            for row in sorted(rows, key=lambda row: row.status is not Status.VIOLATION)
            if row.lost
        ],
        "hidden": [(row, row.hidden[:MAX_LOST]) for row in rows if row.hidden],
        "misses": [row for row in rows if row.counts.losing or row.counts.undecided],
        "ages": words.ages_table(rows),
        "motion": words.motion_line(run),
        "policy": words.policy_line(run.manifest.policy),
        "accepted": any(row.counts.small + row.counts.late + row.counts.waived for row in rows),
        "causes": [row for row in rows if row.causes],
        "told": [cause for cause in Cause if any(row.causes.get(cause) for row in rows)],
        "plots": _plots(run, rows),
        "frames": frames,
        "frames_left_out": frames_left_out,
        "start": _start(rows, frames),
        "superfluous": [
            (
                row,
                units[:MAX_SUPERFLUOUS],
                max(0, len(units) - MAX_SUPERFLUOUS),
                run.superfluous_listed(row.culler) == row.counts.superfluous,
            )
            for row in rows
            if (units := run.superfluous_units(row.culler))
        ],
        "findings": _findings(run),
        "beside": [
            (paper, [table_view(table) for table in tables]) for paper, tables in tables_beside(run)
        ],
        "relative": words.path_from(out, run.folder),
    }


def _start(
    rows: Sequence[CullerSummary], frames: Sequence[FrameView]
) -> tuple[int, int, str] | None:
    """Where the browser opens, (culler number, frame, view): at the worst pictured violation, else
    the worst miss, else the last culler's first frame."""
    candidates = [
        (
            rows[one.number].status is Status.VIOLATION,
            one.row.missed_pixels,
            # Of the views of one set, one in which something is lost.
            "errors" in one.pictures,
            one.number,
            -index,
        )
        for index, view in enumerate(frames)
        for one in view.cullers
    ]
    if not candidates:
        return None
    *_, number, index = max(candidates)
    return number, frames[-index].frame, frames[-index].view


def _columns(rows: Sequence[CullerSummary]) -> list[Column]:
    """Those of the table of cullers; where all was decided, the sentences say so."""
    open_ = any(row.counts.undecided_samples for row in rows)
    return [column for column in _COLUMNS if open_ or column.name != "undecided_share"]


def _cells(rows: Sequence[CullerSummary], columns: Sequence[Column]) -> dict[str, list[Cell]]:
    """The cells of the table of cullers, by culler."""
    ranked: dict[str, tuple[Callable[[CullerSummary], float | None], bool]] = {
        "superfluous": (lambda row: row.counts.superfluous, True),
        "fpr": (lambda row: row.rates.fpr, True),
        "queries": (lambda row: row.queries or None, False),
        "batches": (lambda row: row.batches or None, False),
        "query_fragments": (lambda row: row.query_fragments or None, False),
        "triangle_share": (lambda row: row.triangle_share, False),
    }
    winners = {
        name: best(rows, value, by_unit=by_unit) for name, (value, by_unit) in ranked.items()
    }
    table = {}
    for row in rows:
        texts = {
            **{name: words.count(getattr(row.counts, name)) for name in COUNTS},
            **{rate.key: words.percent(share) for rate, share in row.rates.named()},
            "undecided_share": words.percent(row.undecided_share),
            "queries": words.quantity(row.queries),
            "batches": words.quantity(row.batches),
            "query_fragments": words.large(row.query_fragments),
            "triangle_share": words.percent(row.triangle_share),
            "ms_median": words.quantity(row.ms_median),
        }
        notes = {
            "drawn": "" if row.unit_kind == "object" else f"{row.unit_kind}s",
            "superfluous": words.percent(row.superfluous_share) if row.counts.drawn else "",
            "missed": _parts(row),
            "partly_missed": words.percent(row.rates.partly) if row.counts.partly_missed else "",
        }
        alarms = set()
        if row.counts.confirmed:
            in_full = {"missed", "fnr"} if row.counts.missed else set()
            in_part = {"partly_missed"} if row.counts.partly_missed else set()
            alarms = {"missed_pixels", "fnr_px", "per", *in_full, *in_part}
        if row.counts.superfluous_confirmed:
            alarms.add("superfluous")
        if row.status is Status.INCONCLUSIVE and row.counts.undecided_samples:
            alarms.add("undecided_share")
        table[row.culler] = [
            Cell(
                column.name,
                texts[column.name],
                notes.get(column.name, ""),
                row.culler in winners.get(column.name, ()),
                column.name in alarms,
            )
            for column in columns
        ]
    return table


def _parts(row: CullerSummary) -> str:
    """What `missed` and `partly missed` together are put down to, one line for each kind."""
    counts = row.counts
    parts = [
        (counts.confirmed, "confirmed"),
        (counts.ties, "tied"),
        (counts.within_raster_tolerance, "raster"),
        (counts.small, "small"),
        (counts.late, "late"),
        (counts.waived, "waived"),
    ]
    return "\n".join(f"{words.count(number)} {name}" for number, name in parts if number)


def _lost_views(
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


def _bench_view(bench: BenchFolder, out: Path) -> dict[str, Any]:
    """A bench as the page shows it: its plot as an image, so that nothing in it can act."""
    plot = base64.b64encode(bench.svg).decode()
    relative = words.path_from(out, bench.folder)
    return {"record": bench, "uri": f"data:image/svg+xml;base64,{plot}", "relative": relative}


def _plots(run: RunFolder, rows: Sequence[CullerSummary]) -> list[Plot]:
    numbers = {row.culler: number for number, row in enumerate(rows)}

    def series(
        name: str, cullers: Sequence[CullerSummary] = rows, scale: float = 1.0
    ) -> list[Series]:
        found = []
        for row in cullers:
            sums = of_frames(run.frames_of[row.culler], name)
            values = {frame: value * scale for frame, value in sums.items()}
            if values:
                found.append(Series(row.culler, values, numbers[row.culler]))
        return found

    kinds: dict[str, list[CullerSummary]] = defaultdict(list)
    for row in rows:
        if row.frames:
            kinds[row.unit_kind].append(row)
    # A set for all views counts an object once, sets by view once in each: the first culler's.
    visible = of_frames(run.frames_of[rows[0].culler], "visible") if rows else {}
    plots = []
    for kind, cullers in sorted(kinds.items(), key=lambda item: item[0] != "object"):
        area = ("visible", visible) if kind == "object" else None
        title = "Drawn against visible" if kind == "object" else f"Drawn {kind}s"
        drawn, note = on_scale(series("drawn", cullers))
        plots.append(Plot(title, f"{kind}s", drawn, area, note))
    missing = [row for row in rows if row.counts.losing]
    if missing:
        plots.append(Plot("Missed", "objects", series("missed", missing)))
        if any(row.counts.partly_missed for row in missing):
            plots.append(Plot("Partly missed", "objects", series("partly_missed", missing)))
        plots.append(Plot("Samples lost", "samples", series("missed_pixels", missing)))
    queries = [line for line in series("queries") if any(line.values.values())]
    if queries:
        plots.append(Plot("Queries", "asked of the depth buffer", queries))
    if triangles := run.manifest.scene.triangles:
        shares, note = on_scale(series("triangles_drawn", scale=100.0 / triangles))
        plots.append(Plot("Triangles drawn", "per cent of the scene", shares, note=note))
    times = [
        Series(row.culler, run.cull_ms[row.culler], numbers[row.culler])
        for row in rows
        if run.cull_ms.get(row.culler)
    ]
    if times:
        plots.append(Plot("Time", "milliseconds of the culler's call", times))
    return [plot for plot in plots if plot.series]


def _frame_views(run: RunFolder) -> tuple[list[FrameView], int]:
    """The pictured views of frames: all, or those that lost most and the rest evenly picked."""
    by_view: dict[tuple[int, str], dict[str, PictureSet]] = defaultdict(dict)
    for entry in run.manifest.pictures:
        by_view[entry.frame, entry.view][entry.culler] = entry
    rows = {(row.culler, row.frame, view): row for row in run.frames for view in run.views_of(row)}
    order = {
        (frame, view): (frame, place)
        for frame in {frame for frame, _ in by_view}
        for place, view in enumerate(run.manifest.samples[frame])
    }
    lost = {
        (frame, view): sum(
            rows[culler, frame, view].missed_pixels
            for culler, entry in entries.items()
            if "errors" in entry.files
        )
        for (frame, view), entries in by_view.items()
    }
    guilty = sorted((one for one in lost if lost[one]), key=lambda one: (-lost[one], order[one]))
    chosen = guilty[: MAX_FRAMES // 2]
    others = sorted(set(by_view) - set(chosen), key=order.__getitem__)
    room = MAX_FRAMES - len(chosen)
    others = [others[i] for i in evenly_picked(len(others), room)]
    views = []
    for frame, view in sorted([*chosen, *others], key=order.__getitem__):
        shared: dict[str, Picture] = {}
        cullers = []
        for number, culler in enumerate(run.cullers):
            found = by_view[frame, view].get(culler)
            if found is None:
                continue
            pictures = {
                what: Picture(what, _VIEWS[what], data_uri(run, found.files[what], frame, view))
                for what in _VIEWS
                if what in found.files and not (what in ("picture", "ids") and what in shared)
            }
            for what in ("picture", "ids"):
                if what in pictures:
                    shared[what] = pictures.pop(what)
            row = rows[culler, frame, view]
            joint = len(run.views_of(row)) > 1
            cullers.append(CullerView(number, culler, row, joint, pictures))
        views.append(FrameView(frame, view, words.moved_in(run, frame), shared, cullers))
    return views, len(by_view) - len(views)


def _shown(code: str) -> int:
    """How many findings of this code are listed; some have a section of their own."""
    return 0 if code in _ELSEWHERE else MAX_FINDINGS


def _findings(run: RunFolder) -> list[FindingGroup]:
    """Findings by code: what is to be mended in the input, then the gravest, else in the
    catalogue's order and unknown codes last."""
    by_code: dict[str, list[FindingRow]] = {code: [] for code in Code}
    for finding in run.verdict.findings:
        by_code.setdefault(finding.code, []).append(finding)
    rules = [rule_of(code, found[0].severity) for code, found in by_code.items() if found]
    # The catalogue's severity, unless the user's policy says another.
    said = run.manifest.policy.severities if run.manifest.policy is not None else {}
    rules = [replace(rule, severity=Severity(said.get(rule.code, rule.severity))) for rule in rules]
    gravity = {severity: rank for rank, severity in enumerate(Severity)}
    rules.sort(key=lambda rule: (rule.code != Code.MISALIGNED, gravity[rule.severity]))
    return [
        FindingGroup(rule, found[: (shown := _shown(rule.code))], max(0, len(found) - shown))
        for rule in sorted(
            rules, key=lambda rule: (rule.code != Code.MISALIGNED, gravity[rule.severity])
        )
        for found in [by_code[rule.code]]
    ]
