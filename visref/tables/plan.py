"""What has to be run for which paper, in which order, and on which frames of a path."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from visref.camera_path import CameraPath, Frame, middles
from visref.papers import Paper
from visref.papers.contents import Experiment, JudgedRun
from visref.registry import CULLERS, SCENES, available

EXPERIMENTS = "visref.experiments"
# What a path counts whose frames are not known yet, and an experiment.
PATH_STEPS = 100
EXPERIMENT_STEPS = 20
_SOURCES = (".py", ".vert", ".frag", ".comp", ".geom", ".glsl")


@dataclass(frozen=True)
class Task:
    """One thing to run for a paper."""

    paper: str
    work: JudgedRun | Experiment

    @property
    def label(self) -> str:
        return f"{self.paper}/{self.work.key}"


def tasks(papers: Iterable[Paper], *, large: bool, seed: int = 0) -> list[Task]:
    """All that the papers need, those of one scene together, so that it is read once; the
    large scenes last. Scenes are generated with `seed`; 0 is their own."""
    found: list[Task] = []
    for paper in papers:
        work: tuple[JudgedRun | Experiment, ...] = (*paper.runs, *paper.experiments)
        found += [
            Task(paper.name, replace(one, scene=seeded(one.scene, seed)))
            for one in work
            if large or not one.large
        ]
    first: dict[str | None, int] = {}
    for place, task in enumerate(found):
        first.setdefault(task.work.scene, place)
    return sorted(found, key=lambda task: (task.work.large, first[task.work.scene]))


def side_by_side(todo: Sequence[Task], frames: int | None) -> list[list[Task]]:
    """What may be measured at once: those of one scene together, one after the other, and those
    with most to do first. Without what is to be measured alone, and what is large."""
    groups: dict[str | None, list[Task]] = {}
    for task in todo:
        if not (task.work.alone or task.work.large):
            groups.setdefault(task.work.scene, []).append(task)
    return sorted(groups.values(), key=lambda group: -sum(steps(task, frames) for task in group))


def steps(task: Task, frames: int | None) -> int:
    """How much there is to do: of a run a step is one culler's frame."""
    if isinstance(task.work, Experiment):
        return EXPERIMENT_STEPS
    return len(task.work.cullers) * (frames or PATH_STEPS)


def seeded(scene: str | None, seed: int) -> Any:
    """A generated scene's spec with another seed, unless it names its own."""
    if scene is None or not seed or "seed=" in scene:
        return scene
    return f"{scene}{',' if ':' in scene else ':'}seed={seed}"


def sampled(count: int, wanted: int | None, stretch: int, shift: float = 0.0) -> list[int]:
    """Frames of a path of `count`: `wanted` of them, all for None, spread evenly in stretches of
    `stretch` consecutive ones. Ascending, without repeats. `shift`, from -0.5 to 0.5: by what part
    of the way from one stretch to the next they are moved along the path."""
    if wanted is None or wanted >= count:
        return list(range(count))
    parts = -(-wanted // stretch)
    moved = round(shift * count / parts)
    starts = [min(max(start + moved, 0), count - 1) for start in middles(count, parts)]
    frames = {min(start + k, count - 1) for start in starts for k in range(stretch)}
    return sorted(frames)[:wanted]


def cut_path(path: CameraPath, frames: Sequence[int]) -> CameraPath:
    """The path, with a cut marked at every picked frame whose predecessor was not picked: what a
    temporal method remembers is not the frame before."""
    picked = set(frames)
    marked: list[Frame] = []
    for index, frame in enumerate(path.frames):
        if index in picked and index - 1 not in picked:
            cameras = tuple(replace(camera, cut=True) for camera in frame.cameras)
            frame = replace(frame, cameras=cameras)
        marked.append(frame)
    return CameraPath(marked, path.source)


def code_digest(packages: Iterable[str] | None = None) -> str:
    """A digest of the sources of packages, by default of visref and all that it finds by name: a
    result or a scene that other code made is made anew."""
    if packages is None:
        points = [p for group in (CULLERS, EXPERIMENTS, SCENES) for p in available(group).values()]
        packages = {"visref", *(point.module.partition(".")[0] for point in points)}
    digest = hashlib.sha256()
    for package in sorted(packages):
        spec = find_spec(package)
        for folder in spec.submodule_search_locations or () if spec is not None else ():
            files = (file for file in Path(folder).rglob("*") if file.suffix in _SOURCES)
            for file in sorted(files):
                digest.update(str(file.relative_to(folder)).encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()[:16]
