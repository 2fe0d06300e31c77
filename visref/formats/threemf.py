"""3MF: objects, components nested in each other, and the build's items. Lengths stay in the file's
unit.

Why not through trimesh: measured with trimesh 5.2, of components that name a component twice, 28
deep, it gives 844 objects of 2^28 and says nothing; it renames bodies as one program writes them;
and a component of an object that there is not is only logged.

Source: 3MF Consortium, "3D Manufacturing Format, Core Specification 1.3" and "Production Extension
1.1" (objects in other parts of the file). Colours and materials are not read: all is opaque.
"""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Callable, Generator, Mapping
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from visref.errors import InputError
from visref.findings import Code
from visref.formats.in_a_child import read_in_a_child
from visref.formats.numbers import is_number, parsed
from visref.formats.placed import NO_MESH, Mesh, Placed, below, compose
from visref.memory import Budget
from visref.scene import Float64, Int64, check_indices

_RELATIONSHIPS = "_rels/.rels"
_MODEL_TYPE = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
_USUAL_PART = "3d/3dmodel.model"
_PRODUCTION = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"
# Extensions that add no geometry to that of the core: where objects lie, and their materials.
_KNOWN = {_PRODUCTION, "http://schemas.microsoft.com/3dmanufacturing/material/2015/02"}
_CHUNK = 1 << 16
# A vertex is three float64, a triangle three int64; each twice while parts are joined.
_ROW_BYTES = 48

Attributes = Mapping[str, str]
# A part of the archive, and an object's id in it.
_Key = tuple[str, str]


@dataclass(frozen=True)
class _Part:
    """An object placed in another, or in the build, with its `world_from_object` or so."""

    key: _Key
    transform: Float64
    name: str = ""


@dataclass
class _Object:
    """What `<object>` says: a mesh (`NO_MESH` for none), or components."""

    name: str
    mesh: int = NO_MESH
    components: list[_Part] = field(default_factory=list)


def read_3mf(path: Path, *, budget: Budget) -> Placed:
    """The objects of a 3MF file: every mesh, as often as the build holds it. Raises InputError
    where the file cannot be read, or names an object that there is not, or an object itself."""
    return read_in_a_child("visref.formats.threemf:parse_3mf", path, budget)


def parse_3mf(path: Path, budget: Budget) -> Placed:
    """`read_3mf`, in this process."""
    try:
        with zipfile.ZipFile(path) as archive:
            reader = _Reader(archive, budget)
            reader.read()
    except (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, EOFError) as error:
        if isinstance(error, RecursionError):
            raise
        raise InputError(
            f"not a readable zip archive: {str(error)[:200]}", fix="export the file anew"
        ) from error
    reader.place()
    return reader.placed


