"""The plain facts about a miss, as its witness's line tells them: where it lies, through how wide a
gap it is seen and whose that is, how far it was."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from visref.camera import Camera
from visref.judging.judge import Miss
from visref.judging.outcome import CullerRecord
from visref.run_folder.cuts import Cut
from visref.scene import OBJECT, Int32, Int64, Scene
from visref.visibility import hit_depths
from visref.wording import counted, legible

# The facts that are told of what was kept around a miss, and null where nothing was.
OF_SURROUNDINGS = ("depth_min", "depth_max", "gap_px", "in_front")


def miss_facts(
    scene: Scene, camera: Camera, record: CullerRecord, miss: Miss, cut: Cut | None
) -> dict[str, Any]:
    """Null stands for what is not known.

    `edge_px`: the witness's distance to the image's nearest edge. `eye_to_box`: the eye's straight
    distance to the object's box, 0 within it, beside `near`. `age`: for how many frames it was in
    view. `box_holds_it`: whether the box that the culler says it tested held the object. From what
    was kept around the miss: `depth_min` and `depth_max` of the samples lost, `gap_px`, the side of
    the greatest square of lost samples, in pixels; and `in_front`, of the objects beside and before
    what was lost, the one that borders it most.
    """
    x, y = miss.sample % camera.width, miss.sample // camera.width
    low, high = scene.object_bounds[miss.object]
    away = np.linalg.norm(camera.eye - np.clip(camera.eye, low, high))
    facts: dict[str, Any] = {
        "edge_px": min(x, y, camera.width - 1 - x, camera.height - 1 - y),
        "eye_to_box": float(away) if math.isfinite(away) else None,
        "near": camera.near,
        "age": miss.age,
        "box_too_small": box_too_small(record, miss.object),
        **dict.fromkeys(OF_SURROUNDINGS),
    }
    if cut is not None and cut.lost.any():
        facts |= _around(scene, camera, miss, cut)
    return facts


def box_too_small(record: CullerRecord, obj: int) -> bool:
    """Whether a box that the culler says it tested did not hold the object, in some frame; of
    units that are no objects, no."""
    return record.unit_kind == OBJECT and any(one.unit == obj for one in record.too_small)


def causes_json(record: CullerRecord, frame: int, view: str, obj: int) -> list[dict[str, Any]]:
    """Why an object was missed, as a witness's line says it."""
    return [
        {"cause": one.cause, "text": one.text, "score": round(one.score, 3)}
        for one in record.causes.of(frame, view, obj)
    ]


def facts_text(facts: Mapping[str, Any]) -> str:
    """The facts of a witness's line in words; empty where there are none."""
    if not facts:
        return ""
    parts = []
    edge = facts["edge_px"]
    parts.append(f"{edge} px from the image's edge" if edge else "at the image's edge")
    if (away := facts["eye_to_box"]) is not None:
        box = "the eye is in its box" if away == 0.0 else f"its box is {away:.4g} from the eye"
        parts.append(f"{box} (near {facts['near']:.4g})")
    if facts["box_too_small"]:
        parts.append("the box that was tested does not hold it")
    if (age := facts["age"]) is not None:
        parts.append(f"{counted(age, 'frame')} after it came into view" if age else "new in view")
    low, high = facts["depth_min"], facts["depth_max"]
    if low is not None and high is not None:
        depths = f"{low:.6g}" if f"{low:.6g}" == f"{high:.6g}" else f"{low:.6g} to {high:.6g}"
        parts.append(f"lost at depth {depths}")
    if facts["gap_px"]:
        parts.append(f"through a gap {facts['gap_px']} px wide")
    if facts["in_front"] is not None:
        parts.append(f"bordered by {legible(facts['in_front']['name'])}, in front of it")
    return "; ".join(parts)


def _around(scene: Scene, camera: Camera, miss: Miss, cut: Cut) -> dict[str, Any]:
    height, width = cut.triangle.shape
    columns, rows = cut.x + cut.step * np.arange(width), cut.y + cut.step * np.arange(height)
    sample = rows[:, None] * camera.width + columns
    lost = cut.lost
    triangle = np.where(lost & (cut.glass >= 0) & _other(scene, cut, miss), cut.glass, cut.triangle)
    depth = np.full(lost.shape, np.inf)
    hit = triangle >= 0
    depth[hit] = hit_depths(scene, camera, sample[hit].astype(np.int64), triangle[hit])
    mine = depth[lost & np.isfinite(depth)]
    return {
        "depth_min": float(mine.min()) if len(mine) else None,
        "depth_max": float(mine.max()) if len(mine) else None,
        "gap_px": greatest_square(lost) * cut.step,
        "in_front": _in_front(scene, lost, depth, triangle, miss),
    }


def _other(scene: Scene, cut: Cut, miss: Miss) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Where the opaque owner is not the object that was missed."""
    owner = scene.object_of_triangle[np.maximum(cut.triangle, 0)]
    return np.asarray((cut.triangle < 0) | (owner != miss.object))


def greatest_square(flags: np.ndarray[Any, np.dtype[np.bool_]]) -> int:
    """The side of the greatest square of cells that are all set, of (h, w) bool."""
    side, alike = 0, flags
    while alike.any():
        side += 1
        # A square of the next side is four of this one.
        alike = alike[:-1, :-1] & alike[1:, :-1] & alike[:-1, 1:] & alike[1:, 1:]
    return side


def _in_front(
    scene: Scene,
    lost: np.ndarray[Any, np.dtype[np.bool_]],
    depth: np.ndarray[Any, np.dtype[np.float64]],
    triangle: Int32,
    miss: Miss,
) -> dict[str, Any] | None:
    """The object that most cells beside a lost one belong to, and before it."""
    beside: list[Int64] = []
    for axis in (0, 1):
        for step in (1, -1):
            here = lost & ~_edge(lost.shape, axis, step)
            there = np.roll(here, step, axis=axis)
            nearer = np.roll(depth, step, axis=axis)[there] > depth[there]
            cells = triangle[there][nearer & (triangle[there] >= 0)]
            owner = scene.object_of_triangle[cells]
            beside.append(owner[owner != miss.object].astype(np.int64))
    owners = np.concatenate(beside)
    if not len(owners):
        return None
    first = int(np.bincount(owners).argmax())
    return {"object": first, "name": scene.names[first]}


def _edge(shape: tuple[int, ...], axis: int, step: int) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """The cells that a step along an axis would carry out of the image."""
    result = np.zeros(shape, np.bool_)
    last = [slice(None), slice(None)]
    last[axis] = slice(-1, None) if step > 0 else slice(0, 1)
    result[tuple(last)] = True
    return result
