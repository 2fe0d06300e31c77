"""Triangles of a polygon cover what the polygon covers, once, in every format that has polygons."""

from __future__ import annotations

import math
import struct
from fractions import Fraction

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from visref.camera import Camera, look_at
from visref.engines import make_engine
from visref.errors import InputError
from visref.formats import load_scene
from visref.formats.polygons import triangulated
from visref.visibility import objects_seen

Point = tuple[int, int]

SQUARE = [(0, 0), (4, 0), (4, 4), (0, 4)]
# Eight corners, four of them turned inwards: a square of side 20 less four triangles of 20 by 6.
STAR = [(0, 0), (10, 6), (20, 0), (14, 10), (20, 20), (10, 14), (0, 20), (6, 10)]
# A wall 10 by 4 with a doorway 1.2 by 2.2, in fifths.
DOOR = [(0, 0), (22, 0), (22, 11), (28, 11), (28, 0), (50, 0), (50, 20), (0, 20)]
# A square with a square hole, joined by a cut that is walked twice.
KEYHOLE = [(0, 0), (9, 0), (9, 9), (0, 9), (0, 0), (3, 3), (3, 6), (6, 6), (6, 3), (3, 3)]
# Corners on straight edges, some of them several in a row.
LEVEL = [(0, 0), (2, 0), (5, 0), (6, 0), (6, 6), (4, 6), (3, 3), (2, 6), (0, 6), (0, 3)]
SPIKE = [(0, 0), (6, 0), (6, 3), (9, 3), (6, 3), (6, 6), (3, 1), (0, 6)]
SPIRAL = [(0, 0), (9, 0), (9, 9), (2, 9), (2, 4), (5, 4), (5, 6), (4, 6), (4, 8), (8, 8), (8, 2)]
SPIRAL += [(0, 2)]
SIMPLE = {
    "square": (SQUARE, 16),
    "star": (STAR, 160),
    "door": (DOOR, 934),
    "keyhole": (KEYHOLE, 72),
    "level": (LEVEL, 33),
    "spike": (SPIKE, 21),
    "dart": ([(0, 0), (4, 4), (8, 0), (4, 10)], 24),
    "twice": ([(0, 0), (4, 0), (4, 0), (4, 4), (0, 4)], 16),
    "arrow": ([(4, 10), (0, 0), (4, 4), (8, 0)], 24),
}
CROSSED = {
    "figure of eight": [(0, 0), (4, 4), (4, 0), (0, 4)],
    "lopsided eight": [(0, 0), (4, 4), (4, 1), (0, 3)],
    "pentagram": [(0, 10), (6, -8), (-9, 3), (9, 3), (-6, -8)],
    "crossed wall": [(0, 0), (10, 0), (10, 10), (5, -5), (0, 10)],
}


def one(points: np.ndarray) -> np.ndarray:
    """The triangles of a single polygon, (n - 2, 3)."""
    count = len(points)
    triangles, owner = triangulated(
        points, np.arange(count), np.array([count]), lambda polygon: f"polygon {polygon}"
    )
    assert owner.tolist() == [0] * (count - 2)
    assert triangles.shape == (count - 2, 3)
    return triangles


def twice_area(a: Point, b: Point, c: Point) -> int:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def placed(corners: list[Point], lift: tuple[int, int], order: tuple[int, int, int]) -> np.ndarray:
    """The polygon in space, on a plane over its own two axes; every coordinate an integer."""
    flat = np.array(corners, np.float64)
    space = np.column_stack([flat, flat @ np.array(lift, np.float64)])
    return space[:, order]


