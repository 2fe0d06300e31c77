"""A search's faults, each shrunk into a folder of its own; those that come out alike are one.

Violations of one cause are one fault before anything is shrunk (`visref.search.folder.Key`). What
is left of a scene once it is shrunk holds nothing that the fault does not need, so faults of one
kind and cause whose smallest scenes have the same ingredients are one fault too: its *structure*.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from visref.camera_path import CameraPath
from visref.errors import InputError
from visref.files import replacing_folder
from visref.search import edits
from visref.search.case import Case
from visref.search.fault_folder import FAULT_FOLDER, write_fault
from visref.search.folder import FAULTS, Fault, SearchFolder
from visref.search.holding import Effort, Holding, Wanted
from visref.search.shrinking import Shrunk, shrink
from visref.search.trying import Trier
from visref.search.views import ViewsOf

# Trials per fault: most are through in two hundred.
EFFORT = Effort(trials=1000)


def shrink_all(folder: SearchFolder, trier: Trier, told: Callable[[str], None]) -> None:
    """Shrink the faults that have no folder yet. `told` is told of each before."""
    waiting = [fault for fault in folder.faults if not fault.folder and not fault.note]
    for number, fault in enumerate(waiting):
        told(f"shrinking fault {number + 1} of {len(waiting)}")
        try:
            _shrink_one(folder, fault, trier)
        except InputError as error:
            # It stays among the faults, with what became of it.
            fault.note = error.args[0]


def _shrink_one(folder: SearchFolder, fault: Fault, trier: Trier) -> None:
    wanted = Wanted.of(fault.violation, cause=fault.key.cause)
    for case in _cases(fault, trier):
        holding = Holding(trier.suspect, wanted, engine=trier.engine, effort=EFFORT)
        if holding.starts(case):
            break
    else:
        raise InputError(f"trial {fault.trial} does not show it by itself")
    shrunk = shrink(case, holding)
    fault.structure = structure_of(shrunk)
    fault.objects, fault.triangles = (
        shrunk.case.scene.object_count,
        shrunk.case.scene.triangle_count,
    )
    for other in folder.faults:
        if other.folder and other.alike == fault.alike:
            fault.folder = other.folder
            return
    count = len({one.folder for one in folder.faults if one.folder})
    name = f"{FAULTS}/{count + 1:03d}"
    with replacing_folder(folder.out / name, kind=FAULT_FOLDER) as beside:
        fault.violation = write_fault(beside, shrunk, trier.suspect, engine=trier.engine)
    fault.folder = name


def _cases(fault: Fault, trier: Trier) -> Iterator[Case]:
    """The trial up to the frame of the violation: by itself, then with those that were judged
    before it in the same run."""
    source = trier.source
    last = fault.violation.frame
    genome = source.read(fault.genome)
    if not isinstance(source, ViewsOf):
        yield edits.only_frames(source.case(genome), range(last + 1))
        return
    own = source.frames(genome)[: last + 1]
    yield source.on(CameraPath(own, "views"))
    if fault.before:
        before = [frame for one in fault.before for frame in source.frames(source.read(one))]
        yield source.on(CameraPath([*before, *own], "views"))


def structure_of(shrunk: Shrunk) -> str:
    """What a smallest scene is made of, in words: of several frames and objects or one, and what is
    uncommon about them."""
    case = shrunk.case
    scene, frames = case.scene, case.path.frames
    cameras = [camera for frame in frames for camera in frame.cameras]
    poses = {camera.world_from_camera.tobytes() for camera in cameras}
    lenses = {(camera.width, camera.height, camera.yfov, camera.ymag) for camera in cameras}
    special = {
        "several frames": len(frames) > 1,
        "several views": any(len(frame.cameras) > 1 for frame in frames),
        "the camera moves": len(poses) > 1,
        "the lens changes": len(lenses) > 1,
        "a cut": any(camera.cut for camera in cameras[1:]),
        "things move": any(frame.world_from_object for frame in frames),
        "things bend": bool(case.shapes),
        "things are absent": any(frame.absent for frame in frames),
        "orthographic": any(not camera.is_perspective for camera in cameras),
        "shifted lens": any(camera.shift_x_px or camera.shift_y_px for camera in cameras),
        "clip plane": any(camera.clip_plane is not None for camera in cameras),
        "far plane": any(np.isfinite(camera.far) for camera in cameras),
        "far out": bool(scene.origin.any()),
        "glass": scene.has_blend,
        "mask": scene.masks is not None,
        "equal names": len(set(scene.given_names)) < scene.object_count,
        "one-sided": scene.has_one_sided,
    }
    several = "several objects" if scene.object_count > 1 else "an object"
    return ", ".join([several, *(name for name, there in special.items() if there)])
