"""The baseline of single occlusion queries, asked in three ways, with one step broken."""

from __future__ import annotations

from tests.mutants.common import common
from tests.mutants.harness import Suite, not_here
from visref_culling.baselines import SingleQueryCulling

SUITE = Suite({})

QUERIES = (
    SUITE.method("occlusion-query", SingleQueryCulling),
    SUITE.method("occlusion-query-batch", SingleQueryCulling, query="batch", size=8),
    SUITE.method("occlusion-query-instanced", SingleQueryCulling, query="instanced", size=8),
)

common("G2 G9 G10 G12 G13 G14 G15 M1 M2 M3 M4 M5 M6", of=QUERIES)
not_here(
    "G1 G3 G4 G5 G6 G7",
    QUERIES,
    "the rasteriser projects and rounds the box and compares the depths: nothing is tested, "
    "and nothing read back, on the CPU",
)
not_here("G8", QUERIES, "an object's own depth is not there when its box is asked")
not_here("G11", QUERIES, "nothing is kept from one frame to the next")
