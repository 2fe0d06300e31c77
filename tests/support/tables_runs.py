"""A paper of a few small walks and experiments, and cullers that tell how often they ran."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from visref.camera_path import CameraPath
from visref.culler import Culler, DrawnSet, QueryStats
from visref.errors import NothingToJudge
from visref.papers import Paper
from visref.papers.contents import Curve, Experiment, Figure, JudgedRun, Results, Row, Table, Trend
from visref.papers.culler_frames import culler_frames
from visref.scene import Scene

TOWN = "city:scale=0.02,frames=6"
SIZE = (32, 24)
ALL, NOTHING, STOPPED, BROKEN = (
    f"tests.support.tables_runs:{name}" for name in ("All", "Nothing", "Stopped", "Broken")
)


class All(Culler):
    """Draws everything, and remembers the cameras of all its kind."""

    name = "all"
    cameras: ClassVar[list[Any]] = []

    def prepare(self, scene: Scene):
        self.scene = scene
        return scene.object_units()

    def cull(self, camera):
        All.cameras.append(camera)
        ids = np.arange(self.scene.object_count, dtype=np.int32)
        return DrawnSet(ids, QueryStats(queries=7))


class Nothing(Culler):
    """Misses all there is."""

    name = "nothing"

    def cull(self, camera):
        return DrawnSet(np.zeros(0, np.int32))


class Stopped(Culler):
    """Somebody presses Ctrl-C."""

    name = "stopped"

    def cull(self, camera):
        raise KeyboardInterrupt


class Broken(Culler):
    """Falls over."""

    name = "broken"

    def cull(self, camera):
        raise ZeroDivisionError("it fell over")


def counting(scene: Scene | None, path: CameraPath | None) -> dict[str, Any]:
    """An experiment: what it was given."""
    if scene is None or path is None:
        return {"scene": scene, "path": path}
    sizes = sorted({(camera.width, camera.height) for camera in path})
    return {"triangles": scene.triangle_count, "frames": len(path), "sizes": sizes}


def without_gl(scene: Scene | None, path: CameraPath | None) -> dict[str, Any]:
    raise NothingToJudge("no OpenGL here")


RUNS = (JudgedRun("first", TOWN, (ALL,), size=SIZE), JudgedRun("second", TOWN, (ALL,), size=SIZE))
EXPERIMENTS = (Experiment("count", "counting", TOWN, size=SIZE),)


def tables(results: Results) -> list[Table]:
    run, counted = results.run("first"), results.experiment("count")
    queries = culler_frames(run, ALL).mean("queries") if run is not None else None
    rows = (
        Row("queries a frame", 14.0, queries),
        Row("triangles", 1_000, counted["triangles"] if counted is not None else None),
        Row("share of <all>", 0.25, 0.125, unit="%", digits=1),
    )
    curves = (
        Curve("ours", (1.0, 2.0), (7.0, 7.0)),
        Curve("paper", (1.0, 2.0), (14.0, 13.0), published=True),
    )
    figure = Figure("budget", "queries", curves)
    trends = (Trend("fewer queries than the paper", None if queries is None else queries < 14),)
    return [Table("Queries", "Table 1", rows, trends, figure)]


def paper(
    walks: tuple[JudgedRun, ...] = RUNS, experiments: tuple[Experiment, ...] = EXPERIMENTS
) -> Paper:
    return Paper("toy", "A. Toy: A Paper & Its Tables, 2001", walks, experiments, tables)


class Steps:
    """Progress that only counts."""

    def __init__(self) -> None:
        self.all, self.done = 0, 0.0
        self.labels: list[str] = []

    def begin(self, steps: int) -> None:
        self.all = steps

    def task(self, label: str) -> None:
        self.labels.append(label)

    def advance(self, steps: float) -> None:
        self.done += steps


def sided(scene: Scene | None, path: CameraPath | None) -> float:
    """An experiment: the share of the triangles that are one-sided."""
    assert scene is not None
    return float(scene.one_sided.mean())
