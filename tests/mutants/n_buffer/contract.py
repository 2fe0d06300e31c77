"""What the N-buffer promises to save, checked by watching its steps and its drawn sets.

Nothing of the method's own code is used: rectangles and depths are computed here, by hand, from
the scene and the camera, and the depth map is the one that the method drew.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import numpy as np

from tests.mutants.harness import Suite, Trace
from visref.camera import Camera
from visref.conformance.scenes import Case, case, pixel_panel
from visref.conformance.scenes import camera as camera_at
from visref.scene import Scene

SUITE = Suite(
    {
        "U1": "min for max, or reversed depth",
        "U2": "d for d + 1 pixels",
        "U3": "offset 2^(i±1)",
        "U4": "the second square one pixel short",
        "U5": "level rounded down",
        "U6": "bottom and top origin mixed",
        "U7": "unclipped query",
        "U8": "linear filtering, or half a texel off",
        "U9": "top level missing at 640",
        "U10": "last frame's depth",
        "U11": "half-float level",
        "W12": "border 1",
        "W13": "repeat wrap",
    },
    watched=("edges_of_the_image", "revealed_by_a_pierced_wall", "crowd", "peeking_by_a_pixel"),
    # Each camera stands for three frames: all is drawn, all is an occluder, what passed is drawn.
    cameras=lambda path: [camera for camera in path.cameras[:2] for _ in range(3)],
)

# How far the method's inflated box may stand off the true one in pixels, and its stored depth in
# window depth: well above both, and far below what separates things in the watched scenes.
SLACK_PX = 0.02
SLACK_DEPTH = 1e-5


def window_depth(camera: Camera, depth: np.ndarray) -> np.ndarray:
    """Of a perspective camera with a finite far plane."""
    near, far = camera.near, camera.far
    return (1.0 / near - 1.0 / depth) / (1.0 / near - 1.0 / far)


def rectangle_and_depth(scene: Scene, camera: Camera, unit: int) -> tuple[list[int], float] | None:
    """x0, y0, x1, y1 of a unit's box, as large as the method may take it, and its least depth;
    None where it reaches behind the near plane."""
    low, high = scene.object_bounds[unit]
    corners = np.array(list(itertools.product(*zip(low, high, strict=True))), float)
    points, depth = camera.pixel_of(corners)
    if depth.min() <= camera.near * 1.01:
        return None
    # `pixel_of` has integers at centres; a pixel's square begins half before.
    first = np.floor(points.min(axis=0) + 0.5 - SLACK_PX).astype(int)
    last = np.floor(points.max(axis=0) + 0.5 + SLACK_PX).astype(int)
    return [*first, *last], float(depth.min())


def must_be_hidden(depth: np.ndarray, rectangle: list[int], nearest: float) -> bool:
    """Whether one square of the paper's says so. `depth`: the map, top row first."""
    height, width = depth.shape
    x0, y0 = max(rectangle[0], 0), max(rectangle[1], 0)
    x1, y1 = min(rectangle[2], width - 1), min(rectangle[3], height - 1)
    if x0 > x1 or y0 > y1:
        return True
    side = 1
    while side < max(x1 - x0 + 1, y1 - y0 + 1):
        side *= 2
    return nearest > depth[y0 : y0 + side, x0 : x0 + side].max() + SLACK_DEPTH


@SUITE.contract
def what_one_square_hides_is_not_drawn(trace: Trace) -> Iterator[str]:
    """A box whose smallest power-of-two square, from its rectangle's upper left corner and clipped
    to the image, is nearer all over than the box is not drawn, unless the frame before saw it:
    then it is an occluder once, and forgotten."""
    drawn, before = set(trace.drawn), trace.before
    hidden_before = hidden_units(before) if before else set()
    drawn_before = set(before.drawn) if before else set()
    in_vain = drawn & hidden_units(trace) & (hidden_before | (drawn - drawn_before))
    yield from (f"unit {unit} is drawn" for unit in sorted(in_vain))


@SUITE.contract
def every_unit_in_view_is_tested(trace: Trace) -> Iterator[str]:
    """The occluders too. Not so with a hierarchy; on the GPU nothing tells."""
    culler = trace.culler
    tested = [len(data["boxes"]) for data in trace.of("test")]
    in_view = len(culler.tree.in_frustum(culler.view_of(trace.camera)))
    if tested and not culler.hierarchy and sum(tested) != in_view:
        yield f"{sum(tested)} boxes of {in_view}"


@lru_cache(maxsize=2)
def hidden_units(trace: Trace) -> set[int]:
    """The units that must be hidden by the depth map of a frame: called while it is there."""
    scene, camera, depth = trace.scene, trace.camera, map_of(trace.culler)
    found = set()
    for unit in range(scene.object_count):
        at = rectangle_and_depth(scene, camera, unit)
        if at is not None:
            nearest = float(window_depth(camera, np.array([at[1]]))[0])
            if must_be_hidden(depth, at[0], nearest):
                found.add(unit)
    return found


def map_of(culler: Any) -> np.ndarray:
    """The depth that was looked up in the last frame, top row first."""
    made: np.ndarray = culler.gpu.map.read()[0] if culler.gpu is not None else culler.map.levels[0]
    return made


@SUITE.scene("draws nothing that is hidden along the image's edges")
def edges_of_the_image(rng: np.random.Generator) -> Case:
    """Boxes hidden along the lower and the right edge, flat, high and square, so that squares over
    them leave the image; along the other two edges one looks past the wall."""
    view = camera_at()
    wall = pixel_panel(view, (1.5, 70.0), (1.5, 60.0), 5.0)
    objects = [("wall", wall)]
    for k in range(5):
        x, y = 4.0 + 11.0 * k, 4.0 + 8.0 * k
        objects.append((f"flat{k}", pixel_panel(view, (x, x + 9.0), (46.8, 47.2), 9.0)))
        objects.append((f"high{k}", pixel_panel(view, (62.8, 63.2), (y, y + 7.0), 9.0)))
    objects.append(("square", pixel_panel(view, (58.8, 63.2), (42.8, 47.2), 9.0)))
    return case(objects, [view, view])
