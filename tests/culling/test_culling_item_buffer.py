"""The GL image of ids against closed forms and against rays cast one by one."""

import math

import numpy as np
import pytest

from tests.support.culling_scenes import (
    QUAD_FACES,
    box,
    ortho,
    owners_by_brute_force,
    perspective,
    quad,
)
from visref.camera import Camera
from visref.engines.embree import EmbreeEngine
from visref.scene import Alpha, Scene
from visref_culling.gl.item_buffer import GLRaster
from visref_culling.item_buffer_engine import ItemBufferEngine

pytestmark = pytest.mark.gl


def truth(scene, camera):
    engine = ItemBufferEngine(scene)
    frame = engine.frame(camera).copy()
    engine.close()
    return frame


def with_materials(scene, *, alpha=None, one_sided=None):
    return Scene(
        scene.vertices,
        scene.triangles,
        scene.object_offsets,
        scene.names,
        np.zeros(scene.triangle_count, bool) if one_sided is None else np.asarray(one_sided),
        np.zeros(scene.triangle_count, np.uint8) if alpha is None else np.asarray(alpha, np.uint8),
    )


@pytest.mark.parametrize("make", [ortho, perspective])
def test_quads_own_exactly_their_pixels_at_their_depth(make):
    depth_near, depth_far = 4.0, 8.0
    pixel = {d: 1.0 if make is ortho else 2.0 * d / 16 for d in (depth_near, depth_far)}
    # 3 by 2 pixels, its lower left corner at the image's middle; behind it the whole image.
    small = quad((0, 0), (3 * pixel[depth_near], 2 * pixel[depth_near]), -depth_near)
    wide = quad((-99, -99), (99, 99), -depth_far)
    scene = Scene.from_objects([("wide", *wide), ("small", *small)])
    frame = truth(scene, make(20, 16))
    owners = scene.object_of_triangle[frame.buffer.triangle]
    expected = np.zeros((16, 20), int)
    expected[6:8, 10:13] = 1
    assert owners.tolist() == expected.tolist()
    exact = np.where(expected == 1, depth_near, depth_far)
    assert np.allclose(frame.buffer.depth, exact, rtol=1e-5)
    assert frame.buffer.triangle.dtype == np.int32
    assert frame.buffer.depth.dtype == np.float64


def test_lens_shift_moves_the_picture_right_and_down():
    scene = Scene.from_objects([("a", *quad((0, 0), (1, 1), -4.0))])
    plain = truth(scene, ortho(8, 8)).buffer.triangle >= 0
    shifted = truth(scene, ortho(8, 8, shift_x_px=2.0, shift_y_px=-1.0)).buffer.triangle >= 0
    assert np.argwhere(plain).tolist() == [[3, 4]]
    assert np.argwhere(shifted).tolist() == [[4, 2]]


def test_background_is_minus_one_at_infinity():
    frame = truth(Scene.from_objects([]), perspective(3, 2))
    assert (frame.buffer.triangle == -1).all()
    assert np.isinf(frame.buffer.depth).all()


def test_infinite_range_gives_finite_depths():
    scene = Scene.from_objects([("a", *quad((-1e9, -1e9), (1e9, 1e9), -1e8))])
    frame = truth(scene, perspective(4, 4, near=0.1, far=math.inf))
    assert (frame.buffer.triangle >= 0).all()
    assert np.isfinite(frame.buffer.depth).all()


@pytest.mark.slow
@pytest.mark.parametrize("origin", [0.0, 1e5, 1e7])
@pytest.mark.parametrize("seed", range(4))
def test_agrees_with_rays_wherever_the_answer_is_clear(origin, seed):
    rng = np.random.default_rng(seed)
    size = 4.0 if origin < 1e7 else 64.0  # float32 steps by 1 at 1e7
    objects = [
        ("o", rng.uniform(-1, 1, (6, 3)) * size + origin, [(0, 1, 2), (3, 4, 5)]) for _ in range(12)
    ]
    scene = Scene.from_objects(objects)
    scene = with_materials(scene, one_sided=rng.random(scene.triangle_count) < 0.5)
    pose = np.eye(4)
    pose[:3, 3] = origin + np.array([0.01, 0.02, 1.2 * size])
    camera = Camera(pose, 24, 16, 0.05 * size, 10.0 * size, yfov=1.4)
    owner, depth, margin = owners_by_brute_force(scene, camera)
    frame = truth(scene, camera)
    clear = margin > 0.02
    assert clear.mean() > 0.7
    assert (owner[clear] >= 0).any()
    assert (frame.buffer.triangle[clear] == owner[clear]).all()
    hit = clear & (owner >= 0)
    assert np.allclose(frame.buffer.depth[hit], depth[hit], rtol=1e-3)


