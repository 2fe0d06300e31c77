"""What a policy accepts, against a second evaluator that reads the same file for itself.

Records are made up: a policy asks a miss for its object, frame, culler, samples lost and age, and
nothing of what there is to see. The second evaluator knows neither the reader nor `fnmatch`.
"""

from __future__ import annotations

import random
import tomllib
from collections import Counter
from dataclasses import replace
from datetime import date

import numpy as np
import pytest

from visref.culler import QueryStats
from visref.findings import Code
from visref.judging.judge import Counts, FrameVerdict, Miss, MissKind
from visref.judging.misses import Misses
from visref.judging.outcome import CullerRecord, FrameRecord, RunOutcome, verdict_json
from visref.judging.policy import Accepting, Policy, Span
from visref.judging.policy_file import adopted, read_policy, spans_of, to_toml
from visref.judging.stale import policy_findings
from visref.judging.status import Exit, Status
from visref.promise import Promise
from visref.scene import Scene

PATHS = (
    "house/kitchen/chair", "house/kitchen/Chair", "house/door", "yard/door", "yard/tree[1]", "wall",
)  # fmt: skip
NAMES = ("chair", "Chair", "door", "door#2", "tree[1]", "wall")
CULLERS = ("hzb:levels=4", "pvs")
TODAY = date(2026, 5, 17)
PATTERNS = (
    "door", "door*", "*door", "house/*", "?hair", "*/door", "[Cc]hair", "tree[[]1]", "tree[1]",
    "w*l", "nothing", "*", "[!w]*",
)  # fmt: skip
FRAMES = (None, 2, "0:3", ":", "4:", "1::2", [0, "5:9:3"], "90:99")


def scene() -> Scene:
    corner = (np.eye(3), np.array([[0, 1, 2]]))
    made = Scene.from_objects([(name, *corner) for name in NAMES])
    return replace(made, names=NAMES, given_names=NAMES, paths=PATHS)


def miss(index: int, kind: MissKind, samples: int, age: int | None) -> Miss:
    return Miss(index, kind, samples, samples + 3, 0, index, 1.0, width=4, age=age)


def record(spec: str, frames: dict[int, list[Miss]], promise: Promise) -> CullerRecord:
    """With misses as they come from a judge, before any policy."""
    rows = []
    for frame, misses in frames.items():
        kinds = Counter(one.kind for one in misses)
        confirmed = kinds[MissKind.CONFIRMED]
        counts = Counts(
            visible=6,
            missed=len(misses),
            confirmed=confirmed,
            ties=kinds[MissKind.TIE],
            within_raster_tolerance=kinds[MissKind.WITHIN_RASTER],
            violations=confirmed if promise.convicts else 0,
            owned_samples=100,
        )
        verdict = FrameVerdict(counts, Misses.of(misses))
        rows.append(FrameRecord(frame, "", 4, verdict, QueryStats(), 0))
    made = CullerRecord(spec, promise)
    made.frames = rows
    return made


def judged_by(policy: Policy, records: list[CullerRecord], frames: range) -> RunOutcome:
    """The records, passed through a policy, and the run that they make."""
    accepting = Accepting(policy, scene())
    through = []
    for one in records:
        rows = [
            replace(row, verdict=accepting.verdict(row.verdict, one.promise, row.frame, one.spec))
            for row in one.frames
        ]
        through.append(replace(one, frames=rows, max_undecided=policy.max_undecided))
    return RunOutcome(through, policy_findings(accepting, through, frames), policy)


# The second evaluator.


def like(text: str, pattern: str) -> bool:
    """Whether a text is like a pattern of *, ?, [...] and [!...], by trying every way."""
    if not pattern:
        return not text
    if pattern[0] == "*":
        return any(like(text[i:], pattern[1:]) for i in range(len(text) + 1))
    end = pattern.find("]", 2 + pattern.startswith("[!")) if pattern[0] == "[" else -1
    if end > 0:
        inside, rest = pattern[1:end], pattern[end + 1 :]
        unlike = inside.startswith("!")
        return bool(text) and (text[0] in inside[unlike:]) != unlike and like(text[1:], rest)
    return bool(text) and pattern[0] in ("?", text[0]) and like(text[1:], pattern[1:])


