"""Every published constant is printed: where it says, in a list of the numbers that the document
prints there.

`tests/papers/printed/PAPER.json` lists numbers alone, by table, figure or section, in the
document's own units, number words as numbers. They were taken from the documents and not from our
constants; so a number that was never printed, or is said to stand elsewhere, is in none of them.
"""

from __future__ import annotations

import json
import re
from importlib import import_module
from pathlib import Path

import pytest

from visref.papers import load_paper, paper_names
from visref.papers.contents import Printed, printed_numbers, ratio_of

LISTS = Path(__file__).parent / "printed"


def printed_in(paper):
    return json.loads((LISTS / f"{paper}.json").read_text())


def unprinted(constants, lists):
    """Those of the printed numbers that are not in the list of their place."""
    return [one for one in printed_numbers(constants) if one.value not in lists.get(one.where, ())]


class Nowhere:
    def run(self, key):
        return None

    def experiment(self, key):
        return None


def shown(paper):
    """All that the paper's tables show as published, and what its claims are judged by."""
    for table in load_paper(paper).tables(Nowhere()):
        yield from (row.published for row in table.rows)
        yield from (claim.published for claim in (*table.claims, *table.own))
        yield from (setup.published for setup in table.setup)


def constants(paper):
    module = import_module(f"visref.papers.printed.{paper}")
    return [value for name, value in vars(module).items() if name.isupper()]


@pytest.mark.parametrize("paper", paper_names())
def test_every_published_number_is_printed_where_it_says(paper):
    lists = printed_in(paper)
    assert list(printed_numbers(constants(paper)))
    assert unprinted(constants(paper), lists) == []
    assert unprinted(list(shown(paper)), lists) == []


@pytest.mark.parametrize("paper", paper_names())
def test_lists_hold_numbers_alone(paper):
    for place, numbers in printed_in(paper).items():
        assert re.fullmatch(r"(Table|Fig\.|section) [\d.]+|Conclusions and Future Work", place)
        assert numbers == sorted(set(numbers))
        assert all(isinstance(number, (int, float)) for number in numbers)


def test_a_number_that_is_not_printed_or_not_there_is_found_out():
    """Fig. 4 of Décoret is an image in colours: 2.19 was ours."""
    lists = printed_in("decoret2005")
    good = Printed(350, "Table 2", "NB w/ hier.")
    for bad in (
        Printed(2.19, "Fig. 4", "extra over box pixels"),
        Printed(2.19, "Table 2", "extra over box pixels"),
        Printed(350, "Table 1", "in another table"),
        Printed(351, "Table 2", "off by one"),
    ):
        planted = {"table": [good, (bad, ratio_of(good, bad))]}
        assert unprinted(planted, lists) == [bad, bad]
    assert unprinted([good], lists) == []


def test_recomputed_averages_of_staneker_are_found_out():
    lists = printed_in("staneker2003")
    for value in (2_371, 1_216, 2_136):
        assert unprinted([Printed(value, "Table 3", "average polygons/shape")], lists)


def numerals(text):
    return [float(one.replace(",", "")) for one in re.findall(r"\d[\d,]*(?:\.\d+)?", text)]


def unsaid(claim, printed):
    """Numbers in a claim's words that are neither printed in the document nor its own figure."""
    amount = None if claim.published is None else claim.published.amount
    figures = () if amount is None else (amount, 100 * amount, 100 * (amount - 1.0))
    said = printed | {round(figure, digits) for figure in figures for digits in (0, 1, 2)}
    return [number for number in numerals(claim.statement) if number not in said]


@pytest.mark.parametrize("paper", paper_names())
def test_numbers_in_a_claims_words_are_the_papers(paper):
    printed = {number for numbers in printed_in(paper).values() for number in numbers}
    claims = [claim for table in load_paper(paper).tables(Nowhere()) for claim in table.claims]
    assert claims
    assert {
        claim.statement: unsaid(claim, printed) for claim in claims if unsaid(claim, printed)
    } == {}
