"""The catalogue and its generated page."""

from __future__ import annotations

from pathlib import Path

import pytest

from visref.findings import Code, Finding, Severity, document, rule_of

ROOT = Path(__file__).parent.parent


def test_the_documentation_is_the_catalogue():
    assert (ROOT / "docs" / "findings.md").read_text() == document()


def test_every_code_is_its_own_name_and_says_what_it_means():
    for name, code in Code.__members__.items():
        assert name == code == code.value == code.rule.code
        assert code.rule.severity in Severity
        assert code.rule.title
        assert code.rule.explanation.endswith(".")


def test_a_finding_on_file_reads_back_to_its_code():
    finding = Finding(Code.NO_GL, "no context")
    assert rule_of("NO_GL", "error") is finding.rule  # the catalogue's severity, not the file's


def test_a_misspelt_code_stops_where_it_stands():
    with pytest.raises(AttributeError):
        Code.PARTLY_RAED  # noqa: B018


@pytest.mark.parametrize(
    ("severity", "taken_as"), [("error", Severity.ERROR), ("fatal", Severity.WARNING)]
)
def test_a_code_of_another_version_is_told_by_what_the_record_says(severity, taken_as):
    rule = rule_of("LATER_CODE", severity)
    assert (rule.code, rule.severity) == ("LATER_CODE", taken_as)
    assert "does not know" in rule.title