def numbers(said: object, count: int) -> set[int]:
    if said is None:
        return set(range(count))
    if isinstance(said, list):
        return set().union(*(numbers(one, count) for one in said))
    if isinstance(said, int):
        return {said} & set(range(count))
    parts = [int(part) if part else None for part in said.split(":")]
    return set(range(count)[slice(*parts)])


def brute_kind(policy: dict, one: Miss, frame: int, spec: str, count: int) -> str:
    if one.kind.value in ("tie", "within_raster_tolerance"):
        return one.kind.value
    if one.samples < policy.get("min_samples", 0):
        return "small"
    if one.age in range(policy.get("latency_frames", 0)):
        return "late"
    for waiver in policy.get("waive", []):
        if brute_names(waiver, one, frame, spec, count):
            return "waived"
    return "confirmed"


def brute_names(waiver: dict, one: Miss, frame: int, spec: str, count: int) -> bool:
    texts = (NAMES[one.object], PATHS[one.object])
    return (
        any(like(text, waiver["object"]) for text in texts)
        and frame in numbers(waiver.get("frames"), count)
        and like(spec, waiver.get("culler", "*"))
    )


def brute_stale(policy: dict, records: list[CullerRecord], count: int) -> list[int]:
    stale = []
    for place, waiver in enumerate(policy.get("waive", [])):
        its = [one for one in records if like(one.spec, waiver.get("culler", "*"))]
        covered = numbers(waiver.get("frames"), count)
        judged = bool(its) and all(covered <= {row.frame for row in one.frames} for one in its)
        named = any(
            brute_names(waiver, miss, row.frame, one.spec, count)
            for one in its
            for row in one.frames
            for miss in row.verdict.misses
        )
        expired = "expires" in waiver and waiver["expires"] < TODAY
        if expired or (judged and not named):
            stale.append(place)
    return stale


def drawn_policy(rng: random.Random) -> str:
    lines = []
    for name, most in (("latency_frames", 4), ("min_samples", 9)):
        if rng.random() < 0.6:
            lines.append(f"{name} = {rng.randrange(most)}")
    for _ in range(rng.randrange(4)):
        lines += ["[[waive]]", f'object = "{rng.choice(PATTERNS)}"', 'reason = "known"']
        frames = rng.choice(FRAMES)
        if frames is not None:
            lines.append(f"frames = {frames!r}")
        if rng.random() < 0.4:
            lines.append(f'culler = "{rng.choice(["hzb*", "pvs", "nobody"])}"')
        if rng.random() < 0.4:
            lines.append(f"expires = {rng.choice(['2026-05-16', '2026-05-17', '2031-01-01'])}")
    return "\n".join(lines)


def drawn_records(rng: random.Random, count: int) -> list[CullerRecord]:
    """Of one or two cullers, which were judged in all frames of the path or in some."""
    records = []
    for spec in CULLERS[: rng.randint(1, 2)]:
        judged = [frame for frame in range(count) if rng.random() < rng.choice([1.0, 0.8])]
        frames = {
            frame: [
                miss(
                    index,
                    kind := rng.choice(
                        [MissKind.CONFIRMED] * 6 + [MissKind.TIE, MissKind.WITHIN_RASTER]
                    ),
                    0 if kind is MissKind.TIE else rng.randint(1, 12),
                    rng.choice([None, 0, 1, 2, 3, 7]),
                )
                for index in range(len(NAMES))
                if rng.random() < 0.2
            ]
            for frame in judged
        }
        records.append(record(spec, frames, rng.choice(list(Promise))))
    return records


