"""The page: what it shows of each run, chosen here and laid out by the template."""

from __future__ import annotations

import base64
import re
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from markupsafe import Markup

from visref.judging.status import Status
from visref.papers import tables_beside
from visref.report import words
from visref.report.bench_folder import BenchFolder
from visref.report.caused import whys
from visref.report.charts import plots_of
from visref.report.crop_data import CropData
from visref.report.crops import CropBudget
from visref.report.environment import page_environment
from visref.report.found import ELSEWHERE, finding_groups
from visref.report.losses import MAX_LOST, lost_views
from visref.report.measures import STARTS, cells_of, columns_of
from visref.report.object_list import ObjectList
from visref.report.packed import packed
from visref.report.pictured import PictureBudget, frame_views, opens_at
from visref.report.plots import STYLES
from visref.report.run_tables import shares_text, value_text
from visref.report.savings import savings
from visref.report.summary import (
    NO_FPR_PX,
    RATES,
    summarise,
)
from visref.report.tables import table_view
from visref.report.view3d import View3d
from visref.run_folder.causes import Cause
from visref.run_folder.layout import MAX_MARGIN_PX, REPORT_SCENE
from visref.run_folder.read import RunFolder
from visref.wording import legible

# How much of a long list the page carries; the tables in the run folder have the rest.
MAX_SUPERFLUOUS = 5
MAX_MOVED = 10


def page_html(
    runs: Sequence[RunFolder],
    benches: Sequence[BenchFolder],
    out: Path,
    flight: View3d | None = None,
) -> str:
    """The whole page. `out` is the folder it will stand in: replay commands start there. `flight`:
    the view in three dimensions of the first run."""
    environment = page_environment("visref.report")
    environment.filters |= {
        "percent": words.percent,
        "quantity": words.quantity,
        "amount": value_text,
        "shares": shares_text,
        "code": _code,
        "breakable": _breakable,
        "headings": headings,
    }
    status, exit_ = words.overall(runs)
    budgets = CropBudget(), CropData(), PictureBudget()
    views = [_run_view(run, index, out, *budgets) for index, run in enumerate(runs)]
    return environment.get_template("report.html.j2").render(
        status=status,
        exit_status=int(exit_),
        headlines=words.HEADLINES,
        glyphs=words.GLYPHS,
        runs=views,
        starts=STARTS,
        rates=RATES,
        no_fpr_px=NO_FPR_PX,
        causes=words.CAUSES,
        max_moved=MAX_MOVED,
        max_margin=MAX_MARGIN_PX,
        words=words,
        elsewhere=ELSEWHERE,
        benches=[_bench_view(bench, out) for bench in benches],
        styles=STYLES,
        flight=flight,
        scene_file=REPORT_SCENE,
    )


# What a heading's title is without: what stands small in it, as a status or a path.
_ASIDE = re.compile(r"<small>.*?</small>|<span class=\"badge.*</span>", re.S)
_HEADING = re.compile(r'<h2[^>]* ?id="(?P<id>[^"]+)"[^>]*>(?P<title>.*?)</h2>', re.S)


def headings(body: str) -> list[tuple[str, Markup, bool]]:
    """The page's second headings, (id, title, whether it is a run's own name), but for what nobody
    looks up."""
    found = []
    for heading in _HEADING.finditer(body):
        title = Markup(_ASIDE.sub("", heading["title"]).strip())
        if not heading["id"].endswith("-claims"):
            found.append((heading["id"], title, heading["id"].endswith("-run")))
    return found


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


def _run_view(
    run: RunFolder,
    index: int,
    out: Path,
    budget: CropBudget,
    crops: CropData,
    pictures: PictureBudget,
) -> dict[str, Any]:
    rows = [summarise(run, culler) for culler in run.cullers]
    frames, frames_left_out = frame_views(run, rows, pictures)
    pictured = {(view.frame, view.view, one.culler) for view in frames for one in view.cullers}
    places_of: dict[str, set[tuple[int, str]]] = defaultdict(set)
    for frame, view, culler in pictured:
        places_of[culler].add((frame, view))
    listed = ObjectList(run, sorted(pictured), crops)
    # Who broke a promise comes first.
    for number, row in sorted(
        enumerate(rows), key=lambda one: one[1].status is not Status.VIOLATION
    ):
        listed.add(number, row)
    return {
        "id": f"run{index}",
        "list": len(listed),
        "list_data": packed(listed.data(rows, out)) if len(listed) else "",
        "run": run,
        "status": run.verdict.status,
        "sentence": words.run_sentence(run, rows),
        "not_claimed": words.not_claimed(run),
        "rows": [(number, row, words.culler_sentence(row)) for number, row in enumerate(rows)],
        "columns": (columns := columns_of(rows)),
        "cells": cells_of(rows, columns),
        "savings": savings(run),
        "why": {
            culler: lines
            for culler in run.cullers
            if (lines := whys(run, culler, places_of.get(culler, ()), f"run{index}"))
        },
        "lost": [
            (row, lost_views(run, row, pictured, out, budget))
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
        "plots": plots_of(run, rows),
        "frames": frames,
        "frames_left_out": frames_left_out,
        "start": opens_at(rows, frames),
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
        "findings": finding_groups(run),
        "beside": [
            (paper, [table_view(table) for table in tables]) for paper, tables in tables_beside(run)
        ],
        "relative": words.path_from(out, run.folder),
    }


def _bench_view(bench: BenchFolder, out: Path) -> dict[str, Any]:
    """A bench as the page shows it: its plot as an image, so that nothing in it can act."""
    plot = base64.b64encode(bench.svg).decode()
    relative = words.path_from(out, bench.folder)
    return {"record": bench, "uri": f"data:image/svg+xml;base64,{plot}", "relative": relative}
