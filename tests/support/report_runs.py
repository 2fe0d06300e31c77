"""Run folders for the reports' tests: a wall, what stands before it, and what it hides."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tests.support.hand_made import square
from visref.camera import Camera, look_at
from visref.camera_path import CameraPath
from visref.culler import Culler, DrawnSet, Promise, QueryStats
from visref.engines.base import TruthEngine
from visref.judging.referee import Referee
from visref.run_folder.write import RunWriter
from visref.scene import Scene, Units
from visref.visibility import FrameTruth, VisibilityBuffer

NASTY = "<script>alert('x')</script> | `a` & \"b\"\x07"

# (name, x, y, z, size), off the samples' grid so that none lies on an edge or a diagonal.
SQUARES = [
    ("wall", -20.25, -20.125, 0.0, 40.0),
    (NASTY, -8.25, -4.125, 3.0, 2.0),
    ("pillar", 10.25, -10.125, 2.0, 9.0),
    ("hidden", -5.25, -5.125, -5.0, 6.0),
    ("also hidden", 0.25, 0.125, -6.0, 6.0),
    ("outside", 500.25, 0.125, 0.0, 6.0),
]
WALL, NASTY_ID, PILLAR, HIDDEN, ALSO_HIDDEN, OUTSIDE = range(6)
VISIBLE = (WALL, NASTY_ID, PILLAR)
EVERYTHING = tuple(range(6))
# Of triangles as units: one of the pillar's two is left out.
HALF = tuple(unit for unit in range(6) if unit != 2 * PILLAR)
WIDTH, HEIGHT = 48, 32

BROKEN = "module:Forgets"
LOOSE = "loose:budget=3"


def scene() -> Scene:
    return Scene.from_objects(
        [(name, *square(x, y, z, size)) for name, x, y, z, size in SQUARES],
        source="folder/squares.glb",
    )


def path(frames: int = 5) -> CameraPath:
    """The camera slides to the right, a world unit (a pixel) a frame."""
    cameras = [
        Camera(
            look_at((float(i), 0.0, 10.0), (float(i), 0.0, 0.0)),
            WIDTH,
            HEIGHT,
            near=1.0,
            far=100.0,
            ymag=HEIGHT / 2,
        )
        for i in range(frames)
    ]
    return CameraPath(tuple(cameras), source="slide.path.json")


class Painter(TruthEngine):
    """The truth of axis-aligned squares, painted from the back."""

    name = "painter"
    summary = "for tests"

    def frame(self, camera: Camera) -> FrameTruth:
        triangle = np.full((HEIGHT, WIDTH), -1, np.int32)
        depth = np.full((HEIGHT, WIDTH), np.inf)
        x = camera.eye[0] + camera.column_a * camera.right_step[0]
        y = camera.eye[1] + camera.row_b * camera.up_step[1]
        order = sorted(range(len(SQUARES)), key=lambda i: SQUARES[i][3])
        for index in order:
            _, left, low, z, size = SQUARES[index]
            u, v = np.meshgrid(x - left, y - low)
            inside = (u >= 0) & (u <= size) & (v >= 0) & (v <= size)
            triangle[inside] = np.where(v <= u, 2 * index, 2 * index + 1)[inside]
            depth[inside] = camera.eye[2] - z
        return FrameTruth(camera, self.name, VisibilityBuffer(triangle, depth), ties_complete=True)


class ExactPainter(Painter):
    """Says of itself that it is exact."""

    exact = True


class SlippingPainter(Painter):
    """Sees a hidden object at one sample, as a ray that slips through an edge does, and
    promises nothing about ties."""

    def frame(self, camera: Camera) -> FrameTruth:
        exact = super().frame(camera)
        exact.buffer.triangle[16, 30] = 2 * HIDDEN
        exact.buffer.depth[16, 30] = 15.0
        return FrameTruth(camera, self.name, exact.buffer)


class Scripted(Culler):
    """Draws what it was told to, frame by frame; the last list stands for the rest."""

    name = "scripted"

    def __init__(
        self,
        *drawn: Sequence[int],
        promise: Promise = Promise.CONSERVATIVE,
        queries: int | None = None,
        units: Units | None = None,
        fails_at: int | None = None,
    ) -> None:
        self.drawn, self.promise, self.queries = drawn, promise, queries
        self.units, self.fails_at = units, fails_at
        self.frame = 0

    def prepare(self, scene: Scene) -> Units:
        return self.units or scene.object_units()

    def cull(self, camera: Camera) -> DrawnSet:
        if self.frame == self.fails_at:
            raise RuntimeError("it fell over <here>")
        drawn = self.drawn[min(self.frame, len(self.drawn) - 1)]
        self.frame += 1
        stats = QueryStats(ms={"cull": 2.0 * self.frame})
        if self.queries is not None:
            stats.queries = self.queries * self.frame
            stats.batches = self.frame
            stats.query_fragments = 1_000_000 * self.frame
        return DrawnSet(np.array(drawn, np.int32), stats)


def write_run(
    folder: Path,
    cullers: Sequence[tuple[str, Culler]],
    *,
    frames: int = 5,
    engine: str = "embree",
    pictures: Sequence[int] = (0, 3),
    truth: type[TruthEngine] = Painter,
    superfluous_rows: bool = False,
) -> Path:
    """Judge the cullers with the painter's truth and leave a run folder that says `engine`."""
    folder.mkdir(parents=True)
    world, cameras = scene(), path(frames)
    recorder = RunWriter(
        folder,
        world,
        cameras,
        engine=engine,
        settings={"cull_backfaces": False},
        picture_frames=pictures,
        superfluous_rows=superfluous_rows,
    )
    outcome = Referee(world, lambda: truth(world)).run(cameras, range(frames), cullers, [recorder])
    recorder.finish(outcome)
    return folder


