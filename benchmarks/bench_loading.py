"""Loading: a file of very many nodes, one of very many instances, and the engine's build."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest

from benchmarks.measuring import Job, Skipped, Turns, command
from benchmarks.scenes import Sizes, write_instances, write_tree

LOADING = Path(__file__).with_name("loading.py")


@pytest.fixture(scope="session")
def pythons(request: pytest.FixtureRequest) -> dict[str, Path]:
    result = {"": Path(sys.executable)}
    before = request.config.getoption("--before")
    if before is not None:
        result["before: "] = before.with_name("python")
    return result


def loading(told: dict[str, Any], title: str, *words: object) -> Job:
    def job() -> None:
        told[title] = json.loads(command(*words))

    return job


def test_many_nodes(pythons, tmp_path, turns: Turns, sizes: Sizes) -> None:
    scene = write_tree(tmp_path / "tree.glb", sizes.nodes)
    told: dict[str, Any] = {}
    jobs: dict[str, Job | Skipped] = {
        f"{title}load_scene": loading(told, title, python, LOADING, scene)
        for title, python in pythons.items()
    }
    turns.run("loading", f"{sizes.nodes:,} nodes", jobs, rounds=2, warm=False)
    for title, one in told.items():
        turns.say(
            **{
                f"{title}µs per node": 1e6 * one["load_s"] / sizes.nodes,
                f"{title}bytes per node": one["load_bytes"] / sizes.nodes,
            }
        )


def test_many_instances(pythons, tmp_path, turns: Turns, sizes: Sizes) -> None:
    scene = write_instances(tmp_path / "instances.glb", sizes.instanced_triangles)
    told: dict[str, Any] = {}
    jobs: dict[str, Job | Skipped] = {
        f"{title}load_scene and Embree's build": loading(
            told, title, python, LOADING, scene, "build"
        )
        for title, python in pythons.items()
    }
    name = f"{sizes.instanced_triangles:,} triangles of instances"
    turns.run("loading", name, jobs, rounds=2, warm=False)
    for title, one in told.items():
        turns.say(
            **{
                f"{title}s to load": one["load_s"],
                f"{title}s to build": one["build_s"],
                f"{title}bytes per triangle, loaded": one["load_bytes"] / one["triangles"],
                f"{title}and with the build": one["build_bytes"] / one["triangles"],
            }
        )
