"""Prioritized-Layered Projection and its conservative extension (Klosowski, Silva 2001)."""

from visref_culling.plp.cplp import ConservativePLPCulling
from visref_culling.plp.plp import PLPCulling

__all__ = ["ConservativePLPCulling", "PLPCulling"]
