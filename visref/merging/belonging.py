"""Whether parts are those of one run, all of them, each once."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from visref.judging.outcome import finding_json
from visref.merging.reading import PartFolder
from visref.picking import Shard, Stretch

SAME_FIX = "merge the parts of one run: the same command, but for --shard and --out"


def in_order(parts: Sequence[PartFolder]) -> list[PartFolder]:
    """The parts in the order of their frames. Raises InputError, which names the folder and what is
    otherwise, unless they are the parts of one run, all of them."""
    first = parts[0]
    for part in parts[1:]:
        for difference in _differences(first, part):
            raise part.error(f"{difference} than {first.folder}", fix=SAME_FIX)
    if isinstance(first.said.shard, Stretch):
        return _stretches_in_order(parts)
    by_number: dict[int, PartFolder] = {}
    for part in parts:
        shard = part.said.shard
        assert isinstance(shard, Shard)
        if shard.number in by_number:
            other = by_number[shard.number].folder
            raise part.error(f"it is shard {shard}, and so is {other}", fix="give each shard once")
        by_number[shard.number] = part
    assert isinstance(first.said.shard, Shard)
    count = first.said.shard.count
    missing = [number for number in range(1, count + 1) if number not in by_number]
    if missing:
        named = ", ".join(f"{number}/{count}" for number in missing[:10])
        more = f" and {len(missing) - 10} more" if len(missing) > 10 else ""
        raise first.error(
            f"of the {count} shards of its run these are missing: {named}{more}",
            fix="give the folders of all shards",
        )
    return [by_number[number] for number in sorted(by_number)]


def _stretches_in_order(parts: Sequence[PartFolder]) -> list[PartFolder]:
    place = 0
    ordered = sorted(parts, key=lambda part: _start(part.said.shard))
    for part in ordered:
        stretch = part.said.shard
        assert isinstance(stretch, Stretch)
        if stretch.start != place:
            said = f"it begins with the frame at place {stretch.start}, and the one before it"
            raise part.error(f"{said} ends before place {place}", fix=SAME_FIX)
        place = stretch.stop
    if place != len(ordered[-1].said.frames):
        raise ordered[-1].error("what follows it is missing", fix=SAME_FIX)
    return ordered


def _start(share: Shard | Stretch) -> int:
    return share.start if isinstance(share, Stretch) else 0


@dataclass(frozen=True)
class _Said:
    """Something that is the same in all parts of a run, and what to say where it is not."""

    value: object
    problem: str


def _differences(first: PartFolder, part: PartFolder) -> Iterator[str]:
    for one, other in zip(_common(first), _common(part), strict=True):
        if one.value != other.value:
            yield one.problem
    for facts in part.said.cullers:
        known = next((one for one in first.said.cullers if one.name == facts.name), None)
        if known is None:
            yield f"it judges another culler, '{facts.name}',"
            continue
        # Of a culler that could not be prepared nothing is known.
        if not (known.failed or facts.failed) and (
            (known.promise, known.unit_kind, known.units)
            != (facts.promise, facts.unit_kind, facts.units)
        ):
            yield f"its culler '{facts.name}' has another promise or other units"


def _common(part: PartFolder) -> Iterator[_Said]:
    manifest, said = part.manifest, part.said
    yield _Said(manifest["scene"]["sha256"], "it is of another scene")
    yield _Said(manifest["path"]["sha256"], "it is of another path")
    if isinstance(said.shard, Stretch):
        # A stretch has the samples of its own frames.
        yield _Said(0, "it is one of another number of shards")
        yield _Said(None, "it is of another path")
    else:
        count = said.shard.count
        yield _Said(count, f"it is one of another number of shards ({count})")
        yield _Said(manifest["samples"], "it is of another path")
    yield _Said(said.frames, "it is of a run over other frames")
    yield _Said(manifest["engine"], "its truth is of another engine")
    yield _Said(manifest["exact"], "its truth is of another engine")
    yield _Said(_settings(manifest), "it was run with other settings")
    yield _Said(said.pictures, "it was run with another number of pictures")
    yield _Said(_policy(manifest), "it was judged by another policy")
    yield _Said(manifest["versions"], "it was run with other versions of visref or its libraries")
    yield _Said([one.name for one in said.cullers], "it judges other cullers, or in another order,")
    yield _Said(len(said.again), "it was asked another number of times")
    truth = part.truth.facts.get("digest") if said.truth and part.truth is not None else None
    yield _Said((said.truth, truth), "it went by another truth file")
    inputs = said.inputs
    every = (inputs.misaligned, inputs.notes, inputs.recorded, said.remarks)
    yield _Said(
        ([[finding_json(one) for one in found] for found in every], inputs.excused),
        "it found other things of its inputs",
    )


def _settings(manifest: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in manifest["settings"].items() if name != "shard"}


def _policy(manifest: dict[str, Any]) -> dict[str, Any] | None:
    """Where it lies, and on which day it was asked, is each part's own."""
    policy = manifest.get("policy")
    if policy is None:
        return None
    return {name: value for name, value in policy.items() if name not in ("today", "source")}
