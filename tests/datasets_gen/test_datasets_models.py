"""The four models of the occupancy map's paper: exact sizes, sound parts, closed cases, paths."""

from __future__ import annotations

import math
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest

from tests.datasets_gen.test_datasets_gen import areas, edge_counts, signed_volume
from visref.camera_path import CameraPath
from visref.engines.embree import EmbreeEngine
from visref.errors import InputError
from visref.registry import SCENES, available
from visref.scene import Scene
from visref.visibility import objects_seen
from visref_datasets_gen import scene_of, solids
from visref_datasets_gen.angio import angio
from visref_datasets_gen.assembly import Assembly, exactly
from visref_datasets_gen.boombox import boombox
from visref_datasets_gen.city_cars import CARS, city_cars
from visref_datasets_gen.city_large import triangles_of
from visref_datasets_gen.formula_one import formula_one
from visref_datasets_gen.glb import glb_bytes
from visref_datasets_gen.graph import Node
from visref_datasets_gen.hulls import hull, open_shell, patch_on, tunnel
from visref_datasets_gen.refine import split_to, welded
from visref_datasets_gen.shapes import Soup, box, quads

PUBLISHED = {
    angio: (177, 419_639),
    boombox: (530, 644_268),
    formula_one: (306, 746_827),
    city_cars: (1_900, 4_059_195),
}
whole = cache(lambda make: make())  # a scene at scale 1 is made once
STATIONS = [
    (1.0, 0.5, 0.0, 1.0, 2.0),
    (0.5, 0.6, 0.1, 1.1, 3.0),
    (0.0, 0.5, 0.1, 0.9, 4.0),
    (-0.6, 0.3, 0.2, 0.7, 2.5),
]
SOLIDS = {
    "revolved": lambda fine: solids.revolved([(1.0, 0.0), (2.0, 1.0), (0.5, 3.0)], 9),
    "annulus": lambda fine: solids.annulus([(1.0, 0.0), (2.0, 0.0), (2.0, 1.0), (1.0, 1.0)], 9),
    "torus": lambda fine: solids.torus(4.0, 1.0, fine),
    "rod": lambda fine: solids.rod(1.0, 5.0, fine),
    "rounded box": lambda fine: solids.rounded_box((-1, 0, -3), (2, 4, 3), 0.5, fine),
    "open box": lambda fine: solids.open_box((-4, 0, -3), (4, 4, 3), 0.3, 1.0, fine),
    "plate": lambda fine: solids.framed(*solids.square_to_circle(4.0, 3.0, 2.0, fine), 0.0, 1.0),
    "tube": lambda fine: solids.tube([(0, 0, 0), (0, 4, 1), (3, 5, 0)], 0.4, fine),
    "spring": lambda fine: solids.spring(3.0, 0.4, 9.0, 5, fine),
    "screw": lambda fine: solids.screw(1.0, 6.0, fine),
    "nut": lambda fine: solids.nut(2.0, 1.0, fine),
    "gear": lambda fine: solids.gear(5.0, 12, 1.0, 1.0, fine),
    "knurled": lambda fine: solids.knurled(3.0, 4.0, 12, fine),
    "perforated": lambda fine: solids.perforated(5.0, 1.0, 0.3, fine),
    "finned": lambda fine: solids.finned((0, 0, 0), (8, 4, 2), 4, 1.0),
    "cylinder": lambda fine: solids.tube([(0, 0, 0), (1, 0, 0)], 0.2, fine),
    "hull": lambda fine: hull(STATIONS, fine),
    "open shell": lambda fine: open_shell(STATIONS, (0.05, 0.7, 0.7, 0.1), fine),
    "tunnel": lambda fine: tunnel(STATIONS, (0.0, 0.1, 0.1, 0.0), fine),
    "decal": lambda fine: patch_on(
        STATIONS, (0.0,) * 4, (0.1, 0.8), (-0.4, 0.4), (-0.02, -0.01), fine
    ),
}


def is_closed(soup: Soup) -> bool:
    """Every edge as often one way as the other."""
    counts = edge_counts(np.round(soup[0], 9), soup[1])
    return bool((counts[:, 0] == counts[:, 1]).all())


@pytest.mark.slow
@pytest.mark.parametrize("fine", [0.1, 1.0, 1.7])
@pytest.mark.parametrize("name", SOLIDS)
def test_solid_is_closed_and_faces_outward_at_any_fineness(name: str, fine: float) -> None:
    soup = SOLIDS[name](fine)
    assert is_closed(soup)
    assert signed_volume(soup) > 0.0
    corners = soup[0][soup[1]]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.linalg.norm(normal, axis=1) > 0.0).all()


