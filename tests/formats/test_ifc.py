"""IFC files: products as their structure holds them, in metres and +Y up."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest

from tests.support.gltf_files import Gltf
from visref.camera import Camera, look_at
from visref.camera_path import CameraPath
from visref.cli.main import main
from visref.errors import InputError
from visref.formats import load_scene
from visref.formats.ifc import reader
from visref.recordings.names import Names
from visref.scene import Alpha

HEAD = """ISO-10303-21;
HEADER;
FILE_DESCRIPTION((''),'2;1');
FILE_NAME('','',(''),(''),'','','');
FILE_SCHEMA(('{schema}'));
ENDSEC;
DATA;
#1=IFCPROJECT('{guid}P',$,'project',$,$,$,$,(#10),#20);
#10=IFCGEOMETRICREPRESENTATIONCONTEXT($,'Model',3,1.E-05,#11,$);
#11=IFCAXIS2PLACEMENT3D(#12,$,$);
#12=IFCCARTESIANPOINT((0.,0.,0.));
#13=IFCAXIS2PLACEMENT2D(#14,$);
#14=IFCCARTESIANPOINT((0.,0.));
#20=IFCUNITASSIGNMENT((#21));
{unit}
#30=IFCSITE('{guid}S',$,'site',$,$,#31,$,$,$,$,$,$,$,$);
#31=IFCLOCALPLACEMENT($,#11);
#32=IFCBUILDING('{guid}B',$,'building',$,$,#31,$,$,$,$,$,$);
#33=IFCBUILDINGSTOREY('{guid}T',$,'storey',$,$,#31,$,$,$,$);
#34=IFCRELAGGREGATES('{guid}0',$,$,$,#1,(#30));
#35=IFCRELAGGREGATES('{guid}1',$,$,$,#30,(#32));
#36=IFCRELAGGREGATES('{guid}2',$,$,$,#32,(#33));
#37=IFCDIRECTION((0.,0.,1.));
"""
GUID = "0YvctVUKr0kugbFTf53O9"
MILLIMETRES = "#21=IFCSIUNIT(*,.LENGTHUNIT.,.MILLI.,.METRE.);"
METRES = "#21=IFCSIUNIT(*,.LENGTHUNIT.,$,.METRE.);"
FEET = """#21=IFCCONVERSIONBASEDUNIT(#22,.LENGTHUNIT.,'FOOT',#23);
#22=IFCDIMENSIONALEXPONENTS(1,0,0,0,0,0,0);
#23=IFCMEASUREWITHUNIT(IFCLENGTHMEASURE(0.3048),#24);
#24=IFCSIUNIT(*,.LENGTHUNIT.,$,.METRE.);"""


def guid(number: int) -> str:
    return f"{number:022d}"


class Ifc:
    """A file under construction: boxes, each about a place of its own."""

    def __init__(self, unit: str = METRES, schema: str = "IFC4") -> None:
        self.text = HEAD.format(schema=schema, unit=unit, guid=GUID)
        self.last = 100
        self.held: list[int] = []

    def line(self, entity: str) -> int:
        self.last += 1
        self.text += f"#{self.last}={entity};\n"
        return self.last

    def solid(self, x: float, y: float, z: float) -> int:
        """A box, its lower face about the origin: a profile that is pulled up."""
        profile = self.line(f"IFCRECTANGLEPROFILEDEF(.AREA.,$,#13,{x:.6f},{y:.6f})")
        return self.line(f"IFCEXTRUDEDAREASOLID(#{profile},#11,#37,{z:.6f})")

    def shape(self, item: int, kind: str = "SweptSolid") -> int:
        body = self.line(f"IFCSHAPEREPRESENTATION(#10,'Body','{kind}',(#{item}))")
        return self.line(f"IFCPRODUCTDEFINITIONSHAPE($,$,(#{body}))")

    def place(self, x: float, y: float, z: float) -> int:
        point = self.line(f"IFCCARTESIANPOINT(({x:.6f},{y:.6f},{z:.6f}))")
        axes = self.line(f"IFCAXIS2PLACEMENT3D(#{point},$,$)")
        return self.line(f"IFCLOCALPLACEMENT(#31,#{axes})")

    def product(self, kind: str, name: str | None, place: int, shape: int, more: str = "") -> int:
        written = "$" if name is None else f"'{name}'"
        entity = f"{kind}('{guid(self.last)}',$,{written},$,$,#{place},#{shape},$"
        return self.line(f"{entity}{more})")

    def box(self, name: str | None, place=(0, 0, 0), size=(1, 1, 1), kind="IFCWALL") -> int:
        shape = self.shape(self.solid(*size))
        more = ",$" if kind in ("IFCWALL", "IFCMEMBER") else ""
        number = self.product(kind, name, self.place(*place), shape, more)
        self.held.append(number)
        return number

    def write(self, folder) -> str:
        listed = ",".join(f"#{number}" for number in self.held)
        if self.held:
            self.line(f"IFCRELCONTAINEDINSPATIALSTRUCTURE('{GUID}3',$,$,$,({listed}),#33)")
        file = folder / "scene.ifc"
        file.write_text(self.text + "ENDSEC;\nEND-ISO-10303-21;\n")
        return str(file)


