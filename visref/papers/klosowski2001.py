"""J. T. Klosowski, C. T. Silva: Efficient Conservative Visibility Culling Using the
Prioritized-Layered Projection Algorithm. TVCG 7(4), 2001. Section 4, Tables 2 and 3, Figs. 6 to 8.

Measured on `soda_hall` and `skyscraper`, laid out like the paper's models, which are not
available, and on `city`. Rounds, triangles and z-tests depend on the scene and compare in order
and trend; times belong to machines of 2001 and compare as ratios within one run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import mean
from typing import Any

LEAF_TRIANGLES = 5_000
LEAVES = 1_429
FRAMES = 500

# Budget: average rounds of queries a frame ("# EXT tests"), and triangles beyond the budget's.
TABLE_3 = {
    1_000: (4.688, 16_844),
    10_000: (3.376, 10_978),
    25_000: (2.426, 5_641),
    50_000: (1.908, 2_796),
    75_000: (1.630, 1_770),
    100_000: (1.372, 1_247),
}

# Microseconds to transfer and to scan an image of 64 x 64 and 512 x 512 pixels, by machine.
TABLE_2 = {
    "Octane": {64: (217, 30), 512: (4_483, 2_300)},
    "Onyx": {64: (564, 20), 512: (7_733, 1_000)},
    "Kayak": {64: (375, 47), 512: (11_250, 3_430)},
}
# The same with the histogram, in one number.
HISTOGRAM_US = {"Octane": {64: 800, 512: 34_000}, "Onyx": {64: 690, 512: 13_500}}

# Z-tests a pixel in the skyscraper: frustum and back-face culling, cPLP.
DEPTH_COMPLEXITY = (26.70, 7.97)

# Section 4: seconds a frame on the Octane; the HP baseline and cPLP-IB are the Kayak's.
SECONDS_OCTANE = {"item-buffer": 0.081, "histogram": 0.164, "frustum": 0.975}

# Section 1, a city of 500,000 triangles on a tenth of them: visible triangles found, on average,
# and wrong pixels at worst.
PLP_QUALITY = (0.90, 0.04)

Row = Mapping[str, Any]
Line = tuple[str, str, str]  # quantity, here, in the paper


@dataclass(frozen=True)
class Walk:
    """One culler's frames of a path: rows with the counters of `frames.parquet`."""

    rows: Sequence[Row]

    def average(self, counter: str) -> float:
        return mean(float(row[counter]) for row in self.rows)


def specs(query: str = "fragment-histogram") -> dict[int, tuple[str, str]]:
    """For each budget of Table 3 the cullers to run: cPLP, and PLP alone, whose triangles are
    those that the budget drew."""
    options = f"leaf={LEAF_TRIANGLES}"
    return {
        budget: (f"cplp:query={query},budget={budget},{options}", f"plp:budget={budget},{options}")
        for budget in TABLE_3
    }


def table_3(walks: Mapping[int, tuple[Walk, Walk]]) -> list[Line]:
    """Rounds and extra triangles by budget, from the walks of cPLP and of PLP alone."""
    lines = []
    for budget, (conservative, alone) in walks.items():
        rounds, extra = TABLE_3[budget]
        ours = conservative.average("triangles_drawn") - alone.average("triangles_drawn")
        lines += [
            (f"Table 3: tests, budget {budget:,}",
             f"{conservative.average('iterations'):.3f}", f"{rounds:.3f}"),
            (f"Table 3: extra triangles, budget {budget:,}", f"{ours:,.0f}", f"{extra:,}"),
        ]  # fmt: skip
    return lines


def depth_complexity(frustum: Walk, conservative: Walk, pixels: int) -> list[Line]:
    """Z-tests a pixel, from walks with `fragments=true`; `pixels` of an image."""
    before, after = DEPTH_COMPLEXITY
    everything = frustum.average("depth_tests") / pixels
    tests = conservative.average("depth_tests") / pixels
    asking = conservative.average("query_fragments") / pixels
    return [
        ("z-tests a pixel, frustum culling", f"{everything:.2f}", f"{before:.2f}"),
        ("z-tests a pixel, cPLP's drawing", f"{tests - asking:.2f}", f"{after:.2f}"),
        ("z-tests a pixel, cPLP's queries", f"{asking:.2f}", "not said"),
        ("drawing: factor saved", f"{everything / (tests - asking):.2f}", f"{before / after:.2f}"),
        ("drawing and queries: factor saved", f"{everything / tests:.2f}", "not said"),
    ]