def test_a_solid_with_a_face_gone_is_not_closed() -> None:
    vertices, faces = solids.rod(1.0, 5.0, 1.0)
    assert not is_closed((vertices, faces[1:]))


@pytest.mark.parametrize(
    ("soup", "volume"),
    [
        (solids.rod(1.0, 8.0, 8.0), math.pi * 8.0),
        (solids.torus(5.0, 1.0, 3.0), 2.0 * math.pi**2 * 5.0),
        (solids.rounded_box((0, 0, 0), (4, 5, 6), 0.01, 1.0), 120.0),
        (solids.open_box((0, 0, 0), (10, 10, 10), 1.0, 0.01, 1.0), 1000.0 - 8.0 * 8.0 * 9.0),
        (solids.framed(*solids.square_to_circle(4.0, 3.0, 2.0, 6.0), 0.0, 1.0), 48 - 4 * math.pi),
        (solids.tube([(0, 0, 0), (0, 9, 0)], 1.0, 6.0), 9.0 * math.pi),
    ],
)
def test_solids_have_the_volumes_of_their_formulas(soup: Soup, volume: float) -> None:
    assert signed_volume(soup) == pytest.approx(volume, rel=0.03)


@pytest.mark.parametrize("count", [12, 14, 40, 122])
def test_halving_edges_keeps_a_surface_closed_and_its_volume(count: int) -> None:
    split = split_to(welded(box([0, 0, 0], [1, 2, 3])), count)
    assert len(split[1]) == count
    assert is_closed(split)
    assert signed_volume(split) == pytest.approx(6.0)


def test_only_an_open_border_gives_an_odd_number_of_triangles() -> None:
    sheet = quads([[(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]])
    assert len(split_to(sheet, 7)[1]) == 7
    with pytest.raises(ValueError, match="no edge makes 13 triangles"):
        split_to(welded(box([0, 0, 0], [1, 2, 3])), 13)


@pytest.mark.slow
@pytest.mark.parametrize("make", PUBLISHED)
def test_model_has_the_papers_shapes_and_polygons(make) -> None:  # type: ignore[no-untyped-def]
    scene = scene_of(whole(make))
    assert (scene.object_count, scene.triangle_count) == PUBLISHED[make]
    assert len(set(scene.names)) == scene.object_count
    assert np.isfinite(scene.vertices).all()
    assert (areas(scene) > 0.0).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("make", "scale"),
    [
        (boombox, 0.3),
        (boombox, 0.511),
        (formula_one, 0.1),
        (formula_one, 0.3333),
        (city_cars, 0.1),
        (city_cars, 0.21),
    ],
)
def test_model_at_another_scale_has_its_share_of_triangles(make, scale) -> None:  # type: ignore[no-untyped-def]
    scene = scene_of(make(scale=scale, frames=2))
    shapes, triangles = PUBLISHED[make]
    assert scene.triangle_count == round(scale * triangles)
    own = shapes - CARS * 306
    assert scene.object_count == (CARS * 306 + round(own * scale) if make is city_cars else shapes)


@pytest.mark.slow
@pytest.mark.parametrize(("make", "scale"), [(boombox, 0.5), (formula_one, 0.2), (city_cars, 0.1)])
def test_same_seed_same_bytes_and_another_seed_others(make, scale) -> None:  # type: ignore[no-untyped-def]
    made = [make(seed=seed, scale=scale, frames=3) for seed in (5, 5, 6)]
    files = [glb_bytes(dataset.nodes) for dataset in made]
    assert files[0] == files[1] != files[2]
    assert made[0].path.to_json() == made[1].path.to_json()


@pytest.mark.slow
@pytest.mark.parametrize("make", [boombox, formula_one, city_cars])
@pytest.mark.parametrize(
    ("settings", "line"),
    [({"scale": 0.0}, "scale"), ({"scale": 0.02}, "nearer to 1"), ({"frames": 0}, "frames")],
)
def test_nothing_to_make_is_one_clear_line(make, settings, line) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InputError, match=line):
        make(**{"scale": 0.3, **settings})


