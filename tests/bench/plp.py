"""PLP and cPLP on this machine: the paper's tables and figures, and what each way of asking costs.

`python -m tests.bench plp`; a few minutes.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from statistics import mean, median

import numpy as np

from culling.device import State, device
from culling.plp import PLPCulling
from culling.queries.histogram import HistogramQueries
from culling.queries.item_buffer_query import ItemBufferQueries
from culling.queries.occlusion_query import BoxQueries
from culling.view import View, round_outward
from datasets_gen.city import city
from datasets_gen.dataset import Dataset, scene_of
from datasets_gen.skyscraper import skyscraper
from datasets_gen.soda_hall import soda_hall
from visref.culler import Culler, QueryStats
from visref.engines.embree import EmbreeEngine
from visref.papers import klosowski2001 as paper
from visref.registry import make_culler
from visref.scene import Scene

TITLE = "PLP and cPLP (Klosowski 2001): Soda Hall, skyscraper and city, 512x512"

FRAMES = 25
ROUNDS = 9
WAYS = (
    "fragment-histogram",
    "occlusion-query",
    "item-buffer",
    "item-buffer,image=restore",
    "histogram",
    "histogram,image=restore",
)
BASELINES = ("cplp:order=front-to-back,query=occlusion-query", "cplp:order=frustum")


def run() -> list[dict[str, str]]:
    dataset = soda_hall(frames=FRAMES)
    scene = scene_of(dataset)
    rows = [("soda_hall", *line) for line in table_3_rows(scene, dataset)]
    rows += [("soda_hall", *line) for line in time_rows(scene, dataset)]
    for leaf in (500, 30):
        rows += [("soda_hall", *line) for line in query_rows(scene, dataset, leaf)]
    rows += [("", *line) for line in primitive_rows()]
    rows += [("skyscraper", *line) for line in depth_rows()]
    rows += [("city", *line) for line in quality_rows()]
    heads = ("scene", "quantity", "here", "paper")
    return [dict(zip(heads, row, strict=True)) for row in rows]


def walk(spec: str, scene: Scene, dataset: Dataset) -> paper.Walk:
    """The culler's counters and frame times; the first frame is drawn twice, to warm up."""
    culler: Culler = make_culler(spec)
    culler.prepare(scene)
    culler.cull(dataset.path.frames[0])
    rows = []
    for camera in dataset.path:
        stats = culler.cull(camera).stats
        rows.append({**stats.counts(), "frame_ms": stats.ms["frame"]})
    culler.close()
    return paper.Walk(rows)


def table_3_rows(scene: Scene, dataset: Dataset) -> list[paper.Line]:
    walks = {
        budget: (walk(cplp, scene, dataset), walk(plp, scene, dataset))
        for budget, (cplp, plp) in paper.specs().items()
    }
    leaves = PLPCulling(leaf=paper.LEAF_TRIANGLES).prepare(scene).count
    return [("octree leaves", f"{leaves:,}", f"{paper.LEAVES:,}"), *paper.table_3(walks)]


def time_rows(scene: Scene, dataset: Dataset) -> list[paper.Line]:
    """Figs. 6 and 8: milliseconds a frame by budget."""
    lines = []
    for way in WAYS:
        spent = [
            walk(f"cplp:query={way},budget={budget}", scene, dataset).average("frame_ms")
            for budget in (1_000, 25_000, 100_000)
        ]
        text = ", ".join(f"{ms:.0f}" for ms in spent)
        lines.append((f"Figs 6, 8: ms at 1k, 25k, 100k, {way}", text, ""))
    for spec in BASELINES:
        spent = walk(spec, scene, dataset).average("frame_ms")
        lines.append((f"Fig 6: ms, {spec}", f"{spent:.0f}", ""))
    return lines


def typical(job: Callable[[], object]) -> float:
    """Median seconds of a job, after a first turn that warms up."""
    spent = []
    for turn in range(ROUNDS + 1):
        device().context.finish()
        start = time.perf_counter()
        job()
        device().context.finish()
        if turn:
            spent.append(time.perf_counter() - start)
    return median(spent)


