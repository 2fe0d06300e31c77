"""The busy street: two rows of houses along x, from x = 0, and what goes on between them."""

from __future__ import annotations

import math

import numpy as np

from visref.errors import InputError
from visref_datasets_gen.animated import VISIBLE, AnimatedDataset, AnimatedNode, Track, at_place
from visref_datasets_gen.busy_street.figures import STRIDE_M_S, Walk, figure
from visref_datasets_gen.busy_street.houses import SHAFT_M, STOREY_M, HouseMaker, lift, turned_by
from visref_datasets_gen.busy_street.trees import tree, tree_mesh
from visref_datasets_gen.busy_street.walk import CLIP_S, EYE_M, Shots, path_of
from visref_datasets_gen.furniture import mesh as furnished
from visref_datasets_gen.graph import Node
from visref_datasets_gen.shapes import (
    Float64,
    Soup,
    box,
    boxes,
    icosphere,
    lathe,
    merge,
    moved,
    snap,
)
from visref_datasets_gen.stock import Stock, placed, plain

PITCH_M = 12.0
FRONT_M, KERB_M = 8.5, 5.0
PAVEMENT_M = 0.125
HOUSES_AT_SCALE_1 = 5
SEDAN, VAN = "sedan", "van"


def busy_street(
    *, seed: int = 0, scale: float = 1.0, frames: int = 120, views: str = "mono"
) -> AnimatedDataset:
    """Ten houses at scale 1, and in proportion to `scale`, ten seconds of what goes on in front of
    them. `views` of a frame: mono (1280 by 960), stereo (two of 960 by 960), or the six of a cube
    map (512 by 512). Raises InputError for a scale, a number of frames, or views that make none.
    """
    if not 0.0 < scale <= 20.0:
        raise InputError(f"the scale is {scale}", place="scale", fix="give more than 0, at most 20")
    maker = _Street(seed, max(2, round(HOUSES_AT_SCALE_1 * scale)))
    nodes = (
        *maker.ground(),
        *maker.houses(),
        *maker.lift(),
        *maker.cars(),
        *maker.walkers(),
        *maker.trees(),
        *maker.furniture(),
        *maker.towers(),
        Node("drone", plain("drone", {"metal": _drone()})[0], at_place(maker.drone(0.0))),
    )
    return AnimatedDataset("busy_street", "street", nodes, path_of(maker.shots(), frames, views))


