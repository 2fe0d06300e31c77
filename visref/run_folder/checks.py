"""Whether what the files of a run folder say goes together: that every row tells of a culler, a
frame, a view, an object and a sample that there are. What fits is safe to show; whether it is true,
nobody can see from a record.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from visref.camera import ALL_VIEWS
from visref.errors import InputError
from visref.findings import Code, fails_run
from visref.judging.causes import CODES
from visref.judging.status import Status, run_status
from visref.run_folder.columns import check_among, check_range
from visref.run_folder.facts import FIX
from visref.run_folder.inside import file_inside, quoted, shortened
from visref.run_folder.layout import (
    CAUSES,
    COUNTERS,
    COUNTS,
    FRAMES,
    MANIFEST,
    MISS_KINDS,
    OBJECTS,
    TIMINGS,
    TRUTH_PHASE,
    VERDICT,
    ObjectKind,
    slug,
)
from visref.run_folder.rows import Manifest, RunVerdict

# More phases than any culler times in a frame.
MAX_PHASES = 32
# The largest runs have some 50 million rows, and each takes about 100 bytes in memory.
MAX_OBJECT_ROWS = 100_000_000

_INT64 = (1 << 63) - 1
_MISSED = ("missed", "partly_missed", "undecided")


def check_is_run(folder: Path) -> None:
    """Raises InputError unless the folder has a manifest, a file of its own."""
    if not (folder / MANIFEST).exists():
        raise InputError(
            f"this is no run folder: it has no {MANIFEST}", source=str(folder), fix=FIX
        )
    file_inside(folder, MANIFEST, FIX)


def check_manifest(folder: Path, manifest: Manifest) -> None:
    """That the manifest agrees with itself."""
    source = str(folder / MANIFEST)
    if len(manifest.samples) != manifest.path.frames:
        raise InputError(
            f"it defines the samples of {len(manifest.samples)} of {manifest.path.frames} frames",
            source=source,
            place="samples",
            fix=FIX,
        )
    for name, facts in manifest.cullers.items():
        if facts.slug != slug(name):
            raise InputError(
                "it is not the culler's part of file names",
                source=source,
                place=f"cullers.{shortened(name)}.slug",
                fix=FIX,
            )
    for index, pictures in enumerate(manifest.pictures):
        if pictures.culler not in manifest.cullers:
            problem, place = f"culler {quoted(pictures.culler)} is not in 'cullers'", "culler"
        elif pictures.frame not in manifest.samples:
            problem, place = f"frame {pictures.frame} is not in 'samples'", "frame"
        elif pictures.view not in manifest.samples[pictures.frame]:
            problem, place = f"view {quoted(pictures.view)} is not in 'samples'", "view"
        else:
            continue
        at = f"pictures[{index}].{place}"
        raise InputError(problem, source=source, place=at, fix=FIX)


def check_verdict(folder: Path, manifest: Manifest, verdict: RunVerdict) -> None:
    """That both files tell of the same cullers, and that the verdict's words and its exit status
    are those of its cullers."""
    check_manifest(folder, manifest)
    source = str(folder / VERDICT)
    for culler, said in verdict.cullers.items():
        if culler not in manifest.cullers:
            problem = f"it judges {quoted(culler)}, which {MANIFEST} does not list"
            raise InputError(problem, source=source, place="cullers", fix=FIX)
        excused = said.status == Status.INCONCLUSIVE and any(
            finding.code == Code.MISALIGNED and finding.culler == culler
            for finding in verdict.findings
        )
        if bool(said.violations) != (said.status == Status.VIOLATION) and not excused:
            problem = f"it is {said.status}, with {said.violations} violations"
            place = f"cullers.{shortened(culler)}.status"
            raise InputError(problem, source=source, place=place, fix=FIX)
    statuses = [Status(said.status) for said in verdict.cullers.values()]
    fails = any(fails_run(finding.code, finding.severity) for finding in verdict.findings)
    told = run_status(statuses, fails=fails)
    if Status(verdict.status) is not told:
        problem = f"it is {verdict.status}, and its cullers and findings say {told}"
        raise InputError(problem, source=source, place="status", fix=FIX)
    if verdict.exit_status != told.exit:
        problem = f"it is {verdict.exit_status}, which is not that of its status"
        raise InputError(problem, source=source, place="exit_status", fix=FIX)


def check_frames(folder: Path, manifest: Manifest, verdict: RunVerdict, table: pa.Table) -> None:
    """That rows are of cullers that were judged, of frames and views of the manifest, and each of
    another; that counts are counts; and that every picture has its row."""
    file = folder / FRAMES
    known = dict.fromkeys(verdict.cullers)
    for name in (*COUNTS, *COUNTERS, "corrections", "image_pixels_differ", "owned"):
        check_range(table, name, 0, _INT64, file, FIX)
    seen: set[tuple[str, int, str]] = set()
    columns = (table[name].to_pylist() for name in ("culler", "frame", "view"))
    for cell in zip(*columns, strict=True):
        culler, frame, view = cell
        if culler not in known:
            problem, place = f"it judges {quoted(culler)}, which {VERDICT} does not", "culler"
        elif frame not in manifest.samples:
            problem, place = f"frame {frame} is not one of {MANIFEST}", "frame"
        elif not judged_views(manifest, frame, view):
            problem, place = f"view {quoted(view)} is not one of {MANIFEST}", "view"
        elif cell in seen:
            problem, place = f"frame {frame} of {quoted(culler)} stands twice", "frame"
        else:
            seen.add(cell)
            continue
        raise InputError(problem, source=str(file), place=place, fix=FIX)
    for index, pictures in enumerate(manifest.pictures):
        shown = {(pictures.culler, pictures.frame, view) for view in (pictures.view, ALL_VIEWS)}
        if shown.isdisjoint(seen):
            raise InputError(
                f"it shows frame {pictures.frame} of {quoted(pictures.culler)}, which {FRAMES} "
                "does not have",
                source=str(folder / MANIFEST),
                place=f"pictures[{index}]",
                fix=FIX,
            )


def check_timings(folder: Path, manifest: Manifest, table: pa.Table) -> None:
    """That times are times, of cullers and frames of the manifest."""
    file = folder / TIMINGS
    check_among(table, "frame", manifest.samples, file, FIX)
    check_range(table, "ms", 0.0, float(np.finfo(np.float64).max), file, FIX)
    check_among(table, "culler", {**manifest.cullers, "": None}, file, FIX)
    check_among(table, "view", _views(manifest), file, FIX)
    no_culler = pc.equal(table["culler"], "")
    of_truth = pc.equal(table["phase"], TRUTH_PHASE)
    if pc.any(pc.and_not(no_culler, of_truth)).as_py():
        raise InputError("a time of no culler", source=str(file), place="culler", fix=FIX)


class Told(NamedTuple):
    """How many rows objects.parquet may have by the counts of frames.parquet: of what was missed,
    and of what was drawn for nothing, not all of which need be listed."""

    missed: int
    superfluous: int


def told_rows(frames: pa.Table) -> Told:
    """By the table of frames."""
    missed, superfluous = (
        sum(sum(cell or 0 for cell in frames[name].to_pylist()) for name in names)
        for names in (_MISSED, ("superfluous",))
    )
    return Told(missed, superfluous)


def check_objects(folder: Path, manifest: Manifest, table: pa.Table, told: Told) -> None:
    """That rows are of cullers, frames and views of the manifest, of objects, units and triangles
    that there are and of samples within their view, and no more than was counted."""
    file = folder / OBJECTS
    for_nothing = pc.sum(pc.equal(table["kind"], ObjectKind.SUPERFLUOUS.value)).as_py() or 0
    if for_nothing > told.superfluous or len(table) - for_nothing > told.missed:
        raise InputError("more rows than were counted", source=str(file), place="kind", fix=FIX)
    check_among(table, "frame", manifest.samples, file, FIX)
    check_among(table, "culler", manifest.cullers, file, FIX)
    check_among(table, "kind", frozenset(ObjectKind), file, FIX)
    check_among(table, "cause", CAUSES | CODES.keys(), file, FIX)
    check_among(table, "view", _views(manifest), file, FIX)
    last_unit = max((facts.units for facts in manifest.cullers.values()), default=0) - 1
    last_triangle = manifest.scene.triangles - 1
    # Of a unit that is no object, the object is -1.
    check_range(table, "object", -1, manifest.scene.objects - 1, file, FIX)
    check_range(table, "unit", 0, last_unit, file, FIX)
    check_range(table, "triangle", 0, last_triangle, file, FIX)
    check_range(table, "occluder", 0, last_triangle, file, FIX)
    for name in ("pixels", "owned", "samples", "age"):
        check_range(table, name, 0, _INT64, file, FIX)
    sizes = {
        (view["width"], view["height"])
        for views in manifest.samples.values()
        for view in views.values()
    }
    check_range(table, "x", 0, max(width for width, _ in sizes) - 1, file, FIX)
    check_range(table, "y", 0, max(height for _, height in sizes) - 1, file, FIX)
    for name in ("depth", "margin_px", "margin_depth"):
        largest = float(np.finfo(np.float64).max)
        check_range(table, name, -largest, largest, file, FIX)
    _check_kinds(table, file)


def _check_kinds(table: pa.Table, file: Path) -> None:
    """That a row has what its kind needs: a miss its object and sample, what is superfluous its
    unit, and where a triangle hides that, its name and the sample."""
    missed = pc.is_in(table["kind"].cast(pa.string()), pa.array(list(MISS_KINDS), pa.string()))
    superfluous = pc.equal(table["kind"], ObjectKind.SUPERFLUOUS.value)
    hiding = pc.is_valid(table["occluder"])
    for rows, names in (
        (missed, ("object", "name", "pixels", "owned", "x", "y", "triangle", "depth", "partly")),
        (superfluous, ("unit",)),
        (pc.is_valid(table["samples"]), ("unit",)),
        (hiding, ("samples", "occluder_name", "x", "y")),
    ):
        for name in names:
            if pc.any(pc.and_(rows, pc.is_null(table[name]))).as_py():
                raise InputError(
                    "a row has an empty cell that its kind needs",
                    source=str(file),
                    place=name,
                    fix=FIX,
                )
    if pc.any(pc.and_(missed, pc.less(table["object"], 0))).as_py():
        raise InputError("a miss of no object", source=str(file), place="object", fix=FIX)


def judged_views(manifest: Manifest, frame: int, view: str) -> tuple[str, ...]:
    """The views that a record's drawn set is for: the one that it names, or all of its frame where
    it names none of several; empty where there is no such view."""
    views = tuple(manifest.samples[frame])
    if view in views:
        return (view,)
    return views if view == ALL_VIEWS and len(views) > 1 else ()


def _views(manifest: Manifest) -> frozenset[str]:
    """All that a record may name."""
    several = any(len(views) > 1 for views in manifest.samples.values())
    named = frozenset(view for views in manifest.samples.values() for view in views)
    return named | {ALL_VIEWS} if several else named
