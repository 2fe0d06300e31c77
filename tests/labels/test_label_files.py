"""`visref truth --labels …` and its companions, as somebody who makes data uses them."""

from __future__ import annotations

import json
import re
from collections import Counter
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from PIL import Image

from tests.labels.alone import scene_of
from tests.support import exact_brute
from visref.camera import Camera
from visref.cli.main import main
from visref.conformance.glb import glb_of
from visref.exact import ExactScene
from visref.inputs import open_inputs
from visref.labels.bop import intrinsics
from visref.labels.images import MOST_IN_16_BITS, ImageFolder
from visref.labels.models import RIGID, Model, diameter, normals, pose_between
from visref.labels.table import SCHEMA
from visref.scene import Scene
from visref.visibility import objects_seen

# A cart that passes before a wall, a crate before it and one behind; two views.
FRAMES = 4
# pycocotools hands out its masks in a way that NumPy 2 finds old.
NUMPY_1_STYLE = pytest.mark.filterwarnings(
    "ignore:__array__ implementation doesn't accept a copy keyword:DeprecationWarning"
)


def box(centre: tuple[float, float, float], size: float) -> tuple[np.ndarray, np.ndarray]:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    return corners * size / 2 + centre, np.array(
        [[f[0], f[i], f[i + 1]] for f in faces for i in (1, 2)]
    )


WALL = np.array([[-3, -1, -6], [3, -1, -6], [3, 2, -6], [-3, 2, -6]], float)
OBJECTS = [
    ("wall", WALL, np.array([[0, 1, 2], [0, 2, 3]])),
    ("cart", *box((0.0, 0.0, 0.0), 1.0)),
    ("crate", *box((0.5, 0.0, -8.0), 1.0)),
    ("crate", *box((1.5, -0.5, -5.0), 0.75)),
]


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scene")
    scene = Scene.from_objects(OBJECTS)
    (folder / "scene.glb").write_bytes(glb_of(scene, given=True))
    frames = []
    for number in range(FRAMES):
        turn = 0.4 * number
        world = np.eye(4)
        world[:3, :3] = [
            [np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)],
        ]  # fmt: skip
        world[:3, 3] = [-1.5 + number, 0.1, -4.0]
        aside = np.eye(4)
        aside[0, 3] = 0.5
        frames.append(
            {
                "views": {
                    "left": {"world_from_camera": np.eye(4).tolist()},
                    "right/eye": {"world_from_camera": aside.tolist(), "width": 40},
                },
                "world_from_object": {"cart": world.tolist()},
                **({"absent": ["crate#2"]} if number == 2 else {}),
            }
        )
    path = {
        "format": "visref-path", "version": 1, "width": 48, "height": 36, "near": 0.1, "far": 50.0,
        "yfov": 0.9, "frames": frames,
    }  # fmt: skip
    (folder / "path.json").write_text(json.dumps(path))
    return [str(folder / "scene.glb"), "--path", str(folder / "path.json"), "--engine", "exact"]


def truth(inputs, folder, *more, status=0):
    folder.mkdir(exist_ok=True)
    arguments = ["truth", *inputs, "--out", str(folder / "truth.parquet"), *map(str, more)]
    assert main(arguments) == status


@pytest.fixture(scope="module")
def made(inputs, tmp_path_factory):
    """All of it."""
    folder = tmp_path_factory.mktemp("made")
    truth(
        inputs, folder, "--labels", folder / "labels.parquet", "--images", folder / "images",
        "--coco", folder / "coco.json", "--bop", folder / "bop",
    )  # fmt: skip
    return folder


def alone(inputs, scene, camera, object_id):
    """(height, width) bool: the object drawn by itself."""
    only = scene_of(scene, object_id)
    cast = ExactScene(only, threads=1).certify(camera)
    return cast.buffer.triangle >= 0


def every_cell(inputs):
    given = open_inputs(inputs[0], path=inputs[2])
    for frame in given.frames:
        for camera in given.path.views(frame):
            yield given, frame, camera, given.timeline.at(frame)


