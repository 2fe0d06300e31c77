"""USD files: what is drawn, where, under which name, and when, as the stage says."""

from __future__ import annotations

import json
import math
import os
import zipfile

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from tests.support.gltf_files import SQUARE, TWO, Gltf
from visref.camera import Camera
from visref.camera_path import CameraPath, Frame
from visref.cli.main import main
from visref.errors import InputError
from visref.formats import load_scene
from visref.formats.usd import reader
from visref.scene import Alpha
from visref.timeline import Timeline

MOVE = """double3 xformOp:translate = ({}, 0, {})
    uniform token[] xformOpOrder = ["xformOp:translate"]
"""
METRES = '(\n    metersPerUnit = 1\n    upAxis = "Y"\n    {more}\n)\n'
TRIANGLE = """
    uniform token subdivisionScheme = "none"
    int[] faceVertexCounts = [3]
    int[] faceVertexIndices = [0, 1, 2]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
"""


def usda(body: str, *, more: str = "", head: str | None = None) -> str:
    return "#usda 1.0\n" + (METRES.format(more=more) if head is None else head) + body


def mesh(name: str, more: str = "", api: str = "") -> str:
    return f'def Mesh "{name}" {api} {{{TRIANGLE}{more}\n}}\n'


@pytest.fixture
def child():
    """Read in a process of its own, as users do."""


@pytest.fixture(autouse=True)
def here(request, monkeypatch):
    """Read in this process, which takes a second less, but where a test asks for the child."""
    if "child" not in request.fixturenames:
        monkeypatch.setattr(
            "visref.formats.usd.read_in_a_child",
            lambda name, path, budget: reader.parse_usd(path, budget),
        )


def load(folder, text: str, **options):
    (folder / "scene.usda").write_text(text)
    return load_scene(folder / "scene.usda", **options)


def corners(scene, number: int = 0):
    first, last = scene.object_offsets[number : number + 2]
    return scene.vertices[scene.triangles[first:last]].astype(np.float64) + scene.origin


def codes(scene) -> list[str]:
    return [str(code) for code, _ in scene.notes]


# --- units and axes


@pytest.mark.parametrize(
    ("head", "expected", "said"),
    [
        ('(\n metersPerUnit = 1\n upAxis = "Y"\n)\n', (10, 20, 30), ""),
        ('(\n metersPerUnit = 1\n upAxis = "Z"\n)\n', (10, 30, -20), "from units of 1 metres, +Z"),
        ('(\n metersPerUnit = 0.5\n)\n', (5, 10, 15), "from units of 0.5 metres, +Y up"),
        ("", (0.1, 0.2, 0.3), "from units of 0.01 metres, USD's default, +Y up"),
    ],
)  # fmt: skip
def test_units_and_axes_become_metres_and_y_up_and_that_is_said(tmp_path, head, expected, said):
    place = "double3 xformOp:translate = (10, 20, 30)\n"
    order = 'uniform token[] xformOpOrder = ["xformOp:translate"]\n'
    scene = load(tmp_path, usda(mesh("a", place + order), head=head))
    assert np.allclose(corners(scene)[0, 0], expected, atol=1e-6)
    notes = [text for code, text in scene.notes if code == "UNITS_CONVERTED"]
    assert len(notes) == bool(said)
    assert all(note.startswith(said) for note in notes)


@pytest.mark.parametrize("metres", ["0", "-1"])
def test_a_unit_of_no_length_is_refused(tmp_path, metres):
    with pytest.raises(InputError, match="metersPerUnit: the unit is"):
        load(tmp_path, usda(mesh("a"), head=f"(\n metersPerUnit = {metres}\n)\n"))


# --- names, order, hierarchy


def test_objects_come_depth_first_with_their_names_and_paths(tmp_path):
    text = usda(
        'def Xform "house" {\n def Xform "kitchen" {\n' + mesh("chair") + "}\n"
        + mesh("table") + "}\n" + 'def Scope "yard" {\n' + mesh("chair") + "}\n"
    )  # fmt: skip
    scene = load(tmp_path, text)
    assert scene.names == ("chair", "table", "chair#2")
    assert scene.paths == ("house/kitchen/chair", "house/table", "yard/chair")


OPS = """
    double3 xformOp:translate = (1, 2, 3)
    double3 xformOp:translate:pivot = (0.5, 0, 0)
    float3 xformOp:rotateXYZ = (10, 20, 30)
    float xformOp:rotateY = 40
    quatf xformOp:orient = (0.5, 0.5, -0.5, 0.5)
    float3 xformOp:scale = (2, 3, -4)
    matrix4d xformOp:transform = ((1, 0, 0, 0), (0, 2, 1, 0), (0, 0, 1, 0), (7, 8, 9, 1))
    float3 xformOp:rotateZYX:more = (5, 6, 7)
    float xformOp:translateX:only = 3
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:translate:pivot",
        "xformOp:rotateXYZ", "xformOp:rotateY", "xformOp:orient", "xformOp:scale",
        "!invert!xformOp:translate:pivot", "xformOp:transform", "xformOp:rotateZYX:more",
        "xformOp:translateX:only", "!invert!xformOp:orient", "!invert!xformOp:scale"]
"""


