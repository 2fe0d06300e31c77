"""Cullers in scenes that move: what they keep is this frame's, and nothing more is drawn for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from visref.camera import look_at
from visref.camera_path import CameraPath, Frame
from visref.conformance import case
from visref.conformance.moving import MOVING, about, moved, posed
from visref.conformance.scenes import box, camera, panel
from visref.registry import make_culler
from visref.scene import Scene
from visref.timeline import Timeline
from visref_culling.gl import changes
from visref_culling.gl.changes import Changes, taken, write_rows
from visref_culling.gl.device import device
from visref_culling.n_buffer import NBufferCulling
from visref_culling.three_pass.stand_ins import StandIns

pytestmark = pytest.mark.gl

WITHOUT_MEMORY = [
    "none",
    "frustum",
    "frustum:views=union",
    "occlusion-query",
    "occlusion-query:query=instanced,size=4",
    "occupancy-map",
    "occupancy-map:maps=1,parts=3",
    "lazy-grid",
    "lazy-grid:buffer=z",
    "lazy-grid:query=software",
    "lazy-grid:query=gl",
    "three-pass",
    "three-pass:mode=conservative",
]
NAMES = [made.name for made in MOVING]


def frames_of(name: str):
    """Each frame's scene and cameras."""
    scene, path = case(name)
    timeline = Timeline(scene, path)
    return [(timeline.at(k), path.views(k)) for k in range(len(path))]


def drawn_by(culler, cameras) -> list[list[int]]:
    return [culler.cull(camera).unit_ids.tolist() for camera in cameras]


@pytest.mark.parametrize("spec", WITHOUT_MEMORY)
def test_culler_that_is_updated_draws_what_one_prepared_afresh_draws(spec):
    for name in NAMES:
        culler = make_culler(spec)
        for number, (scene, cameras) in enumerate(frames_of(name)):
            culler.update(scene) if number else culler.prepare(scene)
            fresh = make_culler(spec)
            fresh.prepare(scene)
            assert drawn_by(culler, cameras) == drawn_by(fresh, cameras), (name, number)
            assert np.array_equal(culler.bounds(), fresh.bounds())
            fresh.close()
        culler.close()


@pytest.mark.parametrize("spec", ["n-buffer", "n-buffer:where=gpu", "n-buffer:hierarchy=true"])
def test_n_buffer_that_is_updated_settles_on_what_one_prepared_afresh_settles_on(spec):
    for name in NAMES:
        culler = make_culler(spec)
        for number, (scene, cameras) in enumerate(frames_of(name)):
            culler.update(scene) if number else culler.prepare(scene)
            fresh = make_culler(spec)
            fresh.prepare(scene)
            # What it has seen hides the rest from the second answer on, its own seen from the third
            # on, and nothing depends any more on what came before: the most visible set.
            for _ in range(4):
                drawn_by(culler, cameras), drawn_by(fresh, cameras)
            both = zip(drawn_by(culler, cameras), drawn_by(fresh, cameras), strict=True)
            assert all(set(one) == set(other) for one, other in both), (name, number)
            fresh.close()
        culler.close()


@pytest.mark.parametrize("spec", ["n-buffer", "n-buffer:where=gpu"])
def test_each_view_hides_things_behind_what_it_saw_itself(spec):
    """Beside the other view's, the very same sequence of answers is its own alone."""
    frames = frames_of("two_views")
    views = [camera.view for camera in frames[0][1]]
    together = make_culler(spec)
    alone = {view: make_culler(spec) for view in views}
    for number, (scene, cameras) in enumerate(frames):
        for culler in (together, *alone.values()):
            culler.update(scene) if number else culler.prepare(scene)
        for camera_ in cameras:
            assert drawn_by(together, [camera_]) == drawn_by(alone[camera_.view], [camera_])
    for culler in (together, *alone.values()):
        culler.close()


