"""COLLADA files: units, axes, instances and names as the file says."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from visref.errors import InputError
from visref.formats import load_scene
from visref.formats.collada import parse_collada
from visref.memory import Budget

pytest.importorskip("collada", reason="the extra 'collada' is not installed")

GEOMETRY = """
<geometry id="{id}" name="{id}"><mesh>
  <source id="{id}-p"><float_array id="{id}-a" count="12">0 0 0 1 0 0 1 1 0 0 1 0</float_array>
    <technique_common><accessor source="#{id}-a" count="4" stride="3">
      <param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/>
    </accessor></technique_common></source>
  <vertices id="{id}-v"><input semantic="POSITION" source="#{id}-p"/></vertices>
  {primitives}
</mesh></geometry>"""
TRIANGLES = """<triangles count="1" material="m">
  <input semantic="VERTEX" source="#{id}-v" offset="0"/><p>0 1 {last}</p></triangles>"""
POLYLIST = """<polylist count="1" material="m">
  <input semantic="VERTEX" source="#{id}-v" offset="0"/>
  <vcount>4</vcount><p>0 1 2 3</p></polylist>"""


def dae(nodes: str, *, unit: float = 1.0, up: str = "Y_UP", last: int = 2, more: str = "") -> str:
    primitives = TRIANGLES.format(id="g", last=last) + POLYLIST.format(id="g")
    return f"""<?xml version="1.0" encoding="utf-8"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit meter="{unit}" name="u"/><up_axis>{up}</up_axis></asset>
<library_effects><effect id="two-sided"><profile_COMMON><technique sid="common"><phong>
  <diffuse><color>1 1 1 1</color></diffuse></phong></technique>
  <extra><technique profile="GOOGLEEARTH"><double_sided>1</double_sided></technique></extra>
  </profile_COMMON></effect></library_effects>
<library_materials><material id="mat"><instance_effect url="#two-sided"/></material>
  </library_materials>
<library_geometries>{GEOMETRY.format(id="g", primitives=primitives)}</library_geometries>
{more}
<library_visual_scenes><visual_scene id="s">{nodes}</visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


INSTANCE = '<instance_geometry url="#g"/>'


def load(folder, text: str, **options):
    (folder / "scene.dae").write_text(text)
    return load_scene(folder / "scene.dae", **options)


@pytest.mark.parametrize(
    ("up", "expected"),
    [("Y_UP", (10, 20, 30)), ("Z_UP", (10, 30, -20)), ("X_UP", (-20, 10, 30))],
)
def test_units_and_up_axis_are_applied(tmp_path, up, expected):
    node = f'<node id="n"><translate>10 20 30</translate>{INSTANCE}</node>'
    scene = load(tmp_path, dae(node, unit=0.5, up=up))
    first = scene.vertices[scene.triangles[0, 0]] + scene.origin
    assert first.tolist() == [v * 0.5 for v in expected]
    corners = scene.vertices[scene.triangles[0]]
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    # A rotation, not a mirror: the file's +Z normal goes where +Z goes, and stays in front.
    assert normal.tolist() == ([0, 0.25, 0] if up == "Z_UP" else [0, 0, 0.25])


def test_instanced_nodes_are_objects_and_primitives_are_not(tmp_path):
    nodes = (
        f'<node id="a" name="first">{INSTANCE}'
        f'<node id="b"><translate>5 0 0</translate>{INSTANCE}</node></node>'
        '<node id="c"><translate>0 9 0</translate><instance_node url="#tree"/></node>'
    )
    library = f'<library_nodes><node id="tree" name="tree">{INSTANCE}</node></library_nodes>'
    scene = load(tmp_path, dae(nodes, more=library))
    assert scene.names == ("first", "b", "tree")
    assert scene.paths == ("first", "first/b", "c/tree")
    assert np.diff(scene.object_offsets).tolist() == [3, 3, 3]
    starts = scene.vertices[scene.triangles[scene.object_offsets[:-1], 0]]
    assert starts.tolist() == [[0, 0, 0], [5, 0, 0], [0, 9, 0]]


