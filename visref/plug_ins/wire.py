"""Messages between the judge and a plug-in's process, over a socket pair.

A message is two lengths (uint64, little-endian), a JSON header and the bytes of the arrays that the
header describes. Nothing in it can name code: the judge reads what a plug-in's process sends, and
believes none of it. Arrays are copied: what a plug-in could still write is no evidence. What the
judge sends, a plug-in may trust: a scene goes beside the message, as a file descriptor
(`visref.plug_ins.shared`).
"""

from __future__ import annotations

import json
import math
import select
import socket
import struct
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

_LENGTHS = struct.Struct("<QQ")
# Far above any header of ours: names, counters and the shapes of a handful of arrays.
_MAX_HEADER = 1 << 24
_CHUNK = 1 << 20
_KINDS = "biuf"
# A poll is told milliseconds, an int of C.
_MOST_SECONDS = 2e6


class BrokenMessage(RuntimeError):
    """The other side sent what is no message."""


@dataclass(frozen=True, eq=False)
class Message:
    """A header (JSON values), named arrays of numbers, and file descriptors sent along."""

    header: Mapping[str, Any]
    arrays: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    descriptors: Sequence[int] = ()


@dataclass(eq=False)
class Deadline:
    """A moment after which nobody waits any more. `seconds` from now; None means never, and so
    does more than a poll can be told."""

    seconds: float | None

    def __post_init__(self) -> None:
        bounded = self.seconds is not None and self.seconds < _MOST_SECONDS
        self._end = time.monotonic() + self.seconds if bounded else None  # type: ignore[operator]

    def comes(self, file: int | socket.socket, *, to_write: bool = False) -> bool:
        """Wait until `file` can be read, or written, or time is up: whether it can."""
        left = None if self._end is None else max(self._end - time.monotonic(), 0.0)
        poll = select.poll()
        poll.register(file, select.POLLOUT if to_write else select.POLLIN)
        return bool(poll.poll(None if left is None else math.ceil(left * 1e3)))

    def wait(self, end: socket.socket, *, to_write: bool = False) -> None:
        """Wait until `end` can be read, or written. Raises TimeoutError when time is up."""
        if not self.comes(end, to_write=to_write):
            raise TimeoutError


def send(end: socket.socket, message: Message, deadline: Deadline) -> None:
    """Send a message. Raises OSError where nobody is there to read, TimeoutError where nobody
    reads in time."""
    arrays = {name: np.ascontiguousarray(array) for name, array in message.arrays.items()}
    described = [[name, a.dtype.str, list(a.shape)] for name, a in arrays.items()]
    header = json.dumps({**message.header, "arrays": described}).encode()
    total = sum(array.nbytes for array in arrays.values())
    first = _LENGTHS.pack(len(header), total) + header
    end.setblocking(False)
    if message.descriptors:
        deadline.wait(end, to_write=True)
        # The first byte carries them.
        socket.send_fds(end, [first[:1]], list(message.descriptors))
        first = first[1:]
    _send_all(end, memoryview(first), deadline)
    for array in arrays.values():
        _send_all(end, array.reshape(-1).view(np.uint8).data, deadline)


def _send_all(end: socket.socket, data: memoryview, deadline: Deadline) -> None:
    while len(data):
        deadline.wait(end, to_write=True)
        try:
            data = data[end.send(data[:_CHUNK]) :]
        except BlockingIOError:
            continue


def receive(
    end: socket.socket, deadline: Deadline, *, max_bytes: int, descriptors: int = 0
) -> Message:
    """The next message, of at most `max_bytes` of arrays and so many descriptors.

    Raises EOFError where the other side has gone, TimeoutError where none comes in time, and
    BrokenMessage where it is none.
    """
    end.setblocking(False)
    came: list[int] = []
    first = b""
    if descriptors:
        deadline.wait(end)
        first, came, _, _ = socket.recv_fds(end, 1, descriptors)
        if not first:
            raise EOFError
    lengths = first + _receive(end, _LENGTHS.size - len(first), deadline)
    header_size, total = _LENGTHS.unpack(lengths)
    if header_size > _MAX_HEADER:
        raise BrokenMessage("a header too long")
    if total > max_bytes:
        raise BrokenMessage(f"an answer of {total:,} bytes, where {max_bytes:,} are allowed")
    try:
        header = json.loads(bytes(_receive(end, header_size, deadline)))
        described = [_description(one) for one in header.pop("arrays")]
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise BrokenMessage("a header that is none") from error
    if sum(dtype.itemsize * math.prod(shape) for _, dtype, shape in described) != total:
        raise BrokenMessage("arrays of other sizes than announced")
    arrays = {}
    for name, dtype, shape in described:
        data = _receive(end, dtype.itemsize * math.prod(shape), deadline)
        arrays[name] = np.frombuffer(data, dtype).reshape(shape)
    return Message(header, arrays, came)


def _description(one: Any) -> tuple[str, np.dtype[Any], tuple[int, ...]]:
    name, code, shape = one
    dtype = np.dtype(str(code))
    sides = tuple(side for side in shape if type(side) is int and side >= 0)
    if dtype.kind not in _KINDS or len(sides) != len(shape) or len(sides) > 8:
        raise ValueError
    return str(name), dtype, sides


def _receive(end: socket.socket, size: int, deadline: Deadline) -> bytes:
    parts, missing = [], size
    while missing:
        deadline.wait(end)
        try:
            part = end.recv(min(missing, _CHUNK))
        except BlockingIOError:
            continue
        except ConnectionError as error:
            raise EOFError from error
        if not part:
            raise EOFError
        parts.append(part)
        missing -= len(part)
    return b"".join(parts)
