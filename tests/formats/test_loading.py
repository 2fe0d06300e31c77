"""Scenes from files are what the files say; what cannot be read is said in one line."""

from __future__ import annotations

import re
import sys
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.bad_input import BAD_INPUT, BAD_PATHS, BadInput, good_path, good_scene
from tests.support.gltf_files import SQUARE, TRIANGLE, TWO, Gltf, one_triangle
from visref.camera import Camera, look_at
from visref.engines import make_engine
from visref.errors import InputError
from visref.findings import Code
from visref.formats import load_path, load_scene, scene_from_trimesh
from visref.formats.gltf.extensions import HARMLESS, READ
from visref.scene import Alpha, Scene
from visref.visibility import objects_seen

ENGINE = Path("/usr/share/assimp/models/glTF2/2CylinderEngine-glTF-Binary/2CylinderEngine.glb")


def load(gltf: Gltf, folder: Path, **options) -> Scene:
    return load_scene(gltf.write(folder / "scene.glb"), **options)


def corners(scene: Scene, name: str) -> list[list[tuple[float, ...]]]:
    """The triangles of one object, as lists of corners."""
    index = scene.id_of_name[name]
    start, stop = scene.object_offsets[index : index + 2]
    return [[tuple(p) for p in row] for row in scene.vertices[scene.triangles[start:stop]].tolist()]


def soup(triangles: np.ndarray) -> set[tuple[tuple[float, ...], ...]]:
    """Triangles as a set, each started at its least corner: the winding counts."""
    result = set()
    for row in np.asarray(triangles, np.float32).tolist():
        points = [tuple(p) for p in row]
        first = points.index(min(points))
        result.add(tuple(points[first:] + points[:first]))
    return result


def codes(scene: Scene) -> list[str]:
    return [code for code, _ in scene.notes]


def test_objects_come_depth_first_in_file_order_with_their_names(tmp_path):
    gltf = Gltf()
    mesh = gltf.mesh(gltf.primitive(TRIANGLE), name="m")
    unnamed = gltf.mesh(gltf.primitive(TRIANGLE))
    leaf = gltf.node(root=False, mesh=mesh, name="leaf")
    group = gltf.node(root=False, children=[leaf], name="group")
    gltf.node(mesh=mesh, name="top", children=[group])
    gltf.node(mesh=mesh)
    gltf.node(mesh=unnamed, name="")
    gltf.node(mesh=mesh, name="leaf")
    gltf.node(root=False, mesh=mesh, name="not in the scene")
    assert load(gltf, tmp_path).names == ("top", "leaf", "m", "object", "leaf#2")


def test_several_primitives_are_one_object_and_unused_meshes_none(tmp_path):
    gltf = Gltf()
    both = gltf.mesh(gltf.primitive(TRIANGLE), gltf.primitive(SQUARE, TWO))
    gltf.mesh(gltf.primitive(TRIANGLE), name="nobody's")
    gltf.node(mesh=both, name="part")
    scene = load(gltf, tmp_path)
    assert scene.names == ("part",)
    assert scene.triangle_count == 3
    assert soup(scene.vertices[scene.triangles]) == soup(
        np.stack([TRIANGLE, *SQUARE[TWO.reshape(-1, 3)]])
    )


def test_object_without_triangles_keeps_its_id(tmp_path):
    gltf = Gltf()
    gltf.node(mesh=gltf.mesh(gltf.primitive(TRIANGLE, mode=0)), name="points")
    gltf.node(mesh=gltf.mesh(gltf.primitive(TRIANGLE)), name="part")
    scene = load(gltf, tmp_path)
    assert scene.id_of_name == {"points": 0, "part": 1}
    assert scene.object_offsets.tolist() == [0, 0, 1]
    assert codes(scene) == ["NO_TRIANGLES"]


def test_hidden_node_shows_nothing_and_neither_do_its_children(tmp_path):
    gltf = Gltf()
    mesh = gltf.mesh(gltf.primitive(TRIANGLE))
    child = gltf.node(root=False, mesh=mesh, name="child")
    gltf.node(extensions={"KHR_node_visibility": {"visible": False}}, children=[child])
    gltf.node(mesh=mesh, name="seen", extensions={"KHR_node_visibility": {"visible": True}})
    scene = load(gltf, tmp_path)
    assert scene.names == ("child", "seen")
    assert scene.object_offsets.tolist() == [0, 0, 1]


