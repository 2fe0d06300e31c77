"""The page's table of cullers: its columns, and each culler's cells."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from visref.judging.status import Status
from visref.report import words
from visref.report.summary import RATES, CullerSummary, best
from visref.run_folder.layout import COUNTS


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


_COLUMNS = (
    Column("visible", "visible object-frames", "objects that own a sample of the frame",
           "sums over frames"),
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
    Column("ms_median", "ms", "median of the culler's call, without its first in a process",
           "per frame"),
)  # fmt: skip


# The first column of each group.
STARTS = [next(c.name for c in _COLUMNS if c.group == group)
           for group in dict.fromkeys(c.group for c in _COLUMNS)]  # fmt: skip


def columns_of(rows: Sequence[CullerSummary]) -> list[Column]:
    """Those of the table of cullers; where all was decided, the sentences say so."""
    open_ = any(row.counts.undecided_samples for row in rows)
    return [column for column in _COLUMNS if open_ or column.name != "undecided_share"]


def cells_of(rows: Sequence[CullerSummary], columns: Sequence[Column]) -> dict[str, list[Cell]]:
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
