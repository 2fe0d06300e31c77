"""Every line of "what a verdict means", on truths and drawn sets made by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.support.hand_made import judged, settled, soup, triangle_units, truth
from visref.culler import Promise
from visref.judging.disputes import Measured, Rulings, find_disputes
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
    assert found.counts == Counts(visible=2, owned_samples=3, drawn=3, superfluous=1)
    assert found.superfluous_units.tolist() == [2]


def test_drawing_nothing_misses_every_visible_object_and_every_owned_sample():
    scene = soup([1, 1, 1])
    found = verdict(scene, truth([[0, 0, 1, -1]]), [])
    assert found.counts == Counts(
        visible=2,
        missed=2,
        confirmed=2,
        violations=2,
        missed_pixels=3,
        owned_samples=3,
        missed_units=2,
    )
    assert [(m.object, m.samples, m.owned) for m in found.misses] == [(0, 2, 2), (1, 1, 1)]


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


def test_object_that_shows_somewhere_and_loses_samples_elsewhere_is_partly_missed_and_convicts():
    scene = soup([2])
    found = verdict(scene, truth([[0, 1, 1, -1]]), [0], units=triangle_units(scene))
    assert found.counts == Counts(
        visible=1,
        partly_missed=1,
        confirmed=1,
        violations=1,
        missed_pixels=2,
        owned_samples=3,
        drawn=1,
        missed_units=1,
    )
    (miss,) = found.misses
    assert (miss.partly, miss.samples, miss.owned, miss.sample) == (True, 2, 3, 1)


def test_object_drawn_only_where_it_owns_nothing_is_missed():
    scene = soup([2])
    found = verdict(scene, truth([[0, 0]]), [1], units=triangle_units(scene))
    assert found.counts == Counts(
        visible=1,
        missed=1,
        confirmed=1,
        violations=1,
        missed_pixels=2,
        owned_samples=2,
        drawn=1,
        superfluous=1,
        missed_units=1,
    )


def test_tied_object_left_out_beside_a_drawn_co_owner_is_a_tie_and_misses_no_pixel():
    scene = soup([1, 1])
    found = verdict(scene, truth([[0, 0]], ties=[(0, 1), (1, 1)]), [0])
    assert found.counts == Counts(visible=2, missed=1, ties=1, owned_samples=2, drawn=1)
    assert found.misses[0].kind is MissKind.TIE
    assert (found.misses[0].object, found.misses[0].samples) == (1, 0)


def test_tie_holds_whichever_of_the_tied_the_engine_named_as_owner():
    scene = soup([1, 1])
    found = verdict(scene, truth([[0, 0]], ties=[(0, 1), (1, 1)]), [1])
    assert found.counts == Counts(visible=2, missed=1, ties=1, owned_samples=2, drawn=1)
    assert found.misses[0].object == 0


def test_if_none_of_the_tied_is_drawn_each_is_missed_in_full():
    scene = soup([1, 1])
    found = verdict(scene, truth([[0, 0]], ties=[(0, 1), (1, 1)]), [])
    assert found.counts == Counts(
        visible=2,
        missed=2,
        confirmed=2,
        violations=2,
        missed_pixels=2,
        owned_samples=2,
        missed_units=2,
    )
    assert [m.samples for m in found.misses] == [2, 2]


def test_object_tied_at_one_sample_and_lost_alone_at_another_is_confirmed():
    scene = soup([1, 1])
    found = verdict(scene, truth([[0, 1]], ties=[(0, 1)]), [0])
    assert (found.counts.confirmed, found.counts.ties, found.counts.missed_pixels) == (1, 0, 1)
    assert found.misses[0].sample == 1


def test_tie_between_triangles_of_one_object_is_shown_by_either():
    scene = soup([2])
    units = triangle_units(scene)
    found = verdict(scene, truth([[0]], ties=[(0, 1)]), [1], units=units)
    assert found.counts == Counts(visible=1, owned_samples=1, drawn=1)


def test_missed_is_the_sum_of_its_parts_with_a_raster_ruling():
    scene = soup([1, 1, 1, 1])
    frame = truth([[0, 1, 2, 2]], ties=[(2, 3), (3, 3)])
    found = verdict(scene, frame, [3], rulings=Rulings(within_raster=frozenset({1})))
    counts = found.counts
    assert (counts.confirmed, counts.ties, counts.within_raster_tolerance) == (1, 1, 1)
    assert counts.missed == 3
    assert counts.violations == 1


def test_sample_in_doubt_of_which_only_a_part_was_drawn_neither_clears_nor_convicts():
    # A leaf (2) may be seen at sample 1 before the wall (1).
    scene, frame = soup([1, 1, 1]), truth([[0, 1]], doubt=[(1, 2)])
    found = verdict(scene, frame, [0, 2])
    assert found.counts == Counts(
        visible=1, undecided=1, owned_samples=2, undecided_samples=1, drawn=2
    )
    assert found.undecided_objects.tolist() == [1]
    # Drawing what may be seen is not superfluous either.
    assert verdict(scene, frame, [0, 1, 2]).counts == Counts(visible=1, owned_samples=2, drawn=3)


def test_sample_in_doubt_is_lost_for_certain_where_nothing_down_to_a_certain_hit_was_drawn():
    scene, frame = soup([1, 1, 1]), truth([[0, 1]], doubt=[(1, 2)])
    found = verdict(scene, frame, [0])
    assert found.counts == Counts(
        visible=2,
        missed=1,
        confirmed=1,
        violations=1,
        missed_pixels=1,
        owned_samples=2,
        drawn=1,
        missed_units=1,
    )
    assert [(m.object, m.samples, m.owned, m.sample) for m in found.misses] == [(1, 1, 1, 1)]


def test_leaf_before_the_background_leaves_the_sample_undecided_where_it_was_not_drawn():
    found = verdict(soup([1, 1]), truth([[0, -1]], doubt=[(1, 1)]), [0])
    assert (found.counts.violations, found.counts.undecided_samples) == (0, 1)
    assert found.undecided_objects.tolist() == [1]


def test_object_missed_elsewhere_is_not_excused_by_a_sample_in_doubt():
    found = verdict(soup([1, 1, 1]), truth([[0, 1, 1]], doubt=[(1, 2)]), [0, 2])
    assert (found.counts.violations, found.counts.undecided) == (1, 0)


def test_unit_without_triangles_is_never_superfluous():
    scene = soup([1, 0])
    for drawn in ([0, 1], [0]):
        counts = verdict(scene, truth([[0]]), drawn).counts
        assert counts == Counts(visible=1, owned_samples=1, drawn=len(drawn))


def test_background_is_nobodys():
    assert verdict(soup([1]), truth([[-1, -1]]), []).counts == Counts()


def test_overlapping_units_show_a_triangle_through_any_of_them():
    scene = soup([2])
    units = Units(np.array([0, 2, 3]), np.array([0, 1, 1], np.int32), "cell")
    found = verdict(scene, truth([[1]]), [1], units=units)
    assert found.counts == Counts(visible=1, owned_samples=1, drawn=1)


def test_exact_ruling_clears_a_miss_that_the_engine_invented():
    scene, frame = soup([1, 1]), truth([[0, 1]])
    rulings = Rulings(np.array([1]), truth([[-1, 0]], depth=4.0), corrections=1)
    found = verdict(scene, frame, [0], rulings=rulings)
    assert found.counts == Counts(visible=1, owned_samples=2, drawn=1)


def test_exact_ruling_of_a_tie_turns_a_miss_into_a_tie():
    rulings = Rulings(np.array([0]), truth([[0]], ties=[(0, 1)]))
    found = verdict(soup([1, 1]), truth([[1]]), [0], rulings=rulings)
    assert found.counts == Counts(visible=2, missed=1, ties=1, owned_samples=1, drawn=1)


def test_exact_ruling_of_background_takes_the_sample_from_everybody():
    found = verdict(soup([1]), truth([[0]]), [], rulings=Rulings(np.array([0]), truth([[-1]])))
    assert found.counts == Counts()


def test_exact_ruling_of_doubt_takes_the_sample_from_the_decided():
    rulings = Rulings(np.array([0]), truth([[1]], doubt=[(0, 2)]))
    found = verdict(soup([1, 1, 1]), truth([[0, 0]]), [2], rulings=rulings)
    assert (found.counts.undecided_samples, found.counts.missed_pixels) == (1, 1)


def test_rulings_hold_at_their_samples_alone():
    elsewhere = truth([[0, 1, 2]], ties=[(0, 2)], doubt=[(2, 1)])
    found = verdict(
        soup([1, 1, 1]), truth([[0, 0, 0]]), [0], rulings=Rulings(np.array([1]), elsewhere)
    )
    assert [(m.object, m.samples) for m in found.misses] == [(1, 1)]


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
        np.array([1], np.int64),
        np.array([1], np.int32),
        np.array([3.0]),
    )
    return FrameTruth(base.camera, "hand", base.buffer, ties_complete=True, blend=blend)


def test_blended_object_before_the_opaque_hit_is_visible_and_can_be_missed():
    scene = blended_scene()
    counts = verdict(scene, blended_truth(), [0, 1]).counts
    assert counts == Counts(visible=2, owned_samples=2, drawn=2)
    found = verdict(scene, blended_truth(), [0])
    # It owns no sample of the visibility buffer, so no sample of the buffer is missed.
    assert found.counts == Counts(
        visible=2, missed=1, confirmed=1, violations=1, owned_samples=2, drawn=1, missed_units=1
    )
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
    measured = Measured(np.array([0]), np.array([0]), np.array([1.0]), np.array([1.0]))
    rulings = Rulings(within_raster=frozenset({0}), measured=measured)
    found = verdict(scene, blended_truth(0), [], rulings=rulings)
    assert [(miss.kind, miss.sample, miss.triangle) for miss in found.misses] == [
        (MissKind.CONFIRMED, 1, 1)
    ]


def test_glass_is_lost_sample_by_sample():
    """Two panes of one object, one sample each: half of it drawn is partly missed, and the
    exact glass at the sample counts, not any of the object's."""
    scene = replace(soup([1, 2]), alpha=np.array([0, 2, 2], np.uint8))
    base = truth([[0, 0]])
    blend = BlendVisibility.of(scene, np.array([0, 1]), np.array([1, 2]), np.array([3.0, 4.0]))
    frame = replace(base, blend=blend)
    found = verdict(scene, frame, [0, 1], units=triangle_units(scene))
    assert (found.counts.partly_missed, found.counts.confirmed, found.counts.missed) == (1, 1, 0)
    (miss,) = found.misses
    assert (miss.object, miss.samples, miss.owned, miss.sample, miss.triangle) == (1, 1, 2, 1, 2)
    assert (found.counts.missed_pixels, found.counts.missed_units) == (0, 1)


