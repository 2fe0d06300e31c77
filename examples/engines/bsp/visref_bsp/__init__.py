"""Compiled maps of Quake III's family (IBSP, version 46) for visref."""
