"""The suite as files: each says exactly its case, and the folder is what its manifest says."""

from __future__ import annotations

import io
import json
import os
import struct
from dataclasses import replace
from fractions import Fraction

import jsonschema
import numpy as np
import pytest
import trimesh
from PIL import Image

from visref.camera_path import CameraPath
from visref.conformance import files
from visref.conformance.building import Case, Cutout, box, camera, case, clusters, cut_out, panel
from visref.conformance.classes import CLASSES, classes_of
from visref.conformance.glb import glb_of
from visref.conformance.png import png_of_alpha
from visref.conformance.scenes import SCENES
from visref.conformance.suite import built_of
from visref.errors import InputError
from visref.files import parse_json
from visref.formats import load_scene
from visref.recordings.names import Names
from visref.scene import Alpha, Group
from visref.schemas import schema
from visref.timeline import Timeline

CASES = {one.name: one for one in files.written_cases()}
BY_NAME = {made.name: made for made in SCENES}


def corners(scene, triangles):
    """The exact numbers of the corners of some triangles."""
    points = scene.vertices[triangles].reshape(-1, 3)
    if not scene.origin.any():
        return points.tolist()
    origin = [Fraction(value) for value in scene.origin.tolist()]
    return [[Fraction(x) + o for x, o in zip(row, origin, strict=True)] for row in points.tolist()]


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in (1, 5))])
def test_every_case_is_read_back_as_it_was_built(seed):
    written = files.written_cases(seed)
    assert [one.name for one in written] == [n for n in BY_NAME if n != "empty_scene"]
    for one in written:
        built, found = built_of(one.made, seed), one.scene
        scene = built.scene
        for what in ("names", "groups"):
            assert getattr(found, what) == getattr(scene, what), (one.name, what)
        for what in ("object_offsets", "one_sided", "alpha"):
            assert np.array_equal(getattr(found, what), getattr(scene, what)), (one.name, what)
        assert corners(found, found.triangles) == corners(scene, scene.triangles), one.name
        assert (found.masks is None) == (scene.masks is None)
        if found.masks is not None:
            assert found.masks.digest == scene.masks.digest, one.name
        assert one.path.to_json() == built.path.to_json()
        assert (one.units is None) == (built.units is None)
        if one.units is not None:
            assert np.array_equal(one.units.offsets, built.units.offsets)
            assert np.array_equal(one.units.triangles, built.units.triangles)


def test_every_name_in_the_files_means_one_object_or_one_group():
    for one in CASES.values():
        names = Names(one.scene)
        for index, name in enumerate(one.scene.names):
            inside = [group.objects for group in one.scene.groups if index in group.objects]
            assert names.meanings(name) in ([(index,)], inside), (one.name, name)
        for group in one.scene.groups:
            assert names.meanings(group.name) == [group.objects]


def test_every_moment_is_that_of_the_case_as_it_was_built():
    moved = 0
    for one in CASES.values():
        built = built_of(one.made, 0)
        ours = Timeline(one.scene, one.path)
        theirs = Timeline(built.scene, built.path)
        assert ours.moves == theirs.moves == one.made.moves
        for frame in range(len(one.path)) if ours.moves else ():
            mine, right = ours.at(frame), theirs.at(frame)
            assert np.array_equal(ours.absent(frame), theirs.absent(frame))
            assert corners(mine, mine.triangles) == corners(right, right.triangles)
            moved += 1
    assert moved > 30


def test_files_are_the_same_bytes_each_time_and_others_for_another_seed():
    crowd = BY_NAME["crowd"]
    first, again = (files._written.__wrapped__(crowd, 3).files for _ in range(2))
    assert first == again
    assert files._written(crowd, 4).files[files.SCENE] != first[files.SCENE]


