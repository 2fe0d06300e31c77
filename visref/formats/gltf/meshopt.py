"""Buffer views that are compressed with meshopt: EXT_ and KHR_meshopt_compression.

Why not through a package: the one that decodes them for Python is a month old, and where the
specification leaves a unit in the last place open, its answer depends on the processor.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from visref.files import Bytes
from visref.formats.gltf import meshopt_codecs as codecs
from visref.formats.gltf.extensions import MESHOPT
from visref.formats.gltf.meshopt_filters import FILTERS, UnspecifiedElement
from visref.formats.gltf.values import Json
from visref.memory import Budget

_MAX_COUNT = 2**31 - 1
_MODES = ("ATTRIBUTES", "TRIANGLES", "INDICES")
_MAX_STRIDE = 256


def compression(view: Json) -> Json | None:
    """What of a buffer view says how it is compressed, None where it is not."""
    found = [entry for name in MESHOPT if (entry := view.extension(name)) is not None]
    if len(found) > 1:
        view.fail(f"{' and '.join(MESHOPT)} exclude each other")
    return found[0] if found else None


def decoded(extension: Json, view: Json, data: Bytes, budget: Budget) -> Bytes:
    """The bytes of a buffer view, (n,) uint8, out of `data`, (m,) uint8, those that `extension`
    names.

    Raises InputError where they do not hold what it says, and where they would not fit.
    """
    mode = _one_of(extension["mode"], _MODES)
    named = extension.get("filter")
    name = "NONE" if named is None else _one_of(named, ("NONE", *FILTERS))
    stride, count = _layout(extension, view, mode, name)
    size = count * stride
    what = f"{count:,} elements, decompressed,"
    budget.need(what, size * (1 if name == "NONE" else 10), place=view.place)
    budget.claim(what, size, place=view.place)
    if mode == "ATTRIBUTES":
        result = _attributes(extension, data, count, stride)
        if name != "NONE":
            try:
                result = FILTERS[name][0](result)
            except UnspecifiedElement as error:
                extension.fail(f"the {name.lower()} filter's element {error.element} is not valid")
        return result.reshape(-1)
    return _indices(extension, data, mode, count, stride)


def _layout(extension: Json, view: Json, mode: str, name: str) -> tuple[int, int]:
    """The length of an element, and how many there are."""
    attributes = mode == "ATTRIBUTES"
    stride = extension["byteStride"].integer(1, _MAX_STRIDE)
    if stride % 4 if attributes else stride not in (2, 4):
        rule = "a multiple of 4" if attributes else "2 or 4"
        extension["byteStride"].fail(f"{stride} is not {rule}, as {mode} needs")
    if name != "NONE":
        lengths = FILTERS[name][1]
        if not attributes:
            extension["filter"].fail(f"{mode} has no filter")
        if lengths is not None and stride not in lengths:
            extension["byteStride"].fail(f"{stride} bytes are no element of the filter {name}")
    count = extension["count"].integer(1, _MAX_COUNT)
    if mode == "TRIANGLES" and count % 3:
        extension["count"].fail(f"{count} indices are no triangles")
    length = view["byteLength"].integer(1)
    if length != count * stride:
        view["byteLength"].fail(f"{count} elements of {stride} bytes are not {length} bytes")
    own = view.get("byteStride")
    if own is not None and own.integer() != stride:
        own.fail(f"its compressed elements have {stride} bytes, not {own.value}")
    return stride, count


def _attributes(extension: Json, data: Bytes, count: int, stride: int) -> NDArray[np.uint8]:
    header = _header(extension, data, (codecs.ATTRIBUTES_0, codecs.ATTRIBUTES_1))
    tail = codecs.tail_bytes(header, stride)
    _long_enough(extension, data, 1 + tail)
    result = np.empty((count, stride), np.uint8)
    version = header - codecs.ATTRIBUTES_0
    _whole(extension, data, codecs.decode_attributes(data, tail, stride, version, result))
    return result


def _indices(extension: Json, data: Bytes, mode: str, count: int, stride: int) -> Bytes:
    result: NDArray[np.uint16 | np.uint32] = np.empty(count, f"<u{stride}")
    if mode == "TRIANGLES":
        _header(extension, data, (codecs.TRIANGLES,))
        end = codecs.decode_triangles(data, result)
    else:
        _header(extension, data, (codecs.INDICES,))
        end = codecs.decode_indices(data, result)
    _whole(extension, data, end)
    return result.view(np.uint8)


def _header(extension: Json, data: Bytes, known: tuple[int, ...]) -> int:
    first = int(data[0])
    if first not in known:
        listed = " or ".join(f"0x{header:02x}" for header in known)
        extension.fail(f"the compressed data starts with 0x{first:02x}, not {listed}")
    return first


def _long_enough(extension: Json, data: Bytes, least: int) -> None:
    if len(data) < least:
        extension.fail(f"the compressed data has {len(data)} bytes, and {least} at least are due")


def _whole(extension: Json, data: Bytes, end: tuple[int, bool]) -> None:
    if not end[1]:
        extension.fail(f"the compressed data is not valid at byte {end[0]} of {len(data)}")


def _one_of(value: Json, known: tuple[str, ...]) -> str:
    text = value.text()
    if text not in known:
        value.fail(f"{text[:40]!a} is not {', '.join(known[:-1])} or {known[-1]}")
    return text
