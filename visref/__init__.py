"""The public interface: what Python programs import, `from visref import Scene, Referee`.

Each name is imported from its module at its first use, so that `import visref` costs nothing.
pytest rewrites the assertions of a package that brings a plug-in, and warns if it was imported
before; here there are none that a test would show: PYTEST_DONT_REWRITE.
"""

from __future__ import annotations

import importlib

# `typing` costs more than all the rest of this module, and an interrupt meanwhile is Python's to
# tell, in many lines.
TYPE_CHECKING = False

if TYPE_CHECKING:
    from visref.camera import Camera, look_at
    from visref.camera_path import CameraPath, Frame
    from visref.conformance import assert_conforms, check_culler, conformance_checks
    from visref.culler import Culler, DrawnSet, Option, Promise, QueryStats, RasterTolerance
    from visref.engines import TruthEngine, make_engine
    from visref.errors import InputError, NothingToJudge
    from visref.formats import load_path, load_scene, scene_from_trimesh
    from visref.inputs import Inputs, open_inputs
    from visref.judging.outcome import RunOutcome
    from visref.judging.referee import Referee
    from visref.judging.status import Exit
    from visref.registry import make_culler
    from visref.report.writing import write_report
    from visref.runs import judge_to_folder, truth_to_file
    from visref.scene import Scene, Units
    from visref.timeline import Timeline
    from visref.visibility import (
        FrameTruth,
        ObjectVisibility,
        Ties,
        VisibilityBuffer,
        objects_seen,
    )

    __version__: str

__all__ = [
    "Camera",
    "CameraPath",
    "Culler",
    "DrawnSet",
    "Exit",
    "Frame",
    "FrameTruth",
    "InputError",
    "Inputs",
    "NothingToJudge",
    "ObjectVisibility",
    "Option",
    "Promise",
    "QueryStats",
    "RasterTolerance",
    "Referee",
    "RunOutcome",
    "Scene",
    "Ties",
    "Timeline",
    "TruthEngine",
    "Units",
    "VisibilityBuffer",
    "__version__",
    "assert_conforms",
    "check_culler",
    "conformance_checks",
    "judge_to_folder",
    "load_path",
    "load_scene",
    "look_at",
    "make_culler",
    "make_engine",
    "objects_seen",
    "open_inputs",
    "scene_from_trimesh",
    "truth_to_file",
    "write_report",
]

# Where each public name lives; the imports above say the same to type checkers.
_MODULES = {
    "visref.camera": ("Camera", "look_at"),
    "visref.camera_path": ("CameraPath", "Frame"),
    "visref.conformance": ("assert_conforms", "check_culler", "conformance_checks"),
    "visref.culler": (
        "Culler",
        "DrawnSet",
        "Option",
        "Promise",
        "QueryStats",
        "RasterTolerance",
    ),
    "visref.engines": ("TruthEngine", "make_engine"),
    "visref.errors": ("InputError", "NothingToJudge"),
    "visref.formats": ("load_path", "load_scene", "scene_from_trimesh"),
    "visref.inputs": ("Inputs", "open_inputs"),
    "visref.judging.outcome": ("RunOutcome",),
    "visref.judging.referee": ("Referee",),
    "visref.judging.status": ("Exit",),
    "visref.registry": ("make_culler",),
    "visref.report.writing": ("write_report",),
    "visref.runs": ("judge_to_folder", "truth_to_file"),
    "visref.scene": ("Scene", "Units"),
    "visref.timeline": ("Timeline",),
    "visref.visibility": (
        "FrameTruth",
        "ObjectVisibility",
        "Ties",
        "VisibilityBuffer",
        "objects_seen",
    ),
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}


if not TYPE_CHECKING:  # Or a type checker would take any name for a public one.

    def __getattr__(name: str) -> object:
        if name == "__version__":
            from importlib.metadata import version

            return version("visref")
        if name not in _MODULE_OF:
            raise AttributeError(f"module 'visref' has no attribute '{name}'")
        value = getattr(importlib.import_module(_MODULE_OF[name]), name)
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