def test_transforms_of_the_chain_apply_from_the_leaf_upwards(tmp_path):
    gltf = Gltf()
    mesh = gltf.mesh(gltf.primitive(TRIANGLE))
    # A quarter turn about z takes x to y; then scaled, then moved; then the parent's move.
    leaf = gltf.node(
        root=False,
        mesh=mesh,
        name="leaf",
        rotation=[0, 0, 1, 1],
        scale=[2, 3, 1],
        translation=[10, 0, 0],
    )
    matrix = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 5], [0, 0, 0, 1]])
    gltf.node(children=[leaf], matrix=matrix.T.reshape(-1).tolist())
    assert corners(load(gltf, tmp_path), "leaf") == [[(10, 0, 5), (10, 0, 7), (7, 0, 5)]]


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    depth=st.integers(1, 4),
    far=st.sampled_from([1.0, 1e5, 1e7]),
)
def test_vertices_are_the_exact_product_rounded_once(tmp_path_factory, seed, depth, far):
    rng = np.random.default_rng(seed)
    gltf = Gltf()
    points = rng.normal(size=(6, 3)).astype("f4")
    node = gltf.node(root=False, mesh=gltf.mesh(gltf.primitive(points)), name="part")
    matrices = []
    for level in range(depth):
        matrix = np.eye(4)
        matrix[:3] = rng.normal(size=(3, 4))
        matrix[:3, 3] *= far
        matrices.append(matrix)
        node = gltf.node(
            root=level == depth - 1, children=[node], matrix=matrix.T.reshape(-1).tolist()
        )
    scene = load(gltf, tmp_path_factory.mktemp("scene"))
    ours = scene.vertices[scene.triangles].reshape(-1, 3)
    origin = [Fraction(float(v)) for v in scene.origin]
    mirrored = np.prod([np.linalg.det(m[:3, :3]) for m in matrices]) < 0
    expected = points.reshape(-1, 3, 3)[:, ::-1] if mirrored else points.reshape(-1, 3, 3)
    for got, point in zip(ours, expected.reshape(-1, 3), strict=True):
        exact = [Fraction(float(v)) for v in point]
        size = [abs(v) for v in exact]
        for matrix in matrices:
            rows = [[Fraction(float(v)) for v in row] for row in matrix[:3]]
            exact = [sum((row[k] * exact[k] for k in range(3)), start=row[3]) for row in rows]
            size = [
                sum((abs(row[k]) * size[k] for k in range(3)), start=abs(row[3])) for row in rows
            ]
        exact = [value - zero for value, zero in zip(exact, origin, strict=True)]
        for value, wanted, bound in zip(got, exact, size, strict=True):
            # Half a unit in the last place of float32, and what cancelled in float64: at most
            # 4 (depth + 1) roundings of at most 2**-53 of the sum of magnitudes each.
            half_step = Fraction(float(np.spacing(np.abs(value)))) / 2
            slack = 4 * (depth + 1) * bound * Fraction(1, 2**53)
            assert abs(Fraction(float(value)) - wanted) <= half_step + slack


def test_mirroring_flips_the_winding_and_two_mirrors_do_not(tmp_path):
    gltf = Gltf()
    mesh = gltf.mesh(gltf.primitive(TRIANGLE))
    twice = gltf.node(root=False, mesh=mesh, name="twice", scale=[1, -1, 1])
    gltf.node(mesh=mesh, name="once", scale=[-1, 1, 1], children=[twice])
    gltf.node(mesh=mesh, name="flat", scale=[-1, 0, 1])
    scene = load(gltf, tmp_path)
    once, twice = (np.array(corners(scene, name)[0]) for name in ("once", "twice"))
    up = [np.cross(p[1] - p[0], p[2] - p[0])[2] for p in (once, twice)]
    assert up == [1.0, 1.0]
    assert corners(scene, "flat") == [[(0, 0, 0), (-1, 0, 0), (0, 0, 0)]]


def test_tiny_mirroring_scale_still_flips(tmp_path):
    gltf = Gltf()
    mesh = gltf.mesh(gltf.primitive(TRIANGLE))
    gltf.node(mesh=mesh, name="part", scale=[-1e-30] * 3, translation=[1, 1, 1])
    vertices = load(gltf, tmp_path)
    assert vertices.triangles.tolist() == [[2, 1, 0]]


INTEGERS = np.array([[0, 0, 0], [127, 0, 0], [0, -127, 64]])


@pytest.mark.parametrize(
    ("dtype", "normalized", "expected"),
    [
        ("i1", False, INTEGERS),
        ("i2", False, INTEGERS),
        ("u2", False, np.abs(INTEGERS)),
        ("u1", False, np.abs(INTEGERS)),
        ("i1", True, INTEGERS / 127),
        ("i2", True, INTEGERS / 32767),
        ("u1", True, np.abs(INTEGERS) / 255),
        ("u2", True, np.abs(INTEGERS) / 65535),
    ],
)
def test_quantized_positions_are_decoded(tmp_path, dtype, normalized, expected):
    gltf = Gltf()
    values = np.abs(INTEGERS) if dtype[0] == "u" else INTEGERS
    padded = np.zeros((3, 4), dtype)
    padded[:, :3] = values
    view = gltf.view(padded.tobytes(), byteStride=padded.strides[0])
    primitive = gltf.primitive(values.astype(dtype))
    gltf.json["accessors"][-1].update(bufferView=view, normalized=normalized)
    gltf.node(mesh=gltf.mesh(primitive), name="part")
    gltf.json["extensionsRequired"] = ["KHR_mesh_quantization"]
    scene = load(gltf, tmp_path)
    assert np.array_equal(scene.vertices, expected.astype(np.float32))


