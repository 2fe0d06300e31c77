"""H. Hey, R. F. Tobler, W. Purgathofer: Real-Time Occlusion Culling With A Lazy Occlusion Grid.

TR-186-2-01-02, Vienna University of Technology, January 2001. Section 7 and Figs. 7 to 9.

Measured on `forest` and `city_large`, which have the paper's numbers of triangles; its models
and walkthroughs are not available. So triangles and queries compare in ratio and order alone,
and times, which belong to a GeForce2 and a 900 MHz Thunderbird, as ratios within one run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import mean
from typing import Any

SCENE_TRIANGLES = {"forest": 1_694_426, "city_large": 34_034_176}
CELL_PX = 32
TRIANGLES_A_BOX = 1500

# By scene and image width (640 by 480, 1280 by 960).
TRIANGLES_DRAWN = {  # Fig. 7: lazy and busy, no occlusion culling
    ("forest", 640): (7_009, 147_969),
    ("forest", 1280): (7_510, 147_969),
    ("city_large", 640): (11_981, 1_964_918),
    ("city_large", 1280): (11_775, 1_964_918),
}
PIXEL_QUERIES = {  # Fig. 8: lazy, busy
    ("forest", 640): (498, 2_394),
    ("forest", 1280): (650, 6_781),
    ("city_large", 640): (565, 1_332),
    ("city_large", 1280): (937, 4_227),
}
FRAME_RATE_GAIN = (1.9, 5.8)  # Fig. 9 and section 7: lazy over none, the least and the most
READBACK_SHARE = (0.38, 0.52)  # of the frame's time, lazy

Row = Mapping[str, Any]
Line = tuple[str, str, str]  # quantity, here, in the paper


@dataclass(frozen=True)
class Walk:
    """One culler's frames of a walkthrough: rows with the counters `triangles_drawn`, `queries`
    and the phases `frame_ms`, `query_ms` (as `frames.parquet` and `timings.parquet` have them,
    joined by `walks`)."""

    rows: Sequence[Row]

    def average(self, counter: str) -> float:
        return mean(float(row[counter]) for row in self.rows)


def specs(scene: str) -> dict[str, str]:
    """The cullers to run: "lazy", "busy" and "none", as the paper set them up."""
    boxes = "" if scene == "forest" else f",boxes=triangles,leaf={TRIANGLES_A_BOX}"
    return {
        update: f"lazy-grid:update={update},cell={CELL_PX}{boxes}"
        for update in ("lazy", "busy", "none")
    }


def walks(frames: Sequence[Row], timings: Sequence[Row]) -> dict[str, Walk]:
    """Each culler's walk, from the rows of a run folder's two tables. A walk's first frame is
    left out: it compiles and warms."""
    times: dict[tuple[str, int], dict[str, float]] = {}
    for row in timings:
        phases = times.setdefault((row["culler"], row["frame"]), {})
        phases[f"{row['phase']}_ms"] = row["ms"]
    joined: dict[str, list[Row]] = {}
    for row in sorted(frames, key=lambda row: row["frame"]):
        phases = {"frame_ms": 0.0, "query_ms": 0.0}
        phases |= times.get((row["culler"], row["frame"]), {})
        joined.setdefault(row["culler"], []).append({**row, **phases})
    return {culler: Walk(rows[1:] or rows) for culler, rows in joined.items()}


def figures(scene: str, width: int, lazy: Walk, busy: Walk, none: Walk) -> list[Line]:
    """Figs. 7, 8 and 9 for one scene and resolution, the published numbers beside ours."""
    paper_drawn, paper_none = TRIANGLES_DRAWN[scene, width]
    paper_lazy, paper_busy = PIXEL_QUERIES[scene, width]
    drawn, drawn_busy = lazy.average("triangles_drawn"), busy.average("triangles_drawn")
    everything = none.average("triangles_drawn")
    asked, asked_busy = lazy.average("queries"), busy.average("queries")
    frame = {name: walk.average("frame_ms") for name, walk in _named(lazy, busy, none)}
    low, high = FRAME_RATE_GAIN
    least, most = READBACK_SHARE
    return [
        ("Fig 7: triangles a frame, lazy", f"{drawn:,.0f}", f"{paper_drawn:,}"),
        ("Fig 7: the same, busy", f"{drawn_busy:,.0f}", f"{paper_drawn:,}"),
        ("Fig 7: the same, no occlusion culling", f"{everything:,.0f}", f"{paper_none:,}"),
        ("Fig 7: lazy over none", _percent(drawn / everything), _percent(paper_drawn / paper_none)),
        ("Fig 8: pixel-level queries a frame, lazy", f"{asked:,.0f}", f"{paper_lazy:,}"),
        ("Fig 8: the same, busy", f"{asked_busy:,.0f}", f"{paper_busy:,}"),
        ("Fig 8: busy over lazy", f"{asked_busy / asked:.2f}", f"{paper_busy / paper_lazy:.2f}"),
        *((f"Fig 9: ms a frame, {name}", f"{frame[name]:.0f}", "") for name in frame),
        ("Fig 9: frame rate, lazy over none", f"{frame['none'] / frame['lazy']:.1f}",
         f"{low} to {high}"),
        ("Section 7: queries' share of the time, lazy",
         _percent(lazy.average("query_ms") / frame["lazy"]), f"{least:.0%} to {most:.0%}"),
    ]  # fmt: skip


def _named(lazy: Walk, busy: Walk, none: Walk) -> list[tuple[str, Walk]]:
    return [("lazy", lazy), ("busy", busy), ("none", none)]


def _percent(share: float) -> str:
    return f"{100.0 * share:.2f} %"
