"""What accuracy costs: engines and sampling densities, timed in turn and held against exact.

Three errors, in three columns, never summed:

numeric       an engine against exact arithmetic at the same samples
sampling      a nested subset of the samples against all of them, by the same engine
definitional  objects visible in the continuous image that own no sample at all
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from statistics import median
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from visref.bench.bounds import ALPHA, good_turing, unseen_share_bound
from visref.bench.subsets import ALL, SUBSETS, Sublattice, nested_subsets
from visref.between.search import TRIES, FrameGeometry, GeometricSearch, Status
from visref.camera import Camera
from visref.camera_path import CameraPath
from visref.engines import TruthEngine, make_engine
from visref.engines.rays import RayEngine
from visref.errors import InputError, NothingToJudge
from visref.exact import ExactScene
from visref.exact.outside import pixel_at
from visref.scene import Alpha, Float64, Int32, Int64, Scene
from visref.visibility import FrameTruth, objects_seen

Bool = NDArray[np.bool_]

REFERENCE = "exact"
PROBER = "embree"
ENGINES = (REFERENCE, "embree", "embree:robust=false", "open3d", "gl:depth=24", "gl:depth=32")
# A rasteriser snaps vertices to a share of its own pixel: a subset drawn as a smaller picture
# would be other samples.
WHOLE_ONLY = ("gl:depth=24", "gl:depth=32")
REPEATS = 3
RAYS_PER_PIXEL = (1, 2, 4, 8, 16)
NOT_SAMPLED = -3


@dataclass(eq=False)
class ImageRow:
    """One engine at one density; counts are sums over frames, `seconds` a mean over frames of
    each frame's median."""

    engine: str
    sixteenths: int
    seconds: float = 0.0
    rays: int = 0
    visible: int = 0
    numeric_wrong_samples: int = 0
    numeric_wrong_triangles: int = 0
    numeric_missed: int = 0
    numeric_extra: int = 0
    sampling_missed: int | None = 0
    definitional_missed: int = 0


@dataclass(eq=False)
class GeometricRow:
    """One way of sampling the continuous image. `bound`: the worst frame's, holding for all
    looks and frames at once; `good_turing`: a mean estimate, no bound."""

    method: str
    rays_per_pixel: int | None
    seconds: float = 0.0
    rays: int = 0
    found: int = 0
    missed_of_known: int = 0
    refuted: int = 0
    holdout_rays: int | None = None
    holdout_new: int | None = None
    bound: float | None = None
    good_turing: float | None = None


@dataclass(eq=False)
class Bench:
    """Everything that was measured. `alpha_each`: what each of the looks may err by."""

    image: list[ImageRow]
    geometric: list[GeometricRow]
    frames: list[int]
    samples: int
    objects_known: int
    alpha_each: float
    left_out: list[tuple[str, str]] = field(default_factory=list)
    frame_rows: list[dict[str, Any]] = field(default_factory=list)


@dataclass(eq=False)
class _View:
    """What one cast gave: (height, width) owners (`NOT_SAMPLED` elsewhere), the flat samples that
    are decided, objects seen."""

    triangle: Int32
    decided: Bool
    visible: Bool


