"""IFC, the buildings' format, through ifcopenshell, an extra: `pip install 'visref[ifc]'`.

Every product with a shape, its openings cut out, in metres and +Y up as glTF; spaces are left out.
The file is parsed in a process of its own (`visref.formats.in_a_child`): the library below is C++
and was not written for files of strangers.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path

from visref.errors import InputError
from visref.formats.in_a_child import read_in_a_child
from visref.formats.placed import Placed
from visref.memory import Budget

# Solids are extruded, cut and united: a megabyte of text can be a thousand of them, at some 10 ms.
_SECONDS_A_MB = 30


def read_ifc(path: Path, *, budget: Budget) -> Placed:
    """The objects of an IFC file: every product with a shape.

    Raises InputError where the file cannot be read, or ifcopenshell is not installed.
    """
    if importlib.util.find_spec("ifcopenshell") is None:
        raise InputError("reading IFC needs ifcopenshell", fix="run: pip install 'visref[ifc]'")
    return read_in_a_child(
        "visref.formats.ifc.reader:parse_ifc", path, budget, seconds_a_mb=_SECONDS_A_MB
    )
