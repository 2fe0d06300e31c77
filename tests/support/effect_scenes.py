"""Small scenes for effects, and their judges. One GL context, tiny images."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from visref.camera import Camera, look_at
from visref.effects.images import ImageVerdict
from visref.effects.light import Light, sun
from visref.effects.shadow_truth import ShadowTruth
from visref.effects.sprite_truth import SpriteTruth
from visref.effects.sprites import Sprites
from visref.scene import Scene
from visref_culling.n_buffer.particles import Particles
from visref_culling.shadow_volumes import ShadowVolumes
from visref_culling.shadow_volumes.volumes import endless
from visref_datasets_gen.shapes import Soup, box, loft

Point = tuple[float, float, float]


def ground(half: float = 8.0, cells: int = 8) -> Soup:
    """A square of ground at height 0, in cells, so that few triangles pass the near plane."""
    ticks = np.linspace(-half, half, cells + 1)
    x, z = (grid.ravel() for grid in np.meshgrid(ticks, ticks))
    points = np.stack([x, np.zeros_like(x), z], axis=1)
    corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()[:, None]
    across = cells + 1
    faces = [np.add(corner, (0, across, across + 1)), np.add(corner, (0, across + 1, 1))]
    return points, np.concatenate(faces)


def scene_with(**objects: Soup) -> Scene:
    return Scene.from_objects([(name, *soup) for name, soup in objects.items()])


def camera_at(eye: Point, target: Point, *, near: float = 0.25) -> Camera:
    return Camera(look_at(eye, target), 96, 72, near=near, far=math.inf, yfov=0.9)


@dataclass(frozen=True)
class Stage:
    """A scene, its light, and one or more cameras."""

    scene: Scene
    light: Light
    cameras: tuple[Camera, ...]


def stage(scene: Scene, eye: Point, target: Point, *more: tuple[Point, Point],
          direction: Point = (0.13, -1.0, 0.07), lexels: int = 64) -> Stage:  # fmt: skip
    cameras = tuple(camera_at(*pair) for pair in ((eye, target), *more))
    return Stage(scene, sun(direction, scene, lexels), cameras)


def pedestals(seed: int, *, direction: Point = (0.3, -1.0, 0.2), lexels: int = 24) -> Stage:
    """Boxes and sheets in the air over pedestals over the ground, at random; coarse litmaps, so
    that a lexel holds more than one thing."""
    rng = np.random.default_rng(seed)
    objects: dict[str, Soup] = {"ground": ground()}
    for k in range(24):
        centre = np.array([rng.uniform(-6, 6), 0.0, rng.uniform(-6, 6)])
        half = np.array([*rng.uniform(0.1, 0.5, 3)])
        if k % 3 == 0:
            top = rng.uniform(0.3, 2.0)
            low, high = centre - half, centre + half
            low[1], high[1] = 0.0, top
            objects[f"pedestal-{k}"] = box(low, high, "xXYzZ")
        elif k % 3 == 1:
            centre[1] = rng.uniform(3.0, 6.0)
            objects[f"box-{k}"] = box(centre - 2.0 * half, centre + 2.0 * half)
        else:
            # A sheet that falls from high to low, and folds back on itself along an edge.
            points = rng.uniform(-1.5, 1.5, (4, 3)) + centre
            points[:, 1] = (rng.uniform(3.0, 5.0), rng.uniform(0.2, 0.6), *rng.uniform(1.0, 4.0, 2))
            objects[f"sheet-{k}"] = points, np.array([[0, 1, 2], [0, 1, 3]])
    eyes = (((0.0, 9.0, 9.0), (0.0, 0.0, 0.0)), ((8.0, 2.0, 6.0), (-2.0, 1.0, -1.0)))
    return stage(scene_with(**objects), *eyes[0], eyes[1], direction=direction, lexels=lexels)


def flat() -> Stage:
    """A board above flat ground, the sun straight above: the ground lies in the dark plane. The
    near plane is near, so that depths are coarse."""
    board = box((-1.5, 2.0, -1.5), (1.5, 2.2, 1.5))
    scene = scene_with(ground=ground(), board=board)
    camera = camera_at((0.0, 4.0, 7.0), (0.0, 0.0, 0.0), near=0.01)
    return Stage(scene, sun((0.0, -1.0, 0.0), scene, 64), (camera,))


def eye_in_shadow() -> Stage:
    """The eye under a roof, beside a pillar whose lit side it sees up to above its own height, so
    that the volume stays around it."""
    roof = box((-3.0, 3.0, -3.0), (3.0, 3.2, 3.0))
    pillar = box((1.2, 0.0, -0.5), (1.6, 2.6, 0.0))
    made = scene_with(ground=ground(), roof=roof, pillar=pillar)
    return stage(made, (0.0, 1.0, 2.0), (0.0, 1.4, -1.0))


def no_solids() -> Stage:
    """Casters in the air that look like solids, and of which the lit faces alone cast too little:
    inside out, without their top, and one that crosses itself, part of it inside out."""
    board = box((-4.0, 2.0, -1.0), (-2.0, 3.0, 1.0))
    crossing = [
        [(-1.0, y, 2.0), (3.0, y, -2.0), (3.0, y, 0.0), (-1.0, y, -2.0)] for y in (2.0, 3.0)
    ]
    objects: dict[str, Soup] = {
        "ground": ground(),
        "inside-out": (board[0], np.asarray(board[1])[:, ::-1]),
        "topless": box((-4.0, 2.0, 3.0), (-2.0, 3.5, 5.0), "xXyzZ"),
        "crossing": loft(crossing),
    }
    from_above = (0.0, 9.0, 9.0), (0.0, 0.0, 0.0)
    # What is lost of these is lost to an eye inside: outside, the far side's shadow does as well.
    inside_out = (-3.7, 2.5, -0.7), (-2.0, 2.4, 0.5)
    lobe = (2.6, 2.5, -0.7), (3.0, 2.4, -0.9)
    made = scene_with(**objects)
    return stage(made, *from_above, inside_out, lobe, direction=(0.3, -1.0, 0.2))


def grazed() -> Stage:
    """A wall that the light all but runs along, seen from its unlit side: the volume of what it
    belongs to begins nearer to it than depths tell apart."""
    points, faces = box((-1.0, 0.0, -2.0), (0.0, 3.0, 2.0))
    turn = np.array([[0.8, 0.0, -0.6], [0.0, 1.0, 0.0], [0.6, 0.0, 0.8]])
    made = scene_with(ground=ground(), wall=(points @ turn, faces))
    return stage(made, (6.0, 2.0, 1.0), (0.0, 1.5, 0.0), direction=(1e-6, -1.0, 0.0))


def shadow_verdict(made: Stage, method: type[ShadowVolumes] = ShadowVolumes) -> ImageVerdict:
    """A method's clamped shadows against its full ones of the sound method, and against rays,
    over all cameras of a stage."""
    rays = ShadowTruth(made.scene, made.light)
    sound, volumes = ShadowVolumes(made.scene, made.light), method(made.scene, made.light)
    verdict = ImageVerdict()
    for camera in map(endless, made.cameras):
        reference = sound.frame(camera, clamped=False).image
        image = volumes.frame(camera).image
        truth = rays.engine.frame(camera)
        verdict = verdict.plus(rays.judge(truth, image, reference, sound.tolerance(camera)))
    for part in (rays, sound, volumes):
        part.close()
    return verdict


def snowfall(seed: int, count: int = 400, side_px: int = 8) -> tuple[Stage, Sprites]:
    """Sprites among the pedestals, at their borders and beyond the image's."""
    rng = np.random.default_rng(seed)
    places = rng.uniform((-9.0, -1.0, -9.0), (9.0, 7.0, 9.0), (count, 3)).astype(np.float32)
    return pedestals(seed), Sprites(places, side_px)


def particle_verdict(
    made: Stage, sprites: Sprites, method: type[Particles] = Particles
) -> ImageVerdict:
    """A method's culled sprites against all sprites of the sound method, and against rays."""
    truth = SpriteTruth(made.scene, sprites)
    sound, particles = Particles(made.scene, sprites), method(made.scene, sprites)
    verdict = ImageVerdict()
    for camera in made.cameras:
        reference = sound.frame(camera, culled=False).layers
        layers = particles.frame(camera).layers
        verdict = verdict.plus(truth.judge(camera, layers, reference, sound.tolerance(camera)))
    for part in (truth, sound, particles):
        part.close()
    return verdict
