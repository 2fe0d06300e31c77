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


def particles(**changed):
    counted = {
        "sprites_in_view": 100.0,
        "sprites_kept": 40.0,
        "depth_tests_plain": 25_000.0,
        "lookups_counted": 100.0,
        "depth_tests_left": 10_000.0,
        "verdict": GOOD,
    }
    other = {
        "1": counted | {"sprites_kept": 60.0},
        "4": counted | {"lookups_counted": 400.0, "sprites_kept": 50.0},
    }
    times = {"culled_ms": [30.0, 50.0], "plain_ms": [15.0, 25.0]}
    return counted | {"other": other} | times | changed


def test_particles_are_told_a_sprite():
    result = particles()
    rows = rows_of(Results(particles_city=result), 0)
    assert rows["city: depth tests a sprite, rasterised"].ours == 250.0
    assert rows["city: lookups a sprite"].ours == 1.0
    claim = paper.tables(Results(particles_city=result))[0].claims[1]
    assert (claim.ours.value, claim.interval, claim.grade) == (250.0, None, Grade.IN_DIRECTION)
    assert rows["city: sprites culled"].ours == pytest.approx(0.6)
    assert rows["city: samples lost, extra or unlike the uncut effect's"].ours == 0.0
    assert rows["terrain_towers: lookups a sprite"].ours is None
    del result["lookups_counted"]
    uncounted = paper.tables(Results(particles_city=result))[0]
    assert uncounted.claims[1].grade is Grade.UNMEASURED
    assert {r.quantity: r.ours for r in uncounted.rows}["city: lookups a sprite"] is None


def test_time_of_particles_stands_beside_the_papers_frame_rates():
    rows = rows_of(Results(particles_city=particles()), 0)
    culled, plain = (
        rows[f"city: {name}"]
        for name in ("frames a second, 60² sprites culled", "the same, not culled")
    )
    assert (culled.theirs, culled.ours, plain.theirs, plain.ours) == (3, 25.0, 100, 50.0)
    slower = rows["city: the latter over the former"]
    assert (slower.ours, round(slower.theirs, 2)) == (2.0, 33.33)


@pytest.mark.parametrize(("kept", "grade"), [(59.0, Grade.HOLDS), (61.0, Grade.FAILS)])
def test_four_squares_are_held_against_one(kept, grade):
    result = particles()
    result["other"]["4"]["sprites_kept"] = kept
    made = paper.tables(Results(particles_city=result))[0]
    rows = {row.quantity: row for row in made.rows}
    assert rows["city: sprites of 24², four squares: lookups a sprite"].ours == 4.0
    claims = {claim.statement: claim for claim in made.own}
    (four,) = (c for text, c in claims.items() if text.startswith("city: four squares"))
    assert four.grade is grade


def test_sprite_lost_of_another_size_shows_in_the_table():
    result = particles()
    result["other"]["4"]["verdict"] = {**GOOD, "status": "violation", "lost": 1}
    safe = paper.tables(Results(particles_city=result))[0].own[0]
    assert safe.grade is Grade.FAILS


def shadows(verdict=GOOD, **changed):
    result = {
        "fragments_full": 1000.0,
        "fragments_clamped": 150.0,
        "casters": 50,
        "casters_kept": 5.0,
        "solid": 0.25,
        "kinds": {
            "bird": {"fragments_full": 400.0, "fragments_clamped": 10.0},
            "tower": {"fragments_full": 600.0, "fragments_clamped": 140.0},
        },
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
    safe, birds = paper.tables(results)[1].own
    assert safe.grade is grade
    assert birds.grade is Grade.HOLDS


def test_fragments_are_told_by_kind_of_caster():
    rows = rows_of(shadows(), 1)
    assert rows["terrain_towers: of bird: share left"].ours == 0.025
    assert rows["terrain_towers: of tower: share left"].ours == pytest.approx(140 / 600)
    assert rows["terrain_towers: fragments left that are of tower"].ours == pytest.approx(14 / 15)
    kinds = {"bird": {"fragments_full": 400.0, "fragments_clamped": 10.1}}
    assert paper.tables(shadows(kinds=kinds))[1].own[1].grade is Grade.IN_DIRECTION


@pytest.mark.parametrize(
    ("clamped", "grade"), [(25, Grade.HOLDS), (26, Grade.IN_DIRECTION), (1001, Grade.FAILS)]
)
def test_what_clamping_leaves_is_graded_by_the_papers_share(clamped, grade):
    claims = paper.tables(shadows(fragments_clamped=clamped))[1].claims
    assert [claim.grade for claim in claims] == [grade, Grade.UNMEASURED]


def test_fragments_by_frame_give_an_interval():
    by_frame = {"fragments_clamped": [20.0, 30.0, 10.0, 40.0], "fragments_full": [1000.0] * 4}
    made = shadows(fragments_clamped=25, by_frame=by_frame, frames=[5, 15, 25, 35])
    claim = paper.tables(made)[1].claims[0]
    assert claim.ours.value == 0.025
    assert claim.grade is Grade.OPEN


def test_nothing_measured_claims_nothing():
    for table in paper.tables(Results()):
        assert all(row.ours is None for row in table.rows)
        assert all(claim.ours is None for claim in (*table.claims, *table.own))