def test_least_normalized_integer_is_minus_one(tmp_path):
    gltf = Gltf()
    primitive = gltf.primitive(np.array([[-128, 0, 0], [0, 0, 0], [0, 127, 0]], "i1"))
    gltf.json["accessors"][-1]["normalized"] = True
    gltf.node(mesh=gltf.mesh(primitive), name="part")
    assert load(gltf, tmp_path).vertices.min() == -1.0


@pytest.mark.parametrize("index_type", ["u1", "u2", "u4", None])
@pytest.mark.parametrize(
    ("mode", "expected"),
    [
        (4, [(0, 1, 2), (3, 4, 5)]),
        (5, [(0, 1, 2), (1, 3, 2), (2, 3, 4), (3, 5, 4), (4, 5, 6)]),
        (6, [(1, 2, 0), (2, 3, 0), (3, 4, 0), (4, 5, 0), (5, 6, 0)]),
        (0, []),
        (1, []),
        (2, []),
        (3, []),
    ],
)
def test_primitive_modes_become_triangles(tmp_path, mode, expected, index_type):
    gltf = Gltf()
    points = np.random.default_rng(1).normal(size=(7, 3)).astype("f4")
    indices = None if index_type is None else np.arange(7, dtype=index_type)
    gltf.node(mesh=gltf.mesh(gltf.primitive(points, indices, mode=mode)), name="part")
    got = corners(load(gltf, tmp_path), "part")
    assert got == [[tuple(points[i].tolist()) for i in row] for row in expected]


def test_sparse_accessor_replaces_what_it_names(tmp_path):
    gltf = Gltf()
    primitive = gltf.primitive(TRIANGLE)
    gltf.json["accessors"][0]["sparse"] = {
        "count": 2,
        "indices": {"bufferView": gltf.view(b"\0\2"), "componentType": 5121},
        "values": {"bufferView": gltf.view(np.array([[7, 7, 7], [8, 8, 8]], "f4").tobytes())},
    }
    zeros = gltf.primitive(TRIANGLE)
    sparse = gltf.json["accessors"][0]["sparse"]
    gltf.json["accessors"][1] = {"componentType": 5126, "count": 3, "type": "VEC3"}
    gltf.json["accessors"][1]["sparse"] = sparse
    gltf.node(mesh=gltf.mesh(primitive), name="over")
    gltf.node(mesh=gltf.mesh(zeros), name="alone")
    scene = load(gltf, tmp_path)
    assert corners(scene, "over") == [[(7, 7, 7), (1, 0, 0), (8, 8, 8)]]
    assert corners(scene, "alone") == [[(7, 7, 7), (0, 0, 0), (8, 8, 8)]]


def test_shared_vertex_buffer_is_not_copied_for_every_primitive(tmp_path):
    gltf = Gltf()
    points = np.random.default_rng(0).normal(size=(300, 3)).astype("f4")
    first = gltf.primitive(points, np.arange(3, dtype="u2"))
    for start in range(0, 300, 3):
        indices = gltf.accessor(np.arange(start, start + 3, dtype="u2"))
        mesh = gltf.mesh({"attributes": first["attributes"], "indices": indices})
        gltf.node(mesh=mesh, name="part")
    scene = load(gltf, tmp_path)
    assert len(scene.vertices) == 300
    assert np.array_equal(scene.vertices[scene.triangles].reshape(-1, 3), points)


@pytest.mark.parametrize("count", [1, 125])
def test_gpu_instances_are_objects_like_nodes_of_their_own(tmp_path, count):
    rng = np.random.default_rng(count)
    translation, scale = rng.normal(size=(2, count, 3)).astype("f4")
    rotation = rng.normal(size=(count, 4)).astype("f4")
    instanced, plain = Gltf(), Gltf()
    parent = {"translation": [1.0, 2.0, 3.0], "rotation": [0.5, 0.5, 0.5, 0.5]}
    attributes = {
        "TRANSLATION": instanced.accessor(translation),
        "ROTATION": instanced.accessor(rotation),
        "SCALE": instanced.accessor(scale),
    }
    instanced.node(
        mesh=instanced.mesh(instanced.primitive(TRIANGLE)),
        name="tree",
        extensions={"EXT_mesh_gpu_instancing": {"attributes": attributes}},
        **parent,
    )
    instanced.json["extensionsRequired"] = ["EXT_mesh_gpu_instancing"]
    mesh = plain.mesh(plain.primitive(TRIANGLE))
    children = [
        plain.node(
            root=False,
            mesh=mesh,
            name="tree",
            translation=t.tolist(),
            rotation=r.tolist(),
            scale=s.tolist(),
        )
        for t, r, s in zip(translation, rotation, scale, strict=True)
    ]
    plain.node(children=children, **parent)
    a, b = load(instanced, tmp_path), load(plain, tmp_path)
    assert a.object_count == count
    assert a.digest == b.digest


