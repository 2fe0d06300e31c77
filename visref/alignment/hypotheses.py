"""The ordinary mistakes, each with what undoes it: a small function of a camera or of a cell.

A hypothesis says how the recording would have to be read for it to fit. Each is named by what the
user would see ("if the camera looks along +Z"), and says how to mend it. Those with the same
`kind` that tell of one mistake in several ways (frames 1 to 3 late) stand apart all the same:
which of them it is, is the answer.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.errors import InputError
from visref.scene import Float64

Bool = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Cell:
    """A drawn set as it was recorded. `place`: of its frame, in the path; `views`: of its
    cameras, in the frame's order; `drawn`: (n,) bool, by object."""

    place: int
    views: tuple[int, ...]
    drawn: Bool


# What a camera becomes, and what a cell becomes on a path of so many frames, whose frame has so
# many views; None where there is no such thing.
CameraChange = Callable[[Camera], Camera | None]
CellChange = Callable[[Cell, int, int], Cell | None]


_WORLD = (0.0, 0.0, 0.0)


def _same_camera(camera: Camera) -> Camera:
    return camera


def _same_cell(cell: Cell, frames: int, views: int) -> Cell:
    return cell


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """One way in which the input may be wrong. `name`: what it is called in tables; `reading`: how
    the recording fits, after "if"; `fix`: what to do; `engine`: the fault by which an engine itself
    gives the very same answers, empty where none would. `sound`: such an engine is at no fault as
    long as it loses nothing, so nothing is said of it. `turned`: the scene's triangles are turned
    about. `over_time`: it is about the order of frames."""

    name: str
    reading: str
    fix: str
    engine: str = ""
    camera: CameraChange = _same_camera
    cell: CellChange = _same_cell
    turned: bool = False
    sound: bool = False
    over_time: bool = False


def posed(change: Callable[[Float64], Float64]) -> CameraChange:
    """By a function of the pose, (4, 4) float64, in world coordinates."""

    def changed(camera: Camera) -> Camera | None:
        world = camera.relative_to(_WORLD)
        try:
            made = replace(world, world_from_camera=change(world.world_from_camera))
        except InputError:
            return None
        return made.relative_to(camera.origin)

    return changed


def with_lens(**change: Callable[[Camera], float | None]) -> CameraChange:
    """By fields, each a function of the camera; None where one has nothing to change."""

    def changed(camera: Camera) -> Camera | None:
        values = {name: value(camera) for name, value in change.items()}
        if any(value is None for value in values.values()):
            return None
        try:
            return replace(camera, **values)  # type: ignore[arg-type]
        except InputError:
            return None

    return changed


def _conjugated(signs: tuple[float, float, float]) -> Callable[[Float64], Float64]:
    mirror = np.diag([*signs, 1.0])
    return lambda world: np.asarray(mirror @ world @ mirror)


def _turned_by(rotation: list[list[float]]) -> Callable[[Float64], Float64]:
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    return lambda world: np.asarray(matrix @ world)


def _transposed(world: Float64) -> Float64:
    result = world.copy()
    result[:3, :3] = world[:3, :3].T
    return result


# World axes of a scene with +Y up from those of one with +Z up, and back.
_Y_UP_FROM_Z_UP = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]
_Z_UP_FROM_Y_UP = [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]