@pytest.mark.parametrize("order", [(0, 1, 2), (1, 2, 0), (2, 0, 1), (1, 0, 2)])
@pytest.mark.parametrize("lift", [(0, 0), (1, -2), (7, 3)])
@pytest.mark.parametrize("turn", [0, 1, 3])
@pytest.mark.parametrize("name", SIMPLE)
def test_areas_of_the_triangles_add_up_to_the_closed_form(name, turn, lift, order):
    corners, area = SIMPLE[name]
    corners = corners[turn:] + corners[:turn]
    triangles = one(placed(corners, lift, order))
    signed = [twice_area(*(corners[i] for i in row)) for row in triangles.tolist()]
    # None turned over, and so none overlaps another.
    assert min(signed) >= 0
    assert sum(signed) == 2 * area
    # Every corner is used, those on a straight edge too: neighbours have them.
    assert set(triangles.ravel().tolist()) == set(range(len(corners)))


def test_winding_is_the_polygons_own():
    corners, area = SIMPLE["star"]
    backwards = corners[::-1]
    rows = one(placed(backwards, (0, 0), (0, 1, 2))).tolist()
    signed = [twice_area(*(backwards[i] for i in row)) for row in rows]
    assert max(signed) <= 0
    assert sum(signed) == -2 * area


@pytest.mark.parametrize("turn", [0, 1, 2])
@pytest.mark.parametrize("name", CROSSED)
def test_a_polygon_that_crosses_itself_is_refused(name, turn):
    corners = CROSSED[name]
    with pytest.raises(InputError, match=r"polygon 0: the polygon of \d corners crosses itself"):
        one(placed(corners[turn:] + corners[:turn], (1, 2), (2, 0, 1)))


@pytest.mark.parametrize("corners", [[(0, 0)] * 5, [(0, 0), (1, 1), (3, 3), (2, 2), (5, 5)]])
def test_a_polygon_without_area_has_triangles_without_area(corners):
    rows = one(placed(corners, (0, 1), (0, 1, 2))).tolist()
    assert [twice_area(*(corners[i] for i in row)) for row in rows] == [0] * 3


def test_a_bent_quad_is_cut_where_its_projection_is_not_turned_over():
    # Seen along its normal corner 2 turns inwards, whatever it does in depth.
    points = np.array([[0, 0, 0], [10, 0, 1], [3, 3, -1], [0, 10, 1]], np.float64)
    assert {frozenset(row) for row in one(points).tolist()} == {
        frozenset((0, 1, 2)),
        frozenset((0, 2, 3)),
    }
    points = np.roll(points, 1, axis=0)
    assert {frozenset(row) for row in one(points).tolist()} == {
        frozenset((0, 1, 3)),
        frozenset((1, 2, 3)),
    }


def test_far_from_the_origin_and_tiny_is_no_reason_to_refuse():
    for scale, shift in ((1e-6, 0.0), (1.0, 1e7), (1e-3, 5e5), (1e8, 1e9)):
        points = placed(STAR, (1, -2), (1, 2, 0)) * scale + shift
        triangles = one(points)
        sides = points[triangles[:, 1:]] - points[triangles[:, :1]]
        area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]).sum(axis=0)) / 2.0
        assert area == pytest.approx(160 * math.sqrt(6.0) * scale**2, rel=1e-2)


def inside(point: tuple[Fraction, Fraction], corners: list[Point]) -> bool:
    """By counting the edges that a ray towards +x crosses, in exact numbers."""
    x, y = point
    crossed = 0
    for (ax, ay), (bx, by) in zip(corners, corners[1:] + corners[:1], strict=True):
        if (ay > y) != (by > y):
            crossed += ax + (y - ay) * Fraction(bx - ax, by - ay) > x
    return crossed % 2 == 1


def covering(point: tuple[Fraction, Fraction], corners: list[Point], triangles: list) -> int:
    def left(a: Point, b: Point) -> bool:
        return (b[0] - a[0]) * (point[1] - a[1]) > (b[1] - a[1]) * (point[0] - a[0])

    count = 0
    for row in triangles:
        a, b, c = (corners[i] for i in row)
        count += left(a, b) and left(b, c) and left(c, a)
    return count