class BenchRun:
    """Runs the bench over a scene's frames."""

    def __init__(
        self, scene: Scene, path: CameraPath, frames: Sequence[int], threads: int | None
    ) -> None:
        self._scene, self._path, self._frames = scene, path, list(frames)
        self._threads = threads
        self._engines: dict[str, TruthEngine] = {}
        self._left_out: list[tuple[str, str]] = []

    def run(self, on_frame: Callable[[int], None] = lambda frame: None) -> Bench:
        """Measure; `on_frame` is told of each frame that is done."""
        try:
            self._open_engines()
            return self._run(on_frame)
        finally:
            for engine in self._engines.values():
                engine.close()

    def _open_engines(self) -> None:
        for spec in ENGINES:
            try:
                self._engines[spec] = make_engine(spec, self._scene, threads=self._threads)
            except (InputError, NothingToJudge) as error:
                if spec in (REFERENCE, PROBER):
                    raise
                self._left_out.append((spec, str(error)))

    def _run(self, on_frame: Callable[[int], None]) -> Bench:
        cameras = [self._path.cameras[frame] for frame in self._frames]
        subsets = [nested_subsets(camera) for camera in cameras]
        densities: tuple[int, ...] = tuple(SUBSETS)
        if None in subsets:
            self._left_out.append(
                ("densities below 1", "4 does not divide the image's sides (or the lens shift)")
            )
            densities = (ALL,)
        configurations = [
            (spec, density)
            for spec in self._engines
            for density in reversed(densities)
            if density == ALL or spec not in WHOLE_ONLY
        ]
        image = {key: ImageRow(*key) for key in configurations}
        looks = len(RAYS_PER_PIXEL) - 1
        geometric = _GeometricBench(
            self._scene,
            cast(RayEngine, self._engines[PROBER]),
            ExactScene(self._scene, threads=self._threads),
            ALPHA / (looks * len(cameras)),
        )
        rows: list[dict[str, Any]] = []
        for frame, camera, nested in zip(self._frames, cameras, subsets, strict=True):
            nested = nested or {ALL: [Sublattice(camera, 0, 0, 1)]}
            if frame == self._frames[0]:
                # Compiles, and lets the engines build what they build late.
                self._cast(configurations, camera, nested)
            views: dict[tuple[str, int], _View] = {}
            seconds: dict[tuple[str, int], list[float]] = {key: [] for key in configurations}
            for _ in range(REPEATS):
                views, spent = self._cast(configurations, camera, nested)
                for key, value in spent.items():
                    seconds[key].append(value)
            truth = self._engines[REFERENCE].frame(camera)
            between = geometric.frame(frame, camera, truth)
            for key, row in image.items():
                row.seconds += median(seconds[key]) / len(cameras)
                row.definitional_missed += between
                changes = _compare(row, key, views, truth, self._scene)
                rows.append({"frame": frame, "engine": key[0], "sixteenths": key[1],
                             "seconds": median(seconds[key]), **changes})  # fmt: skip
            on_frame(frame)
        return Bench(
            list(image.values()),
            geometric.finish(len(cameras), image[REFERENCE, ALL].seconds),
            self._frames,
            sum(camera.samples for camera in cameras),
            geometric.known_total,
            geometric.alpha,
            self._left_out,
            rows,
        )

    def _cast(
        self,
        configurations: Sequence[tuple[str, int]],
        camera: Camera,
        subsets: dict[int, list[Sublattice]],
    ) -> tuple[dict[tuple[str, int], _View], dict[tuple[str, int], float]]:
        """Each configuration once, in turn: what it saw, and seconds for owners and objects."""
        views, seconds = {}, {}
        for spec, density in configurations:
            engine = self._engines[spec]
            shape = (camera.height, camera.width)
            triangle = np.full(shape, NOT_SAMPLED, np.int32)
            decided = np.zeros(shape, np.bool_)
            visible = np.zeros(self._scene.object_count, np.bool_)
            spent = 0.0
            for part in subsets[density]:
                start = time.perf_counter()
                truth = engine.frame(part.camera)
                seen = objects_seen(truth, self._scene)
                spent += time.perf_counter() - start
                visible |= seen.visible
                at = np.s_[part.y :: part.step, part.x :: part.step]
                triangle[at] = truth.buffer.triangle
                decided[at] = truth.decided.reshape(truth.buffer.triangle.shape)
            views[spec, density] = _View(triangle, decided.ravel(), visible)
            seconds[spec, density] = spent
        return views, seconds


