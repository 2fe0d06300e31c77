"""Replaying a witness from the run folder alone: the ray, what lies along it, the decision.

The scene is not needed: a witness holds its ray's definition and the triangles along it as
hexadecimal floats, and exact arithmetic orders them again.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from visref.errors import InputError
from visref.exact.ray import Ray, RayHit, along_ray
from visref.files import replacing_file
from visref.masks.lookup import BETWEEN, HOLE, SOLID
from visref.run_folder.claims import no_such_witness, witnesses_of
from visref.run_folder.layout import WITNESSES, explained_name
from visref.run_folder.miss_facts import facts_text
from visref.run_folder.panels import composed, panels
from visref.scene import Alpha, Float64

# The picture shows this many pixels around the sample, each this many picture pixels wide.
AROUND_PX = 3
MAGNIFICATION = 64

# Okabe and Ito's palette, as in the reports: vermilion for what is missing.
_MISSING = (213, 94, 0)
_OTHERS = ((86, 180, 233), (230, 159, 0), (0, 158, 115), (240, 228, 66), (204, 121, 167))
_BACKGROUND = (236, 236, 232)

# How every PNG begins: what is none is no earlier picture.
_PNG = b"\x89PNG\r\n\x1a\n"


@dataclass(frozen=True)
class Explanation:
    """A witness, replayed.

    `hits`: every triangle along the ray that covers the sample in range, in exact order of
    depth. `holds`: the object is among the nearest hits that are certain (or, blended, before
    all that may be opaque), and no drawn triangle is among them or before them. `lines`: all
    of it in words.
    """

    witness: Mapping[str, Any]
    hits: tuple[RayHit, ...]
    holds: bool
    lines: tuple[str, ...]


def explain(run: Path, frame: int, target: str, culler: str | None = None) -> list[Explanation]:
    """The witnesses of one object in one frame, one for each culler that missed it.

    `target` is an object id or name. Raises InputError if the folder is no run, or records no
    such witness.
    """
    found = [_replay(witness) for witness in witnesses_of(run, frame, target, culler)]
    if not found:
        raise no_such_witness(run, frame, target)
    return found


def picture_beside(run: Path, witness: Mapping[str, Any]) -> Path:
    """Where the picture of a witness stands in its run folder, by a name of ours. Raises
    InputError if a link is in its place, or on the way to it."""
    folder = run / WITNESSES
    name = explained_name(witness["culler"], witness["frame"], witness["view"], witness["object"])
    for place in (folder, folder / name):
        if place.is_symlink():
            raise InputError("it is a link", source=str(place), fix="give --picture FILE.png")
    return folder / name


def _replay(witness: Mapping[str, Any]) -> Explanation:
    """What exact arithmetic says of a witness that was checked."""
    triangles = witness["triangles"]
    corners = np.array(
        [[[float.fromhex(v) for v in p] for p in t["vertices"]] for t in triangles], np.float32
    ).reshape(-1, 3, 3)
    ray = Ray.from_definition(witness["samples"], witness["x"], witness["y"])
    sides = np.array([t["one_sided"] for t in triangles], np.bool_)
    hits = tuple(along_ray(ray, corners, sides))
    return Explanation(witness, hits, _holds(witness, hits), tuple(_tell(witness, ray, hits)))


def _holds(witness: Mapping[str, Any], hits: tuple[RayHit, ...]) -> bool:
    triangles, obj = witness["triangles"], witness["object"]
    certain: list[RayHit] = []
    open_: list[RayHit] = []
    for hit in hits:
        triangle = triangles[hit.triangle]
        # A mask that is not told is in between.
        mask = triangle.get("mask", BETWEEN) if triangle["alpha"] == Alpha.MASK else SOLID
        if triangle["alpha"] != Alpha.BLEND and mask != HOLE:
            (certain if mask == SOLID else open_).append(hit)
    nearest = min((hit.order for hit in certain), default=math.inf)
    before = [hit for hit in open_ if hit.order <= nearest]
    claimed = next((t for t in triangles if t["triangle"] == witness["triangle"]), None)
    if claimed is None:
        return False
    if claimed["alpha"] == Alpha.BLEND:
        first = min((hit.order for hit in before), default=nearest)
        glass = [
            triangles[hit.triangle]
            for hit in hits
            if triangles[hit.triangle]["alpha"] == Alpha.BLEND and hit.order < first
        ]
        mine = [t for t in glass if t["object"] == obj]
        return claimed in mine and not any(t["drawn"] for t in mine)
    owners = [triangles[hit.triangle] for hit in certain if hit.order == nearest]
    mine = [t for t in owners if t["object"] == obj]
    if witness["kind"] == "tie":
        return bool(mine) and not any(t["drawn"] for t in mine)
    shown = owners + [triangles[hit.triangle] for hit in before]
    return bool(mine) and not any(t["drawn"] for t in shown)


def _masked(triangle: Mapping[str, Any]) -> list[str]:
    words = {SOLID: "masked, solid", HOLE: "masked, a hole", BETWEEN: "masked, in between"}
    return [words.get(triangle.get("mask", BETWEEN), "masked")]


def _tell(witness: Mapping[str, Any], ray: Ray, hits: tuple[RayHit, ...]) -> Iterator[str]:
    triangles = witness["triangles"]
    missed = "partly missed" if witness.get("partly") else "missed"
    yield (
        f"object {witness['object']} '{witness['object_name']}', frame {witness['frame']}, "
        f"pixel ({witness['x']}, {witness['y']}), {missed} by {witness['culler']}"
    )
    kind = witness["kind"].replace("_", " ")
    yield f"  {kind}: {witness['pixels']} of its {witness['owned']} samples lost"
    if causes := [cause["text"] for cause in witness.get("causes", ())]:
        yield f"  why: {'; or '.join(causes)}"
    if facts := facts_text(witness.get("facts", {})):
        yield f"  {facts}"
    a, b = float(ray.column_a[0]), float(ray.row_b[0])
    form = "e + t (F + a R + b U)" if ray.is_perspective else "e + a R + b U + t F"
    yield f"the ray: {form}, a = {a:g}, b = {b:g}, {ray.near:g} <= t <= {ray.far:g}"
    for name, vector in (
        ("e", ray.eye),
        ("F", ray.forward),
        ("R", ray.right_step),
        ("U", ray.up_step),
    ):
        yield f"  {name} = ({', '.join(float(v).hex() for v in vector)})"
    covering = {hit.triangle for hit in hits}
    near_misses = len(triangles) - len(hits)
    yield f"along it, in exact order of depth ({len(hits)} hits, {near_misses} near misses):"
    for hit in hits:
        triangle = triangles[hit.triangle]
        marks = [
            "drawn" if triangle["drawn"] else "not drawn",
            *(["blended"] if triangle["alpha"] == Alpha.BLEND else []),
            *(_masked(triangle) if triangle["alpha"] == Alpha.MASK else []),
        ]
        yield (
            f"  {hit.order + 1}. t = {hit.depth!r}  object {triangle['object']} "
            f"'{triangle['object_name']}', triangle {triangle['triangle']} ({', '.join(marks)})"
        )
        if hit.by_floats:
            yield f"     float64 decides: {hit.depth_float64!r} ± {hit.bound:.3g}"
        else:
            yield f"     float64 cannot decide (± {hit.bound:.3g}); exactly {_ratio(hit)}"
    for index, triangle in enumerate(triangles):
        if index not in covering:
            yield (
                f"  -  object {triangle['object']} '{triangle['object_name']}', triangle "
                f"{triangle['triangle']}: does not cover the sample in range"
            )


def _ratio(hit: RayHit) -> str:
    if len(hit.numerator) + len(hit.denominator) <= 120:
        return f"{hit.numerator} / {hit.denominator}"
    return (
        f"{hit.numerator[:24]}… / {hit.denominator[:24]}… "
        f"({len(hit.numerator)} and {len(hit.denominator)} digits)"
    )


def draw_neighbourhood(explanation: Explanation, file: Path) -> None:
    """Draw what lies around the witness: what ought to be seen, what was drawn, and the nearest
    pixels at closer sight; where the witness has no surroundings, the pixels alone.
    """
    witness = explanation.witness
    picture = composed(panels(witness)) if "surroundings" in witness else _pixels_alone(witness)
    with replacing_file(file, begins=_PNG) as beside:
        picture.save(beside, format="PNG", optimize=True)


def _pixels_alone(witness: Mapping[str, Any]) -> Image.Image:
    """The pixels around the witness, magnified, with the samples marked.

    Only the triangles of the witness are known, so only they are drawn; the missed object is
    vermilion. A pixel's own sample is the dot in its middle, the witness the ringed one.
    """
    side = (2 * AROUND_PX + 1) * MAGNIFICATION
    nearest = _nearest_by_point(witness, side)
    palette = _palette(witness)
    pixels = np.full((side, side, 3), _BACKGROUND, np.uint8)
    for index in range(len(palette)):
        pixels[nearest == index] = palette[index]
    # Outline every triangle where it meets another.
    edge = np.zeros((side, side), np.bool_)
    edge[:, 1:] |= nearest[:, 1:] != nearest[:, :-1]
    edge[1:] |= nearest[1:] != nearest[:-1]
    pixels[edge] = (40, 40, 40)
    picture = Image.fromarray(pixels)
    pen = ImageDraw.Draw(picture)
    for line in range(0, side, MAGNIFICATION):
        pen.line((line, 0, line, side), (150, 150, 150))
        pen.line((0, line, side, line), (150, 150, 150))
    for row in range(2 * AROUND_PX + 1):
        for column in range(2 * AROUND_PX + 1):
            x, y = ((c + 0.5) * MAGNIFICATION for c in (column, row))
            pen.ellipse((x - 3, y - 3, x + 3, y + 3), (20, 20, 20), (255, 255, 255))
            if (row, column) == (AROUND_PX, AROUND_PX):
                pen.ellipse((x - 12, y - 12, x + 12, y + 12), None, (255, 255, 255), 5)
                pen.ellipse((x - 12, y - 12, x + 12, y + 12), None, (20, 20, 20), 2)
    return picture


def _palette(witness: Mapping[str, Any]) -> list[tuple[int, int, int]]:
    """A colour for each triangle of the witness, by its object."""
    order: list[int] = []
    for triangle in witness["triangles"]:
        if triangle["object"] not in (*order, witness["object"]):
            order.append(triangle["object"])
    return [
        _MISSING
        if triangle["object"] == witness["object"]
        else _OTHERS[order.index(triangle["object"]) % len(_OTHERS)]
        for triangle in witness["triangles"]
    ]


def _nearest_by_point(witness: Mapping[str, Any], side: int) -> NDArray[np.int64]:
    """(side, side) int64, which triangle is nearest at each point of the picture, -1 for none.

    In plain float64: it is a picture, the decision was made exactly.
    """
    ray = Ray.from_definition(witness["samples"], witness["x"], witness["y"])
    # Half a pixel is one unit of a or b, and b grows upward.
    offsets = ((np.arange(side) + 0.5) / MAGNIFICATION - (AROUND_PX + 0.5)) * 2.0
    a = (ray.column_a[0] + offsets)[None, :, None]
    b = (ray.row_b[0] - offsets)[:, None, None]
    spread = a * ray.right_step + b * ray.up_step
    origin, direction = ray.eye + np.zeros_like(spread), ray.forward + spread
    if not ray.is_perspective:
        origin, direction = ray.eye + spread, ray.forward + np.zeros_like(spread)
    best = np.full((side, side), np.inf)
    nearest = np.full((side, side), -1, np.int64)
    for index, triangle in enumerate(witness["triangles"]):
        corners = np.array([[float.fromhex(v) for v in p] for p in triangle["vertices"]])
        depth = _depth(corners, origin, direction)
        closer = (depth >= ray.near) & (depth <= ray.far) & (depth < best)
        best[closer], nearest[closer] = depth[closer], index
    return nearest


def _depth(corners: Float64, origin: Float64, direction: Float64) -> Float64:
    """View depth of a triangle along many rays, NaN where it is not hit (Möller, Trumbore)."""
    first, second = corners[1] - corners[0], corners[2] - corners[0]
    across = np.cross(direction, second)
    determinant = across @ first
    start = origin - corners[0]
    up = np.cross(start, first)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = (across * start).sum(axis=-1) / determinant
        v = (direction * up).sum(axis=-1) / determinant
        t: Float64 = (up @ second) / determinant
    return np.where((u >= 0.0) & (v >= 0.0) & (u + v <= 1.0), t, np.nan)