def placed_by_usd(folder, path: str, code: float | None = None):
    """world_from_object, by the library."""
    stage = Usd.Stage.Open(str(folder / "scene.usda"))
    time = Usd.TimeCode.Default() if code is None else Usd.TimeCode(code)
    prim = UsdGeom.Imageable(stage.GetPrimAtPath(path))
    return np.array(prim.ComputeLocalToWorldTransform(time)).T


def test_operations_compose_as_the_library_has_them(tmp_path):
    text = usda(f'def Xform "above" {{{OPS}\n' + mesh("a", OPS) + "}\n")
    scene = load(tmp_path, text)
    expected = placed_by_usd(tmp_path, "/above/a")
    # Entries below 10^3, a score of products of float32 angles and quaternions.
    assert np.allclose(scene.rig.worlds[0], expected, rtol=1e-5, atol=1e-4)
    assert np.linalg.det(scene.rig.worlds[0]) != 0.0


def test_a_reset_starts_from_the_root(tmp_path):
    move = "double3 xformOp:translate = (5, 0, 0)\n"
    order = 'uniform token[] xformOpOrder = ["!resetXformStack!", "xformOp:translate"]\n'
    text = usda(f'def Xform "above" {{{OPS}\n' + mesh("a", move + order) + "}\n")
    scene = load(tmp_path, text)
    assert scene.rig.worlds[0].tolist() == [[1, 0, 0, 5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]


def test_a_projective_matrix_is_refused(tmp_path):
    matrix = "matrix4d xformOp:transform = ((1,0,0,1), (0,1,0,0), (0,0,1,0), (0,0,0,1))\n"
    order = 'uniform token[] xformOpOrder = ["xformOp:transform"]\n'
    with pytest.raises(InputError, match=r"/a\.xformOp:transform: the matrix is not affine"):
        load(tmp_path, usda(mesh("a", matrix + order)))


# --- meshes


def polygon(points, counts, indices, more: str = "") -> str:
    listed = ", ".join(str(tuple(map(float, point))) for point in points)
    return f"""def Mesh "a" {{
        uniform token subdivisionScheme = "none"
        int[] faceVertexCounts = {list(counts)}
        int[] faceVertexIndices = {list(indices)}
        point3f[] points = [{listed}]
        {more}
    }}
    """


# An L, whose fan from the first corner would cover what it does not.
ELL = [(1, 1, 0), (1, 2, 0), (0, 2, 0), (0, 0, 0), (2, 0, 0), (2, 1, 0)]


def area(triangles) -> float:
    a, b, c = (triangles[:, k] for k in range(3))
    return float(np.cross(b - a, c - a)[:, 2].sum() / 2.0)


def test_polygons_keep_their_area_and_holes_are_left_out(tmp_path):
    scene = load(tmp_path, usda(polygon(ELL, [6, 3], [0, 1, 2, 3, 4, 5, 3, 4, 5])))
    assert scene.triangle_count == 5
    assert area(corners(scene)[:4]) == 3.0
    hole = "int[] holeIndices = [0]"
    scene = load(tmp_path, usda(polygon(ELL, [6, 3], [0, 1, 2, 3, 4, 5, 3, 4, 5], hole)))
    assert area(corners(scene)) == 1.0


def test_a_left_handed_mesh_is_turned(tmp_path):
    more = 'uniform token orientation = "leftHanded"\n'
    scene = load(tmp_path, usda(mesh("right") + mesh("left", more)))
    assert area(corners(scene, 0)) == 0.5
    assert area(corners(scene, 1)) == -0.5


def test_sides_are_the_mesh_s(tmp_path):
    text = usda(mesh("one") + mesh("two", "uniform bool doubleSided = 1\n"))
    assert load(tmp_path, text, cull_backfaces=True).one_sided.tolist() == [True, False]
    assert not load(tmp_path, text).one_sided.any()


def test_a_subdivision_surface_is_its_cage_and_that_is_said(tmp_path):
    text = usda(mesh("a")).replace('uniform token subdivisionScheme = "none"', "")
    scene = load(tmp_path, text)
    assert scene.triangle_count == 1
    assert "1 subdivision surface, whose cage is taken" in scene.notes[0][1]
    assert load(tmp_path, usda(mesh("a"))).notes == ()


def test_a_cube_is_its_six_faces_seen_from_outside(tmp_path):
    scene = load(tmp_path, usda('def Cube "a" {\n double size = 3\n}\n'))
    found = corners(scene)
    assert np.abs(found).max() == np.abs(found).min() == 1.5
    a, b, c = (found[:, k] for k in range(3))
    outward = np.cross(b - a, c - a)
    assert (np.einsum("ij,ij->i", outward, found.mean(axis=1)) > 0.0).all()
    assert math.isclose(np.sqrt((outward**2).sum(axis=1)).sum() / 2.0, 6 * 9)


def test_other_shapes_keep_an_id_without_triangles_and_that_is_said(tmp_path):
    scene = load(tmp_path, usda('def Sphere "ball" {\n}\ndef Points "dust" {\n}\n' + mesh("a")))
    assert scene.names == ("ball", "dust", "a")
    assert np.diff(scene.object_offsets).tolist() == [0, 0, 1]
    assert "2 shapes neither mesh nor cube, left out: Sphere /ball" in [t for _, t in scene.notes]


@pytest.mark.parametrize(
    ("counts", "indices", "more", "match"),
    [
        ([3], [0, 1, 2, 3], "", "its polygons have 3 corners, and 4 are listed"),
        ([-3, 6], [0, 1, 2], "", "its polygons have 3 corners"),
        ([3], [0, 1, 6], "", "names vertex 6 of 6"),
        ([3], [0, 1, -1], "", "names vertex -1 of 6"),
        ([3], [0, 1, 2], "int[] holeIndices = [1]", "holeIndices names a face that it does not"),
    ],
)
def test_a_mesh_that_contradicts_itself_is_refused_with_its_place(
    tmp_path, counts, indices, more, match
):
    with pytest.raises(InputError, match=f"/a: .*{match}"):
        load(tmp_path, usda(polygon(ELL, counts, indices, more)))


# --- what is drawn


def test_proxies_and_guides_are_left_out_and_that_is_said(tmp_path):
    token = 'uniform token purpose = "{}"\n'
    text = usda(
        mesh("plain") + mesh("render", token.format("render"))
        + 'def Xform "guides" {\n' + token.format("guide") + mesh("b")
        + mesh("shown", token.format("default")) + "}\n" + mesh("proxy", token.format("proxy"))
    )  # fmt: skip
    scene = load(tmp_path, text)
    assert scene.names == ("plain", "render", "shown")
    assert [text for _, text in scene.notes] == [
        "1 prim of purpose 'guide' left out",
        "1 prim of purpose 'proxy' left out",
    ]


def test_inactive_and_abstract_prims_are_no_objects(tmp_path):
    text = usda(
        'class "c" {\n' + mesh("x") + "}\n" + 'over "o" {\n' + mesh("y") + "}\n"
        + mesh("off", api="(active = false)") + mesh("on")
    )  # fmt: skip
    assert load(tmp_path, text).names == ("on",)


def test_what_is_invisible_keeps_its_id_and_is_absent(tmp_path):
    off = 'token visibility = "invisible"\n'
    text = usda(f'def Xform "x" {{\n{off}' + mesh("below") + "}\n" + mesh("a"))
    scene = load(tmp_path, text)
    assert scene.names == ("below", "a")
    assert scene.absent.tolist() == [True, False]


SURFACE = """def Material "m" {
    token outputs:surface.connect = </m/s.outputs:surface>
    def Shader "s" {
        uniform token info:id = "UsdPreviewSurface"
        %s
        token outputs:surface
    }
    def Shader "t" {
        uniform token info:id = "UsdUVTexture"
        float outputs:a
    }
}
"""
BOUND = ("rel material:binding = </m>\n", '(prepend apiSchemas = ["MaterialBindingAPI"])')


@pytest.mark.parametrize(
    ("inputs", "alphas"),
    [
        ("", [Alpha.OPAQUE]),
        ("float inputs:opacity = 0.5", [Alpha.BLEND]),
        ("float inputs:opacity = 1", [Alpha.OPAQUE]),
        ("float inputs:opacity = 0.5\nfloat inputs:opacityThreshold = 0.4", [Alpha.OPAQUE]),
        ("float inputs:opacity = 0.3\nfloat inputs:opacityThreshold = 0.4", []),
        ("float inputs:opacity.connect = </m/t.outputs:a>", [Alpha.BLEND]),
        (
            "float inputs:opacity.connect = </m/t.outputs:a>\nfloat inputs:opacityThreshold = 0.5",
            [Alpha.MASK],
        ),
    ],
)
def test_opacity_says_what_a_surface_hides(tmp_path, inputs, alphas):
    scene = load(tmp_path, usda(SURFACE % inputs + mesh("a", *BOUND) + mesh("b")))
    assert scene.alpha.tolist() == [*alphas, Alpha.OPAQUE]
    masked = Alpha.MASK in alphas
    assert ["alpha mask cannot be looked up" in t for _, t in scene.notes if masked] == [
        True
    ] * masked


def test_parts_of_a_mesh_have_their_own_materials(tmp_path):
    part = """def GeomSubset "p" (prepend apiSchemas = ["MaterialBindingAPI"]) {
        uniform token elementType = "face"
        uniform token familyName = "materialBind"
        int[] indices = [1]
        rel material:binding = </m>
    }"""
    square = polygon([*SQUARE.tolist()], [3, 3], TWO.tolist(), part)
    scene = load(tmp_path, usda(SURFACE % "float inputs:opacity = 0.5" + square))
    assert scene.alpha.tolist() == [Alpha.OPAQUE, Alpha.BLEND]
    assert scene.names == ("a",)


def test_another_shader_is_opaque_and_that_is_said(tmp_path):
    text = (SURFACE % "").replace("UsdPreviewSurface", "acme_glass")
    scene = load(tmp_path, usda(text + mesh("a", *BOUND)))
    assert scene.alpha.tolist() == [Alpha.OPAQUE]
    assert "without a UsdPreviewSurface count as opaque, first /m" in scene.notes[0][1]


@pytest.mark.parametrize(("opacity", "alpha"), [(0.5, Alpha.BLEND), (1, Alpha.OPAQUE)])
def test_without_a_material_the_displayed_opacity_counts(tmp_path, opacity, alpha):
    scene = load(tmp_path, usda(mesh("a", f"float[] primvars:displayOpacity = [{opacity}]\n")))
    assert scene.alpha.tolist() == [alpha]


def test_a_skinned_mesh_stands_as_bound_and_that_is_said(tmp_path):
    more = "int[] primvars:skel:jointIndices = [0, 0, 0]\n"
    scene = load(tmp_path, usda(mesh("a", more, '(prepend apiSchemas = ["SkelBindingAPI"])')))
    assert scene.triangle_count == 1
    assert "1 skinned mesh not posed by a skeleton, first /a" in scene.notes[0][1]


# --- instances


def test_instances_of_a_scene_graph_share_a_mesh_and_are_objects_each(tmp_path):
    text = usda(
        'class Xform "tree" {\n' + mesh("leaf") + mesh("stem") + "}\n"
        + "".join(
            f'def "t{i}" (\n instanceable = true\n inherits = </tree>\n) {{\n{move}}}\n'
            for i, move in enumerate(MOVE.format(i, 0) for i in range(3))
        )
    )  # fmt: skip
    scene = load(tmp_path, text)
    assert scene.names == ("leaf", "stem", "leaf#2", "stem#2", "leaf#3", "stem#3")
    assert scene.paths[4] == "t2/leaf"
    assert scene.rig.mesh_of_object.tolist() == [0, 1] * 3
    assert scene.rig.worlds[:, 0, 3].tolist() == [0, 0, 1, 1, 2, 2]


def instancer(more: str, prototypes: str | None = None) -> str:
    if prototypes is None:
        prototypes = (
            'over "kept" {\n def Xform "one" {\n' + MOVE.format(0, 5) + mesh("leaf") + "}\n"
            + 'def Xform "two" {\n' + mesh("x") + mesh("y") + "}\n}\n"
        )  # fmt: skip
    return f"""def PointInstancer "trees" {{
        rel prototypes = [</trees/kept/one>, </trees/kept/two>]
        {more}
        {prototypes}
    }}
    """


POINTS = """
    int[] protoIndices = [0, 1, 0]
    point3f[] positions = [(1, 0, 0), (2, 0, 0), (3, 0, 0)]
    quath[] orientations = [(1, 0, 0, 0), (0, 0, 0, 1), (1, 0, 0, 0)]
    float3[] scales = [(2, 2, 2), (1, 1, 1), (1, 1, 1)]
"""


def test_a_point_instancer_s_objects_stand_at_their_points_and_are_a_group(tmp_path):
    scene = load(tmp_path, usda(instancer(POINTS) + mesh("last")))
    assert scene.names == ("leaf", "x", "y", "leaf#2", "last")
    assert scene.paths[:4] == ("trees/one/leaf", "trees/two/x", "trees/two/y", "trees/one/leaf")
    (group,) = scene.groups
    assert (group.name, group.path, group.objects) == ("trees", "trees", (0, 1, 2, 3))
    worlds = scene.rig.worlds
    # Twice the size, its prototype's own place with it; half a turn about z.
    assert worlds[0].tolist() == [[2, 0, 0, 1], [0, 2, 0, 0], [0, 0, 2, 10], [0, 0, 0, 1]]
    assert worlds[1].tolist() == [[-1, 0, 0, 2], [0, -1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    assert worlds[3, :3, 3].tolist() == [3, 0, 5]


def test_the_library_places_the_instances_alike(tmp_path):
    load(tmp_path, usda(instancer(POINTS)))
    stage = Usd.Stage.Open(str(tmp_path / "scene.usda"))
    made = UsdGeom.PointInstancer(stage.GetPrimAtPath("/trees"))
    default = Usd.TimeCode.Default()
    expected = made.ComputeInstanceTransformsAtTime(default, default)
    worlds = load_scene(tmp_path / "scene.usda").rig.worlds
    # The object of the first instance, of the second (twice), of the third; float32 quaternions.
    for number, instance in ((0, 0), (1, 1), (2, 1), (3, 2)):
        assert np.allclose(worlds[number], np.array(expected[instance]).T, atol=1e-6)


def test_invisible_instances_keep_their_ids_and_are_absent(tmp_path):
    scene = load(tmp_path, usda(instancer(POINTS + "int64[] invisibleIds = [1]\n")))
    assert scene.absent.tolist() == [False, True, True, False]


def test_instancers_stand_in_prototypes(tmp_path):
    inner = instancer(POINTS).replace("/trees/kept", "/outer/trees/kept")
    outer = f"""def PointInstancer "outer" {{
        rel prototypes = </outer/trees>
        int[] protoIndices = [0, 0]
        point3f[] positions = [(0, 10, 0), (0, 20, 0)]
        {inner}
    }}
    """
    scene = load(tmp_path, usda(outer))
    assert len(scene.names) == 8
    assert scene.rig.worlds[:, 1, 3].tolist() == [10] * 4 + [20] * 4


@pytest.mark.parametrize(
    ("points", "match"),
    [
        (POINTS.replace("[0, 1, 0]", "[0, 2, 0]"), "prototype that is none of its 2"),
        (POINTS.replace("[0, 1, 0]", "[0, 1]"), "3 positions for 2 instances"),
        (POINTS.replace(", (3, 0, 0)", ""), "2 positions for 3 instances"),
    ],
)
def test_an_instancer_that_contradicts_itself_is_refused(tmp_path, points, match):
    with pytest.raises(InputError, match=f"/trees: .*{match}"):
        load(tmp_path, usda(instancer(points)))


def test_an_instancer_of_itself_is_refused(tmp_path):
    text = instancer(POINTS).replace("</trees/kept/one>", "</trees>")
    with pytest.raises(InputError, match="prototype /trees instances itself"):
        load(tmp_path, usda(text))


def test_a_prototype_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(InputError, match="prototype /trees/kept/one is not there"):
        load(tmp_path, usda(instancer(POINTS, "")))


# --- in time


ANIMATED = """
    double3 xformOp:translate.timeSamples = { 0: (0, 0, 0), 48: (4, 0, -2) }
    float3 xformOp:rotateXYZ.timeSamples = { 12: (0, 0, 0), 36: (90, 30, 10) }
    quatf xformOp:orient.timeSamples = { 0: (1, 0, 0, 0), 24: (-0.6, 0, -0.8, 0), 30: (0, 1, 0, 0) }
    float3 xformOp:scale = (1, 2, 1)
    float3 xformOp:scale.timeSamples = { 10: (2, 2, 2) }
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ", "xformOp:orient",
        "xformOp:scale"]
"""


def pose(scene, time_s: float):
    moment = scene.rig.motion.at(0, time_s)
    worlds = dict(zip(moment.objects.tolist(), moment.worlds, strict=True))
    return worlds, moment


@pytest.mark.parametrize("code", [-5, 0, 7.5, 12, 24, 27, 30, 36, 48, 100])
def test_transforms_in_time_are_the_library_s(tmp_path, code):
    text = usda(
        f'def Xform "x" {{{ANIMATED}\n def Xform "y" {{{ANIMATED}\n' + mesh("a") + "}\n"
        + mesh("b", OPS) + "}\n" + mesh("still"),
        more="timeCodesPerSecond = 24",
    )  # fmt: skip
    scene = load(tmp_path, text)
    worlds, _ = pose(scene, code / 24.0)
    assert sorted(worlds) == [0, 1]
    for number, path in ((0, "/x/y/a"), (1, "/x/b")):
        expected = placed_by_usd(tmp_path, path, code)
        # Entries below 10^3, and the library interpolates float32 in float32.
        assert np.allclose(worlds[number], expected, rtol=1e-5, atol=1e-4)
    assert scene.rig.motion.affected(0).tolist() == [True, True, False]


def test_at_rest_stands_the_default_or_else_the_first_sample(tmp_path):
    scene = load(tmp_path, usda(mesh("a", ANIMATED)))
    assert scene.rig.worlds[0].tolist() == np.diag([1, 2, 1, 1]).tolist()


def test_visibility_in_time_holds_its_keys(tmp_path):
    keys = 'token visibility.timeSamples = { 24: "inherited", 48: "invisible", 72: "inherited" }\n'
    text = usda(f'def Xform "x" {{\n{keys}' + mesh("below") + "}\n" + mesh("a"))
    scene = load(tmp_path, text)
    assert scene.absent is None
    hidden = [pose(scene, code / 24.0)[1].hidden.tolist() for code in (0, 24, 47, 48, 71, 72)]
    assert hidden == [[on, False] for on in (False, False, False, True, True, False)]


def test_points_in_time_are_interpolated_and_only_used_ones_kept(tmp_path):
    text = usda(
        """def Mesh "a" {
        uniform token subdivisionScheme = "none"
        int[] faceVertexCounts = [3]
        int[] faceVertexIndices = [1, 2, 3]
        point3f[] points.timeSamples = {
            0: [(9, 9, 9), (0, 0, 0), (1, 0, 0), (0, 1, 0)],
            24: [(9, 9, 9), (0, 0, 4), (1, 0, 8), (0, 1, 0)]
        }
    }
    """,
    )
    scene = load(tmp_path, text)
    _, moment = pose(scene, 0.25)
    assert moment.positions[0].tolist() == [[0, 0, 1], [1, 0, 2], [0, 1, 0]]
    frames = (Frame((Camera(np.eye(4), 8, 6, near=0.1, yfov=1.0),), time_s=t) for t in (0, 0.5))
    timeline = Timeline(scene, CameraPath(tuple(frames)))
    assert timeline.at(1).vertices.tolist() == [[0, 0, 2], [1, 0, 4], [0, 1, 0]]
    assert timeline.changed(1).tolist() == [True]


def test_time_codes_are_seconds_by_the_stage_s_own_rate(tmp_path):
    keys = "double3 xformOp:translate.timeSamples = { 0: (0, 0, 0), 10: (1, 0, 0) }\n"
    order = 'uniform token[] xformOpOrder = ["xformOp:translate"]\n'
    scene = load(tmp_path, usda(mesh("a", keys + order), more="timeCodesPerSecond = 10"))
    assert pose(scene, 0.5)[0][0][0, 3] == 0.5


def test_what_instances_do_in_time_is_played(tmp_path):
    """The instancer itself moves; its points and prototypes that move stand, and that is said."""
    text = usda(
        f'def Xform "x" {{{ANIMATED}\n' + instancer(POINTS).replace("/trees", "/x/trees") + "}\n"
    )
    scene = load(tmp_path, text)
    worlds, _ = pose(scene, 1.0)
    above = placed_by_usd(tmp_path, "/x", 24)
    rest = load(tmp_path, usda(instancer(POINTS))).rig.worlds
    for number in range(4):
        assert np.allclose(worlds[number], above @ rest[number], rtol=1e-5, atol=1e-5)
    moving = (
        POINTS + "point3f[] positions.timeSamples = { 0: [(1, 0, 0), (2, 0, 0), (3, 0, 0)], "
        "5: [(1, 0, 1), (2, 0, 0), (3, 0, 0)] }\n"
    )
    scene = load(tmp_path, usda(instancer(moving)))
    assert codes(scene) == ["ANIMATION_IGNORED"]
    assert "1 animated property stands as at rest, first '/trees.positions'" in scene.notes[0][1]


def test_a_prototype_that_moves_stands_and_that_is_said(tmp_path):
    keys = "double3 xformOp:translate.timeSamples = { 0: (0, 0, 5), 5: (0, 0, 6) }"
    still = usda(instancer(POINTS))
    moving = still.replace("double3 xformOp:translate = (0, 0, 5)", keys)
    assert moving != still
    scene = load(tmp_path, moving)
    assert scene.digest == load(tmp_path, still).digest
    assert codes(load(tmp_path, moving)) == ["ANIMATION_IGNORED"]


def test_a_spline_stands_and_that_is_said(tmp_path):
    order = 'uniform token[] xformOpOrder = ["xformOp:rotateX"]\n'
    spline = "double xformOp:rotateX.spline = {\n 0: 0,\n 24: 90,\n}\n"
    scene = load(tmp_path, usda(mesh("a", "double xformOp:rotateX = 0\n" + spline + order)))
    assert codes(scene) == ["ANIMATION_IGNORED"]
    assert scene.rig.motion is None


def test_changing_topology_stands_and_that_is_said(tmp_path):
    text = usda(mesh("a")).replace(
        "int[] faceVertexCounts = [3]", "int[] faceVertexCounts.timeSamples = { 0: [3], 1: [3] }"
    )
    scene = load(tmp_path, text)
    assert codes(scene) == ["ANIMATION_IGNORED"]
    assert scene.rig.motion is None


def test_digests_tell_motions_apart(tmp_path):
    digests = {
        load(tmp_path, usda(mesh("a", ANIMATED.replace("36:", f"{k}:")))).digest for k in (36, 37)
    }
    assert len(digests) == 2


def test_an_animated_stage_without_time_is_refused_by_a_timeline(tmp_path):
    scene = load(tmp_path, usda(mesh("a", ANIMATED)))
    frame = Frame((Camera(np.eye(4), 8, 6, near=0.1, yfov=1.0),))
    with pytest.raises(InputError, match="the scene animates 1 objects"):
        Timeline(scene, CameraPath((frame,)))


# --- files


def test_references_are_followed_and_missing_ones_said(tmp_path):
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "chair.usda").write_text(
        usda(mesh("chair"), head='(\n defaultPrim = "chair"\n metersPerUnit = 1\n)\n')
    )
    text = usda(
        'def "one" (references = @./parts/chair.usda@) {\n}\n'
        'def "two" (references = @parts/absent.usda@) {\n}\n'
    )
    scene = load(tmp_path, text)
    assert scene.names == ("one",)
    notes = [note for code, note in scene.notes if code == "PARTLY_READ"]
    assert notes == ["1 file that it names cannot be opened, first 'parts/absent.usda'"]


@pytest.mark.parametrize("name", ["/etc/passwd.usda", "file:///x.usda", "https://a/b.usd"])
def test_names_that_are_not_beside_the_file_are_refused(tmp_path, name):
    with pytest.raises(InputError, match="which is not a file beside it"):
        load(tmp_path, usda(f'def "a" (references = @{name}@) {{\n}}\n'))


def test_value_clips_are_refused(tmp_path):
    """A library opens what they name when a value is asked for, be it absolute or a pipe."""
    clips = """( clips = { dictionary default = {
        asset[] assetPaths = [@/etc/clip.usda@]
        double2[] active = [(0, 0)]
        double2[] times = [(0, 0), (9, 9)]
        string primPath = "/a"
    } } )"""
    with pytest.raises(InputError, match="/a: value clips are not read"):
        load(tmp_path, usda(mesh("a", api=clips)))


def test_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe.usda")
    with pytest.raises(InputError, match=r"file 'pipe\.usda': this is a pipe, a device"):
        load(tmp_path, usda('def "a" (references = @pipe.usda@) {\n}\n'))


def test_binary_and_zipped_files_are_the_same_scene(tmp_path):
    text = usda(f'def Xform "x" {{{ANIMATED}\n' + mesh("a") + "}\n" + instancer(POINTS))
    expected = load(tmp_path, text)
    stage = Usd.Stage.Open(str(tmp_path / "scene.usda"))
    stage.Export(str(tmp_path / "b.usdc"))
    stage.Export(str(tmp_path / "c.usd"))
    data = (tmp_path / "b.usdc").read_bytes()
    with zipfile.ZipFile(tmp_path / "d.usdz", "w", zipfile.ZIP_STORED) as archive:
        entry = zipfile.ZipInfo("b.usdc")
        # The package's files start at multiples of 64 bytes.
        padding = -(30 + len("b.usdc") + 4) % 64
        entry.extra = b"\x86\x19" + padding.to_bytes(2, "little") + bytes(padding)
        archive.writestr(entry, data)
    for name in ("b.usdc", "c.usd", "d.usdz"):
        assert load_scene(tmp_path / name).digest == expected.digest


@pytest.mark.parametrize("text", ["", "#usda 1.0\ndef {", "not USD", "#usda 1.0\n" + "{" * 5000])
def test_what_is_no_usd_is_refused_in_one_line(tmp_path, text):
    with pytest.raises(InputError) as error:
        load(tmp_path, text)
    assert len(str(error.value).splitlines()) == 1


def test_a_missing_extra_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"needs usd-core; run: pip install 'visref\[usd\]'"):
        load(tmp_path, usda(mesh("a")))


def test_without_the_extra_a_command_ends_with_status_2_and_a_line(tmp_path, monkeypatch, capsys):
    (tmp_path / "scene.usda").write_text(usda(mesh("a")))
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert main(["objects", str(tmp_path / "scene.usda")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith("run: pip install 'visref[usd]'")


def test_the_child_hands_over_the_same_scene_and_motion(tmp_path, monkeypatch, child):
    keys = 'token visibility.timeSamples = { 24: "inherited", 48: "invisible" }\n'
    body = f'def Xform "x" {{{ANIMATED}{keys}\n' + mesh("a")
    body += instancer(POINTS + "int64[] invisibleIds = [2]\n").replace("/trees", "/x/trees")
    text = usda(body + "}\n" + mesh("last", 'token visibility = "invisible"\n'))
    there = load(tmp_path, text)
    monkeypatch.setattr(
        "visref.formats.usd.read_in_a_child", lambda _, path, budget: reader.parse_usd(path, budget)
    )
    here = load(tmp_path, text)
    assert there.digest == here.digest
    assert there.groups == here.groups
    assert there.absent.tolist() == here.absent.tolist() == [False] * 4 + [True] * 2
    for time in (0.3, 2.5):
        (a, one), (b, other) = pose(there, time), pose(here, time)
        assert np.array_equal(np.array(list(a.values())), np.array(list(b.values())))
        assert one.hidden.tolist() == other.hidden.tolist()


def test_references_that_double_at_every_level_are_refused_in_one_line(tmp_path, child):
    levels = "".join(
        f'def Xform "n{i}" {{\n def "a" (instanceable = true\nreferences = </n{i + 1}>) {{}}\n'
        f' def "b" (instanceable = true\nreferences = </n{i + 1}>) {{}}\n}}\n'.replace("{}", "{\n}")
        for i in range(30)
    )
    text = usda(levels + 'def Xform "n30" {\n' + mesh("a") + "}\n")
    with pytest.raises(InputError) as error:
        load(tmp_path, text, max_memory=300 << 20)
    assert len(str(error.value).splitlines()) == 1


def test_the_same_scene_as_glb_gets_the_same_vertices(tmp_path):
    gltf = Gltf()
    number = gltf.mesh(gltf.primitive(SQUARE, TWO))
    gltf.node(mesh=number, name="a", translation=[0, 0, -5])
    gltf.node(mesh=number, name="b", translation=[0, 0, -7], scale=[2, 2, 2])
    expected = load_scene(gltf.write(tmp_path / "scene.glb"))
    square = polygon(SQUARE.tolist(), [4], [0, 1, 2, 3], "{}")
    move = "double3 xformOp:translate = (0, 0, {})\n float3 xformOp:scale = ({}, {}, {})\n"
    order = 'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]\n'
    text = "".join(
        square.replace('"a"', f'"{name}"').replace("{}", move.format(z, s, s, s) + order)
        for name, z, s in (("a", -5, 1), ("b", -7, 2))
    )
    found = load(tmp_path, usda(text))
    assert found.names == expected.names
    assert found.vertices.tobytes() == expected.vertices.tobytes()
    assert found.triangles.tobytes() == expected.triangles.tobytes()


@pytest.mark.slow
def test_the_same_scene_as_glb_gets_the_same_verdict(tmp_path, child):
    """A small square before a large one, and one behind it: what is left out convicts alike."""
    gltf = Gltf()
    number = gltf.mesh(gltf.primitive(SQUARE, TWO))
    places = (("near", -4, 1), ("wall", -5, 2), ("hidden", -6, 1))
    for name, z, size in places:
        gltf.node(mesh=number, name=name, translation=[0, 0, z], scale=[size] * 3)
    gltf.write(tmp_path / "scene.glb")
    move = "double3 xformOp:translate = (0, 0, {})\n float3 xformOp:scale = ({}, {}, {})\n"
    order = 'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]\n'
    square = polygon(SQUARE.tolist(), [4], [0, 1, 2, 3], "{}")
    text = "".join(
        square.replace('"a"', f'"{name}"').replace("{}", move.format(z, s, s, s) + order)
        for name, z, s in places
    )
    (tmp_path / "scene.usda").write_text(usda(text))
    camera = Camera(np.eye(4), 32, 24, near=0.1, far=50.0, yfov=1.0)
    (tmp_path / "path.json").write_text(json.dumps(CameraPath((camera, camera)).to_json()))
    lines = [{"frame": 0, "visible": ["near", "wall"]}, {"frame": 1, "visible": ["near"]}]
    (tmp_path / "sets.jsonl").write_text("\n".join(map(json.dumps, lines)))
    verdicts = []
    for name in ("scene.glb", "scene.usda"):
        out = tmp_path / f"run-{name}"
        status = main([
            "check", str(tmp_path / name), "--path", str(tmp_path / "path.json"),
            "--visible", str(tmp_path / "sets.jsonl"), "--out", str(out), "--pictures", "0",
        ])  # fmt: skip
        assert status == 1
        verdicts.append(json.loads((out / "verdict.json").read_text()))
    assert verdicts[0] == verdicts[1]
    (culler,) = verdicts[0]["cullers"].values()
    assert (culler["missed"], culler["confirmed"]) == (1, 1)
