"""What of a USD material decides what it hides: UsdPreviewSurface's opacity."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from pxr import UsdGeom, UsdShade

from visref.findings import Code
from visref.formats.usd.transforms import rest_value
from visref.scene import Alpha
from visref.wording import counted

_SURFACE = "UsdPreviewSurface"
# Where a masked material's constant opacity hides all of it.
NOTHING = -1


@dataclass
class Materials:
    """The alpha of what is bound, by prim; and what was found on the way."""

    unknown: set[str] = field(default_factory=set)
    textured: set[str] = field(default_factory=set)
    _known: dict[str, int] = field(default_factory=dict)

    def of(self, prim: Any) -> int:
        """An `Alpha` as a number, or NOTHING, of what is bound to a mesh or a part of one."""
        material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
        if not material:
            return self._displayed(prim)
        path = str(material.GetPath())
        if path not in self._known:
            self._known[path] = self._read(material, path)
        return self._known[path]

    def notes(self) -> list[tuple[Code, str]]:
        """What was found, as in `Scene.notes`."""
        notes = []
        if self.unknown:
            what = counted(len(self.unknown), "material")
            first = min(self.unknown)
            notes.append(
                (Code.PARTLY_READ, f"{what} without a {_SURFACE} count as opaque, first {first}")
            )
        if self.textured:
            what = counted(len(self.textured), "alpha mask")
            first = min(self.textured)
            notes.append(
                (Code.PARTLY_READ, f"{what} cannot be looked up, first {first}: USD's are not read")
            )
        return notes

    def _displayed(self, prim: Any) -> int:
        """Without a material: one opacity for all of it, as it is displayed."""
        primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance("displayOpacity")
        values = rest_value(primvar.GetAttr()) if primvar else None
        if values is None or primvar.GetInterpolation() != UsdGeom.Tokens.constant:
            return int(Alpha.OPAQUE)
        return int(Alpha.BLEND if len(values) and values[0] < 1.0 else Alpha.OPAQUE)

    def _read(self, material: Any, path: str) -> int:
        shader, _, _ = material.ComputeSurfaceSource()
        if not shader or shader.GetIdAttr().Get() != _SURFACE:
            self.unknown.add(path)
            return int(Alpha.OPAQUE)
        opacity, textured = _input(shader, "opacity", 1.0)
        threshold, _ = _input(shader, "opacityThreshold", 0.0)
        if textured:
            if threshold > 0.0:
                self.textured.add(path)
                return int(Alpha.MASK)
            return int(Alpha.BLEND)
        if threshold > 0.0:
            return int(Alpha.OPAQUE) if opacity >= threshold else NOTHING
        return int(Alpha.BLEND if opacity < 1.0 else Alpha.OPAQUE)


def _input(shader: Any, name: str, default: float) -> tuple[float, bool]:
    """A shader's number, and whether another shader gives it, which is a texture as a rule."""
    given = shader.GetInput(name)
    if not given:
        return default, False
    sources = given.GetValueProducingAttributes()
    if not sources:
        return default, False
    if UsdShade.Output.IsOutput(sources[0]):
        return default, True
    value = rest_value(sources[0])
    return (float(value) if isinstance(value, (int, float)) else default), False