def test_another_reader_of_gltf_finds_the_same_triangles(tmp_path):
    file = tmp_path / "scene.glb"
    for name in ("crowd", "through_the_holes_of_a_mask", "about_an_origin_of_its_own"):
        one = CASES[name]
        file.write_bytes(one.files[files.SCENE])
        loaded = trimesh.load(file, process=False)
        found = np.concatenate([mesh.triangles for mesh in loaded.dump()]).reshape(-1, 3)
        right = one.scene.vertices[one.scene.triangles].reshape(-1, 3) + one.scene.origin
        # Its transforms are float64, and so is its sum.
        assert np.array_equal(found[np.lexsort(found.T)], right[np.lexsort(right.T)])


def test_a_glb_is_well_formed():
    """Lengths, alignment, and that nothing lies outside the buffer."""
    for one in CASES.values():
        data = one.files[files.SCENE]
        magic, version, length = struct.unpack_from("<4sII", data)
        assert (magic, version, length) == (b"glTF", 2, len(data))
        size, kind = struct.unpack_from("<I4s", data, 12)
        document = json.loads(data[20 : 20 + size])
        assert kind == b"JSON"
        assert size % 4 == 0
        binary, kind = struct.unpack_from("<I4s", data, 20 + size)
        assert kind == b"BIN\0"
        assert binary % 4 == 0
        assert binary == document["buffers"][0]["byteLength"] == length - 28 - size
        for view in document["bufferViews"]:
            assert view["byteOffset"] % 4 == 0
            assert view["byteOffset"] + view["byteLength"] <= binary
        sizes = {"SCALAR": 4, "VEC2": 8, "VEC3": 12, "VEC4": 16}
        for accessor in document["accessors"]:
            view = document["bufferViews"][accessor["bufferView"]]
            assert accessor["count"] * sizes[accessor["type"]] == view["byteLength"]
        for mesh in document["meshes"]:
            for primitive in mesh["primitives"]:
                position = document["accessors"][primitive["attributes"]["POSITION"]]
                assert len(position["min"]) == len(position["max"]) == 3


@pytest.mark.parametrize("shape", [(1, 1), (3, 5), (200, 100)])
def test_a_png_says_its_alpha_to_another_decoder(shape):
    alpha = np.random.default_rng(2).integers(0, 256, shape).astype(np.uint8)
    data = png_of_alpha(alpha)
    with Image.open(io.BytesIO(data)) as image:
        assert image.mode == "RGBA"
        assert np.array_equal(np.asarray(image), np.dstack([np.full((*shape, 3), 255), alpha]))
    # The largest takes more than a block.
    assert (len(data) > 65_535) == (shape == (200, 100))


# What a file cannot say.


def plate(name="plate"):
    return case([(name, panel((-1.0, 1.0), (-1.0, 1.0), -5.0))], [camera()])


def masked(**changes):
    built = case([("card", panel((-1.0, 1.0), (-1.0, 1.0), -5.0))], [camera()],
                 alpha={"card": Alpha.MASK})  # fmt: skip
    values = {"uv": np.array([[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]]),
              "texels": np.array([[0, 255]], np.uint8)}  # fmt: skip
    return cut_out(built, {"card": Cutout(**{**values, **changes})}).scene


def unlooked():
    return case([("card", panel((-1.0, 1.0), (-1.0, 1.0), -5.0))], [camera()],
                alpha={"card": Alpha.MASK}).scene  # fmt: skip


def grouped(*moves, growth=1.0, **changes):
    points, faces = box((-1.0, -1.0, -6.0), (1.0, 1.0, -5.0))
    objects = [("post", (points * growth**k + move, faces)) for k, move in enumerate(moves)]
    group = Group("post", "post", tuple(range(len(moves))))
    return replace(case(objects, [camera()]).scene, groups=(replace(group, **changes),))


@pytest.mark.parametrize(
    ("scene", "told"),
    [
        (case([], [camera()]).scene, "it has no object"),
        (unlooked(), "object 'card': no file can say this scene exactly: an alpha mask cannot"),
        (masked(uv=np.full((4, 2), 0.1)), "a mask's coordinates are no float32 numbers"),
        (replace(plate().scene, paths=("house/plate",)), "an object is not at the root"),
        (
            grouped(0.0, 4.0, growth=2.0),
            "object 'post#2': no file can say this scene exactly: an instance is",
        ),
        (grouped(0.0, 4.0, objects=(1, 0)), "a group is no row of instances"),
        (grouped(0.0, 4.0, levels=((0,), (1,))), "a group is no row of instances"),
        (grouped(0.0, 4.0, name="posts"), "an instance is no moved copy"),
    ],
)
def test_what_a_file_cannot_say_exactly_is_refused(scene, told):
    with pytest.raises(InputError, match=told):
        glb_of(scene)


