"""Mistakes about some objects only, and boxes that lie beside their objects: where a hypothesis is
held to apply, and which cullers are said to err so."""

from __future__ import annotations

import numpy as np
import pytest

from tests.causes.test_inner import ThatBox, row
from tests.causes.test_plain_cullers import CentreOnly, DropsAtRandom, Right, first_named, judged
from visref.causes.partly import PARTS, Applied, kinds_of
from visref.conformance.building import box, camera, case


def test_kinds_are_told_by_names_up_to_a_digit():
    scene = case(
        [(name, box((i, 0, -6), (i + 1, 1, -5))) for i, name in enumerate(("a 1", "b", "a 22-x"))],
        [camera()],
    ).scene
    assert kinds_of(scene).tolist() == [0, 1, 0]


def applied(kinds, right, wrong):
    """By part and unit, from lists of (part, unit); a frame per part."""
    every = [(part, unit, True) for part, unit in right]
    every += [(part, unit, False) for part, unit in wrong]
    # Each part is looked at, though nothing is said there.
    parts, units, flags = (np.array(one) for one in zip(*every, strict=True))
    looked = np.concatenate([parts, np.arange(PARTS)]), np.concatenate([units, [0] * PARTS])
    none = np.zeros(PARTS, np.bool_)
    made = Applied(*looked, np.array(kinds))
    where = made.found(np.concatenate([flags, none]), np.concatenate([~flags, none]))
    if where is None:
        return None
    known = np.unique(looked[1])
    result = where.kinds[:, np.array(kinds)]
    result[:, known] = where.units
    return result


def test_applies_where_it_was_right_in_other_parts():
    found = applied([0, 1], [(0, 0), (1, 0)], [(0, 1), (1, 1)])
    # Of part 0 part 1 tells, and the other way round; unit 0 alone was lost.
    assert found[:, 0].all()
    assert not found[:, 1].any()


def test_what_was_right_in_one_part_alone_is_no_reason_there():
    found = applied([0, 1], [(2, 0)], [(0, 1), (3, 1)])
    assert not found[2, 0]
    assert found[[0, 1, 3, 4, 5, PARTS], 0].all()


def test_kind_tells_of_a_unit_that_nothing_was_known_of():
    # Units 0, 1 and 2 are of a kind; 2 was not asked about yet.
    found = applied([0, 0, 0, 1], [(0, 0), (1, 0), (0, 1), (1, 1)], [(0, 3), (1, 3)])
    assert found[:, 2].all()
    assert not found[:, 3].any()


def test_what_is_right_everywhere_is_not_restricted():
    assert applied([0, 1], [(0, 0), (1, 0), (0, 1), (1, 1)], []) is None


# Cullers.


class CentreOfSome(CentreOnly):
    """Every third is tested by its centre, the others by their boxes."""

    def keeps(self, view, corners, pixels, depth):
        # Of the rows in `row`, two of six.
        third = round(corners[:, 1].min() + 3.0) % 3 == 0
        return (super() if third else super(CentreOnly, self)).keeps(view, corners, pixels, depth)


def test_mistake_about_some_objects_is_named():
    told = first_named(judged(CentreOfSome(), row()))
    assert told.total() >= 5
    assert told["centre-only"] >= 0.8 * told.total(), told


class BesideAlike(ThatBox):
    """All boxes lie beside their objects by the same way."""

    def part(self, low, high):
        return np.add(low, (2.5, 0.0, 0.0)), np.add(high, (2.5, 0.0, 0.0))


def test_boxes_displaced_alike_are_named():
    told = first_named(judged(BesideAlike(), row()))
    assert told.total() >= 10
    assert told["origin-forgotten"] >= 0.8 * told.total(), told


@pytest.mark.parametrize("seed", range(3))
def test_what_is_dropped_at_random_is_of_no_way(seed):
    told = first_named(judged(DropsAtRandom(seed), row()))
    assert not told["origin-forgotten"], told


def test_right_culler_has_no_cause():
    assert not first_named(judged(Right(), row())).total()
