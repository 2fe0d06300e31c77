"""Occupancy maps (Staneker, Bartz, Meissner 2003): which queries to skip, and which to ask
together, by a bit for each tile of the screen."""

from visref_culling.occupancy_map.method import OccupancyMapCulling

__all__ = ["OccupancyMapCulling"]
