"""What another process prints, and how it ended, in words."""

from __future__ import annotations

import signal
import threading
from collections import deque
from collections.abc import Callable
from typing import IO

# What a dying process may still have to say.
SECONDS_TO_DIE = 5.0
# Lines of a plug-in's own that are passed on, and the characters of each.
_MAX_LINES, _MAX_LINE = 200, 300
# Of the last line, so that the names in it are whole whatever is made of them.
_MAX_LAST = 8192

Said = Callable[[str], None]


class Printed:
    """What a process prints to one stream, read as it comes, so that it never waits for a reader.
    `say` is given the first lines of it."""

    def __init__(self, stream: IO[bytes], say: Said | None) -> None:
        self._stream, self._say = stream, say
        self._lines: deque[str] = deque(maxlen=1)
        self._count = 0
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    @property
    def last(self) -> str:
        """The last line that says something."""
        self._thread.join(SECONDS_TO_DIE)
        return self._lines[-1] if self._lines else ""

    def _read(self) -> None:
        # A long line comes in parts.
        whole = b""
        while line := self._stream.readline(_MAX_LINE):
            whole = (line if whole.endswith(b"\n") else whole + line)[-_MAX_LAST:]
            text = line.decode(errors="backslashreplace").strip()
            if not text:
                continue
            self._lines.append(whole.decode(errors="backslashreplace").strip())
            self._count += 1
            if self._say is not None and self._count <= _MAX_LINES:
                self._say(text)
            elif self._say is not None and self._count == _MAX_LINES + 1:
                self._say("… and more, which is not shown")

    def finish(self) -> None:
        self._thread.join(SECONDS_TO_DIE)
        if not self._thread.is_alive():
            self._stream.close()


def signal_name(number: int) -> str:
    """`SIGSEGV`, or `signal 40` for one without a name."""
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
