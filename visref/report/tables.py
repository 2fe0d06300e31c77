"""A paper's tables in Markdown, LaTeX (booktabs), CSV and for HTML, all from the same texts.

Numbers are rounded here alone, so that no two forms of a table differ.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup

from visref.papers.contents import Basis, Row, Table, Trend
from visref.report import words
from visref.report.figures import figure_svg

HEADINGS = ("quantity", "published", "ours", "ratio", "compares")
CSV_COLUMNS = (
    "table", "source", "quantity", "published", "ours", "unit", "ratio", "basis", "note",
)  # fmt: skip

# How a trend turned out: its glyph and its words, by `holds`.
VERDICTS: dict[bool | None, tuple[str, str]] = {
    True: ("✓", "holds"),
    False: ("✕", "does not hold"),
    None: ("?", "not measured"),
}
_BASES = {
    Basis.INDEPENDENT: "in ratio and order",
    Basis.HARDWARE: "not: hardware of its day",
    Basis.WITHIN_RUN: "as a ratio within one run",
}
_LATEX = {
    **{letter: f"\\{letter}" for letter in "&%$#_{}"},
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"$<$",
    ">": r"$>$",
    "×": r"$\times$",
    "≤": r"$\leq$",
    "≥": r"$\geq$",
    "≈": r"$\approx$",
    "−": r"$-$",
    "→": r"$\rightarrow$",
    "µ": r"$\mu$",
    "²": r"\textsuperscript{2}",
    "–": "--",
    "…": r"\ldots{}",
    "\N{NO-BREAK SPACE}": "~",
}


@dataclass(frozen=True)
class TableLine:
    """A row's texts, as `HEADINGS`, and its note."""

    cells: tuple[str, ...]
    note: str


def table_lines(table: Table) -> list[TableLine]:
    """What every form of the table shows, row by row."""
    return [
        TableLine(
            (
                row.quantity,
                row.published
                if isinstance(row.published, str)
                else _number(row.published, row.unit, row.digits),
                _number(row.ours, row.unit, row.digits),
                "–" if row.ratio is None else words.quantity(row.ratio),
                "–" if row.published is None else _BASES[row.basis],
            ),
            row.note,
        )
        for row in table.rows
    ]


def _number(value: float | None, unit: str, digits: int) -> str:
    """A value to so many digits after the point, and its unit; a share in per cent."""
    if value is None:
        return "–"
    shown = 100.0 * value if unit == "%" else value
    text = f"{shown:,.{digits}f}"
    if value and not float(text.replace(",", "")):
        # Never a zero that is none.
        text = f"{shown:.2g}"
    return f"{text} {unit}" if unit else text


def _why(trend: Trend) -> str:
    """Why a trend does not hold, or was not measured; one that holds needs no excuse."""
    return "" if trend.holds else trend.why


def _trend_text(trend: Trend) -> str:
    text = f"{trend.claim}: {VERDICTS[trend.holds][1]}"
    return f"{text}; {_why(trend)}" if _why(trend) else text


def table_markdown(table: Table) -> str:
    """A heading, the rows, the trends. A figure is not drawn: its numbers are the rows'."""
    lines = table_lines(table)
    noted = any(line.note for line in lines)
    headings = (*HEADINGS, "note") if noted else HEADINGS
    out = [
        f"### {words.plain(table.title)}",
        "",
        words.plain(table.source),
        "",
        f"| {' | '.join(headings)} |",
        "|---|--:|--:|--:|---|" + ("---|" if noted else ""),
    ]
    for line in lines:
        cells = (*line.cells, line.note) if noted else line.cells
        out.append(f"| {' | '.join(map(words.plain, cells))} |")
    if table.trends:
        out.append("")
    out += [
        f"- {VERDICTS[trend.holds][0]} {words.plain(_trend_text(trend))}" for trend in table.trends
    ]
    return "\n".join(out) + "\n"


def table_latex(table: Table) -> str:
    """A `table` environment with the rules of the package booktabs; notes by letter below."""
    lines = table_lines(table)
    notes = list(dict.fromkeys(line.note for line in lines if line.note))
    out = [
        r"\begin{table}",
        r"\centering",
        rf"\caption{{{latex_text(f'{table.title} ({table.source})')}}}",
        r"\begin{tabular}{>{\raggedright\arraybackslash}p{0.42\linewidth}rrrl}",
        r"\toprule",
        f"{' & '.join(heading.capitalize() for heading in HEADINGS)} \\\\",
        r"\midrule",
    ]
    for line in lines:
        first, *others = map(latex_text, line.cells)
        if line.note:
            first += rf"\textsuperscript{{{_letter(notes.index(line.note))}}}"
        out.append(f"{' & '.join([first, *others])} \\\\")
    out += [r"\bottomrule", r"\end{tabular}"]
    remarks = [
        rf"\textsuperscript{{{_letter(index)}}} {latex_text(note)}"
        for index, note in enumerate(notes)
    ]
    remarks += [latex_text(f"{_trend_text(trend)}.") for trend in table.trends]
    if remarks:
        out += [r"\par\smallskip\footnotesize\raggedright", " \\\\\n".join(remarks)]
    out.append(r"\end{table}")
    return "\n".join(out) + "\n"


def _letter(index: int) -> str:
    """a … z, aa, ab, …"""
    text = ""
    while index >= 0:
        index, place = divmod(index, 26)
        text = chr(ord("a") + place) + text
        index -= 1
    return text


def latex_text(text: str) -> str:
    """Text that LaTeX sets as it is."""
    return "".join(_LATEX.get(letter, letter) for letter in text)


def table_csv(*tables: Table) -> str:
    """`CSV_COLUMNS`, a line a row and a trend (its `basis` is "trend"); numbers in full, a share
    with unit "%" in per cent. What was not published or not measured is empty."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(CSV_COLUMNS)
    for table in tables:
        for row in table.rows:
            writer.writerow(
                (table.title, table.source, row.quantity, _raw(row, row.published),
                 _raw(row, row.ours), row.unit, _full(row.ratio), row.basis.value, row.note)
            )  # fmt: skip
        for trend in table.trends:
            holds = VERDICTS[trend.holds][1]
            writer.writerow(
                (
                    table.title,
                    table.source,
                    trend.claim,
                    "holds",
                    holds,
                    "",
                    "",
                    "trend",
                    _why(trend),
                )
            )
    return out.getvalue()


def _raw(row: Row, value: float | str | None) -> str:
    if isinstance(value, str):
        return value
    return _full(100.0 * value if value is not None and row.unit == "%" else value)


def _full(value: float | None) -> str:
    return "" if value is None else f"{value:.12g}"


@dataclass(frozen=True)
class TableView:
    """What the template `_tables.html.j2` lays out."""

    table: Table
    headings: Sequence[str]
    lines: Sequence[TableLine]
    trends: Sequence[tuple[str, str, Trend, str]]
    svg: Markup | None


def table_view(table: Table) -> TableView:
    """The table for the template's macro `paper_table`."""
    trends = [(*VERDICTS[trend.holds], trend, _why(trend)) for trend in table.trends]
    svg = figure_svg(table.figure) if table.figure is not None else None
    return TableView(table, HEADINGS, table_lines(table), trends, svg)
