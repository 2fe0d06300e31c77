"""The suite against one engine: rows to run, how each ended, and what all of them come to.

A culler in Python meets the catalogue of `visref.conformance.suite`; any other engine is an
`Entrant`, which is something that gives a `Culler` for the files of a case.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from typing import Any, Protocol

from visref.conformance.declared import Declared
from visref.conformance.files import WrittenCase, written_cases
from visref.conformance.scenes import SCENES
from visref.conformance.suite import (
    Check,
    CheckResult,
    Judged,
    MakeCuller,
    NotForThis,
    Status,
    built_case,
    conformance_checks,
    judged_on,
    status_of,
)
from visref.culler import Culler, CullerError
from visref.errors import NothingToJudge
from visref.findings import Code
from visref.judging.status import Exit
from visref.scene import OBJECT
from visref.wording import shown

RESULTS_FORMAT, RESULTS_VERSION = "visref-conformance-results", 1


class Entrant(Protocol):
    """An engine that is known by what it answers to files."""

    @property
    def name(self) -> str:
        """What reports call it."""
        ...

    def culler(self, case: WrittenCase) -> AbstractContextManager[Culler]:
        """Its answers to a case. Raises CullerError where it has none, which fails the case."""
        ...


@dataclass(frozen=True)
class Row:
    """A case, or a check of the contract, for one engine. `run` raises NotForThis where it is not
    for such a case."""

    name: str
    claim: str
    trap: str
    classes: tuple[str, ...]
    run: Callable[[], Judged]


@dataclass(frozen=True)
class Ended:
    """A row and how it ended."""

    row: Row
    result: CheckResult

    @property
    def first(self) -> str:
        """One line about it: the first problem, or why it did not count."""
        result = self.result
        if result.status is Status.FAILED:
            return result.problems[0]
        if result.status is Status.UNEXPECTED_PASS:
            return f"expected to fail because: {result.reason}"
        return result.reason


def rows_of_files(entrant: Entrant, cases: Sequence[WrittenCase], declared: Declared) -> list[Row]:
    """A row per case, answered from its files. Who lists objects where a case is about clusters has
    not answered it: that fails where clusters are declared, and else the case counts as not run."""
    return [_row_of_files(entrant, case, declared) for case in cases]


def _row_of_files(entrant: Entrant, case: WrittenCase, declared: Declared) -> Row:
    def run() -> Judged:
        try:
            with entrant.culler(case) as culler:
                judged = judged_on(lambda: culler, case.case, case.truths)
        except CullerError as error:
            return Judged((str(error),))
        if case.units is None or not judged.unit_kind.startswith(OBJECT):
            return judged
        if declared.can is None and not judged.problems:
            raise NotForThis(_LISTS_OBJECTS)
        return replace(judged, problems=(*judged.problems, _LISTS_OBJECTS))

    return Row(case.name, case.made.claim, case.made.trap, case.classes, run)


_LISTS_OBJECTS = "it lists objects, and the case is about clusters"


Maker = Callable[[], AbstractContextManager[MakeCuller]]


def rows_of_culler(name: str, maker: Maker, seed: int) -> list[Row]:
    """A row per check of the catalogue, for a culler in Python. `maker`: gives what makes the
    culler, and ends what it made when a row is done. A culler says itself which units it decides
    about, so that no case asks for clusters."""
    classes = {case.name: case.classes for case in written_cases(seed)}
    rows = []
    for check in conformance_checks():
        own = tuple(name for name in classes.get(check.name, ()) if name != "clusters")
        run = _running(check, name, maker, seed)
        rows.append(Row(check.name, check.claim, check.trap, own, run))
    return rows


_SCENES = frozenset(made.name for made in SCENES)


def _running(check: Check, name: str, maker: Maker, seed: int) -> Callable[[], Judged]:
    def run() -> Judged:
        with maker() as make:
            if check.name in _SCENES:
                return judged_on(make, *built_case(check.name, seed), name)
            return Judged(*check.run(make, seed))

    return run


def run_rows(rows: Iterable[Row], declared: Declared) -> Iterator[Ended]:
    """Run the rows, each when it is asked for. What the engine is not made for is not run.

    Raises NothingToJudge where an engine needs OpenGL and there is none.
    """
    for row in rows:
        yield Ended(row, _result(row, declared))


def _result(row: Row, declared: Declared) -> CheckResult:
    if lacking := declared.lacks(row.classes):
        text = f"the engine is not made for {', '.join(lacking)}"
        return CheckResult(row.name, Status.SKIPPED, reason=text)
    try:
        judged = row.run()
    except NotForThis as why:
        return CheckResult(row.name, Status.SKIPPED, reason=str(why))
    for problem in judged.problems:
        if problem.startswith(f"{Code.NO_GL}:"):
            raise NothingToJudge(problem)
    reason = declared.reasons.get(row.name, "")
    status = status_of(judged.problems, reason, promised=judged.promised)
    return CheckResult(row.name, status, judged.problems, reason, judged.missed)


# What it comes to.


def counts_of(ended: Sequence[Ended]) -> dict[Status, int]:
    """How many rows ended in each way, in the order of `Status`."""
    return {status: sum(one.result.status is status for one in ended) for status in Status}


def exit_of(ended: Sequence[Ended]) -> Exit:
    """0 where all ended as it should, 1 where one failed or passed unexpectedly, 3 where none was
    run."""
    if not all(one.result.ok for one in ended):
        return Exit.VIOLATION
    if all(one.result.status is Status.SKIPPED for one in ended):
        return Exit.NOTHING_JUDGED
    return Exit.NO_VIOLATION


def results_json(engine: str, seed: int, ended: Sequence[Ended]) -> dict[str, Any]:
    """The results for programs."""
    return {
        "format": RESULTS_FORMAT,
        "version": RESULTS_VERSION,
        "engine": engine,
        "seed": seed,
        "exit_status": int(exit_of(ended)),
        "counts": {status.value: count for status, count in counts_of(ended).items()},
        "cases": [
            {
                "name": one.row.name,
                "classes": list(one.row.classes),
                "result": one.result.status.value,
                "missed": one.result.missed,
                "problems": list(one.result.problems),
                "reason": one.result.reason,
            }
            for one in ended
        ],
    }


def results_junit(engine: str, seed: int, ended: Sequence[Ended]) -> str:
    """The results as JUnit XML. What was not run, was measured alone, or failed as expected is
    skipped, with the reason: none of it has passed."""
    counts = counts_of(ended)
    bad = counts[Status.FAILED] + counts[Status.UNEXPECTED_PASS]
    skipped = len(ended) - bad - counts[Status.PASSED]
    suites = ET.Element("testsuites", name="visref conformance")
    suite = ET.SubElement(
        suites,
        "testsuite",
        name=shown(engine),
        tests=str(len(ended)),
        failures=str(bad),
        errors="0",
        skipped=str(skipped),
    )
    properties = ET.SubElement(suite, "properties")
    ET.SubElement(properties, "property", name="seed", value=str(seed))
    for one in ended:
        result = one.result
        case = ET.SubElement(
            suite, "testcase", classname="visref.conformance", name=one.row.name, time="0"
        )
        said = shown(f"{result.status}: {one.first}" if one.first else result.status.value)
        lines = "\n".join(map(shown, result.problems))
        if not result.ok:
            kind = result.status.value.replace(" ", "_")
            ET.SubElement(case, "failure", type=kind, message=said).text = lines
        elif result.status is not Status.PASSED:
            ET.SubElement(case, "skipped", message=said)
        about = [f"claim: {one.row.claim}", f"trap: {one.row.trap}"]
        if one.row.classes:
            about.append(f"classes: {', '.join(one.row.classes)}")
        ET.SubElement(case, "system-out").text = "\n".join(map(shown, about))
    ET.indent(suites)
    return ET.tostring(suites, encoding="unicode", xml_declaration=True) + "\n"