def test_labels_of_a_moving_scene_agree_with_each_object_drawn_by_itself(inputs, made):
    rows = pq.read_table(made / "labels.parquet").to_pylist()
    by_cell: dict = {}
    for row in rows:
        by_cell.setdefault((row["frame"], row["view"]), []).append(row)
    owned = {
        (row["frame"], row["view"], row["object"]): row["pixels"]
        for row in pq.read_table(made / "truth.parquet").to_pylist()
    }
    hidden = 0
    for given, frame, camera, scene in every_cell(inputs):
        there = [row["object"] for row in by_cell[frame, camera.view]]
        assert there == ([0, 1, 2] if frame == 2 else [0, 1, 2, 3])
        cast = ExactScene(scene, threads=1).certify(camera)
        nearest = np.where(
            cast.buffer.triangle >= 0, scene.object_of_triangle[cast.buffer.triangle], -1
        )
        for row in by_cell[frame, camera.view]:
            each = row["object"]
            mask = alone(inputs, scene, camera, each)
            assert row["name"] == given.scene.names[each]
            assert row["silhouette_samples"] == mask.sum()
            visible = mask & (nearest == each)
            assert row["visible_samples"] == visible.sum()
            assert row["visible_samples"] == owned.get((frame, camera.view, each), 0)
            assert row["visible_box"] == edges_of(visible)
            if row["in_view_fraction"] == 1.0:
                assert row["amodal_box"] == edges_of(mask)
            assert row["undecided_fraction"] == (0.0 if mask.any() else None)
            behind = {
                int(one): int((mask & (nearest == one)).sum())
                for one in np.unique(nearest[mask])
                if one != each
            }
            told = {one["object"]: one["samples"] for one in row["occluders"]}
            assert told == behind
            shares = [one["share"] for one in row["occluders"]]
            assert shares == sorted(shares, reverse=True)
            if mask.any():
                assert row["visibility_fraction"] == visible.sum() / mask.sum()
                assert row["visibility_fraction"] + sum(shares) == pytest.approx(1.0)
                hidden += not visible.any()
    assert hidden, "something is hidden wholly, and labelled"


def test_labels_of_a_moving_scene_agree_with_poses_by_hand_and_rays_by_the_book(inputs, made):
    """Of visref itself there is only what a sample is: the camera's numbers."""
    rows = pq.read_table(made / "labels.parquet").to_pylist()
    said = {(row["frame"], row["view"], row["object"]): row for row in rows}
    names = ["wall", "cart", "crate", "crate#2"]
    hidden = 0
    for number, frame in enumerate(json.loads(Path(inputs[2]).read_text())["frames"]):
        pose = np.array(frame["views"]["left"]["world_from_camera"])
        camera = Camera(pose, 48, 36, near=0.1, far=50.0, yfov=0.9)
        nearest = [(np.inf, -1)] * camera.samples
        masks = {}
        for each, (_, points, faces) in enumerate(OBJECTS):
            if names[each] in frame.get("absent", ()):
                assert (number, "left", each) not in said
                continue
            world = np.array(frame["world_from_object"].get(names[each], np.eye(4)))
            moved = points @ world[:3, :3].T + world[:3, 3]
            hits = exact_brute.hits(Scene.from_objects([("alone", moved, faces)]), camera)
            masks[each] = [min((t for t, _ in one), default=None) for one in hits]
            for sample, depth in enumerate(masks[each]):
                if depth is not None and depth < nearest[sample][0]:
                    nearest[sample] = (depth, each)
        for each, depths in masks.items():
            own = [sample for sample, depth in enumerate(depths) if depth is not None]
            by = Counter(nearest[sample][1] for sample in own)
            row = said[number, "left", each]
            assert row["silhouette_samples"] == len(own)
            assert row["visible_samples"] == by.pop(each, 0)
            assert {one["object"]: one["samples"] for one in row["occluders"]} == dict(by)
            least = min((float(depths[sample]) for sample in own), default=None)
            assert row["depth"] == pytest.approx(least, rel=2.0**-30)
            hidden += bool(own) and row["visible_samples"] == 0
    assert hidden


