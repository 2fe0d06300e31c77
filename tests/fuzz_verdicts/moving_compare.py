"""A case in motion through visref, from its files to the exit status, beside the brute force on
each frame's scene as it was baked."""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from tests.fuzz_verdicts import brute
from tests.fuzz_verdicts.case import Triangle
from tests.fuzz_verdicts.compare import (
    COUNTS,
    ENGINES,
    Compared,
    Drawn,
    Kept,
    States,
    clears_only,
    exact_differs,
    lost_samples,
    status_differs,
)
from tests.fuzz_verdicts.moving_case import MovingCase
from visref.camera_path import CameraPath
from visref.formats.loading import load_path, load_scene
from visref.judging.referee import Referee
from visref.scene import Scene
from visref.timeline import Timeline

# visref and the evaluation both round float64 results to float32 once, each with an error before:
# some hundred operations on numbers of up to 2^6, beside the distance from the world's origin,
# which skins and matrices carry along: below 2^-53 * 2^8 of the greatest number.
ERROR = 2.0**-45


def compare_moving(
    case: MovingCase, folder: Path, engines: Sequence[str] = tuple(ENGINES)
) -> Compared:
    """Judge the case with each engine and by brute force."""
    result = Compared()
    scene_file, path_file = folder / "moving.glb", folder / "moving.path.json"
    scene_file.write_bytes(case.glb)
    path_file.write_text(json.dumps(case.path))
    scene = load_scene(scene_file, cull_backfaces=case.cull_backfaces)
    path = load_path(path_file).relative_to(scene.origin)
    if scene.object_of_triangle.tolist() != [t.object for t in case.triangles(0)]:
        result.differences.append("reading: other triangles")
        return result
    timeline = Timeline(scene, path)
    seen = _samples(case, timeline, path, result)
    if result.differences:
        return result
    expected = []
    for (frame, views), drawn in zip(case.cells, case.drawn, strict=True):
        here = case.present(frame)
        units = [[i for i in unit if here[i]] for unit in case.unit_lists]
        samples = [sample for view in views for sample in seen[frame, view]]
        expected.append(brute.judge(samples, case.triangles(frame), units, drawn, case.promise))
    for name in engines:
        kept = Kept()
        culler = Drawn(case.unit_lists, case.promise, case.drawn, joint=case.joint)
        engine = partial(ENGINES[name], timeline.still, threads=1)
        referee = Referee(scene, engine, threads=1, timeline=timeline)
        outcome = referee.run(path, range(len(path)), [("fuzz", culler)], [kept])
        if outcome.cullers[0].failed:
            result.differences.append(f"{name}: failed: {outcome.findings}")
            continue
        if len(kept.judged) != len(case.cells):
            result.differences.append(f"{name}: {len(kept.judged)} cells, not {len(case.cells)}")
            continue
        for number, ((frame, views), wanted, drawn) in enumerate(
            zip(case.cells, expected, case.drawn, strict=True)
        ):
            judged, where = kept.judged[number], f"{name} frame {frame} {'+'.join(views)}"
            samples = [seen[frame, view] for view in views]
            if name == "exact":
                result.differences += exact_differs(where, samples, judged, wanted)
            else:
                shown = {i for unit in drawn for i in case.unit_lists[unit]}
                casts = [c for at, c in kept.cast if at == frame and c.camera.view in views]
                result.differences += clears_only(where, samples, casts, judged, wanted, shown)
            result.seen[f"moving: lost in {name}"] += len(lost_samples(judged))
        if name == "exact":
            result.differences += status_differs(outcome, expected, case.promise)
            result.seen[f"moving: status {outcome.cullers[0].status.value}"] += 1
    result.seen["moving: " + ("general" if case.general else "exact") + " cases"] += 1
    result.seen.update(f"moving: {kind}" for kind in case.kinds)
    for counts, _, _ in expected:
        result.seen.update({f"moving: {name}": counts[name] for name in COUNTS})
    result.seen["moving: samples"] += sum(map(len, seen.values()))
    return result


def _samples(
    case: MovingCase, timeline: Timeline, path: CameraPath, result: Compared
) -> dict[tuple[int, str], list[brute.Sample]]:
    """By frame and view, after a look at where the vertices are."""
    found = {}
    for frame in range(len(path)):
        moment = timeline.at(frame)
        triangles = case.triangles(frame)
        found_here = _misplaced(case, moment, triangles, frame)
        result.differences += found_here
        if found_here:
            continue
        if case.general:
            triangles = case.triangles(frame, _corners(moment))
        for camera in path.views(frame):
            view = brute.View(triangles, case.camera(frame, camera.view))
            states = States(view, moment, camera, result)
            found[frame, camera.view] = [
                brute.Sample(view, at, states) for at in range(len(view.grid))
            ]
    return found


def _corners(moment: Scene) -> np.ndarray:
    """(t, 3, 3) float64: exact, or the baked numbers would not be."""
    return moment.vertices.astype(np.float64)[moment.triangles] + moment.origin


def _misplaced(case: MovingCase, moment: Scene, triangles: list[Triangle], frame: int) -> list[str]:
    """Objects whose corners are not where they were baked, or are there and should not be."""
    here = _corners(moment)
    wanted = np.array([[[float(x) for x in v] for v in t.corners] for t in triangles])
    wanted = wanted.reshape(here.shape)
    present = np.array(case.present(frame), np.bool_)
    wrong = present != moment.present
    if case.general:
        last = np.spacing(np.abs(wanted - moment.origin).astype(np.float32)).astype(float)
        near = last + ERROR * max(64.0, float(np.abs(moment.origin).max()))
    else:
        near = np.zeros_like(wanted)
    off = (np.abs(here - wanted) > near).any(axis=(1, 2)) & present
    return [
        f"frame {frame}: object {o} is {word}"
        for bad, word in ((wrong, "there, or absent, and should not be"), (off, "elsewhere"))
        for o in np.unique(moment.object_of_triangle[bad]).tolist()
    ]
