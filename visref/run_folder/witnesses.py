"""Witness files: a claim's ray and the triangles along it, so that it replays by itself."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence, Set
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.camera_path import CameraPath
from visref.judging.losses import Judged, Losses, Place, worst_places
from visref.judging.misses import Miss, MissKind
from visref.judging.outcome import CullerRecord, witness_json
from visref.run_folder.along import triangles_along as triangles_along
from visref.run_folder.along import triangles_near
from visref.run_folder.balls import balls_about
from visref.run_folder.cuts import CutKeeper
from visref.run_folder.miss_facts import causes_json, miss_facts
from visref.run_folder.part import Part
from visref.run_folder.surroundings import Surroundings
from visref.scene import Alpha, Int64, Scene
from visref.timeline import Timeline
from visref.visibility import mask_states

# A culler that draws nothing misses thousands of objects in every frame. Its worst misses, by
# samples lost, get all the triangles along their rays, and beyond them the worst of every object
# that it is convicted of; every miss has a row in objects.parquet.
WITNESSES_PER_CULLER = 200
# What lies around a witness takes some milliseconds to draw, and some 10 kB: of the worst misses
# and of so many objects, those that lose most over all frames. Of most of these it is the only
# picture that the page has.
SURROUNDED_OBJECTS = 1000


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
            samples = np.array([miss.sample for miss in chosen])
            along = triangles_near(corners, balls, camera, samples)
            met = _triangles_json(scene, camera, samples, along, shown)
            definition = camera.definition()
            for miss, triangles in zip(chosen, met, strict=True):
                witness: dict[str, Any] = witness_json(scene, frame, miss)
                witness["culler"] = record.spec
                witness["causes"] = causes_json(record, frame, view, miss.object)
                witness["samples"] = definition
                witness["triangles"] = triangles
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


def _triangles_json(
    scene: Scene,
    camera: Camera,
    samples: Int64,
    along: Sequence[Int64],
    drawn: NDArray[np.bool_],
) -> Iterator[list[dict[str, Any]]]:
    """What is told of the triangles along the ray of each sample. `drawn`: (t,) bool; a masked
    triangle is told with what its mask says at the sample."""
    counts = [len(one) for one in along]
    every = np.concatenate([*along, np.zeros(0, np.int64)])
    state = mask_states(scene, camera, np.repeat(samples, counts), every.astype(np.int32))
    owner = scene.object_of_triangle[every]
    corners = scene.vertices[scene.triangles[every]].astype(np.float64)
    rows = zip(
        every.tolist(),
        owner.tolist(),
        drawn[every].tolist(),
        scene.one_sided[every].tolist(),
        scene.alpha[every].tolist(),
        state.tolist(),
        corners.tolist(),
        strict=True,
    )
    told = (
        {
            "triangle": triangle,
            "object": obj,
            "object_name": scene.names[obj],
            "drawn": shown,
            "one_sided": one_sided,
            "alpha": alpha,
            **({"mask": mask} if alpha == Alpha.MASK else {}),
            "vertices": [[value.hex() for value in corner] for corner in points],
        }
        for triangle, obj, shown, one_sided, alpha, mask, points in rows
    )
    return (list(islice(told, count)) for count in counts)