def test_nearer_than_near_and_farther_than_far_do_not_count():
    scene = Scene.from_objects(
        [("near", *quad((-9, -9), (9, 9), -1.0)), ("far", *quad((-9, -9), (9, 9), -9.0))]
    )
    for bounds, owner in (((0.5, 10.0), 0), ((2.0, 10.0), 1), ((2.0, 8.0), -1)):
        found = truth(scene, ortho(4, 4, *bounds)).buffer.triangle
        assert set(np.where(found >= 0, found // 2, -1).flat) == {owner}


def test_one_sided_triangles_show_their_front_alone():
    vertices, faces = quad((-9, -9), (9, 9), -4.0)
    for flipped in (False, True):
        scene = Scene.from_objects([("a", vertices, faces[:, ::-1] if flipped else faces)])
        assert (truth(scene, ortho(4, 4)).buffer.triangle >= 0).all()
        scene = with_materials(scene, one_sided=[True, True])
        assert (truth(scene, ortho(4, 4)).buffer.triangle >= 0).all() != flipped


def test_masked_triangles_make_samples_undecided_and_own_none():
    scene = Scene.from_objects(
        [
            ("leaf", *quad((0, 0), (2, 1), -4.0)),
            ("wall", *quad((-9, -9), (9, 9), -5.0)),
            ("hidden leaf", *quad((-2, -2), (0, 0), -6.0)),
        ]
    )
    alpha = np.repeat([Alpha.MASK, Alpha.OPAQUE, Alpha.MASK], 2)
    frame = truth(with_materials(scene, alpha=alpha), ortho(8, 8))
    assert frame.undecided.tolist() == [3 * 8 + 4, 3 * 8 + 5]
    assert set(frame.buffer.triangle.flat) <= {2, 3}


def test_blended_objects_are_seen_before_the_nearest_opaque_hit():
    glass = quad((0, 0), (2, 1), -4.0)
    scene = Scene.from_objects(
        [
            (
                "glass",
                np.concatenate([glass[0], glass[0] - (0, 0, 0.5)]),
                [*QUAD_FACES, *QUAD_FACES + 4],
            ),
            ("wall", *quad((-9, -9), (1, 9), -5.0)),
            ("behind", *quad((-2, -2), (0, 0), -6.0)),
            ("beside", *quad((2, 0), (3, 3), -6.0)),
        ]
    )
    alpha = np.repeat([Alpha.BLEND, Alpha.OPAQUE, Alpha.BLEND, Alpha.BLEND], [4, 2, 2, 2])
    frame = truth(with_materials(scene, alpha=alpha), ortho(8, 8))
    assert frame.blend.object.tolist() == [0, 0, 3, 3, 3]
    assert frame.blend.sample.tolist() == [3 * 8 + 4, 3 * 8 + 5, *(y * 8 + 6 for y in (1, 2, 3))]
    # Of an object's layers the last one drawn stands for all.
    assert np.allclose(frame.blend.depth, [4.5, 4.5, 6.0, 6.0, 6.0])
    assert set(frame.buffer.triangle.flat) == {-1, 4, 5}


def test_image_of_what_shows_is_the_whole_image_and_any_loss_is_seen():
    scene = Scene.from_objects(
        [
            ("front", *box((0, 0, -5), 1.0)),
            ("hidden", *box((0, 0, -8), 0.5)),
            ("glass", *quad((2, 2), (3, 3), -4.0)),
        ]
    )
    alpha = np.zeros(scene.triangle_count, np.uint8)
    alpha[-2:] = Alpha.BLEND
    scene = with_materials(scene, alpha=alpha)
    raster = GLRaster(scene)
    camera = perspective(33, 31)
    whole = raster.image(camera, np.ones(scene.triangle_count, bool))
    for left_out, same in ((0, False), (1, True), (2, False)):
        kept = scene.object_of_triangle != left_out
        assert np.array_equal(raster.image(camera, kept), whole) is same
    assert not np.array_equal(raster.item_buffer(camera), whole)  # opaque alone
    raster.close()
    engine = ItemBufferEngine(scene)
    for left_out, same in ((0, False), (1, True), (2, False)):
        assert (engine.pixels_differ(camera, scene.object_of_triangle != left_out) == 0) is same
    engine.close()


def test_an_engine_frame_is_the_same_after_other_cameras():
    scene = Scene.from_objects([("a", *box((0, 0, -5), 1.0)), ("b", *box((1, 1, -7), 1.0))])
    engine = ItemBufferEngine(scene)
    first = engine.frame(perspective(20, 16)).copy()
    engine.frame(ortho(20, 16))
    engine.frame(perspective(7, 33))
    again = engine.frame(perspective(20, 16))
    assert np.array_equal(first.buffer.triangle, again.buffer.triangle)
    assert np.array_equal(first.buffer.depth, again.buffer.depth)
    engine.close()


@pytest.mark.parametrize("seed", range(3))
def test_agrees_with_embree_but_for_a_few_border_pixels(seed):
    rng = np.random.default_rng(seed)
    objects = [
        (f"b{i}", *box(tuple(rng.uniform(-4, 4, 3) - (0, 0, 7)), rng.uniform(0.1, 0.8)))
        for i in range(60)
    ]
    scene = Scene.from_objects(objects)
    camera = perspective(160, 120)
    ours = truth(scene, camera)
    embree = EmbreeEngine(scene)
    theirs = embree.frame(camera)
    owners = [
        np.where(f.buffer.triangle >= 0, scene.object_of_triangle[f.buffer.triangle], -1)
        for f in (ours, theirs)
    ]
    assert (owners[0] != owners[1]).mean() < 0.002
    both = (owners[0] == owners[1]) & (owners[0] >= 0)
    assert np.allclose(ours.buffer.depth[both], theirs.buffer.depth[both], rtol=1e-3)
    embree.close()
