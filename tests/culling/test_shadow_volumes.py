"""Shadow volumes: ray-cast truth, silhouettes, litmaps, and clamping in the paper's five cases."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.support.effect_scenes import (
    Stage,
    camera_at,
    grazed,
    ground,
    pedestals,
    scene_with,
    shadow_verdict,
    stage,
)
from visref.camera import Camera, look_at
from visref.camera_path import CameraPath
from visref.culler import RasterTolerance
from visref.effects.light import Light, sun
from visref.effects.shadow_truth import ShadowTruth, sample_points
from visref.effects.solid import solid
from visref.errors import InputError
from visref.scene import Alpha
from visref_culling.shadow_volumes import ShadowVolumes
from visref_culling.shadow_volumes.casters import casters_of
from visref_culling.shadow_volumes.closed import bounds_a_solid
from visref_culling.shadow_volumes.volumes import endless
from visref_datasets_gen import scene_of
from visref_datasets_gen.shapes import box, icosphere, lathe, loft, merge
from visref_datasets_gen.terrain_towers import terrain_towers
from visref_experiments.shadow_volumes import measure

TOLERANCE = RasterTolerance(snap_px=0.01, depth_bits=24)
BOARD = box((-1.0, 2.0, -1.0), (1.0, 2.4, 1.0))
DOWN = (0.0, -1.0, 0.0)


def caster_index(made: Stage, name: str) -> int:
    return made.scene.id_of_name[name]


def distance(light: Light, point) -> float:
    return float(light.camera.pixel_of(np.array([point], float))[1][0])


def spot(scene, at=(1.0, 7.0, 2.0)) -> Light:
    return Light(Camera(look_at(at, (0.0, 0.0, 0.0)), 48, 48, near=0.5, far=40.0, yfov=1.6))


# The truth.


def test_shadow_of_a_board_under_the_sun_is_the_board_moved_down():
    scene = scene_with(ground=ground(), board=BOARD)
    rays = ShadowTruth(scene, sun(DOWN, scene, 32))
    camera = camera_at((0.3, 6.0, 9.0), (0.0, 0.0, 0.0))
    truth = rays.engine.frame(camera)
    image = rays.image(truth).reshape(-1)
    seen = np.flatnonzero(truth.buffer.triangle.reshape(-1) >= 0)
    point = sample_points(camera, seen, truth.buffer.depth.reshape(-1)[seen])
    on_ground = point[:, 1] < 1e-6
    inside = (np.abs(point[:, [0, 2]]) < 1.0).all(axis=1)
    assert np.array_equal(image[seen[on_ground]] > 0, inside[on_ground])
    # The board's top is lit.
    assert not image[seen[point[:, 1] > 2.4 - 1e-6]].any()
    rays.close()


def test_sheet_seen_from_its_dark_side_is_in_shadow_and_from_the_other_lit():
    sheet = (
        np.array([(-2, 2, -2), (-2, 2, 2), (2, 2, 2), (2, 2, -2)], float),
        [[0, 1, 2], [0, 2, 3]],
    )
    scene = scene_with(sheet=sheet)
    rays = ShadowTruth(scene, sun((0.1, -1.0, 0.1), scene, 8))
    for height, shadow in ((5.0, 0), (-1.0, 1)):
        camera = camera_at((0.2, height, 4.0), (0.0, 2.0, 0.0))
        truth = rays.engine.frame(camera)
        seen = truth.buffer.triangle >= 0
        assert seen.any()
        assert (rays.image(truth)[seen] == shadow).all()


@pytest.mark.slow
def test_bounds_are_narrow_but_next_to_a_shadows_edge():
    scene = scene_with(ground=ground(cells=4), board=BOARD)
    rays = ShadowTruth(scene, sun((0.2, -1.0, 0.1), scene, 32))
    camera = camera_at((0.3, 6.0, 9.0), (0.0, 0.0, 0.0), near=1.0)
    truth = rays.engine.frame(camera)
    image = rays.image(truth).reshape(-1)
    bounds = rays.bounds(camera, np.arange(camera.samples), TOLERANCE)
    assert (bounds.least <= image).all()
    assert (image <= bounds.most).all()
    # Sure nearly everywhere: what is open is about shadows' and triangles' edges.
    assert 0 < np.count_nonzero(bounds.least != bounds.most) < 0.02 * camera.samples


def test_the_sun_holds_all_of_the_scene_and_a_spot_light_its_cone():
    made = pedestals(1)
    truth = ShadowTruth(made.scene, made.light).engine.frame(made.cameras[0])
    seen = truth.buffer.triangle >= 0
    for light, share in ((made.light, 1.0), (spot(made.scene), 0.9)):
        held = ShadowTruth(made.scene, light).lit_domain(truth, TOLERANCE)
        assert not held[~seen].any()
        assert (held.sum() == seen.sum()) == (share == 1.0)
        assert held.sum() > 0.1 * seen.sum()


def test_effects_stand_on_opaque_triangles_seen_from_both_sides():
    scene = scene_with(a=BOARD, b=BOARD, c=BOARD)
    alpha = np.repeat([Alpha.BLEND, Alpha.OPAQUE, Alpha.MASK], 12).astype(np.uint8)
    left = solid(replace(scene, alpha=alpha, one_sided=np.ones(36, np.bool_)))
    assert np.diff(left.object_offsets).tolist() == [0, 12, 0]
    assert left.names == scene.names
    assert not left.one_sided.any()


# Silhouettes.


def directed_edges(faces):
    """Net uses of each directed edge by vertex index."""
    net: dict[tuple[int, int], int] = {}
    for triangle in faces.tolist():
        for i, j in zip(triangle, triangle[1:] + triangle[:1], strict=True):
            net[i, j] = net.get((i, j), 0) + 1
            net[j, i] = net.get((j, i), 0) - 1
    return net


@pytest.mark.parametrize("seed", [1, 2])
def test_volumes_of_any_soup_are_closed(seed):
    made = pedestals(seed)
    casters = casters_of(made.scene, made.light)
    for index in range(casters.count):
        parts = [
            part.indices[part.offsets[index] : part.offsets[index + 1]]
            for part in (casters.caps_front, casters.caps_back, casters.body)
        ]
        parts[1] = parts[1][:, ::-1]  # turned towards the light
        assert not any(directed_edges(np.concatenate(parts)).values())


def dark_caps_and_sides(board):
    """Of a board above the ground under a slanted sun: triangles of its dark cap and its sides."""
    scene = scene_with(ground=ground(cells=1), board=board)
    casters = casters_of(scene, sun((0.3, -1.0, 0.2), scene, 8))
    body = casters.body.indices[casters.body.offsets[1] :]
    dark_caps = (body >= len(casters.caster)).all(axis=1)
    assert len(casters.caster) == 4 + 8
    return dark_caps.sum(), (~dark_caps).sum()


def test_silhouette_of_a_solid_box_under_a_slanted_sun_is_a_hexagon():
    # Three lit faces of two triangles each, and six edges between them and the unlit ones.
    assert dark_caps_and_sides(BOARD) == (6, 6 * 2)


def test_silhouette_of_a_box_inside_out_is_that_hexagon_twice():
    # Lit and unlit faces both cast, so each of the six edges between them keeps two sides.
    assert dark_caps_and_sides((BOARD[0], BOARD[1][:, ::-1])) == (12, 6 * 2 * 2)


def solid_of(soup):
    """(t,) bool, which of a soup's triangles bound a solid."""
    points, index = np.unique(np.asarray(soup[0], np.float32), axis=0, return_inverse=True)
    return bounds_a_solid(points, index.reshape(-1)[np.asarray(soup[1])].astype(np.int32))


