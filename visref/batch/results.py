"""What came of a batch: one record, and a table of it in Markdown and on a page."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from visref.batch.running import FORMAT, MARKDOWN, PAGE, PAGES, RECORD, RUNS, Ended, Run, worst
from visref.errors import InputError
from visref.files import replacing_file
from visref.judging.status import Status
from visref.report import words
from visref.report.environment import page_environment
from visref.run_folder.inside import json_inside
from visref.run_folder.read import read_run

_TITLE = "# visref batch: "
_PAGE_BEGINS = b"<!doctype html>\n<!-- visref batch -->\n"
# What is told of each culler of a job, as verdict.json has it.
COUNTS = (
    "frames", "visible", "drawn", "superfluous", "missed", "partly_missed", "missed_pixels",
    "violations",
)  # fmt: skip
HEADINGS = (
    "job", "culler", "frames", "visible", "drawn", "superfluous", "missed", "partly missed",
    "samples lost", "violations", "verdict",
)  # fmt: skip


@dataclass(frozen=True)
class BatchResults:
    """`batch.json`, as it is written."""

    record: dict[str, Any]

    @property
    def status(self) -> int:
        return int(self.record["exit_status"])

    @property
    def rows(self) -> list[tuple[str, ...]]:
        """A row for each job and culler, below `HEADINGS`; one for a job without a verdict."""
        found: list[tuple[str, ...]] = []
        for job in self.record["jobs"]:
            if not job["cullers"]:
                gap = ("–",) * (len(HEADINGS) - 3)
                found.append((job["name"], "–", *gap, f"✕ no verdict: {job['error']}"))
            for culler, told in job["cullers"].items():
                status = str(told["status"])
                said = f"{words.GLYPHS[status]} {status.replace('_', ' ')}"
                counts = [words.count(told[name]) for name in COUNTS]
                found.append((job["name"], culler, *counts, said))
        return found


def write_results(ended: Sequence[Ended], run: Run) -> BatchResults:
    """Write the record, the table and the page of jobs that have ended into the batch's folder."""
    statuses = [one.status for one in ended]
    results = BatchResults(
        {
            "format": FORMAT,
            "version": 1,
            "exit_status": worst(statuses),
            "jobs": [_job_json(one, run) for one in ended],
        }
    )
    text = json.dumps(results.record, indent=2)
    for name, written, begins in (
        (MARKDOWN, _markdown(results), _TITLE.encode()),
        (PAGE, _page(results), _PAGE_BEGINS),
        (RECORD, f"{text}\n", f'{{\n  "format": "{FORMAT}"'.encode()),
    ):
        with replacing_file(run.out / name, begins=begins) as beside:
            beside.write_text(written, encoding="utf-8")
    return results


def read_results(folder: Path) -> BatchResults:
    """The record of a batch's folder. Raises InputError if it is none."""
    record = json_inside(folder, RECORD, "give a folder that `visref batch` wrote")
    if not isinstance(record, dict) or record.get("format") != FORMAT or record.get("version") != 1:
        raise InputError(
            "this is no batch (format visref-batch, version 1)", source=str(folder / RECORD),
            fix="give a folder that `visref batch` wrote",
        )  # fmt: skip
    return BatchResults(record)


def _job_json(ended: Ended, run: Run) -> dict[str, Any]:
    job = ended.job
    told: dict[str, Any] = {
        "name": job.name,
        "scene": job.scene,
        "path": job.path,
        "exit_status": ended.status,
        "error": ended.error,
        "run": "",
        "page": "",
        "cullers": {},
    }
    if ended.error:
        return told
    read = read_run(run.folder(job), objects=False)
    told["run"] = f"{RUNS}/{job.name}"
    told["page"] = f"{PAGES}/{job.name}/report.html"
    for name in read.cullers:
        culler = read.verdict.cullers[name]
        counts = {count: getattr(culler, count) for count in COUNTS}
        told["cullers"][name] = {"status": culler.status, **counts}
    return told


def _headline(results: BatchResults) -> tuple[str, str]:
    """The status of the batch as a run's word for it, and what it says."""
    jobs = results.record["jobs"]
    without = sum(not job["cullers"] for job in jobs)
    counted = words.counted(len(jobs), "run")
    statuses = [told["status"] for job in jobs for told in job["cullers"].values()]
    if without:
        status = Status.INCONCLUSIVE
        said = f"{counted}, of which {without:,} came to no verdict"
        if Status.VIOLATION in statuses:
            status = Status.VIOLATION
        return status.value, said
    for status in (Status.VIOLATION, Status.INCONCLUSIVE, Status.NO_VIOLATION_FOUND):
        if status in statuses:
            return status.value, counted
    return Status.MEASURED.value, counted


def _markdown(results: BatchResults) -> str:
    status, said = _headline(results)
    lines = [
        f"{_TITLE}{words.GLYPHS[status]} {words.HEADLINES[status]}",
        "",
        f"{said}.",
        "",
        f"| {' | '.join(HEADINGS)} |",
        "|---|---|" + "--:|" * (len(HEADINGS) - 3) + "---|",
    ]
    lines += [f"| {' | '.join(map(words.plain, row))} |" for row in results.rows]
    return "\n".join(lines) + "\n"


def _page(results: BatchResults) -> str:
    status, said = _headline(results)
    template = page_environment("visref.batch").get_template("batch.html.j2")
    text = template.render(
        status=status,
        said=said,
        exit_status=results.status,
        jobs=results.record["jobs"],
        counts=COUNTS,
        headings=HEADINGS,
        words=words,
        glyphs=words.GLYPHS,
        headlines=words.HEADLINES,
    )
    return _PAGE_BEGINS.decode() + text
