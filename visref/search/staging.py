"""How a generated scene is looked at: the lens, the path of its cameras, their views, and where in
the world all of it stands.

The camera looks down -Z from the origin, in whose pixels things are laid out, in one frame at
least; the others come from it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera, look_at
from visref.search.kinds import YES, Catalogue, Gene, log, register, whole

LENSES: Catalogue = {}
PATHS: Catalogue = {}
VIEWS: Catalogue = {}
WORLDS: Catalogue = {}

Float64 = NDArray[np.float64]

# Sides of images in pixels: multiples of what tiles and cells measure, one less, one more, others.
_SIDES = ((64, 48), (61, 47), (33, 17), (17, 33), (96, 72), (100, 70), (40, 40), (65, 49),
          (127, 2), (1, 40), (9, 5), (5, 13), (1, 1), (63, 31), (48, 64))  # fmt: skip
# Small ones are cheap, and show little: most have the first few sizes.
_SIZE = whole(0, 3 * len(_SIDES) - 1)
_NEARS = (0.1, 0.1, 0.1, 0.5, 1.0, 1e-3)
_FARS = (200.0, 200.0, math.inf, 64.0, 30.0, 1e6)
_NEAR, _FAR = whole(0, len(_NEARS) - 1), whole(0, len(_FARS) - 1)


def _image(size: float) -> tuple[int, int]:
    at = int(size)
    return _SIDES[at] if at < len(_SIDES) else _SIDES[at % 6]


@register(LENSES, 6.0, size=_SIZE, yfov=log(0.5, 1.6), near=_NEAR, far=_FAR)
def straight(size, yfov, near, far):  # type: ignore[no-untyped-def]
    """perspective, of any size"""
    return _lens(size, near, far, yfov=yfov)


@register(LENSES, 0.7, size=_SIZE, yfov=Gene(1.6, 2.6), near=_NEAR, far=_FAR)
def wide(size, yfov, near, far):  # type: ignore[no-untyped-def]
    """a wide angle, where distance is far from depth"""
    return _lens(size, near, far, yfov=yfov)


@register(LENSES, 1.8, size=_SIZE, yfov=log(0.5, 1.6), near=_NEAR, far=_FAR, x=Gene(-60.0, 60.0),
          y=Gene(-40.0, 40.0), part=YES)  # fmt: skip
def shifted(size, yfov, near, far, x, y, part):  # type: ignore[no-untyped-def]
    """a lens shift: an off-centre frustum, or jitter of a part of a pixel"""
    share = 1.0 if part else 0.01
    return replace(_lens(size, near, far, yfov=yfov), shift_x_px=share * x, shift_y_px=share * y)


@register(LENSES, 1.5, size=_SIZE, ymag=log(0.5, 12.0), near=_NEAR, far=_FAR)
def parallel(size, ymag, near, far):  # type: ignore[no-untyped-def]
    """orthographic"""
    return _lens(size, near, far, ymag=ymag)


@register(LENSES, 0.9, size=_SIZE, yfov=log(0.5, 1.6), depth=log(1.2, 30.0), tilt=Gene(-1.0, 1.0),
          aside=Gene(-1.0, 1.0), before=YES)  # fmt: skip
def clipped(size, yfov, depth, tilt, aside, before):  # type: ignore[no-untyped-def]
    """a clip plane across the view: what it cuts off hides nothing"""
    normal = np.array([tilt, aside, -1.0])
    normal = normal / np.linalg.norm(normal)
    plane = (*normal.tolist(), float(normal[2] * depth))
    if not before:
        plane = tuple(-value for value in plane)
    return replace(_lens(size, 0, 0, yfov=yfov), clip_plane=plane)


def _lens(
    size: float, near: float, far: float, yfov: float | None = None, ymag: float | None = None
) -> Camera:
    width, height = _image(size)
    near, far = _NEARS[int(near)], _FARS[int(far)]
    return Camera(np.eye(4), width, height, near=near, far=far, yfov=yfov, ymag=ymag)


# Paths: frames of one camera each.


def _moved(camera: Camera, by: Float64, yaw: float = 0.0, pitch: float = 0.0) -> Camera:
    """The camera carried along and turned about its own axes."""
    (sy, cy), (sp, cp) = ((math.sin(turn), math.cos(turn)) for turn in (yaw, pitch))
    about_y = np.array([[cy, 0.0, sy], [0.0, 1.0, 0.0], [-sy, 0.0, cy]])
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cp, -sp], [0.0, sp, cp]])
    pose = camera.world_from_camera.copy()
    pose[:3, 3] += by
    pose[:3, :3] = pose[:3, :3] @ about_y @ about_x
    return replace(camera, world_from_camera=pose)


@register(PATHS, 4.0)
def one_frame(view):  # type: ignore[no-untyped-def]
    """a single frame"""
    return [view]


@register(PATHS, 2.0, frames=whole(2, 4), x=Gene(-1.0, 1.0), y=Gene(-0.5, 0.5), z=Gene(-1.0, 1.0),
          size=log(0.005, 4.0), last=YES)  # fmt: skip
def walk(view, frames, x, y, z, size, last):  # type: ignore[no-untyped-def]
    """a walk: what was hidden comes into view little by little"""
    step = size * np.array([x, y, z])
    first = 0 if not last else 1 - int(frames)
    return [_moved(view, (first + k) * step) for k in range(int(frames))]


@register(PATHS, 2.0, aside=log(8.0, 400.0), sign=YES, times=whole(1, 2), lens=YES)
def coming_back(view, aside, sign, times, lens):  # type: ignore[no-untyped-def]
    """aside and back, and the same again: what memory holds of the first is old in the second"""
    by = aside if sign else -aside
    if lens:
        away = replace(view, shift_x_px=view.shift_x_px + by)
    else:
        away = _moved(view, np.array([by / 20.0, 0.0, 0.0]))
    return [away, view] * int(times)


@register(PATHS, 1.5, frames=whole(2, 5), turn=Gene(-3.1, 3.1), pitch=Gene(-0.5, 0.5), cut=YES)
def turning(view, frames, turn, pitch, cut):  # type: ignore[no-untyped-def]
    """a fast turn, without a word, and back"""
    found = [_moved(view, np.zeros(3), k * turn, k * pitch) for k in range(int(frames) - 1)]
    return [replace(found[-1], cut=bool(cut)), *found[::-1], view]


@register(PATHS, 1.5, frames=whole(2, 4), reach=log(1.0, 40.0), seed=whole(0, 9999), cut=YES)
def jumping(view, frames, reach, seed, cut):  # type: ignore[no-untyped-def]
    """cuts to other places, announced or not"""
    rng = np.random.default_rng(int(seed))
    views = []
    for _ in range(int(frames) - 1):
        eye = rng.uniform(-1.0, 1.0, 3) * reach
        pose = look_at(eye, np.array([0.0, 0.0, -8.0]) + rng.normal(0.0, 1.0, 3))
        views.append(replace(view, world_from_camera=pose, cut=bool(cut)))
    return [*views, replace(view, cut=bool(cut))]


@register(PATHS, 1.4, frames=whole(2, 4), zoom=log(0.4, 2.5), roll=Gene(-3.2, 3.2), size=_SIZE,
          sizes=YES)  # fmt: skip
def changing_lens(view, frames, zoom, roll, size, sizes):  # type: ignore[no-untyped-def]
    """another angle, roll or image size in each frame"""
    views = [view]
    for k in range(1, int(frames)):
        s, c = math.sin(k * roll), math.cos(k * roll)
        pose = np.eye(4)
        pose[:2, :2] = [[c, -s], [s, c]]
        other = replace(view, world_from_camera=pose)
        if other.yfov is not None:
            other = replace(other, yfov=min(other.yfov * zoom**k, 3.0))
        elif other.ymag is not None:
            other = replace(other, ymag=other.ymag * zoom**k)
        if sizes and k % 2:
            width, height = _image(size)
            other = replace(other, width=width, height=height)
        views.append(other)
    return views


@register(PATHS, 0.8, reach=log(0.3, 8.0), frames=whole(2, 4))
def into(view, reach, frames):  # type: ignore[no-untyped-def]
    """straight into things: eyes inside boxes, near planes across them"""
    step = reach * np.array([0.0, 0.0, -1.0])
    return [_moved(view, k * step) for k in range(int(frames))]


@register(PATHS, 0.8, frames=whole(3, 5))
def standing(view, frames):  # type: ignore[no-untyped-def]
    """the same view again and again"""
    return [view] * int(frames)


# Views: of each frame's camera, those of the frame.


@register(VIEWS, 8.0)
def one(camera):  # type: ignore[no-untyped-def]
    """one view"""
    return (camera,)


@register(VIEWS, 1.0, apart=log(0.03, 3.0), turn=Gene(-0.6, 0.6), other=YES)
def two(camera, apart, turn, other):  # type: ignore[no-untyped-def]
    """two eyes, or two windows of other sizes that look elsewhere"""
    aside = camera.world_from_camera[:3, 0] * apart
    right = _moved(camera, aside, turn if other else 0.0)
    if other:
        right = replace(right, width=camera.height, height=camera.width)
    return replace(camera, view="left"), replace(right, view="right")


@register(VIEWS, 0.4, side=whole(8, 33))
def cube(camera, side):  # type: ignore[no-untyped-def]
    """the six sides of a cube"""
    turns = ((0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0))
    square = replace(
        camera, width=int(side), height=int(side), yfov=math.pi / 2, ymag=None, shift_x_px=0.0,
        shift_y_px=0.0, near=max(camera.near, 1e-3),
    )  # fmt: skip
    half = math.pi / 2
    return tuple(
        replace(_moved(square, np.zeros(3), yaw * half, pitch * half), view=f"side {k}")
        for k, (yaw, pitch) in enumerate(turns)
    )


@register(VIEWS, 0.5, above=log(3.0, 60.0), ymag=log(1.0, 20.0))
def a_map(camera, above, ymag):  # type: ignore[no-untyped-def]
    """a picture and its map from above"""
    eye = camera.eye + np.array([0.0, above, 0.0])
    pose = look_at(eye, eye - np.array([0.0, 1.0, 0.0]))
    seen = Camera(pose, 40, 40, near=0.1, far=200.0, ymag=ymag, view="map", cut=camera.cut)
    return replace(camera, view="picture"), seen


# Worlds: (4, 4) world_from_stage, the scene's own origin, and how its objects are called.

World = tuple[Float64, Float64]


@register(WORLDS, 5.0)
def as_it_is() -> World:
    """the world's own axes and origin"""
    return np.eye(4), np.zeros(3)


