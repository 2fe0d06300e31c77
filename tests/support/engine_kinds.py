"""Truth engines by kind, for fixtures."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from visref.engines import embree
from visref.engines.base import TruthEngine
from visref.engines.embree import EmbreeEngine
from visref.engines.exact import ExactEngine
from visref.engines.open3d import Open3DEngine


def engine_kind(name: str, monkeypatch: pytest.MonkeyPatch) -> Callable[..., TruthEngine]:
    """An engine of a kind: "packets", "single rays" (Embree without its bundled library),
    "open3d" or "exact"."""
    if name == "exact":
        return ExactEngine
    if name == "open3d":
        pytest.importorskip("open3d")
        return Open3DEngine
    if name == "single rays":
        monkeypatch.setattr(embree, "load_library", lambda: None)
    elif embree.load_library() is None:
        pytest.skip("this embreex brings no library with packets of eight rays")
    return EmbreeEngine