def edges_of(mask):
    if not mask.any():
        return None
    y, x = np.nonzero(mask)
    return [x.min(), y.min(), x.max() + 1, y.max() + 1]


def test_columns_are_those_of_the_page(made):
    assert pq.read_schema(made / "labels.parquet").equals(SCHEMA)


def test_same_bytes_with_any_number_of_threads_and_after_a_merge(inputs, made, tmp_path):
    for threads in (1, 2):
        truth(inputs, tmp_path, "--labels", tmp_path / f"{threads}.parquet", "--threads", threads)
    parts = []
    for frames in ("2:4", "0:2"):
        parts.append(str(tmp_path / f"part-{frames[0]}.parquet"))
        truth(inputs, tmp_path, "--labels", parts[-1], "--frames", frames)
    assert main(["merge", *parts, "--out", str(tmp_path / "merged.parquet")]) == 0
    whole = (made / "labels.parquet").read_bytes()
    for name in ("1", "2", "merged"):
        assert (tmp_path / f"{name}.parquet").read_bytes() == whole
    # And it may be merged again, with nothing.
    again = ["merge", str(tmp_path / "merged.parquet"), "--out", str(tmp_path / "again.parquet")]
    assert main(again) == 0
    assert (tmp_path / "again.parquet").read_bytes() == whole


def test_labels_that_were_changed_or_do_not_belong_together_are_not_merged(
    inputs, made, tmp_path, capsys
):
    labels = made / "labels.parquet"
    table = pq.read_table(labels)
    column = table["visible_samples"].to_numpy() + 1
    place = table.schema.get_field_index("visible_samples")
    edited = table.set_column(place, table.schema.field(place), pa.array(column))
    pq.write_table(edited, tmp_path / "edited.parquet")
    out = ["--out", str(tmp_path / "merged.parquet")]
    for parts, said in (
        ([tmp_path / "edited.parquet"], "changed after it was written"),
        ([labels, labels], "overlap"),
        ([labels, made / "truth.parquet"], "some are labels and some are not"),
    ):
        assert main(["merge", *map(str, parts), *out]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert said in line
    truth([*inputs[:3], "--engine", "embree"], tmp_path, "--frames", "0:1", "--labels",
          tmp_path / "rays.parquet")  # fmt: skip
    capsys.readouterr()
    assert main(["merge", str(labels), str(tmp_path / "rays.parquet"), *out]) == 2
    assert "cast by another engine" in capsys.readouterr().err
    assert not (tmp_path / "merged.parquet").exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--labels", "{}/truth.parquet"], "--labels and --out are the same place"),
        (["--images", "{}/a", "--bop", "{}/a/b"], "--bop and --images are the same place"),
        (["--images", "{}/foreign"], "is not empty"),
        (["--labels", "{}/foreign/notes.txt"], "of another kind"),
        (["--coco", "{}/foreign"], "it is a folder"),
    ],
)
def test_wrong_places_are_refused_in_one_line(inputs, tmp_path, capsys, arguments, said):
    (tmp_path / "foreign").mkdir()
    (tmp_path / "foreign" / "notes.txt").write_text("mine")
    truth(inputs, tmp_path, *[one.format(tmp_path) for one in arguments], status=2)
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line
    assert [file.name for file in tmp_path.iterdir()] == ["foreign"]
    assert (tmp_path / "foreign" / "notes.txt").read_text() == "mine"


def test_bop_refuses_an_orthographic_camera_before_anything_is_cast(inputs, tmp_path, capsys):
    path = json.loads(Path(inputs[2]).read_text(encoding="utf-8"))
    path["ymag"] = path.pop("yfov")
    (tmp_path / "flat.json").write_text(json.dumps(path))
    flat = [inputs[0], "--path", str(tmp_path / "flat.json")]
    truth(flat, tmp_path, "--bop", tmp_path / "bop", status=2)
    assert "orthographic" in capsys.readouterr().err
    assert not (tmp_path / "truth.parquet").exists()


