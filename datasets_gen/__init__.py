"""Generated scenes with camera paths: seeded, and deterministic to the byte."""

from visref_datasets_gen.dataset import Dataset, scene_of

__all__ = ["Dataset", "scene_of"]
