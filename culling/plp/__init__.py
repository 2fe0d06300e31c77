"""Prioritized-Layered Projection and its conservative extension (Klosowski, Silva 2001)."""

from culling.plp.cplp import ConservativePLPCulling
from culling.plp.plp import PLPCulling

__all__ = ["ConservativePLPCulling", "PLPCulling"]
