"""A culler whose answers hang on what was asked before: how often it was made."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from visref.culler import Culler, DrawnSet

# Names the file in which each one leaves a byte.
STATE = "UNSTEADY_CULLER_STATE"


class Unsteady(Culler):
    """Draws all, but the last object only the first time that it is made."""

    name = "unsteady"
    summary = "for tests"

    def prepare(self, scene):
        file = Path(os.environ[STATE])
        made = file.stat().st_size if file.exists() else 0
        file.write_bytes(b"x" * (made + 1))
        self.ids = np.arange(scene.object_count - (made > 0), dtype=np.int32)
        return super().prepare(scene)

    def cull(self, camera):
        return DrawnSet(self.ids)
