"""Masked software occlusion culling (Hasselgren, Andersson, Akenine-Möller 2016)."""

from visref_culling.masked.method import MaskedOcclusion

__all__ = ["MaskedOcclusion"]
