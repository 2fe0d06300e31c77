"""The jobs that meet the kernels: each small, and the first ones hardly two the same.

A part is run in a process of its own. Several run at once: what two of them meet at the same time
both compile, so the kernels that take longest have parts of their own, which come first. The last
part judges as a user does, with misses, and meets what is left. Who adds a kernel that a command of
these meets has nothing to add here; one that takes seconds may have a part.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path

# Runs a command line in this process; returns its status.
Command = Callable[[Sequence[str]], int]
# What a part does, in a folder that is its own: returns 0, or a status other than a verdict's.
Work = Callable[[Path, Command], int]

CITY = "city:scale=0.02,frames=1"
AT_REST = "walk_through_a_city"
# A wall that comes near, through the near plane; in its frames every cast is in doubt somewhere.
NEAR = "object_crossing_the_near_plane"
MASKED = "through_the_holes_of_a_mask"
MOVING = "sliding_door"


def _in_turn(visref: Command, *lines: Sequence[str]) -> int:
    for line in lines:
        status = visref(line)
        if status not in (0, 1):
            return status
    return 0


def _written(folder: Path, name: str) -> list[str]:
    """A case of the conformance suite as files: the arguments that name it."""
    from visref.conformance.glb import glb_of
    from visref.conformance.suite import case

    scene, path = case(name)
    folder.mkdir(parents=True)
    scene_file, path_file = folder / "scene.glb", folder / "path.json"
    scene_file.write_bytes(glb_of(scene))
    path_file.write_text(json.dumps(path.to_json()), encoding="utf-8")
    return [str(scene_file), "--path", str(path_file)]


def _quiet(folder: Path, name: str) -> list[str]:
    """Where a run of cullers is written, and that no CI server hears of it."""
    return ["--out", str(folder / name), "--no-summary", "--no-annotate"]


def _rays(folder: Path, visref: Command) -> int:
    near = _written(folder / "near", NEAR)
    return _in_turn(visref, ["truth", *near, "--out", str(folder / "near.parquet")])


def _margins(folder: Path, visref: Command) -> int:
    """What the judge asks the exact engine of each miss."""
    import numpy as np

    from visref.conformance.suite import case
    from visref.culler import RasterTolerance
    from visref.exact import ExactScene, surviving, witness_margins

    scene, path = case(NEAR)
    exact = ExactScene(scene)
    camera = path.cameras[0]
    samples, objects = np.zeros(1, np.int64), np.zeros(1, np.int64)
    witness_margins(exact, camera, samples, objects)
    surviving(exact, camera, samples, objects, RasterTolerance(snap_px=0.5))
    return 0


def _exact(folder: Path, visref: Command) -> int:
    near = _written(folder / "near", NEAR)
    out = ["--out", str(folder / "exact.parquet")]
    return _in_turn(visref, ["truth", *near, "--engine", "exact", *out])


def _cullers(*names: str, at_rest: Sequence[str] = ()) -> Work:
    """Runs of these cullers; those `at_rest` are for scenes that stand still."""

    def work(folder: Path, visref: Command) -> int:
        named = [word for name in names for word in ("--culler", name)]
        for name in at_rest:
            # In the city objects are large enough to be divided.
            status = visref(["run", CITY, "--culler", name, *_quiet(folder, name)])
            if status not in (0, 1):
                return status
        standing = _written(folder / "standing", AT_REST)
        moving = _written(folder / "moving", MOVING)
        return _in_turn(
            visref,
            ["run", *standing, *named, *_quiet(folder, "stood")],
            ["run", *moving, *named, *_quiet(folder, "moved")],
        )

    return work


def _masks(folder: Path, visref: Command) -> int:
    masked = _written(folder / "masked", MASKED)
    geometric = ["--geometric", str(folder / "between.parquet")]
    return _in_turn(
        visref,
        ["truth", *masked, "--engine", "exact", "--out", str(folder / "exact.parquet")],
        ["run", *masked, "--culler", "none", "--culler", "n-buffer", *_quiet(folder, "drawn")],
        ["truth", *masked, *geometric, "--out", str(folder / "rays.parquet")],
    )


def _labels(folder: Path, visref: Command) -> int:
    near, masked = _written(folder / "near", NEAR), _written(folder / "masked", MASKED)
    files = ["--labels", str(folder / "labels.parquet"), "--coco", str(folder / "coco.json")]
    return _in_turn(
        visref,
        ["truth", *masked, *files, "--out", str(folder / "masked.parquet")],
        ["truth", *near, "--bop", str(folder / "bop"), "--out", str(folder / "near.parquet")],
    )


def _walking(folder: Path, visref: Command) -> int:
    line = ["path", "walk", CITY, "--frames", "4", "--out", str(folder / "path.json")]
    return _in_turn(visref, line)


def _judging(folder: Path, visref: Command) -> int:
    """A recording without anything in it, of a scene at rest and of one in motion."""
    from visref.conformance.suite import case

    lines: list[list[str]] = []
    for name in (NEAR, MOVING):
        inputs = _written(folder / name, name)
        visible = folder / f"{name}.jsonl"
        frames = len(case(name)[1].frames)
        rows = [{"frame": frame, "visible": []} for frame in range(frames)]
        visible.write_text("".join(f"{json.dumps(row)}\n" for row in rows), encoding="utf-8")
        recorded = ["--visible", str(visible)]
        lines.append(["check", *inputs, *recorded, *_quiet(folder, f"run-{name}")])
    return _in_turn(visref, *lines)


# In the order in which they are begun.
PARTS: dict[str, Work] = {
    "margins": _margins,
    "rays": _rays,
    "exact": _exact,
    "queries": _cullers("none", "frustum", "occlusion-query", "lazy-grid", "three-pass"),
    "maps": _cullers("n-buffer", "occupancy-map", at_rest=("plp", "cplp")),
    "masks": _masks,
    "labels": _labels,
    "walking": _walking,
    "judging": _judging,
}
