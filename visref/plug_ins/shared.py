"""Objects of ours handed to another process: their arrays in shared memory that nobody can write.

An object is pickled with its arrays out of band (pickle protocol 5); pickle and arrays lie in one
anonymous file, sealed, which the other process maps. So a scene is in memory once more, however
many processes hold it. Only the judge shares: what it unpickles itself would be trusted.
"""

from __future__ import annotations

import fcntl
import mmap
import os
import pickle
import struct
import tempfile
from typing import Any

# Arrays start at multiples of this, as SIMD loads like them.
_ALIGNMENT = 64
_COUNT = struct.Struct("<Q")
_SPAN = struct.Struct("<QQ")


def share(value: object) -> int:
    """A file descriptor of a sealed anonymous file that holds `value`; the caller closes it."""
    buffers: list[pickle.PickleBuffer] = []
    data = pickle.dumps(value, protocol=5, buffer_callback=buffers.append)
    parts = [memoryview(data), *(buffer.raw() for buffer in buffers)]
    spans, place = [], _aligned(_COUNT.size + _SPAN.size * len(parts))
    for part in parts:
        spans.append((place, part.nbytes))
        place = _aligned(place + part.nbytes)
    file = _anonymous()
    try:
        os.ftruncate(file, max(place, 1))
        head = _COUNT.pack(len(parts)) + b"".join(_SPAN.pack(*span) for span in spans)
        for (offset, _), part in zip([(0, 0), *spans], [memoryview(head), *parts], strict=True):
            while part.nbytes:
                written = os.pwrite(file, part, offset)
                part, offset = part[written:], offset + written
        if hasattr(fcntl, "F_ADD_SEALS"):
            seals = fcntl.F_SEAL_WRITE | fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_SEAL
            fcntl.fcntl(file, fcntl.F_ADD_SEALS, seals)
    except BaseException:
        os.close(file)
        raise
    return file


def shared_value(file: int) -> Any:
    """The value in a file of `share`; its arrays are read-only views of the mapped file. Closes
    the descriptor."""
    try:
        # Private: older kernels take any shared mapping of a sealed file for one that may write.
        size = os.fstat(file).st_size
        whole = mmap.mmap(file, size, flags=mmap.MAP_PRIVATE, prot=mmap.PROT_READ)
        mapped = memoryview(whole)
    finally:
        os.close(file)
    (count,) = _COUNT.unpack_from(mapped, 0)
    spans = [_SPAN.unpack_from(mapped, _COUNT.size + _SPAN.size * i) for i in range(count)]
    data, *buffers = [mapped[start : start + size] for start, size in spans]
    return pickle.loads(data, buffers=buffers)


def _aligned(place: int) -> int:
    return -(-place // _ALIGNMENT) * _ALIGNMENT


def _anonymous() -> int:
    if hasattr(os, "memfd_create"):
        return os.memfd_create("visref", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
    # Not sealed, but it has no name by which anybody could open it again.
    with tempfile.TemporaryFile() as file:
        return os.dup(file.fileno())
