"""Witness files: a claim's ray and the triangles along it, so that it replays by itself."""

from __future__ import annotations

import json
import math
from collections import defaultdict
from collections.abc import Callable, Sequence, Set
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.camera_path import CameraPath
from visref.compiled import njit
from visref.judging.losses import Judged, Losses, Place, worst_places
from visref.judging.misses import Miss, MissKind
from visref.judging.outcome import CullerRecord, witness_json
from visref.run_folder.balls import BALL_ERROR, BLOCK, balls_about
from visref.run_folder.cuts import CutKeeper
from visref.run_folder.miss_facts import causes_json, miss_facts
from visref.run_folder.part import Part
from visref.run_folder.surroundings import Surroundings
from visref.scene import Alpha, Int32, Int64, Scene
from visref.timeline import Timeline
from visref.visibility import mask_states

# A culler that draws nothing misses thousands of objects in every frame. Its worst misses, by
# samples lost, get all the triangles along their rays, and beyond them the worst of every object
# that it is convicted of; every miss has a row in objects.parquet.
WITNESSES_PER_CULLER = 200
# What lies around a witness takes some milliseconds to draw: of the worst misses and of so many
# objects, those that lose most over all frames.
SURROUNDED_OBJECTS = 200

UNIT_ROUNDOFF = 2.0**-53
# d . (w_i x w_j) in float64, with w = v - o and d, o each a sum of three terms. Roundings on
# the longest way to a term: w 1, product 1, difference 1, d 4, product 1, sums 2: 10 in all,
# and (1 + u)^10 - 1 < 16 u. There are six terms, each at most |d| |w_i| |w_j|.
_EDGE_ERROR = 16.0 * 6.0 * UNIT_ROUNDOFF
# F . w: three terms, w 1, product 1, sums 2.
_DEPTH_ERROR = 8.0 * 3.0 * UNIT_ROUNDOFF
# An orthographic origin e + a R + b U has 4 roundings of its own.
_ORIGIN_ERROR = 4.0 * UNIT_ROUNDOFF


