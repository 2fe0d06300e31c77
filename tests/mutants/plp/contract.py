"""What PLP promises to save, checked by watching its steps, in plain Python."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import numpy as np

from tests.mutants.harness import Suite, Trace
from visref_culling.boxes.conservative import inflated, meets_frustum, needs_no_query
from visref_culling.gl.view import View
from visref_culling.plp.traversal import near_corners

SUITE = Suite(
    {
        "U1": "stops at the budget",
        "U2": "a single item-buffer pass",
        "U3": "ids wrap at 256 or hit the background",
        "U4": "depth mask on during queries",
        "U5": "equal-size neighbours only",
        "U6": "empty leaves skipped",
        "U7": "a triangle only in its centroid's leaf",
        "U8": "eye outside: nearest cell not in the frustum, so an empty front",
        "U9": "back faces of cells culled",
        "U10": "tile retired at a viewport that is no multiple of 64, or on stale state",
        "U11": "multisampling, dither or blending on the item target",
        "U12": "no re-render after the restore",
        "W13": "solidity ignored",
        "W14": "occluded cells queued again",
        "W15": "triangles drawn twice",
    },
    watched=("walk_through_a_city",),
)


@SUITE.contract
def no_cell_is_asked_twice(trace: Trace) -> Iterator[str]:
    asked = [unit for data in trace.of("query") for unit in data["units"].tolist()]
    if len(asked) != len(set(asked)):
        yield f"{len(asked) - len(set(asked))} questions too many"


@SUITE.contract
def no_triangle_is_drawn_twice(trace: Trace) -> Iterator[str]:
    drawn = trace.culler.units.mask(np.array(trace.drawn, np.int32), trace.scene.triangle_count)
    if trace.stats.triangles_drawn != drawn.sum():
        yield f"{trace.stats.triangles_drawn} drawn of {drawn.sum()}"


# The light of a cell is a product along a path of fewer than 2**8 cells here, of exponentials of
# sums of fewer than 2**8 areas, its pixels some twenty roundings more: fewer than 2**13 of 2**-53.
ROUNDING = 2.0**-40


@SUITE.contract
def cells_come_in_the_order_of_what_shows(trace: Trace) -> Iterator[str]:
    """The docstrings of `plp.traversal` and `solidity`, followed along the order found,
    from pairs of boxes that touch, in plain Python."""
    (found,) = [data["cells"].tolist() for data in trace.of("estimate")]
    camera, scene = trace.camera, trace.scene
    octree, budget = trace.culler.octree, trace.culler.budget
    view = View.of(camera, scene, 8)
    bounds, units = octree.bounds, octree.units
    boxes = inflated(view, bounds)
    in_view = np.flatnonzero(meets_frustum(view, boxes)).tolist()
    sure = needs_no_query(view, boxes)
    counts = trace.culler.counts_primitives
    pixels = {cell: 1.0 if counts else rectangle_by_hand(camera, bounds[cell]) for cell in in_view}
    light = {cell: 1.0 for cell in in_view if sure[cell] or on_open_hull(octree, view, cell)}
    held = {
        cell: set(units.triangles[units.offsets[cell] : units.offsets[cell + 1]].tolist())
        for cell in in_view
    }
    front, done, drawn = set(light), set(), set()
    for cell in found:
        if cell not in front:
            yield f"cell {cell} comes before a neighbour of it"
            return
        if len(drawn) >= budget:
            yield f"{len(drawn)} triangles were enough"
        most = max(pixels[other] * light[other] for other in front)
        if pixels[cell] * light[cell] < most * (1.0 - ROUNDING):
            yield f"cell {cell} shows at {pixels[cell] * light[cell]} pixels, another at {most}"
        front.remove(cell)
        done.add(cell)
        drawn |= held[cell]
        stops = solidity_by_hand(scene, bounds[cell], sorted(held[cell]))
        share = units.sizes[cell] / max(units.sizes)
        for other in in_view:
            axis = common_face(bounds[cell], bounds[other])
            if axis is not None and other not in done:
                stopped = stops[axis]
                if counts:
                    stopped = share * slant_by_hand(camera, bounds[cell], bounds[other], axis)
                handed_on = light[cell] * math.exp(-stopped)
                light[other] = max(light.get(other, 0.0), handed_on)
                front.add(other)
    if front and len(drawn) < budget:
        yield f"it stops at {len(drawn)} triangles"


def on_open_hull(octree, view, cell) -> bool:
    """Whether the cell lies along a face of the root beyond which a part of the near plane is."""
    corners, high = near_corners(view), octree.low + octree.side
    low_side = (octree.bounds[cell, 0] == octree.low) & (corners < octree.low).any(axis=0)
    high_side = (octree.bounds[cell, 1] == high) & (corners > high).any(axis=0)
    return bool((low_side | high_side).any())


def rectangle_by_hand(camera, box) -> float:
    """Pixels of a box's screen rectangle, by the samples' definition."""
    right, up = camera.right_step, camera.up_step
    places = []
    for corner in itertools.product(*box.T):
        way = np.array(corner) - camera.eye
        depth = way @ camera.forward if camera.is_perspective else 1.0
        if depth <= 0.0:
            return float(camera.samples)
        a, b = way @ right / (right @ right) / depth, way @ up / (up @ up) / depth
        places.append(((a - camera.column_a[0] + 1.0) / 2.0, (camera.row_b[0] + 1.0 - b) / 2.0))
    image = (camera.width, camera.height)
    low, high = (np.clip(end(places, axis=0), 0.0, image) for end in (np.min, np.max))
    return max(float((high - low).prod()), 1.0)


def solidity_by_hand(scene, box, triangles) -> list[float]:
    """Half the area of the triangles in a box, projected along each axis, over its face's."""
    total = np.zeros(3)
    for triangle in triangles:
        polygon = list(scene.vertices[scene.triangles[triangle]].astype(float))
        for axis, (limit, inwards) in itertools.product(range(3), zip(box, (1, -1), strict=True)):
            kept = []
            for here, there in zip(polygon, polygon[1:] + polygon[:1], strict=True):
                a, b = ((p[axis] - limit[axis]) * inwards for p in (here, there))
                kept += [here] if a >= 0 else []
                kept += [here + a / (a - b) * (there - here)] if a * b < 0 else []
            polygon = kept
        if len(polygon) > 2:
            fan = np.array(polygon[1:]) - polygon[0]
            total += np.abs(np.cross(fan[:-1], fan[1:])).sum(axis=0) / 2.0
    return (total / 2.0 / (box[1, 0] - box[0, 0]) ** 2).tolist()


def slant_by_hand(camera, a, b, axis) -> float:
    """How squarely one looks at the face that two boxes share, across `axis`: a cosine."""
    middle = (np.maximum(a[0], b[0]) + np.minimum(a[1], b[1])) / 2.0
    way = middle - camera.eye if camera.is_perspective else camera.forward
    return abs(way[axis]) / float(np.linalg.norm(way))


def common_face(a, b) -> int | None:
    """The axis across the face that two boxes share, if they do."""
    low, high = np.maximum(a[0], b[0]), np.minimum(a[1], b[1])
    flat = low == high
    return int(np.argmax(flat)) if (low <= high).all() and flat.sum() == 1 else None
