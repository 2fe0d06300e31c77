"""Three passes: low-resolution stand-ins fill the depth, are queried, and pick what is drawn."""

from visref_culling.three_pass.method import ThreePassCulling

__all__ = ["ThreePassCulling"]
