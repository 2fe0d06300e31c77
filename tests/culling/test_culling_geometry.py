"""Units drawn by multi-draw: the right triangles, the right counts."""

import numpy as np
import pytest

from tests.support.culling_scenes import ortho, quad
from visref.culler import QueryStats
from visref.scene import Alpha, Scene, Units
from visref_culling.gl.device import State, device
from visref_culling.gl.geometry import Geometry, occluders
from visref_culling.gl.view import View

pytestmark = pytest.mark.gl
CAMERA = ortho(16, 12)


def columns(count):
    """Quads one pixel wide side by side, object i in column i, all rows."""
    return Scene.from_objects(
        [(f"c{i}", *quad((i - 8, -6), (i - 7, 6), -5.0 - i)) for i in range(count)]
    )


def draw(scene, units, ids, occludes=None):
    geometry = Geometry(device(), scene, units, occluders(scene) if occludes is None else occludes)
    view = View.of(CAMERA, scene, device().subpixel_bits)
    target = device().target(CAMERA.width, CAMERA.height)
    device().clear(State(target.framebuffer, geometry.program))
    stats = QueryStats()
    geometry.draw(view, target, np.array(ids, int), stats)
    image = np.frombuffer(target.framebuffer.read(components=1), np.uint8).reshape(12, 16)
    depth, fragments = (
        target.read_depth().copy(),
        geometry.fragments(view, target, np.array(ids, int)),
    )
    geometry.release()
    return image > 0, depth < 1.0, stats, fragments


@pytest.mark.parametrize("ids", [[], [3], [0, 5], [9, 2, 4], list(range(10))])
def test_exactly_the_named_units_are_drawn_in_one_call(ids):
    scene = columns(10)
    image, depth, stats, fragments = draw(scene, scene.object_units(), ids)
    assert np.flatnonzero(image.all(axis=0)).tolist() == sorted(ids)
    assert image.sum() == 12 * len(ids) == fragments
    assert np.array_equal(image, depth)
    assert (stats.triangles_drawn, stats.units_drawn) == (2 * len(ids), len(ids))
    assert stats.draw_calls == (1 if ids else 0)


def test_units_may_overlap_and_be_empty():
    scene = columns(4)
    units = Units(np.array([0, 2, 2, 5]), np.array([0, 1, 0, 1, 6], np.int32))
    image, _, stats, fragments = draw(scene, units, [0, 1, 2])
    assert image[:, 0].all()
    assert not image[:, 1:3].any()
    assert 0 < image[:, 3].sum() < 12
    assert stats.triangles_drawn == 5
    assert fragments == 24 + image[:, 3].sum()  # hidden fragments are counted too


def test_only_opaque_triangles_write_depth():
    scene = columns(3)
    alpha = np.repeat([Alpha.OPAQUE, Alpha.MASK, Alpha.BLEND], 2).astype(np.uint8)
    scene = Scene(
        scene.vertices,
        scene.triangles,
        scene.object_offsets,
        scene.names,
        np.array([True, True, False, False, True, True]),
        alpha,
    )
    image, depth, stats, _ = draw(scene, scene.object_units(), [0, 1, 2])
    assert np.flatnonzero(image.all(axis=0)).tolist() == [0, 1, 2]
    assert np.flatnonzero(depth.all(axis=0)).tolist() == [0]
    assert stats.triangles_drawn == 6
    assert stats.draw_calls == 3  # a call for each class of triangles


def test_one_sided_back_faces_are_not_drawn():
    scene = columns(2)
    flipped = scene.triangles.copy()
    flipped[2:] = flipped[2:, ::-1]
    scene = Scene(scene.vertices, flipped, scene.object_offsets, scene.names, np.ones(4, bool))
    image, _, _, fragments = draw(scene, scene.object_units(), [0, 1])
    assert np.flatnonzero(image.all(axis=0)).tolist() == [0]
    assert fragments == 12
