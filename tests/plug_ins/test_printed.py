"""What a process prints: its last words are whole, however long the line."""

from __future__ import annotations

import io

import pytest

from visref.plug_ins.printed import Printed


@pytest.mark.parametrize("end", [b"\n", b"", b"\n\n  \n"])
@pytest.mark.parametrize("length", [1, 299, 300, 301, 900, 8000])
def test_the_last_line_is_whole(length, end):
    words = ("ab cd " * 2000)[:length].strip() + "."
    printed = Printed(io.BytesIO(b"x" * 700 + b"\n" + words.encode() + end), None)
    assert printed.last == words
