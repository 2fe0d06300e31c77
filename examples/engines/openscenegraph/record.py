"""OpenSceneGraph culls a scene along a camera path, and what is left is recorded.

    python record.py SCENE PATH.json RECORDING.jsonl [--small-feature PX]
        [--culling default|all|none] [--near-far volumes|own] [--occluders N [--nested]]
    python record.py --suite SUITE OUT        every case of `visref conformance --write SUITE`

`cull.cpp` beside this, which is compiled on first use (g++, libopenscenegraph-dev), holds the scene
as a MatrixTransform with a Geode for each object, and lets a SceneView cull it, with the settings
that OpenSceneGraph has by default. Nothing is drawn: recorded is what the state graph holds for
drawing. The scene is read by visref, so any format will do; what a file animates is refused.

--occluders N: the N largest upright rectangles of opaque objects become OccluderNodes, beside their
object's Geode; all may be active, where OpenSceneGraph by itself takes ten. With --nested an object
stands below its OccluderNodes, one within the other.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.camera_path import CameraPath
from visref.errors import InputError
from visref.formats import load_scene
from visref.path_frame import Frame
from visref.recordings import RecordingWriter
from visref.scene import Alpha, Scene

HERE = Path(__file__).resolve().parent
BUILT = HERE / "build" / "cull"
# osg::CullSettings::CullingModeValues.
CULLING = {"default": 0x39, "all": 0x3F, "none": 0}
NEAR_FAR = {"volumes": 1, "own": 0}
# Cosine of an angle that is right but for the rounding of float32 corners.
RIGHT_ANGLE = 1e-5
# A far plane for what has none: OpenSceneGraph's default culling does not look at it.
ENDLESS = 1e6


def program() -> Path:
    """The compiled cull.cpp."""
    source = HERE / "cull.cpp"
    if not BUILT.exists() or BUILT.stat().st_mtime < source.stat().st_mtime:
        if shutil.which("g++") is None:
            raise SystemExit("there is no g++; install g++ and libopenscenegraph-dev")
        BUILT.parent.mkdir(exist_ok=True)
        words = ["g++", "-O1", "-std=c++17", "-Wall", str(source), "-losgUtil", "-losg"]
        words += ["-lOpenThreads", "-o"]
        with tempfile.TemporaryDirectory(dir=BUILT.parent) as folder:
            made = Path(folder, "cull")
            done = subprocess.run([*words, str(made)], capture_output=True, text=True, check=False)
            if done.returncode:
                raise SystemExit(
                    f"cull.cpp does not compile (is libopenscenegraph-dev there?)\n{done.stderr}"
                )
            made.replace(BUILT)
    return BUILT


def numbers(values: NDArray[np.floating] | NDArray[np.integer]) -> str:
    return " ".join(map(repr, values.reshape(-1).tolist()))


def told_scene(scene: Scene, occluders: int) -> Iterator[str]:
    """The scene in the words of cull.cpp: an object for each, in its own space."""
    rig = scene.rig
    assert rig is not None
    for one in range(scene.object_count):
        positions, triangles = own_mesh(scene, one)
        yield f"object {len(positions)} {len(triangles)}"
        yield numbers(positions)
        yield numbers(triangles)
        yield f"pose {one} {numbers(rig.worlds[one])}"
    for one, corners in largest_walls(scene, occluders):
        yield f"occluder {one} {numbers(corners)}"


def own_mesh(scene: Scene, one: int) -> tuple[NDArray[np.floating], NDArray[np.integer]]:
    rig = scene.rig
    assert rig is not None
    mesh = int(rig.mesh_of_object[one])
    if mesh < 0:
        return np.zeros((0, 3)), np.zeros((0, 3), np.int64)
    rows = slice(*scene.object_offsets[one : one + 2].tolist())
    return rig.positions[mesh], scene.triangles[rows] - rig.vertex_starts[one]


def largest_walls(scene: Scene, most: int) -> list[tuple[int, NDArray[np.floating]]]:
    found = []
    for one in range(scene.object_count) if most else ():
        rows = slice(*scene.object_offsets[one : one + 2].tolist())
        if (scene.alpha[rows] == int(Alpha.OPAQUE)).all() and not scene.one_sided[rows].any():
            positions, triangles = own_mesh(scene, one)
            for first, second in pairwise(triangles.tolist()):
                quad = joined(positions[first].astype(float), positions[second].astype(float))
                if quad is not None:
                    area = float(np.linalg.norm(np.cross(quad[1] - quad[0], quad[3] - quad[0])))
                    found.append((-area, one, quad))
    found.sort(key=lambda wall: wall[:2])
    return [(one, quad) for _, one, quad in found[:most]]


def joined(
    first: NDArray[np.floating], second: NDArray[np.floating]
) -> NDArray[np.floating] | None:
    """The upright rectangle of two triangles, (4, 3), its corners in order."""
    corners = [tuple(one) for one in first.tolist()]
    others = [tuple(one) for one in second.tolist()]
    shared = [one for one in corners if one in others]
    if len(shared) != 2 or len(set(corners)) < 3 or len(set(others)) < 3:
        return None
    (one,) = (np.array(corner) for corner in corners if corner not in shared)
    (other,) = (np.array(corner) for corner in others if corner not in shared)
    left, right = (np.array(corner) for corner in shared)
    if (one + other != left + right).any():  # the diagonals do not halve each other
        return None
    across, along = left - one, right - one
    if abs(across @ along) > RIGHT_ANGLE * np.linalg.norm(across) * np.linalg.norm(along):
        return None
    return np.array([one, left, other, right]) if np.cross(across, along)[1] == 0 else None


def told_frame(scene: Scene, frame: Frame, before: Frame | None) -> Iterator[str]:
    """Poses, what is absent, and the views; what the frame before moved goes back."""
    rig = scene.rig
    assert rig is not None
    if frame.levels or (frame.time_s is not None and rig.motion is not None):
        raise SystemExit("levels of detail, and what a file animates, are not tried")
    for name in before.world_from_object if before else ():
        one = object_of(scene, name)
        yield f"pose {one} {numbers(rig.worlds[one])}"
    for name in before.absent if before else ():
        yield f"present {object_of(scene, name)} 1"
    for name, matrix in frame.world_from_object.items():
        yield f"pose {object_of(scene, name)} {numbers(matrix)}"
    for name in frame.absent:
        yield f"present {object_of(scene, name)} 0"
    for camera in frame.cameras:
        yield told_view(camera)


def told_view(camera: Camera) -> str:
    if camera.clip_plane is not None:
        raise SystemExit("clip planes are not tried")
    far = max(ENDLESS, 1e6 * camera.near) if np.isinf(camera.far) else camera.far
    projection, view = camera.clip_from_camera(far), camera.camera_from_world
    return f"view {camera.width} {camera.height} {numbers(projection)} {numbers(view)}"


def object_of(scene: Scene, name: str) -> int:
    found = {one for one, its in enumerate(scene.names) if its == name}
    found |= {one for one, its in enumerate(scene.paths) if its == name}
    if len(found) != 1:
        raise SystemExit(f"'{name}' is no object's name alone; groups are not tried")
    return found.pop()


def record(scene_file: Path, path_file: Path, recording: Path, options: argparse.Namespace) -> None:
    backfaces = os.environ.get("VISREF_CULL_BACKFACES") == "1"
    scene, path = load_scene(scene_file, cull_backfaces=backfaces), CameraPath.load(path_file)
    if scene.absent is not None or (scene.rig is not None and scene.rig.motion is not None):
        raise SystemExit("scenes with levels of detail, hidden nodes or animation are not tried")
    lines = [
        f"option culling {CULLING[options.culling]}",
        f"option near_far {NEAR_FAR[options.near_far]}",
    ]
    if options.small_feature is not None:
        lines.append(f"option small_feature_px {options.small_feature!r}")
    if options.occluders:
        lines.append(f"option occluders {options.occluders}")
        lines.append(f"option nested {int(options.nested)}")
    lines += told_scene(scene, options.occluders)
    before = None
    for frame in path.frames:
        lines += told_frame(scene, frame, before)
        before = frame
    done = subprocess.run(
        [program()], input="\n".join(lines) + "\n", capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise SystemExit(f"cull ended with status {done.returncode}: {done.stderr}")
    answers = iter(done.stdout.splitlines())
    told = json.loads(path_file.read_text(encoding="utf-8"))
    shared = {k: v for k, v in told.items() if k not in ("format", "version", "frames")}
    with RecordingWriter(recording, **shared) as writer:
        for number, frame in enumerate(path.frames):
            drawn = {one.view: list(map(int, next(answers).split()[2:])) for one in frame.cameras}
            visible = drawn if len(drawn) > 1 else next(iter(drawn.values()))
            writer.frame(number, visible=visible, **told["frames"][number])


def record_suite(suite: Path, out: Path, options: argparse.Namespace) -> None:
    """What cannot be recorded is told, and leaves no file."""
    out.mkdir(parents=True, exist_ok=True)
    os.environ["VISREF_CULL_BACKFACES"] = "1"
    for case in json.loads((suite / "manifest.json").read_text(encoding="utf-8"))["cases"]:
        recording = out / f"{case['name']}.jsonl"
        try:
            record(suite / case["scene"], suite / case["path"], recording, options)
        except (InputError, SystemExit) as problem:
            print(f"{case['name']}: {problem}", file=sys.stderr)
            recording.unlink(missing_ok=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--suite", action="store_true", help="two folders: the suite, and OUT")
    parser.add_argument("files", type=Path, nargs="+")
    parser.add_argument("--small-feature", type=float, metavar="PX", help="0 draws the smallest")
    parser.add_argument("--culling", default="default", choices=tuple(CULLING))
    parser.add_argument("--near-far", default="volumes", choices=tuple(NEAR_FAR))
    parser.add_argument("--occluders", type=int, default=0, metavar="N")
    parser.add_argument("--nested", action="store_true", help="objects below their occluders")
    options = parser.parse_args()
    if len(options.files) != (2 if options.suite else 3):
        parser.error("which files?")
    try:
        (record_suite if options.suite else record)(*options.files, options)
    except InputError as error:
        print(error, file=sys.stderr)
        raise SystemExit(2) from None
    except OSError as problem:
        raise SystemExit(f"{problem.filename}: {problem.strerror}") from None


if __name__ == "__main__":
    main()
