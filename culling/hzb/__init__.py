"""Hierarchical z: boxes looked up in a pyramid of depth, on the GPU, in two passes or by the last
frame alone."""

from visref_culling.hzb.method import LastFrameHZB, TwoPassHZB

__all__ = ["LastFrameHZB", "TwoPassHZB"]
