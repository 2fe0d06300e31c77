"""Each reported fault loses objects by its mistake alone: a culler without it loses none there."""

from __future__ import annotations

import re
from collections import Counter
from functools import cache

import numpy as np
import pytest

from tests.causes.drawn import KEPT_BACK
from tests.causes.reported import (
    LATER,
    LOT,
    NEWEST,
    RECENT,
    REPORTS,
    later,
    newest,
    places,
    recent,
    reported,
)
from tests.causes.reported.sound import Sound
from visref.engines import make_engine
from visref.timeline import Timeline

# Of a fault: object-frames lost at least, and at most, so that none stands for the lot.
LEAST, MOST = 10, 600
EVERY = (*REPORTS, *LATER, *RECENT, *NEWEST)


@cache
def moments(place):
    """Per view of each frame: the scene, the camera, and (n,) bool, the objects that are seen."""
    path = place.path.relative_to(place.scene.origin)
    timeline = Timeline(place.scene, path)
    found, engine, last = [], None, None
    for number in path.numbers:
        scene = timeline.at(number)
        if scene is not last:
            engine, last = make_engine("embree", scene, threads=1), scene
        for camera in path.views(number):
            frame = engine.frame(camera)
            owners = frame.buffer.triangle
            seen = np.zeros(scene.object_count, np.bool_)
            seen[scene.object_of_triangle[owners[owners >= 0]]] = True
            seen[frame.blend.object] = True
            found.append((scene, camera, seen))
    return timeline, found


def told(place, culler):
    """(lost, drawn): pairs of moment and object that it loses, and how many it draws."""
    timeline, found = moments(place)
    culler.prepare(timeline.still)
    lost, drawn, last = [], 0, None
    for at, (scene, camera, seen) in enumerate(found):
        if timeline.moves and scene is not last:
            culler.update(scene)
        last = scene
        kept = np.zeros(scene.object_count, np.bool_)
        kept[culler.cull(camera).unit_ids] = True
        lost += [(at, one) for one in np.flatnonzero(seen & ~kept)]
        drawn += int(np.count_nonzero(kept & seen))
    culler.close()
    return lost, drawn


def once_each():
    """A report per place."""
    seen = {}
    for report in EVERY:
        # Of one with arguments, `partial` shows them.
        seen.setdefault(str(report.place), report)
    return list(seen.values())


@pytest.mark.slow
@pytest.mark.parametrize("report", EVERY, ids=lambda report: report.name)
def test_mistake_shows(report):
    place = report.place()
    lost, drawn = told(place, report.culler(place))
    assert LEAST <= len(lost) <= MOST
    # It is right at times: in some frames, and of some objects.
    assert drawn > len(lost) / 4
    assert len({at for at, _ in lost}) > 2


@pytest.mark.slow
@pytest.mark.parametrize("report", once_each(), ids=lambda report: report.name)
def test_culler_without_a_mistake_loses_nothing_there(report):
    place = report.place()
    lost, drawn = told(place, Sound(place))
    assert not lost
    assert drawn


def test_culler_without_a_mistake_leaves_the_hidden_out():
    place = places.hall()
    sound = Sound(place)
    _, found = moments(place)
    sound.prepare(place.scene)
    scene, camera, seen = found[0]
    drawn = len(sound.cull(camera).unit_ids)
    sound.close()
    assert np.count_nonzero(seen) <= drawn < scene.object_count / 2


def test_each_names_who_reported_it():
    for report in EVERY:
        assert re.match(r"[\w.-]+/[\w.-]+ #\d+", report.source), report
    assert len({report.source for report in REPORTS}) > 0.9 * len(REPORTS)


def test_each_is_a_mistake_of_its_own():
    faults = list(reported())
    assert len({fault.mistake for fault in faults}) == len(faults) == len(REPORTS)
    assert all(fault.about for fault in faults)


@pytest.mark.parametrize(
    ("lot", "reports", "made"),
    [("later", LATER, later), ("recent", RECENT, recent), ("newest", NEWEST, newest)],
)
def test_all_of_a_later_lot_is_kept_back(lot, reports, made):
    faults = list(made())
    assert len({fault.mistake for fault in faults}) == len(faults) == len(reports)
    assert {fault.source for fault in faults} == {lot}
    assert {fault.name for fault in faults} <= KEPT_BACK


def test_lot_is_drawn_and_the_others_are_spare():
    sources = Counter(fault.source for fault in reported())
    assert sources == {"reported": LOT, "spare": len(REPORTS) - LOT}
    assert {fault.name for fault in reported()} <= KEPT_BACK
