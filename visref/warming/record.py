"""What a part left in the cache: by it a second `visref warm` sees that nothing changed.

The record of a part is a file beside the kernels: the machine they were compiled for, what parts
there were, and of each module with kernels that the part had loaded its folder, a digest of whose
source is its name (`visref.compiled`), with the files in it. It holds while these are the same.
"""

from __future__ import annotations

import hashlib
import importlib
import json
import os
from pathlib import Path

from numba.core.registry import cpu_target

from visref.compiled import cache_folder, folders_in_use, source_of
from visref.errors import InputError
from visref.files import replacing_file


def _made_by() -> list[str]:
    """What numba tells caches apart by, platform, processor and its features; and what the parts
    are."""
    machine = cpu_target.target_context.codegen().magic_tuple()
    parts = Path(__file__).with_name("parts.py").read_bytes()
    return [*map(str, machine), hashlib.blake2b(parts, digest_size=16).hexdigest()]


def place() -> Path:
    """The folder of all kernels. Raises InputError where they can be kept nowhere."""
    module = "visref.kernels"
    source = source_of(module)
    folder = None if source is None else cache_folder(module, source)
    if folder is None:
        raise InputError(
            "compiled kernels can be kept nowhere",
            place="NUMBA_CACHE_DIR",
            fix="name a folder that can be written",
        )
    return folder.parent


def can_keep() -> None:
    """Raises InputError where nothing can be added to the compiled kernels."""
    if not os.access(place(), os.W_OK):
        raise InputError(
            f"{place()} is read-only", place="NUMBA_CACHE_DIR", fix="name a folder that is not"
        )


def holds(part: str) -> bool:
    """Whether all that a part compiles lies in the cache, made of the source as it is."""
    try:
        record = json.loads(_file(part).read_bytes())
        if record["made_by"] != _made_by():
            return False
        return all(_is_there(module, *kept) for module, kept in record["kernels"].items())
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        # None was written, or it was spoilt.
        return False


def write_record(part: str) -> None:
    """Record what this process, which has just done a part, finds in the cache. Raises OSError."""
    kernels = {
        module: (folder.name, sorted(file.name for file in folder.glob("*.nb?")))
        for module, folder in sorted(folders_in_use().items())
    }
    with replacing_file(_file(part)) as file:
        file.write_text(json.dumps({"made_by": _made_by(), "kernels": kernels}), encoding="utf-8")


def _file(part: str) -> Path:
    return place() / f"warm-{part}.json"


def _is_there(module: str, name: str, files: list[str]) -> bool:
    try:
        importlib.import_module(module.partition(".")[0])
    except ImportError:
        return False
    source = source_of(module)
    folder = None if source is None else cache_folder(module, source)
    if folder is None or folder.name != name:
        return False
    return set(files) <= {file.name for file in folder.iterdir()}
