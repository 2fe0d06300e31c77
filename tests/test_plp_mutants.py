"""Every broken cPLP is caught where it should be, and the sound one passes there."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np
import pytest

from culling.plp.traversal import LEAST_WEIGHT, near_corners
from culling.view import View
from tests.bad_cullers import COMMON
from tests.bad_plp import ALL, EQUIVALENT, MUTANTS, NOT_HERE, OF_THE_METHOD, OWN
from visref.conformance import Check, Status, _judge_on, case, check_culler, conformance_checks

pytestmark = pytest.mark.gl

CHECKS = {check.name: check for check in conformance_checks()}
CHECKS |= {m.name: Check(m.name, m.claim, m.trap, _judge_on(m)) for m in OWN.values()}
UNSAFE = [mutant for mutant in MUTANTS if mutant.caught_by]
WASTEFUL = [mutant for mutant in MUTANTS if mutant.contract]


@cache
def sound_result(method, check, options):
    sound = {m.name: m for m in ALL}[method]
    return check_culler(lambda: sound.culler(**dict(options)), checks=[CHECKS[check]])[0]


@pytest.mark.parametrize("mutant", UNSAFE, ids=str)
def test_unsafe_mutant_is_convicted_and_the_sound_method_is_not(mutant):
    (found,) = check_culler(mutant.make, checks=[CHECKS[mutant.caught_by]])
    assert found.status is Status.FAILED
    assert found.missed > 0
    assert "MISSED_OBJECT" in found.problems[0]
    options = tuple(sorted(mutant.options.items()))
    sound = sound_result(mutant.method.name, mutant.caught_by, options)
    assert sound.status is Status.PASSED, sound.problems


# The contracts.


def watched(culler, scene, path) -> list[str]:
    """A line for each departure from what cPLP promises to save, over a path."""
    units = culler.prepare(scene)
    steps: list[tuple[str, dict]] = []
    culler.observer = lambda step, data: steps.append((step, dict(data)))
    problems = []
    for camera in path:
        steps.clear()
        answer = culler.cull(camera)
        for check in (no_cell_is_asked_twice, cells_come_in_the_order_of_their_occlusion):
            problems += [f"{check.__name__}: {line}" for line in check(culler, camera, steps)]
        drawn = units.mask(answer.unit_ids, scene.triangle_count).sum()
        if answer.stats.triangles_drawn != drawn:
            line = f"{answer.stats.triangles_drawn} drawn of {drawn}"
            problems.append(f"no_triangle_is_drawn_twice: {line}")
    culler.close()
    return problems


def no_cell_is_asked_twice(culler, camera, steps) -> Iterator[str]:
    asked = [unit for step, data in steps if step == "query" for unit in data["units"].tolist()]
    if len(asked) != len(set(asked)):
        yield f"{len(asked) - len(set(asked))} questions too many"


def cells_come_in_the_order_of_their_occlusion(culler, camera, steps) -> Iterator[str]:
    (found,) = [data["cells"].tolist() for step, data in steps if step == "estimate"]
    expected = plp_by_hand(culler.octree, culler.leaf, culler.budget, camera, culler.scene)
    if found != expected:
        yield f"{found[:8]}, not {expected[:8]}"


def plp_by_hand(octree, limit, budget, camera, scene) -> list[int]:
    """The docstring of `culling.plp.traversal`, from pairs of boxes that touch, in plain Python."""
    view = View.of(camera, scene, 8)
    bounds, units = octree.bounds, octree.units
    boxes = view.inflated(bounds)
    seen, sure = view.meets_frustum(boxes), view.needs_no_query(boxes)
    corners, high = near_corners(view), octree.low + octree.side
    occlusion: dict[int, tuple[float, float]] = {}
    done: list[int] = []
    drawn: set[int] = set()
    for cell in np.flatnonzero(seen):
        faces = [
            (bounds[cell, 0, a] == octree.low[a] and (corners[:, a] < octree.low[a]).any())
            or (bounds[cell, 1, a] == high[a] and (corners[:, a] > high[a]).any())
            for a in range(3)
        ]
        if sure[cell] or any(faces):
            occlusion[int(cell)] = (0.0, 0.0)

    def mean(cell: int) -> float:
        total, weight = occlusion[cell]
        return total / max(weight, LEAST_WEIGHT)

    def cost(cell: int) -> float:
        middle = bounds[cell].mean(axis=0) - camera.eye
        along = middle @ camera.forward
        return mean(cell) + np.log(np.linalg.norm(middle) if camera.is_perspective else along)

    front = set(occlusion)
    while front:
        best = min(front, key=lambda cell: (cost(cell), cell))
        own = set(units.triangles[units.offsets[best] : units.offsets[best + 1]].tolist())
        if len(drawn | own) > budget:
            break
        drawn |= own
        done.append(best)
        front.remove(best)
        passed = mean(best) + min(len(own) / limit, 1.0)
        for other in np.flatnonzero(seen):
            face = common_face(bounds[best], bounds[other])
            if face is None or other in done:
                continue
            axis, sign, middle = face
            way = middle - camera.eye if camera.is_perspective else camera.forward
            light = max(sign * way[axis] / np.linalg.norm(way), LEAST_WEIGHT)
            total, weight = occlusion.get(int(other), (0.0, 0.0))
            occlusion[int(other)] = (total + light * passed, weight + light)
            front.add(int(other))
    return done


def common_face(a, b):
    """Axis, direction from a to b and middle of the face that two boxes share, or None."""
    low, high = np.maximum(a[0], b[0]), np.minimum(a[1], b[1])
    flat = low == high
    if (low > high).any() or flat.sum() != 1:
        return None
    axis = int(np.argmax(flat))
    return axis, 1.0 if b[0, axis] == a[1, axis] else -1.0, (low + high) / 2.0


@pytest.mark.parametrize("method", ALL, ids=str)
def test_sound_method_keeps_every_contract(method):
    assert watched(method.make(), *case("walk_through_a_city")) == []


@pytest.mark.parametrize("mutant", WASTEFUL, ids=str)
def test_wasteful_mutant_breaks_its_contract_and_misses_nothing(mutant):
    problems = watched(mutant.make(), *case("walk_through_a_city"))
    assert mutant.contract in {problem.split(":")[0] for problem in problems}
    (found,) = check_culler(mutant.make, checks=[CHECKS["walk_through_a_city"]])
    assert found.status is Status.PASSED, found.problems


def test_every_mutant_is_tried_or_has_a_reason():
    ids = {mutant.id for mutant in MUTANTS} | set(EQUIVALENT) | set(NOT_HERE)
    assert sorted({*COMMON, *OF_THE_METHOD} - ids) == []
    assert not {mutant.id for mutant in MUTANTS} & {*EQUIVALENT, *NOT_HERE}
