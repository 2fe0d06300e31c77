"""Coherent hierarchical culling: queries of a hierarchy's nodes, by what was seen last."""

from visref_culling.chc.method import CHC, CHCPlusPlus

__all__ = ["CHC", "CHCPlusPlus"]
