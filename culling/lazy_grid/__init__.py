"""The lazy occlusion grid of Hey, Tobler, Purgathofer 2001."""

from visref_culling.lazy_grid.method import LazyGridCulling

__all__ = ["LazyGridCulling"]