def _compare(
    row: ImageRow,
    key: tuple[str, int],
    views: dict[tuple[str, int], _View],
    truth: FrameTruth,
    scene: Scene,
) -> dict[str, int | None]:
    """One frame's errors, added to the row and returned."""
    spec, density = key
    view, exact, whole = views[key], views[REFERENCE, density], views[spec, ALL]
    wrong_samples, wrong_triangles = wrong_owners(
        view.triangle.ravel(), view.decided & truth.decided, truth, scene
    )
    changes: dict[str, int | None] = {
        "rays": int(np.count_nonzero(view.triangle != NOT_SAMPLED)),
        "visible": int(np.count_nonzero(view.visible)),
        "numeric_wrong_samples": wrong_samples,
        "numeric_wrong_triangles": wrong_triangles,
        "numeric_missed": int(np.count_nonzero(exact.visible & ~view.visible)),
        "numeric_extra": int(np.count_nonzero(view.visible & ~exact.visible)),
        "sampling_missed": None
        if spec in WHOLE_ONLY
        else int(np.count_nonzero(whole.visible & ~view.visible)),
    }
    for name, value in changes.items():
        before = getattr(row, name)
        setattr(row, name, None if value is None else before + value)
    return changes


def wrong_owners(triangle: Int32, judged: Bool, truth: FrameTruth, scene: Scene) -> tuple[int, int]:
    """(samples whose owning object is none of the exact co-owners, samples whose owning triangle
    is none), among the `judged` samples. `triangle`: (samples,) int32, each sample's owner;
    `judged`: (samples,) bool."""
    exact = truth.buffer.triangle.reshape(-1)
    at = np.flatnonzero(judged & (triangle != exact) & (triangle != NOT_SAMPLED))
    tied = truth.ties
    # A pair is one whole number; triangle ids are below 2^31, samples below 2^29.
    pairs = tied.sample << 31 | tied.triangle
    at = at[~np.isin(at << 31 | np.maximum(triangle[at], 0), pairs) | (triangle[at] < 0)]
    object_of = np.append(scene.object_of_triangle, -1)
    mine, theirs = object_of[triangle[at]], object_of[exact[at]]
    pairs = tied.sample << 31 | object_of[tied.triangle]
    other = (mine != theirs) & (
        (mine < 0) | ~np.isin(at << 31 | np.maximum(mine, 0).astype(np.int64), pairs)
    )
    return int(np.count_nonzero(other)), len(at)


