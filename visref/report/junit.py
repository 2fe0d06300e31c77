"""JUnit XML, as CI servers read it: a test case per culler and scene, and one per object.

An object that convicts a culler is a failed case, whatever their number; one whose misses a policy
accepts is a skipped case that says as what; all others are one passed case, which counts them: a
scene has a hundred thousand.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence
from pathlib import Path

from visref.findings import Code
from visref.judging.status import Status
from visref.report.misses import (
    ObjectMisses,
    convicted,
    convicted_lines,
    facts_of,
    lost_line,
    object_misses,
    why_lines,
)
from visref.report.summary import CullerSummary, summarise
from visref.report.words import (
    COUNTING,
    HEADLINES,
    ages_line,
    count,
    counted,
    culler_sentence,
    failing_lines,
    hidden_line,
    hidden_name,
    not_claimed,
    policy_line,
    rates_line,
)
from visref.run_folder.layout import ObjectKind
from visref.run_folder.read import RunFolder
from visref.wording import shown

# How a file of ours begins, so that another is never replaced by it.
BEGINS = b"<?xml version='1.0' encoding='utf-8'?>\n<testsuites name=\"visref"

REST = "objects without a violation"
# Of so many convicted objects the case tells all; of the others only how much was lost.
_TOLD = 1000


def junit_xml(runs: Sequence[RunFolder], out: Path) -> str:
    """A violation is a failure; an inconclusive verdict is an error, since a check that checked
    nothing must not pass; what promises nothing is skipped, since it cannot pass. `out` is the
    folder where replay commands start."""
    suites = ET.Element("testsuites", name="visref")
    for run in runs:
        suite = ET.SubElement(suites, "testsuite", name=shown(run.scene_name))
        properties = ET.SubElement(suite, "properties")
        for name, value in (
            ("engine", run.manifest.engine),
            ("scene.sha256", run.manifest.scene.sha256),
            ("path.sha256", run.manifest.path.sha256),
            ("frames", str(len(run.frame_numbers))),
            *([("policy.sha256", policy.sha256)] if (policy := run.manifest.policy) else []),
        ):
            ET.SubElement(properties, "property", name=name, value=shown(value))
        for culler in run.cullers:
            row = summarise(run, culler)
            _add_culler(suite, run, row)
            _add_objects(suite, run, row, out)
        if failing := failing_lines(run):
            case = _case(suite, run.scene_name, "policy")
            _outcome(case, "failure", "policy", failing[0], failing)
        _count(suite)
    return _text(suites)


def junit_of_failure(name: str, kind: str, line: str) -> str:
    """The file of a command that came to no verdict: `name` is the command's, `kind` a word for
    what ended it, `line` what it said."""
    suites = ET.Element("testsuites", name="visref")
    suite = ET.SubElement(suites, "testsuite", name="visref")
    _outcome(_case(suite, "visref", name), "error", kind, line)
    _count(suite)
    return _text(suites)


def _text(suites: ET.Element) -> str:
    ET.indent(suites)
    written: bytes = ET.tostring(suites, encoding="utf-8", xml_declaration=True)
    return written.decode("utf-8") + "\n"


def _case(suite: ET.Element, classname: str, name: str, seconds: float = 0.0) -> ET.Element:
    said = {"classname": shown(classname), "name": shown(name), "time": f"{seconds:.3f}"}
    return ET.SubElement(suite, "testcase", said)


def _outcome(
    case: ET.Element, outcome: str, kind: str, message: str, lines: Iterable[str] = ()
) -> None:
    said = {"type": kind, "message": shown(message)}
    ET.SubElement(case, outcome, said).text = _lines(lines) or None


def _count(suite: ET.Element) -> None:
    """How many cases there are of each kind, on the suite."""
    cases = suite.findall("testcase")
    suite.set("tests", str(len(cases)))
    for total, outcome in (("failures", "failure"), ("errors", "error"), ("skipped", "skipped")):
        suite.set(total, str(sum(case.find(outcome) is not None for case in cases)))


def _add_culler(suite: ET.Element, run: RunFolder, row: CullerSummary) -> None:
    """The culler's own case, with its verdict."""
    seconds = sum(run.cull_ms.get(row.culler, {}).values()) / 1e3
    case = _case(suite, run.scene_name, row.culler, seconds)
    sentence = culler_sentence(row)
    why = why_lines(run.verdict.cullers[row.culler].causes)
    if row.status is Status.VIOLATION:
        _outcome(case, "failure", "violation", sentence, why)
    elif row.status is Status.INCONCLUSIVE:
        _outcome(case, "error", "inconclusive", sentence)
    elif row.status is Status.MEASURED:
        _outcome(case, "skipped", "measured", sentence)
    output = [f"{HEADLINES[row.status]}: {sentence}", *why, rates_line(row)]
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


def _add_objects(suite: ET.Element, run: RunFolder, row: CullerSummary, out: Path) -> None:
    """The cases of a culler's objects; none where nothing was concluded of them."""
    if row.status not in (Status.VIOLATION, Status.NO_VIOLATION_FOUND):
        return
    classname = f"{run.scene_name}: {row.culler}"
    missed = object_misses(run, row.culler)
    facts = facts_of(run, row, _TOLD)
    guilty = {lost.worst.object for lost in convicted(row)}
    for rank, lost in enumerate(convicted(row)):
        misses = missed.get(lost.worst.object)
        case = _case(suite, classname, f"{lost.worst.name}, object {lost.worst.object}")
        told = []
        if rank < _TOLD:
            said = facts.get(lost.worst.object, "")
            told = convicted_lines(run, row, lost, misses, out, said)
        _outcome(case, "failure", "violation", lost_line(lost), told)
    for unit in row.hidden:
        # An object may be lost in one frame and drawn for nothing in another.
        name = f"{hidden_name(row, unit)}, {row.unit_kind} {unit.unit}, drawn though hidden"
        case = _case(suite, classname, name)
        _outcome(case, "failure", "violation", hidden_line(unit))
    excused = [one for one in missed.values() if one.object not in guilty and one.accepted]
    for one in excused:
        case = _case(suite, classname, f"{one.name}, object {one.object}")
        _outcome(case, "skipped", "accepted", f"accepted by the policy: {one.accepted}")
    named = guilty.union(one.object for one in excused)
    if row.unit_kind == "object":
        named.update(unit.unit for unit in row.hidden)
    rest = [one for one in missed.values() if one.object not in named]
    if (others := run.manifest.scene.objects - len(named)) > 0:
        case = _case(suite, classname, REST)
        ET.SubElement(case, "system-out").text = _lines(_rest_lines(run, others, rest))


def _rest_lines(run: RunFolder, others: int, rest: Sequence[ObjectMisses]) -> list[str]:
    objects = counted(run.manifest.scene.objects, "object")
    lines = [f"{count(others)} of the scene's {objects}: seen or not, none of them convicts."]
    for kind, said in (
        (ObjectKind.TIE, "left out at a tie"),
        (ObjectKind.WITHIN_RASTER, "lost within the rasteriser's tolerance"),
        (ObjectKind.UNDECIDED, "undecided, whether it is visible"),
        # Of a culler that does not promise to draw what is visible.
        (ObjectKind.CONFIRMED, "missed, which it does not promise not to do"),
    ):
        if number := sum(bool(one.kinds[kind.value]) for one in rest):
            lines.append(f"{counted(number, 'object')} of these at some time {said}.")
    return lines


def _lines(lines: Iterable[str]) -> str:
    return "\n".join(map(shown, lines))
