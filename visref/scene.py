"""What is looked at: triangles grouped into objects, and the units a culler decides about.

A scene holds only what visibility needs: float32 vertices relative to one origin, triangles in the
order of their objects, and per triangle whether it is one-sided, alpha-masked or blended.
Reading files is `visref.formats`' work.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from visref.errors import InputError
from visref.findings import Code
from visref.frozen import Shared, frozen
from visref.masks.store import Masks
from visref.placing import core_of, somewhere

if TYPE_CHECKING:
    from visref.rig import Rig

Int32 = NDArray[np.int32]
Int64 = NDArray[np.int64]
Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]


class Alpha(IntEnum):
    """How a triangle's material treats its alpha; the values stand in `Scene.alpha`."""

    OPAQUE = 0
    MASK = 1
    BLEND = 2


@dataclass(frozen=True)
class Group:
    """Objects that a file names together (the instances of one node, say): a name, the path from
    the root, and the object ids, ascending. `levels`: of a thing with levels of detail, the ids of
    each level, the finest first; one of the levels is there, and the others are absent."""

    name: str
    path: str
    objects: tuple[int, ...]
    levels: tuple[tuple[int, ...], ...] = ()


@dataclass(frozen=True, eq=False)
class Scene(Shared):
    """Objects made of triangles.

    `vertices`: (v, 3) float32, world space less `origin`, every one finite.
    `triangles`: (t, 3) int32 vertex ids, grouped by object; counter-clockwise seen from the
    front (a mirroring transform has already flipped the winding).
    `object_offsets`: (n + 1,) int64; object i has triangles
    `object_offsets[i]:object_offsets[i + 1]`, possibly none.
    `names`: n unique names.
    `one_sided`: (t,) bool, True where a triangle seen from behind covers nothing.
    `alpha`: (t,) uint8, an `Alpha` each.
    `origin`: (3,) float64, zero unless the scene lies far out. A vertex is the exact number
    origin + vertex, and a camera's pose is taken relative to it (`Camera.relative_to`).
    `moved`: (v,) float32, how far rounding to float32 moved each vertex, in world units, rounded
    up; None where every vertex is what the file says.
    `given_names`: n names as the file has them, which may repeat. `paths`: n paths from the root
    of the scene graph, such as `house/kitchen/chair`, which may repeat too. Both are `names`
    where a reader gives none. `groups`: what several objects are called together.
    `nodes`: (n,) int32, each object's node in its glTF file, None where the file has none.
    `notes`: what the reader of a file left out or decided, as (code, message) pairs.
    `masks`: the alpha masks, a row for each triangle, or None. A MASK triangle without one,
    because its `masks.row` is -1 or there are no `masks`, may be solid or a hole anywhere.
    `absent`: (n,) bool, objects that are not there at this moment (switched off, unloaded, another
    level of detail), None if all are. Each corner of their triangles is the same vertex, so that
    whatever looks at triangles finds nothing there. `moving`: (n,) bool, objects that are posed
    anew from moment to moment of a `Timeline`: they may move, appear and vanish, and no others do;
    None if none does. `rig`: what is needed to pose them, None once that is done. `motion`: digest
    of how its file moves it, empty where that does not.

    Raises InputError where a value breaks these rules. All arrays, computed ones too, are read-only
    and cannot be made writable (`visref.frozen`).
    """

    vertices: Float32
    triangles: Int32
    object_offsets: Int64
    names: tuple[str, ...]
    one_sided: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, np.bool_))
    alpha: NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))
    source: str = "scene"
    notes: tuple[tuple[Code, str], ...] = ()
    masks: Masks | None = None
    origin: Float64 = field(default_factory=lambda: np.zeros(3))
    moved: Float32 | None = None
    given_names: tuple[str, ...] = ()
    paths: tuple[str, ...] = ()
    groups: tuple[Group, ...] = ()
    absent: NDArray[np.bool_] | None = None
    moving: NDArray[np.bool_] | None = None
    rig: Rig | None = field(default=None, repr=False)
    motion: str = ""
    nodes: Int32 | None = None

    def __post_init__(self) -> None:
        count = len(self.triangles)
        put = object.__setattr__
        put(self, "vertices", np.ascontiguousarray(self.vertices, np.float32).reshape(-1, 3))
        put(self, "triangles", np.ascontiguousarray(self.triangles, np.int32).reshape(-1, 3))
        put(self, "object_offsets", np.ascontiguousarray(self.object_offsets, np.int64))
        put(self, "origin", np.array(self.origin, np.float64).reshape(3))
        if count and not len(self.one_sided):
            put(self, "one_sided", np.zeros(count, np.bool_))
        if count and not len(self.alpha):
            put(self, "alpha", np.zeros(count, np.uint8))
        put(self, "given_names", tuple(self.given_names) or tuple(self.names))
        put(self, "paths", tuple(self.paths) or tuple(self.names))
        self._check()
        if self.absent is not None and self.absent.any():
            put(self, "triangles", _collapsed(self.triangles, self.absent[self.object_of_triangle]))
        for name in ("vertices", "triangles", "object_offsets", "one_sided", "alpha", "origin"):
            put(self, name, frozen(getattr(self, name)))
        for name in ("moved", "absent", "moving", "nodes"):
            if getattr(self, name) is not None:
                put(self, name, frozen(getattr(self, name)))

    def owner_name(self, triangle: int) -> str:
        """The name of the object that a triangle belongs to."""
        return self.names[int(self.object_of_triangle[triangle])]

    def _check(self) -> None:
        offsets: Int64 = self.object_offsets
        count = len(self.triangles)
        if len(offsets) != len(self.names) + 1 or offsets[0] != 0 or offsets[-1] != count:
            raise InputError("object_offsets do not span the triangles", source=self.source)
        if np.any(np.diff(offsets) < 0):
            raise InputError("object_offsets decrease", source=self.source)
        if len(self.one_sided) != count or len(self.alpha) != count:
            raise InputError("one_sided or alpha is not one a triangle", source=self.source)
        if not len(self.given_names) == len(self.paths) == len(self.names):
            raise InputError("given_names or paths is not one per object", source=self.source)
        if self.masks is not None and len(self.masks.row) != count:
            raise InputError(
                f"masks have {len(self.masks.row)} rows for {count} triangles",
                source=self.source,
                fix="take the masks of the triangles that are left (Masks.take)",
            )
        if len(set(self.names)) != len(self.names):
            raise InputError("object names repeat", source=self.source, fix="use unique_names")
        try:
            check_indices(
                self.triangles,
                len(self.vertices),
                lambda bad: f"object '{self.names[self._object_at(bad)]}', triangle {bad}",
            )
        except InputError as error:
            raise error.at(source=self.source) from error
        if not np.isfinite(self.origin).all():
            raise InputError("the scene's origin is not finite", source=self.source)
        for name in ("absent", "moving", "nodes"):
            value = getattr(self, name)
            if value is not None and value.shape != (len(self.names),):
                raise InputError(f"{name} is not one per object", source=self.source)
        if self.moved is not None and self.moved.shape != (len(self.vertices),):
            raise InputError("moved has not one number per vertex", source=self.source)
        if not np.isfinite(self.vertices).all():
            finite: NDArray[np.bool_] = np.all(np.isfinite(self.vertices), axis=1)
            bad_triangles = ~np.all(finite[self.triangles], axis=1)
            if bad_triangles.any():
                bad = int(np.argmax(bad_triangles))
                place = f"object '{self.names[self._object_at(bad)]}'"
            else:
                place = f"vertex {int(np.argmin(finite))}, which no triangle uses"
            raise InputError(
                "a vertex is NaN or infinite",
                source=self.source,
                place=place,
                fix="mend the mesh, or drop such triangles with --lenient",
            )

    def _object_at(self, triangle: int) -> int:
        return int(np.searchsorted(self.object_offsets, triangle, side="right")) - 1

    @classmethod
    def from_objects(
        cls,
        objects: Sequence[tuple[str, NDArray[Any], NDArray[Any]]],
        *,
        source: str = "arrays",
    ) -> Scene:
        """A scene from (name, vertices (v, 3), triangles (t, 3)) of each object.

        Vertices are rounded to float32. Repeated names get `#2`, `#3`, …
        """
        vertices, triangles, offsets, base = [], [], [0], 0
        for name, points, faces in objects:
            with np.errstate(over="ignore"):  # an infinity is refused below, with its object
                points = np.asarray(points, np.float32).reshape(-1, 3)
            faces = np.asarray(faces, np.int64).reshape(-1, 3)
            try:
                check_indices(faces, len(points), lambda bad: f"triangle {bad}")
            except InputError as error:
                raise error.at(place=f"object '{name}'", source=source) from error
            vertices.append(points)
            triangles.append((faces + base).astype(np.int32))
            base += len(points)
            offsets.append(offsets[-1] + len(faces))
        return cls(
            vertices=np.concatenate([*vertices, np.zeros((0, 3), np.float32)]),
            triangles=np.concatenate([*triangles, np.zeros((0, 3), np.int32)]),
            object_offsets=np.array(offsets, np.int64),
            names=unique_names([name for name, _, _ in objects]),
            source=source,
            given_names=tuple(clean_name(name) for name, _, _ in objects),
            paths=tuple(clean_name(name) for name, _, _ in objects),
        )

    @property
    def object_count(self) -> int:
        return len(self.names)

    @property
    def triangle_count(self) -> int:
        return len(self.triangles)

    @cached_property
    def object_of_triangle(self) -> Int32:
        """(t,) int32, the object id of each triangle."""
        ids = np.arange(self.object_count, dtype=np.int32)
        return frozen(np.repeat(ids, np.diff(self.object_offsets)))

    @cached_property
    def id_of_name(self) -> Mapping[str, int]:
        return MappingProxyType({name: index for index, name in enumerate(self.names)})

    @cached_property
    def present(self) -> NDArray[np.bool_]:
        """(t,) bool, the triangles whose object is there."""
        if self.absent is None:
            return frozen(np.ones(self.triangle_count, np.bool_))
        return frozen(~self.absent[self.object_of_triangle])

    @cached_property
    def most_moved(self) -> float:
        """How far rounding to float32 moved any vertex at most, in world units."""
        return 0.0 if self.moved is None else float(self.moved.max(initial=0.0))

    @cached_property
    def has_blend(self) -> bool:
        return bool((self.alpha == Alpha.BLEND).any())

    @cached_property
    def has_mask(self) -> bool:
        return bool((self.alpha == Alpha.MASK).any())

    @cached_property
    def has_one_sided(self) -> bool:
        return bool(self.one_sided.any())

    @cached_property
    def object_bounds(self) -> Float64:
        """(n, 2, 3) float64, each object's least and greatest corner (exact: they are float32
        values); an object without triangles, or that is absent, has (+inf, -inf)."""
        return frozen(self.bounds_of(self.object_units()))

    def bounds_of(self, units: Units) -> Float64:
        """(u, 2, 3) float64, each unit's least and greatest corner, (+inf, -inf) if nothing of it
        is there."""
        from visref import kernels

        result = np.empty((units.count, 2, 3))
        kernels.unit_bounds(self.vertices, self.triangles, units.offsets, units.triangles, result)
        return result

    @cached_property
    def bounds(self) -> Float64:
        """(2, 3) float64, the box of all triangles; zeros where none is there."""
        boxes = somewhere(self.object_bounds)
        if not len(boxes):
            return frozen(np.zeros((2, 3)))
        return frozen(np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)]))

    @cached_property
    def core_bounds(self) -> Float64:
        """(2, 3) float64, the box of the objects that belong together.

        For placing cameras and choosing an origin: one stray object far away must not set the
        scale. Left out is an object that reaches more than ten times as far from the median
        centre, along any axis, as nine of ten objects do.
        """
        return frozen(core_of(somewhere(self.object_bounds)))

    def object_units(self) -> Units:
        """The default units: an object each."""
        return self._object_units.handed_out()

    @cached_property
    def _object_units(self) -> Units:
        every = frozen(np.arange(self.triangle_count, dtype=np.int32))
        return Units(self.object_offsets, every)

    @cached_property
    def digest(self) -> str:
        """SHA-256 (hexadecimal) of everything that a verdict depends on."""
        state = hashlib.sha256(b"visref-scene-1")
        for array in (
            self.vertices,
            self.triangles,
            self.object_offsets,
            self.one_sided,
            self.alpha,
        ):
            state.update(str(array.shape).encode())
            state.update(np.ascontiguousarray(array).view(np.uint8).data)
        state.update("\0".join(self.names).encode())
        if self.origin.any():
            state.update(self.origin.tobytes())
        if self.masks is not None:
            state.update(b"\0masks" + self.masks.digest)
        if self.motion:
            state.update(b"\0motion" + self.motion.encode())
        return state.hexdigest()


