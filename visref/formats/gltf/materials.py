"""What a glTF file's extensions say of materials, and what of it is left open."""

from __future__ import annotations

from visref.formats.gltf.document import Document
from visref.formats.gltf.values import Json


def transmission(material: Json) -> tuple[bool, bool]:
    """Whether light goes through a material's surface, and whether a texture says how much."""
    for name in ("KHR_materials_transmission", "ADOBE_materials_thin_transparency"):
        extension = material.extension(name)
        factor = extension.get("transmissionFactor") if extension is not None else None
        if extension is not None and factor is not None and factor.number() > 0.0:
            return True, extension.get("transmissionTexture") is not None
    return False, False


def open_questions(document: Document) -> list[str]:
    """What these extensions leave open, a sentence each."""
    result = []
    textured = [i for i, m in enumerate(document.entries("materials")) if transmission(m)[1]]
    if textured:
        result.append(
            f"{len(textured)} materials have a transmission texture, which is not evaluated: all"
            f" of their surface counts as glass, first materials[{textured[0]}]"
        )
    variants = []
    if "KHR_materials_variants" in document.used_extensions:
        meshes = document.entries("meshes")
        variants = [i for i, mesh in enumerate(meshes) if _varies(document, mesh)]
    if variants:
        result.append(
            "KHR_materials_variants: the default materials are taken, and others hide more or"
            f" less, in {len(variants)} meshes, first meshes[{variants[0]}]"
        )
    return result


def _varies(document: Document, mesh: Json) -> bool:
    """Whether a primitive's variants hide something else than its own material does."""
    for primitive in mesh["primitives"].items():
        extension = primitive.extension("KHR_materials_variants")
        if extension is None:
            continue
        own = primitive.get("material")
        hides = {_hides(document, own)}
        for mapping in extension["mappings"].items():
            hides.add(_hides(document, mapping["material"]))
        if len(hides) > 1:
            return True
    return False


def _hides(document: Document, reference: Json | None) -> str:
    """What of a material decides what it hides, in one string."""
    if reference is None:
        return repr((None, False, None, None, False))
    material = document.entry("materials", reference)
    mode, double = material.get("alphaMode"), material.get("doubleSided")
    mask = mode is not None and mode.value == "MASK"
    look = material.get("pbrMetallicRoughness")
    cutoff = material.get("alphaCutoff")
    return repr(
        (
            None if mode is None or mode.value == "OPAQUE" else mode.value,
            transmission(material)[0],
            look.value if mask and look is not None else None,
            cutoff.value if mask and cutoff is not None else None,
            bool(double is not None and double.value),
        )
    )