class _Reader:
    def __init__(self, archive: zipfile.ZipFile, budget: Budget) -> None:
        self.archive = archive
        self.budget = budget
        self.placed = Placed()
        self.objects: dict[_Key, _Object] = {}
        self.items: list[_Part] = []
        self._parts = {name.lstrip("/").lower(): name for name in archive.namelist()}
        # Parts still to be read, and all that ever were.
        self._waiting: list[str] = []
        self._known: set[str] = set()

    def read(self) -> None:
        """All objects of the model's part and of the parts that it names, and the build."""
        root = self._model_part()
        self._want(root)
        while self._waiting:
            part = self._waiting.pop()
            _PartReader(self, part, build=part == root).parse(self._chunks(part))

    def key(self, part: str, attributes: Attributes) -> _Key:
        """What a component or an item of a part names."""
        path = attributes.get(f"{_PRODUCTION} path")
        if path is not None:
            part = path.lstrip("/").lower()
            self._want(part)
        return part, attributes.get("objectid", "")

    def _want(self, part: str) -> None:
        if part not in self._known:
            self._known.add(part)
            self._waiting.append(part)

    def place(self) -> None:
        """Expand the build into objects."""
        below_it = self._instances()
        self.budget.claim(
            f"{sum(below_it[item.key] for item in self.items):,} objects",
            objects=sum(below_it[item.key] for item in self.items),
        )
        # Depth first and in order. What holds no mesh at all is not looked at: that could take
        # any time, for no object.
        waiting = [(item, np.eye(4), "") for item in reversed(self.items)]
        while waiting:
            part, above, path = waiting.pop()
            if not below_it[part.key]:
                continue
            found = self.objects[part.key]
            name = part.name or found.name
            world, path = compose(above, part.transform), below(path, name)
            if found.mesh != NO_MESH:
                self.placed.add(name, found.mesh, world, path=path)
            waiting.extend((component, world, path) for component in reversed(found.components))

    def _instances(self) -> dict[_Key, int]:
        """How many meshes each object places that the build holds. Raises InputError for an object
        that there is not, or that holds itself."""
        count: dict[_Key, int] = {}
        # An object is open from when it is met until all below it is counted.
        open_: set[_Key] = set()
        waiting = [item.key for item in reversed(self.items)]
        while waiting:
            key = waiting[-1]
            if key in count:
                waiting.pop()
                continue
            found = self.objects.get(key)
            if found is None:
                raise InputError(
                    f"there is no object with the id {key[1][:40]!r}",
                    place=key[0][:80],
                    fix="export the file anew",
                )
            inner = [component.key for component in found.components]
            missing = [one for one in inner if one not in count]
            if missing:
                open_.add(key)
                for one in missing:
                    if one in open_:
                        raise InputError(
                            f"the object with the id {one[1][:40]!r} holds itself",
                            place=one[0][:80],
                            fix="export the file anew",
                        )
                waiting.extend(missing)
                continue
            open_.discard(key)
            count[key] = sum(count[one] for one in inner) + (found.mesh != NO_MESH)
            waiting.pop()
        return count

    def _model_part(self) -> str:
        targets: list[str] = []

        def start(tag: str, attributes: Attributes) -> None:
            if attributes.get("Type") == _MODEL_TYPE:
                targets.append(attributes.get("Target", "").lstrip("/").lower())

        if _RELATIONSHIPS in self._parts:
            _parse(self._chunks(_RELATIONSHIPS), _RELATIONSHIPS, start, lambda tag: None)
        return targets[0] if targets else _USUAL_PART

    def _chunks(self, part: str) -> Generator[bytes, None, None]:
        name = self._parts.get(part)
        if name is None:
            raise InputError(f"the archive has no part {part[:80]!r}", fix="export the file anew")
        with self.archive.open(name) as stream:
            while chunk := stream.read(_CHUNK):
                yield chunk


class _PartReader:
    """Reads a part with a `<model>`; `build`: whether its items count."""

    def __init__(self, reader: _Reader, part: str, *, build: bool) -> None:
        self.reader, self.part, self.build = reader, part, build
        self.space = ""
        self.id = ""
        self.object: _Object | None = None
        self.vertices = _Rows(reader.budget, np.float64, "vertex")
        self.triangles = _Rows(reader.budget, np.int64, "triangle")
        self.prefixes: dict[str | None, str] = {}
        self.unread: set[str] = set()

    def parse(self, chunks: Generator[bytes, None, None]) -> None:
        _parse(chunks, self.part, self._start, self._end, self.prefixes)
        for what in sorted(self.unread):
            self.reader.placed.notes.append((Code.PARTLY_READ, f"{what} is not read"))

    def _start(self, tag: str, attributes: Attributes) -> None:
        space, _, name = tag.rpartition(" ")
        if not self.space:
            if name != "model":
                raise self._fault("this is no 3MF model")
            self.space = space or "-"
            self._note_required(attributes.get("requiredextensions", ""))
        elif (space or "-") != self.space:
            if self.object is not None and space not in _KNOWN:
                self.unread.add(f"<{name[:80]}> of {space[:200]}")
        elif name == "object":
            self.id = attributes.get("id", "")
            self.object = _Object(attributes.get("name") or self.id)
            if (self.part, self.id) in self.reader.objects:
                raise self._fault(f"two objects have the id {self.id[:40]!r}")
            self.reader.objects[self.part, self.id] = self.object
        elif name == "vertex":
            self.vertices.add(attributes, ("x", "y", "z"))
        elif name == "triangle":
            self.triangles.add(attributes, ("v1", "v2", "v3"))
        elif name == "component" and self.object is not None:
            key = self.reader.key(self.part, attributes)
            self.object.components.append(_Part(key, self._transform(attributes)))
        elif name == "item" and self.build:
            key = self.reader.key(self.part, attributes)
            called = attributes.get("partnumber", "")
            self.reader.items.append(_Part(key, self._transform(attributes), called))

    def _end(self, tag: str) -> None:
        if tag.rpartition(" ")[2] != "object" or self.object is None:
            return
        positions, triangles = self.vertices.taken(), self.triangles.taken()
        if len(triangles):
            where = f"object {self.id[:40]!r}"
            check_indices(triangles, len(positions), lambda at: f"{where}, triangle {at}")
            self.object.mesh = len(self.reader.placed.meshes)
            self.reader.placed.meshes.append(Mesh.plain(positions, triangles))
        elif len(positions):
            # A mesh of no triangle is an object all the same, which shows nothing.
            self.object.mesh = len(self.reader.placed.meshes)
            self.reader.placed.meshes.append(Mesh.plain(positions, np.zeros((0, 3), np.int64)))
        self.object = None

    def _transform(self, attributes: Attributes) -> Float64:
        """Twelve numbers, a row for each axis and one for the translation, of row vectors."""
        matrix = np.eye(4)
        text = attributes.get("transform")
        if text is not None:
            values = parsed(text.encode(), np.float64)
            if values is None or len(values) != 12:
                raise self._fault(f"{text[:40]!r} is no transform of twelve numbers")
            matrix[:3] = values.reshape(4, 3).T
        return matrix

    def _note_required(self, prefixes: str) -> None:
        for prefix in prefixes.split():
            space = self.prefixes.get(prefix, prefix)
            if space not in _KNOWN:
                self.unread.add(f"the extension {space[:200]}, which the file requires,")

    def _fault(self, problem: str) -> InputError:
        return InputError(problem, place=self.part[:80], fix="export the file anew")