OTHERS_MOVE = "this was made of a scene in which other objects move"


def same_moving(scene: Scene, other: Scene) -> bool:
    """Whether the same objects are posed anew from moment to moment of both, and some are: whether
    one can be the other at another moment."""
    if scene.moving is None or other.moving is None:
        return False
    return scene.moving is other.moving or np.array_equal(scene.moving, other.moving)


# The kind of units that are the scene's objects.
OBJECT = "object"


@dataclass(frozen=True, eq=False)
class Units(Shared):
    """What a culler decides about: lists of triangles that may overlap.

    `offsets`: (u + 1,) int64, `triangles`: int32 triangle ids; unit i has
    `triangles[offsets[i]:offsets[i + 1]]`. `kind` names them in reports ("object", "octree
    cell", "box").
    """

    offsets: Int64
    triangles: Int32
    kind: str = OBJECT

    @property
    def count(self) -> int:
        return len(self.offsets) - 1

    @cached_property
    def sizes(self) -> Int64:
        """(u,) int64, triangles in each unit."""
        return frozen(np.diff(self.offsets))

    def owned(self) -> Units:
        """The same units in arrays of their own that cannot be made writable, whoever holds these.
        Raises TypeError where these are no one-dimensional arrays of numbers."""
        if not isinstance(self.offsets, np.ndarray) or not isinstance(self.triangles, np.ndarray):
            raise TypeError("the units' offsets and triangles are not both arrays")
        if self.offsets.ndim != 1 or self.triangles.ndim != 1:
            raise TypeError("the units' offsets and triangles are not both of one dimension")
        return Units(frozen(self.offsets), frozen(self.triangles), self.kind)

    def are_objects(self, scene: Scene) -> bool:
        """Whether unit i is object i of `scene`, triangle for triangle."""
        objects = scene.object_units()
        return np.array_equal(self.offsets, objects.offsets) and np.array_equal(
            self.triangles, objects.triangles
        )

    def mask(self, unit_ids: Int32, triangle_count: int) -> NDArray[np.bool_]:
        """(triangle_count,) bool, True for every triangle of the given units."""
        result, chosen = np.zeros(triangle_count, np.bool_), np.zeros(self.count, np.bool_)
        chosen[unit_ids] = True
        result[self.triangles[np.repeat(chosen, self.sizes)]] = True
        return result

    def gather(self, unit_ids: Int32) -> Int32:
        """(k,) int32, the triangles of the given units, (m,) int32 ids, one unit after another."""
        unit_ids = np.asarray(unit_ids)
        sizes = self.sizes[unit_ids]
        ends = np.cumsum(sizes)
        total = int(ends[-1]) if len(ends) else 0
        shift = np.repeat(self.offsets[unit_ids] - (ends - sizes), sizes)
        result: Int32 = self.triangles[np.arange(total) + shift]
        return result

    def take(self, unit_ids: Int32) -> Units:
        """Some of the units, (m,) int32 ids."""
        ends = np.cumsum(self.sizes[unit_ids], dtype=np.int64)
        return Units(np.append(np.int64(0), ends), self.gather(unit_ids), self.kind)

    def check(self, scene: Scene, *, source: str) -> None:
        """Raise InputError unless these are valid units of `scene`."""
        offsets, triangles = self.offsets, self.triangles
        if not all(
            isinstance(array, np.ndarray)
            and array.ndim == 1
            and np.issubdtype(array.dtype, np.integer)
            for array in (offsets, triangles)
        ):
            raise InputError("the units are not arrays of integers", source=source)
        spans = len(offsets) >= 1 and offsets[0] == 0 and offsets[-1] == len(triangles)
        if not spans or (np.diff(offsets) < 0).any():
            raise InputError("the units' offsets do not span their triangles", source=source)
        if len(triangles) and not 0 <= triangles.min() <= triangles.max() < scene.triangle_count:
            raise InputError("a unit names a triangle that the scene lacks", source=source)
        if not isinstance(self.kind, str) or not self.kind.isprintable():
            raise InputError("the units' kind is no printable text", source=source)


