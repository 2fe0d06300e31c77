"""Truth engines, found by name through the entry-point group `visref.engines`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from visref.doing import doing
from visref.engines.base import TruthEngine
from visref.errors import InputError
from visref.options import read_options
from visref.registry import ENGINES, available, load_entry
from visref.scene import Scene
from visref.wording import counted

__all__ = ["ENGINES", "TruthEngine", "check_engine", "engine_names", "make_engine"]


def engine_names() -> list[str]:
    """The installed engines' names, sorted."""
    return list(available(ENGINES))


def make_engine(spec: str, scene: Scene, *, threads: int | None = None) -> TruthEngine:
    """The engine of a spec `NAME[:option=value,…]` over a scene; `threads` None means all cores.

    Raises InputError for an unknown name, option or value, for a number of threads below one,
    and where the engine's library is not installed.
    """
    if threads is not None and threads < 1:
        raise InputError(f"threads is {threads}", place="threads", fix="give 1 or more")
    found, options = _read_spec(spec)
    with doing(f"building {spec} over {counted(scene.triangle_count, 'triangle')}"):
        return found(scene, threads=threads, **options)


def check_engine(spec: str) -> None:
    """Raise InputError where `make_engine` would, for what the spec alone tells."""
    _read_spec(spec)


def _read_spec(spec: str) -> tuple[Callable[..., TruthEngine], dict[str, Any]]:
    name, _, rest = spec.partition(":")
    found = load_entry(ENGINES, name, kind="engine")
    if not (isinstance(found, type) and issubclass(found, TruthEngine)):
        raise InputError(
            f"engine '{name}' is not a subclass of visref.engines.base.TruthEngine",
            fix="derive it",
        )
    return found, read_options(spec, found.options, rest)