@pytest.fixture
def child():
    """Read in a process of its own, as users do."""


@pytest.fixture(autouse=True)
def here(request, monkeypatch):
    """Read in this process, which takes less time, but where a test asks for the child."""
    if "child" not in request.fixturenames:
        monkeypatch.setattr(
            "visref.formats.ifc.read_in_a_child",
            lambda name, path, budget, **more: reader.parse_ifc(path, budget),
        )


def bounds(scene, number: int = 0):
    return scene.object_bounds[number] + scene.origin


def volume(scene, number: int) -> float:
    first, last = scene.object_offsets[number : number + 2]
    a, b, c = scene.vertices[scene.triangles[first:last]].astype(np.float64).transpose(1, 0, 2)
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


@pytest.mark.parametrize(
    ("unit", "metres"), [(METRES, 1.0), (MILLIMETRES, 0.001), (FEET, 0.3048)], ids=["m", "mm", "ft"]
)
def test_units_become_metres_and_z_becomes_y_and_that_is_said(tmp_path, unit, metres):
    ifc = Ifc(unit)
    ifc.box("a", place=(10 / metres, 20 / metres, 30 / metres), size=[1 / metres] * 3)
    scene = load_scene(ifc.write(tmp_path))
    assert np.allclose(bounds(scene), [[9.5, 30, -20.5], [10.5, 31, -19.5]], atol=2e-6)
    text = f"from units of {metres:g} metres, +Z up, to metres, +Y up"
    assert scene.notes == (("UNITS_CONVERTED", text),)
    assert math.isclose(volume(scene, 0), 1.0, abs_tol=1e-5)


@pytest.mark.parametrize("schema", ["IFC2X3", "IFC4", "IFC4X3_ADD2"])
def test_every_schema_is_read(tmp_path, schema):
    ifc = Ifc(schema=schema)
    ifc.box("a", kind="IFCFURNISHINGELEMENT")
    assert load_scene(ifc.write(tmp_path)).names == ("a",)


def test_products_come_depth_first_with_names_or_identifiers(tmp_path):
    ifc = Ifc()
    ifc.box("wall")
    frame = ifc.box("frame")
    ifc.box(None)
    ifc.held.pop()
    nameless = ifc.last
    member = ifc.box("member", kind="IFCMEMBER")
    ifc.held.pop()
    ifc.box("wall")
    ifc.line(f"IFCRELAGGREGATES('{GUID}4',$,$,$,#{frame},(#{member}))")
    scene = load_scene(ifc.write(tmp_path))
    own = guid(nameless - 1)
    assert scene.names == ("wall", "frame", "member", "wall#2", own)
    above = "project/site/building/storey"
    paths = (f"{above}/wall", f"{above}/frame", f"{above}/frame/member", f"{above}/wall", own)
    assert scene.paths == paths


def test_a_product_is_known_by_its_identifier_too(tmp_path):
    """Names repeat in buildings; engines know products by GlobalId."""
    ifc = Ifc()
    first, second = ifc.box("wall"), ifc.box("wall", place=(3, 0, 0))
    scene = load_scene(ifc.write(tmp_path))
    assert [(group.name, group.objects) for group in scene.groups] == [
        (guid(first - 1), (0,)),
        (guid(second - 1), (1,)),
    ]
    assert Names(scene).meanings(guid(second - 1)) == [(1,)]
    assert Names(scene).meanings("wall") == [(0,), (1,)]


def test_placements_turn(tmp_path):
    """The local x axis along the world's y: a long wall stands across."""
    ifc = Ifc()
    axis = ifc.line("IFCDIRECTION((0.,1.,0.))")
    axes = ifc.line(f"IFCAXIS2PLACEMENT3D(#12,#37,#{axis})")
    place = ifc.line(f"IFCLOCALPLACEMENT(#31,#{axes})")
    shape = ifc.shape(ifc.solid(6, 1, 2))
    ifc.held.append(ifc.product("IFCWALL", "wall", place, shape, ",$"))
    scene = load_scene(ifc.write(tmp_path))
    assert np.allclose(bounds(scene), [[-0.5, 0, -3], [0.5, 2, 3]], atol=1e-6)


