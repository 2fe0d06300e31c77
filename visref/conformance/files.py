"""The suite as files, for engines in any language: of each case a scene, a path and, where it is
about clusters, which triangles are one.

    manifest.json     the cases: what each is built around, its classes, its files' digests
    expected.json     who is visible: for people to look up, and for no engine to read
    CASE/scene.glb    CASE/path.json    CASE/units.csv

The files are the cases: what is judged is read back from them. The same seed and the same version
of visref write the same bytes.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
import re
import reprlib
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from importlib.metadata import version
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from visref.camera_path import CameraPath
from visref.conformance.building import Case, SceneMaker, clusters
from visref.conformance.classes import CLASSES, classes_of
from visref.conformance.glb import Growth, glb_of
from visref.conformance.moving import Bending
from visref.conformance.scenes import SCENES
from visref.conformance.suite import built_of, exact_truths
from visref.errors import InputError
from visref.files import FolderKind, map_file, parse_json, replacing_folder
from visref.formats import load_scene
from visref.recordings.names import shown_name
from visref.scene import Scene, Units
from visref.timeline import Timeline
from visref.visibility import FrameTruth, objects_seen

FORMAT, VERSION = "visref-conformance", 1
MANIFEST, EXPECTED = "manifest.json", "expected.json"
SCENE, PATH, UNITS = "scene.glb", "path.json", "units.csv"
UNIT_COLUMNS = ("unit", "object", "first_triangle", "triangle_count")


@dataclass(frozen=True, eq=False)
class WrittenCase:
    """A case as its files have it. `files`: name to bytes. `scene`, `path` and `units` are read
    back from these; one-sided surfaces are so in `scene`, as with `--cull-backfaces`."""

    made: SceneMaker
    files: Mapping[str, bytes]
    scene: Scene
    path: CameraPath
    units: Units | None

    @property
    def name(self) -> str:
        return self.made.name

    @cached_property
    def classes(self) -> tuple[str, ...]:
        return classes_of(self.scene, self.path, self.units)

    @cached_property
    def case(self) -> Case:
        """For the judge: the path relative to the scene's origin."""
        return Case(self.scene, self.path.relative_to(self.scene.origin), self.units)

    @cached_property
    def truths(self) -> tuple[FrameTruth, ...]:
        """The exact truth of each view of each frame."""
        return exact_truths(self.case)


def written_cases(seed: int = 0) -> list[WrittenCase]:
    """Every case that files can say, in the catalogue's order: all but the scene without objects,
    which no file can."""
    return [_written(made, seed) for made in SCENES if built_of(made, seed).scene.object_count]


@lru_cache(maxsize=256)
def _written(made: SceneMaker, seed: int) -> WrittenCase:
    built = built_of(made, seed)
    motion = None if built.scene.rig is None else built.scene.rig.motion
    growth = None
    if isinstance(motion, Bending):
        last = max(frame.time_s or 0.0 for frame in built.path.frames)
        seconds = np.arange(int(np.ceil(last)) + 1, dtype=np.float32)
        moves = {index: grown[None] for index, grown in motion.grown.items()}
        growth = Growth(moves, seconds[:, None], motion.clips[0])
    files = {
        SCENE: glb_of(built.scene, growth),
        PATH: _json(built.path.to_json()),
    }
    if built.units is not None:
        files[UNITS] = units_csv(built.scene, built.units)
    with tempfile.TemporaryDirectory(prefix="visref-case-") as folder:
        file = Path(folder) / SCENE
        file.write_bytes(files[SCENE])
        scene = load_scene(file, cull_backfaces=True)
    # Messages name what was written, not where it was read back.
    scene = replace(scene, source=f"{made.name}/{SCENE}")
    path = CameraPath.from_json(parse_json(files[PATH]), source=f"{made.name}/{PATH}")
    units = None if built.units is None else _units_back(files[UNITS], scene)
    return WrittenCase(made, files, scene, path, units)


