"""Pictures: that they show the samples that the verdict counts, in colours that all can tell."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from PIL import Image

from tests.support.hand_made import scene_of_squares, settled, square, truth
from visref.camera import Camera, look_at
from visref.culler import Promise
from visref.judging.judge import judge
from visref.run_folder import pictures
from visref.run_folder.colours import MISSED_RGB, SUPERFLUOUS_RGB, VISIBLE_RGB
from visref.run_folder.layout import PAGE_WIDTH_PX, page_shape
from visref.run_folder.owners import owner_picture, owners_of
from visref.run_folder.pictures import (
    MAX_RINGS,
    RING_BELOW_PX,
    Painter,
)
from visref.run_folder.silhouettes import silhouettes
from visref.scene import Alpha, Scene
from visref.visibility import BACKGROUND, BlendVisibility, FrameTruth, VisibilityBuffer


def draw(folder, scene, frame_truth, drawn, units=None, promise=Promise.CONSERVATIVE):
    frame = settled(scene, frame_truth, units or scene.object_units(), drawn)
    verdict = judge(frame, promise)
    return Painter(folder / "pictures").draw(frame, verdict, stem="mine", culler="mine", frame=7)


def rgb(folder, pictures, what):
    """(height, width, 3) float64, one of the pictures."""
    with Image.open(folder / pictures.files[what]) as picture:
        return np.asarray(picture.convert("RGB"), float)


def missed_pixels(folder, pictures):
    errors = rgb(folder, pictures, "errors")
    return np.argwhere((errors == MISSED_RGB).all(axis=2))[:, ::-1].tolist()


def wide_truth(scene, width, height, owned):
    """Object 0 owns everything but the `owned` pixels, which are object 1's."""
    triangle = np.zeros((height, width), np.int32)
    for x, y in owned:
        triangle[y, x] = scene.object_offsets[1]
    camera = Camera(
        look_at((0.0, 0.0, 10.0), (0.0, 0.0, 0.0)), width, height, near=1.0, far=100.0, ymag=2.0
    )
    return FrameTruth(camera, "hand", VisibilityBuffer(triangle, np.full((height, width), 5.0)))


def test_error_picture_shows_exactly_the_missed_samples(tmp_path):
    scene = scene_of_squares(0.0, 1.0)
    lost = [[x, y] for y in range(10, 60) for x in range(20, 90)]
    pictures = draw(tmp_path, scene, wide_truth(scene, 120, 80, lost), [0])
    assert sorted(missed_pixels(tmp_path, pictures)) == sorted(lost)


