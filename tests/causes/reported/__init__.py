"""Faults that people reported of engines and libraries: each culler makes the one mistake that a
report tells of, on a scene where it shows.

Written from the reports, whose project and number each names, without a look at what finds causes.
Fifty, drawn by seed, are a lot; the others are spare, for a time when that lot is spent.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from tests.causes.fault import Fault, Input
from tests.causes.reported import (
    bounds,
    hiding,
    later_bounds,
    lists,
    newest_depth,
    newest_planes,
    newest_time,
    newest_views,
    recent_depth,
    recent_lists,
    recent_rooms,
    recent_time,
    view,
)
from tests.causes.reported.sound import LATER, NEWEST, RECENT, REPORTS, Report

__all__ = [
    "LATER",
    "NEWEST",
    "RECENT",
    "REPORTS",
    "bounds",
    "hiding",
    "later",
    "later_bounds",
    "lists",
    "newest",
    "newest_depth",
    "newest_planes",
    "newest_time",
    "newest_views",
    "recent",
    "recent_depth",
    "recent_lists",
    "recent_rooms",
    "recent_time",
    "reported",
    "view",
]

LOT, SEED = 50, 17


def later() -> Iterator[Fault]:
    """Those of the later lot, none of which is spare."""
    for report in LATER:
        yield _fault("later", report)


def recent() -> Iterator[Fault]:
    """Those of the lot after that, of depth, time, lists, levels, views and materials."""
    for report in RECENT:
        yield _fault("recent", report)


def newest() -> Iterator[Fault]:
    """Those of the lot after that one, of the same."""
    for report in NEWEST:
        yield _fault("newest", report)


def reported() -> Iterator[Fault]:
    names = sorted(report.name for report in REPORTS)
    order = np.random.Generator(np.random.PCG64(SEED)).permutation(len(names))
    lot = {names[at] for at in order[:LOT]}
    for report in REPORTS:
        yield _fault("reported" if report.name in lot else "spare", report)


def _fault(lot: str, report: Report) -> Fault:
    name = f"{lot}/{report.name}"
    about = " ".join((report.culler.__doc__ or "").split())
    return Fault(name, report.family, name, about, partial(_input, report))


def _input(report: Report) -> Input:
    place = report.place()
    return Input(place.scene, place.path, report.culler(place))
