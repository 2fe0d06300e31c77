"""What works on this machine: each engine on scenes whose answer is known, each culler's import."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from visref.camera import Camera, look_at
from visref.engines import engine_names, make_engine
from visref.errors import InputError, NothingToJudge
from visref.registry import CULLERS, ENGINES, available, load_entry
from visref.scene import Scene
from visref.trials.hardcases import every_spec
from visref.trials.watertight import leaks_line, watertight_rates


@dataclass(frozen=True)
class DoctorCheck:
    """One line of `visref doctor`; `otherwise` is the word for one that does not work."""

    name: str
    works: bool
    detail: str
    is_engine: bool = False
    otherwise: str = "missing"


def doctor() -> list[DoctorCheck]:
    """What works on this machine. Each engine casts a frame whose answer is known, and frames
    of rays that all aim at vertices and edges of a closed surface."""
    checks = engine_checks()
    broken = {check.name for check in checks if not check.works}
    for spec in every_spec(ENGINES):
        if f"engine {spec.partition(':')[0]}" not in broken:
            leaks = watertight_rates(spec)
            tight = not any(leak.missed for leak in leaks)
            label, line = f"watertight engine {spec}", leaks_line(leaks)
            checks.append(DoctorCheck(label, tight, line, otherwise="leaks"))
    for name in available(CULLERS):
        try:
            load_entry(CULLERS, name, kind="culler")
            checks.append(DoctorCheck(f"culler {name}", True, "found"))
        except ImportError as error:
            checks.append(DoctorCheck(f"culler {name}", False, str(error)))
    return checks


def engine_checks() -> list[DoctorCheck]:
    """Whether each installed engine casts a frame whose answer is known; sorted by name."""
    return [_check_engine(name) for name in engine_names()]


def _check_engine(name: str) -> DoctorCheck:
    label = f"engine {name}"
    # A square of half the view's height, centred: 6 of 12 columns and rows.
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32)
    square = Scene.from_objects([("square", corners, np.array([[0, 1, 2], [0, 2, 3]]))])
    camera = Camera(look_at((0, 0, 4), (0, 0, 0)), 12, 12, near=1.0, far=9.0, ymag=2.0)
    try:
        engine = make_engine(name, square)
        owned = int(np.count_nonzero(engine.frame(camera).buffer.triangle >= 0))
        detail = engine.describe()
        engine.close()
    except (ImportError, NothingToJudge, InputError) as error:
        return DoctorCheck(label, False, str(error), is_engine=True)
    if owned != 36:
        return DoctorCheck(label, False, f"owned {owned} samples of 36; {detail}", is_engine=True)
    return DoctorCheck(label, True, detail, is_engine=True)
