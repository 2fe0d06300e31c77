"""Particles: the sprites' truth, and culling them by one lookup."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.support.effect_scenes import camera_at, particle_verdict, scene_with, snowfall
from visref.camera import Camera
from visref.camera_path import CameraPath
from visref.culler import RasterTolerance
from visref.effects.sprite_truth import SpriteTruth, corners, layers
from visref.effects.sprites import Sprites
from visref.engines.exact import ExactEngine
from visref.errors import InputError
from visref_culling.gl.view import View
from visref_culling.n_buffer.particles import Particles
from visref_experiments.particles import measure

# A wall over the left half of the image, 5 before an eye that looks along -z.
WALL = np.array([(-9, -9, 0), (0, -9, 0), (0, 9, 0), (-9, 9, 0)], float), [[0, 1, 2], [0, 2, 3]]
EYE = camera_at((0.0, 0.0, 5.0), (0.0, 0.0, 0.0))
TOLERANCE = RasterTolerance(snap_px=0.01, depth_bits=24)
PIXEL_AT_1 = 2.0 * math.tan(0.45) / 72


def sprites_at(*places, side_px=8):
    """Centres at (pixels right of the middle, pixels above it, view depth)."""
    at = np.array([(x * PIXEL_AT_1 * d, y * PIXEL_AT_1 * d, 5.0 - d) for x, y, d in places])
    return Sprites(at.astype(np.float32), side_px)


def test_sprite_covers_its_square_of_pixels_and_no_others():
    sprites = sprites_at((10.2, 5.3, 4.0))
    shown = layers(sprites, ExactEngine(scene_with(wall=WALL)).frame(EYE))
    # Its left border belongs at column 48 + 10.2 - 4 = 54.2, its top at row 36 - 5.3 - 4 = 26.7.
    assert shown[27:35, 54:62].min() == shown.max() == 1
    assert shown.sum() == 64


def test_sprite_behind_a_wall_shows_where_it_leaves_it():
    sprites = sprites_at((-1.0, 0.0, 6.0), (-1.0, 0.0, 4.0), (-20.0, 0.0, 6.0))
    shown = layers(sprites, ExactEngine(scene_with(wall=WALL)).frame(EYE))
    # The one behind shows right of column 48 alone; the one before shows whole.
    assert shown[32:40, 43:48].tolist() == [[1] * 5] * 8
    assert shown[32:40, 48:51].tolist() == [[2] * 3] * 8
    assert shown.sum() == 5 * 8 + 2 * 3 * 8


@pytest.mark.parametrize("depth", [0.1, -3.0])
def test_sprite_before_the_near_plane_or_behind_the_eye_is_none(depth):
    truth = ExactEngine(scene_with(wall=WALL)).frame(EYE)
    assert not layers(sprites_at((0.0, 0.0, depth)), truth).any()


def test_sprite_as_deep_as_the_wall_may_show_or_not():
    sprites = sprites_at((-20.0, 0.0, 5.0), (-20.0, 20.0, 4.9), (-20.0, -20.0, 5.1))
    judge = SpriteTruth(scene_with(wall=WALL), sprites)
    samples = np.array([16 * 96 + 28, 36 * 96 + 28, 56 * 96 + 28])
    found = judge.bounds(EYE, samples, TOLERANCE)
    assert found.least.tolist() == [1, 0, 0]
    assert found.most.tolist() == [1, 1, 0]


def test_border_within_the_snap_of_a_pixel_border_may_fall_to_either_side():
    sprites = sprites_at((20.5, 0.0, 4.0))
    judge = SpriteTruth(scene_with(wall=WALL), sprites)
    row = 36 * 96
    samples = row + np.array([63, 64, 65, 71, 72, 73])
    found = judge.bounds(EYE, samples, TOLERANCE)
    assert found.least.tolist() == [0, 0, 1, 1, 0, 0]
    assert found.most.tolist() == [0, 1, 1, 1, 1, 0]


@pytest.mark.parametrize("side_px", [0, 5])
def test_sprites_without_a_middle_pixel_border_are_refused(side_px):
    with pytest.raises(InputError, match="even number"):
        Sprites(np.zeros((1, 3), np.float32), side_px)


@pytest.mark.gl
@pytest.mark.parametrize("side_px", [2, 6, 16, 24, 32])
def test_no_sprite_of_which_a_sample_shows_is_culled(side_px):
    assert particle_verdict(*snowfall(7, 200, side_px)).status == "no_violation_found"


@pytest.mark.gl
def test_sprite_is_culled_where_all_of_its_square_is_nearer_and_only_there():
    made, sprites = snowfall(3)
    camera = made.cameras[0]
    particles = Particles(made.scene, sprites)
    everything, culled = particles.frame(camera, culled=False), particles.frame(camera)
    farthest = particles.levels.read()[0]
    corner, depth = corners(sprites, camera)
    # The window depth of an endless view; what is within the shift of it may go either way.
    window, shift = (
        1.0 - camera.near / depth,
        4.0 * particles.depth_shift(View.of(camera, made.scene, 8)),
    )
    kept = set(culled.kept)
    for k in everything.kept:
        # At the rim what is left of the square is covered by a whole power of two again.
        x, y = np.maximum(corner[k], 0)
        size = np.minimum(corner[k] + 8, (96, 72)) - (x, y)
        side = 1 << int(size.max() - 1).bit_length()
        square = farthest[y : y + side, x : x + side]
        if abs(window[k] - square.max()) > shift:
            assert (k in kept) == (window[k] < square.max())
    assert 0 < len(kept) < len(everything.kept)


@pytest.mark.gl
def test_one_lookup_stands_for_a_sprite_in_the_image():
    made, sprites = snowfall(1)
    frame = Particles(made.scene, sprites).frame(made.cameras[0], fragments=True)
    corner, depth = corners(sprites, made.cameras[0])
    inside = (depth >= 0.25) & (corner > -8).all(axis=1) & (corner < (96, 72)).all(axis=1)
    assert frame.lookups == frame.in_image == np.count_nonzero(inside)
    assert len(frame.kept) * 8 <= frame.fragments <= len(frame.kept) * 64


@pytest.mark.gl
@pytest.mark.parametrize(("side_px", "squares", "a_sprite"), [(6, None, 4), (6, 1, 1), (8, 4, 4)])
def test_lookups_are_counted_as_the_shader_makes_them(side_px, squares, a_sprite):
    made, sprites = snowfall(1, side_px=side_px)
    particles = Particles(made.scene, sprites, squares=squares)
    frame = particles.frame(made.cameras[0])
    assert frame.lookups == a_sprite * frame.in_image > 0
    assert particles.frame(made.cameras[0], culled=False).lookups == 0


@pytest.mark.gl
def test_four_lookups_are_exact_for_any_size_and_one_is_not():
    made, sprites = snowfall(3, side_px=6)
    camera = made.cameras[0]
    four, one = (Particles(made.scene, sprites, squares=squares) for squares in (4, 1))
    kept = {name: set(made_.frame(camera).kept) for name, made_ in (("four", four), ("one", one))}
    corner, depth = corners(sprites, camera)
    farthest = four.levels.read()[0]
    window = 1.0 - camera.near / depth
    shift = 4.0 * four.depth_shift(View.of(camera, made.scene, 8))
    for k in four.frame(camera, culled=False).kept:
        x, y = np.maximum(corner[k], 0)
        right, below = np.minimum(corner[k] + 6, (96, 72))
        square = farthest[y:below, x:right].max()
        if abs(window[k] - square) > shift:
            assert (k in kept["four"]) == (window[k] < square)
    assert kept["four"] < kept["one"]


@pytest.mark.gl
def test_endless_orthographic_view_is_refused_and_one_that_ends_is_judged():
    made, sprites = snowfall(1, 100)
    pose = made.cameras[0].world_from_camera
    endless = Camera(pose, 64, 48, near=0.5, ymag=6.0)
    with pytest.raises(InputError, match="no end"):
        Particles(made.scene, sprites).frame(endless)
    ends = replace(made, cameras=(replace(endless, far=40.0),))
    assert particle_verdict(ends, sprites).status == "no_violation_found"


@pytest.mark.gl
def test_experiment_counts_a_lookup_instead_of_a_squares_samples():
    made, _ = snowfall(1)
    result = measure(made.scene, CameraPath(made.cameras))
    assert result["verdict"]["status"] == "no_violation_found"
    lookups = result["lookups_counted"]
    assert lookups == result["sprites_in_view"] >= result["sprites_kept"]
    assert result["depth_tests_left"] < result["depth_tests_plain"] <= 256 * lookups
    one, four = (result["other"][squares] for squares in ("1", "4"))
    assert four["lookups_counted"] == 4 * one["lookups_counted"]
    assert four["sprites_kept"] <= one["sprites_kept"]
    assert len(result["culled_ms"]) == len(result["plain_ms"]) == len(made.cameras)
    assert sum(result["by_frame"]["lookups_counted"]) == lookups * len(made.cameras)
