"""A witness replays from the run folder alone, and a false one does not."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.cli.test_cli import record, write_scene
from visref.cli.main import main
from visref.run_folder.explain import AROUND_PX, MAGNIFICATION, explain

VERMILION = (213, 94, 0)


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run in which 'beside' was forgotten in frame 1; its scene is gone."""
    scene, path = write_scene(tmp_path)
    visible = record(tmp_path, ["front", "beside"], ["front"])
    out = tmp_path / "run"
    arguments = ["check", scene, "--path", path, "--visible", visible, "--out", str(out)]
    assert main(arguments) == 1
    for file in (scene, path, visible):
        Path(file).unlink()
    return out


def rewrite(run: Path, change) -> None:
    (file,) = (run / "witnesses").glob("*.jsonl")
    witness = json.loads(file.read_text())
    change(witness)
    file.write_text(json.dumps(witness) + "\n")


def test_the_claim_holds_without_the_scene(run, capsys):
    assert main(["explain", str(run), "--frame", "1", "--object", "beside"]) == 0
    printed = capsys.readouterr().out
    assert "the claim holds" in printed
    assert "'beside'" in printed
    assert "not drawn" in printed


def test_hits_come_in_order_of_depth_with_the_known_depths(run):
    (explanation,) = explain(run, 1, "beside")
    depths = [hit.depth for hit in explanation.hits]
    assert depths == sorted(depths)
    # The box beside reaches from z = 1 to z = -1, the eye is at z = 10.
    assert depths[0] == 9.0
    assert explanation.hits[0].order == 0
    assert 9.0 * int(explanation.hits[0].denominator) == int(explanation.hits[0].numerator)


def picture_of(run: Path, picture: Path) -> np.ndarray:
    arguments = ["explain", str(run), "--frame", "1", "--object", "2", "--picture", str(picture)]
    main(arguments)
    return np.asarray(Image.open(picture).convert("RGB"))


def test_the_picture_shows_what_was_lost_and_what_was_drawn_without_the_scene(run, tmp_path):
    pixels = picture_of(run, tmp_path / "p.png")
    # Three panels side by side, a margin between: the lost object is filled in the first and the
    # last, and has an outline alone in the second.
    width = pixels.shape[1] // 3
    vermilion = [
        np.count_nonzero(pixels[:, i * width : (i + 1) * width, 0].astype(int)
                         - pixels[:, i * width : (i + 1) * width, 2] > 120)
        for i in range(3)
    ]  # fmt: skip
    assert vermilion[0] > 4 * vermilion[1] > 0
    assert vermilion[2] > vermilion[0]
    assert np.array_equal(pixels, picture_of(run, tmp_path / "again.png"))


def test_without_surroundings_the_picture_shows_the_missed_object_at_the_witness(run, tmp_path):
    rewrite(run, lambda witness: witness.pop("surroundings"))
    pixels = picture_of(run, tmp_path / "p.png")
    middle = AROUND_PX * MAGNIFICATION + MAGNIFICATION // 2
    assert pixels.shape == ((2 * AROUND_PX + 1) * MAGNIFICATION,) * 2 + (3,)
    assert tuple(pixels[middle + 20, middle + 20]) == VERMILION


def claim_of(run: Path, capsys) -> tuple[int, str]:
    status = main(["explain", str(run), "--frame", "1", "--object", "beside"])
    return status, capsys.readouterr().out


def test_a_claim_against_a_drawn_triangle_does_not_hold(run, capsys):
    rewrite(run, lambda w: [t.update(drawn=True) for t in w["triangles"]])
    status, printed = claim_of(run, capsys)
    assert status == 1
    assert "DOES NOT HOLD" in printed


def test_a_claim_whose_object_lies_behind_another_does_not_hold(run, capsys):
    def hide(witness):
        wall = dict(witness["triangles"][0], object=0, object_name="front", drawn=False)
        corners = ((-90.0, -90.0, 5.0), (90.0, -90.0, 5.0), (0.0, 180.0, 5.0))
        wall["vertices"] = [[v.hex() for v in corner] for corner in corners]
        witness["triangles"].append(wall)

    rewrite(run, hide)
    assert claim_of(run, capsys)[0] == 1


def test_a_claim_for_another_pixel_does_not_hold(run, capsys):
    rewrite(run, lambda w: w.update(x=0, y=0))
    assert claim_of(run, capsys)[0] == 1


@pytest.mark.parametrize(
    ("more", "expected"),
    [
        (["--frame", "0", "--object", "beside"], "no witness"),
        (["--frame", "1", "--object", "nothing"], "no witness"),
        (["--frame", "1", "--object", "beside", "--culler", "other"], "no witness"),
    ],
)
def test_what_was_not_missed_cannot_be_explained(run, more, expected, capsys):
    assert main(["explain", str(run), *more]) == 2
    assert expected in capsys.readouterr().err


def test_damaged_witness_is_a_clear_error(run, capsys):
    rewrite(run, lambda w: w["triangles"][0].pop("vertices"))
    assert main(["explain", str(run), "--frame", "1", "--object", "beside"]) == 2
    assert "damaged" in capsys.readouterr().err


def test_folder_that_is_no_run_is_refused(tmp_path, capsys):
    assert main(["explain", str(tmp_path), "--frame", "0", "--object", "0"]) == 2
    assert "no run folder" in capsys.readouterr().err
