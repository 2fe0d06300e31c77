"""Occlusion queries of boxes: right answers, no traces, true counts."""

import numpy as np
import pytest

from tests.support.culling_scenes import ortho, perspective, quad
from visref.camera import Camera
from visref.culler import QueryStats
from visref.scene import Scene
from visref_culling.boxes.conservative import inflated, round_outward
from visref_culling.gl.device import State, device
from visref_culling.gl.geometry import Geometry, occluders
from visref_culling.gl.view import View
from visref_culling.queries.occlusion_query import BoxQueries

pytestmark = pytest.mark.gl
WAYS = ("sync", "batch", "instanced", "counted")


class Stage:
    """A drawn scene to ask about."""

    def __init__(self, camera, *objects):
        self.scene = Scene.from_objects(list(objects))
        self.view = View.of(camera, self.scene, device().subpixel_bits)
        self.target = device().target(camera.width, camera.height)
        units = self.scene.object_units()
        geometry = Geometry(device(), self.scene, units, occluders(self.scene))
        device().clear(State(self.target.framebuffer, geometry.program))
        geometry.draw(self.view, self.target, np.arange(units.count), QueryStats())
        geometry.release()
        self.queries = BoxQueries(device())

    def boxes(self, *bounds):
        return round_outward(inflated(self.view, np.array(bounds, float)))

    def ask(self, *bounds, way="batch", cull=True, stats=None, **more):
        boxes = self.boxes(*bounds)
        stats = QueryStats() if stats is None else stats
        return self.queries.ask(
            self.view, self.target, boxes, stats, way=way, cull_back_faces=cull, **more
        )


WALL = ("wall", *quad((-2, -2), (2, 2), -5.0))
BEFORE, BEHIND = ((-1, -1, -4), (1, 1, -3)), ((-1, -1, -8), (1, 1, -7))
PEEKING, BESIDE = ((1, 1, -8), (3, 2, -7)), ((3, 3, -8), (4, 4, -7))


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("cull", [True, False])
def test_box_shows_exactly_where_it_is_not_behind_the_wall(way, cull):
    stage = Stage(ortho(16, 12), WALL)
    samples = stage.ask(BEFORE, BEHIND, PEEKING, BESIDE, way=way, cull=cull)
    # In whole pixels; with back faces the sides facing away are counted as well.
    assert (samples > 0).tolist() == [True, False, True, True]
    if cull:
        assert samples.tolist() == ([1, 0, 1, 1] if way == "instanced" else [4, 0, 1, 1])


@pytest.mark.parametrize("seed", range(3))
def test_ways_give_one_answer(seed):
    rng = np.random.default_rng(seed)
    stage = Stage(perspective(64, 48), WALL, ("w2", *quad((-5, 0), (0, 9), -7.0)))
    centres = rng.uniform(-1, 1, (40, 3)) * 5 - (0, 0, 9)
    half = rng.uniform(0.05, 1.5, (40, 3))
    bounds = list(np.stack([centres - half, centres + half], axis=1))
    answers = {way: stage.ask(*bounds, way=way) for way in WAYS}
    samples = answers["sync"]
    assert samples.min() == 0 < samples.max()
    assert samples.tolist() == answers["batch"].tolist() == answers["counted"].tolist()
    assert (samples > 0).tolist() == answers["instanced"].tolist()


@pytest.mark.parametrize("way", WAYS)
def test_query_leaves_depth_and_image_as_they_were(way):
    stage = Stage(perspective(32, 24), WALL)
    depth = stage.target.read_depth().copy()
    image = stage.target.framebuffer.read(components=1)
    assert stage.ask(BEFORE, way=way)[0] > 0
    assert np.array_equal(stage.target.read_depth(), depth)
    assert stage.target.framebuffer.read(components=1) == image