def test_assembly_gives_its_odd_triangle_to_the_sheet_that_stands_first() -> None:
    def make(fine: float) -> Assembly:
        made = Assembly(fine, 1024.0)
        made.add("sheet", quads([[(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]]), (1, 1, 1))
        made.add("ball", solids.torus(3.0, 1.0, fine), (1, 1, 1))
        made.put("screw", solids.screw(1.0, 4.0, fine), (1, 1, 1), [(9, 0, 0), (12, 0, 0)], "+x")
        return made

    for wanted in (8001, 8002):
        made = exactly(make, wanted)
        assert made.triangles == wanted
        sheet, ball, screws = made.parts
        assert len(sheet.soup[1]) == 2 + wanted % 2
        assert is_closed(ball.soup)
        # What stands in several places is tessellated alike, and stored once.
        first, second = made.nodes()[2:]
        assert first.mesh is second.mesh is not None
        assert len(screws.places) == 2


@pytest.mark.slow
@pytest.mark.parametrize("make", [boombox, formula_one])
def test_layout_before_the_papers_table_has_the_same_numbers_in_other_shapes(make) -> None:  # type: ignore[no-untyped-def]
    fitted, before = (scene_of(make(fitted=fitted)) for fitted in (True, False))
    assert (before.object_count, before.triangle_count) == PUBLISHED[make]
    assert (areas(before) > 0.0).all()
    only_fitted, only_before = (
        {name.rstrip("-0123456789") for name in set(one.names) - set(other.names)}
        for one, other in ((fitted, before), (before, fitted))
    )
    if make is boombox:
        assert {"front-housing", "driver"} <= only_fitted
        assert {"front-rim", "speaker-panel", "grille-ring", "cone", "basket"} <= only_before
    else:
        assert {"front-lettering", "rear-lettering", "decal-nose-left"} <= only_fitted
        assert only_before == {"rivet"}  # they make up the number


@pytest.mark.slow
@pytest.mark.parametrize(
    ("make", "scale"),
    [
        (angio, 0.05),
        (boombox, 0.3),
        (formula_one, 0.1),
        (partial(boombox, fitted=False), 0.3),
        (partial(formula_one, fitted=False), 0.1),
    ],
)
def test_path_turns_the_whole_model_then_moves_in_through_free_space(make, scale) -> None:  # type: ignore[no-untyped-def]
    dataset = make(scale=scale, frames=60)
    scene, path = scene_of(dataset), dataset.path
    assert {(camera.width, camera.height) for camera in path} == {(876, 584)}
    corners = scene.vertices.astype(np.float64)
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2.0
    distance = np.array([np.linalg.norm(camera.eye - middle) for camera in path])
    assert np.ptp(distance[:40]) < 1e-6 * distance[0]
    for camera in path.cameras[:40]:
        rays = corners - camera.eye
        depth = rays @ camera.forward
        assert depth.min() > camera.near
        reach = depth * math.tan(camera.yfov / 2)
        assert (np.abs(rays @ camera.world_from_camera[:3, 1]) <= reach).all()
    assert distance[50] < 0.75 * distance[0]
    assert distance[-1] > 0.98 * distance[0]
    boxes = scene.object_bounds
    for camera in path:
        gap = np.maximum(np.maximum(boxes[:, 0] - camera.eye, camera.eye - boxes[:, 1]), 0.0)
        assert np.linalg.norm(gap, axis=1).min() > 1.5 * camera.near


def seen_by_name(scene: Scene, path: CameraPath) -> dict[str, int]:
    """In how many frames an object of each kind owns a sample."""
    engine = EmbreeEngine(scene)
    seen: dict[str, int] = {}
    for camera in path:
        visible = np.flatnonzero(objects_seen(engine.frame(camera), scene).visible)
        for name in {scene.names[i].rstrip("-0123456789") for i in visible}:
            seen[name] = seen.get(name, 0) + 1
    return seen


def without(scene: Scene, name: str) -> Scene:
    """The scene with an object's triangles taken away."""
    gone = scene.id_of_name[name]
    first, last = scene.object_offsets[gone : gone + 2].tolist()
    offsets = scene.object_offsets.copy()
    offsets[gone + 1 :] -= last - first
    kept = np.delete(np.arange(scene.triangle_count), np.s_[first:last])
    return Scene(scene.vertices, scene.triangles[kept], offsets, scene.names, scene.one_sided[kept])


INSIDE_THE_BOOMBOX = {
    "magnet", "pole", "voice-coil", "speaker-screw", "deck-plate", "reel", "gear", "flywheel",
    "motor", "belt", "head", "lever", "cell", "cell-spring", "winding", "wire", "main-board",
    "tuner-board", "chip", "capacitor", "resistor", "board-screw",
}  # fmt: skip
UNDER_THE_ENGINE_COVER = {"trumpet", "head-left", "injector", "ignition-coil", "cam-cover-left"}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fitted", "fronts"), [(True, ("front-housing",)), (False, ("centre-panel",))]
)
def test_boombox_case_hides_all_inside_and_shows_it_when_taken_off(
    fitted: bool, fronts: tuple[str, ...]
) -> None:
    dataset = boombox(scale=0.3, frames=18, fitted=fitted)
    scene, path = scene_of(dataset), dataset.path.resized(219, 146)
    assert {name.rstrip("-0123456789") for name in scene.names} >= INSIDE_THE_BOOMBOX
    seen = seen_by_name(scene, path)
    assert not INSIDE_THE_BOOMBOX & set(seen)
    for name in ("back-shell", *fronts):
        assert seen[name] > 4
        shown = seen_by_name(without(scene, name), path)
        assert len(INSIDE_THE_BOOMBOX & set(shown)) > 6


