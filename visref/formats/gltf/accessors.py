"""Typed arrays out of a glTF file's buffers (section 3.6), checked against the bytes there."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.files import Bytes
from visref.formats.gltf.document import Document
from visref.formats.gltf.values import Json

Float64 = NDArray[np.float64]

_DTYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
FLOAT = 5126
UNSIGNED = (5121, 5123, 5125)
MAX_COUNT = 2**31 - 1


def read_raw(
    document: Document, reference: Json, kinds: tuple[str, ...], components: tuple[int, ...]
) -> NDArray[Any]:
    """An accessor as stored: (count, width), a view of the file where it can be.

    `kinds`: the accessor types allowed; `components`: the component types allowed, empty for
    any.
    """
    accessor = document.entry("accessors", reference)
    kind = accessor["type"].text()
    component = accessor["componentType"].integer()
    if kind not in kinds:
        accessor.fail(f"its type is {kind}, not {' or '.join(kinds)}")
    if component not in (components or _DTYPES):
        accessor.fail(f"componentType {component} is not allowed for {reference.place}")
    count = accessor["count"].integer(1, MAX_COUNT)
    shape, dtype = (count, _WIDTHS[kind]), np.dtype(_DTYPES[component])
    # As it is, and once more as float64 or int64.
    size = shape[0] * shape[1] * (dtype.itemsize + 8)
    document.budget.need(f"{count:,} values", size, place=accessor.place)
    view = accessor.get("bufferView")
    if view is not None:
        data, stride = document.view(view)
        values = _strided(accessor, data, stride, shape, dtype)
    else:
        values = np.broadcast_to(np.zeros((), dtype), shape)
    sparse = accessor.get("sparse")
    return values if sparse is None else _with_sparse(document, sparse, values)


def _strided(
    owner: Json, data: Bytes, stride: int | None, shape: tuple[int, int], dtype: np.dtype[Any]
) -> NDArray[Any]:
    offset = owner.get("byteOffset")
    start = 0 if offset is None else offset.integer()
    element = shape[1] * dtype.itemsize
    step = stride or element
    if step < element:
        owner.fail(f"elements of {element} bytes stand {step} bytes apart")
    end = start + (shape[0] - 1) * step + element
    if end > len(data):
        owner.fail(f"it ends at byte {end} of a buffer view of {len(data)}")
    # A mapped or decoded buffer need not be aligned; NumPy reads it all the same.
    return np.ndarray(shape, dtype, data.data, start, (step, dtype.itemsize))


def _with_sparse(document: Document, sparse: Json, base: NDArray[Any]) -> NDArray[Any]:
    """The base values with those replaced that the accessor's sparse part names."""
    values = base.copy()
    count = sparse["count"].integer(1, len(base))
    places, kind = sparse["indices"], sparse["indices"]["componentType"].integer()
    if kind not in UNSIGNED:
        places["componentType"].fail(f"{kind} is not an unsigned integer type")
    data, _ = document.view(places["bufferView"])
    rows = _strided(places, data, None, (count, 1), np.dtype(_DTYPES[kind]))[:, 0]
    if rows.max() >= len(base):
        places.fail(f"it names element {rows.max()} of {len(base)}")
    data, _ = document.view(sparse["values"]["bufferView"])
    shape = (count, base.shape[1])
    values[rows] = _strided(sparse["values"], data, None, shape, base.dtype)
    return values


def read_floats(
    document: Document, reference: Json, kinds: tuple[str, ...], *, integers: bool = False
) -> NDArray[Any]:
    """An accessor of numbers, (count, width): float32 as stored, or float64 from integers.

    `integers` allows integer components (KHR_mesh_quantization and the like), decoded as the
    accessor's `normalized` says.
    """
    raw = read_raw(document, reference, kinds, () if integers else (FLOAT,))
    if raw.dtype.kind == "f":
        return raw
    normalized = document.entry("accessors", reference).get("normalized")
    return decode(raw, normalized=normalized is not None and normalized.flag())


def decode(raw: NDArray[Any], *, normalized: bool) -> NDArray[Any]:
    """Integers, (count, width), as float64 of that shape; normalized ones as section 3.11 says,
    max(c / limit, -1). Floats come back as they are."""
    if raw.dtype.kind == "f":
        return raw
    values = raw.astype(np.float64)
    if normalized:
        values = np.maximum(values / np.iinfo(raw.dtype).max, -1.0)
    return values