class _GeometricBench:
    """Jittered rays, their bounds, and the aimed search, frame by frame."""

    def __init__(self, scene: Scene, prober: RayEngine, exact: ExactScene, alpha: float) -> None:
        self._scene, self._prober = scene, prober
        self._search = GeometricSearch(scene, prober, exact)
        self.alpha = alpha
        self.known_total = 0
        # Rays look for opaque triangles; who has others is left out of this comparison.
        mixed = scene.object_of_triangle[scene.alpha != Alpha.OPAQUE]
        self._judged = ~np.isin(np.arange(scene.object_count), mixed)
        self._jittered = {n: GeometricRow("jittered rays", n) for n in RAYS_PER_PIXEL}
        self._centres = GeometricRow("pixel centres", None)
        self._aimed = GeometricRow("centres, then aimed rays", None)
        for row in self._jittered.values():
            if row.rays_per_pixel != 1:
                row.holdout_rays = row.holdout_new = 0
                row.bound = 0.0
            row.good_turing = 0.0
        self._shares: dict[int, list[float]] = {n: [] for n in RAYS_PER_PIXEL}

    def frame(self, number: int, camera: Camera, truth: FrameTruth) -> int:
        """Measure one frame; returns how many objects show between the samples alone."""
        seen = objects_seen(truth, self._scene)
        times, result = [], None
        for _ in range(REPEATS):
            start = time.perf_counter()
            result = self._search.frame(number, camera, seen)
            times.append(time.perf_counter() - start)
        assert result is not None
        hits, per_round, points = self._jitter(number, camera, result)
        known = result.status <= Status.SUBPIXEL
        refuted = np.zeros_like(known)
        for obj, places in points.items():
            shows = any(self._search.verify(camera, obj, x, y) is not None for x, y in places)
            (known if shows else refuted)[obj] = True
        self._count(camera, hits, per_round, known & self._judged, refuted)
        visible = seen.visible & self._judged
        self._centres.rays += camera.samples
        self._centres.found += int(np.count_nonzero(visible))
        self._centres.missed_of_known += int(np.count_nonzero(known & self._judged & ~visible))
        found = (result.status <= Status.SUBPIXEL) & self._judged
        self._aimed.rays += camera.samples + result.rays
        self._aimed.found += int(np.count_nonzero(found))
        self._aimed.missed_of_known += int(np.count_nonzero(known & self._judged & ~found))
        self._aimed.seconds += median(times)
        return int(np.count_nonzero(known & ~seen.visible))

    def _jitter(
        self, number: int, camera: Camera, known: FrameGeometry
    ) -> tuple[Int64, float, dict[int, list[tuple[float, float]]]]:
        """Rounds of one ray a pixel, at random in it: ((rounds, n + 1) rays by object, the last
        for none; seconds a round; some points at which objects show that nobody has found)."""
        scene = self._scene
        hits = np.zeros((max(RAYS_PER_PIXEL), scene.object_count + 1), np.int64)
        times = []
        points: dict[int, list[tuple[float, float]]] = {}
        object_of = np.append(scene.object_of_triangle, scene.object_count)
        new = np.append(known.status > Status.SUBPIXEL, False)
        for turn in range(len(hits)):
            start = time.perf_counter()
            a, b = jittered(camera, number, turn)
            met = object_of[self._prober.probe(camera, a, b)]
            hits[turn] = np.bincount(met, minlength=scene.object_count + 1)
            times.append(time.perf_counter() - start)
            at = np.flatnonzero(new[met])
            x, y = pixel_at(camera, a[at], b[at])
            for obj, *place in zip(met[at].tolist(), x.tolist(), y.tolist(), strict=True):
                if len(points.setdefault(obj, [])) < TRIES:
                    points[obj].append((place[0], place[1]))
        return hits, median(times), points

    def _count(
        self, camera: Camera, hits: Int64, per_round: float, known: Bool, refuted: Bool
    ) -> None:
        for n, row in self._jittered.items():
            half = n // 2
            first, all_ = hits[:half].sum(axis=0), hits[:n].sum(axis=0)
            row.seconds += n * per_round
            row.rays += n * camera.samples
            found = (all_[:-1] > 0) & self._judged
            row.found += int(np.count_nonzero(found & known))
            row.missed_of_known += int(np.count_nonzero(known & ~found))
            row.refuted += int(np.count_nonzero(found & refuted))
            self._shares[n].append(good_turing(all_))
            if half:
                # Whatever an unknown ray met, the background is no object.
                fresh = hits[half:n].sum(axis=0)[:-1]
                new = int(fresh[first[:-1] == 0].sum())
                rays = (n - half) * camera.samples
                row.holdout_rays = (row.holdout_rays or 0) + rays
                row.holdout_new = (row.holdout_new or 0) + new
                row.bound = max(row.bound or 0.0, unseen_share_bound(new, rays, self.alpha))
        self.known_total += int(np.count_nonzero(known))

    def finish(self, frames: int, exact_seconds: float) -> list[GeometricRow]:
        """The rows, their seconds a mean over frames. The exact frame is where aiming starts."""
        rows = [self._centres, *self._jittered.values(), self._aimed]
        for row in rows:
            row.seconds /= frames
        self._centres.seconds = exact_seconds
        self._aimed.seconds += exact_seconds
        for n, row in self._jittered.items():
            row.good_turing = float(np.mean(self._shares[n]))
        return rows


def jittered(camera: Camera, frame: int, turn: int) -> tuple[Float64, Float64]:
    """One point in each pixel, uniform in it: (a, b), (samples,) float64 each."""
    random = np.random.default_rng([frame, turn]).random((2, camera.height, camera.width))
    a = camera.column_a + (2.0 * random[0] - 1.0)
    b = camera.row_b[:, None] + (2.0 * random[1] - 1.0)
    return a.ravel(), b.ravel()
