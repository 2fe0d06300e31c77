"""Hypothesis scenes for any culler: few objects, coordinates on a grid, so that ties happen.

Half-unit coordinates put vertices, edges and faces exactly on one another, on samples and on
the eye, where cullers and engines go wrong together if at all.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from hypothesis import strategies as st

from visref.camera import Camera, look_at
from visref.conformance.scenes import Case, Mesh, box, case, panel
from visref.scene import Alpha

coordinate = st.integers(-8, 8).map(lambda i: i / 2)
point = st.tuples(coordinate, coordinate, coordinate)


@st.composite
def boxes(draw) -> Mesh:
    """Closed, or flat in some axes."""
    low, high = np.array(draw(point)), np.array(draw(point))
    return box(np.minimum(low, high), np.maximum(low, high))


@st.composite
def panels(draw) -> Mesh:
    (x0, x1), (y0, y1) = (sorted(draw(st.tuples(coordinate, coordinate))) for _ in range(2))
    return panel((x0, x1), (y0, y1), draw(coordinate))


@st.composite
def triangles(draw) -> Mesh:
    """One to three triangles of one object, perhaps without area."""
    count = draw(st.integers(1, 3))
    corners = draw(st.lists(point, min_size=3 * count, max_size=3 * count))
    return np.array(corners), np.arange(3 * count).reshape(-1, 3)


@st.composite
def slivers(draw) -> Mesh:
    """Two points of the grid, and a third beside one of them."""
    a, b = np.array(draw(point)), np.array(draw(point))
    aside = np.array(draw(point)) * 2.0 ** draw(st.integers(-14, -6))
    return np.stack([a, b, a + aside]), np.array([[0, 1, 2]])


nothing: Mesh = (np.zeros((0, 3)), np.zeros((0, 3), np.int64))
meshes = st.one_of(boxes(), panels(), triangles(), slivers(), st.just(nothing))


@st.composite
def cameras(draw, targets: list[np.ndarray]) -> Camera:
    """On the grid, so perhaps inside an object or on its face; it looks at one of the targets,
    or along an axis or a diagonal."""
    eye = np.array(draw(point))
    directions = st.tuples(*[st.sampled_from((-1.0, 0.0, 1.0))] * 3).filter(any)
    ahead = [target for target in targets if not np.array_equal(target, eye)]
    aim = draw(
        st.sampled_from(ahead) if ahead and draw(st.booleans()) else directions.map(eye.__add__)
    )
    width, height = draw(st.sampled_from([(16, 12), (13, 7), (1, 1), (1, 24), (32, 5), (8, 8)]))
    near = draw(st.sampled_from([0.125, 0.5, 2.0]))
    view: dict[str, float] = {}
    if draw(st.booleans()):
        view["yfov"] = draw(st.sampled_from([0.5, 1.0, math.pi / 2, 2.2]))
        view["far"] = draw(st.sampled_from([math.inf, 8.0, 64.0]))
    else:
        view["ymag"] = draw(st.sampled_from([1.0, 2.0, 6.0]))
        view["far"] = draw(st.sampled_from([8.0, 64.0]))
        near = draw(st.sampled_from([near, 0.0, -4.0]))
    if draw(st.integers(0, 4)) == 0:
        view["shift_x_px"], view["shift_y_px"] = draw(st.sampled_from([(0.5, 0.0), (-3.25, 2.0)]))
    return Camera(look_at(eye, aim), width, height, near, cut=True, **view)


@st.composite
def cases(draw, most_objects: int = 10) -> Case:
    """A scene with one to three cameras. Some objects are there twice; some triangles are
    one-sided, some blended."""
    own = draw(st.lists(meshes, min_size=1, max_size=most_objects))
    own += [own[i] for i in draw(st.lists(st.integers(0, len(own) - 1), max_size=2))]
    targets = [mesh[0].mean(axis=0) for mesh in own if len(mesh[0])]
    views = draw(st.lists(cameras(targets), min_size=1, max_size=3))
    made = case([("object", mesh) for mesh in own], views)
    count = made.scene.triangle_count
    if not count or not draw(st.booleans()):
        return made
    one_sided = draw(st.lists(st.booleans(), min_size=len(own), max_size=len(own)))
    kinds = st.sampled_from([Alpha.OPAQUE, Alpha.OPAQUE, Alpha.OPAQUE, Alpha.BLEND])
    alpha = draw(st.lists(kinds, min_size=len(own), max_size=len(own)))
    owner = made.scene.object_of_triangle
    materials = {
        "one_sided": np.array(one_sided)[owner],
        "alpha": np.array(alpha, np.uint8)[owner],
    }
    return replace(made, scene=replace(made.scene, **materials))