def test_folders_of_ours_are_replaced_and_only_those(inputs, made, tmp_path, capsys):
    for _ in range(2):
        truth(
            inputs, tmp_path, "--frames", "0:1", "--images", tmp_path / "i", "--bop", tmp_path / "b"
        )
    scene = tmp_path / "b" / "test" / "000000"
    (scene / "rgb").mkdir()
    (scene / "rgb" / "000000.png").write_bytes(b"")
    capsys.readouterr()
    truth(inputs, tmp_path, "--frames", "0:1", "--bop", tmp_path / "b", status=2)
    assert "rgb" in capsys.readouterr().err


@NUMPY_1_STYLE
def test_images_are_the_truth_of_each_view(inputs, made):
    index = json.loads((made / "images" / "labels.json").read_text())
    assert index["bits"] == 16
    assert len(index["images"]) == 2 * FRAMES
    for (_given, frame, camera, scene), said in zip(
        every_cell(inputs), index["images"], strict=True
    ):
        assert (said["frame"], said["view"]) == (frame, camera.view)
        assert (said["width"], said["height"]) == (camera.width, camera.height)
        cast = ExactScene(scene, threads=1).certify(camera)
        with Image.open(made / "images" / said["instances"]) as image:
            assert image.mode == "I;16"
            ids = np.array(image).astype(int)
        owner = cast.buffer.triangle
        assert np.array_equal(ids - 1, np.where(owner >= 0, scene.object_of_triangle[owner], -1))
        with np.load(made / "images" / said["depth"]) as kept:
            assert np.array_equal(kept["depth"], cast.buffer.depth.astype(np.float32))
        masks = json.loads((made / "images" / said["amodal"]).read_text())["objects"]
        coded = {one["object"]: one["segmentation"] for one in masks}
        for each in range(scene.object_count):
            mask = alone(inputs, scene, camera, each)
            assert (each in coded) == mask.any()
            if mask.any():
                assert coded[each]["size"] == [camera.height, camera.width]
                mask_utils = pytest.importorskip("pycocotools.mask")
                assert np.array_equal(mask_utils.decode(coded[each]), mask)


def test_more_objects_than_16_bits_hold_take_32(tmp_path):
    count = MOST_IN_16_BITS + 1
    shape = np.array([[-1, -1, -4], [1, -1, -4], [0, 1, -4]], float)
    vertices = np.concatenate([np.zeros((3 * (count - 1), 3)), shape]).astype(np.float32)
    scene = Scene(
        vertices, np.arange(3 * count).reshape(-1, 3), np.arange(count + 1),
        tuple(f"o{i}" for i in range(count)),
    )  # fmt: skip
    from tests.labels.test_closed_forms import CAMERA

    exact = ExactScene(scene, threads=1)
    cast = exact.certify(CAMERA)
    from visref.labels.frame import Labeller

    labels = Labeller(exact).frame(scene, cast, objects_seen(cast, scene))
    folder = ImageFolder(tmp_path, scene)
    folder.add(0, cast, labels)
    folder.finish()
    with Image.open(tmp_path / "instances" / "000000.png") as image:
        ids = np.array(image).view("<u4")[..., 0]
    assert json.loads((tmp_path / "labels.json").read_text())["bits"] == 32
    assert set(np.unique(ids).tolist()) == {0, count}


