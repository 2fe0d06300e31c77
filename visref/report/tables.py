"""A paper's tables in Markdown, LaTeX (booktabs), CSV and for HTML, all from the same texts.

Numbers are rounded here alone, so that no two forms of a table differ.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup

from visref.papers.contents import (
    Basis,
    Claim,
    Derived,
    Grade,
    PrintedRange,
    PrintedWords,
    Published,
    SetUp,
    Table,
    printed_numbers,
)
from visref.papers.estimates import CONFIDENCE
from visref.report import words
from visref.report.figures import figure_svg

HEADINGS = ("quantity", "published", "ours", "ratio", "compares")
CSV_COLUMNS = (
    "table", "source", "kind", "quantity", "published", "ours", "low", "high", "unit", "ratio",
    "basis", "grade", "note", "printed",
)  # fmt: skip
CLAIM_HEADINGS = ("here", "claim", "ours", "interval", "published", "where")

GLYPHS: dict[Grade, str] = {
    Grade.HOLDS: "✓",
    Grade.IN_DIRECTION: "◐",
    Grade.FAILS: "✕",
    Grade.OPEN: "○",
    Grade.UNMEASURED: "?",
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
    """A row's texts, as `HEADINGS`, its note, and where the published number is printed."""

    cells: tuple[str, ...]
    note: str
    printed: str


def table_lines(table: Table) -> list[TableLine]:
    """What every form of the table shows, row by row."""
    return [
        TableLine(
            (
                row.quantity,
                _published(row.published, row.unit, row.digits),
                _number(row.ours, row.unit, row.digits),
                "–" if row.ratio is None else words.quantity(row.ratio),
                "–" if row.published is None else _BASES[row.basis],
            ),
            row.note,
            _printed_at(row.published),
        )
        for row in table.rows
    ]


def _published(published: Published | None, unit: str, digits: int) -> str:
    """What is printed; what only follows from it says so."""
    match published:
        case None:
            return "–"
        case PrintedWords():
            return published.text
        case PrintedRange():
            low = _number(published.low.amount, unit, digits).removesuffix(f" {unit}")
            return f"{low} to {_number(published.high.amount, unit, digits)}"
        case Derived():
            return f"{_number(published.amount, unit, digits)} (derived)"
        case _:
            return _number(published.amount, unit, digits)


def _printed_at(published: Published | None) -> str:
    """Where the numbers behind a published one are printed."""
    if isinstance(published, PrintedWords):
        return f"{published.where}: {published.text}"
    return "; ".join(f"{one.where}: {one.words}" for one in printed_numbers(published))


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


def claim_cells(claim: Claim, where: str) -> tuple[str, ...]:
    """A claim's texts, as `CLAIM_HEADINGS`."""
    shown = (claim.unit, claim.digits)
    return (
        f"{GLYPHS[claim.grade]} {claim.grade}",
        claim.statement,
        _number(None if claim.ours is None else claim.ours.value, *shown),
        _interval(claim),
        _published(claim.published, *shown),
        where,
    )


def _interval(claim: Claim) -> str:
    if claim.interval is None:
        return "–"
    low, high = claim.interval
    if math.isinf(low):
        return "too few frames"
    start = _number(low, claim.unit, claim.digits).removesuffix(f" {claim.unit}")
    return f"{start} to {_number(high, claim.unit, claim.digits)}"


def figures_text(claim: Claim) -> str:
    """The figure, its interval and the published figure, whatever the grade."""
    if claim.ours is None:
        return claim.told
    _, _, ours, interval, published, _ = claim_cells(claim, "")
    if interval == "–":
        parts = [f"here {ours}, without an interval: it is no figure of frames"]
    else:
        parts = [f"here {ours}, {100 * CONFIDENCE:.0f} % interval {interval}"]
    if claim.published is not None:
        parts.append(f"published {published}")
    if claim.grade is Grade.OPEN and claim.published is not None and claim.order:
        parts.append("the order holds")
    return "; ".join([*parts, claim.told] if claim.told else parts)


def claim_text(claim: Claim) -> str:
    """A claim, its grade and its figures, as a line."""
    return f"{claim.statement}: {claim.grade}; {figures_text(claim)}".removesuffix("; ")


