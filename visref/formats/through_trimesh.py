"""Every other format goes through trimesh, with its clean-up switched off, since a verdict is
about the triangles as given. (glTF, OBJ, COLLADA, 3MF, PLY and OFF have readers of their
own, whose modules say what trimesh gets wrong in them.)
"""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from visref.errors import InputError
from visref.findings import Code
from visref.formats.in_a_child import read_in_a_child
from visref.formats.placed import NO_MESH, Mesh, Placed, below, compose
from visref.memory import Budget
from visref.scene import Alpha, check_indices


def extensions() -> list[str]:
    """The extensions that trimesh reads with the packages installed, without their dots."""
    archives = trimesh.exchange.load.compressed_loaders
    return [name for name in sorted(trimesh.available_formats()) if name not in archives]


def can_read(extension: str) -> bool:
    """Whether trimesh knows the format, be its packages installed or not."""
    return extension in trimesh.exchange.load.mesh_loaders or extension in extensions()


def read_with_trimesh(path: Path, *, budget: Budget) -> Placed:
    """The objects of a file in any of trimesh's formats. Raises InputError where it fails, or
    needs a package that is not installed."""
    if path.suffix.lower() == ".stl":
        # Triangles one after another, which cannot become more than they are in the file: 50
        # bytes each, or more as text, where Python's own strings take ten times that.
        budget.need("reading it", 12 * path.stat().st_size)
        return parse_with_trimesh(path, budget)
    return read_in_a_child("visref.formats.through_trimesh:parse_with_trimesh", path, budget)


def parse_with_trimesh(path: Path, budget: Budget) -> Placed:
    """`read_with_trimesh`, in this process."""
    suffix = path.suffix.lower()
    said = _Said(logging.WARNING)
    logger = logging.getLogger("trimesh")
    logger.addHandler(said)
    try:
        loaded = trimesh.load_scene(str(path.absolute()), process=False)
    except ImportError as error:
        raise InputError(
            f"reading '{suffix}' files needs a package: {error}", fix="install it with pip"
        ) from error
    except (MemoryError, RecursionError):
        raise
    except Exception as error:  # trimesh's readers fail in as many ways as there are formats.
        kind = type(error).__name__
        raise InputError(
            f"this is not a readable '{suffix}' file ({kind}: {str(error)[:120]})",
            fix="export the file anew",
        ) from error
    finally:
        logger.removeHandler(said)
    budget.claim(f"{len(loaded.graph.nodes):,} nodes", objects=len(loaded.graph.nodes))
    placed = from_trimesh(loaded)
    placed.notes.extend((Code.PARTLY_READ, f"trimesh says: {line}") for line in said.lines)
    return placed


class _Said(logging.Handler):
    """Collects what a library only logs: a loader's warning is a finding, not a line lost."""

    def __init__(self, level: int) -> None:
        super().__init__(level)
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.lines.append(record.getMessage())


def from_trimesh(given: trimesh.Trimesh | trimesh.Scene) -> Placed:
    """An object for each node with a geometry, depth-first."""
    loaded = given if isinstance(given, trimesh.Scene) else trimesh.Scene(given)
    placed = Placed()
    known: dict[str, int] = {}
    forest = loaded.graph.transforms
    children: dict[Any, list[Any]] = {}
    for child, parent in forest.parents.items():
        children.setdefault(parent, []).append(child)
    waiting = [(loaded.graph.base_frame, np.eye(4), "")]
    while waiting:
        frame, world, above = waiting.pop()
        # The base frame is trimesh's own, and no part of the file's hierarchy.
        path = below(above, str(frame))
        prefix = "" if frame == loaded.graph.base_frame else path
        for child in reversed(children.get(frame, [])):
            matrix = forest.edge_data[(frame, child)].get("matrix", np.eye(4))
            waiting.append((child, compose(world, np.asarray(matrix, np.float64)), prefix))
        name = forest.node_data.get(frame, {}).get("geometry")
        if name is None:
            continue
        if name not in known:
            geometry = loaded.geometry[name]
            known[name] = NO_MESH
            if isinstance(geometry, trimesh.Trimesh):
                known[name] = len(placed.meshes)
                placed.meshes.append(_mesh(geometry, str(frame)))
        placed.add(str(frame), known[name], world, path=path)
    return placed


def _mesh(geometry: trimesh.Trimesh, name: str) -> Mesh:
    positions = np.asarray(geometry.vertices).reshape(-1, 3)
    triangles = np.asarray(geometry.faces).reshape(-1, 3)
    check_indices(triangles, len(positions), lambda _: f"object '{name}'")
    material: Any = getattr(geometry.visual, "material", None)
    one_sided = not getattr(material, "doubleSided", None)
    alpha = Alpha.__members__.get(getattr(material, "alphaMode", None) or "", Alpha.OPAQUE)
    if alpha == Alpha.MASK and material.baseColorTexture is None:
        # A constant alpha decides it, as in glTF.
        factor, cutoff = material.baseColorFactor, material.alphaCutoff
        opacity = 1.0 if factor is None else float(factor[3]) / 255.0
        if opacity < (0.5 if cutoff is None else cutoff):
            triangles = triangles[:0]
        alpha = Alpha.OPAQUE
    return Mesh.plain(positions, triangles, one_sided=one_sided, alpha=alpha)