@pytest.mark.slow
def test_a_single_missed_sample_survives_the_shrinking(tmp_path):
    scene = scene_of_squares(0.0, 1.0)
    for at in ([0, 0], [3839, 0], [1234, 567], [3839, 999]):
        pictures = draw(tmp_path, scene, wide_truth(scene, 3840, 1000, [at]), [0])
        height, width = rgb(tmp_path, pictures, "errors").shape[:2]
        (found,) = missed_pixels(tmp_path, pictures)
        assert found == [at[0] * width // 3840, at[1] * height // 1000]


def test_no_error_picture_where_nothing_is_missed(tmp_path):
    scene = scene_of_squares(0.0, 1.0)
    pictures = draw(tmp_path, scene, wide_truth(scene, 120, 80, [[5, 5]]), [0, 1])
    assert set(pictures.files) == {"picture", "drawn", "ids", "owners"}
    assert (pictures.culler, pictures.frame) == ("mine", 7)
    for what in pictures.files:
        assert rgb(tmp_path, pictures, what).shape == (80, 120, 3)


def test_a_missed_patch_is_ringed_only_if_it_is_small(tmp_path):
    """The ring lies outside the patch: vermilion appears where nothing was missed."""

    def vermilion_outside(owned):
        scene = scene_of_squares(0.0, 1.0)
        pictures = draw(tmp_path, scene, wide_truth(scene, 200, 150, owned), [0])
        overlay = rgb(tmp_path, pictures, "drawn")
        near = np.abs(overlay - MISSED_RGB).sum(axis=2) < 60
        x0, y0 = np.min(owned, axis=0)
        x1, y1 = np.max(owned, axis=0)
        near[max(0, y0 - 3) : y1 + 4, max(0, x0 - 3) : x1 + 4] = False
        return int(near.sum())

    assert vermilion_outside([[100, 70]]) > 20
    assert vermilion_outside([[x, y] for x in range(70, 130) for y in range(40, 100)]) == 0


def test_a_missed_blended_object_is_ringed_though_it_owns_no_sample(tmp_path):
    scene = scene_of_squares(0.0, 1.0)
    alpha = scene.alpha.copy()
    alpha[2:] = Alpha.BLEND
    scene = Scene(scene.vertices, scene.triangles, scene.object_offsets, scene.names, alpha=alpha)
    seen = wide_truth(scene, 120, 80, [])
    seen = FrameTruth(
        seen.camera,
        seen.engine,
        seen.buffer,
        blend=BlendVisibility.of(
            scene, np.array([40 * 120 + 60]), np.array([2], np.int32), np.array([4.0])
        ),
    )
    pictures = draw(tmp_path, scene, seen, [0])
    errors = rgb(tmp_path, pictures, "errors")
    ring = np.argwhere((errors == 255).all(axis=2))
    assert len(ring)
    assert np.allclose(ring.mean(axis=0), (40, 60), atol=0.6)


def test_a_tie_loses_no_sample_and_leaves_no_mark(tmp_path):
    scene = scene_of_squares(0.0, 0.0)
    frame_truth = truth([[0] * 8] * 6, ties=[(s, 2) for s in range(48)])
    pictures = draw(tmp_path, scene, frame_truth, [0])
    assert "errors" not in pictures.files


@pytest.mark.parametrize("lens", [{"yfov": 0.8}, {"ymag": 4.0}])
def test_a_face_looks_the_same_whichever_way_it_is_wound(tmp_path, lens):
    camera = Camera(look_at((0, 0, 10.0), (0, 0, 0)), 40, 30, near=1.0, far=99.0, **lens)
    buffer = VisibilityBuffer(np.zeros((30, 40), np.int32), np.full((30, 40), 10.0))
    pictures = []
    for name, step in (("ccw", 1), ("cw", -1)):
        points, faces = square(-9.0, -9.0, 0.0, 18.0)
        scene = Scene.from_objects([("wall", points, faces[:, ::step])])
        drawn = draw(tmp_path / name, scene, FrameTruth(camera, "hand", buffer), [0])
        pictures.append(rgb(tmp_path / name, drawn, "picture"))
    assert np.array_equal(*pictures)
    # It faces the viewer, and so the light.
    assert pictures[0].mean() > 145


def test_objects_have_one_colour_each_and_the_background_none(tmp_path):
    scene = scene_of_squares(*np.linspace(0.0, 3.0, 30))
    owner = np.repeat(np.arange(-1, 30), 4)
    triangle = np.where(owner >= 0, 2 * owner + np.arange(len(owner)) % 2, BACKGROUND)
    pictures = draw(tmp_path, scene, truth([triangle.tolist()]), range(30))
    colours = rgb(tmp_path, pictures, "ids")[0]
    by_object = {int(o): {tuple(map(int, c)) for c in colours[owner == o]} for o in set(owner)}
    assert by_object[-1] == {(0, 0, 0)}
    assert all(len(found) == 1 for found in by_object.values())
    assert len(set.union(*by_object.values())) == 31


def test_an_empty_view_is_all_sky(tmp_path):
    scene = scene_of_squares(0.0)
    pictures = draw(tmp_path, scene, truth([[-1] * 8] * 6), [])
    sky = rgb(tmp_path, pictures, "picture")
    assert sky.min() > 150


def test_same_frame_gives_the_same_bytes(tmp_path):
    scene = scene_of_squares(0.0, 1.0, -1.0)
    contents = []
    for name in ("a", "b"):
        frame_truth = wide_truth(scene, 120, 80, [[x, 4] for x in range(30)])
        pictures = draw(tmp_path / name, scene, frame_truth, [0, 2])
        contents.append({k: (tmp_path / name / v).read_bytes() for k, v in pictures.files.items()})
    assert contents[0] == contents[1]
    assert set(contents[0]) == {"picture", "drawn", "ids", "owners", "errors"}


def test_superfluous_unit_shows_where_it_lies_hidden(tmp_path):
    """A square in the left upper quarter, behind a wall: orange there, none elsewhere."""
    wall, hidden = square(-60.0, -40.0, 0.0, 200.0), square(-60.0, 0.0, -5.0, 40.0)
    scene = Scene.from_objects([("wall", *wall), ("hidden", *hidden)])
    camera = Camera(
        look_at((0.0, 0.0, 10.0), (0.0, 0.0, 0.0)), 120, 80, near=1.0, far=99.0, ymag=40.0
    )
    frame_truth = FrameTruth(
        camera, "hand", VisibilityBuffer(np.zeros((80, 120), np.int32), np.full((80, 120), 10.0))
    )
    pictures = draw(tmp_path, scene, frame_truth, [0, 1])
    overlay = rgb(tmp_path, pictures, "drawn")
    # Orange has much more red than blue; the blue ramp of what is visible never has.
    orange = overlay[..., 0] - overlay[..., 2] > 40
    inside = np.zeros((80, 120), bool)
    inside[0:40, 0:40] = True
    assert orange[inside].mean() > 0.25
    # A JPEG's colour may bleed over a border by less than a block of 8 pixels.
    assert not orange[48:].any()
    assert not orange[:, 48:].any()


@pytest.mark.parametrize(
    ("size", "shape"), [((64, 48), (48, 64)), ((960, 720), (720, 960)), ((3840, 2160), (540, 960))]
)
def test_pictures_are_never_enlarged_nor_wider_than_the_page(size, shape):
    camera = Camera(np.eye(4), *size, near=1.0, yfov=1.0)
    assert page_shape(camera.width, camera.height) == shape
    assert shape[1] <= PAGE_WIDTH_PX


def ray_cast(scene, camera):
    """Nearest object at each sample by brute force, and the least barycentric coordinate of
    any triangle's plane hit there: near 0 the two methods may differ by rounding."""
    owner = np.full((camera.height, camera.width), -1)
    doubt = np.full((camera.height, camera.width), np.inf)
    corners = scene.vertices[scene.triangles].astype(float)
    for y, x in itertools.product(range(camera.height), range(camera.width)):
        origin, direction = camera.ray(x, y)
        best = np.inf
        for t, (a, b, c) in enumerate(corners):
            system = np.column_stack([b - a, c - a, -direction])
            if abs(np.linalg.det(system)) < 1e-12:
                continue
            u, v, depth = np.linalg.solve(system, origin - a)
            least = min(u, v, 1 - u - v)
            doubt[y, x] = min(doubt[y, x], abs(least), abs(depth - camera.near))
            if least >= 0 and camera.near <= depth < best:
                doubt[y, x] = min(doubt[y, x], best - depth)
                best, owner[y, x] = depth, scene.object_of_triangle[t]
    return owner, doubt


@pytest.mark.slow
@pytest.mark.parametrize("lens", [{"yfov": 1.1}, {"ymag": 3.0, "shift_x_px": 2.25}])
def test_silhouettes_agree_with_rays_even_across_the_near_plane(lens):
    rng = np.random.default_rng(5)
    shown = set()
    for _ in range(4):
        points = rng.uniform((-6, -6, -9), (6, 6, 4), (9, 3))
        faces = np.arange(9).reshape(3, 3)
        scene = Scene.from_objects([(f"t{i}", points, faces[i : i + 1]) for i in range(3)])
        pose = look_at(rng.uniform(-1, 1, 3), (0.3, 0.2, -7.0))
        camera = Camera(pose, 40, 30, near=0.5, shift_y_px=0.5, far=99.0, **lens)
        units = scene.object_units()
        found = silhouettes(scene, camera, units, np.arange(3, dtype=np.int32), (30, 40))
        expected, doubt = ray_cast(scene, camera)
        sure = doubt > 1e-6
        assert sure.mean() > 0.95
        assert (found == expected)[sure].all()
        shown |= set(np.unique(found))
    assert shown == {-1, 0, 1, 2}


def test_a_unit_smaller_than_a_pixel_still_leaves_a_mark():
    scene = Scene.from_objects([("speck", *square(0.2, 0.2, 0.0, 0.01))])
    camera = Camera(look_at((0.0, 0.0, 10.0), (0.0, 0.0, 0.0)), 8, 6, near=1.0, far=99.0, ymag=3.0)
    found = silhouettes(scene, camera, scene.object_units(), np.zeros(1, np.int32), (6, 8))
    assert np.argwhere(found == 0).tolist() == [[2, 4]]


# Machado, Oliveira and Fernandes (2009), severity 1, in linear RGB.
DEFICIENCIES = {
    "normal": np.eye(3),
    "protanopia": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deuteranopia": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "tritanopia": [
        [1.255528, -0.076749, -0.178779],
        [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.303900],
    ],
}