def draco_gltf(positions: np.ndarray, faces: np.ndarray) -> Gltf:
    """A Draco file whose attribute ids are not in the usual order."""
    draco = pytest.importorskip("DracoPy")
    data = draco.encode(
        positions,
        faces,
        quantization_bits=0,
        preserve_order=True,
        generic_attributes={7: -positions},
    )
    names = {a["unique_id"] for a in draco.decode(data).attributes}
    (position_id,) = names - {7}
    gltf = Gltf()
    primitive = gltf.primitive(np.zeros_like(positions), np.zeros(faces.size, "u4"))
    for index in range(2):  # Compressed primitives' accessors have no bytes of their own.
        del gltf.json["accessors"][index]["bufferView"]
    primitive["attributes"]["_NEGATED"] = 0
    extension = {
        "bufferView": gltf.view(data),
        "attributes": {"_NEGATED": 7, "POSITION": position_id},
    }
    primitive["extensions"] = {"KHR_draco_mesh_compression": extension}
    gltf.json["extensionsRequired"] = ["KHR_draco_mesh_compression"]
    gltf.node(mesh=gltf.mesh(primitive), name="part")
    return gltf


def test_draco_geometry_is_decoded(tmp_path):
    box = trimesh.creation.icosphere(subdivisions=1)
    positions, faces = box.vertices.astype("f4"), box.faces.astype("u4")
    scene = load(draco_gltf(positions, faces), tmp_path)
    assert soup(scene.vertices[scene.triangles]) == soup(positions[faces])


def test_draco_without_its_decoder_is_refused(tmp_path, monkeypatch):
    gltf = draco_gltf(TRIANGLE, np.array([[0, 1, 2]], "u4"))
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    with pytest.raises(InputError, match="DracoPy is not installed; run: pip install DracoPy"):
        load(gltf, tmp_path)


def test_skinned_mesh_stands_where_its_joints_are(tmp_path):
    gltf = Gltf()
    primitive = gltf.primitive(TRIANGLE)
    primitive["attributes"]["JOINTS_0"] = gltf.accessor(
        np.array([[0, 1, 0, 0], [1, 0, 0, 0], [0, 1, 0, 0]], "u1")
    )
    primitive["attributes"]["WEIGHTS_0"] = gltf.accessor(
        np.array([[1, 0, 0, 0], [1, 0, 0, 0], [0.5, 0.5, 0, 0]], "f4")
    )
    bind = np.tile(np.eye(4, dtype="f4"), (2, 1, 1))
    bind[:, 3, 0] = -1  # column-major: the joints were bound at x = 1
    joints = [
        gltf.node(translation=[1, 0, 10]),
        gltf.node(translation=[1, 0, 20]),
    ]
    gltf.entry("skins", joints=joints, inverseBindMatrices=gltf.accessor(bind.reshape(2, 16)))
    gltf.node(mesh=gltf.mesh(primitive), skin=0, name="body", translation=[99, 99, 99])
    got = corners(load(gltf, tmp_path), "body")
    assert got == [[(0, 0, 10), (1, 0, 20), (0, 1, 15)]]


def test_morph_targets_rest_at_their_default_weights(tmp_path):
    gltf = Gltf()
    moved = gltf.accessor(np.full((3, 3), 8, "f4"))
    primitive = gltf.primitive(TRIANGLE, targets=[{"POSITION": moved}, {"NORMAL": moved}])
    mesh = gltf.mesh(primitive, weights=[0.5, 1.0])
    gltf.node(mesh=mesh, name="mesh's")
    gltf.node(mesh=mesh, name="node's", weights=[0.25, 0.0])
    gltf.node(mesh=mesh, name="none", weights=[0.0, 0.0])
    scene = load(gltf, tmp_path)
    assert corners(scene, "mesh's")[0][0] == (4, 4, 4)
    assert corners(scene, "node's")[0][0] == (2, 2, 2)
    assert corners(scene, "none")[0][0] == (0, 0, 0)


def animate(gltf: Gltf, node: int, path: str = "translation") -> None:
    sampler = {
        "input": gltf.accessor(np.array([0, 1], "f4")),
        "output": gltf.accessor(np.zeros((2, 3), "f4")),
    }
    channel = {"sampler": 0, "target": {"node": node, "path": path}}
    gltf.entry("animations", samplers=[sampler], channels=[channel])


def test_animated_camera_is_no_finding_about_objects(tmp_path):
    gltf = one_triangle()
    gltf.entry("cameras", type="perspective", perspective={"yfov": 1.0, "znear": 0.1})
    animate(gltf, gltf.node(camera=0))
    assert load(gltf, tmp_path).notes == ()


def test_unknown_extension_that_is_only_used_is_a_finding(tmp_path):
    gltf = one_triangle()
    gltf.json["extensionsUsed"] = ["KHR_materials_clearcoat", "ACME_invisible_ink"]
    (note,) = load(gltf, tmp_path).notes
    assert note[0] == "PARTLY_READ"
    assert "ACME_invisible_ink" in note[1]


TEXTURED = {"baseColorTexture": {"index": 0}}
CLEAR = {"baseColorFactor": [1, 1, 1, 0.25]}


