"""What a recording says of its frames, kept aside: in memory while it is little, else in a file of
its own that goes with the process. So a recording of any length takes a few bytes per frame."""

from __future__ import annotations

import os
import struct
import tempfile
import weakref
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.scene import Float64, Int32

# Beyond this a temporary file holds it all.
_IN_MEMORY = 64 << 20
_LIST, _BITS = 0, 1
# Before an array: how long its kind's name is, and how many dimensions it has.
_HEAD = struct.Struct("<BB")


class Spool:
    """Sets of numbers, boxes and arrays, put away and got back by where they were put. Beyond
    `in_memory` bytes a temporary file holds it all."""

    def __init__(self, in_memory: int = _IN_MEMORY) -> None:
        self._in_memory = in_memory
        self._file = tempfile.SpooledTemporaryFile(max_size=in_memory)  # noqa: SIM115
        # Whoever replays may come back to any frame.
        weakref.finalize(self, self._file.close)
        self._end = 0
        self._on_disk = False

    def put_set(self, numbers: Int32) -> tuple[int, int]:
        """Keep a set, (k,) int32 ascending; returns where. A large one takes a bit per number."""
        if len(numbers) and 4 * len(numbers) > int(numbers[-1]) // 8 + 1:
            flags = np.zeros(int(numbers[-1]) + 1, np.bool_)
            flags[numbers] = True
            return self.put_bytes(bytes([_BITS]) + np.packbits(flags).tobytes())
        return self.put_bytes(bytes([_LIST]) + numbers.astype("<i4").tobytes())

    def get_set(self, at: tuple[int, int]) -> Int32:
        """The set that was put there, (k,) int32 ascending."""
        data = self.get_bytes(at)
        if data[0] == _BITS:
            flags = np.unpackbits(np.frombuffer(data, np.uint8, offset=1))
            return np.flatnonzero(flags).astype(np.int32)
        return np.frombuffer(data, "<i4", offset=1).astype(np.int32)

    def put_boxes(self, numbers: Int32, boxes: Float64) -> tuple[int, int]:
        """Keep boxes, (k, 2, 3) float64, and whose they are, (k,) int32; returns where."""
        return self.put_bytes(numbers.astype("<i4").tobytes() + boxes.astype("<f8").tobytes())

    def get_boxes(self, at: tuple[int, int]) -> tuple[Int32, Float64]:
        """The boxes that were put there, and whose they are."""
        data = self.get_bytes(at)
        count = len(data) // (4 + 48)
        numbers = np.frombuffer(data, "<i4", count).astype(np.int32)
        boxes = np.frombuffer(data, "<f8", 6 * count, 4 * count).astype(np.float64)
        return numbers, boxes.reshape(count, 2, 3)

    def put_arrays(self, arrays: Iterable[NDArray[Any]]) -> tuple[int, int]:
        """Keep arrays of numbers or bools, each with its kind and shape; returns where."""
        data = b""
        for array in arrays:
            # NumPy's own header is text, and takes as long to read as all the rest.
            kind = array.dtype.str.encode()
            data += _HEAD.pack(len(kind), array.ndim) + kind
            data += np.array(array.shape, "<i8").tobytes() + array.tobytes()
        return self.put_bytes(data)

    def get_arrays(self, at: tuple[int, int]) -> list[NDArray[Any]]:
        """The arrays that were put there."""
        data, place, found = self.get_bytes(at), 0, []
        while place < len(data):
            letters, dimensions = _HEAD.unpack_from(data, place)
            place += _HEAD.size + letters
            kind = np.dtype(data[place - letters : place].decode())
            shape = np.frombuffer(data, "<i8", dimensions, place)
            place += shape.nbytes
            array = np.frombuffer(data, kind, int(shape.prod()), place).reshape(shape).copy()
            place += array.nbytes
            found.append(array)
        return found

    def put_bytes(self, data: bytes) -> tuple[int, int]:
        """Keep some bytes; returns where."""
        at = self._end
        self._file.seek(at)
        self._file.write(data)
        self._end += len(data)
        if self._end > self._in_memory:
            self._file.flush()
            self._on_disk = hasattr(os, "pread")
        return at, len(data)

    def get_bytes(self, at: tuple[int, int]) -> bytes:
        """The bytes that were put there."""
        place, length = at
        if self._on_disk:
            # A copy of this process has the same file, and one place in it for both.
            return os.pread(self._file.fileno(), length, place)
        self._file.seek(place)
        return self._file.read(length)
