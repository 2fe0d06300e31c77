"""The baselines are safe, and every one of their safety steps is needed."""

import numpy as np
import pytest

from tests.support.culling_scenes import box, ortho, perspective, quad, random_camera, random_scene
from visref.camera import Camera
from visref.errors import InputError
from visref.scene import Alpha, Scene
from visref_culling.baselines import FrustumCulling, NoCulling, SingleQueryCulling
from visref_culling.gl.geometry import occluders

pytestmark = pytest.mark.gl

CULLERS = [
    NoCulling,
    FrustumCulling,
    SingleQueryCulling,
    lambda: SingleQueryCulling(query="batch", size=7),
    lambda: SingleQueryCulling(query="instanced", size=5, backfaces=True),
    lambda: SingleQueryCulling(query="instanced", depth=32),
]


def missed(culler, scene, cameras):
    """Objects of GL's own unculled image that were not drawn, summed over the cameras."""
    culler.prepare(scene)
    count = drawn = 0
    for camera in cameras:
        result = culler.cull(camera)
        ids = culler.raster.item_buffer(camera)
        visible = np.unique(scene.object_of_triangle[np.unique(ids[ids >= 0])])
        count += len(np.setdiff1d(visible, result.unit_ids))
        drawn += len(result.unit_ids)
    culler.close()
    return count, drawn


@pytest.mark.slow
@pytest.mark.parametrize("make", CULLERS)
def test_every_visible_object_is_drawn(make):
    for seed in range(12):
        rng = np.random.default_rng(seed)
        scene = random_scene(rng)
        sizes = [(1, 1), (1, 64), (33, 17), (64, 48)]
        cameras = [random_camera(rng, *sizes[seed % 4]) for _ in range(3)]
        assert missed(make(), scene, cameras)[0] == 0


def walls_and_boxes(seed=0, count=60):
    """A wall with boxes before, behind and beside it."""
    rng = np.random.default_rng(seed)
    boxes = [
        (
            f"b{i}",
            *box(tuple(rng.uniform(-4, 4, 3) * (1, 1, 0.9) - (0, 0, 6)), rng.uniform(0.05, 0.4)),
        )
        for i in range(count)
    ]
    return Scene.from_objects([("wall", *quad((-3, -3), (3, 3), -5.0)), *boxes])


def test_occlusion_queries_leave_hidden_objects_out():
    scene = walls_and_boxes()
    drawn = {}
    for make in (NoCulling, FrustumCulling, SingleQueryCulling):
        count, drawn[make.name] = missed(make(), scene, [perspective(64, 64)])
        assert count == 0
    assert drawn["none"] == scene.object_count
    assert drawn["frustum"] < drawn["none"]
    assert drawn["occlusion-query"] < 0.8 * drawn["frustum"]


def test_drawn_set_makes_the_unculled_image():
    scene = walls_and_boxes(1)
    culler = SingleQueryCulling()
    units = culler.prepare(scene)
    camera = perspective(64, 48)
    drawn = units.mask(culler.cull(camera).unit_ids, scene.triangle_count)
    assert not drawn.all()
    whole = culler.raster.image(camera, np.ones(scene.triangle_count, bool))
    assert np.array_equal(culler.raster.image(camera, drawn), whole)
    culler.close()


class IgnoresTheEye(SingleQueryCulling):
    def needs_no_query(self, view, boxes):
        return np.zeros(len(boxes), bool)


class WantsManySamples(SingleQueryCulling):
    def passes(self, samples):
        return samples > 3


class WritesDepthInQueries(SingleQueryCulling):
    def query_state(self, state):
        return state._replace(depth_write=True)


class NeverClears(SingleQueryCulling):
    def clear(self, target, stats):
        pass


class OccludesByGlass(SingleQueryCulling):
    def occluders(self, scene):
        return np.ones(scene.triangle_count, bool)


class SmallBoxes(SingleQueryCulling):
    def unit_bounds(self, scene, units):
        bounds = super().unit_bounds(scene, units)
        centre = bounds.mean(axis=1, keepdims=True)
        return centre + 0.3 * (bounds - centre)


class UsesAnotherCamera(SingleQueryCulling):
    def view_of(self, camera):
        pose = camera.world_from_camera.copy()
        pose[:3, 3] += (0.5, 0.0, 0.0)
        return super().view_of(Camera(pose, camera.width, camera.height, 0.1, yfov=camera.yfov))