@pytest.mark.slow
def test_engine_cover_hides_the_engine_and_shows_it_when_taken_off() -> None:
    dataset = formula_one(scale=0.1, frames=18)
    scene, path = scene_of(dataset), dataset.path.resized(219, 146)
    assert not UNDER_THE_ENGINE_COVER & set(seen_by_name(scene, path))
    shown = set(seen_by_name(without(scene, "engine-cover"), path))
    assert len(UNDER_THE_ENGINE_COVER & shown) > 2


@pytest.mark.slow
def test_city_has_four_cars_as_instances_and_meets_them_on_its_walk() -> None:
    dataset = city_cars(scale=0.1, frames=40)
    scene = scene_of(dataset)
    cars = {name.split("/")[0] for name in scene.names if "/" in name}
    assert cars == {f"car{k}" for k in range(CARS)}
    assert len(glb_bytes(dataset.nodes)) < 0.25 * 36 * scene.triangle_count
    assert {(camera.width, camera.height) for camera in dataset.path} == {(1000, 900)}
    boxes = scene.object_bounds
    for camera in dataset.path:
        gap = np.maximum(np.maximum(boxes[:, 0] - camera.eye, camera.eye - boxes[:, 1]), 0.0)
        assert np.linalg.norm(gap, axis=1).min() > 0.25
    engine = EmbreeEngine(scene)
    met = set()
    for camera in dataset.path.resized(100, 90):
        visible = np.flatnonzero(objects_seen(engine.frame(camera), scene).visible)
        met |= {scene.names[i].split("/")[0] for i in visible if "/" in scene.names[i]}
    assert met == cars


@pytest.mark.parametrize("scale", [0.01002, 0.05])
def test_vessels_are_one_surface_with_one_open_end(scale: float) -> None:
    scene = scene_of(angio(scale=scale))
    wanted = round(419_639 * scale)
    assert scene.triangle_count == wanted
    assert scene.object_count == min(177, wanted // 40)
    sizes = np.diff(scene.object_offsets)
    assert sizes.max() - sizes.min() <= 1
    assert (areas(scene) > 0.0).all()
    counts = edge_counts(scene.vertices, scene.triangles)
    assert counts.max() == 1
    border = counts.sum(axis=1) == 1
    # One cut through the trunk: its rim is short, and odd where the count is.
    assert 0 < border.sum() < 0.01 * len(counts)
    assert border.sum() % 2 == wanted % 2


def test_nearly_every_vessel_is_visible_when_all_are_in_view() -> None:
    dataset = angio(scale=0.1, frames=9)
    scene = scene_of(dataset)
    engine = EmbreeEngine(scene)
    for camera in dataset.path.cameras[:6]:
        assert objects_seen(engine.frame(camera), scene).visible.mean() > 0.9


def documented_sizes() -> dict[str, tuple[int, int]]:
    """Objects and triangles of each scene, as docs/scenes.md has them."""
    page = (Path(__file__).parents[2] / "docs" / "scenes.md").read_text(encoding="utf-8")
    sizes = {}
    for line in page.split("## Sizes")[1].split("\n## ")[0].splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if cells[0].startswith("`"):
            objects, triangles = (cells[k].split()[0].replace(",", "") for k in (3, 5))
            sizes[cells[0].strip("`")] = int(objects), int(triangles)
    return sizes


def objects_of(node: Node) -> int:
    return (node.mesh is not None) + sum(map(objects_of, node.children))


@pytest.mark.slow
@pytest.mark.parametrize("name", documented_sizes())
def test_documented_sizes_are_the_scenes(name: str) -> None:
    dataset = whole(available(SCENES)[name].load())
    measured = tuple(sum(map(count, dataset.nodes)) for count in (objects_of, triangles_of))
    assert measured == documented_sizes()[name]
