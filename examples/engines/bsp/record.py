"""What a compiled map's PVS draws along a camera path, as a recording; and a path to judge it by.

    python record.py path MAP.bsp PATH.json [--frames N] [--size PIXELS]
    python record.py draw MAP.bsp PATH.json RECORDING.jsonl [--frustum]
    python record.py ways MAP.bsp RUN

`path` puts an eye where a player's is who stands at a place that the map names (a spawn point, an
item, a weapon), and looks all around from there: six views of 90 degrees. `draw` walks the map's
tree as the engine does (visref_bsp/pvs.py). `ways` goes from the eye to what a run folder of
`visref check` says is lost, and tells through what: by open leaves alone, so that the PVS is wrong,
through solid ones, where faces are missing that the PVS counts on, or through a brush by which the
map's author has shut the view.

`pip install examples/engines/bsp` teaches visref itself the format.
"""

from __future__ import annotations

import argparse
import json
import math
import re
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
from visref_bsp import pvs
from visref_bsp.lumps import Bsp, load
from visref_bsp.scene import name_of, ours, theirs

from visref.camera_path import CameraPath
from visref.errors import InputError
from visref.recordings import RecordingWriter

# The game puts a player 9 units above a place that the map names; its eye is 26 above that.
EYE_HEIGHT = 26.0
ABOVE_GROUND = 9.0
NEAR = 4.0
# Faces lie on planes of the tree, and a plane's float32 numbers put them this far off it.
ROUNDED = 0.25
# A brush of this shader is drawn by nobody, and shut for q3map2's vis.
ANTIPORTAL = b"antiportal"
STANDS = re.compile(r"info_player|item_|weapon_|ammo_|holdable_|team_CTF|misc_teleporter_dest")
# Of six views: where they look, and what is up there.
VIEWS = {
    "east": ((1, 0, 0), (0, 1, 0)),
    "north": ((0, 0, -1), (0, 1, 0)),
    "west": ((-1, 0, 0), (0, 1, 0)),
    "south": ((0, 0, 1), (0, 1, 0)),
    "up": ((0, 1, 0), (1, 0, 0)),
    "down": ((0, -1, 0), (1, 0, 0)),
}


def places(bsp: Bsp) -> list[np.ndarray]:
    """The eyes of players who stand at what the map names, in the map's axes, in its order."""
    found = []
    for block in re.findall(r"\{([^{}]*)\}", bsp.entities):
        fields = dict(re.findall(r'"([^"]*)"\s+"([^"]*)"', block))
        try:
            place = np.array([float(word) for word in fields.get("origin", "").split()])
        except ValueError:
            continue
        if STANDS.match(fields.get("classname", "")) and place.shape == (3,):
            eye = place + np.array([0.0, 0.0, ABOVE_GROUND + EYE_HEIGHT])
            if np.isfinite(eye).all() and bsp.leaves["cluster"][pvs.leaf_at(bsp, eye)] >= 0:
                found.append(eye)
    return found