@pytest.mark.parametrize(
    "mutant",
    [
        IgnoresTheEye,
        WantsManySamples,
        WritesDepthInQueries,
        NeverClears,
        OccludesByGlass,
        SmallBoxes,
        UsesAnotherCamera,
    ],
)
def test_no_safety_step_can_be_broken_unseen(mutant):
    plain = walls_and_boxes(2, 100)
    glass = ("glass", *quad((-9, -9), (9, 9), -3.0))
    room = ("room", *box((0, 0, 0), 40.0))
    scene = Scene.from_objects(
        [
            (
                plain.names[i],
                plain.vertices[plain.triangles[a:b]].reshape(-1, 3),
                np.arange(3 * (b - a)).reshape(-1, 3),
            )
            for i, (a, b) in enumerate(
                zip(plain.object_offsets, plain.object_offsets[1:], strict=False)
            )
        ]
        + [glass, room]
    )
    alpha = np.zeros(scene.triangle_count, np.uint8)
    alpha[scene.object_of_triangle == plain.object_count] = Alpha.BLEND
    scene = Scene(scene.vertices, scene.triangles, scene.object_offsets, scene.names, alpha=alpha)
    cameras = [perspective(40, 40)]
    turned = np.eye(4)
    turned[:3, :3] = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]
    turned[:3, 3] = (8, 0, -5)
    cameras.append(Camera(turned, 40, 40, 0.1, yfov=1.2))
    assert missed(SingleQueryCulling(), scene, cameras)[0] == 0
    assert missed(mutant(), scene, cameras)[0] > 0
    assert occluders(scene).sum() == scene.triangle_count - 2


def test_objects_without_triangles_and_empty_scenes_work():
    empty = ("empty", np.zeros((0, 3)), np.zeros((0, 3), int))
    for objects, expected in (
        ([], []),
        ([empty], []),
        ([empty, ("b", *box((0, 0, -5), 1.0)), ("e2", *empty[1:])], [1]),
    ):
        for make in CULLERS:
            culler = make()
            culler.prepare(Scene.from_objects(objects))
            assert culler.cull(perspective(8, 8)).unit_ids.tolist() == expected
            culler.close()


def test_each_unit_is_drawn_once_front_to_back():
    scene = walls_and_boxes(3)
    culler = FrustumCulling()
    culler.prepare(scene)
    ids = culler.cull(ortho(16, 12)).unit_ids
    depth = -scene.object_bounds[ids, 1, 2]
    assert (np.diff(depth) > -1e-3).all()
    assert len(set(ids)) == len(ids)
    culler.close()


def test_a_frame_does_not_hang_on_the_frames_before_it():
    scene = walls_and_boxes(4)
    cameras = [perspective(40, 30), ortho(16, 12), perspective(9, 40)]
    culler = SingleQueryCulling(fragments=True)
    culler.prepare(scene)
    first = [culler.cull(camera) for camera in cameras]
    again = [culler.cull(camera) for camera in reversed(cameras)][::-1]
    for a, b in zip(first, again, strict=True):
        assert a.unit_ids.tolist() == b.unit_ids.tolist()
        keep = {"state_changes"}  # the first frame starts from whatever was set before
        counts = [{k: v for k, v in r.stats.counts().items() if k not in keep} for r in (a, b)]
        assert counts[0] == counts[1]
    culler.close()


def test_costs_are_those_of_the_frame():
    scene = Scene.from_objects(
        [
            ("wall", *quad((-2, -2), (2, 2), -5.0)),
            ("behind", *box((0, 0, -8), 1.0)),
            ("beside", *box((4, 0, -8), 1.0)),
        ]
    )
    culler = SingleQueryCulling(fragments=True)
    culler.prepare(scene)
    stats = culler.cull(ortho(16, 12)).stats
    assert stats.queries == stats.batches == 3
    assert stats.queries_passed == stats.units_drawn == stats.draw_calls == 2
    assert stats.triangles_drawn == 2 + 12
    assert stats.query_fragments == 16 + 4 + 4
    assert stats.query_fragments_passed == 16 + 4
    assert stats.depth_tests == 16 + 2 * 4 + stats.query_fragments
    assert set(stats.ms) == {"sort", "query", "draw", "frame"}
    culler.close()
    plain = SingleQueryCulling()
    plain.prepare(scene)
    assert plain.cull(ortho(16, 12)).stats.query_fragments is None
    plain.close()


def test_boxes_asked_together_must_be_one_or_more():
    with pytest.raises(InputError, match="size is 0"):
        SingleQueryCulling(query="batch", size=0)