class _Rows:
    """Rows of three numbers, as they come: text at first, then arrays."""

    def __init__(self, budget: Budget, dtype: type, what: str) -> None:
        self._budget, self._dtype, self._what = budget, dtype, what
        self._texts: list[str] = []
        self._arrays: list[NDArray[np.float64] | Int64] = []
        self._count = 0

    def add(self, attributes: Attributes, names: tuple[str, str, str]) -> None:
        try:
            self._texts.extend([attributes[name] for name in names])
        except KeyError as error:
            raise InputError(
                f"it has no {error}",
                place=f"{self._what} {self._count + len(self._texts) // 3}",
                fix="export the file anew",
            ) from None
        if len(self._texts) >= 3 * _CHUNK:
            self._parse()

    def taken(self) -> NDArray[np.float64] | Int64:
        """(n, 3) float64 or int64: all rows since the last call."""
        self._parse()
        empty: NDArray[np.float64] | Int64 = np.zeros((0, 3), self._dtype)
        result: NDArray[np.float64] | Int64 = np.concatenate([empty, *self._arrays])
        self._arrays, self._count = [], 0
        return result

    def _parse(self) -> None:
        rows = len(self._texts) // 3
        self._budget.claim(f"{self._what} rows", rows * _ROW_BYTES)
        values = parsed(" ".join(self._texts).encode(), self._dtype)
        # A text of two numbers would move all that follow.
        if values is None or len(values) != 3 * rows or "" in self._texts:
            odd = [not is_number(text.encode(), self._dtype) for text in self._texts]
            at = odd.index(True) if True in odd else 0
            raise InputError(
                f"{self._texts[at][:40]!r} is not a number",
                place=f"{self._what} {self._count + at // 3}",
                fix="export the file anew",
            )
        self._texts.clear()
        self._count += rows
        self._arrays.append(values.reshape(-1, 3))


def _parse(
    chunks: Generator[bytes, None, None],
    part: str,
    start: Callable[[str, Attributes], None],
    end: Callable[[str], None],
    prefixes: dict[str | None, str] | None = None,
) -> None:
    """Parse XML as it is unzipped. No document type is allowed, as the specification demands: so
    there are no entities that expand. Raises InputError where it is no XML."""
    parser = expat.ParserCreate(namespace_separator=" ")
    parser.StartElementHandler = start
    parser.EndElementHandler = end
    if prefixes is not None:
        parser.StartNamespaceDeclHandler = prefixes.__setitem__

    def refuse(*_: object) -> None:
        raise InputError("it declares a document type", place=part[:80], fix="export the file anew")

    parser.StartDoctypeDeclHandler = refuse
    try:
        # The archive stays open as long as one of its streams does.
        with closing(chunks):
            for chunk in chunks:
                parser.Parse(chunk, False)
        parser.Parse(b"", True)
    except expat.ExpatError as error:
        raise InputError(
            f"this is not valid XML: {str(error)[:200]}",
            place=part[:80],
            fix="export the file anew",
        ) from error
