"""Opening a USD file: which other files it composes, its units, and its up axis."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Sdf, Tf, Usd, UsdGeom

from visref.errors import InputError
from visref.files import open_file
from visref.findings import Code
from visref.scene import Float64
from visref.wording import counted

# y_up_from_axis, by rows: what the new x, y and z are made of.
_Y_UP = {
    "Y": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "Z": ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
}
# A scheme or a drive before a name.
_SCHEME = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*:")
# "Error in 'function' at line n in file f : 'text'".
_SAID = re.compile(r"at line \d+ in file .*? : '(.*?)'\s*$", re.DOTALL)


@dataclass
class Opened:
    """`stage`: composed, with all that it names; `root`: (4, 4) float64, from its units and axes to
    metres and +Y up; `notes`: what was found."""

    stage: Any
    root: Float64
    notes: list[tuple[Code, str]] = field(default_factory=list)


def open_stage(path: Path) -> Opened:
    """Open a file. Raises InputError where it is no USD, or names a file that it may not."""
    try:
        layer = Sdf.Layer.FindOrOpen(str(path.absolute()))
    except Tf.ErrorException as error:
        raise InputError(
            f"this is not valid USD: {said(error)}", fix="export the file anew"
        ) from error
    if layer is None:
        raise InputError("this is not valid USD", fix="export the file anew")
    missing = _named(layer, path)
    try:
        stage = Usd.Stage.Open(layer)
    except Tf.ErrorException as error:
        raise InputError(f"the stage does not compose: {said(error)}", fix="mend it") from error
    opened = Opened(stage, np.eye(4))
    if missing:
        what = counted(len(missing), "file that it names", "files that it names")
        opened.notes.append(
            (Code.PARTLY_READ, f"{what} cannot be opened, first {missing[0][:200]!a}")
        )
    metres = float(UsdGeom.GetStageMetersPerUnit(stage))
    if not 0.0 < metres < np.inf:
        raise InputError(
            f"the unit is {metres} metres", place="metersPerUnit", fix="give a positive length"
        )
    axis = str(UsdGeom.GetStageUpAxis(stage))
    opened.root[:3, :3] = metres * np.array(_Y_UP[axis], np.float64)
    if metres != 1.0 or axis != "Y":
        by_default = "" if UsdGeom.StageHasAuthoredMetersPerUnit(stage) else ", USD's default"
        opened.notes.append(
            (
                Code.UNITS_CONVERTED,
                f"from units of {metres:g} metres{by_default}, +{axis} up, to metres, +Y up",
            )
        )
    return opened


def said(error: Exception) -> str:
    """What USD says of its first error: the text alone, without its own source files."""
    found = _SAID.search(str(error))
    text = found[1] if found else str(error)
    return " ".join(text.split())[:200]


def _named(layer: Any, path: Path) -> list[str]:
    """The names of files that are not there, of all that the layer composes, at whatever distance.

    Raises InputError for a name that leaves no choice of folder (absolute, a URI), and for what is
    no ordinary file.
    """
    missing: list[str] = []
    waiting, known = [layer], {layer.identifier}
    while waiting:
        owner = waiting.pop()
        for name in sorted(filter(None, owner.GetCompositionAssetDependencies())):
            if _SCHEME.match(name) or name.startswith(("/", "\\")):
                raise InputError(
                    f"it names {name[:200]!a}, which is not a file beside it",
                    fix="give it a name relative to the file",
                )
            absolute = owner.ComputeAbsolutePath(name)
            if absolute in known:
                continue
            known.add(absolute)
            # Of "a.usdz[b.usd]" the package is a file.
            file = Path(absolute.partition("[")[0])
            if not file.exists():
                missing.append(name)
                continue
            try:
                open_file(file).close()
            except InputError as error:
                raise error.at(place=f"file {name[:200]!a}") from error
            try:
                found = Sdf.Layer.FindOrOpen(absolute)
            except Tf.ErrorException:
                found = None
            if found is None:
                missing.append(name)
            else:
                waiting.append(found)
    return missing
