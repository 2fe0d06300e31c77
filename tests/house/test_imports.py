"""The import contracts of pyproject.toml hold, and each sees what it claims to forbid.

An import is planted in the graph of the whole tree, and the contracts are asked as `lint-imports`
asks them. One test goes all the way, with a line of source in a copy of the tree.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterable
from copy import deepcopy
from pathlib import Path

import grimp
import pytest
from importlinter.api import read_configuration
from importlinter.contracts.acyclic_siblings import AcyclicSiblingsContract
from importlinter.contracts.forbidden import ForbiddenContract
from importlinter.contracts.layers import LayersContract

from tests.house.sees_only import SeesOnlyContract

ROOT = Path(__file__).parent.parent.parent
CONFIGURATION = read_configuration(str(ROOT / "pyproject.toml"))
OPTIONS = CONFIGURATION["session_options"]
CONTRACTS = {options["name"]: options for options in CONFIGURATION["contracts_options"]}
TYPES = {
    "acyclic_siblings": AcyclicSiblingsContract,
    "forbidden": ForbiddenContract,
    "layers": LayersContract,
    "sees_only": SeesOnlyContract,
}

LAYERS = "visref: arrows point down, from the command line to the words"
ACYCLIC = "no folder needs another that needs it"
NO_GL = "visref needs neither GL nor what it judges"
JUDGE = "a judge sees the words, the exact tests and what a truth engine is"
CULLING = "culling sees the words, and of the effects what is drawn"
SCENES = "scene generators see scene, camera and path"
EXPERIMENTS = "experiments see culling, the words and the judges of effects"

# (contract, importer, imported): each such import breaks that contract.
PLANTS = [
    (LAYERS, "visref.scene", "visref.culler"),
    (LAYERS, "visref.exact.scene", "visref.engines.rays"),
    (LAYERS, "visref.engines.base", "visref.judging.judge"),
    (LAYERS, "visref.judging.judge", "visref.run_folder.write"),
    (LAYERS, "visref.run_folder.explain", "visref.report.words"),
    (LAYERS, "visref.trials.hardcases", "visref.cli.main"),
    (LAYERS, "visref.between.search", "visref.effects.images"),  # side by side
    (LAYERS, "visref.inputs", "visref.paths.looking"),
    (LAYERS, "visref.camera_forms", "visref.camera_path"),
    (LAYERS, "visref.workers", "visref.cluster.running"),
    (LAYERS, "visref.cluster.task", "visref.report.words"),
    (LAYERS, "visref.batch.running", "visref.cli.main"),
    (ACYCLIC, "visref_culling.queries.occlusion_query", "visref_culling.n_buffer.depth_map"),
    (ACYCLIC, "visref_culling.gl.geometry", "visref_culling.boxes.rectangles"),
    (ACYCLIC, "visref_culling.method", "visref_culling.plp.octree"),
    (ACYCLIC, "visref.judging.disputes", "visref.judging.referee"),
    (ACYCLIC, "visref_datasets_gen.graph", "visref_datasets_gen.city"),
    (NO_GL, "visref.judging.judge", "moderngl"),
    (NO_GL, "visref.engines.rays", "glcontext"),
    (NO_GL, "visref.judging.judge", "visref_culling.gl.device"),
    (NO_GL, "visref.trials.hardcases", "visref_datasets_gen.hard"),
    (NO_GL, "visref.tables.runs", "visref_experiments.timing"),
    (JUDGE, "visref.judging.referee", "visref.engines.embree"),
    (JUDGE, "visref.judging.judge", "visref.formats.loading"),
    (JUDGE, "visref.engines.base", "visref.engines.rays"),  # through what it may see
    (CULLING, "visref_culling.baselines", "visref.exact"),
    (CULLING, "visref_culling.baselines", "visref.engines.embree"),
    (CULLING, "visref_culling.n_buffer.particles", "visref.effects.sprite_truth"),
    (CULLING, "visref_culling.shadow_volumes.casters", "visref.effects.shadow_truth"),
    (CULLING, "visref_culling.method", "visref.judging.judge"),
    (CULLING, "visref_culling.method", "visref.conformance"),
    (CULLING, "visref_culling.method", "visref_experiments.timing"),
    (CULLING, "visref_culling.method", "visref_datasets_gen.shapes"),
    (CULLING, "visref.effects.light", "visref.effects.images"),  # through what it may see
    (SCENES, "visref_datasets_gen.city", "visref.visibility"),
    (SCENES, "visref_datasets_gen.hard.stage", "visref.visibility"),
    (SCENES, "visref_datasets_gen.orbit", "visref_culling.gl.view"),
    (EXPERIMENTS, "visref_experiments.plp", "visref.judging.judge"),
    (EXPERIMENTS, "visref_experiments.particles", "visref.exact"),
    (EXPERIMENTS, "visref_experiments.timing", "visref_datasets_gen.city"),
]


@pytest.fixture(scope="module")
def tree() -> grimp.ImportGraph:
    """What imports what, everywhere in the tree: inside of functions and for types alone too."""
    return grimp.build_graph(
        *OPTIONS["root_packages"], include_external_packages=True, cache_dir=None
    )


def broken(graph: grimp.ImportGraph, names: Iterable[str] = CONTRACTS) -> list[str]:
    """The contracts, of those named, that an import graph breaks."""
    found = []
    for name in names:
        contract = TYPES[CONTRACTS[name]["type"]](name, OPTIONS, CONTRACTS[name])
        if not contract.check(deepcopy(graph), verbose=False).kept:
            found.append(name)
    return found


def test_every_contract_holds(tree):
    assert broken(tree) == []


def test_every_contract_has_an_import_planted_here():
    assert {contract for contract, _, _ in PLANTS} == set(CONTRACTS)


@pytest.mark.parametrize(("contract", "importer", "imported"), PLANTS)
def test_planted_import_breaks_the_contract(tree, contract, importer, imported):
    # A plant between modules that are gone would prove nothing.
    assert {importer, imported} <= tree.modules
    assert not tree.direct_import_exists(importer=importer, imported=imported)
    graph = deepcopy(tree)
    graph.add_import(importer=importer, imported=imported)
    assert broken(graph, [contract]) == [contract]


@pytest.mark.parametrize("name", ["visref.novelty", "visref.novelty.module"])
def test_new_folder_is_in_no_layer_until_it_is_given_one(tree, name):
    graph = deepcopy(tree)
    graph.add_module("visref.novelty")
    graph.add_module(name)
    assert broken(graph, [LAYERS]) == [LAYERS]


@pytest.mark.parametrize(
    ("contract", "importer"),
    [(CULLING, "visref_culling.method"), (SCENES, "visref_datasets_gen.city"),
     (JUDGE, "visref.judging.judge"), (EXPERIMENTS, "visref_experiments.plp")],
)  # fmt: skip
def test_new_folder_is_out_of_sight_until_it_is_allowed(tree, contract, importer):
    graph = deepcopy(tree)
    graph.add_module("visref.novelty")
    graph.add_import(importer=importer, imported="visref.novelty")
    assert broken(graph, [contract]) == [contract]


@pytest.mark.parametrize(
    ("file", "line", "contract"),
    [
        ("visref/judging/judge.py", "import moderngl", NO_GL),
        ("culling/baselines.py", "from visref.exact import ExactScene", CULLING),
        ("culling/baselines.py", "def f():\n    from visref.exact import ExactScene", CULLING),
    ],
)
def test_line_planted_in_the_source_fails_lint_imports(tmp_path, file, line, contract):
    without = shutil.ignore_patterns("__pycache__")
    for folder in ("visref", "culling", "experiments", "datasets_gen", "tests/house"):
        shutil.copytree(ROOT / folder, tmp_path / folder, ignore=without)
    shutil.copytree(ROOT / "installed", tmp_path / "installed", symlinks=True)
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    planted = tmp_path / file
    planted.write_text(planted.read_text(encoding="utf-8") + f"\n\n{line}\n", encoding="utf-8")
    # Before what is installed, so that the copy is what is read.
    path = os.pathsep.join([str(tmp_path), str(tmp_path / "installed")])
    result = subprocess.run(
        [sys.executable, "-c", "from importlinter.cli import lint_imports_command as c; c()",
         "--no-cache"],
        cwd=tmp_path, env={**os.environ, "PYTHONPATH": path, "COLUMNS": "200"},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert result.returncode == 1, result.stdout + result.stderr
    assert f"{contract} BROKEN" in result.stdout
    assert "1 broken" in result.stdout
