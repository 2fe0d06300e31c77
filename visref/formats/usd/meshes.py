"""The triangles of USD's meshes and cubes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import UsdGeom, UsdShade, UsdSkel

from visref.errors import InputError
from visref.findings import Code
from visref.formats.keyed_ops import Keys
from visref.formats.placed import NO_MESH, Mesh, used_vertices
from visref.formats.polygons import triangulated
from visref.formats.usd.materials import NOTHING, Materials
from visref.formats.usd.transforms import Clock, rest_value
from visref.memory import Budget
from visref.scene import Int64, check_indices
from visref.wording import counted

# A mesh that is read: points as given, and as float32; corners and triangles as int64.
_POINT_BYTES, _CORNER_BYTES = 24, 40
# Corners of a cube, and its faces, which are seen from outside.
_CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float64)
_FACES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]


@dataclass
class Meshes:
    """The meshes of a stage, each once for all its instances, in `meshes`; `points`: their
    vertices in time, by number; and what was found on the way."""

    clock: Clock
    budget: Budget
    materials: Materials = field(default_factory=Materials)
    meshes: list[Mesh] = field(default_factory=list)
    points: dict[int, Keys] = field(default_factory=dict)
    subdivided: int = 0
    skinned: list[str] = field(default_factory=list)
    curved: list[str] = field(default_factory=list)
    _known: dict[tuple[Any, ...], int] = field(default_factory=dict)

    def of(self, prim: Any) -> int:
        """The number of a prim's mesh; NO_MESH for a shape that has no triangles here."""
        alphas = self._alphas(prim)
        owner = prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim
        key = (str(owner.GetPath()), *alphas)
        if key not in self._known:
            if prim.IsA(UsdGeom.Mesh):
                self._known[key] = self._mesh(prim, alphas)
            elif prim.IsA(UsdGeom.Cube):
                self._known[key] = self._cube(prim, alphas[0])
            else:
                self.curved.append(f"{prim.GetTypeName()} {prim.GetPath()}")
                self._known[key] = NO_MESH
        return self._known[key]

    def notes(self) -> list[tuple[Code, str]]:
        """What was found, as in `Scene.notes`."""
        notes = []
        if self.subdivided:
            what = counted(self.subdivided, "subdivision surface")
            notes.append((Code.PARTLY_READ, f"{what}, whose cage is taken instead of its limit"))
        if self.skinned:
            what = counted(len(self.skinned), "skinned mesh", "skinned meshes")
            notes.append(
                (Code.PARTLY_READ, f"{what} not posed by a skeleton, first {self.skinned[0]}")
            )
        if self.curved:
            what = counted(len(self.curved), "shape")
            notes.append(
                (Code.PARTLY_READ, f"{what} neither mesh nor cube, left out: {self.curved[0]}")
            )
        return notes + self.materials.notes()

    def _alphas(self, prim: Any) -> list[int]:
        """Of the prim, and of each of its parts that has a material."""
        alphas = [self.materials.of(prim)]
        if prim.IsA(UsdGeom.Mesh):
            alphas += [self.materials.of(part.GetPrim()) for part in _parts(prim)]
        return alphas

    def _cube(self, prim: Any, alpha: int) -> int:
        size = rest_value(UsdGeom.Cube(prim).GetSizeAttr())
        self.clock.moving(UsdGeom.Cube(prim).GetSizeAttr())
        half = (2.0 if size is None else float(size)) / 2.0
        faces = np.array(_FACES if alpha != NOTHING else [], np.int64).reshape(-1, 4)
        count = len(faces)
        return self._add(
            prim, _CUBE * half, faces.reshape(-1), np.full(count, 4), np.full(count, alpha), None
        )

    def _mesh(self, prim: Any, alphas: list[int]) -> int:
        mesh = UsdGeom.Mesh(prim)
        place = str(prim.GetPath())
        counts = _array(mesh.GetFaceVertexCountsAttr(), np.int64)
        corners = _array(mesh.GetFaceVertexIndicesAttr(), np.int64)
        points = _array(mesh.GetPointsAttr(), np.float32).reshape(-1, 3)
        size = len(points) * _POINT_BYTES + len(corners) * _CORNER_BYTES
        self.budget.claim(f"{len(points):,} points of a mesh", size, place=place)
        if (counts < 0).any() or counts.sum() != len(corners):
            raise InputError(
                f"its polygons have {counts.sum()} corners, and {len(corners)} are listed",
                place=place,
                fix="export the file anew",
            )
        try:
            check_indices(corners, len(points), lambda _: "")
        except InputError as error:
            raise error.at(place=place) from error
        alpha = np.full(len(counts), alphas[0])
        for part, own in zip(_parts(prim), alphas[1:], strict=True):
            alpha[_faces(part.GetIndicesAttr(), len(counts), place)] = own
        kept = alpha != NOTHING
        kept[_faces(mesh.GetHoleIndicesAttr(), len(counts), place)] = False
        scheme = rest_value(mesh.GetSubdivisionSchemeAttr())
        self.subdivided += scheme not in (None, UsdGeom.Tokens.none)
        api = UsdSkel.BindingAPI(prim)
        joints = api.GetJointIndicesAttr()
        shapes = api.GetBlendShapeTargetsRel()
        if (joints and joints.HasAuthoredValue()) or (shapes and shapes.HasAuthoredTargets()):
            self.skinned.append(place)
        corners = corners[np.repeat(kept, counts)]
        moved = self._moved(mesh, len(points), place)
        return self._add(prim, points, corners, counts[kept], alpha[kept], moved)

    def _moved(self, mesh: Any, count: int, place: str) -> Keys | None:
        """A mesh's points in time, None where they stand."""
        topology = (mesh.GetFaceVertexCountsAttr(), mesh.GetFaceVertexIndicesAttr())
        if sum(self.clock.moving(attribute) for attribute in topology):
            return None
        attribute = mesh.GetPointsAttr()
        samples = attribute.GetNumTimeSamples()
        if samples > 1:
            self.budget.claim(
                f"{samples:,} times {count:,} points", samples * count * 3 * 8, place=place
            )
        keys = self.clock.keys(attribute, lambda value: np.array(value, np.float32).reshape(-1, 3))
        if keys is not None and keys.values.shape[1] != count:
            self.clock.unplayed.append(str(attribute.GetPath()))
            return None
        return keys

    def _add(
        self,
        prim: Any,
        points: NDArray[Any],
        corners: Int64,
        counts: Int64,
        alpha: NDArray[Any],
        moved: Keys | None,
    ) -> int:
        """Append a mesh of polygons, `alpha` of each."""
        gprim = UsdGeom.Gprim(prim)
        place = str(prim.GetPath())
        triangles, owner = triangulated(
            points, corners, counts, lambda polygon: f"{place}, polygon {polygon}"
        )
        if rest_value(gprim.GetOrientationAttr()) == UsdGeom.Tokens.leftHanded:
            triangles = triangles[:, ::-1]
        one_sided = not rest_value(gprim.GetDoubleSidedAttr())
        plain = Mesh.plain(points, triangles, one_sided=one_sided)
        of_triangle = alpha[owner].astype(np.uint8)
        number = len(self.meshes)
        self.meshes.append(Mesh(plain.positions, plain.triangles, plain.one_sided, of_triangle))
        if moved is not None:
            rows = used_vertices(len(points), triangles)
            self.points[number] = Keys(moved.times, moved.values[:, rows])
        return number


def _parts(prim: Any) -> list[Any]:
    """The parts of a mesh that have materials of their own."""
    return list(UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets())


def _array(attribute: Any, kind: Any) -> NDArray[Any]:
    value = rest_value(attribute)
    return np.zeros(0, kind) if value is None else np.array(value, kind)


def _faces(attribute: Any, count: int, place: str) -> Int64:
    """The numbers of faces that an attribute lists."""
    faces: Int64 = _array(attribute, np.int64)
    if len(faces) and not 0 <= faces.min() <= faces.max() < count:
        raise InputError(
            f"{attribute.GetName()} names a face that it does not have",
            place=place,
            fix="export the file anew",
        )
    return faces
