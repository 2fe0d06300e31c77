"""A paper of a few small walks and experiments, and cullers that tell how often they ran."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from visref.camera_path import CameraPath
from visref.culler import Culler, DrawnSet, QueryStats
from visref.errors import NothingToJudge
from visref.papers import Paper
from visref.papers.contents import (
    Claim,
    Curve,
    Experiment,
    Figure,
    JudgedRun,
    Printed,
    Results,
    Row,
    Sense,
    SetUp,
    Table,
    printed_curve,
)
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
    queries = culler_frames(run, ALL).series("queries").mean() if run is not None else None
    theirs = Printed(14, "Table 1", "queries")
    rows = (
        Row("queries a frame", theirs, queries.value if queries is not None else None),
        Row(
            "triangles",
            Printed(1_000, "section 3", "triangles"),
            counted["triangles"] if counted is not None else None,
        ),
        Row("share of <all>", Printed(25, "p. 2", "share", per=100), 0.125, unit="%", digits=1),
    )
    curves = (
        Curve("ours", (1.0, 2.0), (7.0, 7.0)),
        printed_curve("paper", (1.0, 2.0), (theirs, Printed(13, "Fig. 1", "at 2"))),
    )
    figure = Figure("budget", "queries", curves)
    claim = Claim(
        "fewer queries than the paper", Sense.AT_MOST, queries, theirs, even=None, digits=1
    )
    own = Claim("fewer than eight", Sense.AT_MOST, queries, even=8.0)
    setup = (SetUp("cells", Printed(32, "section 7", "cells"), "px"),)
    return [Table("Queries", "Table 1", rows, (claim,), (own,), setup, figure)]


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
