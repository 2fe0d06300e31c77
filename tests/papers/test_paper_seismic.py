"""The slides' rows and trends come from the results, and each trend can fail."""

from __future__ import annotations

import pytest

from tests.support.run_values import run_folder
from visref.papers import seismic as paper
from visref.papers import seismic_figures as figures
from visref.papers.contents import Grade
from visref.registry import make_culler
from visref_experiments import three_pass

SAMPLES = paper.SIZE[0] * paper.SIZE[1]


def options(spec):
    values = dict(part.split("=") for part in spec.partition(":")[2].split(",") if part)
    return {key: int(value) for key, value in values.items() if value.isdigit()}


def counts(spec):
    """Made up as the claims have it: two frames of a culler."""
    given = options(spec)
    reduction, scale = given.get("reduction", 0), given.get("scale", 1)
    approximate = reduction and "conservative" not in spec
    # Coarser stand-ins, thresholds and images lose more; coarser ones draw more for nothing.
    lost = (reduction - 1 + 10 * given["threshold"] + scale - 1) if approximate else 0
    draws = 1000 if spec.startswith("frustum") else 300 + reduction // 2 + scale
    boxes = "ask=boxes" in spec
    draws -= 50 if "tile=" in spec else 0
    return {
        "visible": 200,
        "confirmed": (lost // 10 + scale - 1) // (2 if boxes else 1) if approximate else 0,
        "missed_pixels": lost,
        "drawn": draws,
        "superfluous": 250 if spec == paper.BOXES or boxes else 10 + reduction // 10,
        "triangles_drawn": 10 * draws,
        "batches": 1,
        "depth_tests": 100_000 if spec.startswith("frustum") else 250_000 // scale,
    }


class Results:
    """Every run, with some counters of some specs changed (in all runs, or in one), and frame
    times."""

    def __init__(self, changed=None, prediction=None, runs=True):
        self.changed, self.found, self.runs = changed or {}, prediction, runs

    def run(self, key):
        if not self.runs:
            return None
        (judged,) = (judged for judged in paper.RUNS if judged.key == key)
        frames, timings = {}, []
        for spec in judged.cullers:
            row = counts(spec) | self.changed.get(spec, {}) | self.changed.get((key, spec), {})
            ms = row.pop("ms", 60.0 if spec == paper.FRUSTUM else 20.0)
            frames[spec] = [{"frame": frame, **row} for frame in (0, 1)]
            timings += [
                {"culler": spec, "frame": frame, "phase": "frame", "ms": ms} for frame in (0, 1)
            ]
        return run_folder(frames, timings)

    def experiment(self, key):
        return self.found


def measured(reduction, spearman):
    found = {"reduction": reduction, "wrong": 90.0, "missed": 9.0, "frame_outline": [30.0, 15.0]}
    found |= {"offsets_ms": 30.0, "simplify_ms": 10.0}
    return found | {
        name: {"spearman": value} for name, value in zip(paper.MEASURES, spearman, strict=True)
    }


def prediction(outline=0.8):
    pooled = {name: {"wrong_spearman": 0.9, "missed_spearman": 0.7} for name in paper.MEASURES}
    reductions = [measured(10, (0.5, 0.6, 0.9)), measured(100, (0.5, 0.6, outline))]
    return {"frames": 2, "reductions": reductions, "pooled": pooled}


def rows(results):
    return {
        (table.title, row.quantity): row for table in paper.tables(results) for row in table.rows
    }


def grades(results):
    return {
        claim.statement: claim.grade
        for table in paper.tables(results)
        for claim in (*table.claims, *table.own)
    }


SAYS, MISSES = "What the slides say", "Misses against reduction, threshold and image scale"


def test_rows_are_sums_and_shares_of_the_records():
    found = rows(Results(prediction=prediction()))
    fill = found[SAYS, "worst fill, over drawing what is in the frustum"]
    assert (fill.theirs, fill.ours, fill.unit) == (3.0, 2.5, "×")
    assert found[SAYS, "samples lost at a reduction of 1:100"].ours == 99 / SAMPLES
    assert found[SAYS, "waits a frame"].ratio == 1.0
    assert found[SAYS, "frame rate at 1:100 over frustum culling"].ours == 3.0
    at = "1:10, threshold 5, 1/4 the side"
    lost = 9 + 50 + 3
    assert found[MISSES, f"{at}: samples lost"].ours == lost / SAMPLES
    assert found[MISSES, f"{at}: visible objects missed"].ours == (lost // 10 + 3) / 200
    drawn = "1:100, threshold 0, full image: drawn, of what is in the frustum"
    assert found["Conservative mode", drawn].ours == 351 / 1000
    asked = "Stand-ins against bounding boxes"
    assert found[asked, "1:100, boxes asked: drawn for nothing"].ours == 250 / 351
    assert found[asked, "1:100, stand-ins asked: visible objects missed"].ours == 9 / 200
    whole = "published, in tiles: triangles drawn in full, of what is in the frustum"
    assert found["Horizons that come undivided", whole].ours == 301 / 1000
    foretold = "1:10: wrong pixels over those that the outline foretells"
    assert found["Predicting the error", foretold].ours == 2.0


def test_every_claim_holds_of_records_made_so():
    results = Results(prediction=prediction())
    found = grades(results)
    assert len(found) == 17
    assert set(found.values()) == {Grade.HOLDS}
    assert sum(len(table.own) for table in paper.tables(results)) == 12


@pytest.mark.parametrize(
    ("claim", "changed"),
    [
        ("the fill is at worst",
         {f"{paper.published(1)},fragments=true": {"depth_tests": 300_001}}),
        ("a smaller image needs",
         {f"{paper.published(100, scale=4)},fragments=true": {"depth_tests": 10**6}}),
        ("culling pays", {paper.published(100): {"ms": 61.0}}),
        ("stand-ins are more precise", {paper.published(30): {"superfluous": 290}}),
        ("they miss more for it", {paper.boxed(10): {"confirmed": 90}}),
        ("published: in tiles of its own making",
         {("undivided", paper.in_tiles(paper.published(100))): {"triangles_drawn": 10**6}}),
        ("conservative: in tiles of its own making",
         {("undivided", paper.in_tiles(paper.conservative(100))): {"triangles_drawn": 10**6}}),
        ("the conservative mode misses nothing in tiles",
         {("undivided", paper.in_tiles(paper.conservative(100))): {"confirmed": 1}}),
        ("the more reduced, the more samples", {paper.published(300): {"missed_pixels": 1}}),
        ("the higher the threshold", {paper.published(10, 20, 4): {"missed_pixels": 1}}),
        ("the smaller image misses", {paper.published(10, 0, 4): {"confirmed": 0},
                                      paper.published(10, 0, 1): {"confirmed": 1}}),
        ("up to 1:100", {paper.published(30): {"triangles_drawn": 1}}),
        ("the conservative mode misses nothing: ", {paper.conservative(1000, 4): {"confirmed": 1}}),
        ("the conservative mode misses nothing in motion",
         {("dynamic", paper.conservative(100)): {"confirmed": 1}}),
        ("works for dynamic scenes",
         {("dynamic", paper.published(100)): {"triangles_drawn": 10**6}}),
        ("the more reduced, the less", {paper.conservative(1000, 4): {"drawn": 1}}),
    ],
    ids=str,
)  # fmt: skip
def test_each_claim_can_fail_and_no_other_with_it(claim, changed):
    found = grades(Results(changed, prediction()))
    (failed,) = (c for c, grade in found.items() if grade is Grade.FAILS)
    assert failed.startswith(claim)
    assert sum(grade is not Grade.HOLDS for grade in found.values()) == 1


def test_trend_of_the_predictors_can_fail():
    assert list(grades(Results(prediction=prediction(outline=0.4))).values())[-1] is Grade.FAILS


def test_without_records_nothing_is_claimed():
    made = paper.tables(Results(runs=False))
    assert all(row.ours is None for table in made for row in table.rows)
    assert set(grades(Results(runs=False)).values()) == {Grade.UNMEASURED}
    assert all(table.figure is None for table in made)


@pytest.mark.slow
@pytest.mark.gl
def test_specs_are_cullers_and_the_experiment_is_measured_at_the_runs_reductions():
    for judged in paper.RUNS:
        for spec in judged.cullers:
            made = make_culler(spec)
            if spec.startswith("three-pass"):
                assert (made.reduction, made.extra) == (options(spec)["reduction"], figures.EXTRA)
            made.close()
    assert set(three_pass.REDUCTIONS) == set(paper.REDUCTIONS) - {1}
    assert (three_pass.EXTRA, three_pass.MEASURES) == (figures.EXTRA, paper.MEASURES)
