"""A cutoff at the ends of its range, and one that is an alpha of the texture, in every engine."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from tests.fuzz_verdicts.case import REPEAT, Mask
from tests.fuzz_verdicts.files import write
from tests.judging.test_one_verdict import leaves_before_twins
from visref.engines import make_engine
from visref.errors import InputError
from visref.formats.loading import load_path, load_scene

# Texture bytes, factor, cutoff, and whether the leaf is there: alpha >= cutoff, in float64, where
# a byte is byte / 255.
CUTOFFS = {
    "0, alpha 0": ((0, 255), 1.0, 0.0, True),
    "0, alpha 0 all over": ((0, 0), 1.0, 0.0, True),
    "0, factor 0": ((0, 255), 0.0, 0.0, True),
    "1, alpha 1": ((255, 255), 1.0, 1.0, True),
    "1, alpha below": ((254, 253), 1.0, 1.0, False),
    "above 1": ((255, 0), 1.0, 1.5, False),
    "an alpha of the texture": ((128, 129), 1.0, 128 / 255, True),
    "just above the alphas": ((127, 128), 1.0, 128.0000001 / 255, False),
    "1/2, byte 128": ((128, 200), 1.0, 0.5, True),
    "1/2, byte 127": ((127, 100), 1.0, 0.5, False),
    "factor 0": ((255, 0), 0.0, 0.5, False),
}


def seen(spec: str, mask: Mask, folder: Path) -> tuple[int, int]:
    """How many samples the larger leaf owns, or may own: of all that it covers."""
    if spec == "open3d":
        pytest.importorskip("open3d")
    case = leaves_before_twins(2)
    for index, (name, _, parts) in enumerate(case.objects):
        if name == "leaf1":
            parts[0].mask = mask
            leaf = index
    scene_file, path_file, _ = write(case, folder)
    scene = load_scene(scene_file)
    truth = make_engine(spec, scene).frame(load_path(path_file).cameras[0])
    owner = truth.buffer.triangle[truth.buffer.triangle >= 0]
    open_ = scene.object_of_triangle[truth.doubt.triangle]
    return int((scene.object_of_triangle[owner] == leaf).sum()), int((open_ == leaf).sum())


@pytest.mark.parametrize("spec", ["exact", "embree", "open3d", "gl"])
@pytest.mark.parametrize("name", CUTOFFS)
def test_every_engine_decides_it_alike(name: str, spec: str, tmp_path: Path) -> None:
    texels, factor, cutoff, there = CUTOFFS[name]
    mask = Mask((texels, texels[::-1]), False, (REPEAT, REPEAT), factor, cutoff)
    owned, open_ = seen(spec, mask, tmp_path)
    assert open_ == 0
    assert (owned > 0) == there


@pytest.mark.parametrize("texels", [(0, 255), (255, 255)])
def test_a_negative_cutoff_is_refused(texels: tuple[int, int], tmp_path: Path) -> None:
    mask = Mask((texels, texels), False, (REPEAT, REPEAT), 1.0, 0.5)
    with pytest.raises(InputError, match="cutoff"):
        seen("embree", replace(mask, cutoff=-0.5), tmp_path)