@register(WORLDS, 2.0, a=Gene(-3.2, 3.2), b=Gene(-1.5, 1.5), c=Gene(-3.2, 3.2),
          away=log(0.01, 100.0))  # fmt: skip
def turned(a, b, c, away) -> World:  # type: ignore[no-untyped-def]
    """everything turned, so that no axis is the world's"""
    result = np.eye(4)
    for angle, axis in ((a, 0), (b, 1), (c, 2)):
        j, k = (axis + 1) % 3, (axis + 2) % 3
        turn = np.eye(4)
        turn[j, j] = turn[k, k] = math.cos(angle)
        turn[j, k], turn[k, j] = -math.sin(angle), math.sin(angle)
        result = result @ turn
    result[:3, 3] = away * np.array([1.0, 0.3, -0.7])
    return result, np.zeros(3)


@register(WORLDS, 0.9, x=Gene(-1.0, 1.0), z=Gene(-1.0, 1.0), far=log(1e3, 6.4e6))
def far_out(x, z, far) -> World:  # type: ignore[no-untyped-def]
    """far from the world's origin, about an origin of its own"""
    # Whole multiples of 16, as a reader of such a scene finds them.
    origin = np.rint(far * np.array([x, 0.4, z]) / 16.0) * 16.0
    return np.eye(4), origin


@register(WORLDS, 0.8, x=Gene(-1.0, 1.0), z=Gene(-1.0, 1.0), far=log(1e2, 1e6))
def coarse(x, z, far) -> World:  # type: ignore[no-untyped-def]
    """far out in plain float32, which is coarse there"""
    result = np.eye(4)
    result[:3, 3] = far * np.array([x, 0.4, z])
    return result, np.zeros(3)


Placing = Callable[..., World]