def test_an_opening_is_cut_out_and_no_object(tmp_path):
    ifc = Ifc()
    wall = ifc.box("wall", size=(4, 0.5, 3))
    window = ifc.shape(ifc.solid(1, 2, 1))
    opening = ifc.product("IFCOPENINGELEMENT", "void", ifc.place(0, 0, 1), window, ",$")
    ifc.line(f"IFCRELVOIDSELEMENT('{GUID}5',$,$,$,#{wall},#{opening})")
    scene = load_scene(ifc.write(tmp_path))
    assert scene.names == ("wall",)
    assert math.isclose(volume(scene, 0), 4 * 0.5 * 3 - 1 * 0.5 * 1, abs_tol=1e-5)


def test_spaces_are_left_out_and_that_is_said(tmp_path):
    ifc = Ifc()
    ifc.box("wall")
    room = ifc.shape(ifc.solid(4, 4, 3))
    space = ifc.product("IFCSPACE", "room", ifc.place(0, 0, 0), room, ",$,$,$")
    ifc.line(f"IFCRELAGGREGATES('{GUID}4',$,$,$,#33,(#{space}))")
    scene = load_scene(ifc.write(tmp_path))
    assert scene.names == ("wall",)
    assert scene.notes[1] == ("PARTLY_READ", "1 space left out, first 'room'")


def test_mapped_shapes_share_a_mesh(tmp_path):
    ifc = Ifc()
    body = ifc.line(f"IFCSHAPEREPRESENTATION(#10,'Body','SweptSolid',(#{ifc.solid(1, 1, 1)}))")
    origin = ifc.line(f"IFCREPRESENTATIONMAP(#11,#{body})")
    still = ifc.line("IFCCARTESIANTRANSFORMATIONOPERATOR3D($,$,#12,$,$)")
    for x in (0, 5):
        item = ifc.line(f"IFCMAPPEDITEM(#{origin},#{still})")
        shape = ifc.shape(item, "MappedRepresentation")
        place = ifc.place(x, 0, 0)
        ifc.held.append(ifc.product("IFCFURNISHINGELEMENT", "chair", place, shape))
    ifc.box("wall")
    scene = load_scene(ifc.write(tmp_path))
    assert scene.rig.mesh_of_object.tolist() == [0, 0, 1]
    assert np.allclose(bounds(scene, 1)[:, 0], (4.5, 5.5))


@pytest.mark.parametrize(("clear", "alpha"), [("$", Alpha.OPAQUE), ("0.4", Alpha.BLEND)])
def test_a_transparent_style_is_glass(tmp_path, clear, alpha):
    ifc = Ifc()
    solid = ifc.solid(1, 1, 1)
    colour = ifc.line("IFCCOLOURRGB($,0.5,0.5,0.9)")
    look = ifc.line(f"IFCSURFACESTYLERENDERING(#{colour},{clear},$,$,$,$,$,$,.FLAT.)")
    style = ifc.line(f"IFCSURFACESTYLE('glass',.BOTH.,(#{look}))")
    ifc.line(f"IFCSTYLEDITEM(#{solid},(#{style}),$)")
    shape = ifc.shape(solid)
    ifc.held.append(ifc.product("IFCWALL", "pane", ifc.place(0, 0, 0), shape, ",$"))
    scene = load_scene(ifc.write(tmp_path), cull_backfaces=True)
    assert set(scene.alpha.tolist()) == {int(alpha)}
    assert not scene.one_sided.any()


def test_what_has_no_surface_keeps_its_id(tmp_path):
    ifc = Ifc()
    points = [ifc.line(f"IFCCARTESIANPOINT(({x}.,0.,0.))") for x in (0, 1)]
    line = ifc.line(f"IFCPOLYLINE((#{points[0]},#{points[1]}))")
    shape = ifc.shape(line, "Curve3D")
    axis = ifc.product("IFCFURNISHINGELEMENT", "axis", ifc.place(0, 0, 0), shape)
    ifc.held.append(axis)
    ifc.box("wall")
    scene = load_scene(ifc.write(tmp_path))
    assert scene.names == ("axis", "wall")
    assert scene.object_offsets[1] == 0


def test_a_shape_that_cannot_be_made_is_said(tmp_path):
    """IFC2X3 wants a place for a profile."""
    ifc = Ifc(schema="IFC2X3")
    ifc.box("good", kind="IFCFURNISHINGELEMENT")
    before = len(ifc.text)
    ifc.box("bad", kind="IFCFURNISHINGELEMENT")
    ifc.text = ifc.text[:before] + ifc.text[before:].replace("$,#13,", "$,$,")
    scene = load_scene(ifc.write(tmp_path))
    assert scene.names == ("good", "bad")
    assert np.diff(scene.object_offsets).tolist() == [12, 0]
    text = "ifcopenshell cannot make all shapes: 1 product has none, first 'bad'"
    assert ("PARTLY_READ", text) in scene.notes


