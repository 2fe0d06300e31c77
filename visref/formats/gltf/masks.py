"""What a glTF file says of alpha masks: textures, images, samplers, texture coordinates.

Sources: glTF 2.0, sections 3.8 (textures) and 3.9.2 (materials' textures); the extensions
KHR_texture_transform, EXT_texture_webp and KHR_texture_basisu.

A texture that cannot be had is no reason to refuse a file whose geometry is right: its
material becomes one of unknown alpha, and the reader says why.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from visref.errors import InputError
from visref.findings import Code
from visref.formats.gltf.document import Document
from visref.formats.gltf.values import Json
from visref.masks.instances import MaskTable
from visref.masks.materials import MaskMaterial, Sampler, TextureTransform, Wrap
from visref.masks.textures import AlphaImage, UndecodableImage, decode_alpha

_NEAREST = 9728
_DEFAULT_CUTOFF = 0.5
# Where a texture's image stands, first choice first. Basis Universal and DDS come last: no
# decoder here reads them, so a file's own substitute for readers without one is taken.
_SOURCES = (
    "EXT_texture_webp",
    "",
    "KHR_texture_basisu",
    "EXT_texture_avif",
    "MSFT_texture_dds",
    "GOOGLE_texture_basis",
)


@dataclass(frozen=True)
class Texture:
    """`image`: its index in the `MaskTable`; `coordinates`: n of TEXCOORD_n."""

    image: int
    sampler: Sampler
    transform: TextureTransform
    coordinates: int


@dataclass(frozen=True)
class MaskedMaterial:
    """A material of alphaMode MASK: `index` in the file, `factor` of its alpha, `cutoff`, the
    `texture` or why there is none (`unknown`), and the alpha that all of the texture has
    (`uniform`: 1 without a texture, None where it differs from texel to texel)."""

    index: int
    factor: float
    cutoff: float
    texture: Texture | None = None
    unknown: str = ""
    uniform: float | None = None


class MaskReader:
    """Reads the masked materials of one file, each image once, into a `MaskTable`."""

    def __init__(self, document: Document, table: MaskTable) -> None:
        self.document = document
        self.table = table
        self._materials: dict[int, MaskedMaterial] = {}
        self._images: dict[int, int | UndecodableImage] = {}
        self._constant: set[int] = set()
        self._unknown: dict[str, set[int]] = {}
        self._examples: dict[str, str] = {}

    def material(self, reference: Json) -> MaskedMaterial:
        """The material that `reference` names. Raises InputError for a bad factor or cutoff."""
        index = reference.integer()
        if index not in self._materials:
            self._materials[index] = self._read(index, self.document.entry("materials", reference))
        return self._materials[index]

    def add(self, material: MaskedMaterial, without: str = "") -> int:
        """The material's index in the table; `without`: why a primitive has no texture
        coordinates for it, empty if it has."""
        reason = material.unknown or without
        if reason:
            self._unknown.setdefault(reason, set()).add(material.index)
        texture = None if reason else material.texture
        return self.table.index_of(
            MaskMaterial(
                texture.image if texture is not None else -1,
                texture.sampler if texture is not None else Sampler(),
                material.factor,
                material.cutoff,
                reason,
            )
        )

    def is_constant(self, material: MaskedMaterial) -> None:
        """A material without a texture was decided by its constant alpha."""
        self._constant.add(material.index)

    def notes(self) -> Iterator[tuple[Code, str]]:
        """What was found, as in `Scene.notes`: one note for each reason."""
        if self._constant:
            first = f"first materials[{min(self._constant)}]"
            yield Code.ALPHA_MASK_CONSTANT, f"{len(self._constant)} materials, {first}"
        for reason, materials in self._unknown.items():
            count = "an alpha mask" if len(materials) == 1 else f"{len(materials)} alpha masks"
            example = f"; {self._examples[reason]}" if reason in self._examples else ""
            first = f"first materials[{min(materials)}]"
            yield Code.PARTLY_READ, f"{count} cannot be looked up, {first}: {reason}{example}"

    def _read(self, index: int, material: Json) -> MaskedMaterial:
        cutoff = material.get("alphaCutoff")
        level = _DEFAULT_CUTOFF if cutoff is None else cutoff.number()
        if cutoff is not None and level < 0.0:
            cutoff.fail(f"alpha cutoff {level} is below 0", "give 0 or more")
        factor, info = _base_alpha(material)
        if info is None:
            return MaskedMaterial(index, factor, level, uniform=1.0)
        try:
            texture = self._texture(info)
        except _TooLarge:
            raise
        except UndecodableImage as error:
            return MaskedMaterial(index, factor, level, unknown=str(error))
        except InputError as error:
            # Many missing files are one reason, told with the first of them.
            reason = "the texture cannot be read"
            self._examples.setdefault(reason, f"{error.place}: {error.problem}")
            return MaskedMaterial(index, factor, level, unknown=reason)
        image = self.table.images[texture.image]
        uniform = float(image.alpha[0, 0]) / image.scale if image.alpha.size == 1 else None
        return MaskedMaterial(index, factor, level, texture, uniform=uniform)

    def _texture(self, info: Json) -> Texture:
        """Raises UndecodableImage or InputError where it cannot be looked up."""
        texture = self.document.entry("textures", info["index"])
        chosen = info.get("texCoord")
        transform = TextureTransform()
        extension = _extension(info, "KHR_texture_transform")
        if extension is not None:
            transform = _transform(extension)
            chosen = extension.get("texCoord") or chosen
        sampler = texture.get("sampler")
        return Texture(
            self._image(_source(texture)),
            Sampler() if sampler is None else _sampler(self.document.entry("samplers", sampler)),
            transform,
            0 if chosen is None else chosen.integer(),
        )

    def _image(self, reference: Json) -> int:
        index = reference.integer()
        if index not in self._images:
            image = self.document.entry("images", reference)
            try:
                self._images[index] = self.table.add_image(_decoded(self.document, image))
            except UndecodableImage as error:
                self._images[index] = error
        found = self._images[index]
        if isinstance(found, UndecodableImage):
            raise found
        return found


def _decoded(document: Document, image: Json) -> AlphaImage:
    data, mime = document.image(image)
    try:
        found = decode_alpha(data, mime, document.budget)
        if np.all(found.alpha == found.alpha[0, 0]):
            return AlphaImage(found.alpha[:1, :1].copy(), found.scale)
        document.budget.claim("the alpha of its images", found.alpha.nbytes)
    except UndecodableImage:
        raise
    except InputError as error:
        # Not one that cannot be looked up: what is undecided must not hang on the free memory.
        raise _TooLarge(error.problem, fix=error.fix, place=image.place) from error
    return found


class _TooLarge(InputError):
    """An image that could be decoded, with more memory."""


def _base_alpha(material: Json) -> tuple[float, Json | None]:
    """The constant factor of a material's alpha, and the texture that multiplies it."""
    specular = _extension(material, "KHR_materials_pbrSpecularGlossiness")
    if specular is not None:
        owner, factor_name, texture_name = specular, "diffuseFactor", "diffuseTexture"
    else:
        metallic = material.get("pbrMetallicRoughness")
        if metallic is None:
            return 1.0, None
        owner, factor_name, texture_name = metallic, "baseColorFactor", "baseColorTexture"
    factor = owner.get(factor_name)
    alpha = 1.0 if factor is None else factor.numbers(4)[3]
    return alpha, owner.get(texture_name)