def test_double_sided_material_stays_two_sided(tmp_path):
    bound = (
        '<instance_geometry url="#g"><bind_material><technique_common>'
        '<instance_material symbol="m" target="#mat"/></technique_common></bind_material>'
        "</instance_geometry>"
    )
    nodes = f'<node id="a">{INSTANCE}</node><node id="b">{bound}</node>'
    scene = load(tmp_path, dae(nodes), cull_backfaces=True)
    assert scene.one_sided.tolist() == [True] * 3 + [False] * 3


STAR = "0 0 0 10 6 0 20 0 0 14 10 0 20 20 0 10 14 0 0 20 0 6 10 0"


def star(primitive: str) -> str:
    """A geometry of one polygon with eight corners, four of them turned inwards."""
    text = dae(f'<node id="a">{INSTANCE}</node>')
    text = text.replace("0 0 0 1 0 0 1 1 0 0 1 0", STAR).replace('count="12"', 'count="24"')
    text = text.replace('count="4" stride', 'count="8" stride')
    start, end = text.index("<triangles"), text.index("</polylist>") + len("</polylist>")
    return text[:start] + primitive + text[end:]


VERTEX = '<input semantic="VERTEX" source="#g-v" offset="0"/>'
POLYGONS = f'<polygons count="1">{VERTEX}<p>0 1 2 3 4 5 6 7</p></polygons>'


@pytest.mark.parametrize(
    "primitive",
    [
        POLYGONS,
        f'<polylist count="1">{VERTEX}<vcount>8</vcount><p>0 1 2 3 4 5 6 7</p></polylist>',
    ],
)
def test_a_polygon_that_is_not_convex_has_its_own_area(tmp_path, primitive):
    scene = load(tmp_path, star(primitive))
    corners = scene.vertices[scene.triangles].astype(np.float64)
    twice = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2]
    assert (twice > 0).all()
    assert twice.sum() == 2 * 160


def test_polygons_with_holes_or_too_few_corners_are_errors(tmp_path):
    hole = POLYGONS.replace("<p>", "<ph><p>").replace("</p>", "</p><h>0 2 4</h></ph>")
    with pytest.raises(InputError, match="geometry 'g': a polygon has holes"):
        load(tmp_path, star(POLYGONS + hole))
    short = f'<polylist count="1">{VERTEX}<vcount>9</vcount><p>0 1 2 3 4 5 6 7</p></polylist>'
    with pytest.raises(InputError, match="have 9 corners, and 8 are listed"):
        load(tmp_path, star(short))


def test_index_out_of_range_is_an_error(tmp_path):
    with pytest.raises(InputError, match=r"scene\.dae: "):
        load(tmp_path, dae(f'<node id="a">{INSTANCE}</node>', last=9))


def test_without_its_library_it_is_refused(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "collada", None)
    file = tmp_path / "scene.dae"
    file.write_text(dae(f'<node id="a">{INSTANCE}</node>'))
    with pytest.raises(InputError, match="reading COLLADA needs pycollada"):
        parse_collada(file, Budget.of(None))


def test_geometry_that_the_library_cannot_read_is_an_error(tmp_path):
    text = dae(f'<node id="a">{INSTANCE}</node>').replace("<mesh>", "<spline>", 1)
    text = text.replace("</mesh>", "</spline>", 1)
    with pytest.raises(InputError, match="a geometry is lost"):
        load(tmp_path, text)


def test_comments_and_instructions_mean_nothing(tmp_path):
    node = f'<node id="n">{INSTANCE}</node>'
    plain = load(tmp_path, dae(node))
    head, mark, body = dae(node).partition("?>")
    for more in ("<!-- <mesh/> -->", "<?tool <mesh/> ?>", "<!---->"):
        scene = load(
            tmp_path, head + mark + body.replace("><", f">{more}<").replace("0 1 2", f"0 1{more} 2")
        )
        assert (scene.digest, scene.names) == (plain.digest, plain.names)
        assert scene.notes == plain.notes


def test_what_looks_like_a_comment_in_a_cdata_section_is_text(tmp_path):
    node = f'<node id="n">{INSTANCE}</node>'
    numbers = dae(node).replace("0 0 0 1 0 0", "<![CDATA[0 0 0 1 0 0]]>")
    assert load(tmp_path, numbers).digest == load(tmp_path, dae(node)).digest
    with pytest.raises(InputError):
        load(tmp_path, dae(node).replace("0 0 0 1 0 0", "<![CDATA[0 0 0 <!-- 9 --> 1 0 0]]>"))