@pytest.mark.parametrize(
    ("material", "expected"),
    [
        ({}, Alpha.OPAQUE),
        ({"alphaMode": "BLEND"}, Alpha.BLEND),
        ({"alphaMode": "OPAQUE", "pbrMetallicRoughness": CLEAR}, Alpha.OPAQUE),
        ({"alphaMode": "MASK"}, Alpha.OPAQUE),
        ({"alphaMode": "MASK", "alphaCutoff": 1.0}, Alpha.OPAQUE),
        ({"alphaMode": "MASK", "alphaCutoff": 1.01}, None),
        ({"alphaMode": "MASK", "pbrMetallicRoughness": CLEAR}, None),
        ({"alphaMode": "MASK", "alphaCutoff": 0.25, "pbrMetallicRoughness": CLEAR}, Alpha.OPAQUE),
        ({"alphaMode": "MASK", "pbrMetallicRoughness": TEXTURED}, Alpha.MASK),
        ({"alphaMode": "MASK", "pbrMetallicRoughness": {**TEXTURED, **CLEAR}}, None),
        (
            {
                "alphaMode": "MASK",
                "extensions": {
                    "KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [1, 1, 1, 0.2]}
                },
            },
            None,
        ),
    ],
)
def test_alpha_mode_decides_what_a_triangle_hides(tmp_path, material, expected):
    gltf = one_triangle()
    gltf.entry("materials", **material)
    gltf.json["meshes"][0]["primitives"][0]["material"] = 0
    scene = load(gltf, tmp_path)
    assert scene.names == ("part",)
    assert scene.alpha.tolist() == ([] if expected is None else [expected])


def glass(factor: float, **more) -> dict:
    return {"extensions": {"KHR_materials_transmission": {"transmissionFactor": factor, **more}}}


@pytest.mark.parametrize(
    ("material", "expected"),
    [
        (glass(1.0), Alpha.BLEND),
        (glass(0.01), Alpha.BLEND),
        (glass(0.0), Alpha.OPAQUE),
        ({"extensions": {"KHR_materials_transmission": {}}}, Alpha.OPAQUE),
        ({"extensions": {"KHR_materials_volume": {"thicknessFactor": 1}}}, Alpha.OPAQUE),
        ({"alphaMode": "BLEND", **glass(0.0)}, Alpha.BLEND),
        ({"alphaMode": "MASK", **glass(0.5)}, Alpha.BLEND),
        ({"alphaMode": "MASK", "pbrMetallicRoughness": CLEAR, **glass(0.5)}, None),
        ({"alphaMode": "MASK", "pbrMetallicRoughness": TEXTURED, **glass(0.5)}, Alpha.BLEND),
        (
            {"extensions": {"ADOBE_materials_thin_transparency": {"transmissionFactor": 0.7}}},
            Alpha.BLEND,
        ),
    ],
)
def test_what_transmits_light_is_glass_and_not_wall(tmp_path, material, expected):
    gltf = one_triangle()
    gltf.entry("materials", **material)
    gltf.json["meshes"][0]["primitives"][0]["material"] = 0
    gltf.json["extensionsUsed"] = ["KHR_materials_transmission", "KHR_materials_volume"]
    scene = load(gltf, tmp_path)
    assert scene.alpha.tolist() == ([] if expected is None else [expected])
    assert "PARTLY_READ" not in codes(scene)


def test_a_vase_behind_a_pane_of_glass_is_seen(tmp_path):
    gltf = Gltf()
    square = gltf.primitive(SQUARE, TWO)
    gltf.entry("materials", **glass(1.0), pbrMetallicRoughness={"roughnessFactor": 0})
    gltf.node(mesh=gltf.mesh({**square, "material": 0}), name="pane")
    gltf.node(mesh=gltf.mesh(square), name="vase", translation=[0.25, 0.25, -1], scale=[0.5] * 3)
    scene = load(gltf, tmp_path)
    camera = Camera(look_at((0.501, 0.501, 5), (0.501, 0.501, 0)), 20, 20, near=0.1, ymag=0.5)
    seen = objects_seen(make_engine("exact", scene).frame(camera), scene)
    # One unit of the view is 20 samples; the pane is blended, and shows at 20 by 20.
    assert dict(zip(scene.names, seen.samples.tolist(), strict=True)) == {"pane": 400, "vase": 100}


def test_what_a_transmission_texture_and_variants_leave_open_is_said(tmp_path):
    gltf = one_triangle()
    gltf.entry("materials", **glass(0.5, transmissionTexture={"index": 0}))
    gltf.entry("materials", name="plain")
    gltf.entry("materials", name="as plain, in red", pbrMetallicRoughness=TEXTURED)
    primitive = gltf.json["meshes"][0]["primitives"][0]
    primitive["material"] = 1
    used = gltf.json["extensionsUsed"] = ["KHR_materials_variants"]

    def variants(*materials: int) -> None:
        mappings = [{"material": material, "variants": [0]} for material in materials]
        primitive["extensions"] = {"KHR_materials_variants": {"mappings": mappings}}

    variants(1, 2)
    (texture,) = [text for _, text in load(gltf, tmp_path).notes]
    assert "transmission texture" in texture
    assert "materials[0]" in texture
    variants(2, 0)
    scene = load(gltf, tmp_path)
    assert scene.names == ("part",)
    assert codes(scene) == ["PARTLY_READ"] * 2
    assert "meshes[0]" in scene.notes[1][1]
    used.clear()