class _Street:
    def __init__(self, seed: int, columns: int) -> None:
        self.rng = np.random.Generator(np.random.PCG64(seed))
        self.stock = Stock(seed)
        self.columns = columns
        self.length = columns * PITCH_M
        self.levels: dict[str, tuple[Float64, tuple[float, ...]]] = {}

    def ground(self) -> list[Node]:
        end = self.length + 14.0
        road = box([-14.0, 0.0, -KERB_M], [end, 0.0, KERB_M], "Y")
        dashes = np.arange(-12.0, end - 4.0, 6.0)
        low = np.stack([dashes, np.full_like(dashes, 0.01), np.full_like(dashes, -0.08)], axis=1)
        marks = boxes(low, np.add(low, (3.0, 0.0, 0.16)), "Y")
        low_x, high_x = [-14.0, 0.0], [end, PAVEMENT_M]
        slabs = boxes(
            [[*low_x, -FRONT_M - 10.0], [*low_x, KERB_M]],
            [[*high_x, -KERB_M], [*high_x, FRONT_M + 10.0]],
            "xXYzZ",
        )
        earth = box([-150.0, -0.06, -150.0], [self.length + 150.0, -0.06, 150.0], "Y")
        return [
            placed(name, plain(name, parts), (0.0, 0.0, 0.0))
            for name, parts in (
                ("road", {"asphalt": road, "marking": marks}),
                ("pavements", {"pavement": slabs}),
                ("ground", {"earth": earth}),
            )
        ]

    def _fronts(self) -> list[tuple[str, float, int]]:
        """Each house's name, the x of its door, and its side: 0 looks along +z, 2 along -z."""
        return [
            (f"house-{'north' if turns == 0 else 'south'}-{k}", (k + 0.5) * PITCH_M, turns)
            for turns in (0, 2)
            for k in range(self.columns)
        ]

    def houses(self) -> list[Node]:
        maker = HouseMaker(self.rng)
        nodes = []
        for name, x, turns in self._fronts():
            start = float(self.rng.uniform(0.2, 5.0))
            times = (start, start + float(self.rng.uniform(2.0, 4.0)))
            if name == "house-north-0":
                times = (3.75, 6.5)  # as the second shot looks out of it
            at = (x, PAVEMENT_M, -FRONT_M if turns == 0 else FRONT_M)
            body = placed(name, (plain(f"{name}/step", {"trim": _STEP})[0],), at, turns)
            children = maker.house(name, times)
            nodes.append(Node(body.name, body.mesh, body.parent_from_node, children))
        return nodes

    def lift(self) -> list[Node]:
        stops = ((0.0, 0), (1.0, 0), (3.0, 2), (6.0, 2), (7.5, 1), (10.0, 1))
        # In a tower beside the last northern house, where the third shot looks.
        inside = Walk(((0.0, (0.0, 0.06, -1.2)), (CLIP_S, (0.0, 0.06, -1.125))), standing=True)
        rider, joints = figure("rider", 2, inside, CLIP_S)
        tower = lift("lift", stops, (joints,))
        at = snap([self.length + SHAFT_M / 2 + 0.5, PAVEMENT_M, -FRONT_M])
        return [Node(tower.name, tower.mesh, at_place(at), tower.children), rider]

    def cars(self) -> list[Node]:
        """Traffic keeps right: along +x at z > 0."""
        end = self.length
        plans = [
            # One through the street, each way; one that brakes for the crossing figure, and goes
            # on; one that turns into the street.
            (SEDAN, self._straight(-20.0, end + 20.0, 2.5, 1.0)),
            ("hatchback", self._straight(end + 10.0, -30.0, -2.5, -1.0)),
            (VAN, self._braking(2.5)),
            ("hatchback", self._turning()),
        ]
        nodes: list[Node] = []
        for k, (kind, tracks) in enumerate(plans):
            body = placed(f"car-{k}/body", self.stock.prop(kind, k), (0.0, 0.0, 0.0), 1)
            nodes.append(AnimatedNode(f"car-{k}", None, np.eye(4), (body,), tracks))
        for k in range(2 * self.columns):
            side = 1.0 if k % 2 else -1.0
            x = (k + 0.5) * PITCH_M / 2.0 + float(self.rng.uniform(-1.0, 1.0))
            if self.rng.random() < 0.5:
                mesh = self.stock.prop(SEDAN, int(self.rng.integers(6)))
                nodes.append(
                    placed(f"parked-{k}", mesh, (x, 0.0, side * 4.0), 1 if side > 0 else 3)
                )
        return nodes

    def _straight(self, start: float, end: float, z: float, way: float) -> tuple[Track, ...]:
        turn = Track("rotation", np.zeros(1), turned_by([0.0 if way > 0 else math.pi]))
        ends = np.array([[start, 0.0, z], [end, 0.0, z]])
        return Track("translation", np.array([0.0, CLIP_S]), ends), turn

    def _braking(self, z: float) -> tuple[Track, ...]:
        """A cubic spline: at 9 m/s, down to a stop before the middle, and on."""
        stop = self.length / 2.0 - 4.0
        places = [stop - 24.0, stop, stop, stop + 20.0]
        speeds = [9.0, 0.0, 0.0, 9.0]
        values = np.zeros((4, 3, 3))
        values[:, 1] = [[x, 0.0, z] for x in places]
        values[:, 0, 0] = values[:, 2, 0] = speeds
        return (Track("translation", np.array([0.0, 4.0, 6.0, CLIP_S]), values, "CUBICSPLINE"),)

    def _turning(self) -> tuple[Track, ...]:
        """Round the corner at the far end, into the near lane."""
        x = self.length + 10.0
        places = [[x, 0.0, -30.0], [x, 0.0, -6.0], [x - 3.5, 0.0, -2.5], [x - 30.0, 0.0, -2.5]]
        times = np.array([0.0, 4.0, 5.0, CLIP_S])
        # Along -z to -x is a turn about y from 90 to 180 degrees; it comes along +z.
        turns = turned_by([-math.pi / 2, -math.pi / 2, -math.pi, -math.pi])
        return (
            Track("translation", times, np.array(places)),
            Track("rotation", times, turns),
        )

    def walkers(self) -> list[Node]:
        y, far = PAVEMENT_M, CLIP_S * STRIDE_M_S
        nodes: list[Node] = []
        door = PITCH_M / 2.0
        middle = self.length / 2.0
        walks = {
            # Out of the first house, whose door opens, and along the pavement.
            "visitor": (
                (0.0, (door, y + 0.02, -FRONT_M - 3.5)),
                (4.25, (door, y + 0.02, -FRONT_M - 3.0)),
                (7.0, (door, y + 0.02, -FRONT_M + 1.5)),
                (CLIP_S, (door + 4.0, y + 0.02, -FRONT_M + 1.5)),
            ),
            # Across the street, before the van that stops.
            "crossing": (
                (0.0, (middle - 4.0, y, KERB_M + 1.5)),
                (2.5, (middle, y, KERB_M + 1.0)),
                (3.0, (middle, 0.0, KERB_M - 0.5)),
                (8.5, (middle, 0.0, -KERB_M + 0.5)),
                (9.0, (middle, y, -KERB_M - 0.5)),
                (CLIP_S, (middle + 1.5, y, -KERB_M - 1.5)),
            ),
            # Behind the lift's tower, round its corner.
            "corner": (
                (0.0, (self.length + 0.25, y, -FRONT_M - 6.0)),
                (4.5, (self.length + 0.25, y, -FRONT_M - 3.0)),
                (6.5, (self.length + 4.0, y, -FRONT_M - 3.0)),
                (CLIP_S, (self.length + 4.5, y, -FRONT_M + 2.0)),
            ),
        }
        for k in range(2 * self.columns - 2):
            side = 1.0 if k % 2 else -1.0
            way = 1.0 if self.rng.random() < 0.5 else -1.0
            x = float(self.rng.uniform(0.0, self.length))
            z = side * (KERB_M + float(self.rng.uniform(0.6, 2.6)))
            walks[f"walker-{k}"] = ((0.0, (x, y, z)), (CLIP_S, (x + way * far, y, z)))
        for k, (name, ways) in enumerate(walks.items()):
            nodes += figure(name, k, Walk(ways, phase=(k % 4) / 4.0), CLIP_S)
        return nodes

    def trees(self) -> list[Node]:
        mesh = tree_mesh(self.rng)
        places = [
            (k * PITCH_M, PAVEMENT_M, side * (KERB_M + 0.75))
            for k in range(1, self.columns)
            for side in (-1.0, 1.0)
        ]
        return [tree(self.rng, f"tree-{k}", mesh, at, CLIP_S) for k, at in enumerate(places)]

    def furniture(self) -> list[Node]:
        """What stands about, of which some appears and some vanishes."""
        nodes: list[Node] = []
        for k in range(self.columns):
            x, side = (k + 0.25) * PITCH_M, 1.0 if k % 2 else -1.0
            turns = 2 if side < 0 else 0
            kind = ("lamp", "bench", "hydrant", "bin")[k % 4]
            at = (x, PAVEMENT_M, -side * (KERB_M + 0.6))
            nodes.append(placed(f"{kind}-{k}", self.stock.prop(kind), at, turns))
        shelter = (0.75 * PITCH_M, PAVEMENT_M, -KERB_M - 1.0)
        nodes.append(placed("shelter", self.stock.prop("shelter"), shelter, 0))
        lorry = plain("lorry", {"paint": _lorry()})[0]
        stall = plain("stall", {"awning": _stall(), "bark": _counter()})[0]
        parcels = plain("parcels", {"bark": _parcels()})[0]
        middle = self.length / 2.0
        for name, mesh, at, times, shown in (
            # A stall is put up, and taken away; a lorry goes out of the picture; parcels come.
            ("stall", stall, (middle + 5.0, PAVEMENT_M, -KERB_M - 1.75), (0.0, 1.5, 8.0),
             (0, 1, 0)),
            ("lorry", lorry, (1.5 * PITCH_M, 0.0, 3.75), (0.0, 2.25), (1, 0)),
            ("parcels", parcels, (PITCH_M / 2 + 1.5, PAVEMENT_M, -FRONT_M + 0.5), (0.0, 5.5),
             (0, 1)),
        ):  # fmt: skip
            values = np.array(shown, np.float64).reshape(-1, 1)
            track = Track(VISIBLE, np.array(times), values, "STEP")
            nodes.append(
                AnimatedNode(
                    name, mesh, at_place(snap(at)), tracks=(track,), visible=bool(shown[0])
                )
            )
        return nodes

    def towers(self) -> list[Node]:
        """What closes the street's ends, and a statue: each with levels of detail."""
        nodes: list[Node] = []
        for name, x, turns in (("tower-west", -32.0, 1), ("tower-east", self.length + 34.0, 3)):
            meshes, depth, _ = self.stock.building("office", 24, 0, turns)
            fine = placed(name, meshes, (x, 0.0, 0.0), turns)
            top = max(float(p.vertices[:, 1].max()) for p in meshes[0].primitives)
            block = box([-11.875, 0.0, -depth / 2], [11.875, top, depth / 2], "xXYzZ")
            coarse = placed(
                f"{name}-block", plain(f"{name}-block", {"wall": block}), (x, 0, 0), turns
            )
            nodes.append(
                AnimatedNode(fine.name, fine.mesh, fine.parent_from_node, fine.children,
                             levels=(coarse,))
            )  # fmt: skip
            self.levels[name] = np.array([x, EYE_M, 0.0]), (60.0,)
        at = snap([self.length + 5.0, PAVEMENT_M, FRONT_M + 1.0])
        levels = [
            Node(f"statue-{k}" if k else "statue", furnished("statue", {"clay": _statue(k)}),
                 at_place(at))
            for k in range(3)
        ]  # fmt: skip
        statue = levels[0]
        nodes.append(
            AnimatedNode(statue.name, statue.mesh, statue.parent_from_node,
                         levels=tuple(levels[1:]))
        )  # fmt: skip
        self.levels["statue"] = at, (15.0, 40.0)
        return nodes

    def drone(self, time_s: float) -> Float64:
        """Across the street and round, where a program puts it."""
        angle = 2.0 * math.pi * time_s / CLIP_S
        return np.array(
            [self.length / 2.0 + 9.0 * math.sin(angle), 4.0 + math.sin(3.0 * angle),
             6.0 * math.cos(angle)]
        )  # fmt: skip

    def shots(self) -> Shots:
        """Along the northern pavement; out of the first house; past the lift's corner."""
        end, door = self.length, PITCH_M / 2.0

        def pavement(time_s: float) -> tuple[Float64, Float64]:
            eye = np.array([1.0 + 2.0 * time_s, EYE_M + PAVEMENT_M, -KERB_M - 2.0])
            aside = 0.9 * math.sin(1.1 * time_s)
            return eye, np.add(eye, (math.cos(aside), -0.02, math.sin(aside)))

        def indoors(time_s: float) -> tuple[Float64, Float64]:
            out = (time_s - CLIP_S / 3.0) / (CLIP_S / 3.0)
            eye = np.array([door + 1.2, EYE_M, -FRONT_M - 6.0 + 1.5 * out])
            return eye, np.array([door, 1.4, -FRONT_M])

        def corner(time_s: float) -> tuple[Float64, Float64]:
            along = (time_s - 2.0 * CLIP_S / 3.0) / (CLIP_S / 3.0)
            eye = np.array([end - 5.0 + 9.0 * along, EYE_M + PAVEMENT_M, KERB_M - 0.5])
            return eye, np.array([end + 1.5, STOREY_M, -FRONT_M])

        return Shots(
            (0.0, CLIP_S / 3.0, 2.0 * CLIP_S / 3.0),
            (pavement, indoors, corner),
            self.levels,
            [("shelter", 2.0, 7.5), (f"tree-{2 * self.columns - 3}", 0.0, 7.0)],
            self.drone,
        )


