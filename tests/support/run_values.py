"""Run folders as values, from a few numbers: nothing is run, and nothing is on disk."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from visref.run_folder.layout import COUNTS, OBJECTS_SCHEMA
from visref.run_folder.read import RunFolder
from visref.run_folder.rows import (
    CullerFacts,
    CullerVerdict,
    FrameRow,
    Manifest,
    PathFacts,
    RunVerdict,
    SceneFacts,
    TimingRow,
)

NOTHING = dict.fromkeys((*COUNTS, "corrections"), 0)


def run_folder(
    frames: Mapping[str, Sequence[Mapping[str, Any]]],
    timings: Sequence[Mapping[str, Any]] = (),
    *,
    source: str = "scene",
    objects: int = 1,
    triangles: int = 1,
    units: int = 1,
    size: tuple[int, int] = (100, 50),
) -> RunFolder:
    """A run folder's content from columns of frames.parquet by culler; counts not given are 0."""
    last = max((row["frame"] for rows in frames.values() for row in rows), default=0)
    definition = {"width": size[0], "height": size[1]}
    verdict = CullerVerdict(
        **dict.fromkeys(COUNTS, 0),
        status="measured",
        promise="approximate",
        frames=0,
        unit_kind="object",
        ages={},
        causes=(),
        worst=None,
    )
    return RunFolder(
        Path(source),
        Manifest(
            2,
            SceneFacts(source, "", objects, triangles),
            PathFacts(source, "", last + 1, range(last + 1)),
            "embree",
            False,
            {},
            {name: CullerFacts("approximate", "object", units, name) for name in frames},
            (),
            {frame: {"": definition} for frame in range(last + 1)},
            {},
            {},
        ),
        RunVerdict(2, "measured", 0, dict.fromkeys(frames, verdict), ()),
        [
            FrameRow(**{**NOTHING, "culler": name, **row})
            for name, rows in frames.items()
            for row in rows
        ],
        [TimingRow(**row) for row in timings],
        OBJECTS_SCHEMA.empty_table(),
    )
