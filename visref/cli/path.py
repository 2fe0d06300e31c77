"""visref path: make camera paths, and say what their cameras see."""

from __future__ import annotations

import argparse
import json
import math
import shlex
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from visref.camera_path import CameraPath, Frame
from visref.cli.arguments import add_memory_argument, memory_of
from visref.cli.path_check import add_check_arguments, check
from visref.cli.terminal import OUT
from visref.errors import InputError
from visref.files import refuse_inputs, replacing_file
from visref.formats import GLTF, load_path
from visref.inputs import open_scene
from visref.judging.status import Exit
from visref.memory import Budget
from visref.numerals import decimal_number, whole_number
from visref.paths import circling, pose_files
from visref.paths.conventions import CONVENTIONS, find_convention
from visref.paths.cube import cube_frame, cube_views
from visref.paths.free_space import free_route
from visref.paths.lens import DEFAULT_YFOV, FRAME_BYTES, MATRIX_BYTES, Lens, check_frames
from visref.paths.stereo import stereo_frame
from visref.paths.walking import walk
from visref.scene import Float64, Scene
from visref.wording import counted

Make = Callable[[argparse.Namespace], CameraPath]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_check_arguments(parser)
    kinds = parser.add_subparsers(metavar="KIND")

    def kind(name: str, make: Make, about: str) -> argparse.ArgumentParser:
        one: argparse.ArgumentParser = kinds.add_parser(name, help=about)
        one.add_argument("--out", type=Path, required=True, metavar="FILE.json")
        one.set_defaults(make=make)
        return one

    for name, make, about in (
        ("orbit", _orbit, "a camera circles the scene, or something in it"),
        ("turntable", _turntable, "the scene's objects, or some, turn before a camera that stands"),
    ):
        circle = kind(name, make, about)
        _add_scene(circle)
        circle.add_argument("--around", metavar="NAME", help="an object or a group; default: all")
        circle.add_argument(
            "--distance", type=decimal_number, metavar="D", help="default: all of it is in view"
        )
        circle.add_argument(
            "--elevation", type=decimal_number, default=20.0, metavar="DEG", help="default 20"
        )
        _add_frames(circle, fps=name == "orbit")
        _add_lens(circle)
    walking = kind("walk", _walk, "along given points, or through a scene by itself")
    _add_scene(walking, optional=True)
    walking.add_argument(
        "--through", metavar="POINTS", help='points in world space, "0,1.7,0; 5,1.7,-2"'
    )
    walking.add_argument("--seed", type=whole_number, default=0, metavar="N", help="default 0")
    walking.add_argument(
        "--clearance", type=decimal_number, metavar="D", help="what no triangle is nearer than"
    )
    walking.add_argument(
        "--eye-height", type=decimal_number, metavar="Y", help="default: where most is to be seen"
    )
    _add_frames(walking, fps=True)
    _add_lens(walking)
    cube = kind("cube", _cube, "six views of one eye, 90 degrees each: px, nx, py, ny, pz, nz")
    eyes = cube.add_mutually_exclusive_group(required=True)
    eyes.add_argument(
        "--eye", metavar="X,Y,Z", help="in world space; --eye=-1,2,0 where a minus comes first"
    )
    eyes.add_argument(
        "--from",
        dest="from_path",
        metavar="PATH",
        help="from the eye of each frame of this path, with all else that the frame says",
    )
    cube.add_argument("--size", type=whole_number, required=True, metavar="N", help="pixels a side")
    _add_range(cube, "0.1, or the path's", "infinite, or the path's")
    stereo = kind("stereo", _stereo, "two eyes in place of each of a path's: left and right")
    stereo.add_argument("--from", dest="from_path", metavar="PATH", required=True)
    stereo.add_argument(
        "--eyes",
        type=decimal_number,
        default=0.063,
        metavar="D",
        help="the distance between them (default 0.063, people's in metres)",
    )
    stereo.add_argument(
        "--screen",
        type=decimal_number,
        metavar="D",
        help="the depth at which the images coincide, by shifted lenses (default: none)",
    )
    cameras = kind("cameras", _cameras, "the cameras of a glTF file, still and animated")
    _add_scene(cameras)
    cameras.add_argument("--size", type=_size, default=(1280, 960), metavar="WxH", help=_SIZE_HELP)
    cameras.add_argument(
        "--fps", type=decimal_number, metavar="N", help="frames a second (default: the keyframes)"
    )
    poses = kind("from-poses", _from_poses, "poses of other programs: CSV, TUM, COLMAP")
    poses.add_argument("file", metavar="FILE")
    poses.add_argument(
        "--convention",
        required=True,
        metavar="NAME",
        help=f"whose axes, handedness and units: {', '.join(CONVENTIONS)}",
    )
    _add_lens(poses)
    add_memory_argument(poses)


