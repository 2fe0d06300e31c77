"""Scene files: a target for each format."""

from __future__ import annotations

import base64
import io
import json
import tempfile
import zipfile
from collections.abc import Callable, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from PIL import Image

from tests.fuzz import rewrite, spoil
from tests.fuzz.draws import Draws
from tests.fuzz.limits import MEMORY, Folders
from tests.fuzz.target import Target
from tests.support import meshopt_encoder
from tests.support.gltf_everything import everything
from tests.support.gltf_files import SQUARE, TWO, Gltf, one_triangle
from tests.support.meshopt_encoder import compressed_accessor
from visref.camera import Camera
from visref.camera_path import CameraPath, Frame
from visref.formats import load_scene
from visref.timeline import Timeline


def read(file: Path, folders: Folders) -> Any:
    del folders
    scene = load_scene(file, max_memory=MEMORY)
    return scene.digest, scene.names, sorted({code for code, _ in scene.notes})


def command(file: Path, folders: Folders) -> Sequence[str]:
    del folders
    return ["objects", str(file), "--max-memory", str(MEMORY)]


def _png() -> bytes:
    out = io.BytesIO()
    Image.fromarray(np.arange(64, dtype="u1").reshape(4, 4, 4)).save(out, "PNG")
    return out.getvalue()


def textured() -> Gltf:
    """A square with an alpha mask in a texture."""
    gltf = Gltf()
    square = gltf.primitive(SQUARE, TWO, material=0)
    square["attributes"]["TEXCOORD_0"] = gltf.accessor(
        np.array([[0, 0], [1, 0], [1, 1], [0, 1]], "f4")
    )
    gltf.entry("images", bufferView=gltf.view(_png()), mimeType="image/png")
    gltf.entry("textures", source=0, sampler=0)
    gltf.entry("samplers", wrapS=33071, magFilter=9729)
    texture = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
    gltf.entry("materials", alphaMode="MASK", **texture)
    gltf.node(mesh=gltf.mesh(square), name="leaf")
    return gltf


def moving() -> Gltf:
    """`everything`, its objects animated too: places, turns, weights, and who is there."""
    gltf = everything()
    times = gltf.accessor(np.array([0, 1], "f4"))
    places = gltf.accessor(np.array([[0, 0, 0], [1, 2, 3]], "f4"))
    weights = gltf.accessor(np.array([[0], [1]], "f4"))
    shown = gltf.accessor(np.array([[1], [0]], "u1"))
    visible = "/nodes/3/extensions/KHR_node_visibility/visible"
    pointer = {"KHR_animation_pointer": {"pointer": visible}}
    gltf.json["animations"] = [
        {
            "samplers": [
                {"input": times, "output": places},
                {"input": times, "output": weights, "interpolation": "STEP"},
                {"input": times, "output": shown, "interpolation": "STEP"},
            ],
            "channels": [
                {"sampler": 0, "target": {"node": 0, "path": "translation"}},
                {"sampler": 0, "target": {"node": 2, "path": "scale"}},
                {"sampler": 1, "target": {"node": 1, "path": "weights"}},
                {"sampler": 2, "target": {"path": "pointer", "extensions": pointer}},
            ],
        }
    ]
    gltf.json["buffers"] = [{"byteLength": len(gltf.blob)}]
    return gltf


def read_moving(file: Path, folders: Folders) -> Any:
    """A scene in three moments."""
    del folders
    scene = load_scene(file, max_memory=MEMORY)
    poses = (Frame((Camera(np.eye(4), 8, 6, near=0.1, yfov=1.0),), time_s=t) for t in (0, 0.25, 1))
    timeline = Timeline(scene, CameraPath(tuple(poses)))
    moments = [timeline.at(frame) for frame in range(3)]
    return [(at.vertices.tobytes(), timeline.absent(i).tolist()) for i, at in enumerate(moments)]