@pytest.mark.parametrize(
    ("pointer", "bears"),
    [
        ("/materials/0/alphaCutoff", True),
        ("/materials/0/pbrMetallicRoughness/baseColorFactor", True),
        ("/materials/0/extensions/KHR_materials_transmission/transmissionFactor", True),
        ("/nodes/0/extensions/ACME_bend/angle", True),
        ("/meshes/0/weights/0", True),
        ("/materials/0/emissiveFactor", False),
        ("/cameras/0/perspective/yfov", False),
    ],
)
def test_a_pointer_that_is_not_played_is_a_finding_where_it_bears_on_what_is_seen(
    tmp_path, pointer, bears
):
    gltf = one_triangle()
    animate(gltf, 0)
    gltf.json["animations"][0]["channels"][0]["target"] = {
        "path": "pointer",
        "extensions": {"KHR_animation_pointer": {"pointer": pointer}},
    }
    scene = load(gltf, tmp_path)
    assert scene.rig.motion is None
    if not bears:
        assert scene.notes == ()
    else:
        ((code, text),) = scene.notes
        assert code == Code.ANIMATION_IGNORED
        assert text == f"1 animated property stands as written, first '{pointer}'"


def test_every_extension_that_is_known_is_documented_and_others_are_not():
    page = (Path(__file__).parent.parent.parent / "docs" / "formats.md").read_text()
    documented = set(re.findall(r"^\| ((?:`\w+`(?:, )?)+) \|", page, flags=re.M))
    names = {name for row in documented for name in re.findall(r"`(\w+)`", row)}
    extensions = {name for name in names if re.match(r"[A-Z]+_\w+", name)}
    assert extensions == READ | HARMLESS
    assert "KHR_materials_of_tomorrow" not in READ | HARMLESS
    assert not READ & HARMLESS


def test_every_known_extension_says_nothing_where_it_is_only_listed(tmp_path):
    gltf = one_triangle()
    gltf.json["extensionsUsed"] = sorted(READ | HARMLESS)
    gltf.json["extensionsRequired"] = sorted(READ | HARMLESS)
    assert load(gltf, tmp_path).notes == ()


def test_vertex_alpha_leaves_a_mask_undecided_only_where_it_crosses_the_cutoff(tmp_path):
    gltf = Gltf()
    primitive = gltf.primitive(np.tile(TRIANGLE, (3, 1)), material=0)
    color = np.ones((9, 4), "f4")
    color[:, 3] = [1, 1, 1, 0, 0, 0, 1, 0, 1]
    primitive["attributes"]["COLOR_0"] = gltf.accessor(color)
    gltf.entry("materials", alphaMode="MASK")
    gltf.node(mesh=gltf.mesh(primitive), name="part")
    assert load(gltf, tmp_path).alpha.tolist() == [Alpha.OPAQUE, Alpha.MASK]


def test_sides_take_effect_only_when_back_faces_are_culled(tmp_path):
    gltf = Gltf()
    gltf.entry("materials", doubleSided=True)
    gltf.entry("materials", doubleSided=False)
    mesh = gltf.mesh(
        gltf.primitive(TRIANGLE, material=0),
        gltf.primitive(TRIANGLE, material=1),
        gltf.primitive(TRIANGLE),
    )
    gltf.node(mesh=mesh, name="part")
    assert load(gltf, tmp_path).one_sided.tolist() == [False, False, False]
    culled = load(gltf, tmp_path, cull_backfaces=True)
    assert culled.one_sided.tolist() == [False, True, True]


def test_lenient_drops_triangles_that_are_not_finite_and_counts_them(tmp_path):
    gltf = Gltf()
    points = np.concatenate([TRIANGLE, SQUARE, TRIANGLE + 5])
    points[3:7, 1] = np.nan
    indices = np.array([0, 1, 2, 3, 4, 5, 0, 1, 6, 7, 8, 9], "u2")
    gltf.node(mesh=gltf.mesh(gltf.primitive(points, indices)), name="torn")
    gltf.node(mesh=gltf.mesh(gltf.primitive(TRIANGLE + 9)), name="whole")
    with pytest.raises(InputError, match="object 'torn': a vertex is NaN or infinite"):
        load(gltf, tmp_path)
    scene = load(gltf, tmp_path, lenient=True)
    assert scene.object_offsets.tolist() == [0, 2, 3]
    assert codes(scene) == ["NONFINITE_DROPPED"]
    assert scene.notes[0][1].startswith("2 triangles")
    expected = np.stack([TRIANGLE, TRIANGLE + 5, TRIANGLE + 9])
    assert np.array_equal(scene.vertices[scene.triangles], expected)


