"""Buffers on the GPU follow a scene from moment to moment: what changed is written."""

from __future__ import annotations

from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

# Rows that may lie unchanged between two written ones: to copy some ten kilobytes more is no
# slower than another call.
GAP = 1024


def write_changed(buffer: moderngl.Buffer, before: NDArray[Any], after: NDArray[Any]) -> None:
    """Write into a buffer that holds the rows `before`, (n, k), what differs in `after`."""
    if before is after:
        return
    rows = np.flatnonzero((before != after).any(axis=1))
    if not len(rows):
        return
    for run in np.split(rows, np.flatnonzero(np.diff(rows) > GAP) + 1):
        part = np.ascontiguousarray(after[run[0] : run[-1] + 1])
        buffer.write(part.tobytes(), offset=int(run[0]) * part.strides[0])