def _poses() -> Iterator[Hypothesis]:
    write = "write world_from_camera with columns right, up, back, eye"
    about = np.diag([-1.0, 1.0, -1.0, 1.0])
    yield Hypothesis(
        "looks along +Z",
        "the camera looks along +Z",
        f"{write}: negate its third column, and its first (+Y up) or second (+Y down, as OpenCV)",
        camera=posed(lambda world: np.asarray(world @ about)),
    )
    for axis, signs in (("x", (-1.0, 1.0, 1.0)), ("y", (1.0, -1.0, 1.0)), ("z", (1.0, 1.0, -1.0))):
        yield Hypothesis(
            f"mirrored in {axis}",
            f"the path's world has its {axis} axis the other way (left-handed)",
            f"negate row and column {'xyz'.index(axis)} of each pose",
            camera=posed(_conjugated(signs)),
        )
    yield Hypothesis(
        "path is Z up",
        "the path is in a world with +Z up",
        "turn each pose to +Y up: (x, y, z) becomes (x, z, -y)",
        camera=posed(_turned_by(_Y_UP_FROM_Z_UP)),
    )
    yield Hypothesis(
        "scene is Z up",
        "the scene stands with +Z up and the path with +Y",
        "export the scene with +Y up, or turn each pose: (x, y, z) becomes (x, -z, y)",
        camera=posed(_turned_by(_Z_UP_FROM_Y_UP)),
    )
    mirror = _conjugated((1.0, 1.0, -1.0))
    turn = _turned_by(_Y_UP_FROM_Z_UP)
    yield Hypothesis(
        "path is Z up, left-handed",
        "the path is in a left-handed world with +Z up",
        "turn each pose to +Y up, and negate row and column 2",
        camera=posed(lambda world: mirror(turn(world))),
    )
    yield Hypothesis(
        "inverse matrix",
        "the matrices are camera_from_world",
        "write their inverses, world_from_camera",
        camera=posed(lambda world: np.asarray(np.linalg.inv(world), np.float64)),
    )
    yield Hypothesis(
        "transposed rotation",
        "the rotations are transposed",
        "write row-major rows; the camera's axes are columns",
        camera=posed(_transposed),
    )


def _units() -> Iterator[Hypothesis]:
    for unit, factor in (
        ("centimetres", 0.01),
        ("millimetres", 0.001),
        ("hundreds of metres", 100.0),
        ("kilometres", 1000.0),
    ):

        def scaled(camera: Camera, factor: float = factor) -> Camera | None:
            world = camera.relative_to(_WORLD)
            pose = world.world_from_camera.copy()
            pose[:3, 3] *= factor
            made = replace(
                world,
                world_from_camera=pose,
                near=camera.near * factor,
                far=camera.far * factor,
                ymag=None if camera.ymag is None else camera.ymag * factor,
            )
            return made.relative_to(camera.origin)

        yield Hypothesis(
            f"units × {factor:g}",
            f"the path's unit is {factor:g} of the scene's ({unit} for metres)",
            f"multiply positions, near and far by {factor:g}",
            camera=scaled,
        )


def _fov(change: Callable[[Camera, float], float]) -> CameraChange:
    return with_lens(
        yfov=lambda camera: None if camera.yfov is None else change(camera, camera.yfov)
    )


def _lenses() -> Iterator[Hypothesis]:
    culls = "the engine culls by that field of view"
    yield Hypothesis(
        "degrees for radians",
        "yfov was turned to radians twice",
        "give yfov in radians",
        camera=_fov(lambda _, yfov: math.degrees(yfov)),
    )
    yield Hypothesis(
        "horizontal field of view",
        "yfov is the horizontal field of view",
        "give the vertical one: 2 atan(tan(x / 2) · height / width)",
        culls,
        camera=_fov(
            lambda camera, yfov: 2 * math.atan(math.tan(yfov / 2) * camera.height / camera.width)
        ),
    )
    yield Hypothesis(
        "vertical taken as horizontal",
        "the engine's horizontal field of view is yfov × width / height, of tangents, once more",
        "give yfov as the engine's vertical field of view",
        culls,
        camera=_fov(
            lambda camera, yfov: 2 * math.atan(math.tan(yfov / 2) * camera.width / camera.height)
        ),
    )
    for name, factor in (("half", 0.5), ("double", 2.0)):
        yield Hypothesis(
            f"{name} the field of view",
            f"the field of view is {name} of yfov",
            "give the whole vertical angle, not the half" if factor > 1 else "halve yfov",
            culls,
            camera=_fov(lambda _, yfov, factor=factor: yfov * factor),  # type: ignore[misc]
        )
    aspect = "the engine culls by that aspect ratio"
    yield Hypothesis(
        "square picture",
        "the picture is as wide as high",
        "give width and height as the engine's",
        aspect,
        camera=with_lens(width=lambda c: None if c.width == c.height else c.height),
    )
    yield Hypothesis(
        "width and height swapped",
        "width and height are swapped",
        "swap width and height",
        aspect,
        camera=with_lens(
            width=lambda c: None if c.width == c.height else c.height, height=lambda c: c.width
        ),
    )
    yield Hypothesis(
        "near and far ignored",
        "near and far hide nothing",
        "give near and far as the engine's, in the scene's units",
        "the engine does not cull by them",
        sound=True,
        camera=with_lens(
            near=lambda c: c.near * 2.0**-10 if c.is_perspective else c.near,
            far=lambda c: math.inf if math.isfinite(c.far) or c.is_perspective else None,
        ),
    )
    shifts = "the engine culls by that shift"
    for name, x, y in (("x", -1.0, 1.0), ("y", 1.0, -1.0), ("x and y", -1.0, -1.0)):
        flipped = " (y counts up there)" if y < 0 else ""
        yield Hypothesis(
            f"lens shift's sign in {name}",
            f"the lens shift has the other sign in {name}{flipped}",
            f"negate the shift in {name}: x counts to the right, y down",
            shifts,
            camera=with_lens(
                shift_x_px=lambda c, x=x: None if x < 0 and not c.shift_x_px else x * c.shift_x_px,  # type: ignore[misc]
                shift_y_px=lambda c, y=y: None if y < 0 and not c.shift_y_px else y * c.shift_y_px,  # type: ignore[misc]
            ),
        )


