"""One verdict for one input: whatever engine cast it, whatever the unit, whoever else is judged.

Random cases full of coincident surfaces, alpha masks and glass, decided by the brute force in whole
numbers of `tests.fuzz_verdicts`. A ray engine may see something else at a sample (an edge that
float32 rounds away); where it sees what is there, or one of several that tie, its verdict is the
exact one.
"""

from __future__ import annotations

import random
from collections import Counter
from functools import partial
from pathlib import Path

import pytest

from tests.fuzz_verdicts import brute
from tests.fuzz_verdicts.case import REPEAT, Case, Mask, Part
from tests.fuzz_verdicts.cases import random_case, shifted
from tests.fuzz_verdicts.compare import ENGINES, Compared, Drawn, Kept, States, lost_samples
from tests.fuzz_verdicts.files import write
from visref.formats.loading import load_path, load_scene
from visref.judging.referee import Referee
from visref.visibility import FrameTruth

pytestmark = pytest.mark.slow

BATCH, BATCHES = 12, 5
SAME = (
    *("confirmed", "violations", "missed_pixels", "missed_units", "drawn"),
    *("owned_samples", "undecided_samples", "superfluous_confirmed"),
)


def units_of(case: Case, kind: str, rng: random.Random) -> list[list[int]] | None:
    every = list(range(len(case.triangles)))
    if kind == "objects":
        return None
    if kind == "triangles":
        return [[i] for i in every]
    rng.shuffle(every)
    if kind == "pairs":
        return [every[i : i + 2] for i in range(0, len(every), 2)]
    clusters = [every[i : i + 3] for i in range(0, len(every), 3)]
    return clusters + [rng.sample(every, min(4, len(every))) for _ in clusters]


def draw(case: Case, kind: str, rng: random.Random) -> None:
    case.units = units_of(case, kind, rng)
    share = rng.choice((0.3, 0.6, 0.85))
    count = range(len(case.unit_lists))
    case.drawn = [[u for u in count if rng.random() < share] for _ in case.frames]


def sees_what_is_there(cast: FrameTruth, samples: list[brute.Sample]) -> bool:
    """Whether a ray engine names one of those that tie at each sample, and in doubt and as glass
    the same triangles."""
    owner, doubt_at = cast.buffer.triangle.reshape(-1).tolist(), cast.doubt.at()
    for at, sample in enumerate(samples):
        if owner[at] not in (sample.tied or [-1]):
            return False
        if set(cast.doubt.triangle[doubt_at == at].tolist()) != set(sample.doubt):
            return False
        if set(cast.blend.triangle[cast.blend.sample == at].tolist()) != set(sample.glass):
            return False
    return True


@pytest.mark.parametrize("batch", range(BATCHES))
def test_ray_engines_lead_to_the_verdict_of_whole_numbers_whatever_the_unit(
    batch: int, tmp_path: Path
) -> None:
    seen: Counter[str] = Counter()
    for seed in range(batch * BATCH, (batch + 1) * BATCH):
        agree(random_case(seed), ("objects", "triangles", "pairs", "clusters"), tmp_path, seen)
    # The cases are of use: most frames are seen alike, and much is lost in them.
    assert min(seen[f"{k} {n}"] for k in ("pairs", "clusters") for n in ENGINES) > BATCH
    assert seen["lost"] > 500