def test_vertex_that_no_triangle_uses_may_be_nan(tmp_path):
    gltf = Gltf()
    points = np.concatenate([TRIANGLE, [[np.nan] * 3]]).astype("f4")
    gltf.node(mesh=gltf.mesh(gltf.primitive(points, np.arange(3, dtype="u2"))), name="part")
    assert len(load(gltf, tmp_path).vertices) == 3


def test_buffers_may_lie_beside_the_file_or_within(tmp_path):
    gltf = one_triangle()
    wanted = load(gltf, tmp_path).digest
    (tmp_path / "a b.bin").write_bytes(gltf.blob)
    assert load_scene(gltf.write_gltf(tmp_path / "beside.gltf", "a%20b.bin")).digest == wanted
    assert load_scene(gltf.write_gltf(tmp_path / "within.gltf")).digest == wanted


def test_images_are_not_looked_at(tmp_path):
    gltf = one_triangle()
    gltf.entry("images", uri="absent.png")
    gltf.entry("textures", source=0)
    gltf.entry("materials", pbrMetallicRoughness=TEXTURED)
    gltf.json["meshes"][0]["primitives"][0]["material"] = 0
    assert load(gltf, tmp_path).triangle_count == 1


def random_trimesh_scene(seed: int) -> trimesh.Scene:
    rng = np.random.default_rng(seed)
    scene = trimesh.Scene()
    shapes = [
        trimesh.creation.box(),
        trimesh.creation.icosphere(subdivisions=1),
        trimesh.creation.cone(radius=1.0, height=2.0),
    ]
    frames = [scene.graph.base_frame]
    for index in range(8):
        matrix = trimesh.transformations.random_rotation_matrix(rng.random(3))
        matrix[:3, 3] = rng.normal(size=3)
        matrix[:3, :3] *= rng.choice([-2.0, 0.5, 1.0])
        scene.add_geometry(
            shapes[index % 3],
            geom_name=f"mesh{index % 3}",
            node_name=f"node{index}",
            parent_node_name=frames[rng.integers(len(frames))],
            transform=matrix,
        )
        frames.append(f"node{index}")
    return scene


@pytest.mark.parametrize("seed", range(5))
def test_triangles_agree_with_trimesh_on_random_hierarchies(tmp_path, seed):
    scene = random_trimesh_scene(seed)
    file = tmp_path / "scene.glb"
    file.write_bytes(scene.export(file_type="glb"))
    ours = load_scene(file)
    theirs = trimesh.load_scene(file, process=False)
    assert ours.object_count == len(theirs.graph.nodes_geometry) == 8
    for index, name in enumerate(ours.names):
        matrix, geometry = theirs.graph[name]
        points = trimesh.transform_points(theirs.geometry[geometry].vertices, matrix)
        triangles = points[theirs.geometry[geometry].faces]
        if np.linalg.det(matrix) < 0:
            triangles = triangles[:, ::-1]
        start, stop = ours.object_offsets[index : index + 2]
        got = ours.vertices[ours.triangles[start:stop]]
        # trimesh keeps its vertices and sums in another order: a float32 step or two.
        assert np.allclose(got, triangles, rtol=0, atol=1e-5)


@pytest.mark.parametrize("seed", range(3))
def test_trimesh_scene_is_flattened_as_its_file_is(tmp_path, seed):
    scene = random_trimesh_scene(seed)
    file = tmp_path / "scene.glb"
    file.write_bytes(scene.export(file_type="glb"))
    direct, through_file = scene_from_trimesh(scene), load_scene(file)
    # The exporter orders children its own way, so objects are compared by name.
    assert sorted(direct.names) == sorted(through_file.names)
    for name in direct.names:
        got, expected = np.array(corners(direct, name)), np.array(corners(through_file, name))
        assert np.allclose(got, expected, rtol=0, atol=1e-5)


def test_trimesh_nodes_come_depth_first_with_children_in_order():
    scene, box = trimesh.Scene(), trimesh.creation.box()
    base = scene.graph.base_frame
    for name, parent in (("a", base), ("b", base), ("a1", "a"), ("b1", "b"), ("a2", "a")):
        scene.add_geometry(box, geom_name="box", node_name=name, parent_node_name=parent)
    assert scene_from_trimesh(scene).names == ("a", "a1", "a2", "b", "b1")


def test_trimesh_paths_leave_its_own_root_out():
    box = trimesh.Trimesh(TRIANGLE, [[0, 1, 2]], process=False)
    graph = trimesh.Scene()
    graph.add_geometry(box, node_name="house")
    graph.add_geometry(box, node_name="chair", parent_node_name="house")
    assert scene_from_trimesh(graph).paths == ("house", "house/chair")


def test_a_deep_nest_of_long_names_takes_no_memory_without_end(tmp_path):
    gltf = one_triangle()
    node = 0
    for _ in range(400):
        node = gltf.node(root=False, children=[node], name="n" * 100)
    gltf.json["scenes"][0]["nodes"] = [node]
    (path,) = load(gltf, tmp_path).paths
    assert path.endswith("/part")
    assert len(path) < 4096 + 200


