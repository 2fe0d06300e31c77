"""What the three passes promise to save, checked by watching them.

Each contract reads what the method told its observer, its counters and its picture. None uses the
method's own code: pieces, reductions and pictures are computed afresh.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tests.mutants.harness import Suite, Trace
from visref_culling.gl.device import device
from visref_culling.gl.item_buffer import ItemBuffer

SUITE = Suite(
    {
        "U1": "LESS in pass two",
        "U2": "writes on in pass two",
        "U3": "no clear before pass three",
        "U4": "tile indices of low and high shifted",
        "U5": "threshold off by one",
        "U6": "transparent slice as occluder",
        "U7": "small image with another aspect",
        "U8": "tile outside its own proxy",
        "U9": "a tile's proxy is another tile's",
        "W9": "stand-ins at another reduction",
        "W10": "a stand-in drawn and asked twice",
        "W11": "a wait for each query",
        "W12": "answers ignored",
    },
    watched=("torn_layers",),
)

# A rectangle cannot be left by an edge collapse that keeps its border: it may stay four triangles.
LEAST_TRIANGLES = 4


def stand_in_sizes(trace: Trace) -> list[int]:
    """Triangles of each stand-in, none in the conservative mode."""
    low = trace.culler.low
    return low.units.sizes.tolist() if low is not None else []


def depths_left_and_afresh(trace: Trace) -> tuple[np.ndarray, np.ndarray]:
    """(height, width) window depth of the picture that the method left, and of one drawn afresh
    from its drawn set."""
    culler, camera = trace.culler, trace.camera
    left = culler.target_for(camera).read_depth().copy()
    items = ItemBuffer(device(), trace.scene, culler.depth_bits)
    drawn = np.array(trace.drawn, np.int32)
    items.image(camera, culler.units.mask(drawn, trace.scene.triangle_count))
    target = device().target(camera.width, camera.height, culler.depth_bits, dtype="i4")
    afresh = target.read_depth().copy()
    items.release()
    return left, afresh


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


@SUITE.contract
def stand_ins_have_the_reduction(trace: Trace) -> Iterator[str]:
    """At most one triangle for `reduction` of the object's, as far as its pieces allow."""
    scene = trace.scene
    for unit, found in enumerate(stand_in_sizes(trace)):
        own = scene.triangles[scene.object_offsets[unit] : scene.object_offsets[unit + 1]]
        if len(own) <= trace.culler.extra:
            most = len(own)
        else:
            least = LEAST_TRIANGLES * pieces(own, scene.vertices)
            most = max(-(-len(own) // trace.culler.reduction), least)
        if found > most:
            yield f"object {unit}: {found} triangles stand in for {len(own)}, not {most}"


@SUITE.contract
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


@SUITE.contract
def pipeline_stalls_once(trace: Trace) -> Iterator[str]:
    asked = sum(len(data["units"]) for data in trace.of("query"))
    if trace.stats.batches != min(asked, 1):
        yield f"{trace.stats.batches} waits for {asked} queries"


@SUITE.contract
def only_what_shows_is_drawn(trace: Trace) -> Iterator[str]:
    shown = {
        unit
        for data in trace.of("query")
        for unit, samples in zip(data["units"].tolist(), data["samples"].tolist(), strict=True)
        if samples > trace.culler.threshold
    }
    if shown != set(trace.drawn):
        yield f"{len(trace.drawn)} objects drawn, of which {len(shown)} showed"


@SUITE.contract
def third_pass_draws_on_empty_buffers(trace: Trace) -> Iterator[str]:
    left, afresh = depths_left_and_afresh(trace)
    differ = int(np.count_nonzero(left != afresh))
    if differ:
        yield f"{differ} pixels have another depth than the drawn set's own picture"