@cache
def glbs() -> dict[str, bytes]:
    return {
        "everything": everything().glb(),
        "textured": textured().glb(),
        "triangle": one_triangle().glb(),
        "packed": packed().glb(),
    }


def packed() -> Gltf:
    """A square, turned and repeated, all its buffer views compressed with meshopt."""
    gltf = Gltf()
    rows = SQUARE.view("u1").reshape(4, 12)
    data = meshopt_encoder.attributes(rows, version=1, modes=(0, 1, 0x12), controls=(0, 1, 2, 3))
    position = compressed_accessor(gltf, SQUARE, data, "ATTRIBUTES")
    data = meshopt_encoder.triangles(TWO.tolist())
    triangles = compressed_accessor(gltf, TWO, data, "TRIANGLES")
    data = meshopt_encoder.indices([0, 1, 2])
    fan = compressed_accessor(gltf, TWO[:3], data, "INDICES")
    turns = np.array([[0, 0, 0, 2047], [2047, 0, 0, 2044]], "<i2")
    data = meshopt_encoder.attributes(turns.view("u1").reshape(2, 8))
    turn = compressed_accessor(gltf, turns, data, "ATTRIBUTES", filter="QUATERNION")
    gltf.json["accessors"][turn]["normalized"] = True
    places = np.array([[(-1 << 24) + 3] * 3, [0] * 3], "<i4")
    data = meshopt_encoder.attributes(places.view("u1").reshape(2, 12))
    place = compressed_accessor(gltf, places.view("f4"), data, "ATTRIBUTES", filter="EXPONENTIAL")
    attributes = {"attributes": {"POSITION": position}}
    mesh = gltf.mesh(
        {**attributes, "indices": triangles}, {**attributes, "indices": fan, "mode": 6}
    )
    instances = {"attributes": {"ROTATION": turn, "TRANSLATION": place}}
    gltf.node(mesh=mesh, name="m", extensions={"EXT_mesh_gpu_instancing": instances})
    return gltf


def packed_beside() -> bytes:
    """`packed`, its compressed bytes in a file of their own."""
    gltf = packed()
    gltf.json["buffers"][0]["uri"] = "scene.bin"
    return spoil.json_bytes(gltf.json)


def leaf() -> bytes:
    """`textured`, its picture in a file of its own."""
    gltf = textured()
    gltf.json["images"] = [{"uri": "leaf.png"}]
    gltf.json["buffers"] = [{"byteLength": len(gltf.blob), "uri": "scene.bin"}]
    return spoil.json_bytes({key: value for key, value in gltf.json.items() if value != []})


BIN = one_triangle().blob


@cache
def gltfs() -> dict[str, bytes]:
    beside = {"byteLength": len(BIN), "uri": "scene.bin"}
    found = {"triangle": spoil.json_bytes({**one_triangle().json, "buffers": [beside]})}
    for name, gltf in (("everything", everything()), ("textured", textured())):
        chunks = spoil.glb_chunks(gltf.glb())
        uri = "data:application/octet-stream;base64," + _base64(chunks[1][1])
        document = json.loads(chunks[0][1])
        document["buffers"] = [{"byteLength": len(chunks[1][1]), "uri": uri}]
        found[name] = spoil.json_bytes(document)
    return found


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode()


OBJ = b"""mtllib scene.mtl
o wall
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
vt 0 0
vn 0 0 1
usemtl solid
f 1 2 3 4
o "part" of it
g a b
usemtl thin
s 1
f -4/1/1 -3/1/1 \\
  -2/1/1
f 1//1 3//1 4//1
l 1 2
"""
MTL = b"""newmtl solid
Kd 0.5 0.5 0.5
d 1.0
newmtl thin
d 0.5
map_d -clamp on leaf.png
map_Kd leaf.png
"""
OFF = b"OFF\n5 3 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n0 0 1\n4 0 1 2 3\n3 0 1 4\n3 1 2 4 255 0 0\n"
HEAD = """ply
format {} 1.0
comment by hand
element vertex 4
property float x
property float y
property float z
property uchar red
element face 2
property list uchar int vertex_indices
end_header
"""
PLY_VERTICES = [(0, 0, 0, 1), (1, 0, 0, 2), (1, 1, 0, 3), (0, 1, 0, 4)]
PLY_FACES = [(0, 1, 2), (0, 1, 2, 3)]


