"""Arrays and records that others may read and nobody can change through what they are handed.

A numpy array that is merely flagged read-only owns its memory, and whoever holds it (or a view's
`base`) may set the flag back. An array whose memory is a `bytes` object, or a read-only buffer
that was handed over (pickle's protocol 5), cannot be made writable.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Self, TypeVar

import numpy as np

Array = TypeVar("Array", bound="np.ndarray[Any, Any]")


def is_frozen(array: np.ndarray[Any, Any]) -> bool:
    """Whether nobody can write to the array's memory through it, its views or its bases."""
    base: Any = array
    while isinstance(base, np.ndarray):
        if base.flags.writeable:
            return False
        base = base.base
    try:
        # An array that owns its memory has no base, and None is no buffer.
        return memoryview(base).readonly
    except TypeError:
        return False


def frozen(array: Array) -> Array:
    """The same values, of the same type and shape, in memory that cannot be made writable: the
    array itself where it is so already, else one copy, in C order. Raises TypeError where the
    elements are Python objects."""
    if type(array) is np.ndarray and is_frozen(array):
        return array
    if array.dtype.hasobject:
        raise TypeError("an array of Python objects cannot be frozen")
    # Not np.frombuffer, which takes no empty buffer.
    copy: Any = np.ndarray(array.shape, array.dtype, buffer=array.tobytes())
    return copy  # type: ignore[no-any-return]


class Fresh:
    """Memory to be filled by whoever makes it, through `array`, and then handed over `frozen`
    without a copy. Nobody may keep `array`, or a view of it, beyond that."""

    def __init__(self, shape: int | tuple[int, ...], dtype: Any) -> None:
        """`array` has that shape and type, and any values."""
        kind = np.dtype(dtype)
        sizes = (shape,) if isinstance(shape, int) else shape
        size = math.prod(sizes) * kind.itemsize
        # A bytes object of any content, which Python lets its maker fill as long as nobody else
        # has it.
        self._memory: bytes = _new_bytes(None, size)
        raw = (ctypes.c_char * size).from_address(_address_of(self._memory))
        self.array: np.ndarray[Any, Any] = np.ndarray(sizes, kind, buffer=raw)

    def frozen(self) -> Any:
        """The array, in memory that cannot be made writable; `array` is gone."""
        result: Any = np.ndarray(self.array.shape, self.array.dtype, buffer=self._memory)
        del self.array, self._memory
        return result


_new_bytes = ctypes.pythonapi.PyBytes_FromStringAndSize
_new_bytes.restype, _new_bytes.argtypes = ctypes.py_object, [ctypes.c_char_p, ctypes.c_ssize_t]
_address_of = ctypes.pythonapi.PyBytes_AsString
_address_of.restype, _address_of.argtypes = ctypes.c_void_p, [ctypes.py_object]


class Shared:
    """A frozen dataclass that is shared with plug-ins: its arrays stay frozen, by `frozen`, over
    pickling too, and a plug-in gets a record of its own, `handed_out`."""

    def handed_out(self) -> Self:
        """A record of its own that shares the arrays: what `object.__setattr__` does to it reaches
        nobody else. What was computed already is not computed again."""
        own = object.__new__(type(self))
        for name, value in vars(self).items():
            own.__dict__[name] = value.handed_out() if isinstance(value, Shared) else value
        return own

    def __getstate__(self) -> dict[str, Any]:
        # A mapping that was computed is computed again: its proxy cannot be pickled.
        return {k: v for k, v in vars(self).items() if not isinstance(v, MappingProxyType)}

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        # Nothing is copied of what came as bytes or in a read-only buffer.
        self.__dict__.update({name: _frozen_value(value) for name, value in state.items()})


def _frozen_value(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return frozen(value)
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return type(value)(*map(_frozen_value, value))
    return value