@pytest.mark.parametrize(
    "text", ["", "x", "ISO-10303-21;\nHEADER;\n", HEAD.format(schema="IFC9", unit=METRES, guid="x")]
)
def test_what_is_no_ifc_is_refused_in_one_line(tmp_path, text):
    (tmp_path / "scene.ifc").write_text(text)
    with pytest.raises(InputError) as error:
        load_scene(tmp_path / "scene.ifc")
    assert len(str(error.value).splitlines()) == 1


def test_a_missing_extra_says_what_to_install(tmp_path, monkeypatch):
    file = Ifc().write(tmp_path)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"needs ifcopenshell; run: pip install 'visref\[ifc\]'"):
        load_scene(file)


def test_the_child_hands_over_the_same_scene(tmp_path, monkeypatch, child):
    ifc = Ifc(MILLIMETRES)
    ifc.box("wall", size=(4000, 500, 3000))
    ifc.box("wall", place=(5000, 0, 0))
    there = load_scene(ifc.write(tmp_path))
    monkeypatch.setattr(
        "visref.formats.ifc.read_in_a_child",
        lambda name, path, budget, **more: reader.parse_ifc(path, budget),
    )
    here = load_scene(tmp_path / "scene.ifc")
    assert there.digest == here.digest
    assert there.groups == here.groups
    assert there.notes == here.notes


HOUSE = Path("/usr/share/assimp/models/IFC/AC14-FZK-Haus.ifc")


@pytest.mark.slow
def test_a_house_that_an_architect_s_program_wrote_is_read_whole(child):
    scene = load_scene(HOUSE)
    text = HOUSE.read_text(encoding="latin-1")
    walls = re.findall(r"IFCWALLSTANDARDCASE\('([^']*)',[^,]*,'([^']*)'", text)
    assert len(walls) == 13
    for identifier, name in walls:
        number = scene.names.index(name)
        assert (number,) in [g.objects for g in scene.groups if g.name == identifier]
        assert scene.object_offsets[number + 1] > scene.object_offsets[number]
    notes = [text for _, text in scene.notes]
    assert notes[0] == "from units of 1 metres, +Z up, to metres, +Y up"
    assert notes[1].startswith(f"{len(re.findall('IFCSPACE[(]', text))} spaces left out")
    # Glass: its windows' panes alone.
    glass = scene.object_of_triangle[scene.alpha == Alpha.BLEND]
    assert {scene.names[i].split("-")[1] for i in set(glass.tolist()) if "-" in scene.names[i]} == {
        "Fenster"
    }


@pytest.mark.slow
def test_the_same_scene_as_glb_gets_the_same_verdict(tmp_path, child):
    """A post before a wall, and one behind it: what is left out convicts alike."""
    ifc = Ifc()
    boxes = {"near": (0, -2, 0), "wall": (0, 0, 0), "hidden": (0, 2, 0)}
    for name, place in boxes.items():
        ifc.box(name, place=place, size=(4, 1, 3) if name == "wall" else (1, 1, 1))
    scene = load_scene(ifc.write(tmp_path))
    gltf = Gltf()
    for number, name in enumerate(scene.names):
        first, last = scene.object_offsets[number : number + 2]
        corners = scene.vertices[scene.triangles[first:last]].reshape(-1, 3)
        gltf.node(mesh=gltf.mesh(gltf.primitive(corners)), name=name)
    gltf.write(tmp_path / "scene.glb")
    pose = look_at((0.0, 0.5, 8.0), (0.0, 0.5, 0.0))
    camera = Camera(pose, 32, 24, near=0.1, far=50.0, yfov=1.0)
    (tmp_path / "path.json").write_text(json.dumps(CameraPath((camera, camera)).to_json()))
    lines = [{"frame": 0, "visible": ["near", "wall"]}, {"frame": 1, "visible": ["near"]}]
    (tmp_path / "sets.jsonl").write_text("\n".join(map(json.dumps, lines)))
    verdicts = []
    for name in ("scene.glb", "scene.ifc"):
        out = tmp_path / f"run-{name}"
        status = main([
            "check", str(tmp_path / name), "--path", str(tmp_path / "path.json"),
            "--visible", str(tmp_path / "sets.jsonl"), "--out", str(out), "--pictures", "0",
        ])  # fmt: skip
        assert status == 1
        verdicts.append(json.loads((out / "verdict.json").read_text()))
    assert verdicts[0]["cullers"] == verdicts[1]["cullers"]
    (culler,) = verdicts[0]["cullers"].values()
    assert (culler["missed"], culler["confirmed"]) == (1, 1)
