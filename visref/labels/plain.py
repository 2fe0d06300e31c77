"""JSON that labels are written in."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any


def write_json(file: Path, value: Any, indent: int | None = None) -> None:
    """Write JSON in UTF-8, as it stands; what is no Unicode in a name becomes an escape, from which
    it is read back."""
    text = json.dumps(value, indent=indent, ensure_ascii=False) + "\n"
    file.write_text(text, encoding="utf-8", errors="backslashreplace")