@pytest.mark.parametrize("seed", range(8))
def test_kinds_counts_statuses_and_stale_waivers_are_those_of_a_second_evaluator(seed, tmp_path):
    rng = random.Random(seed)
    kinds: Counter[str] = Counter()
    stale = 0
    for _ in range(60):
        count = rng.choice([1, 6, 12])
        records, text = drawn_records(rng, count), drawn_policy(rng)
        (tmp_path / "visref.toml").write_text(text)
        policy = read_policy(tmp_path / "visref.toml", today=TODAY)
        outcome = judged_by(policy, records, range(count))
        value = tomllib.loads(text)
        for before, after in zip(records, outcome.cullers, strict=True):
            for row, got in zip(before.frames, after.frames, strict=True):
                expected = [
                    brute_kind(value, one, row.frame, before.spec, count)
                    for one in row.verdict.misses
                ]
                assert [one.kind.value for one in got.verdict.misses] == expected, text
                kinds.update(expected)
                counts, number = got.verdict.counts, Counter(expected)
                assert counts.missed == sum(number.values())
                assert (counts.ties, counts.within_raster_tolerance) == (
                    number["tie"], number["within_raster_tolerance"]
                )  # fmt: skip
                assert (counts.small, counts.late, counts.waived, counts.confirmed) == tuple(
                    number[kind] for kind in ("small", "late", "waived", "confirmed")
                )
                convicts = before.promise in (Promise.CONSERVATIVE, Promise.EXACT)
                assert counts.violations == (number["confirmed"] if convicts else 0)
        places = brute_stale(value, records, count)
        found = [one for one in outcome.findings if one.code is Code.STALE_WAIVER]
        assert [one.message.split()[0] for one in found] == [f"waive[{at}]" for at in places]
        guilty = any(one.totals.violations for one in outcome.cullers)
        assert (outcome.status is Status.VIOLATION) == bool(guilty or places)
        stale += len(places)
    # Every kind and stale waivers were among them.
    assert len(kinds) == 6
    assert stale


def test_the_pass_is_pure_and_may_be_made_again_with_the_same_policy_or_none(tmp_path):
    rng = random.Random(3)
    for _ in range(40):
        records = drawn_records(rng, 6)
        (tmp_path / "visref.toml").write_text(drawn_policy(rng))
        policy = read_policy(tmp_path / "visref.toml", today=TODAY)
        once = judged_by(policy, records, range(6))
        twice = judged_by(policy, once.cullers, range(6))
        back = judged_by(Policy(), once.cullers, range(6))
        for raw, one, two, none in zip(
            records, once.cullers, twice.cullers, back.cullers, strict=True
        ):
            assert two.totals == one.totals
            assert none.totals == raw.totals


def test_rows_judged_apart_and_merged_are_what_they_are_judged_together(tmp_path):
    (tmp_path / "visref.toml").write_text(
        'min_samples = 3\nlatency_frames = 1\n[[waive]]\nobject = "door"\nreason = "known"\n'
    )
    policy = read_policy(tmp_path / "visref.toml", today=TODAY)
    records = drawn_records(random.Random(11), 12)
    whole = judged_by(policy, records, range(12))
    for at, one in enumerate(records):
        parts = [replace(one, frames=one.frames[:5]), replace(one, frames=one.frames[5:])]
        merged = [row for part in parts for row in judged_by(policy, [part], range(12)).cullers]
        rows = [row for part in merged for row in part.frames]
        assert sum((row.verdict.counts for row in rows), Counts()) == whole.cullers[at].totals


CELL = {0: [miss(2, MissKind.CONFIRMED, 8, 1)]}


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("", "confirmed"),
        ("min_samples = 8", "confirmed"),
        ("min_samples = 9", "small"),
        ("latency_frames = 1", "confirmed"),
        ("latency_frames = 2", "late"),
        ("min_samples = 9\nlatency_frames = 2", "small"),
        ('latency_frames = 2\n[[waive]]\nobject = "door"\nreason = "r"', "late"),
        ('[[waive]]\nobject = "door"\nreason = "r"', "waived"),
        ('[[waive]]\nobject = "Door"\nreason = "r"', "confirmed"),
        ('[[waive]]\nobject = "house/door"\nreason = "r"', "waived"),
        # Expired, it still waives: the run fails by it, and no culler's status changes.
        ('[[waive]]\nobject = "door"\nreason = "r"\nexpires = 2026-05-16', "waived"),
    ],
)
def test_the_first_kind_that_holds_is_counted(text, kind, tmp_path):
    (tmp_path / "visref.toml").write_text(text)
    policy = read_policy(tmp_path / "visref.toml", today=TODAY)
    outcome = judged_by(policy, [record("pvs", CELL, Promise.CONSERVATIVE)], range(1))
    ((row,),) = [one.frames for one in outcome.cullers]
    assert row.verdict.misses[0].kind == kind
    assert outcome.cullers[0].ages() == {1: 1}


def test_an_object_without_an_age_is_never_late():
    cell = {0: [miss(2, MissKind.CONFIRMED, 8, None)]}
    records = [record("pvs", cell, Promise.CONSERVATIVE)]
    outcome = judged_by(Policy(latency_frames=1000), records, range(1))
    assert outcome.cullers[0].totals.confirmed == 1


