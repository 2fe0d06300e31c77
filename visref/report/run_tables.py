"""Tables of a user's own runs in Markdown, LaTeX (booktabs) and CSV, from the run folders alone.

tables.md, tables.tex   what each culler misses, and what it costs and saves; then the papers'
                        tables that the run fills, published numbers beside
tables.csv              every number in full: a line per run, culler and quantity (`COLUMNS`)
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from visref.errors import InputError
from visref.files import refuse_inputs, replacing_file
from visref.papers import tables_beside
from visref.report import words
from visref.report.savings import BASELINES, Amount, Savings, savings
from visref.report.summary import RATES, CullerSummary, definitions, summarise
from visref.report.tables import latex_text, table_latex, table_markdown
from visref.run_folder.layout import COUNTS
from visref.run_folder.read import RunFolder

COLUMNS = (
    "run", "scene", "culler", "promise", "status", "quantity", "value",
    *(f"of_{name}" for name in BASELINES),
)  # fmt: skip
TABLES = ("tables.md", "tables.tex", "tables.csv")
_SHOWN = ("visible", "drawn", "superfluous", "missed", "partly_missed", "missed_pixels")
_NAMES = {"partly_missed": "partly missed", "missed_pixels": "samples lost"}


@dataclass(frozen=True)
class Grid:
    """A table of texts: the first column left-aligned."""

    title: str
    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def write_run_tables(runs: Sequence[RunFolder], out: Path) -> list[Path]:
    """Write `TABLES` into `out`; returns their paths. Raises InputError where no run is given,
    `out` cannot be written to, or a file there is one of the runs'."""
    if not runs:
        raise InputError("no run folder was given", fix="name one that `visref run` wrote")
    written = []
    texts = (runs_markdown(runs), runs_latex(runs), runs_csv(runs))
    read = [file for run in runs for file in run.folder.rglob("*") if file.name not in TABLES]
    for name, text in zip(TABLES, texts, strict=True):
        refuse_inputs(out / name, read)
        with replacing_file(out / name) as beside:
            beside.write_text(text, encoding="utf-8")
        written.append(out / name)
    return written


def grids(run: RunFolder) -> list[Grid]:
    """What each culler misses, and, where anything of it was counted, what it costs and saves."""
    rows = [summarise(run, culler) for culler in run.cullers]
    cells = ", ".join((run.scene_name, words.counted(len(run.frame_numbers), "frame"),
                       *([run.resolution()] if run.frame_numbers else [])))  # fmt: skip
    headings = (
        "culler", "verdict",
        *(_NAMES.get(name, name) for name in _SHOWN),
        *(rate.name for rate in RATES),
        "ms a frame",
    )  # fmt: skip
    made = [Grid(f"Visibility errors: {cells}", headings, tuple(_error_cells(row) for row in rows))]
    if (found := savings(run)) is not None:
        made.append(savings_grid(found, cells))
    return made


def _error_cells(row: CullerSummary) -> tuple[str, ...]:
    return (
        row.culler,
        words.HEADLINES[row.status].lower(),
        *(words.count(getattr(row.counts, name)) for name in _SHOWN),
        *(words.percent(share) for _, share in row.rates.named()),
        words.quantity(row.ms_median),
    )


def savings_grid(found: Savings, of: str) -> Grid:
    """Costs and savings as texts, each with its shares of the baselines."""
    shares = " and of ".join(found.baselines)
    said = f", shares of {shares}" if shares else ""
    return Grid(
        f"Costs and savings a frame{said}: {of}",
        ("culler", *(quantity.name for quantity in found.quantities)),
        tuple(
            (culler, *(amount_text(row[quantity.key]) for quantity in found.quantities))
            for culler, row in found.rows.items()
        ),
    )


def amount_text(amount: Amount) -> str:
    """A number, and its shares of the baselines in brackets."""
    shares = shares_text(amount)
    return f"{value_text(amount)} ({shares})" if shares else value_text(amount)


def value_text(amount: Amount) -> str:
    """A number, which may be less than none."""
    value = amount.value
    return f"−{words.large(-value)}" if value is not None and value < 0 else words.large(value)


def shares_text(amount: Amount) -> str:
    """The shares of the baselines, in their order; empty where there is nothing to share."""
    known = [share for share in amount.shares.values() if share is not None]
    return ", ".join(map(signed_percent, known)) if any(known) else ""


def signed_percent(share: float) -> str:
    """A share that may be less than none: a method may cost what it should save."""
    return f"−{words.percent(-share)}" if share < 0.0 else words.percent(share)


def grid_markdown(grid: Grid, *, level: int = 3) -> str:
    """A heading and a table."""
    lines = [
        f"{'#' * level} {words.plain(grid.title)}",
        "",
        f"| {' | '.join(grid.headings)} |",
        "|---|" + "--:|" * (len(grid.headings) - 1),
        *(f"| {' | '.join(map(words.plain, row))} |" for row in grid.rows),
    ]
    return "\n".join(lines) + "\n"


def grid_latex(grid: Grid) -> str:
    """A `table` environment with the rules of the package booktabs."""
    lines = [
        r"\begin{table}",
        r"\centering\footnotesize",
        rf"\caption{{{latex_text(grid.title)}}}",
        rf"\begin{{tabular}}{{l{'r' * (len(grid.headings) - 1)}}}",
        r"\toprule",
        " & ".join(latex_text(heading) for heading in grid.headings) + r" \\",
        r"\midrule",
        *(" & ".join(map(latex_text, row)) + r" \\" for row in grid.rows),
        r"\bottomrule",
        r"\end{tabular}",
        r"\end{table}",
    ]
    return "\n".join(lines) + "\n"


def runs_markdown(runs: Sequence[RunFolder]) -> str:
    """All grids, and the papers' tables that the runs fill."""
    parts = []
    for run in runs:
        parts += [grid_markdown(grid) for grid in grids(run)]
        for paper, tables in tables_beside(run):
            parts.append(f"## Beside {words.plain(paper.title)}\n")
            parts += [table_markdown(table) for table in tables]
    return "\n".join([*parts, f"{definitions()}\n"])


def runs_latex(runs: Sequence[RunFolder]) -> str:
    """The same; needs booktabs and array."""
    parts = ["% Needs the packages booktabs and array.\n"]
    for run in runs:
        parts += [grid_latex(grid) for grid in grids(run)]
        for paper, tables in tables_beside(run):
            parts.append(f"% {paper.title}\n")
            parts += [table_latex(table) for table in tables]
    return "\n".join(parts)


def runs_csv(runs: Sequence[RunFolder]) -> str:
    """`COLUMNS`, numbers in full, shares as shares of 1; what was not measured has no line."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(COLUMNS)
    for run in runs:
        found = savings(run)
        for culler in run.cullers:
            row = summarise(run, culler)
            known = (run.folder.name, run.scene_name, culler, row.promise.value, row.status.value)
            for quantity, amount in _amounts(row, found):
                if amount.value is not None:
                    shares = (amount.shares.get(name) for name in BASELINES)
                    writer.writerow((*known, quantity, *map(_full, (amount.value, *shares))))
    return out.getvalue()


def _amounts(row: CullerSummary, found: Savings | None) -> Iterator[tuple[str, Amount]]:
    for name in COUNTS:
        yield name, Amount(getattr(row.counts, name), {})
    for rate, share in row.rates.named():
        yield rate.key, Amount(share, {})
    yield "ms_median", Amount(row.ms_median, {})
    if found is not None:
        yield from found.rows.get(row.culler, {}).items()


def _full(value: float | None) -> str:
    return "" if value is None else f"{value:.12g}"
