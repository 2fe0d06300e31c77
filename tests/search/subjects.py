"""Who the benchmark looks for faults in: every unsafe mutant that a verdict can convict, and every
wrong culler; and a quick way to try many of them on one case whose truth is cast once."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.mutants.harness import Mutant, suites
from tests.wrong_cullers import RIGHT, WRONG
from visref.camera_path import CameraPath
from visref.conformance.building import Case as Laid
from visref.conformance.suite import NotForThis, exact_truths, judged_on
from visref.culler import Culler, check_drawn
from visref.errors import NothingToJudge
from visref.scene import Scene
from visref.search.case import Case
from visref.timeline import Timeline
from visref.visibility import FrameTruth

# Judged by images, not by what is drawn: a search for missed objects is not about them.
EFFECTS = ("particles", "shadow_volumes")


@dataclass(frozen=True)
class Subject:
    """A wrong culler. `fault`: what is wrong with it, the same for all methods that are wrong so;
    `about`: that in words; `moves`: whether it can judge scenes that move."""

    name: str
    fault: str
    about: str
    make: Callable[[], Culler]
    moves: bool


def subjects() -> list[Subject]:
    """All of them, in the order of their suites."""
    found = []
    for module, suite in suites().items():
        if module.split(".")[2] not in EFFECTS:
            found += [_of_mutant(mutant) for mutant in suite.mutants if mutant.caught_by]
    for name, wrong in WRONG.items():
        culler = wrong.culler
        found.append(Subject(f"wrong {name}", f"wrong {name}", wrong.rule, culler, _moves(culler)))
    return found


def _of_mutant(mutant: Mutant) -> Subject:
    family = mutant.method.name if mutant.id.startswith(("U", "W")) else ""
    fault = " ".join(filter(None, (mutant.id, mutant.culler.__name__, family and _suite(mutant))))
    return Subject(str(mutant), fault, mutant.about, mutant.make, _moves(mutant.culler))


def _suite(mutant: Mutant) -> str:
    return mutant.suite.methods[0].name


def _moves(culler: type[Culler]) -> bool:
    return culler.update is not Culler.update


def sound() -> list[Subject]:
    """The sound methods that the mutants were made of, and the right cullers: nothing is to be
    found in them."""
    found = {}
    for module, suite in suites().items():
        if module.split(".")[2] not in EFFECTS:
            for method in suite.methods:
                name = f"{method} {method.culler.__name__}"
                found[name] = Subject(name, "", "", method.make, _moves(method.culler))
    for name, culler in RIGHT.items():
        found[f"right {name}"] = Subject(f"right {name}", "", "", culler, _moves(culler))
    return list(found.values())


@dataclass(eq=False)
class Trial:
    """A case as many cullers are tried on it."""

    scene: Scene
    path: CameraPath

    @classmethod
    def of(cls, case: Case) -> Trial:
        inputs = case.inputs()
        return cls(inputs.scene, inputs.path)

    @cached_property
    def truths(self) -> tuple[FrameTruth, ...]:
        return exact_truths(Laid(self.scene, self.path))

    @cached_property
    def timeline(self) -> Timeline:
        return Timeline(self.scene, self.path)

    @cached_property
    def scenes(self) -> list[Scene]:
        return [self.timeline.at(frame) for frame in self.path.numbers]

    @cached_property
    def needed(self) -> list[list[NDArray[np.bool_]]]:
        """By frame and view, (t,) bool, the triangles that are or may be visible: who draws all
        of them loses no sample."""
        truths = iter(self.truths)
        return [
            [_may_be_visible(scene, next(truths)) for _ in frame.cameras]
            for scene, frame in zip(self.scenes, self.path.frames, strict=True)
        ]

    def problem(self, subject: Subject) -> str:
        """What a verdict says against a subject, "" where it says nothing."""
        if self.timeline.moves and not subject.moves:
            return ""
        if self._draws_all(subject):
            return ""
        try:
            said = judged_on(subject.make, Laid(self.scene, self.path), self.truths)
        except NotForThis:
            return ""
        return said.problems[0] if said.problems else ""

    def _draws_all(self, subject: Subject) -> bool:
        """Whether a culler that may draw what is hidden draws all that is needed, so that a
        referee need not be asked."""
        culler = subject.make()
        try:
            if culler.joint or not culler.promise.may_draw_hidden:
                return False
            scene = self.scenes[0]
            units = culler.prepare(scene.handed_out())
            if culler.joint or not culler.promise.may_draw_hidden:
                return False
            for at, frame in enumerate(self.path.frames):
                if self.scenes[at] is not scene:
                    scene = self.scenes[at]
                    culler.update(scene.handed_out())
                for camera, needed in zip(frame.cameras, self.needed[at], strict=True):
                    ids = check_drawn(culler.cull(camera.handed_out()), units)
                    drawn = np.zeros(scene.triangle_count, np.bool_)
                    drawn[units.gather(ids)] = True
                    if (needed & ~drawn).any():
                        return False
        except NothingToJudge:
            raise
        except Exception:  # whatever a wrong culler raises, the referee says
            return False
        else:
            return True
        finally:
            culler.close()


def _may_be_visible(scene: Scene, truth: FrameTruth) -> NDArray[np.bool_]:
    """(t,) bool, the triangles that are visible, or may be."""
    owner = truth.buffer.triangle
    visible = np.zeros(scene.triangle_count, np.bool_)
    for found in (
        *(owner[owner >= 0], truth.ties.triangle, truth.doubt.triangle, truth.blend.triangle),
        truth.veiled,
    ):
        visible[found] = True
    return visible


def by_fault(found: Mapping[str, Any], every: list[Subject]) -> dict[str, list[Any]]:
    """What is known of each subject (None where nothing is), by fault."""
    result: dict[str, list[Any]] = {}
    for one in every:
        result.setdefault(one.fault, []).append(found.get(one.name))
    return result