def leaves_before_twins(seed: int) -> Case:
    """A wall that stands twice in the same place, one of the two cut the other way or not, behind a
    leaf that is neither solid nor a hole, and beside one that touches it."""
    rng = random.Random(seed)

    def square(z: float, size: float) -> list[tuple[float, ...]]:
        return [(-size, -size, z), (size, -size, z), (size, size, z), (-size, size, z)]

    cuts = ([(0, 1, 2), (0, 2, 3)], [(0, 1, 3), (1, 2, 3)])
    between = Mask(((0, 255), (255, 0)), False, (REPEAT, REPEAT), 1.0, 0.5)
    walls = [Part(square(0.0, 4.0), rng.choice(cuts), double_sided=True) for _ in range(3)]
    leaves = [
        Part(square(z, size), rng.choice(cuts), "mask", mask=between)
        for z, size in ((rng.choice((0.0, 1.0)), 3.0), (2.0, 1.0))
    ]
    for leaf in leaves:
        leaf.uv = [(x * 4.0, y * 4.0) for x, y, _ in leaf.positions]
    still = shifted((0.0, 0.0, 0.0))
    # Two of the walls are one object, so that its triangles tie with each other as well.
    objects = [("twins", still, walls[:2]), ("third", still, walls[2:])]
    objects += [(f"leaf{i}", still, [leaf]) for i, leaf in enumerate(leaves)]
    rng.shuffle(objects)
    case = Case(seed, still, objects, [], False, rng.choice(("conservative", "exact")))
    pose = shifted((0.0, 0.0, 8.0))
    case.frames = [
        {"width": 9, "height": 8, "near": 1.0, "far": 100.0, "world_from_camera": pose, "ymag": 5.0}
    ]
    return case


@pytest.mark.parametrize("seed", range(6))
def test_what_a_mask_leaves_open_before_a_tie_is_counted_alike(seed: int, tmp_path: Path) -> None:
    seen: Counter[str] = Counter()
    for _ in range(4):
        agree(leaves_before_twins(seed), ("triangles", "pairs", "clusters"), tmp_path, seen)
    assert seen["undecided"] > 0


def agree(case: Case, kinds: tuple[str, ...], folder: Path, seen: Counter[str]) -> None:
    """Judge the case in units of these kinds, by every engine, beside the brute force."""
    pytest.importorskip("open3d")
    seed, rng = case.seed, random.Random(f"{case.seed} {seen.total()}")
    scene_file, path_file, _ = write(case, folder)
    scene = load_scene(scene_file, cull_backfaces=case.cull_backfaces)
    path = load_path(path_file).relative_to(scene.origin)
    frames = []
    for number, camera in enumerate(case.frames):
        view = brute.View(case.triangles, camera)
        states = States(view, scene, path.cameras[number], Compared())
        frames.append([brute.Sample(view, at, states) for at in range(len(view.grid))])
    for kind in kinds:
        draw(case, kind, rng)
        for name, engine in ENGINES.items():
            kept = Kept()
            cast = partial(engine, scene, threads=1)
            referee = Referee(scene, cast, threads=1)
            culler = Drawn(case.unit_lists, case.promise, case.drawn)
            (record,) = referee.run(path, range(len(path)), [("drawn", culler)], [kept]).cullers
            alike = [
                sees_what_is_there(truth, samples)
                for (_, truth), samples in zip(kept.cast, frames, strict=True)
            ]
            assert name != "exact" or all(alike)
            totals: Counter[str] = Counter()
            for number, samples in enumerate(frames):
                wanted, lost, loses = brute.judge(
                    samples, case.triangles, case.unit_lists, case.drawn[number], case.promise
                )
                totals.update(wanted)
                if not alike[number]:
                    continue
                where = f"case {seed}, {kind}, {name}, frame {number}"
                judged = kept.judged[number]
                verdict = judged.record.verdict
                for field in SAME:
                    assert getattr(verdict.counts, field) == wanted[field], (where, field)
                assert lost_samples(judged) == lost, where
                convicted = {m.object for m in verdict.misses if m.kind == "confirmed"}
                assert convicted == loses, where
                partly = sum(m.partly for m in verdict.misses if m.kind == "confirmed")
                assert partly == wanted["partly_missed"], where
                # A ray engine lists the ties that somebody disputes.
                assert verdict.counts.ties <= wanted["ties"], where
                assert name != "exact" or verdict.counts.ties == wanted["ties"], where
                seen[f"{kind} {name}"] += 1
                seen["undecided"] += wanted["undecided_samples"]
                seen["lost"] += len(lost)
            if all(alike):
                word, _ = brute.status(totals, case.promise)
                assert record.status.value == word, (seed, kind, name)