@settings(max_examples=60, deadline=None)
@given(
    radii=st.lists(st.integers(3, 40), min_size=5, max_size=14),
    seed=st.integers(0, 2**16),
    lift=st.tuples(st.integers(-3, 3), st.integers(-3, 3)),
)
def test_every_point_inside_is_covered_once_and_none_outside(radii, seed, lift):
    """Polygons that see all of themselves from the middle, which is no corner."""
    count = len(radii)
    corners = []
    for k, radius in enumerate(radii):
        angle = 2.0 * math.pi * k / count
        corners.append((round(radius * math.cos(angle)), round(radius * math.sin(angle))))
    triangles = one(placed(corners, lift, (0, 1, 2))).tolist()
    rng = np.random.default_rng(seed)
    for x, y in rng.integers(-40, 40, (40, 2)).tolist():
        # Off every line through two corners: their coordinates are whole and below 41.
        point = x + Fraction(1, 9973), y + Fraction(1, 7919)
        assert covering(point, corners, triangles) == inside(point, corners)


def test_many_polygons_at_once_are_what_they_are_one_by_one():
    polygons = [corners for corners, _ in SIMPLE.values()] * 3 + [[(0, 0), (1, 0)], [(5, 5)], []]
    polygons += [[(0, 0), (1, 0), (0, 1)]]
    points = np.concatenate([placed(p, (1, 1), (0, 1, 2)) for p in polygons if p])
    counts = np.array([len(p) for p in polygons])
    triangles, owner = triangulated(points, np.arange(len(points)), counts, str)
    assert (np.diff(owner) >= 0).all()
    starts = np.cumsum(counts) - counts
    for index, polygon in enumerate(polygons):
        mine = triangles[owner == index] - starts[index]
        if len(polygon) < 3:
            assert len(mine) == 0
        else:
            assert mine.tolist() == one(placed(polygon, (1, 1), (0, 1, 2))).tolist()


def test_a_spiral_of_one_turn_is_no_crossing():
    rows = one(placed(SPIRAL, (0, 0), (0, 1, 2))).tolist()
    signed = [twice_area(*(SPIRAL[i] for i in row)) for row in rows]
    shoelace = sum(
        a[0] * b[1] - a[1] * b[0] for a, b in zip(SPIRAL, SPIRAL[1:] + SPIRAL[:1], strict=True)
    )
    assert min(signed) >= 0
    assert sum(signed) == shoelace > 0


def test_polygons_with_a_vertex_that_is_not_finite_are_left_to_be_refused():
    points = placed(STAR, (0, 0), (0, 1, 2))
    points[3, 0] = np.nan
    assert one(points).shape == (6, 3)


# The formats. Two polygons, so that lists differ in length: the star, and a triangle beside it.


def star_vertices() -> list[tuple[float, float, float]]:
    return [(x, y, 0) for x, y in STAR] + [(30, 0, 0), (40, 0, 0), (30, 10, 0)]


FACES = [list(range(8)), [8, 9, 10]]


def obj() -> bytes:
    lines = ["v {} {} {}".format(*v) for v in star_vertices()]
    lines += ["f " + " ".join(str(i + 1) for i in face) for face in FACES]
    return "\n".join(lines).encode()


def off() -> bytes:
    lines = ["COFF # colours", "# none", f"{len(star_vertices())} 2 0"]
    lines += ["{} {} {} 0.5 0.5 0.5 1".format(*v) for v in star_vertices()]
    lines += [f"{len(face)} " + " ".join(map(str, face)) + " 0.1 0.2 0.3" for face in FACES]
    return "\n".join(lines).encode()


def ply_header(form: str, faces: int, index: str = "vertex_indices") -> str:
    return (
        f"ply\nformat {form} 1.0\ncomment a star\nelement vertex 11\nproperty float x\n"
        "property uchar red\nproperty double y\nproperty float z\n"
        f"element face {faces}\nproperty uchar flag\nproperty list uchar int {index}\n"
        "property list uchar float texcoord\nend_header\n"
    )


