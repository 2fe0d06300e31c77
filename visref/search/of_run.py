"""A run's miss as a case: what was judged is opened again, and the culler asked again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.compute as pc
from numpy.typing import NDArray

from visref.culler import Promise
from visref.errors import InputError
from visref.inputs import Inputs, open_inputs, open_recorded
from visref.judging.causes import CODES
from visref.masks.store import Masks
from visref.recordings.truth_file import path_digest
from visref.run_folder.layout import ObjectKind
from visref.run_folder.read import RunFolder, read_run
from visref.scene import Alpha, Scene
from visref.search import edits
from visref.search.case import Case
from visref.search.holding import Holding, Wanted

RECORDING_ENDS = ".jsonl"
_FIX = "run it again, and shrink that"


@dataclass(frozen=True, eq=False)
class Judged:
    """A run, opened again: its `inputs`; the frames up to the one that is asked about, `frames`, by
    number, as they were judged; and what was done there to which object."""

    run: RunFolder
    inputs: Inputs
    frames: Sequence[int]
    wanted: Wanted

    def case(self, last: int) -> Case:
        """The last so many of the frames as a case. Raises InputError where no file says it."""
        inputs = self.inputs
        case = Case.of(
            inputs.scene,
            inputs.path,
            self.frames[-last:],
            rest_pose=inputs.rest_pose,
            cull_backfaces=bool(inputs.settings["cull_backfaces"]),
        )
        return _sayable(case)


def open_run(folder: Path, frame: int, target: str, culler: str) -> Judged:
    """What a run judged, and that its culler `culler`, if it is one of the run's, or else any, lost
    the object `target`, an id or a name, in a frame, or drew it for nothing against its promise;
    with the cause that the run names of its own culler, if it names one.

    Raises InputError where it did not, where the scene or the path are not what they were, and for
    anything wrong with the folder.
    """
    run = read_run(folder)
    if frame not in run.frame_numbers:
        raise InputError(
            f"frame {frame} was not judged",
            source=str(folder),
            fix=f"give one of its {len(run.frame_numbers)} frames, from {run.frame_numbers[0]} to "
            f"{run.frame_numbers[-1]}" if run.frame_numbers else "judge it first",
        )  # fmt: skip
    inputs = _inputs(run)
    index = _object(inputs.scene, target, str(folder))
    wanted = _wanted(run, frame, index, inputs.scene.names[index], culler)
    frames = [number for number in run.frame_numbers if number <= frame]
    return Judged(run, inputs, frames, wanted)


def starting_case(judged: Judged, holding: Holding) -> Case:
    """The case with the fewest frames before the one that is asked about, of 0, 1, 3, 7, … and
    all, that shows what is wanted; a cause that is not firm is dropped where it is not named there.
    Raises InputError where none does."""
    count = len(judged.frames)
    lengths = [2**k for k in range(count.bit_length()) if 2**k < count]
    named: set[str] = set()
    shows = False
    for length in [*lengths, count]:
        case = judged.case(length)
        if holding.starts(case):
            return case
        named |= {cause for one in holding.shown(case) for cause in one.causes}
        shows |= bool(holding.shown(case))
    if shows:
        raise InputError(
            f"object '{judged.wanted.name}' is not missed by the cause '{holding.wanted.cause}' in "
            f"frame {judged.frames[-1]}",
            source=str(judged.run.folder),
            fix=f"give one that is named there: {', '.join(sorted(named))}"
            if named
            else "leave --cause out: none is named there",
        )
    what = "leave it out" if judged.wanted.left_out else "draw it for nothing"
    raise InputError(
        f"'{holding.suspect.name}' does not {what} any more: object '{judged.wanted.name}', frame "
        f"{judged.frames[-1]}",
        source=str(judged.run.folder),
        fix=_FIX,
    )


def _inputs(run: RunFolder) -> Inputs:
    """The scene and the path of a run, opened as they were, with each material's own sides."""
    manifest, source = run.manifest, str(run.folder)
    settings = manifest.settings
    scene, path = manifest.scene.source, manifest.path.source
    options: dict[str, Any] = {
        "engine": manifest.engine,
        "lenient": bool(settings.get("lenient")),
        "rest_pose": bool(settings.get("rest_pose")),
    }

    def opened(cull_backfaces: bool) -> Inputs:
        if Path(path).suffix == RECORDING_ENDS:
            return open_recorded(scene, path, cull_backfaces=cull_backfaces, **options)[0]
        return open_inputs(
            scene,
            path=None if path == scene else path,
            cull_backfaces=cull_backfaces,
            **options,
        )

    culls = bool(settings.get("cull_backfaces"))
    inputs = opened(culls)
    for kind, digest, file, recorded in (
        ("scene", inputs.scene.digest, scene, manifest.scene.sha256),
        ("path", path_digest(inputs.path), path, manifest.path.sha256),
    ):
        if digest != recorded:
            raise InputError(
                f"the {kind} '{file}' is not the one that was judged", source=source, fix=_FIX
            )
    if not culls:
        # What other programs read of a material is carried along.
        sided = opened(True)
        inputs = Inputs(
            sided.scene, inputs.path, inputs.frames, inputs.engine, inputs.threads,
            inputs.settings, inputs.notes, inputs.max_memory, inputs.rest_pose,
        )  # fmt: skip
    return inputs


