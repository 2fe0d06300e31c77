"""Messages between processes: what is sent arrives, and what is no message is refused."""

from __future__ import annotations

import os
import socket
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.plug_ins.test_plug_ins import scene
from visref.plug_ins.shared import share, shared_value
from visref.plug_ins.wire import BrokenMessage, Deadline, Message, receive, send

SOON = Deadline(20.0)


@pytest.fixture
def pair():
    ends = socket.socketpair()
    yield ends
    for end in ends:
        end.close()


@given(
    dtype=st.sampled_from(["<i4", "<i8", "<f8", "|u1", "|b1"]),
    shape=st.lists(st.integers(0, 5), max_size=3),
    text=st.text(),
)
def test_what_is_sent_arrives(dtype, shape, text):
    array = np.arange(int(np.prod(shape))).reshape(shape).astype(dtype)
    here, there = socket.socketpair()
    with here, there:
        send(here, Message({"text": text, "number": 3}, {"a": array, "b": array.T}), SOON)
        came = receive(there, SOON, max_bytes=1 << 20)
    assert came.header == {"text": text, "number": 3}
    for name, sent in (("a", array), ("b", array.T)):
        assert came.arrays[name].dtype == sent.dtype
        np.testing.assert_array_equal(came.arrays[name], sent)


@pytest.mark.parametrize(
    ("sent", "error"),
    [
        (struct.pack("<QQ", 1 << 60, 0), "a header too long"),
        (struct.pack("<QQ", 2, 1 << 60) + b"{}", "where 1,048,576 are allowed"),
        (struct.pack("<QQ", 2, 0) + b"{}", "a header that is none"),
        (struct.pack("<QQ", 2, 0) + b"[]", "a header that is none"),
        (struct.pack("<QQ", 2, 0) + b"\xff\xff", "a header that is none"),
        *(
            (struct.pack("<QQ", len(text), size) + text, error)
            for text, size, error in (
                (b'{"arrays": [["a", "|O", [1]]]}', 8, "a header that is none"),
                (b'{"arrays": [["a", "<i4", [-1]]]}', 4, "a header that is none"),
                (b'{"arrays": [["a", "<i4", [1.5]]]}', 4, "a header that is none"),
                (b'{"arrays": [["a", "<i4", [2]]]}', 4, "arrays of other sizes"),
                (b'{"arrays": [["a", "<i4", [1152921504606846976, 8]]]}', 4, "other sizes"),
            )
        ),
    ],
)
def test_what_is_no_message_is_refused(sent, error, pair):
    pair[0].sendall(sent)
    with pytest.raises(BrokenMessage, match=error):
        receive(pair[1], SOON, max_bytes=1 << 20)


def test_a_message_cut_short_is_an_end_and_one_that_never_ends_takes_no_longer_than_it_may(pair):
    pair[0].sendall(struct.pack("<QQ", 100, 0) + b'{"arr')
    with pytest.raises(TimeoutError):
        receive(pair[1], Deadline(0.05), max_bytes=1 << 20)
    pair[0].close()
    with pytest.raises(EOFError):
        receive(pair[1], SOON, max_bytes=1 << 20)


def test_nobody_waits_for_a_reader_that_does_not_read(pair):
    with pytest.raises(TimeoutError):
        send(pair[0], Message({}, {"a": np.zeros(1 << 24)}), Deadline(0.05))


def test_a_shared_scene_is_the_same_and_nobody_can_write_into_it():
    made = scene()
    made.object_bounds  # noqa: B018  (cached, and so shared too)
    file = share(made)
    with pytest.raises(PermissionError):
        os.pwrite(file, b"x", 0)
    there = shared_value(os.dup(file))
    os.close(file)
    assert (there.digest, there.names) == (made.digest, made.names)
    for name in ("vertices", "triangles", "object_offsets", "object_bounds"):
        array = getattr(there, name)
        np.testing.assert_array_equal(array, getattr(made, name))
        with pytest.raises(ValueError, match="read-only"):
            array[:] = 0
        with pytest.raises(ValueError, match="WRITEABLE"):
            array.flags.writeable = True