_STEP = box([-0.75, -PAVEMENT_M, 0.0], [0.75, 0.0, 0.25])


def _lorry() -> Soup:
    lows = [[-3.0, 0.5, -1.1], [3.1, 0.5, -1.0], [-2.8, 0.0, -1.0]]
    return boxes(lows, [[3.0, 3.2, 1.1], [4.6, 2.4, 1.0], [4.4, 0.5, 1.0]])


def _stall() -> Soup:
    """A roof and a back."""
    return boxes([[-1.5, 2.2, -1.2], [-1.5, 0.9, -1.2]], [[1.5, 2.26, 1.2], [1.5, 2.2, -1.16]])


def _counter() -> Soup:
    legs = [box([x, 0.0, z], [x + 0.06, 2.2, z + 0.06]) for x in (-1.5, 1.44) for z in (-1.2, 1.14)]
    return merge([box([-1.5, 0.0, 0.6], [1.5, 0.95, 1.0]), *legs])


def _parcels() -> Soup:
    return boxes([[-0.4, 0.0, -0.3], [-0.25, 0.5, -0.25]], [[0.4, 0.5, 0.3], [0.3, 0.9, 0.2]])


def _statue(level: int) -> Soup:
    """A ball on a stem on a plinth, of fewer triangles by level."""
    vertices, faces = icosphere(3 - level)
    ball = moved((vertices * 0.9, faces), (0.0, 2.6, 0.0))
    stem = lathe([(0.5, 1.0), (0.3, 1.4), (0.3, 1.8)], 8 * (3 - level))
    return merge([box([-0.8, 0.0, -0.8], [0.8, 1.0, 0.8]), ball, stem])


def _drone() -> Soup:
    lows = [[-0.5, -0.03, -0.03], [-0.03, -0.03, -0.5], [-0.15, -0.1, -0.15]]
    return boxes(lows, -np.array(lows))