class EverythingAgain(NBufferCulling):
    """What was seen is forgotten whenever something moves."""

    def follow(self, changes):
        super().follow(changes)
        self.seen_of_view.clear()


def test_forgetting_what_was_seen_when_something_moves_draws_more():
    """M7: so the sound method, which does not, saves something by that."""
    drawn = {}
    for kind in (NBufferCulling, EverythingAgain):
        culler, drawn[kind] = kind(), 0
        for number, (scene, cameras) in enumerate(frames_of("two_views")):
            culler.update(scene) if number else culler.prepare(scene)
            drawn[kind] += sum(map(len, drawn_by(culler, cameras)))
        culler.close()
    assert drawn[EverythingAgain] > 1.2 * drawn[NBufferCulling]


@pytest.mark.parametrize("spec", [*WITHOUT_MEMORY, "n-buffer", "n-buffer:where=gpu"])
def test_nothing_is_drawn_or_boxed_of_what_is_absent(spec):
    objects = [(f"box {k}", box((k, -1.0, -9.0 - k), (k + 0.8, 1.0, -8.0 - k))) for k in range(5)]
    names = [name for name, _ in objects]
    gone = [(), ("box 0", "box 3"), tuple(names), (), tuple(names)]
    built = posed(objects, [Frame((camera(),), absent=names) for names in gone])
    timeline = Timeline(built.scene, built.path)
    for first in (0, 2):
        culler = make_culler(spec)
        culler.prepare(timeline.at(first))
        for number in range(first, len(gone)):
            if number > first:
                culler.update(timeline.at(number))
            (drawn,) = drawn_by(culler, built.path.views(number))
            assert not {names[unit] for unit in drawn} & set(gone[number])
            bounds = culler.bounds()
            for unit, name in enumerate(names):
                assert (bounds[unit, 0] > bounds[unit, 1]).all() == (name in gone[number])
        culler.close()


def test_bounds_are_those_of_the_frame():
    objects = [
        ("still", panel((-1.0, 1.0), (-1.0, 1.0), -5.0)),
        ("moved", box((0, 0, -4), (1, 1, -3))),
    ]
    frames = [Frame((camera(),), world_from_object={"moved": moved(x=float(k))}) for k in range(3)]
    built = posed(objects, frames)
    timeline = Timeline(built.scene, built.path)
    culler = make_culler("occlusion-query")
    culler.prepare(timeline.at(0))
    for k in (1, 2):
        culler.update(timeline.at(k))
        assert np.array_equal(culler.bounds()[1], [[k, 0, -4], [k + 1, 1, -3]])
        assert np.array_equal(culler.bounds()[0], [[-1, -1, -5], [1, 1, -5]])
    culler.close()


@pytest.mark.parametrize("spec", ["plp", "cplp"])
def test_octree_of_cells_says_that_it_stands_still(spec):
    culler = make_culler(spec)
    assert not culler.moves
    culler.close()


@pytest.mark.parametrize("spec", ["frustum", "occlusion-query"])
def test_union_of_views_draws_what_any_of_them_needs_once(spec):
    joined = make_culler(f"{spec}:views=union")
    apart = make_culler(spec)
    assert joined.joint
    assert not apart.joint
    for scene, cameras in frames_of("two_views_of_a_changing_city")[:2]:
        joined.prepare(scene), apart.prepare(scene)
        answers = [apart.cull(one) for one in cameras]
        answer = joined.cull_joint(cameras)
        wanted = [set(one.unit_ids.tolist()) for one in answers]
        assert not wanted[0] <= wanted[1]
        assert len(answer.unit_ids) == len(set(answer.unit_ids.tolist()))
        assert set(answer.unit_ids.tolist()) == wanted[0] | wanted[1]
        counted = sum(one.stats.units_drawn for one in answers)
        assert answer.stats.units_drawn == counted
        one = joined.cull_joint(cameras[:1])
        assert one.unit_ids.tolist() == answers[0].unit_ids.tolist()
    joined.close(), apart.close()


