"""The ways to run N-buffer culling that mutants are made of, and the common mutants of each.

Décoret 2005: a level holds the farthest depth of each square of its side, and four squares, or
one, hold a box's rectangle.
"""

from __future__ import annotations

from tests.mutants.common import common
from tests.mutants.harness import equivalent, not_here
from tests.mutants.n_buffer.contract import SUITE
from visref_culling.n_buffer import NBufferCulling

FOUR = SUITE.method("n-buffer-four", NBufferCulling)
ONE = SUITE.method("n-buffer-one", NBufferCulling, squares=1)
TREE = SUITE.method("n-buffer-tree", NBufferCulling, hierarchy=True)
GPU = SUITE.method("n-buffer-gpu", NBufferCulling, where="gpu")
GPU_ONE = SUITE.method("n-buffer-gpu-one", NBufferCulling, where="gpu", squares=1)
QUERY = SUITE.method("n-buffer-query", NBufferCulling, test="query")

CPU = (FOUR, ONE, TREE)
GPUS = (GPU, GPU_ONE)
LOOKUPS = (*CPU, *GPUS)
ALL = (*LOOKUPS, QUERY)

PIERCED = "revealed_by_a_pierced_wall"
LEANING = "revealed_leaning_panels"
ACROSS = "revealed_across_the_near_plane"

SUITE.kept_by(*LOOKUPS)

common("G10", of=ALL, caught_by="walk_through_a_city")
common("G13", of=ALL, caught_by="revealed_behind_glass")
common("G15 M1 M2 M3 M4 M5 M6", of=ALL)
common("G2 G14", of=(QUERY,))
common("G9", of=(QUERY,), caught_by=PIERCED)
common("G12", of=(QUERY,), caught_by="crowd")

not_here("G1 G3 G4 G5 G6 G7 G8", (QUERY,), "the rasteriser projects, rounds and compares the box")
not_here("U1 U2 U3 U4 U5 U6 U7 U8 U9 U11 W12 W13", (QUERY,), "nothing is looked up")
not_here("U10 G11", (QUERY,), "the depth is the target's, cleared and drawn in this frame")
not_here("G2", LOOKUPS, "no box is rasterised, so no face of one is culled")
not_here("G9", LOOKUPS, "no samples are counted")
not_here("G12", LOOKUPS, "the depth that is looked up is the one of a single-sampled target")
not_here("G14", LOOKUPS, "nothing is asked that could be unfinished")
not_here("U4", (ONE, GPU_ONE), "there is no second square")
equivalent(
    "G3",
    LOOKUPS,
    "in whole pixels, sides rounded to nearest hold exactly the pixels whose centres lie in the "
    "unrounded rectangle, and the box is inflated by more than a centre can be off",
)
equivalent(
    "U9",
    (FOUR, TREE, GPU),
    "four squares of half the side never need the top level, for any rectangle in the image",
)
