"""X. Décoret: N-Buffers for efficient depth map query. Computer Graphics Forum 24(3), 2005.

Its two effects: sections 4.3 (particles) and 4.4 (shadow volume clamping). They draw no objects,
so they are no judged runs but experiments, each judged by the image protocol (`visref.effects`).

The paper's models, its paths and its lights are not available; `terrain_towers` is laid out as its
text says, and two cities stand for its city: `city` for particles, and for shadows a part of
`old_town`, whose houses are solids (those of `city` are open sheets, whose lit and unlit sides both
cast). So fragments compare in ratio and order. Its shares depend on what the observer sees: the
volumes of what is seen to cast, and of what lies in its shadow, are wanted in full. So the share is
told by kind of caster as well.
"""

from __future__ import annotations

from collections.abc import Mapping
from statistics import fmean
from typing import Any

from visref.papers.contents import (
    Basis,
    Claim,
    Estimate,
    Experiment,
    Results,
    Row,
    Sense,
    Size,
    Table,
    most,
    ratio_of,
    series,
    single,
)
from visref.papers.printed.decoret2005 import (
    CLAMPED_SHARE,
    CULLED_HZ,
    FEWER_TESTS,
    FRAGMENTS,
    LOOKUPS_A_SPRITE,
    PLAIN_HZ,
    SIMPLE_SHARE,
    TESTS_A_SPRITE,
)

SIZE: Size = (640, 480)
SCENES = {
    "particles": {"terrain_towers": "terrain_towers", "city": "city:scale=0.25"},
    "shadow-volumes": {"terrain_towers": "terrain_towers", "city": "old_town:scale=0.01"},
}

EXPERIMENTS = tuple(
    Experiment(f"{name}-{scene.replace('_', '-')}", name, spec, SIZE)
    for name, scenes in SCENES.items()
    for scene, spec in scenes.items()
)

# "The benefit comes from the birds that cast shadows on the ground": section 4.4.
BIRDS = ("terrain_towers", "bird")

Result = Mapping[str, Any]

# Lookups as they are counted where they are made; an experiment that does not count them says
# nothing, and is not believed to make one a sprite.
COUNTED = "lookups_counted"


def tables(results: Results) -> list[Table]:
    """Sections 4.3 and 4.4."""
    return [
        _particles(_results(results, "particles")),
        _shadows(_results(results, "shadow-volumes")),
    ]


def _results(results: Results, name: str) -> dict[str, Result | None]:
    return {
        scene: results.experiment(f"{name}-{scene.replace('_', '-')}") for scene in SCENES[name]
    }


def _particles(results: Mapping[str, Result | None]) -> Table:
    rows = []
    for scene, result in results.items():
        of = f"{scene}: "
        in_view = _value(result, "sprites_in_view")
        rows += [
            Row(f"{of}sprites of 16² in the image", None, in_view),
            Row(
                f"{of}depth tests a sprite, rasterised",
                TESTS_A_SPRITE,
                _quotient(result, "depth_tests_plain", "sprites_in_view"),
                digits=1,
                note="sprites are cut at the image's rim",
            ),
            Row(
                f"{of}lookups a sprite",
                LOOKUPS_A_SPRITE,
                _quotient(result, COUNTED, "sprites_in_view"),
                digits=1,
            ),
            Row(
                f"{of}depth tests a sprite, of those drawn after their lookup",
                None,
                _quotient(result, "depth_tests_left", "sprites_in_view"),
                digits=1,
                note="the paper counts the lookups alone",
            ),
            Row(
                f"{of}sprites culled",
                None,
                _saved(result, "sprites_kept", "sprites_in_view"),
                unit="%",
                digits=1,
            ),
            *_time_rows(of, result),
            *_other_rows(of, result),
            *_verdict_rows(of, result),
        ]
    claims = tuple(
        Claim(
            f"{scene}: a lookup a sprite makes 256 times fewer depth tests",
            Sense.AT_LEAST,
            _estimate(result, "depth_tests_plain", COUNTED),
            FEWER_TESTS,
            digits=0,
            told="sprites are cut at the image's rim",
        )
        for scene, result in results.items()
    )
    return Table(
        "Particles culled in the vertex shader",
        "section 4.3",
        tuple(rows),
        claims,
        (_safe(results), *(_four_cull_more(scene, result) for scene, result in results.items())),
    )


def _time_rows(of: str, result: Result | None) -> list[Row]:
    culled, plain = (
        None if result is None else fmean(result[name]) for name in ("culled_ms", "plain_ms")
    )
    slower = None if culled is None or plain is None else culled / plain
    return [
        Row(f"{of}frames a second, 60² sprites culled", CULLED_HZ, _hz(culled), "Hz", 0,
            Basis.HARDWARE),
        Row(f"{of}the same, not culled", PLAIN_HZ, _hz(plain), "Hz", 0, Basis.HARDWARE),
        Row(f"{of}the latter over the former", ratio_of(PLAIN_HZ, CULLED_HZ), slower, "", 2,
            Basis.WITHIN_RUN, "there a driver made lookups in vertex programs slow"),
    ]  # fmt: skip


def _hz(ms: float | None) -> float | None:
    return None if not ms else 1e3 / ms


def _other_rows(of: str, result: Result | None) -> list[Row]:
    """Of sprites whose side is no power of two."""
    rows = []
    for squares, name in (("1", "one square"), ("4", "four squares")):
        other = None if result is None else result["other"][squares]
        rows += [
            Row(
                f"{of}sprites of 24², {name}: lookups a sprite",
                None,
                _quotient(other, COUNTED, "sprites_in_view"),
                digits=1,
            ),
            Row(
                f"{of}sprites of 24², {name}: culled",
                None,
                _saved(other, "sprites_kept", "sprites_in_view"),
                "%",
                1,
            ),
        ]
    return rows


