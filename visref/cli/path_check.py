"""visref path --check: what each frame of a path sees, or, without a scene, where it looks."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from typing import Any

from visref.camera_path import CameraPath
from visref.cli.arguments import add_memory_argument, memory_of
from visref.cli.terminal import ERRORS, OUT
from visref.formats import load_path
from visref.inputs import open_inputs
from visref.judging.limits import share
from visref.judging.status import Exit
from visref.paths.looking import Look, looks
from visref.scene import Scene
from visref.wording import counted

# How wide the columns are; names come last.
_SEEN = {
    "frame": 6, "view": 6, "visible": 7, "hits": 6, "behind": 6, "nearest": 9, "clear": 9, "eye": 0,
}  # fmt: skip
_PLACED = {"frame": 6, "view": 6, "yfov": 7, "eye": 30, "looks along": 0}


def add_check_arguments(parser: argparse.ArgumentParser) -> None:
    """Of the command itself, where no kind of path is made; `check` reads them."""
    parser.add_argument(
        "--check", metavar="PATH", help="say what each frame of this path sees (with --scene)"
    )
    parser.add_argument("--scene", metavar="SCENE")
    parser.add_argument("--json", action="store_true", help="for programs")
    parser.add_argument(
        "--rest-pose", action="store_true", help="what the scene animates stands as at rest"
    )
    add_memory_argument(parser)


def check(path: str, scene: str | None, given: argparse.Namespace) -> Exit:
    """Print a row for each view of each frame."""
    if scene is None:
        loaded = load_path(path, max_memory=memory_of(given))
        _remark(loaded.remarks, given.json)
        _say(_PLACED, _placed(loaded), given.json)
        return Exit.NO_VIOLATION
    inputs = open_inputs(
        scene,
        path=path,
        lenient=getattr(given, "lenient", False),
        rest_pose=given.rest_pose,
        max_memory=memory_of(given),
    )
    _remark([(note.code, note.message) for note in inputs.notes], given.json)
    seen: list[Look] = []

    def rows() -> Iterator[dict[str, Any]]:
        for look in looks(inputs):
            seen.append(look)
            yield _named(inputs.scene, look)

    _say(_SEEN, rows(), given.json)
    if not given.json:
        OUT.line(_summary(seen))
    return Exit.NO_VIOLATION


def _remark(found: Sequence[tuple[str, str]], as_json: bool) -> None:
    """What was noticed about the input, before the table; standard error's where that is JSON."""
    for code, text in found:
        (ERRORS if as_json else OUT).line(f"{code}: {text}")


def _say(columns: Mapping[str, int], rows: Iterator[dict[str, Any]], as_json: bool) -> None:
    if as_json:
        OUT.json_rows(rows)
        return
    left = [name in ("view", "eye", "looks along") for name in columns]
    texts = ([_text(row, name) for name in columns] for row in rows)
    OUT.columns(chain([list(columns)], texts), list(columns.values()), left=left)


def _placed(path: CameraPath) -> Iterator[dict[str, Any]]:
    for number, frame in zip(path.numbers, path.frames, strict=True):
        for camera in frame.cameras:
            # No zero is negative.
            yield {
                "frame": number,
                "view": camera.view,
                "yfov": camera.yfov,
                "eye": (camera.eye + 0.0).tolist(),
                "looks along": (camera.forward + 0.0).tolist(),
            }


def _named(scene: Scene, look: Look) -> dict[str, Any]:
    return {
        "frame": look.frame,
        "view": look.view,
        "visible": look.visible,
        "samples": look.samples,
        "hits": look.hits,
        "from_behind": look.from_behind,
        "nearest": _finite(look.nearest),
        "clearance": _finite(look.clearance),
        "inside": [scene.names[index] for index in look.inside],
        "through": None if look.through is None else scene.names[look.through],
    }


def _finite(value: float) -> float | None:
    return None if math.isinf(value) else value


def _text(row: Mapping[str, Any], name: str) -> str:
    """A cell of the table."""
    match name:
        case "hits":
            return share(row["hits"], row["samples"])
        case "behind":
            return share(row["from_behind"], row["hits"]) if row["hits"] else "-"
        case "nearest" | "clear":
            value = row["nearest" if name == "nearest" else "clearance"]
            return "-" if value is None else f"{value:.4g}"
        case "yfov":
            return "-" if row["yfov"] is None else f"{math.degrees(row['yfov']):.5g}"
        case "looks along":
            return " ".join(f"{value:.4g}" for value in row[name])
        case "eye" if "eye" in row:
            return " ".join(f"{value:.6g}" for value in row["eye"])
        case "eye":
            inside = [f"in {', '.join(row['inside'])}"] if row["inside"] else []
            through = [f"came through {row['through']}"] if row["through"] is not None else []
            return "; ".join([*inside, *through]) or "free"
        case _:
            return str(row[name])


def _summary(seen: list[Look]) -> str:
    said = [
        f"{sum(not look.hits for look in seen)} met nothing",
        f"{sum(bool(look.inside) for look in seen)} inside an object",
        f"{sum(look.through is not None for look in seen)} came through one",
    ]
    return f"{counted(len(seen), 'view')}: {', '.join(said)}"
