"""What a batch's file asks for: TOML, read into jobs. `docs/cluster.md` says what each field means.

What is refused here is what the schema `batch` in `visref.schemas` refuses, and besides what a
schema cannot tell: two jobs of one name.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from visref.errors import InputError
from visref.files import read_toml
from visref.wording import did_you_mean

FIX = "see docs/cluster.md"
_MOST_BYTES = 1 << 24
# Of job names, which are folder names.
_NAME = re.compile("[A-Za-z0-9][A-Za-z0-9._-]{0,99}")
_LONGEST = 80
# Of a file's name, what says its format.
_ENDING = re.compile(r"(\.path)?\.[A-Za-z][A-Za-z0-9]{1,5}$")

# Options of `visref run`, by the name of the field, and what its value is.
OPTIONS: Mapping[str, type] = {
    "engine": str,
    "frames": str,
    "max_memory": str,
    "policy": str,
    "today": str,
    "truth": str,
    "pictures": int,
    "repeat": int,
    "time_limit": float,
    "cull_backfaces": bool,
    "fragments": bool,
    "image_check": bool,
    "lenient": bool,
    "rest_pose": bool,
    "superfluous_rows": bool,
}
_SAID = {str: "a text", int: "a whole number", float: "a number", bool: "true or false"}
# Of one scene and path.
_OWN = ("truth",)


@dataclass(frozen=True)
class Job:
    """A run: cullers, by spec, on a scene and a path (None: the scene's own). `options`: of
    `visref run`, as on its command line."""

    name: str
    scene: str
    path: str | None
    cullers: tuple[str, ...]
    options: tuple[str, ...] = ()

    @property
    def arguments(self) -> list[str]:
        """Of `visref run`, but for what is the same for all jobs of a batch."""
        path = [] if self.path is None else [f"--path={self.path}"]
        cullers = [f"--culler={culler}" for culler in self.cullers]
        # What begins with a dash is a file's name here, and no option.
        return [*path, *cullers, *self.options, "--", self.scene]


def read_batch(file: Path | str) -> list[Job]:
    """The jobs in a TOML file, in its order: those of [[job]], then those of [[matrix]]. Raises
    InputError naming the file and the place in it."""
    try:
        return jobs_of(read_toml(Path(file), _MOST_BYTES, "a batch")[1])
    except InputError as error:
        raise error.at(source=str(file)) from error


def jobs_of(value: object) -> list[Job]:
    """The jobs from parsed TOML, or JSON. Raises InputError naming the place."""
    if not isinstance(value, dict):
        raise InputError("this is no table", fix=FIX)
    _check_names(value, ("options", "job", "matrix"), "")
    shared = value.get("options", {})
    if not isinstance(shared, dict):
        raise InputError("it is no table: write [options]", place="options", fix=FIX)
    _check_names(shared, [name for name in OPTIONS if name not in _OWN], "options")
    _check_options(shared, "options")
    found: list[tuple[str, Job]] = []
    for kind, read in (("job", _one), ("matrix", _product)):
        tables = value.get(kind, [])
        if not isinstance(tables, list) or not all(isinstance(one, dict) for one in tables):
            raise InputError(f"it is no list of tables: write [[{kind}]]", place=kind, fix=FIX)
        for number, table in enumerate(tables):
            place = f"{kind}[{number}]"
            found += [(place, job) for job in read(table, shared, place)]
    if not found:
        raise InputError("it asks for nothing", fix="write [[job]] or [[matrix]]")
    return _named(found)


def _one(table: Mapping[str, Any], shared: Mapping[str, Any], place: str) -> Iterator[Job]:
    _check_names(table, ("name", "scene", "path", "cullers", *OPTIONS), place)
    _check_options(table, place)
    name = table.get("name", "")
    if "name" in table and not (isinstance(name, str) and _NAME.fullmatch(name)):
        raise InputError(
            "it is no name", place=f"{place}.name",
            fix="write letters, digits, dots, dashes and underscores, 100 at most",
        )  # fmt: skip
    path = None if "path" not in table else _text(table, "path", place)
    cullers = _texts(table, "cullers", place)
    yield Job(name, _text(table, "scene", place), path, cullers, _options(shared, table))


def _product(table: Mapping[str, Any], shared: Mapping[str, Any], place: str) -> Iterator[Job]:
    own = [name for name in OPTIONS if name not in _OWN]
    _check_names(table, ("scenes", "paths", "cullers", *own), place)
    _check_options(table, place)
    scenes, cullers = _texts(table, "scenes", place), _texts(table, "cullers", place)
    paths: Sequence[str | None] = [None]
    if "paths" in table:
        paths = _texts(table, "paths", place)
    options = _options(shared, table)
    for scene in scenes:
        for path in paths:
            yield Job("", scene, path, cullers, options)


def _named(found: Sequence[tuple[str, Job]]) -> list[Job]:
    """Each with a name of its own: those that are given, and for others one of scene and path."""
    taken = Counter(job.name for _, job in found if job.name)
    for place, job in found:
        if taken[job.name] > 1:
            raise InputError(
                f"two jobs are named '{job.name}'", place=f"{place}.name", fix="name them apart"
            )
    short = Counter(_likeness(job, whole=False) for _, job in found if not job.name)
    names = {*taken}
    jobs = []
    for _, job in found:
        name = job.name
        if not name:
            base = _likeness(job, whole=False)
            if short[base] > 1:
                base = _likeness(job, whole=True)
            name, number = base, 1
            while name in names:
                number += 1
                name = f"{base}-{number}"
            names.add(name)
        jobs.append(replace(job, name=name))
    return jobs


def _likeness(job: Job, *, whole: bool) -> str:
    """A name like scene and path: like their files', or with the folders that they are in."""
    texts = [_ENDING.sub("", text) for text in (job.scene, job.path) if text]
    if not whole:
        texts = [text.rpartition("/")[2] for text in texts]
    plain = re.sub("[^A-Za-z0-9._-]+", "-", "-".join(texts)).strip("-.")
    return plain[:_LONGEST] or "job"


def _options(shared: Mapping[str, Any], own: Mapping[str, Any]) -> tuple[str, ...]:
    """On the command line of `visref run`; a job's own before those of all."""
    said = {name: own.get(name, shared.get(name)) for name in OPTIONS}
    found = []
    for name, value in said.items():
        option = f"--{name.replace('_', '-')}"
        if value is True:
            found.append(option)
        elif value is not None and value is not False:
            found.append(f"{option}={value}")
    return tuple(found)


def _check_names(table: Mapping[str, Any], known: Sequence[str], place: str) -> None:
    for name in table:
        if name not in known:
            at = f"{place}.{name}" if place else name
            raise InputError("nobody knows this field", place=at, fix=did_you_mean(name, known))


def _check_options(table: Mapping[str, Any], place: str) -> None:
    for name, value in table.items():
        kind = OPTIONS.get(name)
        if kind is None:
            continue
        wanted = (int, float) if kind is float else kind
        if not isinstance(value, wanted) or (isinstance(value, bool) and kind is not bool):
            raise InputError(f"it is not {_SAID[kind]}", place=f"{place}.{name}", fix=FIX)


def _text(table: Mapping[str, Any], name: str, place: str) -> str:
    value = table.get(name)
    if not isinstance(value, str) or not value:
        problem = "it is missing" if value is None else "it is no text"
        raise InputError(problem, place=f"{place}.{name}", fix=FIX)
    return value


def _texts(table: Mapping[str, Any], name: str, place: str) -> tuple[str, ...]:
    value = table.get(name)
    if not isinstance(value, list) or not value:
        problem = "it is missing" if value is None else "it is no list of texts, or empty"
        raise InputError(problem, place=f"{place}.{name}", fix=FIX)
    for number, one in enumerate(value):
        if not isinstance(one, str) or not one:
            raise InputError("it is no text", place=f"{place}.{name}[{number}]", fix=FIX)
    if len({*value}) < len(value):
        twice = next(one for one in value if value.count(one) > 1)
        raise InputError(f"'{twice}' is in it twice", place=f"{place}.{name}", fix="leave one out")
    return tuple(value)
