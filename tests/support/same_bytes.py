"""Whether two run folders are the same, as docs/architecture.md and the design have it: all files
but the timings, and the manifest without the machine."""

from __future__ import annotations

import json
from pathlib import Path


def told(folder: Path) -> dict[str, bytes]:
    """What a run folder says, by file."""
    found = {}
    for file in sorted(folder.rglob("*")):
        name = file.relative_to(folder).as_posix()
        if not file.is_file() or name == "timings.parquet":
            continue
        found[name] = file.read_bytes()
    manifest = json.loads(found["manifest.json"])
    del manifest["machine"]
    found["manifest.json"] = json.dumps(manifest, indent=2).encode()
    return found


def differing(one: Path, other: Path) -> list[str]:
    """The files that two run folders do not have alike."""
    first, second = told(one), told(other)
    return [name for name in sorted({*first, *second}) if first.get(name) != second.get(name)]
