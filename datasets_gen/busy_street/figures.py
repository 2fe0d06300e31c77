"""Walking figures: eleven joints, a skin over them, and a walk cycle."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from visref_datasets_gen.animated import AnimatedNode, Skin, SkinnedPrimitive, Track, at_place
from visref_datasets_gen.busy_street.houses import turned_by
from visref_datasets_gen.graph import Material, Mesh, Node
from visref_datasets_gen.shapes import Float64, Soup, icosphere, loft, ring, snap

# By name: the joint above, and where it is in the bind pose, metres; the figure looks along +z.
JOINTS: dict[str, tuple[str | None, tuple[float, float, float]]] = {
    "hips": (None, (0.0, 0.9375, 0.0)),
    "spine": ("hips", (0.0, 1.125, 0.0)),
    "head": ("spine", (0.0, 1.5, 0.0)),
    **{f"{name}-{side}": (above and above.replace("*", side), (sign * x, y, 0.0))
       for side, sign in (("left", 1.0), ("right", -1.0))
       for name, above, (x, y) in (
           ("shoulder", "spine", (0.21875, 1.40625)), ("elbow", "shoulder-*", (0.25, 1.125)),
           ("thigh", "hips", (0.09375, 0.90625)), ("knee", "thigh-*", (0.09375, 0.46875)))},
}  # fmt: skip
NUMBER = {name: index for index, name in enumerate(JOINTS)}
CYCLE_S = 1.0
KEYS_A_CYCLE = 8
STRIDE_M_S = 1.4
_SKIN, _TROUSERS = (0.55, 0.36, 0.26), (0.10, 0.12, 0.20)
_CLOTH = ((0.50, 0.12, 0.10), (0.12, 0.22, 0.42), (0.62, 0.56, 0.42), (0.10, 0.10, 0.11))


@dataclass(frozen=True)
class Walk:
    """`ways`: by time in seconds, where the figure is, metres, in between in a straight line.
    `phase`: of the walk cycle, 0 to 1. `standing`: arms and legs hang."""

    ways: tuple[tuple[float, tuple[float, float, float]], ...]
    phase: float = 0.0
    standing: bool = False


def figure(name: str, cloth: int, walk: Walk, clip_s: float) -> tuple[Node, Node]:
    """The skinned figure, and the joints that carry it."""
    joints: dict[str, Node] = {}
    for joint in reversed(JOINTS):
        above, place = JOINTS[joint]
        start = (0.0, 0.0, 0.0) if above is None else JOINTS[above][1]
        below = tuple(joints[other] for other, (parent, _) in JOINTS.items() if parent == joint)
        tracks = () if walk.standing else _swing(joint, walk.phase, clip_s)
        offset = np.subtract(place, start)
        joints[joint] = AnimatedNode(f"{name}/{joint}", None, at_place(offset), below, tracks)
    root = AnimatedNode(f"{name}/root", None, np.eye(4), (joints["hips"],), _going(walk))
    inverse = np.array([at_place(-np.array(place)) for _, place in JOINTS.values()])
    skin = Skin(tuple(joints[joint] for joint in JOINTS), inverse)
    return AnimatedNode(name, _body(cloth), skin=skin), root


def _going(walk: Walk) -> tuple[Track, ...]:
    """Along the way, turning towards the next part of it within a fifth of a second."""
    times = np.array([time for time, _ in walk.ways])
    places = np.array([place for _, place in walk.ways])
    steps = np.diff(places, axis=0)
    headings = [math.atan2(x, z) for x, _, z in steps.tolist()] or [0.0]
    keys, angles = [float(times[0])], [headings[0]]
    for time, old, new in zip(times[1:-1].tolist(), headings, headings[1:], strict=False):
        turn = (new - old + math.pi) % (2.0 * math.pi) - math.pi
        keys += [time - 0.1, time + 0.1]
        angles += [angles[-1], angles[-1] + turn]
    return (
        Track("translation", times, places),
        Track("rotation", np.array(keys), turned_by(angles)),
    )


def _swing(joint: str, phase: float, clip_s: float) -> tuple[Track, ...]:
    """One joint's part in the walk cycle: a turn about x."""
    kind, _, side = joint.partition("-")
    opposite = 0.5 if side == "right" else 0.0
    keys = round(clip_s * KEYS_A_CYCLE / CYCLE_S) + 1
    times = np.arange(keys, dtype=np.float64) * (CYCLE_S / KEYS_A_CYCLE)
    angles = 2.0 * math.pi * (times / CYCLE_S + phase + opposite)
    if kind == "thigh":
        turns = -0.45 * np.sin(angles)
    elif kind == "knee":
        turns = 0.15 + 0.45 * (1.0 + np.cos(angles)) / 2.0
    elif kind == "shoulder":
        turns = 0.4 * np.sin(angles)
    elif kind == "elbow":
        turns = -0.35 + 0.15 * np.sin(angles)
    else:
        return ()
    zero = np.zeros_like(turns)
    values = np.stack([np.sin(turns / 2.0), zero, zero, np.cos(turns / 2.0)], axis=1)
    return (Track("rotation", times, values),)