# How changes get to the GPU.


def scenes_of(rows: int) -> tuple[Scene, Scene]:
    rng = np.random.default_rng(5)
    points = rng.uniform(-1.0, 1.0, (3 * rows, 3)).astype(np.float32)
    faces = np.arange(3 * rows).reshape(-1, 3)
    before = Scene.from_objects([("all", points, faces)])
    moved_points = points.copy()
    moved_points[[0, 4, 3 * rows - 1]] += 1.0
    triangles = before.triangles.copy()
    triangles[7] = triangles[7, 0]
    return before, replace(before, vertices=moved_points, triangles=triangles)


def test_changes_are_those_vertices_and_triangles_that_differ():
    before, now = scenes_of(2000)
    found = Changes.between(before, now)
    assert np.flatnonzero(found.vertices).tolist() == [0, 4, 5999]
    assert np.flatnonzero(found.indices).tolist() == [7]
    assert np.flatnonzero(found.triangles).tolist() == [0, 1, 7, 1999]
    units = replace(before.object_units(), offsets=np.array([0, 2, 2, 9, 1000, 2000]))
    assert found.units(units).tolist() == [0, 2, 4]
    assert taken(units, np.array([2, 0])).triangles.tolist() == [*range(2, 9), 0, 1]
    nothing = Changes.between(before, before)
    assert not nothing.triangles.any()
    assert not len(nothing.units(units))


@pytest.mark.parametrize("rows", [1, 1023, 1024, 1025, 5000])
def test_buffer_holds_this_moment_s_rows_whatever_the_number_of_blocks(rows):
    rng = np.random.default_rng(rows)
    before, now = rng.normal(size=(2, rows, 3)).astype(np.float32)
    changed = rng.random(rows) < 3.0 / rows
    buffer = device().context.buffer(before.tobytes())
    sent = []

    def part(first: int, end: int):
        sent.append((first, end))
        return now[first:end]

    write_rows(buffer, changed, part)
    held = np.frombuffer(buffer.read(), np.float32).reshape(-1, 3)
    assert np.array_equal(held[changed], now[changed])
    whole = np.zeros(rows, np.bool_)
    for first, end in sent:
        whole[first:end] = True
    assert np.array_equal(held, np.where(whole[:, None], now, before))
    assert whole.sum() <= changed.sum() * changes.BLOCK_ROWS
    buffer.release()


def ball(count: int) -> tuple[np.ndarray, np.ndarray]:
    """A sphere of count x count points."""
    u, v = np.meshgrid(np.linspace(0.1, 3.0, count), np.linspace(0.0, 6.0, count), indexing="ij")
    points = np.stack([np.sin(u) * np.cos(v), np.cos(u), np.sin(u) * np.sin(v)], axis=-1)
    at = np.arange(count * count).reshape(count, count)
    a, b, c, d = at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]
    faces = np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).reshape(-1, 3)
    return points.reshape(-1, 3), faces


def test_stand_in_moves_with_what_moves_as_one_and_is_made_anew_of_what_is_deformed():
    points, faces = ball(24)
    scene = Scene.from_objects([("ball", points, faces)])
    made = StandIns(scene, reduction=10, extra=100)
    at_rest = made.of_object[0].points
    matrix = moved(3.0, -2.0, 50.0) @ about((0.0, 1.0, 0.0), 0.7, axis=1)
    matrix[:3, :3] *= 1.5

    def placed(of):
        return of @ matrix[:3, :3].T + matrix[:3, 3]

    there = replace(scene, vertices=placed(scene.vertices.astype(float)).astype(np.float32))
    made.update(there, np.array([0]))
    assert made.simplifications == 1
    # Vertices are rounded by 2**-24 of some 53; the fit by as much again.
    assert np.abs(made.of_object[0].points - placed(at_rest)).max() < 53.0 * 2.0**-22
    bent = scene.vertices.copy()
    bent[:, 0] += 0.3 * bent[:, 1] ** 2
    made.update(replace(scene, vertices=bent), np.array([0]))
    assert made.simplifications == 2
    low, high = made.of_object[0].points.min(axis=0), made.of_object[0].points.max(axis=0)
    assert (np.abs(low - bent.min(axis=0)) < 0.3).all()
    assert (np.abs(high - bent.max(axis=0)) < 0.3).all()


