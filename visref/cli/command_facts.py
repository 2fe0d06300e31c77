"""What determines the result of a run, by name: only a command of which all of it is the same goes
on with what another one left (`visref.kept`)."""

from __future__ import annotations

import argparse
import hashlib
import json
import shlex
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from visref.inputs import Inputs
from visref.judging.policy import Policy
from visref.provenance import code_of, file_digest, versions
from visref.recordings.truth_file import path_digest
from visref.registry import CULLERS, available

_OURS = ("visref", "visref_culling")


def facts_of(
    given: argparse.Namespace,
    inputs: Inputs,
    policy: Policy | None,
    *,
    cullers: Sequence[str] = (),
    programs: Sequence[str] = (),
    files: Mapping[str, Path | None],
    options: Mapping[str, object],
) -> dict[str, str]:
    """By name in words, of a `run` or a `check` with these arguments. `cullers`: specs; `programs`:
    command lines; `files`: what else is read, by what it is; `options`: what else was asked."""
    facts = {
        "scene": inputs.scene.digest,
        "path": path_digest(inputs.path),
        "frames": _text_digest([int(frame) for frame in inputs.frames]),
        "engine": inputs.engine,
        "settings": _text_digest(inputs.settings),
        "policy": "" if policy is None else _policy(policy),
        "versions": _text_digest(versions()),
        "cullers": json.dumps([*cullers, *programs]),
        **{f"{name} file": file_digest(file) for name, file in files.items() if file is not None},
        **{name: str(value) for name, value in options.items()},
    }
    for name in packages_of(cullers):
        facts[f"code of {name}"] = code_of(name)
    for program in programs:
        for file in _files_of(program):
            facts[f"file {file}"] = file_digest(file)
    # Limits that were not given are those of the moment.
    for limit in ("time_limit", "max_memory"):
        facts[limit.replace("_", " ")] = str(getattr(given, limit, None))
    return facts


def packages_of(cullers: Iterable[str]) -> list[str]:
    """Whose code a run with these cullers, by spec, hangs on."""
    return list(dict.fromkeys([*_OURS, *filter(None, map(_package, cullers))]))


def _policy(policy: Policy) -> str:
    """On which day it is asked, is no other command."""
    said = policy.to_json()
    return _text_digest({name: said[name] for name in said if name not in ("today", "source")})


def _package(spec: str) -> str:
    """The outermost package that a culler's spec names."""
    name = spec.partition(":")[0]
    points = available(CULLERS)
    module = points[name].value.partition(":")[0] if name in points else name
    return module.partition(".")[0]


def _files_of(program: str) -> Iterable[Path]:
    """The files that a command line names, its program's among them."""
    words: list[str] = []
    with suppress(ValueError):
        words = shlex.split(program)
    for word in words:
        if (file := Path(word)).is_file():
            yield file


def _text_digest(value: object) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=str).encode()).hexdigest()
