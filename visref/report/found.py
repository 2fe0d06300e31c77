"""Findings as the page groups them."""

from __future__ import annotations

from dataclasses import dataclass, replace

from visref.findings import Code, Rule, Severity, rule_of
from visref.run_folder.read import RunFolder
from visref.run_folder.rows import FindingRow

# How many of one code the page lists; verdict.json has the rest.
MAX_FINDINGS = 8


@dataclass(frozen=True)
class FindingGroup:
    """The findings of one code."""

    rule: Rule
    findings: list[FindingRow]
    left_out: int

    @property
    def total(self) -> int:
        return len(self.findings) + self.left_out


# Findings that have a section of their own: the end of its id, and its heading.
ELSEWHERE: dict[str, tuple[str, str]] = {
    Code.MISSED_OBJECT: ("lost", "What was lost"),
    Code.MISSED_DECLARED: ("lost", "What was lost"),
    Code.DRAWN_HIDDEN: ("hidden", "Drawn against the promise"),
}


def _shown(code: str) -> int:
    """How many findings of this code are listed; some have a section of their own."""
    return 0 if code in ELSEWHERE else MAX_FINDINGS


def finding_groups(run: RunFolder) -> list[FindingGroup]:
    """Findings by code: what is to be mended in the input, then the gravest, else in the
    catalogue's order and unknown codes last."""
    by_code: dict[str, list[FindingRow]] = {code: [] for code in Code}
    for finding in run.verdict.findings:
        by_code.setdefault(finding.code, []).append(finding)
    rules = [rule_of(code, found[0].severity) for code, found in by_code.items() if found]
    # The catalogue's severity, unless the user's policy says another.
    said = run.manifest.policy.severities if run.manifest.policy is not None else {}
    rules = [replace(rule, severity=Severity(said.get(rule.code, rule.severity))) for rule in rules]
    gravity = {severity: rank for rank, severity in enumerate(Severity)}
    rules.sort(key=lambda rule: (rule.code != Code.MISALIGNED, gravity[rule.severity]))
    return [
        FindingGroup(rule, found[: (shown := _shown(rule.code))], max(0, len(found) - shown))
        for rule in sorted(
            rules, key=lambda rule: (rule.code != Code.MISALIGNED, gravity[rule.severity])
        )
        for found in [by_code[rule.code]]
    ]