def _json(value: Any) -> bytes:
    return (json.dumps(value, indent=1, ensure_ascii=True, allow_nan=False) + "\n").encode()


def _runs(scene: Scene, triangles: Sequence[int]) -> Iterator[tuple[int, int, int]]:
    """Object, first triangle in it, and how many, of each run of a list of triangle ids."""
    owner = scene.object_of_triangle
    numbered = [(int(owner[t]), t - at, t) for at, t in enumerate(triangles)]
    for (index, _), run in groupby(numbered, key=lambda row: row[:2]):
        members = [t for _, _, t in run]
        yield index, members[0] - int(scene.object_offsets[index]), len(members)


def units_csv(scene: Scene, units: Units) -> bytes:
    """Units as a table that a recording names (`visref.recordings.units`)."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(UNIT_COLUMNS)
    for unit in range(units.count):
        members = units.triangles[units.offsets[unit] : units.offsets[unit + 1]].tolist()
        rows.writerows((unit, *run) for run in _runs(scene, members))
    return text.getvalue().encode()


def _units_back(data: bytes, scene: Scene) -> Units:
    """The units that a file of ours says."""
    parts: dict[int, list[int]] = {}
    for row in csv.DictReader(io.StringIO(data.decode())):
        unit, index, first, count = (int(row[name]) for name in UNIT_COLUMNS)
        start = int(scene.object_offsets[index]) + first
        parts.setdefault(unit, []).extend(range(start, start + count))
    return clusters(scene, [parts[unit] for unit in range(len(parts))])


# The folder.


def _wrote(record: Any) -> Sequence[str] | None:
    """Of a manifest, patterns of all files that visref writes into its folder."""
    if not isinstance(record, dict) or record.get("format") != FORMAT:
        return None
    listed = record.get("cases")
    names = [one.get("name") for one in listed or () if isinstance(one, dict)]
    good = [name for name in names if isinstance(name, str) and re.fullmatch(r"\w+", name)]
    files = "|".join(map(re.escape, (SCENE, PATH, UNITS)))
    return [
        *(f"{name}/({files})" for name in good),
        *map(re.escape, (MANIFEST, EXPECTED)),
    ]


SUITE_FOLDER = FolderKind(MANIFEST, _wrote)


def write_suite(folder: Path | str, seed: int = 0) -> int:
    """Write the suite; an older one of ours is replaced. Returns how many cases it has. Raises
    InputError where something else stands there."""
    cases = written_cases(seed)
    with replacing_folder(folder, kind=SUITE_FOLDER) as inside:
        for case in cases:
            (inside / case.name).mkdir(parents=True)
            for name, data in case.files.items():
                (inside / case.name / name).write_bytes(data)
        (inside / EXPECTED).write_bytes(_json(_expected(cases, seed)))
        (inside / MANIFEST).write_bytes(_json(manifest_of(cases, seed)))
    return len(cases)


def manifest_of(cases: Sequence[WrittenCase], seed: int) -> dict[str, Any]:
    """What `manifest.json` holds."""
    return {
        "format": FORMAT,
        "version": VERSION,
        "visref": version("visref"),
        "seed": seed,
        "classes": CLASSES,
        "cases": [
            {
                "name": case.name,
                "claim": case.made.claim,
                "trap": case.made.trap,
                "classes": list(case.classes),
                "frames": len(case.path),
                "objects": case.scene.object_count,
                "units": None if case.units is None else case.units.count,
                "scene": f"{case.name}/{SCENE}",
                "path": f"{case.name}/{PATH}",
                "units_file": None if case.units is None else f"{case.name}/{UNITS}",
                "sha256": {
                    name: hashlib.sha256(data).hexdigest() for name, data in case.files.items()
                },
            }
            for case in cases
        ],
    }


def _expected(cases: Sequence[WrittenCase], seed: int) -> dict[str, Any]:
    return {
        "format": "visref-conformance-expected",
        "version": VERSION,
        "seed": seed,
        "cases": {case.name: list(_expected_of(case)) for case in cases},
    }


def _expected_of(case: WrittenCase) -> Iterator[dict[str, Any]]:
    """Of each view of each frame: the objects that own samples, and how many (a sample that is
    tied counts for each); those that an alpha mask may show; and the clusters that own samples."""
    timeline = Timeline(case.scene, case.case.path)
    truths = iter(case.truths)
    names = case.scene.names
    for number, frame in enumerate(case.path.frames):
        for camera in frame.cameras:
            truth, scene = next(truths), timeline.at(number)
            samples = objects_seen(truth, scene).samples
            perhaps = np.unique(scene.object_of_triangle[truth.doubt.triangle])
            row: dict[str, Any] = {
                "frame": number,
                "visible": {names[k]: int(samples[k]) for k in np.flatnonzero(samples)},
                "perhaps": [names[k] for k in perhaps if not samples[k]],
            }
            if camera.view:
                row["view"] = camera.view
            if case.units is not None:
                owners = np.union1d(truth.buffer.triangle, truth.ties.triangle)
                seen = np.zeros(scene.triangle_count, np.bool_)
                seen[owners[owners >= 0]] = True
                spans = zip(case.units.offsets[:-1], case.units.offsets[1:], strict=True)
                row["visible_units"] = [
                    unit
                    for unit, (a, b) in enumerate(spans)
                    if seen[case.units.triangles[a:b]].any()
                ]
            yield row


# Reading a manifest back.


def check_manifest(file: Path, seed: int | None) -> int:
    """The seed of a suite that this visref wrote, from its manifest. Raises InputError where that
    is none, is of another version, was written with another seed than the one asked for, or lists
    other files than this visref writes."""
    source = str(file)
    fix = "write the suite anew with `visref conformance --write`"
    try:
        found = parse_json(map_file(file).tobytes())
    except InputError as error:
        raise error.at(source=source) from error
    if not isinstance(found, dict) or found.get("format") != FORMAT:
        raise InputError(f"this is no manifest of a suite ({FORMAT})", source=source, fix=fix)
    if found.get("version") != VERSION or isinstance(found.get("version"), bool):
        raise InputError(
            f"version {reprlib.repr(found.get('version'))} is not known",
            source=source,
            place="version",
            fix=f"this visref reads version {VERSION}",
        )
    wrote = found.get("seed")
    if not isinstance(wrote, int) or isinstance(wrote, bool) or wrote < 0:
        raise InputError("its seed is no whole number", source=source, place="seed", fix=fix)
    if seed is not None and wrote != seed:
        raise InputError(
            f"the suite was written with seed {wrote}, and {seed} was asked for",
            source=source,
            place="seed",
            fix=f"give --seed {wrote}, or write the suite anew",
        )
    listed = found.get("cases")
    theirs: dict[str, Any] = {
        one["name"]: one.get("sha256")
        for one in (listed if isinstance(listed, list) else [])
        if isinstance(one, dict) and isinstance(one.get("name"), str)
    }
    ours = {one["name"]: one["sha256"] for one in manifest_of(written_cases(wrote), wrote)["cases"]}
    if theirs != ours:
        differ = sorted(
            name for name in theirs.keys() | ours.keys() if theirs.get(name) != ours.get(name)
        )
        raise InputError(
            f"its case {shown_name(differ[0])} is not the one of visref {version('visref')}",
            source=source,
            place="cases",
            fix=fix,
        )
    return wrote


def check_suite(folder: Path, seed: int | None) -> int:
    """As `check_manifest`, of a whole folder: its files, too, are those that this visref writes."""
    wrote = check_manifest(folder / MANIFEST, seed)
    for case in written_cases(wrote):
        for name, data in case.files.items():
            file = folder / case.name / name
            try:
                same = map_file(file).tobytes() == data
            except InputError as error:
                raise error.at(source=str(file)) from error
            if not same:
                raise InputError(
                    "the file is not as it was written",
                    source=str(file),
                    fix="write the suite anew, and record it again",
                )
    return wrote
