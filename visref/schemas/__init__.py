"""JSON Schemas (draft 2020-12) of the files that visref reads and writes as JSON, for programs that
check them without visref.

verdict, manifest   of a run folder, version 2
witness             a line of a file in its `witnesses/`
path                a camera path, version 1
visible_sets        a line of recorded visible sets, version 1
recording           a line of a recording, header or frame, version 1
batch               many runs from one file (TOML, as its value in JSON)
policy              what a user accepts (TOML, as its value in JSON)
conformance         the manifest of a conformance suite, version 1
conformance_results what `visref conformance --json` writes, version 1
fault               `expected.json` of a shrunk fault, version 1
fuzz                `summary.json` of a search for faults, version 1
labels              a row of a label file (Parquet, as its value in JSON), version 1
"""

from __future__ import annotations

import json
from importlib.resources import files
from typing import Any

NAMES = (
    "batch", "conformance", "conformance_results", "fault", "fuzz", "labels", "manifest", "path",
    "policy", "recording", "verdict", "visible_sets", "witness",
)  # fmt: skip


def schema(name: str) -> dict[str, Any]:
    """The schema of one of `NAMES`. Raises KeyError for any other name."""
    if name not in NAMES:
        raise KeyError(name)
    text = files(__name__).joinpath(f"{name}.json").read_text(encoding="utf-8")
    loaded: dict[str, Any] = json.loads(text)
    return loaded
