"""N-buffers (Décoret 2005): the farthest or nearest depth in any rectangle, by a constant number
of lookups; and occlusion culling with them."""

from visref_culling.n_buffer.method import NBufferCulling

__all__ = ["NBufferCulling"]
