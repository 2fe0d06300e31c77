"""Papers' tables: every form shows the same numbers, escapes what it must, and hides no doubt."""

from __future__ import annotations

import csv
import io
import re
import xml.etree.ElementTree as ET

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jinja2 import Environment, PackageLoader, StrictUndefined

from visref.papers.contents import (
    Basis,
    Claim,
    Curve,
    Figure,
    Printed,
    PrintedRange,
    PrintedWords,
    Row,
    Sense,
    SetUp,
    Table,
    printed_curve,
    ratio_of,
    series,
    single,
)
from visref.report.figures import figure_svg
from visref.report.tables import (
    claim_text,
    latex_text,
    table_csv,
    table_latex,
    table_lines,
    table_markdown,
    table_view,
)


def printed(value, **unit):
    return Printed(value, "Table 2", "Angio & more", **unit)


FEW, MANY = series([1.0, 2.0, 3.0, 2.0], range(4)).mean(), series([40.0] * 4, range(4)).mean()
TABLE = Table(
    "Fill & <b>queries</b>",
    "Table 2, p. 5_6",
    (
        Row("Angio | share", printed(13, per=100), 0.26, "%"),
        Row("fps", printed(7.0), 700.0, "Hz", basis=Basis.HARDWARE),
        Row(
            "lazy over none",
            PrintedRange(printed(1.9), printed(5.8)),
            2.5,
            digits=1,
            basis=Basis.WITHIN_RUN,
        ),
        Row("tests", printed(1_100_000), None, note="asked for with --large"),
        Row("not published", None, 12_345.678, digits=2),
        Row("small", printed(0.5), 0.04, digits=1),
        Row("a quotient", ratio_of(printed(12), printed(8)), 3.0, digits=1),
        Row("in words", PrintedWords("orders of magnitude", "section 3"), 200.0),
    ),
    (
        Claim("N-buffers test least", Sense.AT_LEAST, MANY, printed(40), told="by far"),
        Claim("maps save most on Angio", Sense.AT_MOST, MANY, told="its boxes are larger"),
        Claim("the large city", Sense.AT_LEAST, None),
        Claim("a share", Sense.AT_MOST, single(0.3), ratio_of(printed(1), printed(8)), unit="%"),
    ),
    (Claim("a claim of ours", Sense.AT_LEAST, FEW, even=2.0),),
    (SetUp("a cell's side", printed(32), "px"),),
    Figure(
        "budget <k>",
        "tests",
        (
            printed_curve("cPLP", (1_000.0, 100_000.0), (printed(4.7), printed(1.4))),
            Curve("cPLP", (1_000.0, 100_000.0), (3.0, 0.0)),
            Curve("others & co", (1_000.0, 20_000.0), (40.0, 2.0)),
        ),
        log_x=True,
        log_y=True,
    ),
)


def table_html(table):
    """The table as the pages' templates lay it out."""
    loader = PackageLoader("visref.report")
    templates = Environment(loader=loader, autoescape=True, undefined=StrictUndefined)
    return str(templates.get_template("_tables.html.j2").module.paper_table(table_view(table)))


VALUES = st.just(0.0) | st.floats(1e-9, 1e9)


def test_numbers_are_rounded_to_their_digits_and_never_to_a_zero_that_is_none():
    cells = [line.cells for line in table_lines(TABLE)]
    assert cells[0] == ("Angio | share", "13 %", "26 %", "2", "in ratio and order")
    assert cells[1][1:4] == ("7 Hz", "700 Hz", "–")
    assert cells[2][1:4] == ("1.9 to 5.8", "2.5", "–")
    assert cells[3][1:4] == ("1,100,000", "–", "–")
    assert cells[4] == ("not published", "–", "12,345.68", "–", "–")
    assert cells[5][2] == "0.04"
    assert cells[6][1:4] == ("1.5 (derived)", "3.0", "2")
    assert cells[7][1:4] == ("orders of magnitude", "200", "–")


def test_every_form_shows_every_number_and_every_claim():
    for form in (table_markdown, table_latex, table_html):
        text = form(TABLE).replace("\\", "")
        for line in table_lines(TABLE):
            for cell in line.cells[1:4]:
                assert cell.replace("–", "") in text
        for words in ("does not hold", "not measured", "its boxes are larger", "a cell's side"):
            assert words.replace("'", "&#39;" if form is table_html else "'") in text
        assert "asked for with --large" in text


def test_a_claim_that_holds_prints_its_figures_as_one_that_does_not():
    holds, fails, unmeasured, alone = map(claim_text, TABLE.claims)
    assert holds == (
        "N-buffers test least: holds; here 40.00, 95 % interval 40.00 to 40.00; "
        "published 40.00; by far"
    )
    assert fails.startswith("maps save most on Angio: does not hold; here 40.00, 95 % interval")
    assert unmeasured == "the large city: not measured"
    assert alone == (
        "a share: holds in direction; here 30.00 %, without an interval: it is no figure of "
        "frames; published 12.50 % (derived)"
    )
    (own,) = map(claim_text, TABLE.own)
    assert own.startswith("a claim of ours: open; here 2.00, 95 % interval ")