def ply_ascii() -> bytes:
    lines = [f"{x} 7 {y} {z}" for x, y, z in star_vertices()]
    lines += [f"1 {len(face)} " + " ".join(map(str, face)) + " 2 0.5 0.5" for face in FACES]
    return (ply_header("ascii", 2, "vertex_index") + "\n".join(lines)).encode()


def ply_binary(order: str) -> bytes:
    form = {"<": "binary_little_endian", ">": "binary_big_endian"}[order]
    body = b"".join(struct.pack(order + "fBdf", x, 7, y, z) for x, y, z in star_vertices())
    for face in FACES:
        body += struct.pack(f"{order}BB{len(face)}iB2f", 1, len(face), *face, 2, 0.5, 0.5)
    return ply_header(form, 2).encode() + body


FILES = {
    "a.obj": obj,
    "a.off": off,
    "ascii.ply": ply_ascii,
    "little.ply": lambda: ply_binary("<"),
    "big.ply": lambda: ply_binary(">"),
}


@pytest.mark.parametrize("name", FILES)
def test_a_star_has_its_area_in_every_format(tmp_path, name):
    (tmp_path / name).write_bytes(FILES[name]())
    scene = load_scene(tmp_path / name)
    corners = scene.vertices[scene.triangles].astype(np.float64)
    twice = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert twice[:, :2].tolist() == [[0, 0]] * 7
    assert (twice[:, 2] > 0).all()
    assert twice[:, 2].sum() / 2 == 160 + 50
    assert scene.names == (("object",) if name == "a.obj" else (name,))


def test_who_stands_in_the_doorway_of_a_wall_of_one_polygon_is_seen(tmp_path):
    """A wall 10 by 4 m with a doorway; a square of 0.5 m stands behind the middle of it, one of
    the same size behind the wall. At 20 samples per metre the first owns 10 by 10."""
    text = "".join(f"v {x / 5 - 5} {y / 5} 0\n" for x, y in DOOR) + "o wall\nf 1 2 3 4 5 6 7 8\n"
    for name, x in (("seen", -0.25), ("hidden", 1.0)):
        corners = ((x, 1.0), (x + 0.5, 1.0), (x + 0.5, 1.5), (x, 1.5))
        text += "".join(f"v {a} {b} -1\n" for a, b in corners) + f"o {name}\nf -4 -3 -2 -1\n"
    (tmp_path / "house.obj").write_text(text)
    scene = load_scene(tmp_path / "house.obj")
    camera = Camera(look_at((0.01, 2.01, 5), (0.01, 2.01, 0)), 180, 70, near=0.1, ymag=1.75)
    seen = objects_seen(make_engine("exact", scene).frame(camera), scene)
    # The view is 9 by 3.5 m, from y = 0.26 up: 24 by 39 samples of it are the doorway.
    owned = dict(zip(scene.names, seen.samples.tolist(), strict=True))
    assert owned == {"wall": 180 * 70 - 24 * 39, "seen": 100, "hidden": 0}


# OBJ announces no counts: a part of it is a file.
@pytest.mark.parametrize("name", [name for name in FILES if name != "a.obj"])
def test_a_file_cut_anywhere_behind_its_header_is_refused(tmp_path, name):
    """Of text only whole words are cut off: a number may be cut to another number."""
    whole = FILES[name]()
    (tmp_path / name).write_bytes(whole)
    load_scene(tmp_path / name)
    start = (
        whole.index(b"end_header\n") + 11 if b"end_header" in whole else whole.index(b" 2 0\n") + 4
    )
    if name in ("little.ply", "big.ply"):
        cuts = [*range(start + 1, len(whole), 7), len(whole) - 1]
    else:
        # What stands behind an OFF face's corners is no geometry.
        last = whole.rindex(b"10") if name == "a.off" else len(whole)
        cuts = [k for k in range(start, last) if whole[k : k + 1].isspace()]
    for cut in cuts:
        (tmp_path / name).write_bytes(whole[:cut])
        with pytest.raises(InputError, match=r"truncated|too few|no triangle|empty"):
            load_scene(tmp_path / name)