Weighted = tuple[Soup, list[tuple[str, str, float]]]


def _body(cloth: int) -> Mesh:
    """Limbs and trunk as tubes, whose rings near a joint belong to both of its sides."""
    trunk = _tube(
        [(0.92, 0.16, 0.11), (1.05, 0.14, 0.1), (1.3, 0.19, 0.12), (1.45, 0.12, 0.08)],
        0.0,
        [("hips", "hips", 0.0), ("hips", "spine", 0.5), ("spine", "spine", 0.0),
         ("spine", "spine", 0.0)],
    )  # fmt: skip
    arms, legs = [], []
    for side, sign in (("left", 1.0), ("right", -1.0)):
        upper, lower = f"shoulder-{side}", f"elbow-{side}"
        arms.append(
            _tube(
                [(0.82, 0.045, 0.045), (1.0, 0.05, 0.05), (1.125, 0.05, 0.05), (1.25, 0.055, 0.055),
                 (1.42, 0.06, 0.06)],
                sign * 0.24,
                [(lower, lower, 0.0)] * 2 + [(lower, upper, 0.5)] + [(upper, upper, 0.0)] * 2,
            )
        )  # fmt: skip
        upper, lower = f"thigh-{side}", f"knee-{side}"
        legs.append(
            _tube(
                [(0.0, 0.09, 0.12), (0.1, 0.06, 0.06), (0.36, 0.07, 0.07), (0.47, 0.07, 0.07),
                 (0.58, 0.08, 0.08), (0.92, 0.1, 0.1)],
                sign * 0.094,
                [(lower, lower, 0.0)] * 2 + [(lower, upper, 0.25), (lower, upper, 0.5),
                 (lower, upper, 0.75), (upper, "hips", 0.25)],
            )
        )  # fmt: skip
    vertices, faces = icosphere(1)
    head: Weighted = (
        (vertices * [0.105, 0.14, 0.115] + [0.0, 1.62, 0.01], faces),
        [("head", "head", 0.0)] * len(vertices),
    )
    colour = _CLOTH[cloth % len(_CLOTH)]
    return Mesh(
        f"figure-{cloth % len(_CLOTH)}",
        (
            _primitive([trunk, *arms], Material(f"cloth-{cloth % len(_CLOTH)}", (*colour, 1.0))),
            _primitive(legs, Material("trousers", (*_TROUSERS, 1.0))),
            _primitive([head], Material("skin", (*_SKIN, 1.0))),
        ),
    )


def _tube(
    rings: Sequence[tuple[float, float, float]], x: float, owners: list[tuple[str, str, float]]
) -> Weighted:
    """Rings of a height and two radii about (x, z = 0), and each one's two joints with the share
    of the second."""
    circle = ring(1.0, 8, phase=0.5)
    stations = [
        np.stack([x + a * circle[:, 0], np.full(8, y), -b * circle[:, 1]], axis=1)
        for y, a, b in rings
    ]
    soup = loft(np.array(stations))
    # `loft` adds the caps' vertices: the first ring's and the last ring's.
    of_ring = [*range(len(rings)), 0, len(rings) - 1]
    return soup, [owners[k] for k in of_ring for _ in range(8)]


def _primitive(parts: Sequence[Weighted], material: Material) -> SkinnedPrimitive:
    vertices: list[Float64] = []
    faces, joints, weights, base = [], [], [], 0
    for (points, triangles), owners in parts:
        vertices.append(points)
        faces.append(triangles + base)
        base += len(points)
        for first, second, share in owners:
            joints.append([NUMBER[first], NUMBER[second] if share else 0, 0, 0])
            weights.append([1.0 - share, share, 0.0, 0.0])
    return SkinnedPrimitive(
        snap(np.concatenate(vertices)).astype(np.float32),
        np.concatenate(faces).astype(np.uint32),
        material,
        joints=np.array(joints, np.uint8),
        weights=np.array(weights, np.float32),
    )
