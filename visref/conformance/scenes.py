"""The scenes of `visref.conformance`: small, seeded, each built around one way to go wrong.

In each (but the empty ones) something is visible, and in most something is hidden, so that no
check passes for lack of a question. A module of the catalogue is named after what its scenes are
built around; `building` has what they are made of, which is public here too.
"""

from __future__ import annotations

from visref.conformance.building import (
    Case,
    Mesh,
    Point,
    SceneMaker,
    box,
    camera,
    case,
    panel,
    pixel_panel,
    pixel_point,
    register_in,
    rolled,
    together,
)
from visref.conformance.cameras import CAMERAS
from visref.conformance.clusters import CLUSTERS
from visref.conformance.layers import LAYERS
from visref.conformance.materials import MATERIALS
from visref.conformance.moving import MOVING
from visref.conformance.occlusion import OCCLUSION
from visref.conformance.revealed import REVEALED
from visref.conformance.shapes import SHAPES
from visref.conformance.views import VIEWS

SCENES: list[SceneMaker] = [
    *CAMERAS,
    *OCCLUSION,
    *MATERIALS,
    *SHAPES,
    *LAYERS,
    *CLUSTERS,
    *REVEALED,
    *VIEWS,
    *MOVING,
]

__all__ = [
    "SCENES",
    "Case",
    "Mesh",
    "Point",
    "SceneMaker",
    "box",
    "camera",
    "case",
    "panel",
    "pixel_panel",
    "pixel_point",
    "register_in",
    "rolled",
    "together",
]
