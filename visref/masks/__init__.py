"""Alpha masks: what a MASK triangle's texture says where a ray meets it, in three values."""
