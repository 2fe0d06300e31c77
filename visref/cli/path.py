"""visref path: make camera paths: the six views of a cube map from one eye."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from visref.camera_path import CameraPath, Frame
from visref.cli.terminal import OUT
from visref.errors import InputError
from visref.files import replacing_file
from visref.formats import load_path
from visref.judging.status import Exit
from visref.numerals import decimal_number, whole_number
from visref.recordings.cube import cube_frame, cube_views
from visref.scene import Float64
from visref.wording import counted


def add_arguments(parser: argparse.ArgumentParser) -> None:
    kinds = parser.add_subparsers(required=True, metavar="KIND")
    cube = kinds.add_parser(
        "cube", help="six views of one eye, 90 degrees each: px, nx, py, ny, pz, nz"
    )
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
    cube.add_argument(
        "--near", type=decimal_number, metavar="D", help="default: 0.1, or the path's"
    )
    cube.add_argument(
        "--far", type=decimal_number, metavar="D", help="default: infinite, or the path's"
    )
    cube.add_argument("--out", type=Path, required=True, metavar="FILE.json")
    cube.set_defaults(make=_cube)


def run(given: argparse.Namespace) -> Exit:
    make: Callable[[argparse.Namespace], CameraPath] = given.make
    path = make(given)
    with replacing_file(given.out) as file:
        file.write_text(json.dumps(path.to_json(), allow_nan=False) + "\n", encoding="utf-8")
    views = sum(len(frame.cameras) for frame in path.frames)
    OUT.line(f"{given.out}: {counted(len(path), 'frame')}, {counted(views, 'view')}")
    return Exit.NO_VIOLATION


def _cube(given: argparse.Namespace) -> CameraPath:
    size, near, far = given.size, given.near, given.far
    if given.from_path is None:
        near, far = 0.1 if near is None else near, math.inf if far is None else far
        return CameraPath([Frame(cube_views(_eye(given.eye), size, near, far))])
    frames = []
    for index, frame in enumerate(load_path(given.from_path).frames):
        try:
            frames.append(cube_frame(frame, size, near, far))
        except InputError as error:
            raise error.at(source=given.from_path, place=f"frames[{index}]") from error
    return CameraPath(frames)


def _eye(text: str) -> Float64:
    try:
        eye = np.array([decimal_number(part) for part in text.split(",")])
    except ValueError:
        eye = np.zeros(0)
    if eye.shape != (3,):
        raise InputError(f"--eye {text} is no point", fix="write three numbers: 1.5,2,0")
    return eye