def test_what_a_file_can_say_is_read_back(tmp_path):
    """The rules above are no wider than they must be."""
    file = tmp_path / "scene.glb"
    for scene in (masked(nearest=False), grouped(0.0, 4.0, -2.5)):
        file.write_bytes(glb_of(scene))
        found = load_scene(file)
        assert found.groups == scene.groups
        assert corners(found, found.triangles) == corners(scene, scene.triangles)
        if scene.masks is not None:
            assert found.masks.digest == scene.masks.digest


# Classes.

# By hand, from what the cases are built around.
OF_CLASS = {
    "animated": "bending_reeds",
    "blending": "glass torn_layers revealed_behind_glass",
    "clip-plane": "cut_by_a_plane",
    "clusters": "half_of_a_wall_of_two_clusters shell_of_clusters overlapping_clusters",
    "far-origin": "far_from_the_origin about_an_origin_of_its_own",
    "infinite-far": "huge_depth_range sides_of_a_cube",
    "instancing": "instances_of_one_draw",
    "lens-shift": "lens_shift_and_zoom beside_the_unshifted_view revealed_by_a_pierced_wall "
    "revealed_leaning_panels",
    "masks": "glass through_the_holes_of_a_mask masks_behind_masks",
    "moving": "sliding_door carried_about turning_about appearing_and_vanishing two_views "
    "two_views_of_a_changing_city",
    "one-sided": "one_sided_walls one_sided_walls_at_the_side",
    "orthographic": "beside_the_unshifted_view orthographic_camera exactly_at_the_near_plane "
    "close_by_in_an_orthographic_view cut_by_a_plane one_sided_walls_at_the_side picture_and_map",
    "resizing": "odd_viewports large_object_at_the_edge hole_of_a_pixel",
    "views": "two_eyes sides_of_a_cube picture_and_map two_views two_views_of_a_changing_city",
}


def test_each_case_has_the_classes_that_it_is_built_around():
    assert list(OF_CLASS) == list(CLASSES) == sorted(CLASSES)
    for name, listed in OF_CLASS.items():
        found = {one.name for one in CASES.values() if name in one.classes}
        assert found == set(listed.split()), name
    # And most ask nothing more than a plain engine does.
    assert sum(not one.classes for one in CASES.values()) > 20


def test_a_class_goes_with_what_it_is_read_off():
    """Each of these takes away what made the class, and nothing else."""
    first = {name: CASES[listed.split()[0]] for name, listed in OF_CLASS.items()}

    def without(name, scene=None, path=None, units=None):
        one = first[name]
        return classes_of(scene or one.scene, path or one.path, units)

    def still(path):
        return CameraPath([frame.cameras[0] for frame in path.frames])

    def changed(path, **values):
        return CameraPath([replace(camera, **values) for camera in path.cameras])

    assert without("animated", path=still(first["animated"].path)) == ()
    assert without("moving", path=still(first["moving"].path)) == ()
    assert without("views", path=still(first["views"].path)) == ()
    assert without("clusters") == ()
    glass, holes = first["blending"].scene, CASES["masks_behind_masks"].scene
    assert without("blending", scene=replace(glass, alpha=glass.alpha * 0)) == ()
    assert classes_of(replace(holes, alpha=holes.alpha * 0), plate().path, None) == ()
    far, posts = first["far-origin"].scene, first["instancing"].scene
    assert without("far-origin", scene=replace(far, origin=np.zeros(3))) == ()
    assert without("instancing", scene=replace(posts, groups=())) == ()
    walls = first["one-sided"].scene
    assert without("one-sided", scene=replace(walls, one_sided=walls.one_sided & False)) == ()
    for name, values in (
        ("clip-plane", {"clip_plane": None}),
        ("infinite-far", {"far": 9.0}),
        ("lens-shift", {"shift_x_px": 0.0, "shift_y_px": 0.0}),
        ("orthographic", {"ymag": None, "yfov": 1.0}),
        ("resizing", {"width": 9, "height": 9}),
    ):
        assert name not in without(name, path=changed(first[name].path, **values)), name