def _object(scene: Scene, target: str, source: str) -> int:
    if target in scene.id_of_name:
        return scene.id_of_name[target]
    if target.isascii() and target.isdigit() and int(target) < scene.object_count:
        return int(target)
    raise InputError(
        f"the scene has no object '{target}'",
        source=source,
        fix="`visref objects SCENE` lists its ids and names",
    )


# Why a miss that was found is no violation.
_NO_VIOLATION = {
    ObjectKind.TIE: "what it is tied with was drawn",
    ObjectKind.WITHIN_RASTER: "the tolerance of its rasteriser excuses it",
    ObjectKind.SMALL: "the run's policy takes it for small",
    ObjectKind.LATE: "the run's policy takes it for late",
    ObjectKind.WAIVED: "the run's policy waives it",
    ObjectKind.UNDECIDED: "whether it is visible is undecided",
    ObjectKind.SUPERFLUOUS: "its promise allows to draw what is hidden",
}


def _wanted(run: RunFolder, frame: int, index: int, name: str, culler: str) -> Wanted:
    """What was done to an object in a frame, from the run's table. Raises InputError where nothing
    was that a promise forbids."""
    table, source = run.objects, str(run.folder)
    mine = pc.equal(table["frame"], frame)
    if culler in run.cullers:
        mine = pc.and_(mine, pc.equal(table["culler"], culler))
    of_object = pc.or_kleene(pc.equal(table["object"], index), pc.equal(table["name"], name))
    kinds = table.filter(pc.and_kleene(mine, of_object))
    kinds = kinds.select(["kind", "samples", "cause"]).to_pylist()
    found = {ObjectKind(row["kind"]) for row in kinds}
    promises = [
        Promise(facts.promise)
        for one, facts in run.manifest.cullers.items()
        if one == culler or culler not in run.cullers
    ]
    if ObjectKind.CONFIRMED in found:
        if not any(promise.convicts for promise in promises):
            raise InputError(
                f"'{name}' was missed in frame {frame}, and the promise allows it",
                source=source,
                fix="name a culler that promises to miss nothing",
            )
        causes = [row["cause"] for row in kinds if row["kind"] == ObjectKind.CONFIRMED]
        own = culler in run.cullers and causes[0] in CODES
        return Wanted(name, left_out=True, cause=causes[0] if own else "")
    if any(row["samples"] is not None for row in kinds):
        return Wanted(name, left_out=False)
    # Units finer than objects have no name in the table.
    unnamed = table.filter(pc.and_kleene(mine, pc.is_null(table["name"])))
    if any(row is not None for row in unnamed["samples"].to_pylist()):
        return Wanted(name, left_out=False)
    why = "; ".join(
        _NO_VIOLATION[kind] for kind in ObjectKind if kind in found & set(_NO_VIOLATION)
    )
    raise InputError(
        f"object '{name}' is not lost in frame {frame}" + (f": {why}" if why else ""),
        source=source,
        fix="`visref report RUN --out PAGE` lists what is lost",
    )


def _sayable(case: Case) -> Case:
    """The case, or one without the masks that no file says. Raises InputError where that is not
    enough."""
    try:
        case.files()
    except InputError:
        scene = case.scene
        bad = (scene.alpha == Alpha.MASK) & ~_looked_up(scene.masks, scene.triangle_count)
        if not bad.any():
            raise
        names = {scene.names[i] for i in scene.object_of_triangle[bad].tolist()}
        case = edits.opaque(case, names)
        case.files()
    return case


def _looked_up(masks: Masks | None, count: int) -> NDArray[np.bool_]:
    """(t,) bool, the triangles whose mask a GLB file can hold: with a texture of 8 bits, and
    coordinates that float32 holds."""
    result = np.zeros(count, np.bool_)
    if masks is None:
        return result
    arrays = masks.arrays
    own = np.flatnonzero(masks.row >= 0)
    rows = arrays.triangles[masks.row[own]]
    of = arrays.materials[rows["material"]]
    good = ~of["unknown"] & (of["texture"] >= 0)
    if len(arrays.textures):
        good &= arrays.textures["scale"][np.maximum(of["texture"], 0)] == 255
    for name in ("uv", "vertex_alpha"):
        same = rows[name].astype(np.float32) == rows[name]
        good &= same.reshape(len(own), -1).all(axis=1)
    result[own] = good
    return result