@cache
def plys() -> dict[str, bytes]:
    text = HEAD.format("ascii")
    text += "".join("{} {} {} {}\n".format(*vertex) for vertex in PLY_VERTICES)
    text += "".join(f"{len(face)} {' '.join(map(str, face))}\n" for face in PLY_FACES)
    found = {"ascii": text.encode()}
    for name, order in (("binary_little_endian", "<"), ("binary_big_endian", ">")):
        vertices = np.array(PLY_VERTICES, f"{order}f4")
        body = b"".join(row[:3].tobytes() + bytes([int(row[3])]) for row in vertices)
        body += b"".join(bytes([len(f)]) + np.array(f, f"{order}i4").tobytes() for f in PLY_FACES)
        found[name] = HEAD.format(name).encode() + body
    return found


DAE = b"""<?xml version="1.0" encoding="utf-8"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit meter="0.5" name="u"/><up_axis>Z_UP</up_axis></asset>
<library_effects><effect id="e"><profile_COMMON><technique sid="common"><phong>
  <diffuse><color>1 1 1 1</color></diffuse><transparency><float>0.5</float></transparency></phong>
  </technique></profile_COMMON></effect></library_effects>
<library_materials><material id="mat"><instance_effect url="#e"/></material></library_materials>
<library_geometries><geometry id="g" name="g"><mesh>
  <source id="p"><float_array id="a" count="12">0 0 0 1 0 0 1 1 0 0 1 0</float_array>
    <technique_common><accessor source="#a" count="4" stride="3"><param name="X" type="float"/>
      <param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common>
  </source><vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
  <triangles count="1" material="m"><input semantic="VERTEX" source="#v" offset="0"/>
    <p>0 1 2</p></triangles>
  <polylist count="1" material="m"><input semantic="VERTEX" source="#v" offset="0"/>
    <vcount>4</vcount><p>0 1 2 3</p></polylist>
</mesh></geometry></library_geometries>
<library_nodes><node id="tree"><instance_geometry url="#g"/></node></library_nodes>
<library_visual_scenes><visual_scene id="s">
  <node id="n" name="a"><translate>1 2 3</translate><rotate>0 0 1 90</rotate>
    <instance_geometry url="#g"><bind_material><technique_common>
      <instance_material symbol="m" target="#mat"/></technique_common></bind_material>
    </instance_geometry>
    <node id="c"><matrix>1 0 0 1 0 1 0 1 0 0 1 1 0 0 0 1</matrix><instance_node url="#tree"/></node>
  </node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>
"""
USD = b"""#usda 1.0
(
    metersPerUnit = 0.5
    upAxis = "Z"
    timeCodesPerSecond = 24
)
def Xform "a" {
    double3 xformOp:translate.timeSamples = { 0: (0, 0, 0), 24: (1, 2, 3) }
    float3 xformOp:rotateXYZ = (10, 20, 30)
    token visibility.timeSamples = { 0: "inherited", 12: "invisible" }
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ"]
    def Mesh "m" (prepend apiSchemas = ["MaterialBindingAPI"]) {
        uniform token subdivisionScheme = "none"
        uniform token orientation = "leftHanded"
        uniform bool doubleSided = 1
        int[] faceVertexCounts = [4, 3]
        int[] faceVertexIndices = [0, 1, 2, 3, 0, 1, 2]
        int[] holeIndices = [1]
        point3f[] points.timeSamples = {
            0: [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)],
            24: [(0, 0, 1), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
        }
        rel material:binding = </look>
    }
}
def PointInstancer "p" {
    int[] protoIndices = [0, 0]
    point3f[] positions = [(0, 0, 0), (5, 0, 0)]
    quath[] orientations = [(1, 0, 0, 0), (0.5, 0.5, 0.5, 0.5)]
    float3[] scales = [(1, 1, 1), (2, 2, 2)]
    int64[] invisibleIds = [1]
    rel prototypes = </p/kept>
    over "kept" (references = @beside.usda@) {
        def Cube "cube" {
            double size = 2
            uniform token purpose = "render"
        }
    }
}
def Material "look" {
    token outputs:surface.connect = </look/s.outputs:surface>
    def Shader "s" {
        uniform token info:id = "UsdPreviewSurface"
        float inputs:opacity = 0.5
        token outputs:surface
    }
}
"""
BESIDE = b"""#usda 1.0
(
    defaultPrim = "b"
)
def Xform "b" {
    float xformOp:rotateY = 45
    uniform token[] xformOpOrder = ["xformOp:rotateY"]
}
"""
IFC = b"""ISO-10303-21;
HEADER;
FILE_DESCRIPTION((''),'2;1');
FILE_NAME('','',(''),(''),'','','');
FILE_SCHEMA(('IFC4'));
ENDSEC;
DATA;
#1=IFCPROJECT('0YvctVUKr0kugbFTf53O9P',$,'project',$,$,$,$,(#2),#6);
#2=IFCGEOMETRICREPRESENTATIONCONTEXT($,'Model',3,1.E-05,#3,$);
#3=IFCAXIS2PLACEMENT3D(#4,$,$);
#4=IFCCARTESIANPOINT((0.,0.,0.));
#5=IFCDIRECTION((0.,0.,1.));
#6=IFCUNITASSIGNMENT((#7));
#7=IFCSIUNIT(*,.LENGTHUNIT.,.MILLI.,.METRE.);
#8=IFCLOCALPLACEMENT($,#3);
#9=IFCSITE('0YvctVUKr0kugbFTf53O9S',$,'site',$,$,#8,$,$,$,$,$,$,$,$);
#10=IFCRELAGGREGATES('0YvctVUKr0kugbFTf53O90',$,$,$,#1,(#9));
#11=IFCRECTANGLEPROFILEDEF(.AREA.,$,$,2000.,200.);
#12=IFCEXTRUDEDAREASOLID(#11,#3,#5,3000.);
#13=IFCSHAPEREPRESENTATION(#2,'Body','SweptSolid',(#12));
#14=IFCPRODUCTDEFINITIONSHAPE($,$,(#13));
#15=IFCWALL('0YvctVUKr0kugbFTf53O9W',$,'wall',$,$,#8,#14,$,$);
#16=IFCRECTANGLEPROFILEDEF(.AREA.,$,$,500.,400.);
#17=IFCEXTRUDEDAREASOLID(#16,#3,#5,1000.);
#18=IFCSHAPEREPRESENTATION(#2,'Body','SweptSolid',(#17));
#19=IFCPRODUCTDEFINITIONSHAPE($,$,(#18));
#20=IFCOPENINGELEMENT('0YvctVUKr0kugbFTf53O9O',$,'opening',$,$,#8,#19,$,$);
#21=IFCRELVOIDSELEMENT('0YvctVUKr0kugbFTf53O91',$,$,$,#15,#20);
#22=IFCREPRESENTATIONMAP(#3,#18);
#23=IFCCARTESIANTRANSFORMATIONOPERATOR3D($,$,#4,$,$);
#24=IFCMAPPEDITEM(#22,#23);
#25=IFCSHAPEREPRESENTATION(#2,'Body','MappedRepresentation',(#24));
#26=IFCPRODUCTDEFINITIONSHAPE($,$,(#25));
#27=IFCFURNISHINGELEMENT('0YvctVUKr0kugbFTf53O9C',$,'chair',$,$,#8,#26,$);
#28=IFCSPACE('0YvctVUKr0kugbFTf53O9R',$,'space',$,$,#8,#19,$,$,$,$);
#29=IFCRELCONTAINEDINSPATIALSTRUCTURE('0YvctVUKr0kugbFTf53O92',$,$,$,(#15,#27,#28),#9);
ENDSEC;
END-ISO-10303-21;
"""
MODEL = b"""<?xml version="1.0" encoding="utf-8"?>
<model unit="millimeter" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">
<resources><object id="1" name="part" type="model"><mesh><vertices>
<vertex x="0" y="0" z="0"/><vertex x="1" y="0" z="0"/><vertex x="0" y="1" z="0"/>
</vertices><triangles><triangle v1="0" v2="1" v3="2"/></triangles></mesh></object>
<object id="2" type="model"><components><component objectid="1"/>
<component objectid="1" transform="1 0 0 0 1 0 0 0 1 5 0 0"/></components></object></resources>
<build><item objectid="2"/><item objectid="1" transform="1 0 0 0 1 0 0 0 1 0 7 0"/></build></model>
"""
RELATIONS = b"""<?xml version="1.0" encoding="UTF-8"?>
<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships"><Relationship
Target="/3D/3dmodel.model" Id="rel0"
Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>"""
XAML = b"""<?xml version="1.0"?>
<Viewport3D xmlns="http://schemas.microsoft.com/winfx/2006/xaml/presentation"><ModelVisual3D>
<ModelVisual3D.Content><GeometryModel3D><GeometryModel3D.Geometry><MeshGeometry3D
Positions="0,0,0 1,0,0 0,1,0" Normals="0,0,1 0,0,1 0,0,1" TriangleIndices="0 1 2"/>
</GeometryModel3D.Geometry></GeometryModel3D></ModelVisual3D.Content></ModelVisual3D></Viewport3D>
"""
XYZ = b"0 0 0\n1 0 0\n0 1 0\n"
DXF = (
    "\n".join(
        [
            "0",
            "SECTION",
            "2",
            "HEADER",
            "0",
            "ENDSEC",
            "0",
            "SECTION",
            "2",
            "ENTITIES",
            "0",
            "LINE",
            "8",
            "0",
            "10",
            "0.0",
            "20",
            "0.0",
            "11",
            "1.0",
            "21",
            "1.0",
            "0",
            "ENDSEC",
            "0",
            "EOF",
        ]
    ).encode()
    + b"\n"
)