# The folder.


@pytest.fixture(scope="module")
def suite(tmp_path_factory):
    folder = tmp_path_factory.mktemp("written") / "suite"
    files.write_suite(folder)
    return folder


def test_the_folder_is_what_its_manifest_says(suite):
    manifest = json.loads((suite / files.MANIFEST).read_text())
    listed = {files.MANIFEST, files.EXPECTED}
    for one in manifest["cases"]:
        assert one["claim"]
        assert one["trap"]
        assert one["classes"] == list(CASES[one["name"]].classes)
        assert one["frames"] == len(json.loads((suite / one["path"]).read_text())["frames"])
        named = {one[key] for key in ("scene", "path", "units_file")} - {None}
        assert {f"{one['name']}/{file}" for file in one["sha256"]} == named
        assert (one["units"] is None) == (one["units_file"] is None)
        listed |= named
    assert [one["name"] for one in manifest["cases"]] == list(CASES)
    found = {p.relative_to(suite).as_posix() for p in suite.rglob("*") if p.is_file()}
    assert found == listed
    assert files.check_manifest(suite / files.MANIFEST, None) == 0


def test_the_folder_s_files_fit_their_schemas(suite):
    manifest = json.loads((suite / files.MANIFEST).read_text())
    jsonschema.validate(manifest, schema("conformance"))
    for one in manifest["cases"]:
        jsonschema.validate(json.loads((suite / one["path"]).read_text()), schema("path"))
    for key in manifest:
        spoilt = {**manifest, key: None}
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(spoilt, schema("conformance"))
    first = manifest["cases"][0]
    for key in first.keys() - {"units", "units_file"}:
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(
                {**manifest, "cases": [{**first, key: None}]}, schema("conformance")
            )


def test_writing_again_gives_the_same_bytes(suite, tmp_path):
    files.write_suite(tmp_path / "again")
    for file in suite.rglob("*"):
        if file.is_file():
            assert (tmp_path / "again" / file.relative_to(suite)).read_bytes() == file.read_bytes()


def test_a_suite_of_ours_is_replaced_and_no_other_folder_is(tmp_path):
    folder = tmp_path / "suite"
    files.write_suite(folder, 1)
    files.write_suite(folder, 2)
    assert files.check_manifest(folder / files.MANIFEST, 2) == 2
    (folder / "crowd" / "crowd.jsonl").write_text("{}\n")
    with pytest.raises(InputError, match=r"crowd.jsonl.*did not write"):
        files.write_suite(folder, 2)
    other = tmp_path / "other"
    other.mkdir()
    (other / "manifest.json").write_text('{"format": "somebody-else"}')
    with pytest.raises(InputError, match="is not visref's"):
        files.write_suite(other)
    assert (other / "manifest.json").read_text() == '{"format": "somebody-else"}'


def test_units_file_says_each_cluster_by_object_and_triangles(suite):
    one = CASES["overlapping_clusters"]
    rows = (suite / one.name / files.UNITS).read_text().splitlines()
    assert rows[0] == "unit,object,first_triangle,triangle_count"
    # Three columns of three quads, the next cluster from the third column on; then the posts.
    assert rows[1:3] == ["0,0,0,18", "1,0,12,18"]
    assert rows[7:9] == ["6,1,0,2", "7,2,0,2"]