def _four_cull_more(scene: str, result: Result | None) -> Claim:
    one, four = (None, None) if result is None else (result["other"][n] for n in ("1", "4"))
    kept = None
    if one is not None and four is not None and one["sprites_kept"]:
        kept = single(four["sprites_kept"]) / float(one["sprites_kept"])
    return Claim(
        f"{scene}: four squares leave fewer sprites of 24² than one: theirs over its",
        Sense.AT_MOST,
        kept,
        digits=3,
    )


def _shadows(results: Mapping[str, Result | None]) -> Table:
    rows = []
    for scene, result in results.items():
        of = f"{scene}: "
        full, clamped = FRAGMENTS if scene == "city" else (None, None)
        rows += [
            Row(
                f"{of}fragments of shadow volumes, in full", full, _value(result, "fragments_full")
            ),
            Row(f"{of}the same, clamped", clamped, _value(result, "fragments_clamped")),
            Row(
                f"{of}share left",
                CLAMPED_SHARE,
                _quotient(result, "fragments_clamped", "fragments_full"),
                unit="%",
                digits=1,
                note=f"published for simpler scenes: {SIMPLE_SHARE.value:.0f} %",
            ),
            Row(
                f"{of}casters culled",
                None,
                _saved(result, "casters_kept", "casters"),
                unit="%",
                digits=1,
            ),
            Row(f"{of}triangles that bound a solid", None, _value(result, "solid"), "%", 1),
            *_kind_rows(of, result),
            *_verdict_rows(of, result),
        ]
    claims = tuple(
        Claim(
            f"{scene}: clamping leaves 2.5 % of the fragments",
            Sense.AT_MOST,
            _estimate(result, "fragments_clamped", "fragments_full"),
            CLAMPED_SHARE,
            unit="%",
            digits=1,
        )
        for scene, result in results.items()
    )
    own = (_safe(results), _birds(results))
    return Table("Shadow volumes, clamped", "section 4.4", tuple(rows), claims, own)


def _kind_rows(of: str, result: Result | None) -> list[Row]:
    """Whose fragments they are, and what clamping leaves of each kind's."""
    if result is None:
        return []
    rows = []
    for kind, counts in result["kinds"].items():
        share = counts["fragments_clamped"] / (result["fragments_clamped"] or 1)
        rows += [
            Row(f"{of}fragments left that are of {kind}", None, share, "%", 1),
            Row(f"{of}of {kind}: share left", None,
                _quotient(counts, "fragments_clamped", "fragments_full"), "%", 1),
        ]  # fmt: skip
    return rows


def _birds(results: Mapping[str, Result | None]) -> Claim:
    scene, kind = BIRDS
    result = results[scene]
    counts = None if result is None else result["kinds"].get(kind)
    return Claim(
        f"{scene}: of the birds' volumes, from which the paper says that the benefit comes, "
        "clamping leaves 2.5 %",
        Sense.AT_MOST,
        None if counts is None else _estimate(counts, "fragments_clamped", "fragments_full"),
        CLAMPED_SHARE,
        unit="%",
        digits=1,
    )


def _verdict_rows(of: str, result: Result | None) -> list[Row]:
    verdict = None if result is None else result["verdict"]
    return [
        Row(f"{of}samples lost, extra or unlike the uncut effect's", None, _wrong(verdict)),
        Row(
            f"{of}samples within the rasteriser's tolerance",
            None,
            None if verdict is None else verdict["within_tolerance"],
            note=f"of {verdict['judged']:,} judged" if verdict is not None else "",
        ),
    ]


def _wrong(verdict: Result | None) -> float | None:
    if verdict is None:
        return None
    return float(verdict["lost"] + verdict["extra"] + verdict["differing"])


def _safe(results: Mapping[str, Result | None]) -> Claim:
    found = [result for result in results.values() if result is not None]
    found += [other for result in found for other in result.get("other", {}).values()]
    verdicts = [result["verdict"] for result in found]
    decided = all(verdict["status"] in ("no_violation_found", "violation") for verdict in verdicts)
    counts = [_wrong(verdict) for verdict in verdicts if decided]
    wrong = [single(count) for count in counts if count is not None]
    return Claim(
        "culling changes no sample of the picture, in any scene",
        Sense.AT_MOST,
        most(*wrong) if wrong else None,
        even=0.0,
        ties=True,
        digits=0,
    )


def _estimate(result: Result | None, over: str, under: str) -> Estimate | None:
    """A quotient of sums over frames: with an interval where the experiment gives both by frame."""
    if result is None or not result.get(under):
        return None
    by_frame = result.get("by_frame", {})
    if over in by_frame and under in by_frame:
        parts = (by_frame[over], by_frame[under])
        frames = result.get("frames", range(len(parts[0])))
        above, below = (series(part, frames, "effects").mean() for part in parts)
        return above / below
    return single(result[over]) / float(result[under])


def _value(result: Result | None, name: str) -> float | None:
    return None if result is None else float(result[name])


def _quotient(result: Result | None, over: str, under: str) -> float | None:
    if result is None or not result.get(under) or over not in result:
        return None
    return float(result[over] / result[under])


def _saved(result: Result | None, kept: str, of: str) -> float | None:
    share = _quotient(result, kept, of)
    return None if share is None else 1.0 - share
