"""JUnit XML: one test case per culler and scene, as CI servers read it."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence
from pathlib import Path

from visref.findings import Code
from visref.judging.status import Status
from visref.report.summary import CullerSummary, summarise
from visref.report.words import (
    COUNTING,
    HEADLINES,
    ages_line,
    counted,
    culler_sentence,
    failing_lines,
    frame_of,
    hidden_line,
    hidden_name,
    missed_in,
    not_claimed,
    policy_line,
    rates_line,
    replay_command,
)
from visref.run_folder.read import RunFolder
from visref.wording import shown

_MAX_LOST = 20


def junit_xml(runs: Sequence[RunFolder], out: Path) -> str:
    """A violation is a failure; an inconclusive verdict is an error, since a check that checked
    nothing must not pass; what promises nothing is skipped, since it cannot pass. `out` is the
    folder it will stand in: replay commands start there."""
    suites = ET.Element("testsuites", name="visref")
    for run in runs:
        rows = [summarise(run, culler) for culler in run.cullers]
        failing = failing_lines(run)
        failures = sum(row.status is Status.VIOLATION for row in rows) + bool(failing)
        errors = sum(row.status is Status.INCONCLUSIVE for row in rows)
        skipped = sum(row.status is Status.MEASURED for row in rows)
        suite = ET.SubElement(
            suites,
            "testsuite",
            name=shown(run.scene_name),
            tests=str(len(rows) + bool(failing)),
            failures=str(failures),
            errors=str(errors),
            skipped=str(skipped),
        )
        properties = ET.SubElement(suite, "properties")
        for name, value in (
            ("engine", run.manifest.engine),
            ("scene.sha256", run.manifest.scene.sha256),
            ("path.sha256", run.manifest.path.sha256),
            ("frames", str(len(run.frame_numbers))),
            *([("policy.sha256", policy.sha256)] if (policy := run.manifest.policy) else []),
        ):
            ET.SubElement(properties, "property", name=name, value=shown(value))
        for row in rows:
            _add_case(suite, run, row, out)
        if failing:
            said = {"classname": shown(run.scene_name), "name": "policy", "time": "0"}
            case = ET.SubElement(suite, "testcase", said)
            failure = ET.SubElement(case, "failure", type="policy", message=shown(failing[0]))
            failure.text = _lines(failing)
    ET.indent(suites)
    return ET.tostring(suites, encoding="unicode", xml_declaration=True) + "\n"


def _add_case(suite: ET.Element, run: RunFolder, row: CullerSummary, out: Path) -> None:
    seconds = sum(run.cull_ms.get(row.culler, {}).values()) / 1e3
    case = ET.SubElement(
        suite,
        "testcase",
        classname=shown(run.scene_name),
        name=shown(row.culler),
        time=f"{seconds:.3f}",
    )
    sentence = shown(culler_sentence(row))
    if row.status is Status.VIOLATION:
        failure = ET.SubElement(case, "failure", type="violation", message=sentence)
        failure.text = _lines([*_losses(run, row, out), *_hidden(row)])
    elif row.status is Status.INCONCLUSIVE:
        ET.SubElement(case, "error", type="inconclusive", message=sentence)
    elif row.status is Status.MEASURED:
        ET.SubElement(case, "skipped", message=sentence)
    output = [f"{HEADLINES[row.status]}: {sentence}", rates_line(row)]
    if ages := ages_line(row):
        output.append(f"Misses by age, in frames since what is missed came into view: {ages}")
    if policy := policy_line(run.manifest.policy):
        output.append(policy)
    output += [COUNTING, *not_claimed(run)]
    output += [
        f"{finding.code}: {finding.message}"
        for finding in run.verdict.findings
        if finding.culler == row.culler and finding.code in (Code.CULLER_FAILED, Code.NO_GL)
    ]
    ET.SubElement(case, "system-out").text = _lines(output)


def _losses(run: RunFolder, row: CullerSummary, out: Path) -> list[str]:
    lines = [
        f"{lost.worst.name}, {missed_in(lost)}: {counted(lost.samples, 'sample')} over "
        f"{counted(lost.frames, 'frame')}; witness: "
        f"{frame_of(lost.worst)}, pixel ({lost.worst.x}, {lost.worst.y}), depth "
        f"{lost.worst.depth:.9g}; {replay_command(run, lost.worst, out)}"
        for lost in row.lost[:_MAX_LOST]
    ]
    if len(row.lost) > _MAX_LOST:
        lines.append(f"… and {len(row.lost) - _MAX_LOST} more in objects.parquet")
    return lines


def _hidden(row: CullerSummary) -> list[str]:
    lines = [f"{hidden_name(row, one)}: {hidden_line(one)}" for one in row.hidden[:_MAX_LOST]]
    if len(row.hidden) > _MAX_LOST:
        lines.append(f"… and {len(row.hidden) - _MAX_LOST} more in objects.parquet")
    return lines


def _lines(lines: Iterable[str]) -> str:
    return "\n".join(map(shown, lines))