@cache
def stls() -> dict[str, bytes]:
    box = trimesh.creation.box((1, 2, 3))
    head, body = bytes(80), box.export(file_type="stl")[80:]
    return {"binary": head + body}


ASCII_STL = b"""solid part
facet normal 0 0 1
 outer loop
  vertex 0 0 0
  vertex 1 0 0
  vertex 0 1e0 0
 endloop
endfacet
endsolid part
"""


def _plain(data: bytes, name: str = "seed") -> Callable[[], dict[str, bytes]]:
    return lambda: {name: data}


def _beside(name: str) -> dict[str, Any]:
    """Of a target whose file is named by a scene file: that is what is read."""
    return {
        "read": lambda file, folders: read(file.with_name(name), folders),
        "reads_outside": True,
        "command": lambda file, folders: command(file.with_name(name), folders),
    }


_scene: Callable[..., Target] = partial(Target, read=read, command=command, reads_outside=True)
_text = spoil.tokens
_words = rewrite.lines(None)


def _spoilt_usdz(data: bytes, draws: Draws) -> bytes:
    """The package, or its first file in a package that is whole."""
    return usdz(_text(USD, draws)) if draws.below(2) else spoil.any_bytes(data, draws)


TARGETS = (
    _scene("glb", "scene.glb", glbs, spoil.glb, rewrite=rewrite.glb),
    Target("glb-motion", "scene.glb", lambda: {"moving": moving().glb()}, spoil.glb, read_moving,
           rewrite.glb),
    _scene("gltf", "scene.gltf", gltfs, spoil.json_text, rewrite=rewrite.gltf_text,
           companions={"scene.bin": BIN}),
    _scene("obj", "scene.obj", _plain(OBJ), _text, rewrite=rewrite.lines(b"#", first=1),
           companions={"scene.mtl": MTL, "leaf.png": _png()}),
    Target("gltf-bin", "scene.bin", _plain(BIN), spoil.any_bytes, **_beside("scene.gltf"),
           companions={"scene.gltf": gltfs()["triangle"]}, cases=100),
    Target("meshopt", "scene.bin", _plain(packed().blob), spoil.any_bytes, **_beside("scene.gltf"),
           companions={"scene.gltf": packed_beside()}, cases=300),
    Target("obj-mtl", "scene.mtl", _plain(MTL), _text, **_beside("scene.obj"),
           rewrite=rewrite.lines(b"#"), companions={"scene.obj": OBJ, "leaf.png": _png()}),
    Target("texture", "leaf.png", _plain(_png()), spoil.any_bytes, **_beside("scene.gltf"),
           companions={"scene.gltf": leaf(), "scene.bin": textured().blob}),
    _scene("ply", "scene.ply", plys, spoil.headed(b"end_header\n", spoil.any_bytes),
           rewrite=rewrite.ply),
    _scene("ply-text", "scene.ply", lambda: {"ascii": plys()["ascii"]}, _text),
    _scene("off", "scene.off", _plain(OFF), _text, rewrite=rewrite.lines(b"#")),
    _scene("dae", "scene.dae", _plain(DAE), spoil.xml, rewrite=rewrite.xml, cases=40),
    _scene("zae", "scene.zae", lambda: {"seed": spoil.zipped_up([("scene.dae", DAE)])},
           spoil.archive(spoil.xml, ".dae"), cases=25),
    _scene("ifc", "scene.ifc", _plain(IFC), _text, rewrite=_words, cases=30),
    _scene("usda", "scene.usda", _plain(USD), _text, rewrite=rewrite.lines(b"#", first=1),
           companions={"beside.usda": BESIDE}, cases=30),
    Target("usda-motion", "scene.usda", _plain(USD), _text, read_moving,
           companions={"beside.usda": BESIDE}, cases=20),
    _scene("usdz", "scene.usdz", lambda: {"seed": usdz()}, _spoilt_usdz, cases=20),
    _scene("usdc", "scene.usdc", lambda: {"seed": usdc()}, spoil.any_bytes, cases=25),
    _scene("3mf", "scene.3mf", lambda: {"seed": three_mf()}, spoil.archive(spoil.xml, ".model"),
           rewrite=rewrite.archive(rewrite.xml, ".model"), cases=30),
    _scene("stl", "scene.stl", stls, spoil.any_bytes, rewrite=rewrite.stl),
    _scene("stl-text", "scene.stl", _plain(ASCII_STL), _text, rewrite=_words),
    _scene("xaml", "scene.xaml", _plain(XAML), spoil.xml, cases=30),
    _scene("xyz", "scene.xyz", _plain(XYZ), _text, cases=40),
    _scene("dxf", "scene.dxf", _plain(DXF), _text, cases=40),
)  # fmt: skip


@cache
def usdc() -> bytes:
    """`USD` in its binary form, as the library writes it."""
    from pxr import Sdf

    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.ImportFromString(USD.decode())
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "scene.usdc"
        layer.Export(str(file))
        return file.read_bytes()


def usdz(main: bytes = USD) -> bytes:
    """The same as a package: stored, each file at a multiple of 64 bytes."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_STORED) as archive:
        for name, data in (("scene.usda", main), ("beside.usda", BESIDE)):
            entry = zipfile.ZipInfo(name)
            padding = -(out.tell() + 30 + len(name) + 4) % 64
            entry.extra = b"\x86\x19" + padding.to_bytes(2, "little") + bytes(padding)
            archive.writestr(entry, data)
    return out.getvalue()


def three_mf() -> bytes:
    return spoil.zipped_up([("3D/3dmodel.model", MODEL), ("_rels/.rels", RELATIONS)])