def test_glass_before_its_own_wall_is_lost_though_the_wall_is_drawn():
    scene = replace(soup([2]), alpha=np.array([0, 2], np.uint8))
    blend = BlendVisibility.of(scene, np.array([0]), np.array([1]), np.array([3.0]))
    frame = replace(truth([[0, 0]]), blend=blend)
    found = verdict(scene, frame, [0], units=triangle_units(scene))
    assert [(m.samples, m.owned, m.partly) for m in found.misses] == [(1, 2, True)]
    whole = verdict(scene, frame, [1], units=triangle_units(scene))
    assert [(m.samples, m.owned, m.partly) for m in whole.misses] == [(2, 2, True)]


def test_glass_before_what_a_mask_leaves_open_is_seen_whoever_stands_behind():
    """Object 0 is a pane and a wall; before the wall a leaf of object 1 may be solid or not."""
    scene = replace(soup([2, 1]), alpha=np.array([0, 2, 1], np.uint8))
    blend = BlendVisibility.of(scene, np.array([0]), np.array([1]), np.array([3.0]))
    frame = replace(truth([[0, 0]], doubt=[(0, 2), (1, 2)]), blend=blend)

    def told(*drawn):
        found = verdict(scene, frame, drawn, units=triangle_units(scene))
        return found.counts.visible, [
            (m.object, m.samples, m.owned, m.partly) for m in found.misses
        ]

    # The pane is seen for certain, the wall behind the leaf is not.
    assert told(0, 1, 2) == (1, [])
    assert told(0, 2) == told(2) == (1, [(0, 1, 1, False)])
    # With nothing drawn, wall or leaf is lost at both samples; the pane's sample counts once.
    assert told() == (1, [(0, 2, 2, False)])
    assert told(1) == (1, [(0, 2, 2, True)])


