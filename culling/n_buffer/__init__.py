"""N-buffers: the farthest or nearest depth in any rectangle, by a constant number of lookups."""