@njit()
def _along(
    corners: NDArray[Any],
    origin: NDArray[Any],
    origin_error: float,
    direction: NDArray[Any],
    direction_size: float,
    forward: NDArray[Any],
    near: float,
    balls: NDArray[Any],
) -> NDArray[np.int64]:
    """Triangles that the ray may meet at or behind `near`. Outward: none that it meets is
    left out. `balls`: centre and radius about each `BLOCK` of the corners."""
    found = np.empty(64, np.int64)
    count = 0
    w = np.empty((3, 3))
    size = np.empty(3)
    side = np.empty(3)
    passed = False
    for t in range(len(corners)):
        if t % BLOCK == 0:
            # How far the ray's line passes the ball's centre: |d x w| / |d|.
            d0, d1, d2 = direction
            ball = balls[t // BLOCK]
            w0, w1, w2 = ball[0] - origin[0], ball[1] - origin[1], ball[2] - origin[2]
            cross = (d1 * w2 - d2 * w1) ** 2 + (d2 * w0 - d0 * w2) ** 2 + (d0 * w1 - d1 * w0) ** 2
            length = math.sqrt(d0 * d0 + d1 * d1 + d2 * d2)
            reach = ball[3] + 8.0 * origin_error
            reach += BALL_ERROR * (abs(w0) + abs(w1) + abs(w2) + ball[3])
            passed = math.sqrt(cross) > reach * length
        if passed:
            continue
        deepest = -np.inf
        for i in range(3):
            size[i] = 0.0
            depth = 0.0
            for k in range(3):
                w[i, k] = np.float64(corners[t, i, k]) - origin[k]
                size[i] = max(size[i], abs(w[i, k]))
                depth += forward[k] * w[i, k]
            size[i] += origin_error
            deepest = max(deepest, depth + _DEPTH_ERROR * size[i] + 3.0 * origin_error)
        # Outward: a camera's axes are orthonormal only to 1e-6, so F . w is not quite t.
        if deepest < near - 0.5 * abs(near):
            continue
        positive = False
        negative = False
        for i in range(3):
            j = (i + 1) % 3
            side[i] = (
                direction[0] * (w[i, 1] * w[j, 2] - w[i, 2] * w[j, 1])
                + direction[1] * (w[i, 2] * w[j, 0] - w[i, 0] * w[j, 2])
                + direction[2] * (w[i, 0] * w[j, 1] - w[i, 1] * w[j, 0])
            )
            bound = direction_size * (
                _EDGE_ERROR * size[i] * size[j] + 12.0 * origin_error * (size[i] + size[j])
            )
            positive = positive or side[i] > bound
            negative = negative or side[i] < -bound
        if positive and negative:
            continue
        if count == len(found):
            grown = np.empty(2 * count, np.int64)
            for k in range(count):
                grown[k] = found[k]
            found = grown
        found[count] = t
        count += 1
    return found[:count].copy()


def triangles_along(scene: Scene, camera: Camera, samples: Sequence[int]) -> list[Int64]:
    """For each sample (flat index) the triangles that its ray may meet: (n,) int64 ascending ids.

    Outward: a triangle that the ray meets in the camera's range is never left out, one that
    it passes closely may be listed too.
    """
    corners = scene.vertices[scene.triangles]
    return _triangles_along(corners, balls_about(corners), camera, samples)


def _triangles_along(
    corners: NDArray[Any], balls: NDArray[np.float64], camera: Camera, samples: Sequence[int]
) -> list[Int64]:
    forward = camera.forward
    result = []
    for sample in samples:
        x, y = sample % camera.width, sample // camera.width
        origin, direction = camera.ray(x, y)
        a, b = abs(camera.column_a[x]), abs(camera.row_b[y])
        spread = np.abs(camera.right_step).max() * a + np.abs(camera.up_step).max() * b
        if camera.is_perspective:
            origin_error = 0.0
            direction_size = float(np.abs(forward).max() + spread)
        else:
            origin_error = float(_ORIGIN_ERROR * (np.abs(camera.eye).max() + spread))
            direction_size = float(np.abs(forward).max())
        result.append(
            _along(
                corners,
                origin,
                origin_error,
                direction,
                direction_size,
                forward,
                camera.near,
                balls,
            )
        )
    return result


def write_witnesses(
    file: Path,
    timeline: Timeline,
    path: CameraPath,
    record: CullerRecord,
    drawn: Callable[[int, str], NDArray[np.bool_]],
    cuts: CutKeeper | None = None,
    part: Part | None = None,
) -> None:
    """One JSON line for each of the culler's worst misses, at least one of every object with a
    confirmed one, by frame, view and object.

    `drawn` gives the drawn triangles of a frame's view, (t,) bool. `cuts`: what was kept around the
    misses; the worst of them, and the worst of the objects that lose most, get their surroundings.
    Of a `part`, all that the whole run may have are written, with their surroundings.
    """
    by_view, surrounded = choose(record, part)
    scene: Scene | None = None
    with file.open("w", encoding="utf-8") as lines:
        for frame, view in sorted(by_view):
            (camera,) = (camera for camera in path.views(frame) if camera.view == view)
            if scene is None or timeline.at(frame) is not scene:
                # Once for all frames that are alike: on a large scene these take longer than rays.
                scene = timeline.at(frame)
                corners = scene.vertices[scene.triangles]
                balls = balls_about(corners)
                around = Surroundings(scene, balls)
            chosen = sorted(by_view[frame, view], key=lambda miss: miss.object)
            shown = drawn(frame, view)
            along = _triangles_along(corners, balls, camera, [miss.sample for miss in chosen])
            for miss, triangles in zip(chosen, along, strict=True):
                state = mask_states(
                    scene, camera, np.full(len(triangles), miss.sample), triangles.astype(np.int32)
                )
                witness: dict[str, Any] = witness_json(scene, frame, miss)
                witness["culler"] = record.spec
                witness["causes"] = causes_json(record, frame, view, miss.object)
                witness["samples"] = camera.definition()
                witness["triangles"] = [
                    _triangle_json(scene, int(t), drawn=bool(shown[t]), state=int(s))
                    for t, s in zip(triangles, state, strict=True)
                ]
                cut = None
                if cuts is not None and (frame, view, miss.object) in surrounded:
                    cut = cuts.get(frame, view, miss.object)
                witness["facts"] = miss_facts(scene, camera, record, miss, cut)
                if cut is not None:
                    witness["surroundings"] = around.record(
                        camera, cut, miss.object, miss.sample, shown
                    )
                lines.write(json.dumps(witness, sort_keys=True) + "\n")


Chosen = tuple[dict[tuple[int, str], list[Miss]], set[tuple[int, str, int]]]


def choose(record: CullerRecord, part: Part | None = None) -> Chosen:
    """The misses that get a witness, by frame and view; and by frame, view and object, those of
    them that get their surroundings. Of a `part`, all that may be among them in the whole run."""
    rows = record.frames
    open_ = part.open if part is not None else frozenset()
    most_lost = set(Losses.of(rows).object[:SURROUNDED_OBJECTS].tolist())
    top = worst_places(rows, WITNESSES_PER_CULLER)
    first = _first_of_each(rows, open_)
    places: dict[int, set[int]] = defaultdict(set)
    for row, place in (*top, *first):
        places[row].add(place)
    worst = set(top)
    by_view: dict[tuple[int, str], list[Miss]] = defaultdict(list)
    surrounded: set[tuple[int, str, int]] = set()
    for row, mine in sorted(places.items()):
        frame, some = rows[row].frame, sorted(mine)
        for place, miss in zip(some, rows[row].verdict.misses.picked(np.array(some)), strict=True):
            by_view[frame, miss.view].append(miss)
            if (row, place) in worst or part is not None or miss.object in most_lost:
                surrounded.add((frame, miss.view, miss.object))
    return by_view, surrounded


def _first_of_each(rows: Sequence[Judged], open_: Set[int]) -> list[Place]:
    """The worst confirmed miss of each object; and of `open_` frames, in which some that are
    confirmed may yet be accepted, besides all that are worse than that."""
    known = Losses.of(rows, open_)
    found = list(zip(known.row.tolist(), known.place.tolist(), strict=True))
    best = {
        obj: (-samples, row)
        for obj, samples, row in zip(
            known.object.tolist(), known.most.tolist(), known.row.tolist(), strict=True
        )
    }
    for number, row in enumerate(rows):
        if row.frame not in open_:
            continue
        misses = row.verdict.misses
        at = np.flatnonzero(misses.are(MissKind.CONFIRMED))
        columns = misses.columns
        for place, obj, samples in zip(
            at.tolist(), columns.object[at].tolist(), columns.samples[at].tolist(), strict=True
        ):
            if obj not in best or (-samples, number) < best[obj]:
                found.append((number, place))
    return found


def _triangle_json(scene: Scene, triangle: int, *, drawn: bool, state: int) -> dict[str, Any]:
    """`state`: what its mask says at the sample, written for a masked triangle alone."""
    owner = int(scene.object_of_triangle[triangle])
    corners: Int32 = scene.triangles[triangle]
    return {
        "triangle": triangle,
        "object": owner,
        "object_name": scene.names[owner],
        "drawn": drawn,
        "one_sided": bool(scene.one_sided[triangle]),
        "alpha": int(scene.alpha[triangle]),
        **({"mask": state} if scene.alpha[triangle] == Alpha.MASK else {}),
        "vertices": [[float(value).hex() for value in scene.vertices[v]] for v in corners],
    }
