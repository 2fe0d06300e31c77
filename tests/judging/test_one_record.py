"""One record for one input: not the threads, nor who else is judged and in what order, nor which
other frames, nor whether the truth was cast before, change what is written down of a frame.

Soups of triangles on a coarse grid: many lie over each other, so that ties are common.
"""

from __future__ import annotations

import hashlib
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from visref.camera import Camera
from visref.camera_path import CameraPath
from visref.culler import Culler, DrawnSet
from visref.engines import make_engine
from visref.judging.referee import Referee
from visref.promise import Promise
from visref.recordings.truth_file import RecordedTruth, TruthTable
from visref.recordings.truth_reading import read_truth
from visref.scene import Scene, Units
from visref.visibility import objects_seen

SEEDS = (1, 2)
FRAMES = range(4)


def soup(seed: int) -> Scene:
    """Objects of a few triangles, with corners on a grid of nine by nine in three planes."""
    random = np.random.default_rng(seed)
    objects = []
    for number in range(12):
        corners = random.integers(-4, 5, (6, 2)).astype(np.float64)
        planes = np.repeat(random.integers(-2, 1, 2), 3)
        positions = np.column_stack([corners, planes])
        objects.append((f"object {number}", positions, np.array([[0, 1, 2], [3, 4, 5]])))
    return Scene.from_objects(objects)


def path() -> CameraPath:
    cameras = []
    for frame in FRAMES:
        pose = np.eye(4)
        pose[:3, 3] = (0.25 * frame, -0.5 * frame, 5.0)
        cameras.append(Camera(pose, 16, 16, 1.0, 100.0, ymag=4.0))
    return CameraPath(tuple(cameras))


class DrawsSome(Culler):
    """Draws a share of the objects, or of the triangles, that hangs on the camera alone."""

    name = "draws-some"

    def __init__(self, share: float, promise: Promise, *, by_triangle: bool = False) -> None:
        self.share, self.promise, self.by_triangle = share, promise, by_triangle

    def prepare(self, scene):
        each = np.arange(scene.triangle_count + 1, dtype=np.int32)
        self.units = Units(each, each[:-1], "triangle") if self.by_triangle else None
        self.units = self.units or scene.object_units()
        return self.units

    def cull(self, camera):
        digest = hashlib.sha256(camera.world_from_camera.tobytes()).digest()
        random = np.random.default_rng(int.from_bytes(digest[:8]))
        return DrawnSet(
            np.flatnonzero(random.random(self.units.count) < self.share).astype(np.int32)
        )


def cullers() -> list[tuple[str, Culler]]:
    return [
        ("most", DrawsSome(0.8, Promise.CONSERVATIVE)),
        ("all", DrawsSome(2.0, Promise.CONSERVATIVE)),
        ("half", DrawsSome(0.5, Promise.EXACT)),
        ("triangles", DrawsSome(0.6, Promise.CONSERVATIVE, by_triangle=True)),
    ]


def records(
    scene: Scene,
    engine: str,
    judged: list[tuple[str, Culler]],
    *,
    frames=FRAMES,
    threads: int = 1,
    recorded: RecordedTruth | None = None,
) -> dict[tuple[str, int], object]:
    """What is kept of each culler and frame."""
    cast = partial(make_engine, engine, scene, threads=threads)
    referee = Referee(scene, cast, threads=threads, recorded=recorded)
    outcome = referee.run(path(), frames, judged)
    assert not any(record.failed for record in outcome.cullers)
    return {
        (record.spec, row.frame): (
            row.verdict.counts,
            row.verdict.misses,
            row.verdict.superfluous_units.tolist(),
            row.verdict.undecided_objects.tolist(),
            row.verdict.confirmed_superfluous,
            row.verdict.owned,
            row.triangles_drawn,
        )
        for record in outcome.cullers
        for row in record.frames
    }


@pytest.fixture(scope="module", params=["embree", "exact"])
def engine(request):
    return request.param


@pytest.fixture(scope="module", params=SEEDS)
def case(request, engine):
    scene = soup(request.param)
    return scene, records(scene, engine, cullers())


def test_the_cases_have_what_they_are_for(case):
    _, whole = case
    assert len(whole) == len(cullers()) * len(FRAMES)
    totals = {spec: [r[0] for (s, _), r in whole.items() if s == spec] for spec, _ in cullers()}
    assert sum(counts.confirmed for counts in totals["most"]) > 0
    assert sum(counts.confirmed for counts in totals["all"]) == 0
    assert sum(counts.superfluous_confirmed for counts in totals["half"]) > 0
    assert sum(counts.missed_pixels for counts in totals["triangles"]) > 0


@pytest.mark.parametrize("threads", [2, 7])
def test_threads_change_no_record(case, engine, threads):
    scene, whole = case
    assert records(scene, engine, cullers(), threads=threads) == whole


def test_the_order_of_cullers_changes_no_record(case, engine):
    scene, whole = case
    assert records(scene, engine, cullers()[::-1]) == whole


@pytest.mark.parametrize("number", range(4))
def test_a_culler_alone_has_the_records_that_it_has_beside_others(case, engine, number):
    scene, whole = case
    judged = cullers()[number]
    alone = {key: record for key, record in whole.items() if key[0] == judged[0]}
    assert records(scene, engine, [judged]) == alone


def without_ages(found):
    """The records but for the ages of misses, which begin anew after frames that nobody judged."""
    return {
        key: (counts, tuple(replace(miss, age=None) for miss in misses), *rest)
        for key, (counts, misses, *rest) in found.items()
    }


@pytest.mark.parametrize("frames", [(2,), (0, 3), (3, 1)])
def test_other_frames_change_no_record_but_for_ages(case, engine, frames):
    scene, whole = case
    some = {key: record for key, record in whole.items() if key[1] in frames}
    assert without_ages(records(scene, engine, cullers(), frames=frames)) == without_ages(some)


def test_a_truth_file_gives_the_records_of_casting(case, engine, tmp_path):
    scene, whole = case
    caster = make_engine(engine, scene, threads=1)
    table = TruthTable(scene)
    for frame, camera in enumerate(path()):
        table.add(frame, camera.width, objects_seen(caster.frame(camera), scene))
    file = tmp_path / "t.parquet"
    table.write(file, engine=engine, path=path(), ties_complete=caster.exact, exact=caster.exact)
    read = read_truth(file, scene, path(), FRAMES)
    assert records(scene, engine, cullers(), recorded=read) == whole
