"""Policies as files: what is refused, where it is said to be, and what comes back."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from datetime import date

import pytest

from visref.errors import InputError
from visref.findings import Code, Severity
from visref.judging.policy import Policy, Span, Waiver
from visref.judging.policy_file import read_policy, to_toml

WAIVER = '[[waive]]\nobject = "door"\nreason = "known"\n'


def read(folder, text, **more):
    file = folder / "visref.toml"
    file.write_text(text, encoding="utf-8")
    return read_policy(file, **more)


def test_an_empty_file_accepts_nothing(tmp_path):
    policy = read(tmp_path, "", today=date(2026, 1, 2))
    plain = replace(policy, source="", sha256="", today=None)
    assert plain == Policy()
    assert policy.sha256 == hashlib.sha256(b"").hexdigest()
    assert policy.today == date(2026, 1, 2)


def test_what_is_written_is_read_back(tmp_path):
    policy = Policy(
        3,
        8,
        0.125,
        (
            Waiver("tree[[]1]", 'of "oak"\n\x7f\t\\ – Eiche', (Span(3, 4), Span(5, None, 2))),
            Waiver("*", "r", (), "hzb:*", date(2031, 2, 28)),
        ),
        {Code.IMAGE_DIFFERS: Severity.ERROR, Code.NO_GL: Severity.INFO},
    )
    again = read(tmp_path, to_toml(policy))
    assert replace(again, source="", sha256="", today=None) == policy


@pytest.mark.parametrize("empty", ['""', '"  "', '"\\n\\t"'])
def test_an_empty_reason_is_an_error_that_says_so(empty, tmp_path):
    with pytest.raises(InputError) as caught:
        read(tmp_path, WAIVER + f'[[waive]]\nobject = "lamp*"\nreason = {empty}\n')
    line = str(caught.value)
    assert "visref.toml: waive[1].reason: the reason is empty" in line
    assert "'lamp*'" in line


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("latency_frames = -1", "latency_frames"),
        ("latency_frames = true", "latency_frames"),
        ("min_samples = 1.5", "min_samples"),
        ("max_undecided = 1.01", "max_undecided"),
        ("max_undecided = nan", "max_undecided"),
        ('max_undecided = "half"', "max_undecided"),
        ("waive = 3", "waive"),
        ('[[waive]]\nreason = "r"', "waive[0].object"),
        ('[[waive]]\nobject = ""\nreason = "r"', "waive[0].object"),
        ('[[waive]]\nobject = "x"', "waive[0].reason"),
        (WAIVER + "frames = []", "waive[0].frames"),
        (WAIVER + 'frames = "3:3"', "waive[0].frames"),
        (WAIVER + 'frames = "-3:"', "waive[0].frames"),
        (WAIVER + 'frames = "1:9:0"', "waive[0].frames"),
        (WAIVER + "frames = [1, -2]", "waive[0].frames"),
        (WAIVER + 'culler = ""', "waive[0].culler"),
        (WAIVER + 'expires = "2026-02-30"', "waive[0].expires"),
        (WAIVER + "expires = 2026-02-03T10:00:00", "waive[0].expires"),
        ('severities = "error"', "severities"),
        ('[severities]\nIMAGE_DIFFERS = "fatal"', "severities.IMAGE_DIFFERS"),
        ('[severities]\nMISSED_OBJECT = "info"', "severities.MISSED_OBJECT"),
        ('[severities]\nSTALE_WAIVER = "warning"', "severities.STALE_WAIVER"),
        ("min_samples = 1\nmin_samples = 2", "not valid TOML"),
    ],
)
def test_what_is_wrong_is_one_line_that_names_its_place(text, place, tmp_path):
    with pytest.raises(InputError) as caught:
        read(tmp_path, text)
    line = str(caught.value)
    assert f"visref.toml: {place}" in line
    assert "\n" not in line


def test_a_misspelt_field_is_passed_over_and_named(tmp_path):
    text = f"latency_frame = 1\n{WAIVER}expired = 2020-01-01\n"
    text += '[severities]\nIMAGE_DIFFER = "error"\n'
    policy = read(tmp_path, text)
    assert (policy.latency_frames, policy.waivers[0].expires) == (0, None)
    assert not policy.severities
    said = [finding.message for finding in policy.remarks]
    assert all(finding.code is Code.FIELD_IGNORED for finding in policy.remarks)
    for name, meant in (
        ("'latency_frame'", "'latency_frames'"),
        ("'waive[0].expired'", "'expires'"),
        ("'severities.IMAGE_DIFFER'", "'IMAGE_DIFFERS'"),
    ):
        assert any(name in message and meant in message for message in said)


def test_the_day_is_the_clocks_unless_it_is_said(tmp_path):
    assert read(tmp_path, "").today is not None
