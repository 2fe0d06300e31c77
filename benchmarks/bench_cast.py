"""From a camera to samples per object: our engines, and the same job in other libraries."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.measuring import Job, Skipped, Turns
from benchmarks.page import DIFFERING
from benchmarks.peers import peers_of
from benchmarks.scenes import NINE, Sizes, one_of_nine
from visref.camera import Camera
from visref.engines.embree import EmbreeEngine
from visref.engines.exact import ExactEngine
from visref.scene import Alpha
from visref.visibility import objects_seen


def over(views: list[Camera], counts: Callable[[Camera], object]) -> Job:
    def job() -> None:
        for view in views:
            counts(view)

    return job


@pytest.mark.parametrize("name", NINE)
def test_cast(name: str, sizes: Sizes, turns: Turns, quick: bool) -> None:
    scene, views = one_of_nine(name, sizes.image, small=quick)
    engines = {"Embree": EmbreeEngine(scene), "exact": ExactEngine(scene)}
    jobs: dict[str, Job | Skipped] = {
        f"visref {title}": over(
            views, lambda view, engine=engine: objects_seen(engine.frame(view), scene)
        )
        for title, engine in engines.items()
    }
    ours = [objects_seen(engines["Embree"].frame(view), scene).samples for view in views]
    differing = {}
    for title, peer in peers_of(scene).items():
        if isinstance(peer, Skipped):
            jobs[title] = peer
            continue
        theirs = [peer.counts(view) for view in views]
        off = sum(np.abs(a - b).sum() for a, b in zip(ours, theirs, strict=True))
        differing[title] = 1e6 * off / sum(view.samples for view in views)
        jobs[title] = over(views, peer.counts)
    turns.run("cast", f"{name}, {scene.triangle_count:,} triangles", jobs, rounds=2)
    turns.say(**{f"{title}: {DIFFERING}": off for title, off in differing.items()})
    for engine in engines.values():
        engine.close()


def test_masks(sizes: Sizes, turns: Turns, quick: bool) -> None:
    """What masks cost: the same cards as solid ones."""
    masked, views = one_of_nine("leaves", sizes.image, small=quick)
    alpha = np.where(masked.alpha == Alpha.MASK, Alpha.OPAQUE, masked.alpha)
    scenes = {"solid": replace(masked, alpha=alpha, masks=None), "masked": masked}
    engines = {title: EmbreeEngine(scene) for title, scene in scenes.items()}
    jobs: dict[str, Job | Skipped] = {
        f"cards {title}": over(
            views,
            lambda view, title=title: objects_seen(engines[title].frame(view), scenes[title]),
        )
        for title in scenes
    }
    turns.run("masks", f"leaves, {masked.triangle_count:,} triangles", jobs, rounds=9)
    for engine in engines.values():
        engine.close()
