"""Recordings of engines, right and wrong, of small scenes that public bug reports are like."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests.cases.files import add_box, add_rectangle, check, rectangle, write_path
from tests.support.gltf_files import TWO, Gltf
from visref_datasets_gen.png import png_bytes

pytestmark = pytest.mark.slow

NEAREST, LINEAR, CLAMP = 9728, 9729, 33071


@pytest.fixture(params=["embree", "exact"])
def engine(request):
    return request.param


# Earth-centred coordinates. In float32 they are half a metre apart.

PLACE = np.array([4_208_411.0, 1_120_733.0, -4_645_519.0])


@pytest.fixture
def two_screens_far_out(tmp_path):
    """A lamp behind two screens that overlap by 3 cm; rounded by half a metre they part."""
    gltf = Gltf()
    for name, x, z, width in (("left", -0.89, -4.0, 1.2), ("right", 0.6, -4.1, 1.84)):
        add_box(gltf, name, PLACE + np.array([x, 0.0, z]), (width, 3.0, 0.02))
    add_box(gltf, "lamp", PLACE + np.array([-0.3, 0.0, -6.3]), (0.5, 0.5, 0.5))
    pose = np.eye(4)
    pose[:3, 3] = PLACE
    write_path(tmp_path, pose, yfov=0.5)
    return gltf.write(tmp_path / "scene.glb")


def test_lamp_behind_screens_far_from_the_origin_is_hidden(two_screens_far_out, engine):
    status, sums = check(two_screens_far_out, "left", "right", engine=engine)
    assert status == 0
    assert (sums["visible"], sums["missed_pixels"]) == (2, 0)
    assert sums["owned_samples"] == 96 * 72


def test_screen_left_out_far_from_the_origin_convicts(two_screens_far_out, engine):
    status, sums = check(two_screens_far_out, "left", "lamp", engine=engine)
    assert status == 1
    assert sums["worst"]["object_name"] == "right"


# Leaves as an alpha mask. A pixel is a tenth of a unit, a texel 4 by 4 pixels, and a hole 2 by 2
# texels.

HOLES = [(1, 1), (2, 5), (4, 3), (5, 6), (6, 2)]  # row, column of 8 by 8 places


def leaves(tmp_path, filtering):
    """A card of 64 by 64 samples; behind it a deer of 72 by 72, which reaches beyond it by 8
    columns; behind both, a rabbit that the leaves cover."""
    places = np.full((8, 8), 255, np.uint8)
    places[tuple(np.transpose(HOLES))] = 0
    alpha = places.repeat(2, axis=0).repeat(2, axis=1)
    gltf = Gltf()
    image = gltf.entry("images", bufferView=gltf.view(png_bytes(alpha)), mimeType="image/png")
    sampler = {"magFilter": filtering, "minFilter": filtering, "wrapS": CLAMP, "wrapT": CLAMP}
    texture = gltf.entry("textures", source=image, sampler=gltf.entry("samplers", **sampler))
    material = gltf.entry(
        "materials",
        alphaMode="MASK",
        doubleSided=True,
        pbrMetallicRoughness={"baseColorTexture": {"index": texture}},
    )
    uv = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], "f4")
    card = gltf.primitive(rectangle(-3.2, -3.2, 3.2, 3.2, -4.0), TWO, material=material)
    card["attributes"]["TEXCOORD_0"] = gltf.accessor(uv)
    gltf.node(mesh=gltf.mesh(card), name="leaves")
    add_rectangle(gltf, "deer", -3.2, -3.6, 4.0, 3.6, -6.0)
    add_rectangle(gltf, "rabbit", -2.0, -2.0, -1.0, -1.0, -8.0)
    write_path(tmp_path)
    return gltf.write(tmp_path / "scene.glb")


CARD = 64 * 64
THROUGH_HOLES = len(HOLES) * 8 * 8
BESIDE = 72 * 72 - CARD


def test_deer_shows_through_the_holes_of_leaves(tmp_path, engine):
    scene = leaves(tmp_path, NEAREST)
    status, sums = check(scene, "leaves", "deer", engine=engine)
    assert status == 0
    assert sums["owned_samples"] == 72 * 72
    assert (sums["visible"], sums["superfluous"], sums["undecided_samples"]) == (2, 0, 0)
    status, sums = check(scene, "leaves", engine=engine)
    assert status == 1
    assert sums["missed_pixels"] == THROUGH_HOLES + BESIDE
    assert (sums["worst"]["object_name"], sums["confirmed"]) == ("deer", 1)
    status, sums = check(scene, "deer", engine=engine)
    assert status == 1
    assert sums["missed_pixels"] == CARD - THROUGH_HOLES


def test_filtered_edges_of_leaves_are_undecided_and_the_verdict_is_the_same(tmp_path, engine):
    scene = leaves(tmp_path, LINEAR)
    status, sums = check(scene, "leaves", "deer", engine=engine)
    assert (status, sums["undecided_samples"]) == (0, 0)
    status, sums = check(scene, "leaves", engine=engine)
    assert status == 1
    # A hole is surely one between the middles of its texels.
    assert BESIDE < sums["missed_pixels"] < BESIDE + THROUGH_HOLES
    # And in doubt no farther than a texel beyond its edges.
    assert 0 < sums["undecided_samples"] < len(HOLES) * 16 * 16


# Glass by its transmission. The vase is 8 by 8 samples.


def test_vase_shows_through_what_transmits_light(tmp_path, engine):
    gltf = Gltf()
    glass = gltf.entry(
        "materials", extensions={"KHR_materials_transmission": {"transmissionFactor": 0.9}}
    )
    gltf.json["extensionsUsed"] = ["KHR_materials_transmission"]
    add_rectangle(gltf, "window", -2.0, -2.0, 2.0, 2.0, -3.0, material=glass)
    add_rectangle(gltf, "vase", 0.4, 0.4, 1.2, 1.2, -5.0)
    write_path(tmp_path)
    scene = gltf.write(tmp_path / "scene.glb")
    status, sums = check(scene, "window", "vase", engine=engine)
    assert (status, sums["visible"]) == (0, 2)
    status, sums = check(scene, "window", engine=engine)
    assert (status, sums["missed_pixels"]) == (1, 8 * 8)
    assert sums["worst"]["object_name"] == "vase"
    # The window owns no opaque sample, yet is seen wherever it is.
    status, sums = check(scene, "vase", engine=engine)
    assert (status, sums["confirmed"], sums["missed_pixels"]) == (1, 1, 0)


# Names.


def test_name_that_three_nodes_bear_is_bad_input_and_the_candidates_are_told(tmp_path, capsys):
    gltf = Gltf()
    for x in (-2.0, 0.0, 2.0):
        add_box(gltf, "stool", (x, 0.0, -5.0), (0.6, 0.6, 0.6))
    write_path(tmp_path)
    scene = gltf.write(tmp_path / "scene.glb")
    status, sums = check(scene, "stool")
    assert (status, sums) == (2, None)
    told = capsys.readouterr().err
    assert all(name in told for name in ("'stool'", "stool#2", "stool#3"))
    assert check(scene, "stool#2", "stool#3", "stool")[0] == 2
    status, sums = check(scene, *(f"stool#{n}" for n in (2, 3)))
    assert status == 1
    file = scene.parent / "visible.jsonl"
    assert json.loads(file.read_text())["visible"] == ["stool#2", "stool#3"]


# A wall that is one polygon with eight corners. A pixel is a tenth of a unit.

HOUSE = """\
o wall
v -3 -2 -4
v -0.6 -2 -4
v -0.6 0.2 -4
v 0.6 0.2 -4
v 0.6 -2 -4
v 3 -2 -4
v 3 2 -4
v -3 2 -4
f 1 2 3 4 5 6 7 8
o visitor
v -0.3 -1.8 -6
v 0.2 -1.8 -6
v 0.2 0 -6
v -0.3 0 -6
f 9 10 11 12
o cellar
v -2.5 -1 -7
v -1 -1 -7
v -1 1 -7
v -2.5 1 -7
f 13 14 15 16
"""


def test_visitor_stands_in_the_doorway_of_a_wall_that_is_one_polygon(tmp_path, engine):
    scene = tmp_path / "house.obj"
    scene.write_text(HOUSE)
    write_path(tmp_path)
    visitor, wall = 5 * 18, 60 * 40 - 12 * 22
    status, sums = check(scene, "wall", "visitor", engine=engine)
    assert status == 0
    assert (sums["visible"], sums["owned_samples"]) == (2, wall + visitor)
    status, sums = check(scene, "wall", engine=engine)
    assert (status, sums["missed_pixels"]) == (1, visitor)
    assert sums["worst"]["object_name"] == "visitor"
