"""What the edges' functions say of a mask at one sample; engines ask of a block at once."""

from __future__ import annotations

from visref.compiled import njit
from visref.masks.by_edges import extent_of, state_by_places, touched_by_edges
from visref.masks.lookup import UNSURE


@njit(inline="always")
def state_by_edges(m, face, sides):  # type: ignore[no-untyped-def]
    """SOLID, HOLE or BETWEEN of a triangle (`facing`) at a sample that it covers, by the values of
    its edge functions; `UNSURE` where these do not tell."""
    if not face[1]:
        return UNSURE
    return state_by_places(m, face[0], touched_by_edges(face, extent_of(m, face[0]), sides))