def path_of(bsp: Bsp, frames: int, size: int) -> dict[str, Any]:
    """Frames at places spread evenly over those that the map names."""
    eyes = places(bsp)
    if not eyes:
        raise InputError("it names no place where a player could stand", fix="give another map")
    frames = min(frames, len(eyes))
    rows = []
    for number in range(frames):
        (eye,) = ours(eyes[number * len(eyes) // frames][None]).tolist()
        views = {
            name: {"eye": eye, "target": (np.add(eye, towards)).tolist(), "up": list(up)}
            for name, (towards, up) in VIEWS.items()
        }
        rows.append({"cut": True, "views": views})
    lens = {"width": size, "height": size, "near": NEAR, "far": None, "yfov": math.pi / 2}
    return {"format": "visref-path", "version": 1, **lens, "frames": rows}


def draw(bsp: Bsp, path: Path, recording: Path, *, with_frustum: bool) -> None:
    told = json.loads(path.read_text(encoding="utf-8"))
    shared = {k: v for k, v in told.items() if k not in ("format", "version", "frames")}
    with RecordingWriter(recording, **shared) as writer:
        for number, frame in enumerate(CameraPath.load(path).frames):
            cameras = {one.view: one for one in frame.cameras}
            names = {
                view: [name_of(face) for face in pvs.drawn(bsp, one, with_frustum=with_frustum)]
                for view, one in cameras.items()
            }
            same = len(names) == 1 or not with_frustum
            visible = next(iter(names.values())) if same else names
            writer.frame(number, visible=visible, **told["frames"][number])


def ways(bsp: Bsp, run: Path) -> list[str]:
    """A line for each witness of a loss, and one of sums."""
    lines, sums = [], Counter()
    for file in sorted((run / "witnesses").glob("*.jsonl")):
        for line in file.read_text(encoding="utf-8").splitlines():
            told = json.loads(line)
            kind, clusters = way_to(bsp, told)
            sums[kind] += 1
            lines.append(
                f"frame {told['frame']}, {told['object_name']} ({told['pixels']} samples): {kind};"
                f" clusters {' '.join(map(str, clusters))}"
            )
    return [*lines, *(f"{count} {kind}" for kind, count in sums.most_common())]


def way_to(bsp: Bsp, witness: dict[str, Any]) -> tuple[str, list[int]]:
    """What a ray goes through to what is lost, and the clusters on its way (-1: solid)."""
    samples = witness["samples"]
    e, f, r, u = (np.array([float.fromhex(x) for x in samples[name]]) for name in "eFRU")
    a = 2 * witness["x"] + 1 - samples["width"]
    b = samples["height"] - 2 * witness["y"] - 1
    ray = witness["depth"] * (f + a * r + b * u)
    length = float(np.linalg.norm(ray))
    pieces = pvs.way(bsp, theirs(e), theirs(e + ray))
    leaves = [
        leaf
        for first, last, leaf in pieces
        if (last - first) * length > ROUNDED and first * length < length - ROUNDED
    ]
    within = [int(bsp.leaves["cluster"][leaf]) for leaf in leaves]
    clusters = [one for one, before in zip(within, [None, *within], strict=False) if one != before]
    if min(clusters) < 0:
        return "through what is solid", clusters
    if any(ANTIPORTAL in name for leaf in leaves for name in brushes_in(bsp, leaf)):
        return "through an antiportal of the map's author", clusters
    if bsp.pvs is not None and not bsp.pvs[clusters[0], clusters[-1]]:
        return "through open clusters, the last not in the PVS of the first", clusters
    return "through open clusters, the last of which does not list it", clusters


def brushes_in(bsp: Bsp, leaf: int) -> list[bytes]:
    """The shaders of the brushes that reach into a leaf."""
    first, count = bsp.leaves["brush"][leaf], bsp.leaves["brushes"][leaf]
    named = bsp.brushes["shader"][bsp.leaf_brushes[first : first + count]]
    return [bytes(name) for name in bsp.shaders["name"][named]]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n\n")[0])
    kinds = parser.add_subparsers(dest="kind", required=True)
    one = kinds.add_parser("path")
    one.add_argument("map", type=Path)
    one.add_argument("path", type=Path)
    one.add_argument("--frames", type=int, default=24)
    one.add_argument("--size", type=int, default=96)
    one = kinds.add_parser("draw")
    one.add_argument("map", type=Path)
    one.add_argument("path", type=Path)
    one.add_argument("recording", type=Path)
    one.add_argument("--frustum", action="store_true", help="leave out what no view can see")
    one = kinds.add_parser("ways")
    one.add_argument("map", type=Path)
    one.add_argument("run", type=Path)
    options = parser.parse_args()
    try:
        bsp = load(options.map)
        if options.kind == "path":
            made = path_of(bsp, options.frames, options.size)
            options.path.write_text(json.dumps(made, indent=1), encoding="utf-8")
        elif options.kind == "draw":
            draw(bsp, options.path, options.recording, with_frustum=options.frustum)
        else:
            print("\n".join(ways(bsp, options.run)))
    except InputError as error:
        print(error.at(source=str(options.map)), file=sys.stderr)
        raise SystemExit(2) from None


if __name__ == "__main__":
    main()