def test_disputes_are_the_samples_that_no_drawn_triangle_shows_and_those_left_open():
    scene = soup([1, 1, 1, 1])
    frame = truth([[0, 1, 2, -1]], ties=[(1, 0)], doubt=[(2, 3)])

    def disputed(*drawn):
        return find_disputes(settled(scene, frame, scene.object_units(), drawn).walk).tolist()

    assert disputed(0, 2, 3) == []
    assert disputed(0, 3) == [2]
    assert disputed(2) == [0, 1, 2]
    assert disputed(2, 3) == [0, 1]
    assert disputed() == [0, 1, 2]


def brute_force(scene, frame, units, drawn_units):
    """The words of the contract, sample by sample, in plain Python."""
    cells = [
        set(units.triangles[low:high].tolist())
        for low, high in zip(units.offsets[:-1], units.offsets[1:], strict=True)
    ]
    drawn = set().union(*(cells[u] for u in drawn_units))
    object_of = scene.object_of_triangle.tolist()
    owners, doubt = {}, {}
    for sample, triangle in zip(frame.doubt.at().tolist(), frame.doubt.triangle, strict=True):
        doubt.setdefault(sample, set()).add(int(triangle))
    for sample, first in enumerate(frame.buffer.triangle.reshape(-1).tolist()):
        tied = frame.ties.triangle[frame.ties.sample == sample].tolist()
        owners[sample] = {first, *tied} if first >= 0 else set()
    decided = {s for s, ts in owners.items() if ts and s not in doubt}
    lost, open_ = set(decided), 0
    lost = {s for s in decided if not owners[s] & drawn}
    charged = set()
    for sample, leaves in doubt.items():
        certain = owners[sample]
        if leaves <= drawn and (not certain or certain & drawn):
            continue
        if certain and not (leaves | certain) & drawn:
            charged.add(sample)
        else:
            open_ += 1
    lost |= charged
    seen = {}
    for sample in decided | charged:
        for t in owners[sample]:
            seen.setdefault(object_of[t], set()).add(sample)
    losses = {o: samples & lost for o, samples in seen.items()}
    shown = {object_of[t] for s in decided for t in owners[s] & drawn}
    partly = {o for o in seen if losses[o] and o in shown}
    missed = set(seen) - shown
    confirmed = {o for o in missed | partly if losses[o]}
    of_lost = set().union(*(owners[s] for s in lost))
    may_show = set().union(*owners.values(), *doubt.values())
    return Counts(
        visible=len(seen),
        missed=len(missed),
        partly_missed=len(partly),
        confirmed=len(confirmed),
        ties=len(missed - confirmed),
        violations=len(confirmed),
        missed_pixels=len(lost),
        owned_samples=len(decided | set(doubt)),
        undecided_samples=open_,
        drawn=len(drawn_units),
        superfluous=sum(bool(cells[u]) and not cells[u] & may_show for u in drawn_units),
        missed_units=sum(
            bool(cell & of_lost) and u not in drawn_units for u, cell in enumerate(cells)
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
    places = st.tuples(st.integers(0, len(owners) - 1), st.integers(0, max(count - 1, 0)))
    leaves = data.draw(st.sets(places, max_size=4)) if count else set()
    known = {(s, t) for s, t in enumerate(owners)} | ties
    frame = truth([owners], ties=list(ties), doubt=sorted(leaves - known))
    cells = data.draw(st.lists(st.lists(st.integers(0, count - 1)), max_size=4)) if count else []
    units = Units(
        np.cumsum([0, *map(len, cells)]),
        np.array([t for cell in cells for t in cell], np.int32),
        "cell",
    )
    drawn = data.draw(st.permutations(range(len(cells)))) if cells else []
    drawn = drawn[: data.draw(st.integers(0, len(drawn)))]
    counts = verdict(scene, frame, drawn, units=units).counts
    expected = brute_force(scene, frame, units, drawn)
    assert replace(counts, undecided=0) == expected
    kinds = counts.confirmed + counts.ties + counts.within_raster_tolerance
    assert counts.missed + counts.partly_missed == kinds
