"""USD (.usd, .usda, .usdc, .usdz) through Pixar's usd-core, an extra: `pip install 'visref[usd]'`.

Meshes and their material's alpha, transforms, scenegraph and point instances, purposes, visibility,
and what of it moves in time; metres and +Y up, as glTF. The file is parsed in a process of its own
(`visref.formats.in_a_child`): the libraries below USD are C++ and were not written for files of
strangers.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path

from visref.errors import InputError
from visref.formats.in_a_child import read_in_a_child
from visref.formats.placed import Placed
from visref.memory import Budget


def read_usd(path: Path, *, budget: Budget) -> Placed:
    """The objects of a USD file and of the files that it composes: every mesh that is drawn.

    Raises InputError where the file cannot be read, or usd-core is not installed.
    """
    if importlib.util.find_spec("pxr") is None:
        raise InputError("reading USD needs usd-core", fix="run: pip install 'visref[usd]'")
    return read_in_a_child("visref.formats.usd.reader:parse_usd", path, budget)
