"""Exact visibility: the sample rule decided by proven bounds, and by integers where they fail."""

from visref.exact.depth_buffer import resolves
from visref.exact.margins import REACH_PX, surviving, witness_margins
from visref.exact.scene import ExactScene, Owners, compare_depths

__all__ = [
    "REACH_PX",
    "ExactScene",
    "Owners",
    "compare_depths",
    "resolves",
    "surviving",
    "witness_margins",
]
