"""What a culler may answer, as messages: units, drawn sets, boxes, pictures and what it declares.

The worker writes them and the judge's side reads them. A value that is not what the contract asks
for is the culler's fault, and said so on either side: `CullerError`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.culler import (
    Culler,
    CullerError,
    DrawnSet,
    QueryStats,
    RasterTolerance,
    check_stats,
    check_tolerance,
    fault_text,
)
from visref.plug_ins.wire import Message
from visref.scene import Units

Arrays = Mapping[str, NDArray[Any]]


def numbers(value: object, what: str) -> NDArray[Any]:
    """An array of plain numbers, of any shape. Raises CullerError where it is none."""
    try:
        array = np.asarray(value)
    except Exception as error:
        raise CullerError(f"{what} is no array of numbers") from error
    if array.dtype.kind not in "biuf":
        raise CullerError(f"{what} is no array of numbers")
    return array


def units_message(units: object) -> Message:
    """What `prepare` returned."""
    if not isinstance(units, Units):
        raise CullerError("prepare() returned no Units")
    arrays = {
        "offsets": numbers(units.offsets, "the units' offsets"),
        "triangles": numbers(units.triangles, "the units' triangles"),
    }
    return Message({"kind": _text(units.kind, "the units' kind")}, arrays)


def read_units(message: Message) -> Units:
    arrays = message.arrays
    return Units(
        _array(arrays, "offsets"), _array(arrays, "triangles"), _text(message.header.get("kind"))
    )


def drawn_message(drawn: object, ms: float | None) -> Message:
    """What `cull` returned, and the milliseconds that it took, None where they are not its own."""
    if not isinstance(drawn, DrawnSet):
        raise CullerError("cull() returned no DrawnSet")
    stats = check_stats(drawn.stats, ms)
    arrays = {"unit_ids": numbers(drawn.unit_ids, "unit_ids")}
    if drawn.asked_at is not None:
        arrays["asked_at"] = numbers(drawn.asked_at, "asked_at")
    times = {phase: float(value) for phase, value in stats.ms.items()}
    header = {"ordered": bool(drawn.ordered), "counts": stats.counts(), "ms": times}
    return Message(header, arrays)


def read_drawn(message: Message) -> DrawnSet:
    counts, ms = message.header.get("counts"), message.header.get("ms")
    known = {f.name for f in fields(QueryStats)} - {"ms"}
    if not isinstance(counts, dict) or not isinstance(ms, dict) or not set(counts) <= known:
        raise CullerError("stats is no QueryStats")
    return DrawnSet(
        _array(message.arrays, "unit_ids"),
        QueryStats(**counts, ms=ms),
        message.arrays.get("asked_at"),
        bool(message.header.get("ordered")),
    )


def array_message(value: object, what: str) -> Message:
    """Boxes or a picture; None is none."""
    return Message({}, {} if value is None else {"array": numbers(value, what)})


def read_array(message: Message) -> NDArray[Any] | None:
    return message.arrays.get("array")


def declared(culler: Culler) -> dict[str, Any]:
    """What a culler says of itself now, as JSON values: its promise, whether it answers for all
    views at once, how far it looks back, and its rasteriser's tolerance."""
    raster = culler.raster
    return {
        "promise": _said(culler.promise),
        "joint": bool(culler.joint),
        "memory": _said(culler.memory),
        "moves": bool(culler.moves),
        "raster": None if raster is None else _tolerance(raster),
    }


def _tolerance(raster: object) -> dict[str, Any]:
    try:
        tolerance = raster.tolerance  # type: ignore[attr-defined]
        return {"snap_px": _said(tolerance.snap_px), "depth_bits": _said(tolerance.depth_bits)}
    except Exception as error:
        return {"fault": f"its rasteriser declares no tolerance: {fault_text(error)}"}


def read_tolerance(said: object) -> RasterTolerance:
    """Raises CullerError where no tolerance was declared, or one out of bounds."""
    if not isinstance(said, dict) or "snap_px" not in said:
        fault = said.get("fault") if isinstance(said, dict) else None
        raise CullerError(str(fault or "its rasteriser declares no tolerance"))
    try:
        return check_tolerance(RasterTolerance(said["snap_px"], said.get("depth_bits")))
    except ValueError as error:
        raise CullerError(f"raster.tolerance: {error}") from error


def _said(value: object) -> Any:
    """A number, a text, or what stands for it in an error message."""
    if value is None or isinstance(value, bool | int | float):
        return value
    if isinstance(value, np.integer | np.floating):
        return value.item()
    return str(value) if isinstance(value, str) else f"a {type(value).__name__}"


def _text(value: object, what: str = "a text") -> str:
    if not isinstance(value, str):
        raise CullerError(f"{what} is no text")
    return value


def _array(arrays: Arrays, name: str) -> NDArray[Any]:
    if name not in arrays:
        raise CullerError(f"its process left out {name}")
    return arrays[name]