def query_rows(scene: Scene, dataset: Dataset, leaf: int) -> list[paper.Line]:
    """Many cells asked at once, over the depth of PLP's estimate: the cells in view of small
    octree leaves, so that there are many. A software rasteriser pays -EXT's counter for every
    fragment, so there its advantage begins where cells are small on screen."""
    culler = PLPCulling(leaf=leaf, budget=25_000)
    culler.prepare(scene)
    camera = dataset.path.frames[len(dataset.path) // 3]
    target = device().target(camera.width, camera.height, channels=4)
    culler.target_for = lambda camera: target  # type: ignore[method-assign]
    culler.cull(camera)
    view = View.of(camera, scene, device().subpixel_bits)
    ids = culler.in_frustum(view)
    boxes = view.inflated(culler.bounds[ids])
    asked = round_outward(boxes[~view.needs_no_query(boxes)])
    queries = BoxQueries(device())
    jobs: dict[str, Callable[[], object]] = {
        way: lambda way=way: queries.ask(  # type: ignore[misc]
            view, target, asked, QueryStats(), way=way, cull_back_faces=True
        )
        for way in ("instanced", "sync", "batch")
    }
    for name, kind in (("item buffer", ItemBufferQueries), ("histogram", HistogramQueries)):
        items = kind(device())
        items.begin(camera.width, camera.height)
        jobs[name] = lambda items=items: items.ask(  # type: ignore[misc]
            view, target.scratch, asked, QueryStats(), whole_front=False, cull_back_faces=True
        )
    spent = {name: typical(job) for name, job in jobs.items()}
    labels = {"instanced": "-EXT", "sync": "-HP one by one", "batch": "-HP in a batch"}
    lines = [
        (f"us a query, {len(asked)} cells at once, {labels.get(name, name)}",
         f"{1e6 * seconds / len(asked):.1f}", "")
        for name, seconds in spent.items()
    ]  # fmt: skip
    for way in ("sync", "batch"):
        ratio = spent[way] / spent["instanced"]
        text = f"cost a query, {len(asked)} cells at once, {labels[way]} over -EXT"
        lines.append((text, f"{ratio:.1f}", ""))
    culler.close()
    return lines


def primitive_rows() -> list[paper.Line]:
    """Table 2, and the histogram's counterpart."""
    lines = []
    for side in (64, 512):
        target = device().target(side, side, channels=4)
        items, histogram = ItemBufferQueries(device()), HistogramQueries(device())
        device().clear(State(target.framebuffer, items.program))
        rng = np.random.default_rng(0)
        image = target.scratch.color_attachments[0]
        image.write(rng.integers(0, 200, (side, side, 4), np.uint8).tobytes())
        for channels in (1, 4):
            raw = target.scratch.read(components=channels, alignment=1)
            ids = np.frombuffer(raw, np.uint8 if channels == 1 else np.uint32) & 255
            transfer = typical(
                lambda target=target, channels=channels: target.scratch.read(
                    components=channels, alignment=1
                )
            )
            scan = typical(lambda ids=ids: np.bincount(ids, minlength=256))
            published = "/".join(
                " + ".join(map(str, machine[side])) for machine in paper.TABLE_2.values()
            )
            lines.append(
                (f"Table 2: us transfer + scan, {side}², {channels} channels",
                 f"{1e6 * transfer:.0f} + {1e6 * scan:.0f}", published)
            )  # fmt: skip
        histogram.begin(side, side)
        spent = typical(
            lambda histogram=histogram, target=target: histogram.scan(
                target.scratch, histogram.active, 255, QueryStats()
            )
        )
        published = "/".join(str(machine[side]) for machine in paper.HISTOGRAM_US.values())
        lines.append((f"section 4: us histogram, {side}²", f"{1e6 * spent:.0f}", published))
    return lines


def depth_rows() -> list[paper.Line]:
    dataset = skyscraper(frames=12)
    scene = scene_of(dataset)
    pixels = dataset.path.frames[0].samples
    lines = []
    for leaf in (5_000, 1_000):
        frustum = walk(f"cplp:order=frustum,fragments=true,leaf={leaf}", scene, dataset)
        for budget in (1_000, 25_000):
            spec = f"cplp:fragments=true,budget={budget},leaf={leaf}"
            found = paper.depth_complexity(frustum, walk(spec, scene, dataset), pixels)
            lines += [(f"leaf {leaf:,}, budget {budget:,}: {q}", a, b) for q, a, b in found]
    return lines


def quality_rows() -> list[paper.Line]:
    """PLP alone on a city of 500,000 triangles: visible triangles found, wrong pixels."""
    dataset = city(scale=0.65, frames=24)
    scene = scene_of(dataset)
    path = dataset.path.resized(512, 512)
    engine = EmbreeEngine(scene)
    owners = [engine.frame(camera).copy().buffer.triangle for camera in path]
    engine.close()
    lines = []
    for share in (0.02, 0.05, 0.1, 0.2):
        culler = PLPCulling(budget=int(share * scene.triangle_count))
        units = culler.prepare(scene)
        found, wrong = [], []
        for camera, owner in zip(path, owners, strict=True):
            drawn = units.mask(culler.cull(camera).unit_ids, scene.triangle_count)
            found.append(drawn[np.unique(owner[owner >= 0])].mean())
            wrong.append(np.count_nonzero(~drawn[owner] & (owner >= 0)) / owner.size)
        culler.close()
        at = f"section 1: PLP on {share:.0%} of {scene.triangle_count:,} triangles"
        published = [f"{value:.0%}" if share == 0.1 else "" for value in paper.PLP_QUALITY]
        lines.append((f"{at}: visible found, mean", f"{mean(found):.1%}", published[0]))
        lines.append((f"{at}: wrong pixels, mean", f"{mean(wrong):.2%}", ""))
        lines.append((f"{at}: wrong pixels, worst", f"{max(wrong):.2%}", published[1]))
    return lines
