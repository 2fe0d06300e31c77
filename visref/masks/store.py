"""`Masks`: all that a scene's alpha masks need, as plain read-only arrays.

A texture's *pyramid*: level 0 is the image; an entry of level k holds the least and the
greatest alpha of a block of 2^k x 2^k texels, blocks counted from texel (0, 0), those at the
far edges cut off. All pyramids lie behind one another in one uint16 array, each number as the
image stores it (8-bit images too, so nothing is lost): level 0 once, since its least and
greatest are the same, then for each further level the least, then the greatest.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from visref.frozen import Shared, frozen
from visref.masks.materials import MaskMaterial, Wrap

if TYPE_CHECKING:
    # Decoding brings a compiler and Pillow along, and only who decodes needs them.
    from visref.masks.textures import AlphaImage

# How a kernel names the wrap modes.
REPEAT, MIRROR, CLAMP = 0, 1, 2
_WRAP = {Wrap.REPEAT: REPEAT, Wrap.MIRRORED_REPEAT: MIRROR, Wrap.CLAMP_TO_EDGE: CLAMP}


# Few arrays, since numba counts references to each whenever they are passed on: a lookup with
# an array per field took three times as long.
TRIANGLE = np.dtype([("material", "i4"), ("uv", "f8", (3, 2)), ("vertex_alpha", "f8", (3,))])
MATERIAL = np.dtype(
    [
        ("texture", "i4"),
        ("wrap_s", "i1"),
        ("wrap_t", "i1"),
        ("nearest", "?"),
        ("unknown", "?"),
        ("factor", "f8"),
        ("cutoff", "f8"),
    ]
)
TEXTURE = np.dtype([(name, "i8") for name in ("width", "height", "scale", "level", "levels")])
LEVEL = np.dtype([(name, "i8") for name in ("least", "greatest", "width")])


class MaskArrays(NamedTuple):
    """What kernels read of `Masks`: structured arrays, and the texels.

    `triangles`: (m,) TRIANGLE per masked triangle: material, uv (already transformed), vertex
    alpha. `materials`: (k,) MATERIAL: texture (-1: none), wrap modes as REPEAT, MIRROR, CLAMP,
    whether it is nearest, whether it is unknown, factor, cutoff. `textures`: (n,) TEXTURE:
    size and scale, its first level's index, how many it has. `levels`: (l,) LEVEL: where its
    least and greatest alphas start in `alpha`, and its width. `alpha`: uint16, all pyramids.

    From these follow `bits`: uint64, a bit per texel and material: whether it is solid under a
    vertex alpha of one. A word holds a square of 8 x 8 texels, row by row, the first texel's the
    lowest; squares stand row by row too, `words_of_row` in each. `bits_of_material`: (k,) int64,
    where a material's begin, -1 where it has no texture.
    """

    triangles: NDArray[Any]
    materials: NDArray[Any]
    textures: NDArray[Any]
    levels: NDArray[Any]
    alpha: NDArray[np.uint16]
    bits: NDArray[np.uint64]
    bits_of_material: NDArray[np.int64]


DECIDING = ("triangles", "materials", "textures", "levels", "alpha")


def words_of_row(width: int) -> int:
    """Of `MaskArrays.bits`."""
    return (width + 7) // 8


@dataclass(frozen=True, eq=False)
class Masks(Shared):
    """Alpha masks of a scene's triangles.

    `row`: (t,) int32, for each triangle its row in the arrays of masked triangles, -1 for one
    that is not masked. `arrays`: see `MaskArrays`. `reasons`: why lookups cannot be done, each
    once. All arrays are read-only, and stay so (`visref.frozen`).
    """

    row: NDArray[np.int32]
    arrays: MaskArrays
    reasons: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "row", frozen(self.row))
        object.__setattr__(self, "arrays", MaskArrays(*map(frozen, self.arrays)))

    @classmethod
    def build(
        cls,
        row: NDArray[Any],
        material: NDArray[Any],
        uv: NDArray[Any],
        vertex_alpha: NDArray[Any],
        materials: Sequence[MaskMaterial],
        images: Sequence[AlphaImage],
    ) -> Masks:
        """From `row` (t,), and per masked triangle `material` (m,), `uv` (m, 3, 2), already
        transformed, and `vertex_alpha` (m, 3): COLOR_0's alpha, 1 without one.

        Raises ValueError where shapes or indices do not fit together.
        """
        row = np.array(row, np.int32).reshape(-1)
        triangles = np.zeros(np.size(material), TRIANGLE)
        triangles["material"] = material
        triangles["uv"] = uv
        triangles["vertex_alpha"] = vertex_alpha
        _check_range("row", row, -1, len(triangles))
        _check_range("material", triangles["material"], 0, len(materials))
        table = np.zeros(len(materials), MATERIAL)
        for entry, of in zip(table, materials, strict=True):
            texture = -1 if of.unknown else of.texture
            wrap_s, wrap_t = _WRAP[of.sampler.wrap_s], _WRAP[of.sampler.wrap_t]
            nearest, unknown = of.sampler.nearest, bool(of.unknown)
            values = (texture, wrap_s, wrap_t, nearest, unknown, of.factor, of.cutoff)
            for name, value in zip(MATERIAL.names or (), values, strict=True):
                entry[name] = value
        _check_range("texture", table["texture"], -1, len(images))
        return cls(
            row=row,
            arrays=MaskArrays(triangles, table, *_pack(images), *_solid(table, images)),
            reasons=tuple(dict.fromkeys(m.unknown for m in materials if m.unknown)),
        )

    @classmethod
    def none(cls, triangles: int) -> Masks:
        """Of so many triangles, no mask of which is known."""
        uv, alpha = np.zeros((0, 3, 2)), np.zeros((0, 3))
        return cls.build(np.full(triangles, -1), np.zeros(0), uv, alpha, [], [])

    def take(self, triangles: NDArray[Any]) -> Masks:
        """Masks of the triangles with these indices, (k,) integers, in this order; or where this,
        (t,) bool, is True."""
        row = self.row[triangles]
        used, inverse = np.unique(row[row >= 0], return_inverse=True)
        kept = np.full(len(row), -1, np.int32)
        kept[row >= 0] = inverse
        arrays = self.arrays._replace(triangles=self.arrays.triangles[used])
        return replace(self, row=kept, arrays=arrays)

    @cached_property
    def digest(self) -> bytes:
        """SHA-256 of everything that decides a lookup, 32 bytes."""
        total = hashlib.sha256()
        deciding = ((name, getattr(self.arrays, name)) for name in DECIDING)
        for name, array in (("row", self.row), *deciding):
            little = array.astype(array.dtype.newbyteorder("<"), copy=False)
            total.update(f"{name} {little.dtype.descr} {little.shape}\n".encode())
            total.update(np.ascontiguousarray(little).data)
        return total.digest()


def _check_range(name: str, values: NDArray[Any], low: int, end: int) -> None:
    if len(values) and not low <= values.min() <= values.max() < end:
        raise ValueError(f"masks: {name} outside {low}…{end - 1}")


def _pack(
    images: Sequence[AlphaImage],
) -> tuple[NDArray[Any], NDArray[Any], NDArray[np.uint16]]:
    """`textures`, `levels` and `alpha` of MaskArrays."""
    textures: list[tuple[int, ...]] = []
    levels: list[tuple[int, int, int]] = []
    parts: list[NDArray[np.uint16]] = []
    end = 0
    for image in images:
        alpha = image.alpha
        if alpha.ndim != 2 or not alpha.size:
            raise ValueError("masks: an image is (height, width), neither zero")
        alpha = _one_texel(alpha)
        least = greatest = alpha.astype(np.uint16)
        first = len(levels)
        levels.append((end, end, least.shape[1]))
        parts.append(least.reshape(-1))
        end += least.size
        while least.size > 1:
            least, greatest = _halve(least, np.minimum), _halve(greatest, np.maximum)
            levels.append((end, end + least.size, least.shape[1]))
            parts += [least.reshape(-1), greatest.reshape(-1)]
            end += 2 * least.size
        textures.append((alpha.shape[1], alpha.shape[0], image.scale, first, len(levels) - first))
    return (
        np.array(textures, TEXTURE),
        np.array(levels, LEVEL),
        np.concatenate(parts) if parts else np.zeros(0, np.uint16),
    )


def _solid(
    table: NDArray[Any], images: Sequence[AlphaImage]
) -> tuple[NDArray[np.uint64], NDArray[np.int64]]:
    """`bits` and `bits_of_material` of MaskArrays."""
    starts = np.full(len(table), -1, np.int64)
    parts: list[NDArray[np.uint64]] = []
    known: dict[tuple[int, bytes], int] = {}
    end = 0
    for index, of in enumerate(table):
        if of["texture"] < 0:
            continue
        image = images[of["texture"]]
        alphas = np.arange(image.scale + 1)
        # In the order of operations in which a lookup does it.
        solid = alphas / np.float64(image.scale) * of["factor"] * 1.0 >= of["cutoff"]
        key = int(of["texture"]), solid.tobytes()
        if key not in known:
            flags = solid[_one_texel(image.alpha)]
            across, down = words_of_row(flags.shape[1]), -(-len(flags) // 8)
            squares = np.zeros((8 * down, 8 * across), np.bool_)
            squares[: len(flags), : flags.shape[1]] = flags
            by_square = squares.reshape(down, 8, across, 8).transpose(0, 2, 1, 3)
            words = np.packbits(by_square, axis=3, bitorder="little").reshape(-1).view("<u8")
            known[key] = end
            parts.append(words.astype(np.uint64))
            end += words.size
        starts[index] = known[key]
    return np.concatenate(parts) if parts else np.zeros(0, np.uint64), starts


def _one_texel(alpha: NDArray[Any]) -> NDArray[Any]:
    """An image of one alpha says the same wherever it is looked up."""
    return alpha[:1, :1] if np.all(alpha == alpha[0, 0]) else alpha


def _halve(values: NDArray[np.uint16], extreme: np.ufunc) -> NDArray[np.uint16]:
    """Extremes over blocks of 2 x 2; at an odd edge, over what is there."""
    rows = extreme.reduceat(values, np.arange(0, values.shape[0], 2), axis=0)
    columns: NDArray[np.uint16] = extreme.reduceat(rows, np.arange(0, values.shape[1], 2), axis=1)
    return columns
