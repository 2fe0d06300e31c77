"""Deliberately wrong cullers, one broken rule each, as public bug reports tell of them.

Each starts from a right culler (`RIGHT`), which passes every check of `visref.conformance`, and
breaks one rule. All are plain NumPy and judge objects' boxes, or clusters of triangles, so that no
GL is needed. `WRONG` lists them: a test takes the class from there, and the command line takes
`--culler tests.wrong_cullers.frustum:CornersOnly` (the class's module and name).

    frustum    the view itself: corners, lens, field of view, near and far, where the eye is
    depth      what is compared with what: which depth, which rectangle, which resolution
    materials  what hides and from which side: glass, masks, back faces, winding
    memory     what is kept from the frame before
    moving     what is not brought up to date where things move, come and go; one view for another
    units      what is drawn of what was found visible, and under which number
    exact      what promises to draw nothing hidden, and does

`registry.py` has the decorators.
"""

from __future__ import annotations

from tests.wrong_cullers import depth, exact, frustum, materials, memory, moving, units
from tests.wrong_cullers.registry import RIGHT, WRONG, Wrong

__all__ = [
    "RIGHT",
    "WRONG",
    "Wrong",
    "depth",
    "exact",
    "frustum",
    "materials",
    "memory",
    "moving",
    "units",
]