def test_csv_has_the_numbers_in_full_and_leaves_the_unmeasured_empty():
    rows = list(csv.DictReader(io.StringIO(table_csv(TABLE, TABLE))))
    assert len(rows) == 2 * (8 + 4 + 1)
    assert (rows[0]["published"], rows[0]["ours"], rows[0]["unit"]) == ("13", "26", "%")
    assert rows[0]["ratio"] == "2"
    assert rows[0]["printed"] == "Table 2: Angio & more"
    assert rows[2]["published"] == "1.9 to 5.8"
    assert rows[3]["ours"] == ""
    assert rows[4]["ours"] == "12345.678"
    claims = [row for row in rows[:13] if row["kind"] != "row"]
    assert [row["grade"] for row in claims] == [
        "holds", "does not hold", "not measured", "holds in direction", "open",
    ]  # fmt: skip
    assert [row["kind"] for row in claims] == ["claim"] * 4 + ["own"]
    assert [claims[0][name] for name in ("ours", "low", "high", "published")] == ["40"] * 4
    assert [claims[3][name] for name in ("ours", "low", "high")] == ["30", "", ""]


def test_markdown_rows_all_have_as_many_cells_as_the_heading():
    rows = [line for line in table_markdown(TABLE).splitlines() if line.startswith("|")]
    assert len(rows) == 2 + len(TABLE.rows)
    assert {len(re.findall(r"(?<!\\)\|", row)) for row in rows} == {7}
    plain = Table("t", "s", TABLE.rows[:2])
    assert "note" not in table_markdown(plain)


def test_latex_rows_end_and_environments_close():
    text = table_latex(TABLE)
    body = text[text.index(r"\midrule") : text.index(r"\bottomrule")].splitlines()[1:]
    assert len(body) == len(TABLE.rows)
    for line in body:
        assert line.endswith(r"\\")
        assert len(re.findall(r"(?<!\\)&", line)) == 4
    for name in ("table", "tabular"):
        assert text.count(rf"\begin{{{name}}}") == text.count(rf"\end{{{name}}}") == 1
    assert r"\textsuperscript{a} asked for" in text


@settings(deadline=None)
@given(st.text(alphabet="&%$#_{}~^\\<>×≤a b", max_size=12))
def test_latex_is_left_no_special_that_it_would_obey(text):
    escaped = latex_text(text)
    for made in (r"\textbackslash{}", r"\textasciitilde{}", r"\textasciicircum{}"):
        escaped = escaped.replace(made, "")
    escaped = re.sub(r"\$(<|>|\\times|\\leq)\$", "", escaped)
    assert not re.sub(r"\\[&%$#_{}]", "", escaped).strip("a b")


def test_html_is_well_formed_and_escapes_what_is_not_its_own():
    section = ET.fromstring(table_html(TABLE))
    assert section.find("h3").text.strip() == "Fill & <b>queries</b>"
    assert len(section.findall(".//tbody/tr")) == len(TABLE.rows)
    assert len(section.findall(".//ul/li")) == len(TABLE.claims) + len(TABLE.own)


@pytest.mark.parametrize("form", [table_markdown, table_latex, table_csv, table_html])
def test_the_same_table_gives_the_same_bytes(form):
    assert form(TABLE) == form(TABLE)


def test_a_figures_points_lie_in_order_and_one_that_a_log_axis_cannot_show_is_said():
    svg = ET.fromstring(str(figure_svg(TABLE.figure)))
    name = "{http://www.w3.org/2000/svg}"
    lines = [
        [tuple(map(float, point.split(","))) for point in line.get("points").split()]
        for line in svg.iter(f"{name}polyline")
    ]
    # After the legend's three come the curves, each without what a logarithm cannot show.
    published, ours, others = lines[3:]
    assert (len(published), len(ours), len(others)) == (2, 1, 2)
    assert published[0][0] < published[1][0]
    assert published[0][1] < published[1][1]  # falling: y grows downwards
    assert others[0][1] < published[0][1]
    assert "1 at zero not shown" in "".join(svg.itertext())
    dashed = [line.get("stroke-dasharray") for line in svg.iter(f"{name}polyline")]
    assert [bool(dash) for dash in dashed[3:]] == [True, False, False]
    colours = [line.get("stroke") for line in svg.iter(f"{name}polyline")][3:]
    assert colours[0] == colours[1] != colours[2]


@settings(deadline=None)
@given(
    st.lists(st.tuples(VALUES, VALUES), max_size=5),
    st.booleans(),
    st.booleans(),
)
def test_any_figure_can_be_drawn_inside_its_box(points, log_x, log_y):
    x, y = zip(*points, strict=True) if points else ((), ())
    figure = Figure("x", "y", (Curve("c", tuple(x), tuple(y)),), log_x, log_y)
    svg = ET.fromstring(str(figure_svg(figure)))
    _, _, width, height = map(float, svg.get("viewBox").split())
    for circle in svg.iter("{http://www.w3.org/2000/svg}circle"):
        assert 0 <= float(circle.get("cx")) <= width
        assert 0 <= float(circle.get("cy")) <= height
