"""The image protocol: what it finds, what it excuses, and that it can fail."""

from __future__ import annotations

import numpy as np
import pytest

from visref.effects.images import NO_BOUNDS, Bounds, ImageVerdict, disputed, judge


def images(*rows):
    return tuple(np.array([row], np.int32) for row in rows)


def bounds(samples, least, most):
    return Bounds(np.array(samples, np.int64), np.array(least, np.int32), np.array(most, np.int32))


def test_three_equal_images_have_no_violation():
    image, reference, truth = images([0, 1, 2], [0, 1, 2], [0, 1, 2])
    verdict = judge(image, reference, truth, NO_BOUNDS)
    assert verdict == ImageVerdict(judged=3, shown=2, held=2)
    assert verdict.status == "no_violation_found"


def test_sample_below_its_bounds_is_lost_and_above_them_extra():
    image, reference, truth = images([0, 3, 1], [1, 1, 1], [1, 1, 1])
    verdict = judge(image, reference, truth, bounds([0, 1], [1, 1], [1, 2]))
    assert (verdict.lost, verdict.extra, verdict.differing) == (1, 1, 2)
    assert verdict.worst == (0, 0)
    assert verdict.status == "violation"


def test_sample_within_its_bounds_is_counted_and_excused():
    image, reference, truth = images([1, 1], [1, 0], [0, 1])
    verdict = judge(image, reference, truth, bounds([0, 1], [0, 0], [1, 1]))
    assert (verdict.shown, verdict.held) == (1, 1)
    assert (verdict.within_tolerance, verdict.differing_within_tolerance) == (1, 1)
    assert verdict.status == "no_violation_found"


def test_image_that_is_right_where_the_reference_is_wrong_still_differs():
    image, reference, truth = images([1], [0], [1])
    verdict = judge(image, reference, truth, bounds([0], [1], [1]))
    assert (verdict.lost, verdict.differing) == (0, 1)
    assert verdict.status == "violation"


def test_blank_image_of_a_shown_effect_passes_nothing_whatever_the_tolerance():
    image, reference, truth = images([0, 0], [0, 0], [1, 0])
    verdict = judge(image, reference, truth, bounds([0], [0], [1]))
    assert (verdict.lost, verdict.within_tolerance) == (0, 1)
    assert verdict.status == "inconclusive"


def test_effect_that_never_shows_proves_nothing():
    image, reference, truth = images([0, 0], [0, 0], [0, 0])
    assert judge(image, reference, truth, NO_BOUNDS).status == "inconclusive"


def test_samples_outside_the_domain_are_not_judged():
    image, reference, truth = images([0, 1], [1, 1], [1, 1])
    domain = np.array([[False, True]])
    assert not len(disputed(image, reference, truth, domain))
    verdict = judge(image, reference, truth, NO_BOUNDS, domain)
    assert (verdict.judged, verdict.shown, verdict.status) == (1, 1, "no_violation_found")


def test_bounds_of_other_samples_are_refused():
    image, reference, truth = images([0, 1], [1, 1], [1, 1])
    with pytest.raises(ValueError, match="disputed"):
        judge(image, reference, truth, bounds([1], [0], [1]))


def test_verdicts_of_frames_add_up_and_keep_the_first_worst_sample():
    bad = ImageVerdict(judged=4, shown=2, lost=1, worst=(3, 1))
    both = (
        ImageVerdict(judged=1, shown=1, held=1).plus(bad).plus(ImageVerdict(lost=1, worst=(0, 0)))
    )
    assert (both.judged, both.lost, both.worst, both.status) == (5, 2, (3, 1), "violation")
    assert both.to_json()["status"] == "violation"
