"""Witnesses of glass and of masked triangles replay by the rules of the judge."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.exact.test_exact_masks import EMPTY, FULL, HALVES, leaf_before_wall, masked
from visref.camera_path import CameraPath
from visref.culler import Culler, DrawnSet
from visref.engines import make_engine
from visref.judging.referee import Referee
from visref.run_folder.explain import Explanation, explain
from visref.run_folder.write import RunWriter
from visref.scene import Scene, Units

LEAF, WALL, GLASS, GLASS_BEFORE = range(4)


class Draws(Culler):
    name = "draws"

    def __init__(self, *ids: int, by_triangle: bool = False) -> None:
        self.ids, self.by_triangle = np.array(ids, np.int32), by_triangle

    def prepare(self, scene: Scene) -> Units:
        count = scene.triangle_count
        if not self.by_triangle:
            return scene.object_units()
        return Units(np.arange(count + 1), np.arange(count, dtype=np.int32), "triangle")

    def cull(self, camera):
        return DrawnSet(self.ids)


def explanations(folder: Path, scene: Scene, culler: Culler) -> dict[str, Explanation]:
    """By object: the replay of each witness that a run of one frame wrote."""
    path = CameraPath((leaf_before_wall()[1],))
    folder.mkdir()
    recorder = RunWriter(folder, scene, path, engine="exact", settings={}, picture_frames=[])
    referee = Referee(scene, lambda: make_engine("exact", scene))
    recorder.finish(referee.run(path, [0], [("draws", culler)], [recorder]))
    (file,) = (folder / "witnesses").glob("*.jsonl")
    names = [json.loads(line)["object_name"] for line in file.read_text().splitlines()]
    return {name: explain(folder, 0, name)[0] for name in names}


def altered(folder: Path, name: str, **changes: object) -> bool:
    """Whether the claim holds with every triangle of an object changed so in the file."""
    (file,) = (folder / "witnesses").glob("*.jsonl")
    lines = [json.loads(line) for line in file.read_text().splitlines()]
    for witness in lines:
        for triangle in witness["triangles"]:
            if triangle["object_name"] == name:
                triangle.update(changes)
    file.write_text("".join(json.dumps(line) + "\n" for line in lines))
    return explain(folder, 0, lines[0]["object_name"])[0].holds


def test_every_claim_holds_whatever_the_masks_say(tmp_path):
    scene, _ = leaf_before_wall()
    for texture, lost in (
        (FULL, {"leaf", "wall", "glass", "glass before"}),
        (EMPTY, {"wall", "glass", "glass before"}),
        (HALVES, {"leaf", "wall", "glass", "glass before"}),
        (None, {"wall", "glass", "glass before"}),
    ):
        there = masked(scene, texture) if texture else scene
        found = explanations(tmp_path / f"{texture and texture.alpha.shape}{lost}", there, Draws())
        assert set(found) == lost
        assert all(one.holds for one in found.values())


def test_a_solid_leafs_claim_falls_if_its_mask_is_no_longer_solid(tmp_path):
    scene, _ = leaf_before_wall()
    found = explanations(tmp_path / "run", masked(scene, FULL), Draws(WALL, GLASS, GLASS_BEFORE))
    assert found["leaf"].holds
    assert any("masked, solid" in line for line in found["leaf"].lines)
    assert not altered(tmp_path / "run", "leaf", mask=0)
    assert not altered(tmp_path / "run", "leaf", mask=2)
    assert altered(tmp_path / "run", "leaf", mask=1)
    assert not altered(tmp_path / "run", "leaf", drawn=True)


def test_a_wall_lost_behind_a_leaf_in_doubt_falls_if_the_leaf_was_drawn(tmp_path):
    scene, _ = leaf_before_wall()
    # Only the leaf is before the wall, which is as large.
    vertices = scene.vertices.copy()
    vertices[4:8] = vertices[:4] - np.array([0, 0, 5], np.float32)
    scene = replace(scene, vertices=vertices)
    found = explanations(tmp_path / "run", scene, Draws(GLASS, GLASS_BEFORE))
    assert set(found) == {"wall"}
    assert found["wall"].holds
    assert any("masked, in between" in line for line in found["wall"].lines)
    assert not altered(tmp_path / "run", "leaf", drawn=True)


def test_drawn_glass_does_not_deny_that_the_opaque_part_behind_it_is_lost(tmp_path):
    scene, _ = leaf_before_wall()
    alpha = scene.alpha.copy()
    alpha[:2] = 2
    # A window: the pane before, the wall behind, one object.
    window = Scene(
        scene.vertices[:8], scene.triangles[:4], np.array([0, 4]), ("window",), alpha=alpha[:4]
    )
    found = explanations(tmp_path / "run", window, Draws(0, 1, by_triangle=True))
    assert found["window"].witness["partly"]
    assert found["window"].holds
    (tmp_path / "b").mkdir()
    glass = explanations(tmp_path / "b" / "run", window, Draws(2, 3, by_triangle=True))
    assert glass["window"].witness["triangle"] in (0, 1)
    assert glass["window"].holds


@pytest.mark.parametrize("mask", [1, 2])
def test_glass_behind_what_may_be_opaque_is_no_claim(tmp_path, mask):
    scene, _ = leaf_before_wall()
    found = explanations(tmp_path / "run", masked(scene, EMPTY), Draws(LEAF, WALL, GLASS_BEFORE))
    assert found["glass"].holds
    # Let the leaf cover the whole picture, and its mask say otherwise.
    (file,) = (tmp_path / "run" / "witnesses").glob("*.jsonl")
    witness = json.loads(file.read_text())
    wall = next(t for t in witness["triangles"] if t["object_name"] == "wall")
    corners = [[v, w, (0.5).hex()] for v, w, _ in wall["vertices"]]
    witness["triangles"].append(
        wall | {"object": 0, "object_name": "leaf", "triangle": 0, "alpha": 1, "vertices": corners}
    )
    file.write_text(json.dumps(witness) + "\n")
    assert not altered(tmp_path / "run", "leaf", mask=mask)
    assert altered(tmp_path / "run", "leaf", mask=0)