def triangle_units() -> Units:
    count = scene().triangle_count
    return Units(np.arange(count + 1), np.arange(count, dtype=np.int32), "triangle")


def write_runs(root: Path) -> dict[str, Path]:
    """Run folders by what is to be said of them."""
    without_nasty = (WALL, PILLAR, HIDDEN)
    return {
        "violation": write_run(
            root / "violation",
            [
                ("none", Scripted(EVERYTHING)),
                ("tight", Scripted(VISIBLE, (*VISIBLE, HIDDEN), queries=7)),
                (BROKEN, Scripted(VISIBLE, without_nasty, VISIBLE, without_nasty, queries=3)),
                (LOOSE, Scripted(VISIBLE, (WALL,), promise=Promise.APPROXIMATE)),
                ("triangles", Scripted(range(12), units=triangle_units())),
                ("falls", Scripted(EVERYTHING, fails_at=2)),
            ],
            superfluous_rows=True,
        ),
        "clean": write_run(
            root / "clean",
            [("only", Scripted(VISIBLE))],
            engine="exact:tile=64",
            truth=ExactPainter,
        ),
        "loose": write_run(
            root / "loose", [("loose", Scripted((WALL,), promise=Promise.AGGRESSIVE))]
        ),
        "measured": write_run(
            root / "measured", [("says nothing", Scripted((), promise=Promise.APPROXIMATE))]
        ),
        "exact": write_run(
            root / "exact", [("greedy", Scripted(EVERYTHING, VISIBLE, promise=Promise.EXACT))]
        ),
        "partly": write_run(
            root / "partly", [("halves", Scripted(HALF, units=triangle_units()))], frames=1
        ),
        "inconclusive": write_run(root / "open", [("falls", Scripted(VISIBLE, fails_at=0))]),
    }


def bench_folder(folder: Path) -> Path:
    """What a report reads of a bench folder."""
    folder.mkdir()
    (folder / "bench.svg").write_text("<svg xmlns='http://www.w3.org/2000/svg'/>")
    record = {
        "format": "visref-bench",
        "version": 1,
        "says": ["Stop at <b>", "Exact costs more."],
        "scene": {"source": "somewhere/city.glb"},
        "path": {"frames": [0, 5]},
        "machine": {"processor": "x", "cores": 2, "threads": 2},
    }
    (folder / "bench.json").write_text(json.dumps(record))
    return folder
