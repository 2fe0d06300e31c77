"""What is lost of an object, in part or in whole, has margins, a firm witness, and no excuse that
the rasteriser's own picture refutes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.support.hand_made import square, triangle_units
from visref.camera import Camera, look_at
from visref.culler import Promise, Raster, RasterTolerance
from visref.engines import make_engine
from visref.exact import ExactScene
from visref.judging.holders import DrawList
from visref.judging.judge import FrameVerdict, Miss, MissKind, judge
from visref.judging.settle import settle
from visref.scene import Alpha, Scene, Units

WIDTH, HEIGHT = 32, 16
VIEW = Camera(look_at((0, 0, 10.0), (0, 0, 0)), WIDTH, HEIGHT, near=1.0, far=100.0, ymag=8.0)
WALL = square(-40.0, -40.0, -5.0, 80.0)
# Pixels.
SLIT = 1.0 / 64


class Picture(Raster):
    """A rasteriser of half a pixel's snap, whose unculled picture shows these triangles."""

    tolerance = RasterTolerance(0.5)

    def __init__(self, *shown: int) -> None:
        self.shown = shown

    def item_buffer(self, camera: Camera):
        picture = np.full((camera.height, camera.width), -1, np.int32)
        picture.reshape(-1)[: len(self.shown)] = self.shown
        return picture


def strips() -> Scene:
    """Object 0: a plank of two quads: one broad, one that reaches a 64th of a pixel over the
    samples of row 12. Object 1: the wall behind."""
    broad = np.array([[-8.0, -2, 0], [8, -2, 0], [8, 4, 0], [-8, 4, 0]])
    # Row 12's samples lie at y = -4.5; this one covers -4.5 - SLIT to -4.5 + SLIT.
    thin = np.array([[-8.0, -4.5 - SLIT, 0], [8, -4.5 - SLIT, 0]])
    thin = np.concatenate([thin, thin[::-1] + np.array([0.0, 2 * SLIT, 0.0])])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    return Scene.from_objects(
        [("plank", np.concatenate([broad, thin]), np.concatenate([faces, faces + 4])),
         ("wall", *WALL)]
    )  # fmt: skip


def two_units() -> Units:
    """Broad part, thin part, wall."""
    return Units(np.array([0, 2, 4, 6]), np.arange(6, dtype=np.int32), "part")


def verdict(
    scene: Scene, units: Units, drawn: list[int], raster: Raster | None, engine: str
) -> FrameVerdict:
    truth = make_engine(engine, scene).frame(VIEW)
    exact = ExactScene(scene)
    draws = DrawList.of_units(scene, units, np.array(drawn, np.int32))
    frame = settle(scene, truth, draws, exact=lambda: exact, raster=raster)
    return judge(frame, Promise.CONSERVATIVE)


def plank(found: FrameVerdict) -> Miss:
    (miss,) = (miss for miss in found.misses if miss.object == 0)
    return miss


ENGINES = ["exact", "embree"]


@pytest.mark.parametrize("engine", ENGINES)
def test_a_lost_strip_of_a_shown_object_has_margins_and_a_witness_in_the_strip(engine):
    miss = plank(verdict(strips(), two_units(), [0, 2], None, engine))
    assert (miss.partly, miss.kind, miss.samples) == (True, MissKind.CONFIRMED, 16)
    assert miss.sample // WIDTH == 12
    assert miss.triangle in (2, 3)
    assert miss.margin_px == pytest.approx(SLIT, rel=0.01)
    # The wall stands at 15, the plank at 10.
    assert miss.margin_depth == pytest.approx(0.5, rel=0.01)


@pytest.mark.parametrize("engine", ENGINES)
def test_the_witness_of_a_lost_broad_part_is_its_firmest_sample(engine):
    miss = plank(verdict(strips(), two_units(), [1, 2], None, engine))
    assert (miss.partly, miss.kind, miss.samples) == (True, MissKind.CONFIRMED, 16 * 6)
    # Six rows high: the two in the middle are two and a half pixels from an edge.
    assert miss.margin_px == pytest.approx(2.5, abs=1e-5)
    assert miss.sample // WIDTH in (6, 7)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_strip_thinner_than_the_snap_is_excused_if_the_picture_lacks_it(engine):
    found = verdict(strips(), two_units(), [0, 2], Picture(0, 1, 4, 5), engine)
    miss = plank(found)
    assert (miss.partly, miss.kind) == (True, MissKind.WITHIN_RASTER)
    counts = found.counts
    assert (counts.partly_missed, counts.within_raster_tolerance, counts.violations) == (1, 1, 0)
    assert counts.missed_pixels == 16


@pytest.mark.parametrize("engine", ENGINES)
def test_an_undrawn_unit_that_shows_in_the_item_buffer_is_not_excused(engine):
    found = verdict(strips(), two_units(), [0, 2], Picture(0, 1, 2, 4, 5), engine)
    assert plank(found).kind is MissKind.CONFIRMED
    assert found.counts.violations == 1


@pytest.mark.parametrize("engine", ENGINES)
def test_only_the_picture_of_undrawn_owners_of_lost_samples_counts(engine):
    # The drawn broad part shows in the picture; of a finer cut the other half of the strip's
    # quad owns lost samples as well, and shows.
    scene, units = strips(), triangle_units(strips())
    none = verdict(scene, units, [0, 1, 4, 5], Picture(0, 1, 4, 5), engine)
    assert plank(none).kind is MissKind.WITHIN_RASTER
    half = verdict(scene, units, [0, 1, 4, 5], Picture(0, 1, 3, 4, 5), engine)
    assert plank(half).kind is MissKind.CONFIRMED


@pytest.mark.parametrize("engine", ENGINES)
def test_a_strip_is_no_excuse_for_what_is_lost_broadly(engine):
    miss = plank(verdict(strips(), two_units(), [2], Picture(), engine))
    assert (miss.partly, miss.kind) == (False, MissKind.CONFIRMED)
    # The firm sample is the witness.
    assert 4 <= miss.sample // WIDTH <= 9


@pytest.mark.parametrize("engine", ENGINES)
def test_no_tolerance_excuses_lost_glass(engine):
    scene = strips()
    alpha = scene.alpha.copy()
    alpha[2:4] = Alpha.BLEND
    scene = replace(scene, alpha=alpha)
    found = verdict(scene, two_units(), [0, 2], Picture(), engine)
    miss = plank(found)
    assert (miss.partly, miss.kind, miss.samples) == (True, MissKind.CONFIRMED, 16)
    assert (found.counts.violations, found.counts.missed_pixels) == (1, 0)
    assert miss.triangle in (2, 3)