@pytest.mark.parametrize(("share", "status"), [(0.5, 3), (0.59, 3), (0.6, 0), (1.0, 0)])
def test_how_much_may_stay_undecided_is_the_policys_to_say(share, status):
    made = record("pvs", {0: []}, Promise.CONSERVATIVE)
    counts = replace(made.frames[0].verdict.counts, undecided_samples=60)
    made.frames[0] = replace(made.frames[0], verdict=FrameVerdict(counts))
    outcome = judged_by(Policy(max_undecided=share), [made], range(1))
    assert outcome.exit == status


def test_a_stale_waiver_fails_the_run_and_no_culler(tmp_path):
    (tmp_path / "p").write_text('[[waive]]\nobject = "wall"\nreason = "gone"\n')
    policy = read_policy(tmp_path / "p", today=TODAY)
    outcome = judged_by(policy, [record("pvs", {0: []}, Promise.CONSERVATIVE)], range(1))
    assert outcome.cullers[0].status is Status.NO_VIOLATION_FOUND
    assert (outcome.status, outcome.exit) == (Status.VIOLATION, Exit.VIOLATION)
    told = verdict_json(outcome, scene())
    assert (told["status"], told["exit_status"]) == ("violation", 1)
    assert told["findings"][0]["severity"] == "error"


def test_a_waiver_is_not_stale_where_a_frame_that_it_covers_was_not_judged(tmp_path):
    (tmp_path / "p").write_text('[[waive]]\nobject = "wall"\nframes = "0:2"\nreason = "r"\n')
    policy = read_policy(tmp_path / "p", today=TODAY)
    some = judged_by(policy, [record("pvs", {0: []}, Promise.CONSERVATIVE)], range(2))
    assert some.exit is Exit.NO_VIOLATION
    failed = record("pvs", {0: [], 1: []}, Promise.CONSERVATIVE)
    failed.failed = True
    assert judged_by(policy, [failed], range(2)).exit is Exit.NOTHING_JUDGED
    # The path has no frame 1: all that it covers was judged.
    assert judged_by(policy, [record("pvs", {0: []}, Promise.CONSERVATIVE)], range(1)).exit == 1


def test_a_finding_that_the_policy_makes_an_error_fails_the_run(tmp_path):
    (tmp_path / "p").write_text('[severities]\nMISSED_TIE = "error"\nNO_TRIANGLES = "warning"\n')
    policy = read_policy(tmp_path / "p", today=TODAY)
    outcome = judged_by(policy, [record("pvs", {0: []}, Promise.CONSERVATIVE)], range(1))
    assert outcome.exit is Exit.NO_VIOLATION
    from visref.findings import Finding

    outcome.findings.append(Finding(Code.NO_TRIANGLES, "x"))
    assert outcome.exit is Exit.NO_VIOLATION
    outcome.findings.append(Finding(Code.MISSED_TIE, "x", "pvs"))
    assert outcome.exit is Exit.VIOLATION
    assert outcome.cullers[0].status is Status.NO_VIOLATION_FOUND


def test_a_first_adoption_waives_all_that_was_missed_once_reasons_are_filled_in(tmp_path):
    rng = random.Random(5)
    for _ in range(30):
        records = drawn_records(rng, 12)
        (tmp_path / "old.toml").write_text(rng.choice(["", "min_samples = 4"]))
        old = read_policy(tmp_path / "old.toml", today=TODAY)
        outcome = judged_by(old, records, range(12))
        text = to_toml(adopted(old, outcome, scene()))
        (tmp_path / "new.toml").write_text(text.replace('reason = ""', 'reason = "because"'))
        new = read_policy(tmp_path / "new.toml", today=TODAY)
        after = judged_by(new, records, range(12))
        assert after.exit is not Exit.VIOLATION
        assert not [one for one in after.findings if one.code is Code.STALE_WAIVER]


def test_spans_name_the_frames_that_they_were_made_of_and_no_other():
    rng = random.Random(1)
    for _ in range(50):
        frames = {rng.randrange(30) for _ in range(rng.randrange(1, 20))}
        spans = spans_of(frames)
        assert {f for f in range(40) if any(span.covers(f) for span in spans)} == frames
        assert list(spans) == sorted(spans, key=lambda span: span.start)
    assert list(map(str, spans_of([3, 5, 6, 7]))) == ["3", "5:8"]
    assert str(Span(2, None, 3)) == "2::3"
