"""A run of many frames, cullers and violations, made from a small one: for what a page weighs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pyarrow as pa

from visref.run_folder.layout import OBJECTS_SCHEMA
from visref.run_folder.read import RunFolder
from visref.run_folder.rows import TimingRow

CAUSES = ("near-larger", "centre-depth", "old-pose")


def big_run(small: RunFolder, *, frames: int, cullers: int, objects: int) -> RunFolder:
    """Each of so many cullers loses each of so many objects, in one to seven frames. The `small`
    run has one culler that convicts; its manifest's samples are those of each frame."""
    (spec,) = small.cullers
    (samples, *_) = small.manifest.samples.values()
    names = [f"{spec}:way={number}" for number in range(cullers)]
    row, verdict = small.frames[0], small.verdict.cullers[spec]
    chosen = np.random.default_rng(1)
    tables, sums = [], {}
    for name in names:
        times = chosen.integers(1, 8, objects)
        obj = np.repeat(np.arange(objects, dtype=np.int32), times)
        count = len(obj)
        columns = {
            "culler": pa.array([name] * count),
            "frame": pa.array(chosen.integers(0, frames, count).astype(np.int32)),
            "view": pa.array([""] * count),
            "object": pa.array(obj),
            "name": pa.array(
                [f"building {one // 40}/floor {one % 40}/window {one}" for one in obj]
            ),
            "kind": pa.array(["confirmed"] * count),
            "pixels": pa.array(chosen.integers(1, 5000, count)),
            "owned": pa.array(np.full(count, 5000)),
            "x": pa.array(chosen.integers(0, 48, count).astype(np.int32)),
            "y": pa.array(chosen.integers(0, 32, count).astype(np.int32)),
            "triangle": pa.array(chosen.integers(0, 10**6, count).astype(np.int32)),
            "depth": pa.array(chosen.random(count) * 100.0),
            "margin_px": pa.array(chosen.random(count) * 16.0),
            "partly": pa.array(chosen.random(count) < 0.5),
            "age": pa.array(chosen.integers(0, 40, count)),
            "cause": pa.array([CAUSES[i] for i in chosen.integers(0, len(CAUSES), count)]),
        }
        tables.append(
            pa.table(
                [columns.get(f.name, pa.nulls(count, f.type)) for f in OBJECTS_SCHEMA],
                schema=OBJECTS_SCHEMA,
            )
        )
        sums[name] = replace(verdict, confirmed=count, violations=count, frames=frames)
    manifest = replace(
        small.manifest,
        cullers=dict.fromkeys(names, small.manifest.cullers[spec]),
        samples=dict.fromkeys(range(frames), samples),
        pictures=tuple(
            replace(one, culler=name) for one in small.manifest.pictures for name in names
        ),
    )
    return replace(
        small,
        manifest=manifest,
        verdict=replace(small.verdict, cullers=sums),
        frames=[
            replace(row, culler=name, frame=frame, missed=frame % 7, drawn=100 + frame % 31)
            for name in names
            for frame in range(frames)
        ],
        timings=[
            TimingRow(culler=name, frame=frame, phase="cull", ms=1.0 + (frame * 7 % 13) / 8)
            for name in names
            for frame in range(frames)
        ],
        objects=pa.concat_tables(tables),
    )
