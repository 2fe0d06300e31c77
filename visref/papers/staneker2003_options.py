"""What section 6.1 of Staneker, Bartz and Meissner 2003 proposes and does not measure, and the
map's other options: tables of ours."""

from __future__ import annotations

from visref.papers.contents import (
    Basis,
    Claim,
    Estimate,
    Results,
    Row,
    Sense,
    Table,
    least,
    most,
)
from visref.papers.printed.staneker2003 import BOX_PIXELS, CORNERS, MODELS
from visref.papers.staneker2003_records import PROCESSOR, Run, Runs, TurnsOf, of, value

ASKED = "occupancy-map:maps=1,fragments=true"
CORNERS_FIRST = "occupancy-map:maps=1,corners=true,fragments=true"
SCENE_SCALED = "occupancy-map:maps=1,scale=scene,fragments=true"
BACK_FACES = "occlusion-query:backfaces=true,fragments=true"
SMALL_LEFT_OUT = "occupancy-map:maps=1,min_pixels=8,fragments=true"
OPTIONS = (CORNERS_FIRST, SCENE_SCALED, BACK_FACES, SMALL_LEFT_OUT)
SINGLE = "occlusion-query:fragments=true"
MULTIPLE = "occupancy-map:maps=5"
INSTANCED = f"{MULTIPLE},query=instanced"

DETAILED = "FormulaOne"  # the model on which levels of detail are tried


def options_table(runs: Runs, large: Runs) -> Table:
    """Corners first, the map scaled to the scene, back faces of query boxes, and shapes left out by
    their size; lists asked as instanced draws, of the `large` images."""
    rows = []
    pixels = []
    for model in BOX_PIXELS:
        run = runs.get(model)
        spared = of(run, _asked_pixels)
        if spared is not None:
            pixels.append(spared)
        rows += [
            Row(f"{model}: visible boxes asked that a corner shows", CORNERS,
                of(run, _shown_by_corners), "%"),
            Row(f"{model}: queries, corners first over boxes alone", None,
                of(run, lambda r: _quotient(r, "queries", CORNERS_FIRST, ASKED)), "", 2),
            Row(f"{model}: pixels of all query boxes, corners first over boxes alone", None,
                of(spared, value), "", 2),
            Row(f"{model}: pixels of visible boxes, tiles over the scene's box over the window",
                None, of(run, lambda r: (r.box_pixels(SCENE_SCALED) / r.box_pixels(ASKED)).value),
                "", 2),
            Row(f"{model}: pixels of visible boxes, no map, back faces too over front", None,
                of(run, lambda r: (r.box_pixels(BACK_FACES) / r.box_pixels(SINGLE)).value),
                "", 2, note="whether theirs have them is not said"),
            Row(f"{model}: polygons drawn, shapes under 8 pixels left out over none", None,
                of(run, lambda r: _quotient(r, "triangles_drawn", SMALL_LEFT_OUT, ASKED)),
                "%", 1),
            Row(f"{model}: visible shapes missed by that", None, of(run, _missed), "%", 1),
        ]  # fmt: skip
    rows += [
        Row(f"{model}: frame rate, lists asked as one instanced draw each over as queries", None,
            run.by_culler[MULTIPLE].ms() / run.by_culler[INSTANCED].ms(), "", 2, Basis.WITHIN_RUN)
        for model, run in large.items()
    ]  # fmt: skip
    own = Claim(
        "corners first lessen the pixels of queries, in every scene: the greatest quotient",
        Sense.AT_MOST,
        most(*pixels) if pixels else None,
    )
    return Table("Options", "section 6.1 and others", tuple(rows), own=(own,))


def _quotient(run: Run, counter: str, of_culler: str, over: str) -> float:
    return run.by_culler[of_culler].mean(counter) / run.by_culler[over].mean(counter)


def _asked_pixels(run: Run) -> Estimate:
    first, alone = (
        run.by_culler[culler].series("query_fragments").mean() for culler in (CORNERS_FIRST, ASKED)
    )
    return first / alone


def _shown_by_corners(run: Run) -> float:
    """Each box asked costs a question about its corners, and one about the box where these do not
    show; which boxes are asked does not hang on how."""
    alone, first = run.by_culler[ASKED], run.by_culler[CORNERS_FIRST]
    shown = 2.0 * alone.mean("queries") - first.mean("queries")
    return shown / alone.mean("queries_passed")


def _missed(run: Run) -> float:
    rows = run.by_culler[SMALL_LEFT_OUT].rows
    return sum(row.missed for row in rows) / sum(row.visible for row in rows)


def arranging_table(turns: TurnsOf) -> Table:
    """Lists arranged in a second thread while what shows at once is drawn."""
    rows = []
    for model in MODELS:
        taken = turns.get(model)
        rows += [
            Row(f"{model}: frame rate, in a second thread over in one", None,
                of(taken, lambda t: t.gain("thread", "multiple").value),
                "", 2, Basis.WITHIN_RUN),
            Row(f"{model}: the same by processor time", None,
                of(taken, lambda t: t.gain("thread", "multiple", PROCESSOR).value),
                "", 2, Basis.WITHIN_RUN),
            Row(f"{model}: arranging, of a frame's time, in one thread", None,
                of(taken, lambda t: t.mean("multiple", "arrange_ms")
                   / t.mean("multiple", "frame_ms")), "%", 1),
            Row(f"{model}: arranging and waiting for it, of a frame's time, in two", None,
                of(taken, lambda t: t.mean("thread", "arrange_ms")
                   / t.mean("thread", "frame_ms")), "%", 1),
        ]  # fmt: skip
    gains = [taken.gain("thread", "multiple") for taken in turns.values()]
    own = Claim(
        "a second thread that arranges makes frames faster, in every scene: the least gain",
        Sense.AT_LEAST,
        least(*gains) if gains else None,
    )
    return Table("Arranging in a second thread", "section 6.1", tuple(rows), own=(own,))


def detail_table(results: Results) -> Table:
    """Levels of detail chosen by the lookup's rectangle."""
    found = results.experiment("detail")
    drawn = of(found, lambda f: f["triangles"])
    rows = [Row(f"{DETAILED}: polygons of the shapes drawn", None, drawn)]
    if found:
        levels = ", ".join(f"1 in {reduction}" for reduction in found["reductions"][1:])
        for place, pixels in enumerate(found["pixels_a_triangle"]):
            words = f"{DETAILED}: a polygon for each {pixels} pixels of a shape's rectangle"
            left = found["triangles_left"][place] / found["triangles"]
            rows += [
                Row(f"{words}: polygons left", None, left, "%", note=f"levels of {levels}"),
                Row(f"{words}: samples that change owner", None, found["samples_changed"][place],
                    "%", 1),
            ]  # fmt: skip
    return Table("Levels of detail by the rectangle", "section 6.1", tuple(rows))