def _source(texture: Json) -> Json:
    """The reference to the image that stands for a texture."""
    for name in _SOURCES:
        owner = _extension(texture, name) if name else texture
        source = owner.get("source") if owner is not None else None
        if source is not None:
            return source
    raise UndecodableImage("the texture names no image")


def _transform(extension: Json) -> TextureTransform:
    offset, scale = extension.get("offset"), extension.get("scale")
    rotation = extension.get("rotation")
    move = (0.0, 0.0) if offset is None else offset.numbers(2)
    stretch = (1.0, 1.0) if scale is None else scale.numbers(2)
    return TextureTransform(
        (float(move[0]), float(move[1])),
        0.0 if rotation is None else rotation.number(),
        (float(stretch[0]), float(stretch[1])),
    )


def _sampler(sampler: Json) -> Sampler:
    filters = [sampler.get(name) for name in ("magFilter", "minFilter")]
    return Sampler(
        _wrap(sampler.get("wrapS")),
        _wrap(sampler.get("wrapT")),
        all(value is not None and value.integer() == _NEAREST for value in filters),
    )


def _wrap(mode: Json | None) -> Wrap:
    value = Wrap.REPEAT if mode is None else mode.integer()
    if value not in Wrap.__members__.values():
        raise UndecodableImage(f"a sampler's wrap mode is {value}, which glTF does not have")
    return Wrap(value)


def _extension(owner: Json, name: str) -> Json | None:
    extensions = owner.get("extensions")
    return extensions.get(name) if extensions is not None else None