def reversed_(soup):
    return soup[0], np.asarray(soup[1])[:, ::-1]


UNIT = box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
# A prism over a quadrilateral that crosses itself: closed, and of its two lobes the larger faces
# outward.
CROSSING = loft([[(-3, y, 3), (1, y, -1), (1, y, 1), (-3, y, -1)] for y in (0.0, 1.0)])
SOLIDS = {
    "box": UNIT,
    "beside": merge([UNIT, box((2.0, 0.0, 0.0), (3.0, 1.0, 1.0))]),
    # Each of them is left after it is entered, whatever the other does.
    "through": merge([UNIT, box((0.5, 0.5, 0.5), (3.0, 2.0, 2.0))]),
    "sphere": icosphere(2),
    "lathe": lathe([(1.2, 0.0), (0.7, 1.0), (0.9, 3.0), (0.02, 4.0)], 24),
    "tilted": (UNIT[0] @ [[0.8, 0.6, 0], [-0.48, 0.64, 0.6], [0.36, -0.48, 0.8]], UNIT[1]),
    "bent": loft(
        [[(0, y, 0), (3, y, 0), (3, y, 1), (1, y, 1), (1, y, 3), (0, y, 3)] for y in (1.0, 0.0)],
        caps="",
    ),
}
NO_SOLIDS = {
    "open": box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), "xXYzZ"),
    "inside out": reversed_(UNIT),
    "one face turned": (UNIT[0], np.concatenate([UNIT[1][:-1], UNIT[1][-1:, ::-1]])),
    "one face twice": (UNIT[0], np.concatenate([UNIT[1], UNIT[1][:1]])),
    "crossing itself": CROSSING,
    "no thickness": (np.eye(3), np.array([[0, 1, 2], [0, 2, 1]])),
    "two that share an edge": merge([UNIT, box((1.0, 0.0, 1.0), (2.0, 1.0, 2.0))]),
}


