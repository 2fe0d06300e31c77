"""The wheel, built and unpacked: what is in it, and that it works in a folder of somebody's that
holds packages named like ours."""

from __future__ import annotations

import os
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from configparser import ConfigParser
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent.parent
# Where a folder of the checkout lies in the wheel.
INSTALLED = {
    "visref": "visref",
    "culling": "visref_culling",
    "experiments": "visref_experiments",
    "datasets_gen": "visref_datasets_gen",
}

MINE = """
import numpy as np
from visref import Culler, DrawnSet

class Mine(Culler):
    name = "mine"

    def prepare(self, scene):
        self.everything = np.arange(scene.object_count)
        return scene.object_units()

    def cull(self, camera):
        return DrawnSet(self.everything)
"""


def build(target: str, folder: Path, source: Path = ROOT) -> Path:
    command = [sys.executable, "-m", "hatchling", "build", "-t", target, "-d", str(folder)]
    subprocess.run(command, cwd=source, check=True, capture_output=True)
    (file,) = folder.iterdir()
    return file


def names_in(wheel: Path) -> set[str]:
    with zipfile.ZipFile(wheel) as archive:
        return set(archive.namelist())


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    return build("wheel", tmp_path_factory.mktemp("wheel"))


def test_the_wheel_holds_our_folders_under_their_installed_names(wheel):
    names = names_in(wheel)
    (metadata,) = {name.partition("/")[0] for name in names} - {*INSTALLED.values()}
    assert metadata.endswith(".dist-info")
    for folder, installed in INSTALLED.items():
        files = {file for file in (ROOT / folder).rglob("*") if file.is_file()}
        relative = {file.relative_to(ROOT / folder).as_posix() for file in files}
        ours = {f"{installed}/{file}" for file in relative if "__pycache__" not in file}
        assert {name for name in names if name.startswith(f"{installed}/")} == ours
    assert {
        "visref/py.typed",
        "visref/schemas/verdict.json",
        "visref_culling/shaders/box.vert",
    } <= names


def test_entry_points_name_modules_that_are_in_the_wheel(wheel):
    names = names_in(wheel)
    with zipfile.ZipFile(wheel) as archive:
        (file,) = (name for name in names if name.endswith("entry_points.txt"))
        points = ConfigParser(delimiters="=")
        points.read_string(archive.read(file).decode())
    real = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert {*points.sections()} == {*real["entry-points"], "console_scripts"}
    for group in points.sections():
        for point in points[group].values():
            module = point.partition(":")[0].replace(".", "/")
            assert {f"{module}.py", f"{module}/__init__.py"} & names


def test_the_source_archive_builds_the_same_wheel_and_holds_no_private_file(wheel, tmp_path):
    with tarfile.open(build("sdist", tmp_path / "sdist")) as archive:
        archive.extractall(tmp_path / "source", filter="data")
    (source,) = (tmp_path / "source").iterdir()
    assert names_in(build("wheel", tmp_path / "wheel", source)) == names_in(wheel)
    # The builder reads `.gitignore` and takes it along.
    assert [file.name for file in source.rglob(".*")] == [".gitignore"]


@pytest.fixture(scope="module")
def elsewhere(wheel, tmp_path_factory):
    """An environment whose visref is the unpacked wheel, with no trace of the checkout."""
    site = tmp_path_factory.mktemp("site")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
    libraries = [path for path in sys.path if Path(path).name in ("site-packages", "dist-packages")]
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(site), *libraries])}


@pytest.fixture
def folder(tmp_path):
    """Somebody's folder, with packages named like our folders, a culler, and a module named like
    a library that we use."""
    raises = 'raise RuntimeError("this is the user\'s own")\n'
    for name, text in {"culling": "", "experiments": raises, "datasets_gen": raises}.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text(text)
    (tmp_path / "culling" / "mine.py").write_text(MINE)
    (tmp_path / "jinja2.py").write_text(raises)
    return tmp_path


def visref(elsewhere, folder, *arguments):
    # -S: an editable installation's `.pth` file would bring the checkout back.
    command = [sys.executable, "-S", "-m", "visref", *arguments]
    return subprocess.run(command, cwd=folder, env=elsewhere, capture_output=True, text=True)


def test_the_wheel_lists_its_cullers_in_a_folder_with_packages_named_like_ours(elsewhere, folder):
    ran = visref(elsewhere, folder, "cullers")
    assert (ran.returncode, ran.stderr) == (0, "")
    assert "occupancy-map  (conservative" in ran.stdout


@pytest.mark.slow
def test_the_wheel_judges_ours_and_the_users_cullers_in_such_a_folder(elsewhere, folder):
    """Slow: what numba compiles is compiled anew for the unpacked wheel."""
    scene = "city:scale=0.02,frames=1"
    cullers = ["--culler", "frustum", "--culler", "culling.mine:Mine"]
    ran = visref(elsewhere, folder, "run", scene, *cullers, "--pictures", "0", "--out", "run")
    assert (ran.returncode, ran.stderr) == (0, "")
    lines = ran.stdout.splitlines()
    for spec in ("frustum", "culling.mine:Mine"):
        (line,) = (line for line in lines if line.startswith(spec))
        assert line.endswith("no violation found")
    assert (folder / "run" / "verdict.json").is_file()


def test_pytest_finds_the_wheels_plug_in_and_has_nothing_to_warn_of(elsewhere, tmp_path):
    (tmp_path / "test_theirs.py").write_text("def test_it(visref_scene): visref_scene('a.glb')\n")
    program = (
        "import sys, visref, pytest\n"
        "sys.exit(pytest.main(['-q', '-W', 'error', '-p', 'no:dash', '-p', 'no:cacheprovider']))"
    )
    command = [sys.executable, "-S", "-c", program]
    ran = subprocess.run(command, cwd=tmp_path, env=elsewhere, capture_output=True, text=True)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    assert "1 passed" in ran.stdout
