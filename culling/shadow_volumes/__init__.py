"""Shadow volumes, culled and clamped by N-buffers over the lit part of what is seen."""

from visref_culling.shadow_volumes.volumes import ShadowFrame, ShadowVolumes

__all__ = ["ShadowFrame", "ShadowVolumes"]