@pytest.mark.parametrize("name", [name for name in SOLIDS if name != "bent"])
def test_triangles_that_close_and_face_outward_bound_a_solid(name):
    assert solid_of(SOLIDS[name]).all()


@pytest.mark.parametrize("name", NO_SOLIDS)
def test_whatever_has_a_rim_or_meets_itself_or_faces_inward_bounds_none(name):
    assert not solid_of(NO_SOLIDS[name]).any()


def test_one_solid_among_sheets_is_found():
    apart = box((5.0, 5.0, 5.0), (6.0, 6.0, 6.0))
    soup = merge([SOLIDS["bent"], NO_SOLIDS["open"], apart])
    assert solid_of(soup).tolist() == [False] * (12 + 10) + [True] * 12


@pytest.mark.parametrize("seed", range(6))
def test_on_any_ray_a_solid_is_entered_before_it_is_left(seed):
    # The brute force that the rule stands for: random closed surfaces, some of them crossing.
    rng = np.random.default_rng(seed)
    points, faces = icosphere(1)
    points = (points * rng.uniform(0.2, 2.2 if seed % 2 else 0.5, (len(points), 1))).astype(
        np.float32
    )
    is_solid = bounds_a_solid(points, faces.astype(np.int32)).all()
    corners = points[faces].astype(float)
    ever_below = False
    for _ in range(200):
        way = rng.normal(size=3)
        start = -5.0 * way + rng.uniform(-1.0, 1.0, 3)
        a, b, c = corners.transpose(1, 0, 2)
        normal = np.cross(b - a, c - a)
        t = ((a - start) * normal).sum(axis=1) / (normal @ way)
        at = start + t[:, None] * way
        sides = [
            (np.cross(q - p, at - p) * normal).sum(axis=1) for p, q in ((a, b), (b, c), (c, a))
        ]
        hit = (np.array(sides) > 0.0).all(axis=0)
        enters = np.where(normal @ way < 0.0, 1, -1)[hit][np.argsort(t[hit])]
        ever_below |= bool((np.cumsum(enters) < 0).any())
    assert not (is_solid and ever_below)
    if seed % 2 == 0:
        assert is_solid


# Clamping: Fig. 5.


def planes_of(made: Stage, name: str = "board"):
    volumes = ShadowVolumes(made.scene, made.light)
    frame = volumes.frame(made.cameras[0])
    index = caster_index(made, name)
    assert shadow_verdict(made).status == "no_violation_found"
    return frame.planes[index], index in frame.kept


SLANT = (0.13, -1.0, 0.07)
FLOOR = (0.0, 0.0, 0.0)
# Between ground points of the board's shadow, along the light; a lexel of a map of 64 more.
ACROSS = 1.0


