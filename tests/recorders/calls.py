"""What is recorded, as a list of calls that every recorder has, and what must come of it.

A call is a name and its arguments. Matrices are 16 numbers row by row, behind the order in which
the recorder gets them; a view is None or a name.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

Call = tuple[Any, ...]
FORMS = ("world_from_camera", "camera_from_world", "clip_from_world")
NUMBERS = (
    1e-308,
    5e-324,
    0.1,
    -0.0,
    0.0,
    1e22,
    1.7976931348623157e308,
    1 / 3,
    -2.5,
    1e16,
    123456789.0,
)
NAMES = (
    "lamp",
    'the "lamp"',
    "a\\b/c",
    "tab\tline\nnull-ish\x01",
    "käse 猫",
    "😀",
    "",
    "__proto__",
    "7",
)
EYE = tuple(float(i % 5 == 0) for i in range(16))


def stored(matrix: Sequence[float], order: str) -> list[float]:
    """A row-major matrix as it lies in memory."""
    return [
        float(x)
        for x in np.reshape(matrix, (4, 4), order="C" if order == "row_major" else "F").flat
    ]


def awkward_calls(seed: int, frames: int) -> list[Call]:
    """A recording with every call in it, in any order, of awkward names and numbers."""
    rng = np.random.default_rng(seed)

    def number() -> float:
        bits = rng.integers(0, 1 << 64, dtype=np.uint64)
        drawn = float(bits.view(np.float64))
        return drawn if rng.random() < 0.5 and math.isfinite(drawn) else float(rng.choice(NUMBERS))

    def name() -> str:
        return NAMES[rng.integers(len(NAMES))]

    def names(most: int) -> list[str]:
        return list(dict.fromkeys(name() for _ in range(rng.integers(most + 1))))

    def matrix() -> list[float]:
        return [number() for _ in range(16)]

    def order() -> str:
        return str(rng.choice(["row_major", "column_major"]))

    calls: list[Call] = [("field", "near", 0.1, None), ("field", "far", math.inf, None)]
    calls += [("field", "yfov", number(), None), ("text", "units", name())]
    calls += [("group", one, names(3)) for one in names(4)]
    frame = 0
    for _ in range(frames):
        frame += int(rng.integers(1, 4))
        views = [None] if rng.random() < 0.6 else [v for v in names(4) if v] or [None]
        some: list[Call] = [
            ("camera", FORMS[rng.integers(3)], order(), matrix(), view) for view in views
        ]
        if rng.random() < 0.5:
            some.append(("field", "shift_x_px", number(), views[0]))
        joint = views == [None] or rng.random() < 0.5
        nodes = rng.random() < 0.3
        for view in [None] if joint else views:
            if rng.random() < 0.2:
                continue
            most = (10, 1 << 31)[rng.integers(2)]
            ids = [int(one) for one in rng.integers(0, most, rng.integers(4))]
            some.append(("visible_nodes" if nodes else "visible_ids", ids, view))
            if not nodes:
                some.append(("visible_names", names(3), view))
        some += [("absent", one) for one in names(2)]
        some += [("pose", one, order(), matrix()) for one in names(2)]
        some += [("level", one, int(rng.integers(5))) for one in names(2)]
        some += [("bounds", one, matrix()[:3], matrix()[:3]) for one in names(2)]
        some += [("stat", one, int(rng.integers(1 << 40))) for one in ("queries", "draw_calls")]
        some += [("stat_ms", "cull", number())] if rng.random() < 0.5 else []
        some += [("time", number()), ("cut",)] if rng.random() < 0.5 else []
        calls += [("begin_frame", frame), *(some[i] for i in rng.permutation(len(some)))]
        calls.append(("end_frame",))
    return calls


def expected_lines(calls: Sequence[Call], width: int, height: int) -> list[dict[str, Any]]:
    """The lines of the recording, by the format's definition."""
    line: dict[str, Any] = {
        "format": "visref-recording",
        "version": 1,
        "width": width,
        "height": height,
    }
    lines = [line]
    sets: dict[str, dict[str | None, list[Any]]] = {}
    views: list[str] = []

    def of(view: str | None) -> dict[str, Any]:
        if view is None:
            return line
        if view not in views:
            views.append(view)
        return line.setdefault("views", {}).setdefault(view, {})

    for name, *arguments in calls:
        match name, arguments:
            case "begin_frame", [number]:
                line, sets, views = {"frame": number}, {}, []
                lines.append(line)
            case "time", [seconds]:
                line["time_s"] = seconds
            case "cut", []:
                line["cut"] = True
            case "camera", [form, _, matrix, view]:
                of(view)[form] = np.reshape(matrix, (4, 4)).tolist()
            case "field", [field, value, view]:
                of(view)[field] = None if value == math.inf else value
            case "text", [field, text]:
                line[field] = text
            case "group", [group, objects]:
                line.setdefault("groups", {})[group] = objects
            case "visible_ids" | "visible_names", [drawn, view]:
                # A call that names nothing is one all the same, but for names, which come singly.
                if drawn or name == "visible_ids":
                    of(view)
                    sets.setdefault("visible", {}).setdefault(view, []).extend(drawn)
            case "visible_nodes", [nodes, view]:
                of(view)
                sets.setdefault("visible_nodes", {}).setdefault(view, []).extend(nodes)
            case "absent", [one]:
                line.setdefault("absent", []).append(one)
            case "pose", [one, _, matrix]:
                line.setdefault("world_from_object", {})[one] = np.reshape(matrix, (4, 4)).tolist()
            case "level", [group, level]:
                line.setdefault("levels", {})[group] = level
            case "bounds", [one, least, greatest]:
                line.setdefault("bounds", {})[one] = [least, greatest]
            case "stat", [stat, count]:
                line.setdefault("stats", {})[stat] = count
            case "stat_ms", [phase, ms]:
                line.setdefault("stats", {}).setdefault("ms", {})[phase] = ms
            case "end_frame", []:
                key = "visible_nodes" if "visible_nodes" in sets else "visible"
                given = sets.get(key, {})
                joint = not given or None in given
                line[key] = given.get(None, []) if joint else {v: given.get(v, []) for v in views}
            case "flush", []:
                pass
            case _:
                raise AssertionError(name)
    return lines


def exactly(value: Any) -> Any:
    """A JSON value in which equal means the same number, by its bits; order of members too where it
    says something: that of views."""
    if isinstance(value, dict):
        members = {name: exactly(one) for name, one in value.items()}
        return {**members, "order of views": list(value["views"])} if "views" in value else members
    if isinstance(value, list):
        return [exactly(one) for one in value]
    return (
        float(value).hex()
        if isinstance(value, int | float) and not isinstance(value, bool)
        else value
    )


def strict_lines(text: bytes) -> list[dict[str, Any]]:
    """The lines of a recording, as a strict reader of JSON takes them: UTF-8, no key twice, no NaN,
    and a line's end behind each."""

    def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        members = dict(pairs)
        assert len(members) == len(pairs), f"a key comes twice: {[name for name, _ in pairs]}"
        return members

    def refuse(constant: str) -> Any:
        raise AssertionError(constant)

    assert text.endswith(b"\n")
    lines = text.decode("utf-8").removesuffix("\n").split("\n")
    return [json.loads(line, object_pairs_hook=once, parse_constant=refuse) for line in lines]
