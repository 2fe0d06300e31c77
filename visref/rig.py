"""What a reader keeps of a scene so that its objects can be posed anew: meshes, places, motion.

`visref.timeline` poses; who reads a file hands over a `Rig` with its `Scene`, and a `Motion` where
the file animates objects.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Moment:
    """How a file poses its objects at one time, those alone that it may move.

    `objects`: (k,) int64 ids, ascending; `worlds`: (k, 4, 4) float64, world_from_object of each.
    `positions`: by object id, (v, 3) float64, its mesh as it is deformed, in the object's space (a
    skinned one's is the world, and its matrix the identity). `hidden`: (n,) bool, objects that the
    file switches off.
    """

    objects: Int64
    worlds: Float64
    positions: Mapping[int, Float64] = field(default_factory=dict)
    hidden: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, np.bool_))


class Motion(Protocol):
    """How a file animates its objects. `clips`: the animations' names, in the file's order.
    `digest`: of everything that it poses by. `skinned`: (n,) bool, objects whose vertices their
    joints place."""

    @property
    def clips(self) -> Sequence[str]: ...
    @property
    def digest(self) -> str: ...
    @property
    def skinned(self) -> NDArray[np.bool_]: ...

    def affected(self, clip: int) -> NDArray[np.bool_]:
        """(n,) bool, the objects that a clip may move, deform, hide or show."""
        ...

    def at(self, clip: int, time_s: float) -> Moment:
        """The pose of the affected objects at a time in seconds; before a clip's first key and
        after its last, those hold."""
        ...


@dataclass(frozen=True, eq=False)
class Rig:
    """`positions`: each mesh's vertices in its own space, (v, 3) float32 or float64 each;
    `mesh_of_object`: (n,) int64, -1 for none; `worlds`: (n, 4, 4) float64, world_from_object in the
    rest pose; `vertex_starts`: (n + 1,) int64, object i's vertices are `vertex_starts[i]:
    vertex_starts[i + 1]` of all before `kept`, (v,) bool, left out what is not finite (None: all
    are kept). `triangles`: (t, 3) int32, the scene's own where something is absent at rest, whose
    triangles there are collapsed; None where the scene's are whole. `hidden`: (n,) bool, objects
    that the file switches off at rest, None for none; the coarser levels of `Scene.groups` are
    absent there too."""

    positions: Sequence[NDArray[Any]]
    mesh_of_object: Int64
    worlds: Float64
    vertex_starts: Int64
    kept: NDArray[np.bool_] | None = None
    motion: Motion | None = None
    triangles: NDArray[np.int32] | None = None
    hidden: NDArray[np.bool_] | None = None