@pytest.mark.gl
def test_case_a_object_and_shadow_visible_the_volume_holds_both():
    made = stage(scene_with(ground=ground(), board=BOARD), (0.0, 5.0, 9.0), FLOOR)
    (light_plane, dark_plane), kept = planes_of(made)
    assert kept
    assert light_plane == -np.inf  # the cap stays on the board
    floor = distance(made.light, FLOOR)
    assert floor < dark_plane < floor + ACROSS


@pytest.mark.gl
def test_case_b_object_hidden_the_volume_begins_at_the_shadow():
    high = box((-1.0, 6.0, -1.0), (1.0, 6.4, 1.0))
    made = stage(scene_with(ground=ground(), board=high), (0.0, 2.0, 6.0), (0.0, -0.5, 0.0))
    (light_plane, dark_plane), kept = planes_of(made)
    assert kept
    floor = distance(made.light, FLOOR)
    assert floor - ACROSS < light_plane < floor < dark_plane < floor + ACROSS


WALLED = {"ground": ground(), "wall": box((-8.0, 0.0, 3.0), (8.0, 1.6, 3.2)), "board": BOARD}


@pytest.mark.gl
def test_case_c_shadow_hidden_the_volume_ends_behind_the_object():
    # Over a wall that hides all of the ground behind it, to the board's lit top.
    wall = box((-8.0, 0.0, 3.0), (8.0, 2.0, 3.2))
    made = stage(scene_with(**{**WALLED, "wall": wall}), (0.0, 3.0, 9.0), (0.0, 2.0, 0.0))
    (light_plane, dark_plane), kept = planes_of(made)
    assert kept
    assert light_plane == -np.inf
    nearest, lowest = distance(made.light, (0, 2.4, 0)), distance(made.light, (0, 2.0, 0))
    assert nearest < dark_plane < lowest + ACROSS < distance(made.light, FLOOR)


@pytest.mark.gl
def test_object_seen_from_its_unlit_side_alone_needs_no_volume():
    made = stage(scene_with(**WALLED), (0.0, 1.5, 9.0), (0.0, 2.0, 0.0))
    _, kept = planes_of(made)
    assert not kept
    frame = ShadowVolumes(made.scene, made.light).frame(made.cameras[0])
    assert frame.unlit.any()
    assert (frame.image[frame.unlit] == 1).all()


@pytest.mark.gl
def test_case_d_neither_visible_the_volume_is_dropped():
    high_wall = box((-8.0, 0.0, 3.0), (8.0, 4.0, 3.2))
    made = stage(scene_with(**{**WALLED, "wall": high_wall}), (0.0, 1.5, 9.0), (0.0, 2.0, 0.0))
    _, kept = planes_of(made)
    assert not kept


@pytest.mark.gl
def test_case_e_a_table_between_does_not_end_the_volume():
    table = box((-2.0, 1.0, -2.0), (2.0, 1.2, 2.0))
    made = stage(
        scene_with(ground=ground(), table=table, board=BOARD), (0.0, 0.6, 9.0), (0.0, 1.0, 0.0)
    )
    (_, dark_plane), kept = planes_of(made)
    assert kept
    assert dark_plane > distance(made.light, FLOOR)


# The method.


@pytest.mark.gl
@pytest.mark.parametrize("seed", [3, 4])
@pytest.mark.parametrize("lexels", [5, 24, 96])
def test_no_sample_loses_its_shadow_whatever_the_litmaps_size(seed, lexels):
    assert shadow_verdict(pedestals(seed, lexels=lexels)).status == "no_violation_found"


@pytest.mark.gl
@pytest.mark.parametrize("seed", [5, 6])
def test_no_sample_loses_its_shadow_under_a_spot_light(seed):
    made = pedestals(seed)
    for at in ((1.0, 9.0, 2.0), (0.5, 3.5, 0.5)):  # above everything; among the casters
        lit = replace(made, light=spot(made.scene, at))
        assert shadow_verdict(lit).status == "no_violation_found"


@pytest.mark.gl
def test_wall_that_the_light_all_but_runs_along_is_dark_all_over():
    verdict = shadow_verdict(grazed())
    assert verdict.status == "no_violation_found"
    # Not even within tolerance, where depths tell the wall from no side of its volume.
    assert verdict.held == verdict.shown