def _numbers() -> Iterator[Hypothesis]:
    for by in (1, 2, 3, -1, -2, -3):

        def moved(cell: Cell, frames: int, views: int, by: int = by) -> Cell | None:
            place = cell.place - by
            return replace(cell, place=place) if 0 <= place < frames else None

        size = abs(by)
        noun = "frame" if size == 1 else "frames"
        way = "later" if by > 0 else "earlier"
        shift = f"subtract {size} from" if by > 0 else f"add {size} to"
        yield Hypothesis(
            f"frames {by:+d}",
            f"what was drawn is written {size} {noun} {way} than its camera",
            f"{shift} the recording's frame numbers",
            f"the engine answers {size} {noun} late" if by > 0 else "",
            cell=moved,
            over_time=True,
        )
    yield Hypothesis(
        "reversed path",
        "the path runs backwards",
        "write its frames in the order in which they were drawn",
        cell=lambda cell, frames, _: replace(cell, place=frames - 1 - cell.place),
        over_time=True,
    )
    for by in (1, -1):

        def renumbered(cell: Cell, frames: int, views: int, by: int = by) -> Cell:
            drawn = np.zeros_like(cell.drawn)
            # An id written is the object's own plus `by`.
            if by > 0:
                drawn[:-1] = cell.drawn[1:]
            else:
                drawn[1:] = cell.drawn[:-1]
            return replace(cell, drawn=drawn)

        yield Hypothesis(
            f"ids {by:+d}",
            f"each id is one too {'high' if by > 0 else 'low'}",
            "number objects from 0, as `visref objects` lists them, or name them",
            "the engine's own list is off by one",
            cell=renumbered,
        )
    yield Hypothesis(
        "complement",
        "the recording lists what was culled",
        "list what was drawn",
        cell=lambda cell, *_: replace(cell, drawn=~cell.drawn),
    )
    yield Hypothesis(
        "eyes swapped",
        "the views are swapped",
        "give each view's own list under its name",
        "the engine takes one view's answer for the other",
        cell=lambda cell, _, views: (
            replace(cell, views=(1 - cell.views[0],))
            if views == 2 and len(cell.views) == 1
            else None
        ),
    )


def shifted(name: str, offset: Float64) -> Hypothesis:
    """The engine's scene has been moved so that `offset`, (3,) float64 in world space, became its
    origin, and the path is of that."""

    def moved(world: Float64) -> Float64:
        result = world.copy()
        result[:3, 3] += offset
        return result

    numbers = ", ".join(f"{value:.6g}" for value in offset)
    return Hypothesis(
        f"origin at {name}",
        f"the engine has the scene's {name} at its origin",
        f"add ({numbers}) to each position, or do not move the scene when importing it",
        camera=posed(moved),
    )


HYPOTHESES: tuple[Hypothesis, ...] = (
    *_poses(),
    *_units(),
    *_lenses(),
    *_numbers(),
    Hypothesis(
        "inside out",
        "the triangles are wound the other way",
        "turn the winding, or leave --cull-backfaces out",
        "the engine culls the faces that look at the eye",
        turned=True,
    ),
)