def test_what_stands_in_for_itself_is_the_object_to_the_bit():
    points, faces = ball(5)
    scene = Scene.from_objects([("ball", points, faces)])
    made = StandIns(scene, reduction=10, extra=100)
    turned = points @ about((0.0, 0.0, 0.0), 0.7, axis=0)[:3, :3].T
    there = replace(scene, vertices=turned.astype(np.float32))
    made.update(there, np.array([0]))
    low = made.scene(there)
    assert np.array_equal(low.vertices[low.triangles], there.vertices[there.triangles])
    assert made.simplifications == 0


# A clip plane along the image is a near plane.


@pytest.mark.parametrize(
    "spec",
    ["frustum", "occlusion-query", "occupancy-map", "lazy-grid:query=software", "n-buffer"],
)
def test_what_a_plane_along_the_image_cuts_off_wholly_is_not_drawn(spec):
    scene, path = case("cut_by_a_plane")
    view = replace(path.cameras[0], world_from_camera=look_at((0, 0, 0), (0, 0, -1)))
    culler = make_culler(spec)
    culler.prepare(scene)
    cut = set(drawn_by(culler, [replace(view, clip_plane=(0.0, 0.0, -1.0, -6.0))])[0])
    near = set(drawn_by(culler, [replace(view, clip_plane=None, near=6.0)])[0])
    whole = set(drawn_by(culler, [replace(view, clip_plane=None)])[0])
    blind = scene.id_of_name["blind"]
    assert blind in whole - cut
    # A box across the near plane is drawn without asking, one across a clip plane is asked. But in
    # the software buffer nothing hides that the plane cuts.
    assert cut <= near or "software" in spec
    assert scene.id_of_name["cut off"] not in cut
    culler.close()


@pytest.mark.parametrize("spec", ["occlusion-query", "three-pass:mode=conservative"])
def test_view_after_one_with_a_clip_plane_is_not_cut(spec):
    # Of one pixel, so that everything is drawn by the same few calls.
    objects = [
        ("floor", panel((-1.0, 3.0), (-4.0, 0.0), -2.5)),
        ("beam", box((-3.0, -2.5, 0.0), (1.0, -1.5, 2.5))),
    ]
    pose = look_at((-1.0, 3.5, -2.0), (-1.0, -2.0, 1.25))
    plain = camera(width=1, height=1)
    plain = replace(plain, world_from_camera=pose, near=0.125)
    scene = posed(objects, [Frame((plain,))]).scene
    culler = make_culler(spec)
    culler.prepare(scene)
    (before,) = drawn_by(culler, [plain])
    drawn_by(culler, [replace(plain, clip_plane=(-1.0, 1.0, -1.0, -3.0))])
    assert drawn_by(culler, [plain]) == [before] != [[]]
    culler.close()


def test_clip_plane_scaled_by_anything_is_the_same_plane():
    scene, path = case("cut_by_a_plane")
    culler = make_culler("occlusion-query")
    culler.prepare(scene)
    view = path.cameras[1]
    for factor in (1e-30, 3.0, 1e30):
        plane = tuple(factor * value for value in view.clip_plane)
        assert drawn_by(culler, [replace(view, clip_plane=plane)]) == drawn_by(culler, [view])
    culler.close()


def test_path_of_moving_scenes_survives_being_written():
    """Or a stranger could not look at a failing check's scene."""
    for name in NAMES:
        _, path = case(name)
        assert CameraPath.from_json(path.to_json()).to_json() == path.to_json()
