"""Every line of "what a verdict means", on truths and drawn sets made by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.hand_made import judged, soup, triangle_units, truth
from visref.culler import Promise
from visref.exact import Owners
from visref.judging.disputes import Rulings, find_disputes
from visref.judging.judge import Counts, MissKind
from visref.scene import Alpha, Scene, Units
from visref.visibility import BlendVisibility, FrameTruth

CONSERVATIVE = Promise.CONSERVATIVE


def verdict(scene, frame, drawn, promise=CONSERVATIVE, rulings=None, units=None):
    units = units or scene.object_units()
    return judged(scene, frame, units, drawn, promise, rulings)


def test_drawing_everything_is_safe_and_superfluous():
    scene = soup([1, 1, 1])
    found = verdict(scene, truth([[0, 0, 1, -1]]), [0, 1, 2])
    assert found.counts == Counts(visible=2, drawn=3, superfluous=1)
    assert found.superfluous_units.tolist() == [2]


def test_drawing_nothing_misses_every_visible_object_and_every_owned_sample():
    scene = soup([1, 1, 1])
    found = verdict(scene, truth([[0, 0, 1, -1]]), [])
    assert found.counts == Counts(visible=2, missed=2, confirmed=2, violations=2, missed_pixels=3)
    assert [(m.object, m.pixels, m.owned) for m in found.misses] == [(0, 2, 2), (1, 1, 1)]


def test_the_witness_is_a_sample_that_the_object_owns():
    scene = soup([1, 1])
    found = verdict(scene, truth([[-1, 0, 1, 1]]), [0])
    (miss,) = found.misses
    assert (miss.object, miss.sample, miss.triangle, miss.depth) == (1, 2, 1, 5.0)


@pytest.mark.parametrize(
    ("promise", "violations"),
    [
        (Promise.EXACT, 1),
        (Promise.CONSERVATIVE, 1),
        (Promise.AGGRESSIVE, 0),
        (Promise.APPROXIMATE, 0),
    ],
)
def test_only_a_promise_of_conservativeness_convicts(promise, violations):
    found = verdict(soup([1, 1]), truth([[0, 1]]), [0], promise)
    assert found.counts.confirmed == 1
    assert found.counts.violations == violations


def test_object_with_one_triangle_shown_is_not_missed_but_loses_pixels():
    scene = soup([2])
    found = verdict(scene, truth([[0, 1, 1, -1]]), [0], units=triangle_units(scene))
    assert found.counts == Counts(visible=1, missed_pixels=2, drawn=1)


def test_object_drawn_only_where_it_owns_nothing_is_missed():
    scene = soup([2])
    found = verdict(scene, truth([[0, 0]]), [1], units=triangle_units(scene))
    assert found.counts == Counts(
        visible=1, missed=1, confirmed=1, violations=1, missed_pixels=2, drawn=1, superfluous=1
    )


def test_tied_object_left_out_beside_a_drawn_co_owner_is_a_tie_and_misses_no_pixel():
    scene = soup([1, 1])
    found = verdict(scene, truth([[0, 0]], ties=[(0, 1), (1, 1)]), [0])
    assert found.counts == Counts(visible=2, missed=1, ties=1, drawn=1)
    assert found.misses[0].kind is MissKind.TIE
    assert (found.misses[0].object, found.misses[0].pixels) == (1, 0)


def test_tie_holds_whichever_of_the_tied_the_engine_named_as_owner():
    scene = soup([1, 1])
    found = verdict(scene, truth([[0, 0]], ties=[(0, 1), (1, 1)]), [1])
    assert found.counts == Counts(visible=2, missed=1, ties=1, drawn=1)
    assert found.misses[0].object == 0


def test_if_none_of_the_tied_is_drawn_each_is_missed_in_full():
    scene = soup([1, 1])
    found = verdict(scene, truth([[0, 0]], ties=[(0, 1), (1, 1)]), [])
    assert found.counts == Counts(visible=2, missed=2, confirmed=2, violations=2, missed_pixels=2)
    assert [m.pixels for m in found.misses] == [2, 2]


def test_object_tied_at_one_sample_and_lost_alone_at_another_is_confirmed():
    scene = soup([1, 1])
    found = verdict(scene, truth([[0, 1]], ties=[(0, 1)]), [0])
    assert (found.counts.confirmed, found.counts.ties, found.counts.missed_pixels) == (1, 0, 1)
    assert found.misses[0].sample == 1


def test_tie_between_triangles_of_one_object_is_shown_by_either():
    scene = soup([2])
    units = triangle_units(scene)
    found = verdict(scene, truth([[0]], ties=[(0, 1)]), [1], units=units)
    assert found.counts == Counts(visible=1, drawn=1)


def test_missed_is_the_sum_of_its_parts_with_a_raster_ruling():
    scene = soup([1, 1, 1, 1])
    frame = truth([[0, 1, 2, 2]], ties=[(2, 3), (3, 3)])
    found = verdict(scene, frame, [3], rulings=Rulings(within_raster=frozenset({1})))
    counts = found.counts
    assert (counts.confirmed, counts.ties, counts.within_raster_tolerance) == (1, 1, 1)
    assert counts.missed == 3
    assert counts.violations == 1


def test_undecided_sample_neither_clears_nor_convicts():
    scene = soup([1, 1])
    found = verdict(scene, truth([[0, 1]], undecided=[1]), [0])
    assert found.counts == Counts(visible=1, undecided=1, drawn=1)
    assert found.undecided_objects.tolist() == [1]
    # Drawing it is not superfluous either: nobody knows.
    assert verdict(scene, truth([[0, 1]], undecided=[1]), [0, 1]).counts.superfluous == 0


def test_object_missed_elsewhere_is_not_excused_by_an_undecided_sample():
    found = verdict(soup([1, 1]), truth([[0, 1, 1]], undecided=[1]), [0])
    assert (found.counts.violations, found.counts.undecided) == (1, 0)


def test_empty_object_is_never_visible_and_drawing_it_is_superfluous():
    scene = soup([1, 0])
    assert verdict(scene, truth([[0]]), [0, 1]).counts == Counts(visible=1, drawn=2, superfluous=1)
    assert verdict(scene, truth([[0]]), [0]).counts == Counts(visible=1, drawn=1)


def test_background_is_nobodys():
    assert verdict(soup([1]), truth([[-1, -1]]), []).counts == Counts()


def test_overlapping_units_show_a_triangle_through_any_of_them():
    scene = soup([2])
    units = Units(np.array([0, 2, 3]), np.array([0, 1, 1], np.int32), "cell")
    assert verdict(scene, truth([[1]]), [1], units=units).counts == Counts(visible=1, drawn=1)


def test_exact_ruling_clears_a_miss_that_the_engine_invented():
    scene = soup([1, 1])
    frame = truth([[0, 1]])
    owners = Owners(np.array([0, 1]), np.array([0], np.int32), np.array([4.0]), 0)
    found = verdict(scene, frame, [0], rulings=Rulings(np.array([1]), owners, corrections=1))
    assert found.counts == Counts(visible=1, drawn=1)


def test_exact_ruling_of_a_tie_turns_a_miss_into_a_tie():
    scene = soup([1, 1])
    frame = truth([[1]])
    owners = Owners(np.array([0, 2]), np.array([0, 1], np.int32), np.array([4.0]), 0)
    found = verdict(scene, frame, [0], rulings=Rulings(np.array([0]), owners))
    assert found.counts == Counts(visible=2, missed=1, ties=1, drawn=1)


def test_exact_ruling_of_background_takes_the_sample_from_everybody():
    owners = Owners(np.array([0, 0]), np.zeros(0, np.int32), np.array([np.inf]), 0)
    found = verdict(soup([1]), truth([[0]]), [], rulings=Rulings(np.array([0]), owners))
    assert found.counts == Counts()


def blended_scene() -> Scene:
    scene = soup([1, 1])
    return Scene(
        scene.vertices,
        scene.triangles,
        scene.object_offsets,
        scene.names,
        alpha=np.array([Alpha.OPAQUE, Alpha.BLEND], np.uint8),
    )


def blended_truth(object_id: int = 1) -> FrameTruth:
    base = truth([[0, 0]])
    blend = BlendVisibility(
        np.array([object_id], np.int32),
        np.array([2], np.int64),
        np.array([1], np.int64),
        np.array([1], np.int32),
        np.array([3.0]),
    )
    return FrameTruth(base.camera, "hand", base.buffer, ties_complete=True, blend=blend)


def test_blended_object_before_the_opaque_hit_is_visible_and_can_be_missed():
    scene = blended_scene()
    assert verdict(scene, blended_truth(), [0, 1]).counts == Counts(visible=2, drawn=2)
    found = verdict(scene, blended_truth(), [0])
    # It owns no sample of the visibility buffer, so no sample of the buffer is missed.
    assert found.counts == Counts(visible=2, missed=1, confirmed=1, violations=1, drawn=1)
    assert (found.misses[0].sample, found.misses[0].depth) == (1, 3.0)


def test_raster_tolerance_of_an_opaque_part_does_not_excuse_a_missed_blended_part():
    scene = soup([2])
    scene = Scene(
        scene.vertices,
        scene.triangles,
        scene.object_offsets,
        scene.names,
        alpha=np.array([Alpha.OPAQUE, Alpha.BLEND], np.uint8),
    )
    rulings = Rulings(within_raster=frozenset({0}), best_sample={0: 0})
    found = verdict(scene, blended_truth(0), [], rulings=rulings)
    assert [(miss.kind, miss.sample, miss.triangle) for miss in found.misses] == [
        (MissKind.CONFIRMED, 1, 1)
    ]


def test_disputes_are_the_samples_that_no_drawn_triangle_shows():
    scene = soup([1, 1, 1])
    frame = truth([[0, 1, 2, -1]], ties=[(1, 0)], undecided=[2])
    drawn = np.array([True, False, False])
    assert find_disputes(frame, scene, drawn).samples.tolist() == []
    drawn = np.array([False, False, True])
    assert find_disputes(frame, scene, drawn).samples.tolist() == [0, 1]


def brute_force(scene, frame, units, drawn_units):
    """The words of the contract, sample by sample, in plain Python."""
    drawn = {
        int(t)
        for u in drawn_units
        for t in units.triangles[units.offsets[u] : units.offsets[u + 1]]
    }
    owner_of = scene.object_of_triangle
    owners = {}
    for sample, first in enumerate(frame.buffer.triangle.reshape(-1).tolist()):
        if first >= 0 and sample not in set(frame.undecided.tolist()):
            tied = frame.ties.triangle[frame.ties.sample == sample].tolist()
            owners[sample] = [first, *tied]
    visible = {int(owner_of[t]) for ts in owners.values() for t in ts}
    shown = {int(owner_of[t]) for ts in owners.values() for t in ts if t in drawn}
    lost = [s for s, ts in owners.items() if not drawn & set(ts)]
    in_full = {int(owner_of[t]) for s in lost for t in owners[s]}
    missed = visible - shown
    return Counts(
        visible=len(visible),
        missed=len(missed),
        confirmed=len(missed & in_full),
        ties=len(missed - in_full),
        violations=len(missed & in_full),
        missed_pixels=len(lost),
        drawn=len(drawn_units),
        superfluous=sum(
            not {t for ts in owners.values() for t in ts}
            & set(units.triangles[units.offsets[u] : units.offsets[u + 1]].tolist())
            for u in drawn_units
        ),
    )


@pytest.mark.slow
@settings(deadline=None)  # the first call compiles
@given(data=st.data())
def test_judge_equals_the_contract_read_aloud(data):
    sizes = data.draw(st.lists(st.integers(0, 3), min_size=1, max_size=4))
    scene = soup(sizes)
    count = scene.triangle_count
    triangle = st.integers(-1, count - 1)
    owners = data.draw(st.lists(triangle, min_size=1, max_size=8))
    hit = [s for s, t in enumerate(owners) if t >= 0]
    ties = set()
    if hit:
        pairs = st.tuples(st.sampled_from(hit), st.integers(0, count - 1))
        ties = {(s, t) for s, t in data.draw(st.sets(pairs, max_size=6)) if t != owners[s]}
    frame = truth([owners], ties=list(ties))
    cells = data.draw(st.lists(st.lists(st.integers(0, count - 1)), max_size=4)) if count else []
    units = Units(
        np.cumsum([0, *map(len, cells)]),
        np.array([t for cell in cells for t in cell], np.int32),
        "cell",
    )
    drawn = data.draw(st.permutations(range(len(cells)))) if cells else []
    drawn = drawn[: data.draw(st.integers(0, len(drawn)))]
    found = verdict(scene, frame, drawn, units=units)
    assert found.counts == brute_force(scene, frame, units, drawn)
    counts = found.counts
    assert counts.missed == counts.confirmed + counts.ties + counts.within_raster_tolerance


def masked_scene() -> Scene:
    """A leaf of alpha-masked triangles before a wall."""
    scene = soup([1, 1])
    return Scene(
        scene.vertices,
        scene.triangles,
        scene.object_offsets,
        scene.names,
        alpha=np.array([Alpha.OPAQUE, Alpha.MASK], np.uint8),
    )


def test_undrawn_masked_object_is_undecided_not_silently_forgotten():
    frame = replace(truth([[0, 0]], undecided=[0]), masked=np.array([1], np.int32))
    found = verdict(masked_scene(), frame, [0])
    assert found.counts == Counts(visible=1, undecided=1, drawn=1)
    assert found.undecided_objects.tolist() == [1]
    assert verdict(masked_scene(), frame, [0, 1]).counts == Counts(visible=1, drawn=2)