def test_a_crossed_polygon_is_named_by_its_place_in_the_file(tmp_path):
    crossed = "0 0 0\n4 4 0\n4 0 0\n0 4 0\n"
    (tmp_path / "a.off").write_text(f"OFF\n4 2 0\n{crossed}3 0 1 2\n4 0 1 2 3\n")
    with pytest.raises(InputError, match=r"a\.off: face 1: the polygon of 4 corners crosses"):
        load_scene(tmp_path / "a.off")
    vertices = "".join(f"v {line}\n" for line in crossed.splitlines())
    (tmp_path / "a.obj").write_text(f"{vertices}f 1 2 3\n\nf 1 2 3 4\n")
    with pytest.raises(InputError, match=r"a\.obj: line 7: the polygon of 4 corners crosses"):
        load_scene(tmp_path / "a.obj")


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_ply_and_off_give_what_an_independent_reader_gives(tmp_path, encoding):
    mesh = trimesh.creation.icosphere(subdivisions=2)
    mesh.export(tmp_path / "a.ply", encoding=encoding)
    mesh.export(tmp_path / "a.off")
    for name in ("a.ply", "a.off"):
        ours = load_scene(tmp_path / name)
        theirs = trimesh.load(tmp_path / name, process=False)
        assert np.array_equal(ours.triangles, theirs.faces)
        assert np.array_equal(ours.vertices, theirs.vertices.astype(np.float32))


def test_ply_strips_are_triangles_each_turned_as_the_first(tmp_path):
    header = "ply\nformat ascii 1.0\nelement vertex 6\n" + "".join(
        f"property float {axis}\n" for axis in "xyz"
    )
    text = header + "element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    text += "".join(f"{x} {y} 0\n" for x in range(3) for y in range(2))
    (tmp_path / "a.ply").write_text(text + "8 0 2 1 3 -1 3 2 5\n")
    scene = load_scene(tmp_path / "a.ply")
    assert scene.triangles.tolist() == [
        [0, 2, 1],
        [2, 3, 1],
        [3, 2, 4],
    ]  # no triangle uses 4: 5 is 4


@pytest.mark.parametrize(
    ("name", "text", "problem"),
    [
        ("a.off", "OFX\n1 1 1\n", "not an OFF file"),
        ("a.off", "4OFF\n1 1 1\n", "not an OFF file of three dimensions"),
        ("a.off", "OFF BINARY\n", "a binary OFF file"),
        ("a.off", "OFF\n", "counts of vertices and faces are missing"),
        ("a.off", "OFF\n1e300 1 0\n", "counts of vertices and faces are missing"),
        ("a.off", "OFF\n3 1 0\n0 0 0\n1 0\n0 1 0\n3 0 1 2\n", "vertex 1: the line holds too few"),
        ("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1\n", "face 0: the line holds too few"),
        ("a.off", "OFF\n3 1 0\n0 0 0\n1 0 x\n0 1 0\n3 0 1 2\n", "'x' is not a number"),
        ("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 1.5\n", "face 0: a vertex index"),
        ("a.ply", "plx\n", "not a PLY file"),
        ("a.ply", "ply\nformat ascii 1.0\nelement vertex", "no end_header"),
        ("a.ply", "ply\nformat morse 1.0\nend_header\n", "line 2: 'format morse 1.0'"),
        ("a.ply", "ply\nelement vertex -1\nend_header\n", "line 2: 'element vertex -1'"),
        ("a.ply", "ply\nproperty int x\nend_header\n", "line 2: 'property int x'"),
        ("a.ply", "ply\nend_header\n", "states no format"),
        ("a.ply", "ply\nformat ascii 1.0\nend_header\n", "no x, y and z"),
        ("a.ply", "ply\nformat ascii 1.0\nend_header\n1", "more in it than its header"),
    ],
)
def test_what_is_wrong_is_one_line_with_its_place(tmp_path, name, text, problem):
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=problem) as caught:
        load_scene(tmp_path / name)
    assert "\n" not in str(caught.value)