def _collapsed(triangles: Int32, gone: NDArray[np.bool_]) -> Int32:
    """(t, 3) triangles, those `gone`, (t,) bool, with their first vertex three times."""
    result = triangles.copy()
    result[gone] = triangles[gone, :1]
    return result


def check_indices(indices: NDArray[Any], vertex_count: int, place: Callable[[int], str]) -> None:
    """Raise InputError where a vertex id, in integers of any shape such as (t, 3), is none of
    the vertices; `place` says where it stands, by its number in that array along the first axis."""
    if not indices.size or 0 <= indices.min() <= indices.max() < vertex_count:
        return
    outside = ((indices < 0) | (indices >= vertex_count)).reshape(len(indices), -1)
    bad = int(np.argmax(outside.any(axis=1)))
    vertex = indices.reshape(len(indices), -1)[bad][outside[bad]][0]
    raise InputError(
        f"it names vertex {vertex} of {vertex_count}: index out of range",
        place=place(bad),
        fix="mend the index buffer",
    )


def clean_name(name: str) -> str:
    """A name as every file can hold it: a zero, and half of a character that takes two ("\\ud800"
    in JSON), become U+FFFD."""
    if name.isascii() and "\0" not in name:
        return name
    whole = name.encode("utf-16-le", "surrogatepass").decode("utf-16-le", "replace")
    return whole.replace("\0", "\ufffd")


def unique_names(names: Sequence[str]) -> tuple[str, ...]:
    """The names, made clean (`clean_name`), with repeats marked `#2`, `#3`, … in order, skipping
    marks already taken."""
    names = [clean_name(name) for name in names]
    taken = set(names)
    if len(taken) == len(names):
        return tuple(names)
    # What marked names are made of ends in front of their last "#": no two names make the same.
    next_mark: dict[str, int] = {}
    result = []
    for name in names:
        mark = next_mark.get(name, 1)
        if mark == 1:
            result.append(name)
        else:
            while (unique := f"{name}#{mark}") in taken:
                mark += 1
            result.append(unique)
        next_mark[name] = mark + 1
    return tuple(result)
