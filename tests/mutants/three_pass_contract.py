"""What the three passes promise to save, checked by watching them.

Each contract reads what the method told its observer, its counters and its picture, and yields a
line for each departure. None uses the method's own code: pieces, reductions and pictures are
computed afresh.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from visref.camera import Camera
from visref.culler import QueryStats
from visref.scene import Scene
from visref_culling.gl.device import device
from visref_culling.gl.item_buffer import ItemBuffer
from visref_culling.three_pass import ThreePassCulling

# A rectangle cannot be left by an edge collapse that keeps its border: it may stay four triangles.
LEAST_TRIANGLES = 4


@dataclass
class Trace:
    """One frame, as its observer saw it. `sizes`: triangles of each stand-in; `depth`,
    `expected`: (height, width) window depth of the picture that the method left, and of one
    drawn afresh from its drawn set."""

    culler: ThreePassCulling
    scene: Scene
    sizes: list[int]
    events: list[tuple[str, dict[str, Any]]] = field(default_factory=list)
    drawn: list[int] = field(default_factory=list)
    stats: QueryStats = field(default_factory=QueryStats)
    depth: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    expected: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))

    def of(self, step: str) -> list[dict[str, Any]]:
        return [data for name, data in self.events if name == step]


Contract = Callable[[Trace], Iterator[str]]
CONTRACTS: dict[str, Contract] = {}


def _contract(check: Contract) -> Contract:
    CONTRACTS[check.__name__] = check
    return check


def broken(culler: ThreePassCulling, scene: Scene, cameras: Iterable[Camera]) -> set[str]:
    """The names of the contracts that some frame departs from."""
    traces = watch(culler, scene, cameras)
    return {name for name, check in CONTRACTS.items() if any(any(check(t)) for t in traces)}


def watch(culler: ThreePassCulling, scene: Scene, cameras: Iterable[Camera]) -> list[Trace]:
    culler.prepare(scene)
    sizes = culler.low.units.sizes.tolist() if culler.low is not None else []
    items = ItemBuffer(device(), scene, culler.depth_bits)
    traces = []
    for camera in cameras:
        trace = Trace(culler, scene, sizes)
        traces.append(trace)
        culler.observer = lambda step, data, trace=trace: trace.events.append((step, dict(data)))
        answer = culler.cull(camera)
        trace.drawn, trace.stats = answer.unit_ids.tolist(), answer.stats
        trace.depth = culler.target_for(camera).read_depth().copy()
        items.image(camera, culler.units.mask(answer.unit_ids, scene.triangle_count))
        target = device().target(camera.width, camera.height, culler.depth_bits, dtype="i4")
        trace.expected = target.read_depth().copy()
    items.release()
    culler.close()
    return traces


def pieces(triangles: np.ndarray, vertices: np.ndarray) -> int:
    """In how many connected pieces triangles are, by the places of their corners."""
    _, place = np.unique(vertices[triangles.reshape(-1)], axis=0, return_inverse=True)
    corners = place.reshape(-1, 3)
    label = np.arange(corners.max(initial=-1) + 1)
    while True:
        least = label[corners].min(axis=1)
        before = label.copy()
        np.minimum.at(label, corners.reshape(-1), np.repeat(least, 3))
        label = label[label]
        if np.array_equal(before, label):
            return len(np.unique(label))


@_contract
def stand_ins_have_the_reduction(trace: Trace) -> Iterator[str]:
    """At most one triangle for `reduction` of the object's, as far as its pieces allow."""
    scene = trace.scene
    for unit, found in enumerate(trace.sizes):
        own = scene.triangles[scene.object_offsets[unit] : scene.object_offsets[unit + 1]]
        if len(own) <= trace.culler.extra:
            most = len(own)
        else:
            least = LEAST_TRIANGLES * pieces(own, scene.vertices)
            most = max(-(-len(own) // trace.culler.reduction), least)
        if found > most:
            yield f"object {unit}: {found} triangles stand in for {len(own)}, not {most}"


@_contract
def each_stand_in_is_drawn_once_and_asked_once(trace: Trace) -> Iterator[str]:
    filled = np.concatenate([data["units"] for data in trace.of("fill")])
    asked = np.concatenate([data["units"] for data in trace.of("query")])
    for name, ids in (("drawn", filled), ("asked", asked)):
        if len(np.unique(ids)) != len(ids):
            yield f"a stand-in is {name} more than once"
    if set(filled.tolist()) != set(asked.tolist()):
        yield "not the same stand-ins are drawn and asked"
    if trace.stats.queries != len(asked):
        yield f"{trace.stats.queries} queries for {len(asked)} stand-ins"


@_contract
def pipeline_stalls_once(trace: Trace) -> Iterator[str]:
    asked = sum(len(data["units"]) for data in trace.of("query"))
    if trace.stats.batches != min(asked, 1):
        yield f"{trace.stats.batches} waits for {asked} queries"


@_contract
def only_what_shows_is_drawn(trace: Trace) -> Iterator[str]:
    shown = {
        unit
        for data in trace.of("query")
        for unit, samples in zip(data["units"].tolist(), data["samples"].tolist(), strict=True)
        if samples > trace.culler.threshold
    }
    if shown != set(trace.drawn):
        yield f"{len(trace.drawn)} objects drawn, of which {len(shown)} showed"


@_contract
def third_pass_draws_on_empty_buffers(trace: Trace) -> Iterator[str]:
    differ = int(np.count_nonzero(trace.depth != trace.expected))
    if differ:
        yield f"{differ} pixels have another depth than the drawn set's own picture"