def test_clusters_of_several_objects_are_written_run_by_run():
    objects = [("a", box((0.0, 0.0, -6.0), (1.0, 1.0, -5.0)))]
    objects.append(("b", panel((2.0, 3.0), (0.0, 1.0), -5.0)))
    scene = case(objects, [camera()]).scene
    units = clusters(scene, [[11, 12, 13], [0, 1, 3, 4], [2, 5, 6, 7, 8, 9, 10]])
    text = files.units_csv(scene, units).decode()
    runs = ["0,0,11,1", "0,1,0,2", "1,0,0,2", "1,0,3,2", "2,0,2,1", "2,0,5,6"]
    assert text.splitlines()[1:] == runs
    back = files._units_back(text.encode(), scene)
    assert np.array_equal(back.triangles, units.triangles)


def test_expected_lists_who_is_visible_and_nothing_else(suite):
    expected = json.loads((suite / files.EXPECTED).read_text())["cases"]
    assert list(expected) == list(CASES)
    (row,) = expected["masks_behind_masks"]
    assert set(row["visible"]) == {"front card", "rear card", "behind column 0", "between"}
    views = [(row["frame"], row.get("view", "")) for row in expected["two_eyes"]]
    assert views == [(k, eye) for k in range(3) for eye in ("left", "right")]
    halves = [row["visible_units"] for row in expected["half_of_a_wall_of_two_clusters"]]
    assert halves[0] == [1, 2]
    assert halves[1] == [0, 2]
    # Each sample of the fence may be a hole.
    assert expected["glass"][0]["perhaps"] == ["mesh fence"]


MANIFESTS = {
    "another seed": (lambda m: m | {"seed": 3}, None, "is not the one of visref"),
    "a seed that was not asked for": (lambda m: m, 7, "written with seed 0, and 7 was asked for"),
    "another version": (lambda m: m | {"version": 2}, None, "version 2 is not known"),
    "true for a version": (lambda m: m | {"version": True}, None, "version True is not known"),
    "another format": (lambda m: m | {"format": "visref-path"}, None, "no manifest of a suite"),
    "a list": (lambda m: [m], None, "no manifest of a suite"),
    "no seed": (lambda m: m | {"seed": None}, None, "its seed is no whole number"),
    "a case less": (lambda m: m | {"cases": m["cases"][1:]}, None, "'walk_through_a_city' is not"),
    "no cases": (lambda m: m | {"cases": None}, None, "is not the one of visref"),
    "an edited file": (
        lambda m: m | {"cases": [m["cases"][0] | {"sha256": {"scene.glb": "0"}}, *m["cases"][1:]]},
        None,
        "its case 'walk_through_a_city' is not the one of visref",
    ),
}


@pytest.mark.parametrize("name", MANIFESTS)
def test_manifest_that_is_not_of_this_suite_is_refused(suite, tmp_path, name):
    change, seed, told = MANIFESTS[name]
    file = tmp_path / files.MANIFEST
    file.write_text(json.dumps(change(parse_json((suite / files.MANIFEST).read_bytes()))))
    with pytest.raises(InputError, match=told) as raised:
        files.check_manifest(file, seed)
    assert str(file) in str(raised.value)
    assert "\n" not in str(raised.value)


def test_manifest_that_is_missing_or_no_json_is_refused(tmp_path):
    file = tmp_path / files.MANIFEST
    with pytest.raises(InputError, match=r"manifest.json: cannot read the file: No such file"):
        files.check_manifest(file, None)
    file.write_text("{")
    with pytest.raises(InputError, match="not valid JSON"):
        files.check_manifest(file, None)
    file.unlink()
    os.mkfifo(file)
    with pytest.raises(InputError, match="this is a pipe"):
        files.check_manifest(file, None)


def test_a_case_is_judged_by_what_its_files_hold():
    """The exact truth of what is read back is that of what was built."""
    from visref.conformance.suite import exact_truths

    for name in ("glass", "bending_reeds", "two_eyes", "far_from_the_origin"):
        one, built = CASES[name], built_of(BY_NAME[name], 0)
        truths = exact_truths(Case(built.scene, built.path))
        assert len(truths) == len(one.truths) > 0
        for ours, theirs in zip(one.truths, truths, strict=True):
            assert np.array_equal(ours.buffer.triangle, theirs.buffer.triangle)
