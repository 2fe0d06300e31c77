"""Generated scenes, each a small case built around ways to go wrong.

A `Recipe` is what a scene is made from: the parts of `layouts`, `bodies`, `staging` and `motions`
with their numbers. Recipes are drawn, changed and crossed; `built` makes the case of one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visref.camera_path import CameraPath, Frame
from visref.conformance.building import Case as Laid
from visref.conformance.building import cut_out
from visref.conformance.moving import Bending, rigged
from visref.errors import InputError
from visref.scene import Scene
from visref.search.bodies import BODIES
from visref.search.kinds import Catalogue, Part, Piece, Stage, changed_part, draw_part
from visref.search.layouts import LAYOUTS
from visref.search.motions import MOTIONS, Moves
from visref.search.staging import LENSES, PATHS, VIEWS, WORLDS

THINGS: Catalogue = {**LAYOUTS, **BODIES}

# Parts a scene has at most: a small scene is quick to judge, and its faults are easy to see.
MOST_THINGS = 5
_SECTIONS = {"lens": LENSES, "path": PATHS, "views": VIEWS, "world": WORLDS}
_ANY_PATH = CameraPath([LENSES["straight"].build(0, 1.0, 0, 0)])
# Of scenes that may move and have several frames, the share that does.
_MOVES = 0.5


@dataclass(frozen=True)
class Recipe:
    """What a generated scene is made from, in JSON values. `things`: parts, a part that moves with
    a part `moves` and the number `mover` of its objects that does; `same_names`: whether objects
    bear one name each kind."""

    lens: Part
    path: Part
    views: Part
    world: Part
    things: tuple[Part, ...]
    same_names: bool = False

    def to_json(self) -> dict[str, Any]:
        return {**vars(self), "things": list(self.things)}

    @classmethod
    def from_json(cls, value: Any) -> Recipe:
        """Raises InputError for what is no recipe of this version of the grammar."""
        try:
            sections = {name: _part(value[name], kinds) for name, kinds in _SECTIONS.items()}
            things = tuple(_thing(one) for one in value["things"])
            return cls(**sections, things=things, same_names=bool(value["same_names"]))
        except (KeyError, TypeError, AttributeError, ValueError) as error:
            raise InputError(
                "it is no recipe that this version makes a scene of", fix="begin anew elsewhere"
            ) from error

    @property
    def moves(self) -> bool:
        """Whether something in it may be posed."""
        return any("moves" in thing for thing in self.things)


def _part(value: Any, kinds: Catalogue) -> Part:
    kind = kinds[value["kind"]]
    return {"kind": kind.name, **{name: float(value[name]) for name in kind.genes}}


def _thing(value: Any) -> Part:
    thing = _part(value, THINGS)
    if "moves" in value:
        thing |= {"mover": int(value["mover"]), "moves": _part(value["moves"], MOTIONS)}
    return thing


# Drawing.


def random_recipe(rng: np.random.Generator, *, moves: bool) -> Recipe:
    """A recipe drawn anew. `moves`: whether things may move in it."""
    sections = {name: draw_part(kinds, rng) for name, kinds in _SECTIONS.items()}
    count = int(rng.choice([1, 2, 3, 4], p=[0.35, 0.35, 0.2, 0.1]))
    things = [draw_part(THINGS, rng) for _ in range(count)]
    recipe = Recipe(**sections, things=tuple(things), same_names=bool(rng.random() < 0.15))
    if moves and rng.random() < _MOVES:
        return _moving(recipe, rng)
    return recipe


def _moving(recipe: Recipe, rng: np.random.Generator) -> Recipe:
    """The recipe with motions, over several frames."""
    while recipe.path["kind"] == "one-frame":
        recipe = replace(recipe, path=draw_part(PATHS, rng))
    if rng.random() < 0.5:
        # Nothing but what moves changes.
        recipe = replace(recipe, path=PATHS["standing"].draw(rng))
    things = list(recipe.things)
    for at in rng.permutation(len(things))[: int(rng.integers(1, 3))]:
        things[int(at)] = _with_motion(things[int(at)], rng)
    return replace(recipe, things=tuple(things))


def _with_motion(thing: Part, rng: np.random.Generator) -> Part:
    # Which of its objects: mostly the first two, which are what hides and what is hidden.
    which = int(rng.integers(2)) if rng.random() < 0.7 else int(rng.integers(40))
    return {**thing, "mover": which, "moves": draw_part(MOTIONS, rng)}


def changed(recipe: Recipe, rng: np.random.Generator, *, moves: bool) -> Recipe:
    """The recipe with one to three changes: of genes, of things, of how it is looked at."""
    for _ in range(int(rng.integers(1, 4))):
        recipe = _changed(recipe, rng, moves)
    return recipe


def _changed(recipe: Recipe, rng: np.random.Generator, moves: bool) -> Recipe:
    things = list(recipe.things)
    at = int(rng.integers(len(things)))
    what = float(rng.random())
    if what < 0.4:
        things[at] = _other_genes(things[at], rng)
    elif what < 0.55:
        name = str(rng.choice(list(_SECTIONS)))
        part = changed_part(_SECTIONS[name], getattr(recipe, name), rng)
        return replace(recipe, **{name: part})  # type: ignore[arg-type]
    elif what < 0.65:
        name = str(rng.choice(list(_SECTIONS)))
        return replace(recipe, **{name: draw_part(_SECTIONS[name], rng)})  # type: ignore[arg-type]
    elif what < 0.75 and len(things) < MOST_THINGS:
        things.append(draw_part(THINGS, rng))
    elif what < 0.82 and len(things) > 1:
        del things[at]
    elif what < 0.9:
        things[at] = draw_part(THINGS, rng)
    elif moves:
        return _moving(recipe, rng)
    return replace(recipe, things=tuple(things))


def _other_genes(thing: Part, rng: np.random.Generator) -> Part:
    moves: Part = {name: thing[name] for name in ("mover", "moves") if name in thing}
    if moves and rng.random() < 0.4:
        moves["moves"] = changed_part(MOTIONS, moves["moves"], rng)
        return {**thing, **moves}
    bare = {name: value for name, value in thing.items() if name not in moves}
    return {**changed_part(THINGS, bare, rng), **moves}


def crossed(one: Recipe, other: Recipe, rng: np.random.Generator) -> Recipe:
    """A recipe of the parts of two."""
    sections = {name: getattr(one if rng.random() < 0.5 else other, name) for name in _SECTIONS}
    every = [*one.things, *other.things]
    count = int(rng.integers(1, min(len(every), MOST_THINGS) + 1))
    kept = sorted(rng.permutation(len(every))[:count].tolist())
    return Recipe(**sections, things=tuple(every[k] for k in kept), same_names=one.same_names)


# Building.


def built(recipe: Recipe) -> tuple[Scene, CameraPath]:
    """The scene and the path of a recipe, the same for the same recipe. Raises InputError where
    they are none (numbers that float32 does not hold, say)."""
    view = _call(LENSES, recipe.lens)
    stage = Stage(view)
    moving: dict[int, Part] = {}
    for thing in recipe.things:
        first = len(stage.pieces)
        with np.errstate(all="ignore"):  # what is not finite is refused with its object
            _call(THINGS, thing, stage)
        count = len(stage.pieces) - first
        if "moves" in thing and count:
            moving[first + thing["mover"] % count] = thing["moves"]
    world, origin = _call(WORLDS, recipe.world)
    cameras = [_call(VIEWS, recipe.views, camera) for camera in _call(PATHS, recipe.path, view)]
    # What the path moves it names, and names of its own it must have.
    pieces = _named(stage.pieces, recipe.same_names and not moving)
    scene = _scene(pieces, world, origin)
    return _posed(scene, [_placed(views, world, origin) for views in cameras], pieces, moving)


def _call(kinds: Catalogue, part: Part, *first: Any) -> Any:
    kind = kinds[part["kind"]]
    return kind.build(*first, **{name: part[name] for name in kind.genes})


def _named(pieces: list[Piece], same: bool) -> list[Piece]:
    if same:
        return pieces
    return [replace(one, name=f"{one.name} {number}") for number, one in enumerate(pieces)]


def _scene(pieces: list[Piece], world: NDArray[Any], origin: NDArray[Any]) -> Scene:
    rotation, step = world[:3, :3], world[:3, 3]
    objects = []
    for piece in pieces:
        points, faces = piece.mesh
        # The identity leaves every bit as it is.
        still = np.array_equal(world, np.eye(4))
        objects.append((piece.name, points if still else points @ rotation.T + step, faces))
    scene = Scene.from_objects(objects, source="generated")
    if scene.triangle_count:
        owner = scene.object_of_triangle
        alpha = np.array([int(piece.alpha) for piece in pieces])[owner].astype(np.uint8)
        sided = np.array([piece.one_sided for piece in pieces])[owner]
        scene = replace(scene, alpha=alpha, one_sided=sided)
    if origin.any():
        scene = replace(scene, origin=origin)
    cutouts = {
        name: piece.cutout
        for name, piece in zip(scene.names, pieces, strict=True)
        if piece.cutout is not None
    }
    if cutouts:
        scene = cut_out(Laid(scene, _ANY_PATH), cutouts).scene
    return scene


def _placed(views: tuple[Any, ...], world: NDArray[Any], origin: NDArray[Any]) -> Frame:
    placed = []
    for camera in views:
        plane = camera.clip_plane
        if plane is not None:
            # n . (R p + s) + d' = n0 . p + d for every p.
            normal = world[:3, :3] @ np.array(plane[:3])
            d = plane[3] - float(normal @ (world[:3, 3] + origin))
            plane = (float(normal[0]), float(normal[1]), float(normal[2]), d)
        pose = world @ camera.world_from_camera
        pose[:3, 3] += origin
        placed.append(replace(camera, world_from_camera=pose, clip_plane=plane))
    return Frame(tuple(placed))


def _posed(
    scene: Scene, frames: list[Frame], pieces: list[Piece], moving: Mapping[int, Part]
) -> tuple[Scene, CameraPath]:
    worlds: list[dict[str, Any]] = [{} for _ in frames]
    absent: list[list[str]] = [[] for _ in frames]
    grown: dict[int, NDArray[np.float32]] = {}
    starts = np.cumsum([0, *(len(piece.mesh[0]) for piece in pieces)])
    for index, part in moving.items():
        own = scene.vertices[starts[index] : starts[index + 1]].astype(np.float64)
        if not len(own) or pieces[index].cutout is not None:
            continue
        moves: Moves = _call(MOTIONS, part, own, len(frames))
        name = scene.names[index]
        if scene.origin.any() and moves.worlds:
            # A matrix of the path is of the world.
            there, here = np.eye(4), np.eye(4)
            there[:3, 3], here[:3, 3] = scene.origin, -scene.origin
            moves.worlds = [there @ one for one in moves.worlds]
        for number, one in enumerate(moves.worlds):
            worlds[number][name] = one
        for number, here_too in enumerate(moves.there):
            if not here_too:
                absent[number].append(name)
        if moves.grown is not None:
            grown[index] = moves.grown.astype(np.float32)
    posed = [
        replace(frame, world_from_object=of, absent=tuple(gone))
        for frame, of, gone in zip(frames, worlds, absent, strict=True)
    ]
    if grown:
        positions = [scene.vertices[a:b] for a, b in pairwise(starts)]
        scene = rigged(scene, positions, Bending(positions, grown))
        posed = [replace(frame, time_s=float(k)) for k, frame in enumerate(posed)]
    return scene, CameraPath(posed, "generated")
