"""Sections 4.3 and 4.4: the published numbers agree, and ours stand beside the right ones."""

from __future__ import annotations

import pytest

from visref.effects.images import ImageVerdict
from visref.papers import decoret2005_effects as paper
from visref.papers.contents import Grade
from visref.registry import available
from visref.tables.plan import EXPERIMENTS


def test_published_share_is_that_of_the_published_fragments():
    full, clamped = (one.amount for one in paper.FRAGMENTS)
    assert clamped / full == pytest.approx(paper.CLAMPED_SHARE.amount, abs=0.001)
    assert paper.TESTS_A_SPRITE.amount == 16 * 16


def test_experiments_are_registered():
    assert {one.name for one in paper.EXPERIMENTS} <= set(available(EXPERIMENTS))


class Results:
    def __init__(self, **results):
        self.results = {key.replace("_", "-"): result for key, result in results.items()}

    def experiment(self, key):
        return self.results.get(key)


GOOD = ImageVerdict(judged=1000, shown=10, held=9, within_tolerance=2).to_json()


def rows_of(results, table):
    return {row.quantity: row for row in paper.tables(results)[table].rows}


def test_particles_are_told_a_sprite():
    result = {
        "sprites_in_view": 100.0,
        "sprites_kept": 40.0,
        "depth_tests_plain": 25_000.0,
        "lookups": 100.0,
        "lookups_counted": 100.0,
        "depth_tests_left": 10_000.0,
        "verdict": GOOD,
    }
    rows = rows_of(Results(particles_city=result), 0)
    assert rows["city: depth tests a sprite, rasterised"].ours == 250.0
    assert rows["city: lookups a sprite"].ours == 1.0
    claim = paper.tables(Results(particles_city=result))[0].claims[1]
    assert (claim.ours.value, claim.interval, claim.grade) == (250.0, None, Grade.IN_DIRECTION)
    del result["lookups_counted"]
    uncounted = paper.tables(Results(particles_city=result))[0]
    assert uncounted.claims[1].grade is Grade.UNMEASURED
    assert {r.quantity: r.ours for r in uncounted.rows}["city: lookups a sprite"] is None
    assert rows["city: sprites culled"].ours == pytest.approx(0.6)
    assert rows["city: samples lost, extra or unlike the uncut effect's"].ours == 0.0
    assert rows["terrain_towers: lookups a sprite"].ours is None


def shadows(verdict=GOOD, **changed):
    result = {
        "fragments_full": 1000.0,
        "fragments_clamped": 150.0,
        "casters": 50,
        "casters_kept": 5.0,
        "verdict": verdict,
    }
    return Results(shadow_volumes_terrain_towers=result | changed)


@pytest.mark.parametrize(
    ("verdict", "grade"),
    [
        (GOOD, Grade.HOLDS),
        ({**GOOD, "status": "violation", "lost": 1}, Grade.FAILS),
        ({**GOOD, "status": "inconclusive"}, Grade.UNMEASURED),
    ],
)
def test_lost_shadow_shows_in_the_table(verdict, grade):
    results = shadows(verdict)
    assert rows_of(results, 1)["terrain_towers: share left"].ours == 0.15
    assert rows_of(results, 1)["city: share left"].ours is None
    (safe,) = paper.tables(results)[1].own
    assert safe.grade is grade


@pytest.mark.parametrize(
    ("clamped", "grade"), [(25, Grade.HOLDS), (26, Grade.IN_DIRECTION), (1001, Grade.FAILS)]
)
def test_what_clamping_leaves_is_graded_by_the_papers_share(clamped, grade):
    claims = paper.tables(shadows(fragments_clamped=clamped))[1].claims
    assert [claim.grade for claim in claims] == [grade, Grade.UNMEASURED]


def test_fragments_by_frame_give_an_interval():
    by_frame = {"fragments_clamped": [20.0, 30.0, 10.0, 40.0], "fragments_full": [1000.0] * 4}
    claim = paper.tables(shadows(fragments_clamped=25, by_frame=by_frame))[1].claims[0]
    assert claim.ours.value == 0.025
    assert claim.grade is Grade.OPEN


def test_nothing_measured_claims_nothing():
    for table in paper.tables(Results()):
        assert all(row.ours is None for row in table.rows)
        assert all(claim.ours is None for claim in (*table.claims, *table.own))
