"""The run folder: what a run leaves on disk, and all that reports are made from.

manifest.json      versions, hashes of the inputs, settings, samples' definition, machine
verdict.json       statuses, sums, findings
frames.parquet     one row per culler, frame and view: counts and costs
timings.parquet    one row per culler, frame, view and phase: milliseconds (the one file that
                   differs between two runs of the same inputs)
objects.parquet    one row per culler, frame, view and object that was missed, in full or in part,
                   or undecided; a miss with its likeliest cause; and one per unit drawn for
                   nothing, in the frames picked for pictures, with its own cause, and where a
                   promise forbids it, with what hides it (with `--superfluous-rows` in all frames;
                   frames.parquet counts them in any case)
truth.parquet      the truth, as `visref truth` writes it
witnesses/         one file per culler, one JSON line per miss: its ray and the triangles along it
                   as hexadecimal floats, so that it replays without the scene; its causes and the
                   plain facts about it; and, for pictures, what is seen around it
pictures/          pictures of a few frames, listed in manifest.json: which ones is said in
                   `visref.run_folder.picture_plan` and `visref.causes.pictured`
part.json          of a shard: which part of which run it is, and what `visref merge` needs
part.parquet       of a shard: one row per row of frames.parquet, with who was drawn and what ages
                   hang on
part-units.parquet of a shard: the units of cullers that decide about others than objects

`visref explain` adds PNGs to witnesses/, and `visref report` its three files where it is told to.

What writer and reader share stands here: names, versions, kinds and the tables' columns. Version
1 has no views and fewer counts, and says nothing of whether the engine is exact; it is still read.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from enum import StrEnum
from typing import Any

import pyarrow as pa

from visref.files import FolderKind

FORMAT = "visref-run"
VERSION = 2
READABLE = (1, 2)

MANIFEST = "manifest.json"
VERDICT = "verdict.json"
FRAMES = "frames.parquet"
TIMINGS = "timings.parquet"
OBJECTS = "objects.parquet"
TRUTH = "truth.parquet"
WITNESSES = "witnesses"
PICTURES = "pictures"
# Of a part of a run: what the whole run needs beside the above (`visref.run_folder.part`).
PART = "part.json"
PART_CELLS = "part.parquet"
PART_UNITS = "part-units.parquet"

# The setting of a run, in its manifest, that lists what was drawn for nothing in all frames.
# Without it: in those that were picked for pictures, and elsewhere what a promise forbids.
SUPERFLUOUS_ROWS = "superfluous_rows"

# What `visref report` writes, into a folder of the user's choice.
REPORT_PAGE, REPORT_JUNIT, REPORT_SUMMARY = "report.html", "junit.xml", "summary.md"
# Beside the page, what would make it too large.
REPORT_SCENE = "scene3d.js"
REPORT = (REPORT_PAGE, REPORT_JUNIT, REPORT_SUMMARY, REPORT_SCENE)

# The view of a frame that has one camera without a name.
UNNAMED_VIEW = ""

# The wall time of a culler's call for a frame; its other phases are parts of it.
CULL_PHASE = "cull"
# A row in timings.parquet that says of a frame that it was the culler's first in its process: what
# compiles when it is first used, and what is allocated then, is in that call's time.
FIRST_PHASE = "first_call"
# Of a row in timings.parquet that belongs to no culler: the time of casting the frame's truth.
TRUTH_PHASE = "truth"

# File systems take names of 255 bytes; frame, kind and ending come on top.
SLUG_LENGTH = 80


class ObjectKind(StrEnum):
    """What a row of objects.parquet tells of an object or unit."""

    CONFIRMED = "confirmed"
    TIE = "tie"
    WITHIN_RASTER = "within_raster_tolerance"
    SMALL = "small"
    LATE = "late"
    WAIVED = "waived"
    UNDECIDED = "undecided"
    SUPERFLUOUS = "superfluous"


# What a miss is put down to, each miss once: missed + partly_missed is their sum.
MISS_KINDS = (
    ObjectKind.CONFIRMED, ObjectKind.TIE, ObjectKind.WITHIN_RASTER, ObjectKind.SMALL,
    ObjectKind.LATE, ObjectKind.WAIVED,
)  # fmt: skip

# Why a unit was drawn for nothing: the values of `visref.run_folder.causes.Cause`, which a reader
# of records need not import.
CAUSES = frozenset(
    {"outside_view", "box_larger_than_object", "occluder_drawn_later", "query_skipped",
     "test_too_coarse", "box_hidden"}
)  # fmt: skip

# How the code of why something was missed looks (`visref.judging.causes`), and how many a witness
# may have.
CAUSE_CODE = re.compile("[a-z0-9/-]{1,40}")
MAX_CAUSES = 64

# The counts of `visref.judging.judge.Counts`, by frame in frames.parquet and summed over frames in
# verdict.json.
COUNTS = (
    "visible", "missed", "partly_missed", "confirmed", "ties", "within_raster_tolerance", "small",
    "late", "waived", "violations", "undecided", "missed_pixels", "owned_samples",
    "undecided_samples", "drawn", "superfluous", "superfluous_confirmed", "missed_units",
)  # fmt: skip
# What version 1 does not say, and what is read in its place. It had no policy and no misses in
# part, so of those there are none; it did not look for what was lost in part, nor count samples,
# lost units and confirmed superfluous ones, so of those nothing is known.
SINCE_VERSION_2 = {
    "view": UNNAMED_VIEW,
    "partly": False,
    **dict.fromkeys(("small", "late", "waived"), 0),
    **dict.fromkeys(
        ("partly_missed", "owned_samples", "undecided_samples", "superfluous_confirmed",
         "missed_units"),
        None,
    ),
}  # fmt: skip
# The counters of `visref.culler.QueryStats`; null where a culler does not count.
COUNTERS = (
    "queries", "queries_passed", "batches", "tests_skipped", "query_fragments",
    "query_fragments_passed", "lookups", "depth_tests", "triangles_drawn", "units_drawn",
    "draw_calls", "state_changes", "bytes_read_back", "iterations", "triangles_estimated",
)  # fmt: skip

FRAMES_SCHEMA = pa.schema(
    [
        ("culler", pa.string()),
        ("frame", pa.int64()),
        ("view", pa.string()),
        *((name, pa.int64()) for name in (*COUNTS, *COUNTERS)),
        ("corrections", pa.int64()),
        ("image_pixels_differ", pa.int64()),
        ("owned", pa.int64()),
    ]
)
TIMINGS_SCHEMA = pa.schema(
    [
        ("culler", pa.string()),
        ("frame", pa.int64()),
        ("view", pa.string()),
        ("phase", pa.string()),
        ("ms", pa.float64()),
    ]
)
OBJECTS_SCHEMA = pa.schema(
    [
        ("culler", pa.string()),
        ("frame", pa.int32()),
        ("view", pa.string()),
        ("object", pa.int32()),
        ("name", pa.string()),
        ("kind", pa.string()),
        ("pixels", pa.int64()),
        ("owned", pa.int64()),
        ("x", pa.int32()),
        ("y", pa.int32()),
        ("triangle", pa.int32()),
        ("depth", pa.float64()),
        ("margin_px", pa.float64()),
        ("margin_depth", pa.float64()),
        ("partly", pa.bool_()),
        ("age", pa.int64()),
        ("unit", pa.int32()),
        ("cause", pa.string()),
        ("samples", pa.int64()),
        ("occluder", pa.int32()),
        ("occluder_name", pa.string()),
    ]
)
# `settled`: whether samples were looked at. `drawn`: a bit for each unit, compressed. Of units
# finer than objects, `seen`: a bit for each that owns a sample; and for each object in `objects`,
# so many (`counts`) of the `units` by which it is missed. The last three hold int64, little-endian.
PART_SCHEMA = pa.schema(
    [
        ("culler", pa.string()),
        ("frame", pa.int32()),
        ("view", pa.string()),
        ("settled", pa.bool_()),
        ("drawn", pa.binary()),
        ("seen", pa.binary()),
        ("objects", pa.binary()),
        ("counts", pa.binary()),
        ("units", pa.binary()),
    ]
)
PART_UNITS_SCHEMA = pa.schema(
    [
        ("culler", pa.string()),
        ("offsets", pa.list_(pa.int64())),
        ("triangles", pa.list_(pa.int32())),
    ]
)
# Columns of few different texts, each of which a reader of the table keeps once.
OBJECTS_REPEATED = ("culler", "view", "kind", "name", "occluder_name")

# How far `margin_px` is told: `visref.exact.REACH_PX`, which a reader of records need not import.
MAX_MARGIN_PX = 16.0
# What a witness says of its surroundings (`visref.run_folder.surroundings`): at most so many
# samples in each direction, enough to tell a fence by and few enough for a line of some kilobytes;
# and of the closer sight, so many pixels around the witness's, each so many cells wide.
SURROUNDED_CELLS = 48
CLOSE_PX = 3
CLOSE_CELLS = 8
CLOSE_SIDE = (2 * CLOSE_PX + 1) * CLOSE_CELLS
MAX_APPEARANCES = 256
# From the darkest to the brightest.
SHADES = 16
# The object of an appearance that stands for several.
OTHERS = -1

# Wide enough for half a laptop's screen; wider costs a page that carries dozens of pictures.
PAGE_WIDTH_PX = 960


def page_shape(width: int, height: int) -> tuple[int, int]:
    """(height, width) of the pictures of a frame of that many samples: the frame's own, or as
    wide as a page takes."""
    if width <= PAGE_WIDTH_PX:
        return height, width
    return max(1, round(height * PAGE_WIDTH_PX / width)), PAGE_WIDTH_PX


def slug(spec: str) -> str:
    """A culler's spec as part of a file name: itself where it may be, else a likeness of it
    with a digest, so that two specs never share a name."""
    likeness = re.sub(r"[^A-Za-z0-9._-]+", "_", spec)[:SLUG_LENGTH]
    if likeness == spec:
        return spec
    return f"{likeness}-{hashlib.sha256(spec.encode()).hexdigest()[:8]}"


def explained_name(spec: str, frame: int, view: str, obj: int) -> str:
    """The name in witnesses/ of the picture that `visref explain` draws."""
    of_view = f"-{slug(view)}" if view else ""
    return f"{slug(spec)}-{frame:05d}{of_view}-{obj}.png"


def _wrote(manifest: Any) -> Sequence[str] | None:
    """Of a run folder's manifest, patterns of all files that visref writes there."""
    if not isinstance(manifest, dict) or manifest.get("format") != FORMAT:
        return None
    try:
        slugs = [re.escape(culler["slug"]) for culler in manifest["cullers"].values()]
        drawn = [file for picture in manifest["pictures"] for file in picture["files"].values()]
        pictures = [re.escape(file) for file in drawn if file.startswith(f"{PICTURES}/")]
    except (AttributeError, KeyError, TypeError):
        return None
    of_a_part = (PART, PART_CELLS, PART_UNITS)
    files = (MANIFEST, VERDICT, FRAMES, TIMINGS, OBJECTS, TRUTH, *of_a_part, *REPORT)
    # With, for each culler, what `explained_name` gives.
    witnesses = [rf"{WITNESSES}/{slug}(\.jsonl|-\d{{5,}}(-[\w.~-]+)?-\d+\.png)" for slug in slugs]
    return [*map(re.escape, files), *witnesses, *pictures]


RUN_FOLDER = FolderKind(MANIFEST, _wrote)
