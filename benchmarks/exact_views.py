"""The exact engine against Embree over nine scenes: CPU time from a camera to objects' counts."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from statistics import median

from benchmarks.exact import terrain
from benchmarks.truth import cameras, town
from visref.camera import Camera
from visref.camera_path import middles
from visref.engines.base import TruthEngine
from visref.engines.embree import EmbreeEngine
from visref.engines.exact import ExactEngine
from visref.generators import find_generator
from visref.scene import Scene
from visref.visibility import objects_seen
from visref_datasets_gen.dataset import scene_of

TITLE = "Camera to counts, exact against Embree: CPU time, 1280x960, three views a scene"

ROUNDS = 5
VIEWS = 3
DATA_SETS = ("city", "forest", "soda_hall", "skyscraper", "angio", "formula_one", "terrain_towers")

View = tuple[str, Camera]


def scenes() -> Iterator[tuple[str, Scene, list[View]]]:
    """Each scene with its views: the middles of three parts of its path."""
    for name in DATA_SETS:
        generator = find_generator(name)
        assert generator is not None, name
        made = generator.make(**generator.settings)
        path = made.path.resized(1280, 960)
        frames = middles(len(path), VIEWS)
        views = [(f"frame {frame}", path.views(frame)[0]) for frame in frames]
        yield name, scene_of(made), views
    yield "town", town(), list(cameras().items())
    hills, camera = terrain()
    closer = [camera.relative_to((0.0, 40.0 * step, 200.0 * step)) for step in range(VIEWS)]
    yield "hills", hills, [(f"step {step}", one) for step, one in enumerate(closer)]


def counting(engine: TruthEngine, scene: Scene, camera: Camera) -> Callable[[], object]:
    return lambda: objects_seen(engine.frame(camera), scene)


def cpu_seconds(jobs: Sequence[Callable[[], object]], rounds: int) -> list[float]:
    """Median CPU seconds of each job, all threads together; the jobs take turns, and the first
    turn, which warms caches and compiled code, does not count."""
    seconds: list[list[float]] = [[] for _ in jobs]
    for turn in range(rounds + 1):
        for job, spent in zip(jobs, seconds, strict=True):
            start = time.process_time()
            job()
            if turn:
                spent.append(time.process_time() - start)
    return [median(spent) for spent in seconds]


def compared(
    name: str, scene: Scene, views: Sequence[View], rounds: int = ROUNDS
) -> Iterator[tuple[dict[str, str], float]]:
    """A row for each view, and how many times as fast as Embree the exact engine is."""
    embree, exact = EmbreeEngine(scene), ExactEngine(scene)
    try:
        for view, camera in views:
            jobs = [counting(engine, scene, camera) for engine in (embree, exact)]
            fast, sure = cpu_seconds(jobs, rounds)
            row = {
                "scene": name,
                "view": view,
                "triangles": f"{scene.triangle_count:,}",
                "embree ms": f"{1e3 * fast:.0f}",
                "exact ms": f"{1e3 * sure:.0f}",
                "embree / exact": f"{fast / sure:.2f}",
            }
            yield row, fast / sure
    finally:
        embree.close()
        exact.close()


def run() -> list[dict[str, str]]:
    rows, ratios = [], []
    for name, scene, views in scenes():
        for row, ratio in compared(name, scene, views):
            rows.append(row)
            ratios.append(ratio)
    blank = dict.fromkeys(rows[0], "")
    for what, value in (("median", median(ratios)), ("least", min(ratios))):
        rows.append(blank | {"scene": what, "embree / exact": f"{value:.2f}"})
    return rows
