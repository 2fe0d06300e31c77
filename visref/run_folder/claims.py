"""A culler's witness files read back, line by line: claims that can be replayed, each checked field
by field against `visref/schemas/witness.json` and against the manifest beside it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Set
from pathlib import Path
from typing import Any

from visref.errors import InputError
from visref.run_folder.checks import check_is_run, check_manifest
from visref.run_folder.facts import FIX, read_cause, read_definition, read_manifest
from visref.run_folder.inside import json_inside, lines_inside, quoted
from visref.run_folder.json_fields import Fields
from visref.run_folder.layout import (
    CLOSE_SIDE,
    MANIFEST,
    MAX_APPEARANCES,
    MAX_CAUSES,
    MISS_KINDS,
    OTHERS,
    SHADES,
    SURROUNDED_CELLS,
    UNNAMED_VIEW,
    WITNESSES,
)
from visref.run_folder.rows import Manifest
from visref.scene import Alpha

# Rays through the densest scenes measured meet some hundred triangles. Replaying takes time by
# the square of their number, and drawing them some milliseconds each.
MAX_TRIANGLES = 4096

# HOLE, SOLID and BETWEEN of `visref.masks.lookup`.
_MAX_MASK = 2


def witnesses_of(
    run: Path, frame: int, target: str, culler: str | None
) -> Iterator[Mapping[str, Any]]:
    """The witnesses of an object, by its id or name, in a frame, of one culler or of all.

    Raises InputError if the folder is no run, and where a line is no witness of it.
    """
    check_is_run(run)
    manifest = read_manifest(json_inside(run, MANIFEST, FIX), str(run / MANIFEST))
    check_manifest(run, manifest)
    for name, facts in sorted(manifest.cullers.items(), key=lambda item: item[1].slug):
        # A culler that missed nothing has no file. A link that leads nowhere is none either.
        file = f"{WITNESSES}/{facts.slug}.jsonl"
        if culler not in (None, name) or not (run / file).exists():
            continue
        for place, value in lines_inside(run, file, FIX):
            witness = Fields(value, f"{run / file}: {place}", FIX)
            same = target in (str(witness.whole("object")), witness.text("object_name"))
            if same and witness.whole("frame") == frame:
                found = read_witness(witness, manifest.version)
                _check(witness, found, name, manifest)
                yield found


def witnesses_about(
    run: Path, manifest: Manifest, culler: str, wanted: Set[tuple[int, str, int]]
) -> dict[tuple[int, str, int], Mapping[str, Any]]:
    """A culler's witnesses, of those `wanted` by frame, view and object.

    Raises InputError where one of them is no witness of the run.
    """
    file = f"{WITNESSES}/{manifest.cullers[culler].slug}.jsonl"
    result: dict[tuple[int, str, int], Mapping[str, Any]] = {}
    if not wanted or not (run / file).exists():
        return result
    for place, value in lines_inside(run, file, FIX):
        witness = Fields(value, f"{run / file}: {place}", FIX)
        view = witness.text("view") if manifest.version >= 2 else UNNAMED_VIEW
        key = witness.whole("frame"), view, witness.whole("object")
        if key in wanted:
            result[key] = read_witness(witness, manifest.version)
            _check(witness, result[key], culler, manifest)
    return result


def read_witness(witness: Fields, version: int = 2) -> dict[str, Any]:
    """A witness as it was written, with `view` and `partly` also where version 1 has neither.
    Raises InputError for what the schema refuses."""
    found = witness.plain()
    for name in ("culler", "object_name"):
        witness.text(name)
    for name in ("frame", "object", "pixels", "owned", "x", "y", "triangle"):
        witness.whole(name)
    witness.text("kind", among=MISS_KINDS)
    witness.number("depth")
    for name in ("margin_px", "margin_depth"):
        if not witness.is_null(name):
            witness.number(name)
    if version >= 2:
        witness.text("view")
        witness.flag("partly")
    else:
        found |= {"view": UNNAMED_VIEW, "partly": False}
    read_definition(witness.inner("samples"))
    triangles = witness.each("triangles")
    if len(triangles) > MAX_TRIANGLES:
        raise witness.error(f"it has more than {MAX_TRIANGLES} triangles", "triangles")
    for triangle in triangles:
        triangle.whole("triangle")
        triangle.whole("object")
        triangle.text("object_name")
        triangle.flag("drawn")
        triangle.flag("one_sided")
        triangle.whole("alpha", most=max(Alpha))
        if triangle.has("mask"):
            triangle.whole("mask", most=_MAX_MASK)
        triangle.hexadecimal_corners("vertices")
    if witness.has("causes"):
        for cause in witness.each("causes", most=MAX_CAUSES):
            read_cause(cause)
    if witness.has("facts"):
        _read_facts(witness.inner("facts"))
    if witness.has("surroundings"):
        _read_surroundings(witness.inner("surroundings"))
    return found


def _read_facts(facts: Fields) -> None:
    """That a witness's plain facts are what they must be; most may be unknown."""
    facts.whole("edge_px")
    facts.number("near")
    for name in ("eye_to_box", "depth_min", "depth_max"):
        if not facts.is_null(name):
            facts.number(name)
    for name in ("age", "gap_px"):
        if not facts.is_null(name):
            facts.whole(name)
    facts.flag("box_too_small")
    if not facts.is_null("in_front"):
        before = facts.inner("in_front")
        before.whole("object")
        before.text("name")


