"""The occupancy map on this machine: a lookup's and a query's cost, and what a map gains in whole
frames. `python -m benchmarks.occupancy_map SCENE [FRAMES]` measures the latter on another scene."""

from __future__ import annotations

import statistics
import sys
from collections.abc import Mapping
from typing import Any

from visref.camera_path import CameraPath, middles
from visref.inputs import open_inputs
from visref_experiments.occupancy_map import latency, lookup, query_in_triangles
from visref_experiments.occupancy_map_scenes import turns

TITLE = "Occupancy map (Staneker 2003): lookups and queries; `visref tables` has the rest"
SCENE, FRAMES, SIZE_PX = "formula_one", 12, (1000, 900)
GAINS = (("map", "single"), ("multiple", "map"), ("thread", "multiple"))


def run() -> list[dict[str, str]]:
    maps, queries, triangles = (
        measure(None, None) for measure in (lookup, latency, query_in_triangles)
    )
    rows = [
        (f"lookup of {tiles} x {tiles} tiles", f"{1e6 * ms:.1f} ns")
        for tiles, ms in zip(maps["tiles"], maps["lookup_ms"], strict=True)
    ]
    small = queries["sizes_px"][0]
    rows += [
        (f"query of {small} x {small} px, {way}", f"{1e3 * ms:.1f} µs each")
        for way, ms in queries["each_ms"].items()
    ]
    sizes = zip(
        *(queries[key] for key in ("sizes_px", "unculled_ms", "culled_ms", "lookup_ms", "bits_ms")),
        strict=True,
    )
    rows += [
        (f"query of {px} x {px} px, waited for",
         f"{1e3 * both:.0f} µs; back faces culled {1e3 * front:.0f} µs ({front / both:.2f}); a "
         f"lookup of the box {1e6 * whole:.0f} ns ({front / whole:,.0f} times), its bits alone "
         f"{1e6 * bits:.0f} ns ({front / bits:,.0f} times)")
        for px, both, front, whole, bits in sizes
    ]  # fmt: skip
    share = triangles["query_ms"] / triangles["triangle_ms"]
    rows.append(("a query, in triangles of 25 px", f"{share:.0f}"))
    rows += gains(SCENE, FRAMES)
    return [dict(zip(("measured", "here"), row, strict=True)) for row in rows]


def gains(scene: str, frames: int) -> list[tuple[str, str]]:
    """What each method gains over another, with methods in turns within each of the frames."""
    inputs = open_inputs(scene)
    cameras = inputs.path.resized(*SIZE_PX).cameras
    picked = CameraPath(tuple(cameras[k] for k in middles(len(cameras), frames)))
    methods = turns(inputs.scene, picked)["methods"]
    found = []
    for name, over in GAINS:
        by = [_gain(methods, name, over, measure) for measure in ("frame_ms", "processor_ms")]
        asked = [statistics.fmean(methods[one]["queries"]) for one in (over, name)]
        arranging = statistics.fmean(methods[name]["arrange_ms"])
        found.append(
            (f"{scene}: {name} over {over}",
             f"{by[0]:.3f} times as fast, {by[1]:.3f} by processor time; queries {asked[0]:.0f} to "
             f"{asked[1]:.0f}, arranging {arranging:.2f} ms")
        )  # fmt: skip
    return found


def _gain(methods: Mapping[str, Any], name: str, over: str, measure: str) -> float:
    return sum(methods[over][measure]) / sum(methods[name][measure])


if __name__ == "__main__":
    for words, here in gains(sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else FRAMES):
        print(f"{words}: {here}")