def oklab(colour, matrix):
    value = np.array(colour) / 255.0
    linear = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    seen = np.clip(np.asarray(matrix) @ linear, 0.0, 1.0)
    cone = np.array(
        [
            [0.4122214708, 0.5363325363, 0.0514459929],
            [0.2119034982, 0.6806995451, 0.1073969566],
            [0.0883024619, 0.2817188376, 0.6299787005],
        ]
    )
    lab = np.array(
        [
            [0.2104542553, 0.7936177850, -0.0040720468],
            [1.9779984951, -2.4285922050, 0.4505937099],
            [0.0259040371, 0.7827717662, -0.8086757660],
        ]
    )
    return lab @ np.cbrt(cone @ seen)


def least_difference(colours):
    """The least distance in OKLab of two of these colours, over every kind of vision."""
    return min(
        math.dist(oklab(one, matrix), oklab(other, matrix))
        for matrix in DEFICIENCIES.values()
        for one, other in itertools.combinations(colours, 2)
    )


def test_the_three_classes_differ_for_every_colour_vision():
    # About five times a just noticeable difference (0.02 in OKLab) for patches side by side.
    assert least_difference([VISIBLE_RGB, SUPERFLUOUS_RGB, MISSED_RGB]) > 0.1
    assert least_difference([(0, 160, 0), (190, 110, 0)]) < 0.1