def test_trimesh_materials_say_alpha_and_sides():
    def part(**material) -> trimesh.Trimesh:
        visual = trimesh.visual.TextureVisuals(
            material=trimesh.visual.material.PBRMaterial(**material)
        )
        return trimesh.Trimesh(TRIANGLE, [[0, 1, 2]], visual=visual, process=False)

    parts = [
        part(alphaMode="BLEND", doubleSided=True),
        part(alphaMode="MASK", baseColorFactor=[255, 255, 255, 10]),
        part(alphaMode="MASK"),
        trimesh.Trimesh(TRIANGLE, [[0, 1, 2]], process=False),
    ]
    scene = scene_from_trimesh(trimesh.Scene(parts), cull_backfaces=True)
    assert scene.object_offsets.tolist() == [0, 1, 1, 2, 3]
    assert scene.alpha.tolist() == [Alpha.BLEND, Alpha.OPAQUE, Alpha.OPAQUE]
    assert scene.one_sided.tolist() == [False, True, True]


@pytest.mark.parametrize("suffix", ["obj", "ply", "stl", "off", "3mf", "dae", "gltf"])
def test_formats_give_the_same_triangles(tmp_path, suffix):
    if suffix in ("3mf", "dae"):
        pytest.importorskip("collada")
        pytest.importorskip("networkx")
    box = trimesh.creation.box((1, 2, 3))
    file = tmp_path / f"box.{suffix}"
    if suffix == "gltf":
        for name, data in trimesh.Scene(box).export(file_type="gltf").items():
            (tmp_path / name).write_bytes(data)
        file = tmp_path / "model.gltf"
    else:
        box.export(file)
    scene = load_scene(file)
    assert scene.object_count == 1
    assert soup(scene.vertices[scene.triangles]) == soup(box.triangles)


def test_clean_up_of_other_loaders_is_off(tmp_path):
    # A degenerate triangle, a duplicate, and vertices that coincide: all are kept.
    file = tmp_path / "soup.off"
    file.write_text("OFF\n4 3 0\n0 0 0\n1 0 0\n0 1 0\n0 0 0\n3 0 1 2\n3 0 1 2\n3 0 3 1\n")
    scene = load_scene(file)
    assert scene.triangle_count == 3
    file.write_text("OFF\n4 2 0\n0 0 0\n1 0 0\n0 1 0\n0 nan 0\n3 0 1 2\n3 0 1 3\n")
    with pytest.raises(InputError, match="NaN"):
        load_scene(file)


def test_what_a_loader_only_logs_is_a_finding(tmp_path, capfd):
    facet = "facet normal 0 0 {}\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\n"
    text = "solid s\n" + facet.format(1) + "endfacet\n" + facet.format("x") + "endfacet\nendsolid\n"
    (tmp_path / "odd.stl").write_text(text)
    scene = load_scene(tmp_path / "odd.stl")
    assert scene.triangle_count == 2
    assert codes(scene) == ["PARTLY_READ"]
    assert capfd.readouterr().err == ""


@pytest.mark.skipif(not ENGINE.exists(), reason="Debian's assimp-testmodels is not installed")
def test_real_model_has_the_objects_that_an_independent_reader_counts():
    scene, path = load_scene(ENGINE), load_path(ENGINE)
    loaded = trimesh.load_scene(ENGINE, process=False)
    # trimesh makes a node of each primitive: 115 of them, in the file's 67 nodes with a mesh.
    assert len(loaded.graph.nodes_geometry) == 115
    assert scene.object_count == 67
    theirs = np.concatenate(
        [
            trimesh.transform_points(loaded.geometry[mesh].vertices, matrix)[
                loaded.geometry[mesh].faces
            ]
            for matrix, mesh in map(loaded.graph.get, loaded.graph.nodes_geometry)
        ]
    )
    assert scene.triangle_count == len(theirs) == 121496
    assert np.allclose(scene.bounds, [theirs.min(axis=(0, 1)), theirs.max(axis=(0, 1))], atol=1e-3)
    ours = np.sort(scene.vertices[scene.triangles].mean(axis=1), axis=0)
    assert np.allclose(ours, np.sort(theirs.mean(axis=1), axis=0), atol=1e-3)
    assert len(path) == 1
    assert path.cameras[0].far == 1e6


@pytest.mark.parametrize("case", BAD_INPUT, ids=lambda case: case.name)
def test_bad_input_gets_one_line_that_names_file_and_place(tmp_path, case: BadInput):
    scene_file, path_file = case.make(tmp_path)
    with pytest.raises(InputError) as caught:
        load_scene(scene_file)
        load_path(path_file)
    line = str(caught.value)
    assert case.expected in line
    assert "\n" not in line
    assert str(path_file if case in BAD_PATHS else scene_file) in line
    assert len(line) < 500 + len(str(tmp_path))


def test_good_files_of_the_bad_input_table_are_good(tmp_path):
    assert load_scene(good_scene(tmp_path)).names == ("part",)
    assert len(load_path(good_path(tmp_path))) == 1
