"""By which command a run folder was left, so that the same one need not judge it again."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from visref.errors import InputError
from visref.files import check_replacing, refuse_inputs, replacing_file
from visref.provenance import file_digest
from visref.run_folder.inside import json_inside
from visref.run_folder.layout import MANIFEST, VERDICT

FORMAT = "visref-stamp"
_BEGINS = f'{{\n  "format": "{FORMAT}"'.encode()
# What says all that there is in a run folder, and what was found.
_FILES = (VERDICT, MANIFEST)


def stands(stamp: Path, out: Path, command: Mapping[str, str]) -> bool:
    """Whether a stamp says that the run folder `out`, as it stands, was left by this command. A
    stamp that does not is removed: what follows it is another run. Raises InputError where no stamp
    can be written there."""
    refuse_inputs(out, [stamp])
    check_replacing(stamp, begins=_BEGINS)
    if not stamp.exists():
        return False
    try:
        said = json_inside(stamp.parent, stamp.name, "remove it")
    except InputError:
        said = None
    if said == _stamp(out, command):
        return True
    stamp.unlink()
    return False


def write_stamp(stamp: Path, out: Path, command: Mapping[str, str]) -> None:
    """Say that the run folder was left by this command."""
    with replacing_file(stamp, begins=_BEGINS) as beside:
        beside.write_text(f"{json.dumps(_stamp(out, command), indent=2)}\n", encoding="utf-8")


def _stamp(out: Path, command: Mapping[str, str]) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "version": 1,
        "command": dict(command),
        "files": {name: file_digest(out / name) for name in _FILES},
    }