def test_rings_are_those_of_an_object_by_object_search():
    """An independent search, object by object, on random masks."""
    rng = np.random.default_rng(5)
    compared = 0
    for _ in range(12):
        scene = scene_of_squares(*np.linspace(0.0, 1.0, 90))
        width, height = 200, 150
        owner = np.zeros((height, width), np.int32)
        for obj in range(1, 90):
            y, x = rng.integers(0, height), rng.integers(0, width)
            side = int(rng.integers(1, 60))
            owner[y : y + side : 3, x : x + side : 2] = obj
        triangle = scene.object_offsets[:-1].astype(np.int32)[owner]
        camera = Camera(
            look_at((0.0, 0.0, 10.0), (0.0, 0.0, 0.0)), width, height, near=1.0, far=100.0, ymag=2.0
        )
        buffer = VisibilityBuffer(triangle, np.full((height, width), 5.0))
        drawn = [0, *rng.choice(np.arange(1, 90), 10, replace=False).tolist()]
        frame = settled(scene, FrameTruth(camera, "hand", buffer), scene.object_units(), drawn)
        verdict = judge(frame, Promise.CONSERVATIVE)
        missed = frame.walk.lost_samples
        wanted = []
        for miss in verdict.misses:
            y, x = np.nonzero(owner == miss.object)
            span = max(np.ptp(x), np.ptp(y)) + 1
            if span < RING_BELOW_PX:
                middle = (x.min() + x.max() + 1) / 2, (y.min() + y.max() + 1) / 2
                wanted.append((*map(float, middle), float(span / 2 + 9.0)))
        rings = pictures._rings(scene, frame.truth, verdict, missed, (height, width))
        assert [(ring.x, ring.y, ring.radius) for ring in rings] == wanted[:MAX_RINGS]
        compared += len(rings)
    assert compared > 100


def test_a_frame_is_shaded_once_for_all_cullers(tmp_path, monkeypatch):
    calls = []
    shade = pictures._shade
    monkeypatch.setattr(pictures, "_shade", lambda *given: calls.append(1) or shade(*given))
    scene = scene_of_squares(0.0, 1.0)
    frame_truth = wide_truth(scene, 60, 40, [(x, 3) for x in range(9)])
    painter = Painter(tmp_path / "pictures")
    found = []
    for frame in (3, 4):
        for culler, drawn in (("a", [0]), ("b", [1]), ("c", [0, 1])):
            one = settled(scene, frame_truth, scene.object_units(), drawn)
            verdict = judge(one, Promise.CONSERVATIVE)
            found.append(painter.draw(one, verdict, stem=culler, culler=culler, frame=frame))
    assert len(calls) == 2
    assert [one.files["ids"] for one in found] == [
        *["pictures/frame-00003-ids.png"] * 3,
        *["pictures/frame-00004-ids.png"] * 3,
    ]
    assert len({one.files["drawn"] for one in found}) == 6


def test_owners_can_be_read_back_from_their_picture(tmp_path):
    ids = np.array([[-1, 0, 1], [254, 255, 65_535], [65_536, 2**24 - 3, 2**24 - 2]], np.int32)
    file = tmp_path / "owners.png"
    owner_picture(ids).save(file)
    with Image.open(file) as picture:
        assert np.array_equal(owners_of(picture), ids)


def test_what_was_only_sketched_is_drawn_as_what_was_drawn_at_once(tmp_path):
    """But for the shades of the scene, which then hang on depths that are computed again."""
    scene = scene_of_squares(0.0, 1.0)
    frame_truth = wide_truth(scene, 60, 40, [(x, 3) for x in range(9)])
    one = settled(scene, frame_truth, scene.object_units(), [0])
    verdict = judge(one, Promise.CONSERVATIVE)
    names = {"stem": "a", "culler": "a", "frame": 3}
    at_once = Painter(tmp_path / "one" / "pictures").draw(one, verdict, **names)
    painter = Painter(tmp_path / "two" / "pictures")
    kept = painter.sketch(one, verdict, **names)
    # Meanwhile another frame passes.
    painter.sketch(one, verdict, **{**names, "frame": 4})
    later = painter.paint(kept, scene)
    assert later == at_once
    for what in ("ids", "owners", "errors"):
        first, second = (
            (tmp_path / name / at_once.files[what]).read_bytes() for name in ("one", "two")
        )
        assert first == second
