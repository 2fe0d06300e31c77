"""On coincident geometry a ray engine leads to the verdict of the exact one, whatever the unit.

A ray names one of several triangles at the same depth, and which one is chance. Judged by units
finer than objects that must not show: a unit whose triangle is tied with a drawn one loses
nothing.
"""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.hand_made import camera, square
from visref.camera import Camera, look_at
from visref.camera_path import CameraPath
from visref.culler import Culler, DrawnSet
from visref.engines import make_engine
from visref.judging.referee import Referee
from visref.scene import Scene, Units

pytestmark = pytest.mark.slow

SEEDS = range(20)
VIEWS = [
    camera(16, 12),
    Camera(look_at((0.0, 0.0, 10.0), (0.0, 0.0, 0.0)), 16, 12, near=1.0, yfov=1.0),
    Camera(look_at((3.0, 5.0, 9.0), (0.0, 0.0, 0.0)), 16, 12, near=1.0, yfov=1.0),
]


def coincident(rng: np.random.Generator) -> Scene:
    """Squares on a grid in two planes, many of them twice or thrice in the same place: as an
    object of their own, or in one with others."""
    objects = []
    for number in range(8):
        points, faces = [], []
        for part in range(int(rng.integers(1, 4))):
            corner = rng.integers(-2, 2, 2) * 2.0
            corners, own = square(*corner, float(rng.integers(0, 2)), 2.0)
            turned = own[:, [1, 2, 0]] if rng.random() < 0.5 else own
            points.append(corners)
            faces.append(turned + 4 * part)
        objects.append((f"o{number}", np.concatenate(points), np.concatenate(faces)))
    return Scene.from_objects(objects)


def units_of(scene: Scene, kind: str, rng: np.random.Generator) -> Units:
    count = scene.triangle_count
    every = np.arange(count, dtype=np.int32)
    if kind == "triangle":
        return Units(np.arange(count + 1), every, kind)
    if kind == "overlapping":
        # Each triangle alone, and pairs of any two.
        pairs = rng.integers(0, count, (6, 2))
        pairs[:, 1] = np.where(pairs[:, 0] == pairs[:, 1], (pairs[:, 1] + 1) % count, pairs[:, 1])
        offsets = np.concatenate([np.arange(count + 1), count + 2 * np.arange(1, 7)])
        return Units(offsets, np.concatenate([every, pairs.reshape(-1)]).astype(np.int32), kind)
    # Chunks of three, across objects, in no order.
    mixed = rng.permutation(every)
    return Units(np.append(np.arange(0, count, 3), count), mixed, kind)


class Draws(Culler):
    name = "draws"

    def __init__(self, units: Units | None, ids: np.ndarray) -> None:
        self.units, self.ids = units, ids

    def prepare(self, scene: Scene) -> Units:
        return self.units or scene.object_units()

    def cull(self, camera: Camera) -> DrawnSet:
        return DrawnSet(self.ids)


def verdicts(engine: str, scene: Scene, units: Units | None, ids: np.ndarray):
    referee = Referee(scene, lambda: make_engine(engine, scene))
    (record,) = referee.run(
        CameraPath(tuple(VIEWS)), range(len(VIEWS)), [("draws", Draws(units, ids))]
    ).cullers
    return record


@pytest.mark.parametrize("kind", ["object", "triangle", "overlapping", "chunk"])
@pytest.mark.parametrize("seed", SEEDS)
def test_embree_convicts_as_the_exact_engine_does(seed, kind):
    rng = np.random.default_rng(seed)
    scene = coincident(rng)
    units = None if kind == "object" else units_of(scene, kind, rng)
    count = scene.object_count if units is None else units.count
    ids = np.flatnonzero(rng.random(count) < rng.choice([0.5, 0.8])).astype(np.int32)
    embree, exact = (verdicts(engine, scene, units, ids) for engine in ("embree", "exact"))
    assert embree.status is exact.status
    for one, other in zip(embree.frames, exact.frames, strict=True):
        mine, theirs = one.verdict.counts, other.verdict.counts
        for name in ("confirmed", "violations", "missed_pixels", "missed_units", "owned_samples"):
            assert getattr(mine, name) == getattr(theirs, name), name
        # Ties that nobody disputes Embree does not list, and so not all who miss by them.
        assert mine.ties <= theirs.ties
        convicted = [
            sorted((m.object, m.samples, m.partly) for m in v.misses if m.kind == "confirmed")
            for v in (one.verdict, other.verdict)
        ]
        assert convicted[0] == convicted[1]


def test_a_triangle_left_out_under_its_twin_is_no_violation_with_either_engine():
    corners, faces = square(-2.0, -2.0, 0.0, 4.0)
    twice = np.concatenate([faces, faces[:, [2, 0, 1]]])
    scene = Scene.from_objects([("square", corners, twice)])
    units = Units(np.arange(5), np.arange(4, dtype=np.int32), "triangle")
    for engine in ("embree", "exact"):
        # Of each pair of twins one, either way; then none of one pair.
        for ids in ([0, 1], [2, 3], [0, 3], [2, 1]):
            record = verdicts(engine, scene, units, np.array(ids, np.int32))
            assert record.totals.missed_pixels == record.totals.violations == 0
        record = verdicts(engine, scene, units, np.array([1, 3], np.int32))
        assert record.totals.missed_pixels > 0
        assert record.totals.violations == len(VIEWS)