def run(given: argparse.Namespace) -> Exit:
    if "make" not in given:
        if given.check is None:
            raise InputError("there is nothing to do", fix="give a KIND (see --help), or --check")
        return check(given.check, given.scene, given)
    names = ("scene", "from_path", "file")
    refuse_inputs(given.out, (getattr(given, name, None) for name in names))
    path = given.make(given)
    with replacing_file(given.out) as file:
        file.write_text(json.dumps(path.to_json(), allow_nan=False) + "\n", encoding="utf-8")
    views = sum(len(frame.cameras) for frame in path.frames)
    OUT.remark(f"{given.out}: {counted(len(path), 'frame')}, {counted(views, 'view')}")
    if getattr(given, "check_made", False):
        return check(str(given.out), given.scene, given)
    shown = shlex.quote(str(given.out))
    OUT.remark(f"Next: `visref path --check {shown}` says where its cameras are")
    return Exit.NO_VIOLATION


_SIZE_HELP = "pixels (default 1280x960)"


def _add_scene(parser: argparse.ArgumentParser, *, optional: bool = False) -> None:
    parser.add_argument("scene", metavar="SCENE", nargs="?" if optional else None)
    parser.add_argument(
        "--check", dest="check_made", action="store_true", help="say what each frame sees"
    )
    parser.add_argument(
        "--lenient", action="store_true", help="drop triangles with a NaN or infinite vertex"
    )
    add_memory_argument(parser)


def _add_frames(parser: argparse.ArgumentParser, *, fps: bool) -> None:
    parser.add_argument(
        "--frames", type=whole_number, default=120, metavar="N", help="how many (default 120)"
    )
    if fps:
        parser.add_argument(
            "--fps", type=decimal_number, metavar="N", help="frames a second, where objects move"
        )


