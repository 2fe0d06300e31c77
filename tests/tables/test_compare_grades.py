"""Two results of `visref tables`: a claim that holds in one and fails in the other is told."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from visref.papers.contents import Claim, Printed, Sense, Table, series, single
from visref.report.tables import table_csv

TOOL = Path(__file__).resolve().parent.parent.parent / "tools" / "compare-grades"
TWO = Printed(2, "Table 1", "twice")
FIGURES = {
    "holds": single(2.5),
    "direction": single(1.5),
    "fails": single(0.5),
    "open": series([0.5, 3.5, 0.2, 3.8, 2.0, 1.0], range(6)).mean(),
    "unmeasured": None,
}


def result(folder, *names):
    folder.mkdir()
    claims = tuple(
        Claim(f"claim {place}", Sense.AT_LEAST, FIGURES[name], TWO)
        for place, name in enumerate(names)
    )
    head, *rows = table_csv(Table("Queries", "Table 1", (), claims[:1], claims[1:])).splitlines()
    (folder / "tables.csv").write_text(
        "\n".join([f"paper,{head}", *(f"toy,{row}" for row in rows)]) + "\n"
    )
    return folder


def compare(tmp_path, first, second):
    folders = result(tmp_path / "a", *first), result(tmp_path / "b", *second)
    done = subprocess.run([sys.executable, TOOL, *folders], capture_output=True, text=True)
    assert not done.stderr
    return done.returncode, done.stdout


@pytest.mark.parametrize("other", ["holds", "direction", "open", "unmeasured"])
def test_what_does_not_turn_over_is_no_contradiction(tmp_path, other):
    status, told = compare(tmp_path, ["holds", "fails"], [other, "open"])
    assert status == 0
    assert "changed: toy / Queries / claim 1: does not hold: 0.5; then open" in told
    assert ("claim 0" in told) is (other != "holds")


@pytest.mark.parametrize("first", ["holds", "direction"])
def test_what_holds_in_one_and_not_in_the_other_is_contradicted(tmp_path, first):
    for place, pair in enumerate([([first], ["fails"]), (["fails"], [first])]):
        folder = tmp_path / str(place)
        folder.mkdir()
        status, told = compare(folder, *pair)
        assert status == 1
        assert "CONTRADICTED: toy / Queries / claim 0" in told
        assert "1 and 1 claims, 1 contradicted" in told


def test_a_claim_of_ours_counts_as_one_and_a_missing_one_is_told(tmp_path):
    status, told = compare(tmp_path, ["holds", "holds"], ["holds", "fails"])
    assert status == 1
    assert "claim 1" in told
    (tmp_path / "more").mkdir()
    status, told = compare(tmp_path / "more", ["holds", "open"], ["holds"])
    assert status == 1
    assert "in one of them only: toy / Queries / claim 1" in told
