"""3MF: every mesh stands where components and items say, as often as they say; or in one line why
not."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest
import trimesh

from visref.errors import InputError
from visref.formats import load_scene, threemf
from visref.formats.in_a_child import read_in_a_child

CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
PRODUCTION = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"
MODEL_TYPE = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
TRIANGLE = (
    '<mesh><vertices><vertex x="0" y="0" z="0"/><vertex x="1" y="0" z="0"/>'
    '<vertex x="0" y="1" z="0"/></vertices>'
    '<triangles><triangle v1="0" v2="1" v3="2"/></triangles></mesh>'
)


@pytest.fixture(autouse=True)
def in_this_process(monkeypatch):
    """A process for each file would take most of the time."""
    monkeypatch.setattr(
        threemf, "read_in_a_child", lambda _, path, budget: threemf.parse_3mf(path, budget)
    )


def model(resources: str, build: str, more: str = "") -> str:
    return (
        f'<?xml version="1.0"?><model unit="millimeter" xmlns="{CORE}" xmlns:p="{PRODUCTION}"'
        f" {more}><resources>{resources}</resources><build>{build}</build></model>"
    )


def thing(number: int, content: str, name: str = "") -> str:
    return f'<object id="{number}" name="{name}" type="model">{content}</object>'


def holding(*components: str) -> str:
    return f"<components>{''.join(components)}</components>"


def component(number: int, transform: str = "", more: str = "") -> str:
    where = f' transform="{transform}"' if transform else ""
    return f'<component objectid="{number}"{where}{more}/>'


def item(number: int, transform: str = "", more: str = "") -> str:
    return component(number, transform, more).replace("<component", "<item")


def moved(x: float, y: float = 0.0) -> str:
    return f"1 0 0 0 1 0 0 0 1 {x} {y} 0"


def write(file: Path, text: str, **parts: str) -> Path:
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("3D/3dmodel.model", text)
        for name, content in parts.items():
            archive.writestr(f"3D/{name}.model", content)
    return file


def doublings(count: int, innermost: str) -> str:
    """Objects that hold the one before them twice, a step apart that doubles too."""
    things = [thing(1, innermost)]
    for level in range(count):
        twice = (component(level + 1), component(level + 1, moved(2**level)))
        things.append(thing(level + 2, holding(*twice)))
    return model("".join(things), item(count + 1))


def test_nested_components_stand_where_their_transforms_say(tmp_path, monkeypatch):
    monkeypatch.setattr(threemf, "read_in_a_child", read_in_a_child)
    scene = load_scene(write(tmp_path / "s.3mf", doublings(10, TRIANGLE)))
    assert scene.object_count == scene.triangle_count == 1024
    # The level's bit is the place: each place is taken once.
    corners = scene.vertices[scene.triangles[:, 0]].astype(np.float64) + scene.origin
    assert sorted(corners[:, 0].tolist()) == list(range(1024))


def test_transforms_are_composed_outer_after_inner(tmp_path):
    quarter = "0 1 0 -1 0 0 0 0 1 0 0 0"  # of row vectors: x becomes y
    resources = thing(1, TRIANGLE, "leaf") + thing(2, holding(component(1, moved(5))), "branch")
    file = write(tmp_path / "s.3mf", model(resources, item(2, quarter)))
    scene = load_scene(file)
    corners = scene.vertices[scene.triangles[0]].astype(np.float64) + scene.origin
    assert corners.tolist() == [[0, 5, 0], [0, 6, 0], [-1, 5, 0]]
    assert (scene.names, scene.paths) == (("leaf",), ("branch/leaf",))


def test_doublings_without_end_are_refused_in_one_line_before_they_are_made(tmp_path, monkeypatch):
    monkeypatch.setattr(threemf, "read_in_a_child", read_in_a_child)
    for count in (28, 200):
        file = write(tmp_path / "s.3mf", doublings(count, TRIANGLE))
        with pytest.raises(InputError, match=rf"{2**count:,} objects would need about") as told:
            load_scene(file)
        assert "\n" not in str(told.value)


def test_doublings_of_nothing_take_no_time(tmp_path):
    text = doublings(200, "").replace("</resources>", thing(999, TRIANGLE) + "</resources>")
    file = write(tmp_path / "s.3mf", text.replace("</build>", item(999) + "</build>"))
    assert load_scene(file).object_count == 1


def test_objects_of_other_parts_are_read(tmp_path):
    root = model(
        thing(1, holding(component(7, moved(3), ' p:path="/3D/part.model"'))),
        item(1) + item(7, "", ' p:path="/3D/part.model" partnumber="spare"'),
        'requiredextensions="p"',
    )
    # The build of another part does not count.
    other = model(thing(7, TRIANGLE, "leaf"), item(7))
    scene = load_scene(write(tmp_path / "s.3mf", root, part=other))
    assert scene.names == ("leaf", "spare")
    assert not scene.notes


def test_the_model_s_part_is_the_one_that_the_archive_names(tmp_path):
    with zipfile.ZipFile(tmp_path / "s.3mf", "w") as archive:
        archive.writestr("3D/3dmodel.model", model(thing(1, TRIANGLE), ""))
        archive.writestr("other.model", model(thing(1, TRIANGLE, "right"), item(1)))
        archive.writestr(
            "_rels/.rels",
            f'<Relationships><Relationship Type="{MODEL_TYPE}" Target="/other.model"/>'
            "</Relationships>",
        )
    assert load_scene(tmp_path / "s.3mf").names == ("right",)


def test_what_an_extension_adds_is_said_to_be_unread(tmp_path):
    lattice = 'xmlns:b="urn:lattice" requiredextensions="b"'
    mesh = TRIANGLE.replace("</mesh>", "<b:beams/></mesh>")
    scene = load_scene(write(tmp_path / "s.3mf", model(thing(1, mesh), item(1), lattice)))
    texts = [text for _, text in scene.notes]
    assert texts == [
        "<beams> of urn:lattice is not read",
        "the extension urn:lattice, which the file requires, is not read",
    ]


def test_names_of_an_extension_are_not_taken_for_the_core_s(tmp_path):
    mesh = TRIANGLE.replace("</mesh>", '<b:vertex x="0" y="0"/></mesh>')
    text = model(thing(1, mesh), item(1), 'xmlns:b="urn:slices"')
    assert load_scene(write(tmp_path / "s.3mf", text)).triangle_count == 1


def test_trimesh_s_own_files_give_what_trimesh_wrote(tmp_path):
    pytest.importorskip("lxml")
    pytest.importorskip("networkx")
    made = trimesh.Scene()
    for number in range(3):
        box = trimesh.creation.box((1, 2, 3 + number))
        place = trimesh.transformations.translation_matrix((5 * number, 0, 0))
        made.add_geometry(box, node_name=f"box {number}", transform=place)
    (tmp_path / "s.3mf").write_bytes(made.export(file_type="3mf"))
    scene = load_scene(tmp_path / "s.3mf")
    assert scene.names == ("box 0", "box 1", "box 2")
    mine = scene.vertices[scene.triangles].astype(np.float64) + scene.origin
    theirs = np.concatenate([mesh.triangles for mesh in made.dump()])
    assert sorted(mine.tolist()) == sorted(theirs.tolist())


BAD = {
    "an object that there is not": (model(thing(1, TRIANGLE), item(2)), "no object with the id"),
    "a component that there is not": (
        model(thing(1, holding(component(9))), item(1)),
        "no object with the id '9'",
    ),
    "an object of itself": (model(thing(1, holding(component(1))), item(1)), "holds itself"),
    "a ring": (
        model(thing(1, holding(component(2))) + thing(2, holding(component(1))), item(1)),
        "holds itself",
    ),
    "an id twice": (model(thing(1, TRIANGLE) * 2, item(1)), "two objects have the id '1'"),
    "no item": (model(thing(1, TRIANGLE), ""), "no mesh in it"),
    "a document type": (
        model(thing(1, TRIANGLE), item(1)).replace("?>", '?><!DOCTYPE a [<!ENTITY b "c">]>'),
        "declares a document type",
    ),
    "cut": (model(thing(1, TRIANGLE), item(1))[:-30], "not valid XML"),
    "another root": ("<scene/>", "no 3MF model"),
    "a vertex that there is not": (
        model(thing(1, TRIANGLE.replace('v3="2"', 'v3="3"')), item(1)),
        "",
    ),
    "a coordinate in words": (
        model(thing(1, TRIANGLE.replace('z="0"', 'z="1_0"', 1)), item(1)),
        "'1_0' is not a number",
    ),
    "two coordinates in one": (
        model(thing(1, TRIANGLE.replace('z="0"', 'z="1 0"', 1)), item(1)),
        "'1 0' is not a number",
    ),
    "two and none": (
        model(thing(1, TRIANGLE.replace('y="0" z="0"', 'y="1 0" z=""', 1)), item(1)),
        "is not a number",
    ),
    "a coordinate too few": (
        model(thing(1, TRIANGLE.replace(' z="0"', "", 1)), item(1)),
        "it has no 'z'",
    ),
    "a transform too short": (model(thing(1, TRIANGLE), item(1, "1 0 0")), "no transform"),
    "a part that there is not": (
        model("", item(1, "", ' p:path="/3D/none.model"')),
        "no part '3d/none.model'",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_file_is_one_line_that_names_it(name, tmp_path):
    text, said = BAD[name]
    file = write(tmp_path / "s.3mf", text)
    with pytest.raises(InputError) as told:
        load_scene(file)
    assert str(told.value).startswith(str(file))
    assert said in str(told.value)
    assert "\n" not in str(told.value)


def test_a_file_that_is_no_archive_or_a_spoilt_one_is_refused(tmp_path):
    file = write(tmp_path / "s.3mf", doublings(3, TRIANGLE))
    whole = file.read_bytes()
    for spoilt in (b"", b"PK", whole[: len(whole) // 2], whole[:60] + b"\xff" * 40 + whole[100:]):
        file.write_bytes(spoilt)
        with pytest.raises(InputError):
            load_scene(file)
