"""Freeze and fly: what the page carries of the scene, and that it starts in a browser."""

from __future__ import annotations

import base64
import json
import struct
import time
import zipfile
import zlib

import numpy as np
import pytest

from tests.support import chromium
from tests.support.hand_made import square
from tests.support.report_runs import (
    BROKEN,
    HIDDEN,
    PILLAR,
    VISIBLE,
    WALL,
    Scripted,
    scene,
    write_run,
)
from visref.errors import InputError
from visref.report import view3d
from visref.report.thinned import STEPS, thinned
from visref.report.view3d import three_js, view3d_of
from visref.report.writing import write_report
from visref.run_folder.read import read_run
from visref.scene import Scene


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The second culler forgets an object in frames 1 and 3 and draws a hidden one there."""
    forgets = (WALL, PILLAR, HIDDEN)
    return write_run(
        tmp_path_factory.mktemp("runs") / "run",
        [("tight", Scripted(VISIBLE)), (BROKEN, Scripted(VISIBLE, forgets, VISIBLE, forgets))],
        superfluous_rows=True,
    )


def unpacked(text):
    content = zlib.decompress(base64.b64decode(text), -zlib.MAX_WBITS)
    (length,) = struct.unpack_from("<I", content)
    head = json.loads(content[4 : 4 + length])
    at, corners, numbers = 4 + length, 3 * sum(head["triangles"]), 3 * sum(head["vertices"])
    index = np.frombuffer(content, "<i4", corners, at).reshape(-1, 3)
    packed = np.frombuffer(content, "<u2", numbers, at + 4 * corners).reshape(-1, 3)
    bits = np.frombuffer(content, np.uint8, offset=at + 4 * corners + 2 * numbers)
    return head, index, packed, bits


def rugged(side, seed):
    """A height field of 2 side² triangles."""
    x, y = np.meshgrid(np.arange(side + 1.0), np.arange(side + 1.0))
    z = np.random.default_rng(seed).random(x.shape)
    corner = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).reshape(-1)
    lower = np.stack([corner, corner + 1, corner + side + 2], -1)
    upper = np.stack([corner, corner + side + 2, corner + side + 1], -1)
    return np.stack([x, y, z], -1).reshape(-1, 3), np.concatenate([lower, upper])


def test_the_page_carries_the_triangles_within_half_a_step(folder):
    head, index, packed, _ = unpacked(view3d_of(read_run(folder), scene()).scene)
    world, vertex, triangle = scene(), 0, 0
    for obj in range(world.object_count):
        low, step = np.array(head["low"][obj]), np.array(head["step"][obj])
        points = low + step * packed[vertex : vertex + head["vertices"][obj]]
        found = points[index[triangle : triangle + head["triangles"][obj]]]
        right = world.vertices[world.triangles[world.object_offsets[obj] :][: len(found)]]
        assert len(found) == 2
        assert np.all(np.abs(found - right) <= 0.5001 * step)
        extent = right.reshape(-1, 3).max(axis=0) - right.reshape(-1, 3).min(axis=0)
        assert np.allclose(step * STEPS, extent)
        vertex, triangle = vertex + head["vertices"][obj], triangle + head["triangles"][obj]
    assert head["names"][PILLAR] == "pillar"


def test_the_page_carries_who_is_visible_missed_and_superfluous(folder):
    run = read_run(folder)
    head, _, _, bits = unpacked(view3d_of(run, scene()).scene)
    changed = np.unpackbits(bits.reshape(5, 1), axis=1, bitorder="little")
    visible = np.bitwise_xor.accumulate(changed, axis=0)
    for place in range(5):
        assert np.flatnonzero(visible[place]).tolist() == sorted(VISIBLE)
    tight, broken = head["cullers"]
    assert tight["missed"] == tight["superfluous"] == {}
    assert {place: [obj for obj, _ in its] for place, its in broken["missed"].items()} == {
        "1": [1],
        "3": [1],
        "4": [1],
    }
    assert broken["superfluous"] == {"1": [HIDDEN], "3": [HIDDEN], "4": [HIDDEN]}
    assert broken["unlisted"] == {}


def test_missed_objects_are_whole_and_others_are_simplified():
    parts = [(f"part {seed}", *rugged(20, seed)) for seed in range(4)]
    shown = thinned(Scene.from_objects(parts), [2], budget=900, whole_budget=800)
    assert shown.whole.tolist() == [False, False, True, False]
    assert shown.triangle_counts[2] == 800
    rest = np.delete(shown.triangle_counts, 2)
    assert rest.min() > 0
    assert rest.sum() <= 900
    # Beyond the second budget it is one of the others.
    assert not thinned(Scene.from_objects(parts), [2], 900, 799).whole.any()


def test_loose_pieces_keep_to_the_budget_and_the_smallest_are_left_out():
    """No edge of a loose triangle can be collapsed."""
    loose = np.arange(3000).reshape(-1, 3)
    points = np.random.default_rng(1).random((3000, 3))
    shown = thinned(Scene.from_objects([("soup", points, loose)]), [], 100, 0)
    assert 0 < len(shown.triangles) <= 100
    squares = [(f"{size}", *square(0.0, 0.0, 0.0, size)) for size in (1.0, 4.0, 2.0, 3.0)]
    shown = thinned(Scene.from_objects(squares), [], 4, 0)
    assert shown.triangle_counts.tolist() == [0, 2, 0, 2]
    assert shown.left_out == 2


def test_another_scene_is_refused_in_one_line(folder):
    other = Scene.from_objects([("other", *square(0.0, 0.0, 0.0, 1.0))])
    with pytest.raises(InputError, match="not the scene that was judged") as refused:
        view3d_of(read_run(folder), other)
    assert "\n" not in str(refused.value)


def test_the_view_goes_with_one_run(folder, tmp_path):
    with pytest.raises(InputError, match="one run"):
        write_report([folder, folder], tmp_path, scene=scene())


def test_the_page_has_the_view_only_with_a_scene(folder, tmp_path):
    without = write_report([folder], tmp_path / "a").read_text()
    page = write_report([folder], tmp_path / "b", scene=scene()).read_text()
    assert 'class="flight"' not in without
    assert 'class="flight"' in page
    assert "Three.js Authors SPDX-License-Identifier: MIT" in page
    assert page == write_report([folder], tmp_path / "b", scene=scene()).read_text()
    assert not (tmp_path / "b" / "scene3d.js").exists()


def test_what_is_too_large_is_written_beside(folder, tmp_path, monkeypatch):
    inside = view3d_of(read_run(folder), scene())
    size = len(inside.scene) + len(inside.three)
    assert not view3d_of(read_run(folder), scene(), most=size).beside
    assert view3d_of(read_run(folder), scene(), most=size - 1).beside
    monkeypatch.setattr("visref.report.writing.view3d_of", lambda *a: view3d_of(*a, most=size - 1))
    page = write_report([folder], tmp_path, scene=scene()).read_text()
    assert inside.scene not in page
    assert 'href="scene3d.js"' in page
    assert inside.scene in (tmp_path / "scene3d.js").read_text()


@pytest.mark.parametrize("content", [None, "<script>other</script>"])
def test_a_trimesh_without_three_js_is_told(folder, tmp_path, monkeypatch, content):
    assert three_js()[0].startswith("/**")
    if content is not None:
        templates = tmp_path / "resources" / "templates"
        templates.mkdir(parents=True)
        with zipfile.ZipFile(templates / "viewer.zip", "w") as archive:
            archive.writestr("viewer.html.template", content)
    monkeypatch.setattr(view3d, "files", lambda name: tmp_path)
    page = write_report([folder], tmp_path / "page", scene=scene()).read_text()
    assert "does not bring three.js along" in page
    assert 'class="flight"' not in page


@pytest.mark.slow
@pytest.mark.skipif(chromium.FOUND is None, reason="no Chromium on this machine")
def test_the_view_starts_and_its_slider_changes_what_is_counted(folder, tmp_path):
    page_file = write_report([folder], tmp_path, scene=scene())
    counts = (
        "Object.fromEntries([...document.querySelectorAll('[data-count]')]"
        ".map(e => [e.dataset.count, Number(e.textContent)]))"
    )
    with chromium.browser(*chromium.SWIFTSHADER) as page:
        page.open(page_file)
        page.run("document.querySelector('.flight').scrollIntoView()")
        end = time.monotonic() + 60
        while not page.run("document.querySelector('.flight').classList.contains('ready')"):
            assert time.monotonic() < end, page.run(
                "document.querySelector('.flight [data-of=told]').textContent"
            )
        # It opens where something was missed.
        shown = page.run(counts)
        assert shown["visible"] == 2
        assert shown["missed"] + shown["aged"] == 1
        assert shown["superfluous"] == 1
        assert shown["rest"] == 2
        page.run(
            "(() => { const s = document.querySelector('.flight input[type=range]');"
            "s.value = 2; s.dispatchEvent(new Event('input')); })()"
        )
        assert page.run(counts) == {
            "visible": 3,
            "superfluous": 0,
            "missed": 0,
            "aged": 0,
            "rest": 3,
        }
        page.click('.flight [data-of="through"]')
        assert page.run(
            "document.querySelector('.flight [data-of=through]').getAttribute('aria-pressed')"
        ) == ("true")
        # A link to a lost object marks it here.
        page.run(f"void (location.hash = '#frame=3&culler={BROKEN}&object=1')")
        while not page.run(
            "document.querySelector('.flight [data-of=chosen]').textContent.startsWith('Marked')"
        ):
            assert time.monotonic() < end
        assert page.run(counts)["superfluous"] == 1
        # Without a GPU the driver says that it is slow.
        assert [one for one in page.problems if "GL Driver Message" not in one] == []
        assert {url for url in page.requests if not url.startswith(("data:", "blob:"))} == {
            page_file.resolve().as_uri()
        }