def _add_lens(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--size", type=_size, metavar="WxH", help=_SIZE_HELP)
    parser.add_argument(
        "--fov", type=decimal_number, metavar="DEG", help="vertical, in degrees (default 60)"
    )
    _add_range(parser, "by the kind", "infinite")


def _add_range(parser: argparse.ArgumentParser, near: str, far: str) -> None:
    for name, default in (("--near", near), ("--far", far)):
        parser.add_argument(name, type=decimal_number, metavar="D", help=f"default: {default}")


def _lens(given: argparse.Namespace) -> Lens:
    width, height = given.size or (1280, 960)
    yfov = DEFAULT_YFOV if given.fov is None else math.radians(given.fov)
    if not 0.0 < yfov < math.pi:
        raise InputError(f"--fov is {given.fov:g}", fix="give degrees between 0 and 180")
    return Lens(width, height, yfov, given.near, math.inf if given.far is None else given.far)


def _times(given: argparse.Namespace) -> Sequence[float | None]:
    _check_frames(given)
    if given.fps is None:
        return [None] * given.frames
    if not given.fps > 0.0:
        raise InputError(f"--fps is {given.fps:g}", fix="give frames a second above 0")
    times = [k / given.fps for k in range(given.frames)]
    if not math.isfinite(times[-1]):
        raise InputError(f"--fps is {given.fps:g}, and a frame's time infinite", fix="give more")
    return times


def _check_frames(given: argparse.Namespace, moved: int = 0) -> None:
    """Raise InputError for too many, too few, or more than fit with so many matrices each."""
    check_frames(given.frames)
    size = given.frames * (FRAME_BYTES + moved * MATRIX_BYTES)
    Budget.of(memory_of(given)).need(f"a path of {given.frames:,} frames", size)


def _scene(given: argparse.Namespace) -> Scene:
    return open_scene(given.scene, lenient=given.lenient, max_memory=memory_of(given))[0]


def _circle(given: argparse.Namespace, scene: Scene, lens: Lens) -> circling.Circle:
    bounds = scene.core_bounds + scene.origin
    if given.around is not None:
        bounds = circling.bounds_of(scene, given.around)
    elevation = math.radians(given.elevation)
    return circling.circle_around(bounds, lens, elevation=elevation, distance=given.distance)


def _orbit(given: argparse.Namespace) -> CameraPath:
    lens = _lens(given)
    circle = _circle(given, _scene(given), lens)
    return circling.orbit(circle, lens, given.frames, _times(given))


def _turntable(given: argparse.Namespace) -> CameraPath:
    scene, lens = _scene(given), _lens(given)
    circle = _circle(given, scene, lens)
    turned = circling.everything(scene) if given.around is None else [given.around]
    _check_frames(given, len(turned))
    return circling.turntable(circle, lens, given.frames, scene, turned)


def _walk(given: argparse.Namespace) -> CameraPath:
    lens, times = _lens(given), _times(given)
    if given.through is not None:
        points = np.array([_point(text, "--through") for text in given.through.split(";")])
        return walk(points, lens, given.frames, times, near=pose_files.DEFAULT_NEAR)
    if given.scene is None:
        raise InputError("there is nothing to walk through", fix="give a SCENE, or --through")
    if given.seed < 0:
        raise InputError(f"--seed is {given.seed}", fix="give 0 or more")
    # A place for every twenty frames, so that they are enough for its way.
    points, clearance = free_route(
        _scene(given),
        seed=given.seed,
        places=max(2, given.frames // 20),
        clearance=given.clearance,
        height=given.eye_height,
    )
    # The whole near plane is within the clearance; all but a hundredth of it, for rounding.
    near = 0.99 * clearance / lens.corner
    return walk(points[: given.frames], lens, given.frames, times, near=near)


def _cube(given: argparse.Namespace) -> CameraPath:
    size, near, far = given.size, given.near, given.far
    if given.from_path is None:
        near, far = 0.1 if near is None else near, math.inf if far is None else far
        return CameraPath([Frame(cube_views(_point(given.eye, "--eye"), size, near, far))])
    return _from_path(given.from_path, lambda frame: cube_frame(frame, size, near, far))


def _stereo(given: argparse.Namespace) -> CameraPath:
    return _from_path(given.from_path, lambda frame: stereo_frame(frame, given.eyes, given.screen))


def _from_path(source: str, change: Callable[[Frame], Frame]) -> CameraPath:
    frames = []
    for index, frame in enumerate(load_path(source).frames):
        try:
            frames.append(change(frame))
        except InputError as error:
            raise error.at(source=source, place=f"frames[{index}]") from error
    return CameraPath(frames)


def _cameras(given: argparse.Namespace) -> CameraPath:
    width, height = given.size
    if Path(given.scene).suffix.lower() not in GLTF:
        raise InputError("only glTF files have cameras", source=given.scene, fix="give one")
    return load_path(
        given.scene, width=width, height=height, fps=given.fps, max_memory=memory_of(given)
    )


def _from_poses(given: argparse.Namespace) -> CameraPath:
    lens = None if given.size is None and given.fov is None else _lens(given)
    return pose_files.from_poses(
        Path(given.file),
        find_convention(given.convention),
        lens,
        near=pose_files.DEFAULT_NEAR if given.near is None else given.near,
        far=math.inf if given.far is None else given.far,
        max_memory=memory_of(given),
    )


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    return whole_number(width), whole_number(height)


def _point(text: str, option: str) -> Float64:
    try:
        point = np.array([decimal_number(part.strip()) for part in text.split(",")])
    except ValueError:
        point = np.zeros(0)
    if point.shape != (3,):
        raise InputError(f"{option} {text} is no point", fix="write three numbers: 1.5,2,0")
    return point