def test_query_with_depth_writes_left_on_does_leave_a_trace():
    """The test above can fail."""
    stage = Stage(perspective(32, 24), WALL)
    depth = stage.target.read_depth().copy()
    stage.ask(BEFORE, state_hook=lambda state: state._replace(depth_write=True))
    assert not np.array_equal(stage.target.read_depth(), depth)


@pytest.mark.parametrize("angle", np.linspace(0.0, 1.5, 7))
@pytest.mark.parametrize("offset", [0.0, 1e6])
def test_box_of_what_is_drawn_always_shows(angle, offset):
    """Its own geometry is in the depth buffer, exactly on the box, seen up to grazing."""
    vertices, faces = quad((-1, -1), (1, 1), 0.0)
    turn = np.array(
        [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    )
    pose = np.eye(4)
    pose[:3, :3] = turn
    pose[:3, 3] = offset + turn[:, 2] * 5.0
    camera = Camera(pose, 64, 48, 0.1, 100.0, yfov=0.6)
    stage = Stage(camera, ("flat", vertices + offset, faces))
    bounds = stage.scene.object_bounds[0]
    assert stage.ask(bounds)[0] > 0


def test_bare_box_can_vanish_behind_its_own_geometry_and_the_inflated_one_does_not():
    """A flat tile lies exactly in its box; seen at random angles rounding decides."""
    lost = seen = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        axes, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        axes[:, 0] *= np.sign(np.linalg.det(axes))
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = axes, axes[:, 2] * 3.0 + rng.uniform(-1, 1, 3)
        side = rng.uniform(0.05, 0.4)
        tile = np.array([(0, 0, 0), (side, 0, 0), (side, 0, side), (0, 0, side)])
        camera = Camera(pose, 64, 48, 0.1, 100.0, yfov=1.2)
        stage = Stage(camera, ("tile", tile, [(0, 1, 3), (1, 2, 3)]))
        if (stage.target.read_depth() == 1.0).all():
            continue
        seen += 1
        assert stage.ask(stage.scene.object_bounds[0])[0] > 0
        bare = (stage.scene.object_bounds - camera.eye).astype(np.float32)
        stage.view.__dict__["depth_shift_ndc"] = 0.0
        lost += (
            stage.queries.ask(
                stage.view, stage.target, bare, QueryStats(), way="batch", cull_back_faces=True
            )[0]
            == 0
        )
    assert 0 < lost < seen


def test_box_reaching_across_the_far_plane_is_asked_whole():
    stage = Stage(ortho(16, 12, far=10.0))
    for way in WAYS:
        samples = stage.ask(((-1, -1, -20), (1, 1, -9)), way=way)[0]
        assert samples == (1 if way == "instanced" else 4)


def test_fragments_are_the_pixels_of_the_faces_whatever_hides_them():
    stage = Stage(ortho(16, 12), WALL)
    boxes = stage.boxes(BEHIND, BESIDE, ((-2, -1, -8), (1, 1, -7)))
    front = stage.queries.fragments(stage.view, stage.target, boxes, cull_back_faces=True)
    both = stage.queries.fragments(stage.view, stage.target, boxes, cull_back_faces=False)
    assert front.tolist() == [4, 1, 6]
    assert both.tolist() == [8, 2, 12]


def test_costs_are_counted_by_the_query():
    stage = Stage(ortho(16, 12), WALL)
    for way, batches, read in (("sync", 3, None), ("batch", 1, None), ("instanced", 1, 12)):
        stats = QueryStats()
        stage.ask(BEFORE, BEHIND, BESIDE, way=way, stats=stats)
        assert (stats.queries, stats.queries_passed, stats.batches) == (3, 2, batches)
        assert stats.bytes_read_back == read
        assert stats.state_changes is not None
    stats = QueryStats()
    stage.queries.ask(
        stage.view,
        stage.target,
        np.zeros((0, 2, 3), np.float32),
        stats,
        way="batch",
        cull_back_faces=True,
    )
    assert stats.queries is None