@pytest.mark.gl
def test_planes_are_the_extremes_over_each_casters_rectangle():
    made = pedestals(1)
    volumes = ShadowVolumes(made.scene, made.light)
    frame = volumes.frame(camera_at((3.0, 1.0, 3.0), (6.0, 0.0, 5.0)))
    nearest, farthest = volumes.litmaps.read()
    height, width = nearest.shape
    kept = []
    for index, (x0, y0, x1, y1) in enumerate(volumes.casters.rectangle):
        # Every lexel that the caster's rectangle meets.
        rows = [y for y in range(height) if y <= y1 and y + 1 >= y0]
        columns = [x for x in range(width) if x <= x1 and x + 1 >= x0]
        least = nearest[np.ix_(rows, columns)].min()
        greatest = farthest[np.ix_(rows, columns)].max()
        if least <= greatest and volumes.casters.nearest[index] <= greatest:
            kept.append(index)
            whole = volumes.casters.farthest[index] <= least
            assert frame.planes[index].tolist() == [least if whole else -np.inf, greatest]
    assert frame.kept.tolist() == kept
    assert 0 < len(kept) < volumes.casters.count


@pytest.mark.gl
def test_every_sample_seen_from_its_lit_side_lies_in_its_lexels_range():
    made = pedestals(2)
    camera = endless(made.cameras[0])
    volumes, rays = ShadowVolumes(made.scene, made.light), ShadowTruth(made.scene, made.light)
    volumes.frame(camera)
    nearest, farthest = volumes.litmaps.read()
    truth = rays.engine.frame(camera)
    lit = ~volumes.frame(camera).unlit
    # Away from silhouettes, where GL may see another surface than rays do.
    whole = np.zeros(truth.buffer.triangle.shape, np.bool_)
    owner = truth.buffer.triangle
    whole[1:-1, 1:-1] = owner[1:-1, 1:-1] >= 0
    for shift, axis in ((1, 0), (-1, 0), (1, 1), (-1, 1)):
        whole &= owner == np.roll(owner, shift, axis)
    assert (whole & ~lit).any()
    samples = np.flatnonzero(whole & lit)
    points = sample_points(camera, samples, truth.buffer.depth.reshape(-1)[samples])
    pixel, along = made.light.camera.pixel_of(points)
    x, y = np.floor(pixel + 0.5).astype(int).T
    assert len(samples) > 1000
    assert (nearest[y, x] <= along).all()
    assert (farthest[y, x] >= along).all()


@pytest.mark.gl
def test_clamping_saves_fragments_and_an_orthographic_view_is_refused():
    made = pedestals(1)
    volumes = ShadowVolumes(made.scene, made.light)
    full = volumes.frame(made.cameras[0], clamped=False, fragments=True)
    clamped = volumes.frame(made.cameras[0], fragments=True)
    assert 0 < clamped.fragments < full.fragments
    assert len(full.kept) == volumes.casters.count
    flat = Camera(made.cameras[0].world_from_camera, 32, 32, near=0.5, ymag=4.0)
    with pytest.raises(InputError, match="orthographic"):
        volumes.frame(flat)


@pytest.mark.gl
def test_light_needs_a_scene():
    with pytest.raises(InputError, match="without triangles"):
        sun(DOWN, scene_with(), 8)


@pytest.mark.gl
def test_experiment_on_terrain_and_towers_loses_no_shadow_and_saves_fragments():
    dataset = terrain_towers(scale=0.05, frames=2)
    small = tuple(replace(camera, width=160, height=120) for camera in dataset.path)
    result = measure(scene_of(dataset), CameraPath(small))
    assert result["verdict"]["status"] == "no_violation_found"
    assert result["frames"] == [0, 1]
    assert result["fragments_clamped"] < result["fragments_full"]
    by_frame = result["by_frame"]["fragments_full"]
    assert math.isclose(result["fragments_full"], sum(by_frame) / 2, rel_tol=1e-12)
    # The volumes are those of the kinds together, and none of two.
    assert set(result["kinds"]) == {"bird", "ground", "tower"}
    for name in ("fragments_full", "fragments_clamped"):
        assert sum(kind[name] for kind in result["kinds"].values()) == result[name]
    assert 0.0 < result["solid"] < 1.0