def _claim_lines(table: Table) -> list[tuple[str, Claim]]:
    """All claims of a table, those that are ours told as such."""
    return [("", claim) for claim in table.claims] + [("ours: ", claim) for claim in table.own]


def _set_up(setup: SetUp) -> str:
    shown = _published(setup.published, setup.unit, 0)
    return f"Set up as printed ({setup.published.where}): {setup.quantity}, {shown}."


def table_markdown(table: Table) -> str:
    """A heading, the rows, the claims. A figure is not drawn: its numbers are the rows'."""
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
    for setup in table.setup:
        out += ["", words.plain(_set_up(setup))]
    claims = _claim_lines(table)
    if claims:
        out.append("")
    out += [
        f"- {GLYPHS[claim.grade]} {whose}{words.plain(claim_text(claim))}"
        for whose, claim in claims
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
    remarks += [latex_text(_set_up(setup)) for setup in table.setup]
    remarks += [latex_text(f"{whose}{claim_text(claim)}.") for whose, claim in _claim_lines(table)]
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
    """`CSV_COLUMNS`, a line per row (`kind` "row"), claim of the paper's ("claim") and claim of
    ours ("own"); numbers in full, a share with unit "%" in per cent. What was not published or not
    measured is empty. `printed`: where the published numbers are printed."""
    out = io.StringIO()
    writer = csv.DictWriter(out, CSV_COLUMNS, restval="", lineterminator="\n")
    writer.writeheader()
    for table in tables:
        at = {"table": table.title, "source": table.source}
        for row in table.rows:
            writer.writerow(
                at
                | {
                    "kind": "row",
                    "quantity": row.quantity,
                    "published": _raw(row.published, row.unit),
                    "ours": _full(row.ours, row.unit),
                    "unit": row.unit,
                    "ratio": _full(row.ratio),
                    "basis": row.basis.value,
                    "note": row.note,
                    "printed": _printed_at(row.published),
                }
            )
        for kind, claims in (("claim", table.claims), ("own", table.own)):
            for claim in claims:
                low, high = claim.interval or (None, None)
                writer.writerow(
                    at
                    | {
                        "kind": kind,
                        "quantity": claim.statement,
                        "published": _raw(claim.published, claim.unit),
                        "ours": _full(claim.ours.value if claim.ours else None, claim.unit),
                        "low": _full(low, claim.unit),
                        "high": _full(high, claim.unit),
                        "unit": claim.unit,
                        "basis": claim.sense.value,
                        "grade": claim.grade.value,
                        "note": claim.told,
                        "printed": _printed_at(claim.published),
                    }
                )
    return out.getvalue()


def _raw(published: Published | None, unit: str) -> str:
    match published:
        case None:
            return ""
        case PrintedWords():
            return published.text
        case PrintedRange():
            ends = (published.low.amount, published.high.amount)
            return " to ".join(_full(end, unit) for end in ends)
        case _:
            return _full(published.amount, unit)


def _full(value: float | None, unit: str = "") -> str:
    if value is None:
        return ""
    return f"{100.0 * value if unit == '%' else value:.12g}"


@dataclass(frozen=True)
class TableView:
    """What the template `_tables.html.j2` lays out."""

    table: Table
    headings: Sequence[str]
    lines: Sequence[TableLine]
    claims: Sequence[ClaimView]
    setup: Sequence[str]
    svg: Markup | None


@dataclass(frozen=True)
class ClaimView:
    """A claim as the template shows it. `status`: the style of its badge."""

    glyph: str
    grade: str
    status: str
    statement: str
    figures: str
    own: bool


_BADGES = {Grade.HOLDS: "no_violation_found", Grade.FAILS: "violation"}


def table_view(table: Table) -> TableView:
    """The table for the template's macro `paper_table`."""
    claims = [
        ClaimView(
            GLYPHS[claim.grade],
            claim.grade.value,
            _BADGES.get(claim.grade, "measured"),
            claim.statement,
            figures_text(claim),
            bool(whose),
        )
        for whose, claim in _claim_lines(table)
    ]
    svg = figure_svg(table.figure) if table.figure is not None else None
    setup = [_set_up(one) for one in table.setup]
    return TableView(table, HEADINGS, table_lines(table), claims, setup, svg)