@NUMPY_1_STYLE
def test_coco_is_read_by_its_own_tools(inputs, made):
    coco = pytest.importorskip("pycocotools.coco")
    mask_utils = pytest.importorskip("pycocotools.mask")
    read = coco.COCO(str(made / "coco.json"))
    assert [one["name"] for one in read.loadCats(read.getCatIds())] == ["wall", "cart", "crate"]
    found = 0
    for number, (_given, _frame, camera, scene) in enumerate(every_cell(inputs), 1):
        (image,) = read.loadImgs(number)
        assert (image["width"], image["height"]) == (camera.width, camera.height)
        cast = ExactScene(scene, threads=1).certify(camera)
        owner = cast.buffer.triangle
        nearest = np.where(owner >= 0, scene.object_of_triangle[owner], -1)
        annotations = read.loadAnns(read.getAnnIds(imgIds=number))
        assert sorted(one["object"] for one in annotations) == sorted(set(nearest.ravel()) - {-1})
        for one in annotations:
            visible = nearest == one["object"]
            assert np.array_equal(read.annToMask(one), visible)
            assert one["area"] == visible.sum() == mask_utils.area(one["segmentation"])
            assert one["bbox"] == mask_utils.toBbox(one["segmentation"]).tolist()
            whole = alone(inputs, scene, camera, one["object"])
            assert np.array_equal(mask_utils.decode(one["amodal_segmentation"]), whole)
            # Byte for byte what COCO's own coder writes.
            own = mask_utils.encode(np.asfortranarray(whole.astype(np.uint8)))["counts"]
            assert one["amodal_segmentation"]["counts"] == own.decode()
            found += 1
    assert found > 12


def models_of(folder):
    """Points, normals and triangles by obj_id, from PLY files."""
    found = {}
    for file in sorted((folder / "models").glob("*.ply")):
        head, _, body = file.read_text().partition("end_header\n")
        points = int(head.split("element vertex ")[1].split()[0])
        rows = body.splitlines()
        vertices = np.array([row.split() for row in rows[:points]], float)
        faces = np.array([row.split() for row in rows[points:]], int)[:, 1:]
        assert re.findall(r"property double (\w+)", head) == ["x", "y", "z", "nx", "ny", "nz"]
        found[int(file.stem[4:])] = vertices[:, :3], vertices[:, 3:], faces
    return found


def test_bop_poses_put_the_models_where_the_images_show_them(inputs, made):
    models = models_of(made / "bop")
    info = json.loads((made / "bop" / "models" / "models_info.json").read_text())
    assert info["2"]["diameter"] == pytest.approx(1000 * np.sqrt(3), rel=2.0**-20)
    assert [info["2"][f"size_{axis}"] for axis in "xyz"] == pytest.approx([1000] * 3, rel=2.0**-18)
    views = {"left": "000000", "right/eye": "000001"}
    compared = 0
    for _given, frame, camera, scene in every_cell(inputs):
        folder = made / "bop" / "test" / views[camera.view]
        said, poses, shown = (
            json.loads((folder / f"scene_{name}.json").read_text())[str(frame)]
            for name in ("camera", "gt", "gt_info")
        )
        matrix = np.array(said["cam_K"]).reshape(3, 3)
        cast = ExactScene(scene, threads=1).certify(camera)
        with Image.open(folder / "depth" / f"{frame:06d}.png") as image:
            depth = np.array(image) * said["depth_scale"]
        real = np.where(np.isfinite(cast.buffer.depth), 1000 * cast.buffer.depth, 0.0)
        assert np.abs(depth - real).max() <= said["depth_scale"] / 2 * 1.001
        assert len(poses) == len(shown)
        for number, (pose, info_of) in enumerate(zip(poses, shown, strict=True)):
            each = pose["obj_id"] - 1
            points, _, _ = models[pose["obj_id"]]
            rotation = np.array(pose["cam_R_m2c"]).reshape(3, 3)
            assert np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
            assert np.linalg.det(rotation) > 0
            there = points @ rotation.T + pose["cam_t_m2c"]
            first, last = scene.object_offsets[each : each + 2]
            world = scene.vertices[np.unique(scene.triangles[first:last])].astype(float)
            pixels, view_depth = camera.pixel_of(world)
            shown_at = there @ matrix.T
            assert np.allclose(shown_at[:, :2] / shown_at[:, 2:], pixels, atol=1e-3)
            assert np.allclose(shown_at[:, 2], 1000 * view_depth, rtol=1e-6)
            # And by the world.
            by_world = 1000 * world @ np.array(said["cam_R_w2c"]).reshape(3, 3).T
            assert np.allclose(by_world + said["cam_t_w2c"], there, atol=1e-2)
            mask = alone(inputs, scene, camera, each)
            visible = mask & (scene.object_of_triangle[cast.buffer.triangle] == each)
            for name, wanted in (("mask", mask), ("mask_visib", visible)):
                with Image.open(folder / name / f"{frame:06d}_{number:06d}.png") as image:
                    assert np.array_equal(np.array(image), wanted * 255)
            check_info(info_of, mask, visible, depth)
            compared += 1
    assert compared > 15