def _read_surroundings(around: Fields) -> None:
    """That a witness's surroundings are of the kind and the size that they must be."""
    for name in ("x", "y"):
        around.whole(name)
    around.whole("step", least=1)
    for name in ("width", "height"):
        around.whole(name, least=1, most=SURROUNDED_CELLS)
    for one in around.each("objects", most=2 * MAX_APPEARANCES):
        one.whole("object")
        one.text("name")
    for one in around.each("appearances", most=MAX_APPEARANCES):
        if not one.is_null("object"):
            one.whole("object", least=OTHERS)
        if not one.is_null("glass"):
            one.whole("glass")
        one.whole("shade", most=SHADES - 1)
        one.flag("lost")
    for name in ("truth", "drawn"):
        around.whole_list(name, most=2 * SURROUNDED_CELLS**2)
    around.whole_list("close", most=2 * CLOSE_SIDE**2)


def _check(witness: Fields, found: Mapping[str, Any], culler: str, manifest: Manifest) -> None:
    """That a witness tells of the culler whose file this is, and of a frame, a view, objects,
    triangles and a sample that there are."""
    frame, view = found["frame"], found["view"]
    if found["culler"] != culler:
        raise witness.error(f"it is {quoted(found['culler'])}, and not {quoted(culler)}", "culler")
    if frame not in manifest.samples:
        raise witness.error(f"frame {frame} is not one of {MANIFEST}", "frame")
    if view not in manifest.samples[frame]:
        raise witness.error(f"view {quoted(view)} is not one of {MANIFEST}", "view")
    if found["samples"] != manifest.samples[frame][view]:
        raise witness.error(f"they are not those of {MANIFEST}", "samples")
    for name, side in (("x", "width"), ("y", "height")):
        if found[name] >= found["samples"][side]:
            raise witness.error("it is not in the image", name)
    for place, one in (
        ("", found),
        *((f"triangles[{i}].", one) for i, one in enumerate(found["triangles"])),
    ):
        for name, count in (("object", "objects"), ("triangle", "triangles")):
            if one[name] >= getattr(manifest.scene, count):
                raise witness.error(f"the scene has no {name} {one[name]}", f"{place}{name}")
    if "surroundings" in found:
        _check_surroundings(witness, found)


def _check_surroundings(witness: Fields, found: Mapping[str, Any]) -> None:
    """That the cells lie in the image, and that each has an appearance."""
    around, one = witness.inner("surroundings"), found["surroundings"]
    for name, side, cells in (("x", "width", one["width"]), ("y", "height", one["height"])):
        if one[name] + one["step"] * (cells - 1) >= found["samples"][side]:
            raise around.error("the cells leave the image", name)
    for name, cells in (
        ("truth", one["width"] * one["height"]),
        ("drawn", one["width"] * one["height"]),
        ("close", CLOSE_SIDE**2),
    ):
        runs = one[name]
        if len(runs) % 2 or sum(runs[::2]) != cells:
            raise around.error(f"its runs are not of {cells} cells", name)
        if max(runs[1::2]) >= len(one["appearances"]):
            raise around.error("it has an appearance that is none of the list", name)


def no_such_witness(run: Path, frame: int, target: str) -> InputError:
    """That nothing of what was asked for is on file."""
    return InputError(
        f"no witness of object {quoted(target)} in frame {frame}",
        source=str(run / WITNESSES),
        fix="objects.parquet lists what was missed; the worst misses have witnesses",
    )
