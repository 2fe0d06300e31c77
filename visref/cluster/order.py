"""What a worker is given besides the frames that it is to judge."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from visref.inputs import Inputs
from visref.shares import MakingAnew

# Reads the inputs where it is called.
Opening = Callable[[], Inputs]


@dataclass(frozen=True, eq=False)
class Order:
    """A run, as a worker is told of it. It can be pickled, if `inputs` and `anew` can.

    `inputs`: as they are, or how a worker reads them; `scene`, `path` and `frames` say which ones
    they must be, `versions` and `code` (digests by package) by what. `asked`: what else is asked,
    as `visref.shares.Asked` has it, but for `truth`, which is a file, and `truth_bytes`, what it
    holds where a worker cannot be expected to have it. `folder`: what relative paths start from.
    `threads`: None for those that the worker has. `key`: another one for each run.
    """

    key: str
    inputs: Inputs | Opening
    anew: MakingAnew
    scene: str
    path: str
    frames: tuple[int, ...]
    versions: Mapping[str, str]
    code: Mapping[str, str]
    folder: str
    asked: Mapping[str, Any] = field(default_factory=dict)
    truth: Path | None = None
    truth_bytes: bytes | None = None
    threads: int | None = None