def check_info(said, mask, visible, depth):
    """As the toolkit's calc_gt_info defines it, of what lies in the image."""
    assert said["px_count_visib"] == visible.sum()
    assert said["px_count_valid"] == (depth[mask] > 0).sum()
    assert said["px_count_all"] >= mask.sum()
    assert said["visib_fract"] == visible.sum() / said["px_count_all"]
    if not visible.any():
        assert said["bbox_obj"] == said["bbox_visib"] == [-1, -1, -1, -1]
        return
    y, x = np.nonzero(visible)
    assert said["bbox_visib"] == [x.min(), y.min(), np.ptp(x), np.ptp(y)]
    if said["px_count_all"] == mask.sum():
        y, x = np.nonzero(mask)
        assert said["bbox_obj"] == [x.min(), y.min(), np.ptp(x), np.ptp(y)]
    else:
        x0, y0, width, height = said["bbox_obj"]
        assert x0 < 0 or y0 < 0 or x0 + width >= mask.shape[1] or y0 + height >= mask.shape[0]


def test_bop_models_have_normals_weighted_by_angles(made):
    models = models_of(made / "bop")
    # Those of a wall face the camera; those of a box are its corners' diagonals, however its faces
    # are cut into triangles.
    points, facing, _ = models[1]
    assert np.allclose(facing, [0.0, 0.0, 1.0])
    points, facing, _ = models[3]
    assert len(points) == 8
    assert np.allclose(np.abs(facing), 1 / np.sqrt(3), atol=1e-6)
    outwards = np.sign((facing * points).sum(axis=1))
    assert np.all(outwards == outwards[0])
    lonely = normals(np.eye(3), np.array([[0, 0, 1]], np.int32))
    assert np.array_equal(lonely, [[0.0, 0.0, 1.0]] * 3)


def test_what_bends_or_is_scaled_has_no_pose():
    rng = np.random.default_rng(1)
    points = rng.normal(size=(20, 3))
    faces = rng.permutation(60).reshape(20, 3) % 20
    scene = Scene.from_objects([("thing", points, faces)])
    model = Model.of(scene, 0)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))

    def posed(world):
        return Scene.from_objects([("thing", world, faces)])

    rotation, at = pose_between(model, posed(points @ turn.T + [5, 6, 7]))
    assert np.allclose(rotation, turn, atol=100 * RIGID)
    assert np.allclose(at, turn @ model.centre + [5, 6, 7], atol=100 * RIGID)
    bent = points.copy()
    bent[0] += 0.001
    for wrong in (points * 1.001, bent, points * [1, 1, -1]):
        assert pose_between(model, posed(wrong)) is None


@pytest.mark.parametrize("seed", range(3))
def test_diameter_is_the_greatest_distance_of_any_two(seed):
    points = np.random.default_rng(seed).normal(size=(50, 3)) * [1, 2, 0.1]
    every = np.linalg.norm(points[:, None] - points[None], axis=2)
    assert diameter(points) == pytest.approx(every.max(), rel=1e-15)


def test_pixel_centres_are_whole_in_bops_matrix():
    from tests.labels.test_silhouettes import CAMERAS

    camera = CAMERAS["shifted"]
    for x, y in ((0, 0), (15, 19), (7, 3)):
        start, direction = camera.ray(x, y)
        local = (start + 3.0 * direction - camera.eye) @ camera.world_from_camera[:3, :3]
        seen = intrinsics(camera) @ (local * [1, -1, -1])
        assert seen[:2] / seen[2] == pytest.approx([x, y], abs=1e-9)
