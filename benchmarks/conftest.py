"""What the benchmarks share: their sizes, turns, and what the JSON says of machine and versions."""

from __future__ import annotations

import platform
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import pytest

from benchmarks.measuring import Turns
from benchmarks.scenes import QUICK, Sizes
from visref.threads import available_threads

PACKAGES = (
    *("visref", "numpy", "numba", "embreex", "open3d-cpu", "open3d", "mitsuba", "moderngl"),
    "pytest-benchmark",
)


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("visref's benchmarks")
    group.addoption("--quick", action="store_true", help="tiny inputs and one round: a rehearsal")
    group.addoption(
        "--scene", type=Path, help="a scene file for run and check, not a generated one"
    )
    group.addoption("--before", type=Path, help="the `visref` of another checkout, to compare with")


@pytest.fixture(scope="session")
def quick(request: pytest.FixtureRequest) -> bool:
    return bool(request.config.getoption("--quick"))


@pytest.fixture(scope="session")
def sizes(quick: bool) -> Sizes:
    return QUICK if quick else Sizes()


@pytest.fixture
def turns(benchmark: Any, quick: bool) -> Iterator[Turns]:
    return Turns(benchmark, quick)


def pytest_benchmark_update_machine_info(
    config: pytest.Config, machine_info: dict[str, Any]
) -> None:
    """What bears on speed, and not what the machine is called."""
    cpu = machine_info.get("cpu", {})
    machine_info.clear()
    machine_info.update(
        cpu=cpu.get("brand_raw", platform.processor() or "unknown"),
        cores=available_threads(),
        avx512="avx512f" in cpu.get("flags", []),
        system=platform.system(),
        machine=platform.machine(),
        python_version=platform.python_version(),
        versions={name: found for name in PACKAGES if (found := _version(name))},
        quick=bool(config.getoption("--quick")),
    )


def pytest_benchmark_update_commit_info(config: pytest.Config, commit_info: dict[str, Any]) -> None:
    for name in set(commit_info) - {"id", "time", "dirty"}:
        del commit_info[name]


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return ""
