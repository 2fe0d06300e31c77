"""Every kind of part makes scenes that can be judged; a recipe is what its JSON says, and the same
recipe makes the same scene."""

from __future__ import annotations

import json

import numpy as np
import pytest

from visref.conformance.building import Case as Laid
from visref.conformance.suite import exact_truths
from visref.errors import InputError
from visref.search.case import Case
from visref.search.generated import PLAIN, GeneratedScenes
from visref.search.grammar import THINGS, Recipe, built, changed, crossed, random_recipe
from visref.search.kinds import Gene
from visref.search.motions import MOTIONS
from visref.search.staging import LENSES, PATHS, VIEWS, WORLDS

SECTIONS = {"lens": LENSES, "path": PATHS, "views": VIEWS, "world": WORLDS}


def recipe(**parts) -> Recipe:
    return Recipe.from_json({**PLAIN.to_json(), **parts})


def visible(made: Recipe) -> int:
    case = Case.of(*built(made))
    inputs = case.inputs()
    truths = exact_truths(Laid(inputs.scene, inputs.path))
    return sum(int(np.count_nonzero(truth.buffer.triangle >= 0)) for truth in truths)


@pytest.mark.parametrize("kind", THINGS)
def test_every_kind_of_thing_shows_in_some_scene(kind):
    rng = np.random.default_rng(3)
    # What is nothing, or lies beyond the range, shows nowhere by itself.
    more = PLAIN.to_json()["things"] if kind in ("nothing", "at-the-limits") else []
    seen = [visible(recipe(things=[THINGS[kind].draw(rng), *more])) for _ in range(8)]
    assert max(seen) > 0


@pytest.mark.parametrize("kind", THINGS)
def test_every_kind_of_thing_can_be_laid_out_in_images_of_any_size(kind):
    rng = np.random.default_rng(4)
    sizes = range(int(LENSES["straight"].genes["size"].high) + 1)
    for size in sizes:
        thing = THINGS[kind].draw(rng)
        if size % 3 == 0:
            # At the ends of their ranges.
            thing |= {
                name: float(rng.choice([gene.low, gene.high]))
                for name, gene in THINGS[kind].genes.items()
            }
        lens = {**PLAIN.lens, "size": size}
        try:
            scene, _ = built(recipe(lens=lens, things=[thing]))
        except InputError:
            continue
        assert np.isfinite(scene.vertices).all()


@pytest.mark.parametrize(
    ("section", "kind"), [(name, kind) for name, kinds in SECTIONS.items() for kind in kinds]
)
def test_every_way_to_look_at_a_scene_makes_one_that_can_be_judged(section, kind):
    rng = np.random.default_rng(5)
    houses = {"things": [THINGS["houses"].draw(rng), THINGS["crowd"].draw(rng)]}
    made = recipe(**{section: SECTIONS[section][kind].draw(rng)}, **houses)
    assert visible(made) > 0


@pytest.mark.parametrize("kind", MOTIONS)
def test_every_motion_changes_the_scene_from_frame_to_frame(kind):
    rng = np.random.default_rng(0)
    things = [{**PLAIN.things[0], "mover": 0, "moves": MOTIONS[kind].draw(rng)}]
    still = {"path": {"kind": "standing", "frames": 4}}
    changes = 0
    for _ in range(4):
        things[0]["moves"] = MOTIONS[kind].draw(rng)
        timeline = Case.of(*built(recipe(things=things, **still))).inputs().timeline
        changes += sum(bool(timeline.changed(frame).any()) for frame in range(1, 4))
    assert changes > 0


def test_the_same_recipe_makes_the_same_case():
    rng = np.random.default_rng(11)
    for _ in range(20):
        made = random_recipe(rng, moves=True)
        again = Recipe.from_json(json.loads(json.dumps(made.to_json())))
        assert again == made
        assert Case.of(*built(again)).digest == Case.of(*built(made)).digest


def test_changed_and_crossed_recipes_are_other_recipes_that_can_be_read():
    rng = np.random.default_rng(2)
    one, other = random_recipe(rng, moves=True), random_recipe(rng, moves=True)
    for _ in range(50):
        near, mixed = changed(one, rng, moves=True), crossed(one, other, rng)
        assert Recipe.from_json(near.to_json()) == near
        assert Recipe.from_json(mixed.to_json()) == mixed
        assert all(part in (*one.things, *other.things) for part in mixed.things)
    assert any(changed(one, rng, moves=True) != one for _ in range(5))


def test_where_nothing_may_move_nothing_does():
    source = GeneratedScenes(moves=False)
    rng = np.random.default_rng(9)
    made = source.random(rng)
    for _ in range(60):
        made = source.changed(source.crossed(made, source.random(rng), rng), rng)
        assert not made.moves
    assert any(GeneratedScenes().random(rng).moves for _ in range(30))


@pytest.mark.parametrize("how", ["even", "log", "whole"])
def test_a_gene_stays_within_its_range_and_near_its_value(how):
    gene, rng = Gene(2.0, 50.0, how), np.random.default_rng(0)
    drawn = [gene.draw(rng) for _ in range(300)]
    assert 2.0 <= min(drawn) < 6.0
    assert 30.0 < max(drawn) <= 50.0
    near = [gene.near(5.0, rng) for _ in range(300)]
    assert 2.0 <= min(near) <= max(near) <= 50.0
    assert np.median(np.abs(np.array(near) - 5.0)) < np.median(np.abs(np.array(drawn) - 5.0))
    if how == "whole":
        assert all(value == int(value) for value in (*drawn, *near))


@pytest.mark.parametrize(
    "spoilt",
    [
        None,
        [],
        {},
        {**PLAIN.to_json(), "lens": {"kind": "no such lens"}},
        {**PLAIN.to_json(), "things": [{"kind": "panel"}]},
        {**PLAIN.to_json(), "things": [{**PLAIN.things[0], "x": "wide"}]},
        {**PLAIN.to_json(), "things": [{**PLAIN.things[0], "moves": {"kind": "bent"}}]},
    ],
)
def test_what_is_no_recipe_is_refused_in_one_line(spoilt):
    with pytest.raises(InputError) as caught:
        Recipe.from_json(spoilt)
    assert "\n" not in str(caught.value)
