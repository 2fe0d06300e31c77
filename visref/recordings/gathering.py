"""From the rows of a recording to the sets of units that were drawn.

A row is looked at once and put away at once, so that a recording takes little more memory than its
longest line and a few bytes per frame and unit.
"""

from __future__ import annotations

import reprlib
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from visref.camera import ALL_VIEWS
from visref.culler import QueryStats
from visref.errors import InputError
from visref.memory import Budget
from visref.recordings.names import Names, shown_name
from visref.recordings.rows import Row
from visref.recordings.spool import Spool
from visref.scene import Float64, Int32, Int64, Scene, Units, clean_name

# So many are listed of what may be many.
_VIEWS_SHOWN = 6
# What a name that means nothing plain, and a view of a frame, take here.
_BAD_BYTES, _CELL_BYTES = 1000, 400
# In place of a number where a name is in the list of those to complain about.
_BAD = -1

At = tuple[int, int]


class FrameSets(Mapping[str, Int32]):
    """The sets of one frame, by view or under `ALL_VIEWS`: ids of units, ascending int32."""

    def __init__(self, spool: Spool, at: Mapping[str, At], unit_of: Int32 | None) -> None:
        self._spool, self._at, self._unit_of = spool, at, unit_of

    def __getitem__(self, view: str) -> Int32:
        numbers = self._spool.get_set(self._at[view])
        return numbers if self._unit_of is None else np.unique(self._unit_of[numbers])

    def __contains__(self, view: object) -> bool:
        return view in self._at

    def __iter__(self) -> Iterator[str]:
        return iter(self._at)

    def __len__(self) -> int:
        return len(self._at)


class FrameBoxes(Mapping[int, Float64]):
    """The boxes of the frames that say some: (u, 2, 3) float64, one per unit, +inf and -inf where
    a frame says none."""

    def __init__(
        self, spool: Spool, at: Mapping[int, At], unit_of: Int32 | None, units: int
    ) -> None:
        self._spool, self._at, self._unit_of, self._units = spool, at, unit_of, units

    def __getitem__(self, frame: int) -> Float64:
        numbers, boxes = self._spool.get_boxes(self._at[frame])
        result: Float64 = np.tile(np.array([[np.inf], [-np.inf]]), (self._units, 1, 3))
        result[numbers if self._unit_of is None else self._unit_of[numbers]] = boxes
        return result

    def __iter__(self) -> Iterator[int]:
        return iter(self._at)

    def __len__(self) -> int:
        return len(self._at)


class _Numbers(dict[int | str, int]):
    """By entry of a set its number: an object's id, or one beyond them for each group that is
    named, or with `units` the unit's. Entries that mean nothing plain get `_BAD`, and are kept with
    the place where each stood first."""

    def __init__(self, scene: Scene, names: Names, units: Units | None) -> None:
        super().__init__()
        self._scene, self._names, self._units = scene, names, units
        self._of_objects: dict[tuple[int, ...], int] = {}
        self.groups: list[tuple[int, ...]] = []
        self.place = ""
        self.bad: dict[str, str] = {}

    @property
    def count(self) -> int:
        """How many numbers there are."""
        if self._units is not None:
            return self._units.count
        return self._scene.object_count + len(self.groups)

    def __missing__(self, entry: int | str) -> int:
        if isinstance(entry, int):
            self._check_id(entry)
            number = entry
        elif self._units is not None:
            raise self._no_unit(entry)
        else:
            name = clean_name(entry)
            meanings = self._names.meanings(name)
            if len(meanings) != 1:
                self.bad.setdefault(name, self.place)
                return _BAD
            number = self.of_objects(meanings[0])
        self[entry] = number
        return number

    def of_objects(self, objects: tuple[int, ...]) -> int:
        """The number of an object or a group."""
        if len(objects) == 1:
            return objects[0]
        if objects not in self._of_objects:
            self._of_objects[objects] = self._scene.object_count + len(self.groups)
            self.groups.append(objects)
        return self._of_objects[objects]

    def _check_id(self, entry: int) -> None:
        what = "unit" if self._units is not None else "object id"
        count = self._scene.object_count if self._units is None else self._units.count
        if not 0 <= entry < count:
            last = f"0…{count - 1}"
            fix = "ids are dense, in the scene graph's depth-first order"
            if self._units is not None:
                fix = "name the units of the recording's units file"
            raise InputError(
                f"{what} {reprlib.repr(entry)} is not in the scene ({last})"
                if self._units is None
                else f"unit {reprlib.repr(entry)} is none of the units ({last})",
                place=self.place,
                fix=fix,
            )

    def of_name(self, name: str) -> int:
        """The number of a name, or of a unit whose number is written as a text, as JSON has keys
        that are texts alone."""
        if self._units is None:
            return self[name]
        if name.isascii() and name.isdecimal() and len(name) < 12:
            return self[int(name)]
        raise self._no_unit(name)

    def _no_unit(self, entry: str) -> InputError:
        return InputError(
            f"{shown_name(entry)} is a name, and the recording has units of its own",
            place=self.place,
            fix="list the units' numbers",
        )


class Gathering:
    """The sets of a recording, row by row.

    `units`: those that the recording's numbers stand for; None where it names the scene's objects
    and groups. Raises InputError, without the file's name, for an id, a node or a view that there
    is not, and where it all does not fit `budget`.
    """

    def __init__(self, scene: Scene, budget: Budget, *, units: Units | None = None) -> None:
        self._scene, self._budget, self._units = scene, budget, units
        self._names = Names(scene)
        self._numbers = _Numbers(scene, self._names, units)
        self._number_of_node = _nodes(scene)
        self._spool = Spool()
        self._sets: dict[int, dict[str, At]] = {}
        self._boxes: dict[int, At] = {}
        self._stats: dict[int, QueryStats] = {}

    def add(self, row: Row, views: Sequence[str]) -> None:
        """Take a frame's row; `views`: the names of the frame's views."""
        try:
            _check_views(row, views)
            cells = len(row.sets) + bool(row.bounds)
            self._budget.claim("its frames up to here", _CELL_BYTES * cells)
            self._numbers.place = row.place
            bad = len(self._numbers.bad)
            self._sets[row.frame] = {
                view: self._spool.put_set(self._numbers_in(entries, row.nodes))
                for view, entries in row.sets.items()
            }
            if row.bounds:
                numbers = [self._numbers.of_name(name) for name in row.bounds]
                kept = [at for at, number in enumerate(numbers) if number != _BAD]
                boxes = np.array(list(row.bounds.values()), np.float64)
                self._boxes[row.frame] = self._spool.put_boxes(
                    np.array(numbers, np.int32)[kept], boxes[kept]
                )
            more = len(self._numbers.bad) - bad
            self._budget.claim("names that mean nothing", _BAD_BYTES * more)
        except InputError as error:
            raise InputError(error.problem, place=row.place, fix=error.fix) from error
        if row.stats != QueryStats():
            self._stats[row.frame] = row.stats

    def _numbers_in(self, entries: Sequence[int | str], nodes: bool) -> Int32:
        if nodes:
            return self._of_nodes(entries)
        numbers = np.unique(np.array([self._numbers[entry] for entry in entries], np.int32))
        return numbers[1:] if len(numbers) and numbers[0] == _BAD else numbers

    def _of_nodes(self, entries: Sequence[int | str]) -> Int32:
        if self._units is not None:
            raise InputError(
                "visible_nodes, and the recording has units of its own",
                fix="list the units' numbers in visible",
            )
        numbers = []
        for node in entries:
            objects = self._number_of_node.get(node)
            if objects is None:
                what = "the scene's file has no nodes"
                if self._number_of_node:
                    what = f"node {reprlib.repr(node)} has no mesh, or is not in the scene"
                raise InputError(what, fix="use the node indices of `visref objects`")
            numbers.append(self._numbers.of_objects(objects))
        return np.unique(np.array(numbers, np.int32))

    def finish(self, source: str) -> tuple[dict[int, FrameSets], dict[int, QueryStats], Units,
                                           FrameBoxes]:  # fmt: skip
        """The sets by frame, the stats of the frames that have some, the units and the boxes.

        Raises one InputError for all unknown names, else one for all ambiguous ones.
        """
        if self._numbers.bad:
            self._names.resolved(self._numbers.bad, source)
        units, unit_of = self._units_of_numbers()
        sets = {frame: FrameSets(self._spool, at, unit_of) for frame, at in self._sets.items()}
        return sets, self._stats, units, FrameBoxes(self._spool, self._boxes, unit_of, units.count)

    def _units_of_numbers(self) -> tuple[Units, Int32 | None]:
        """The units, and each number's, None where they are the same."""
        if self._units is not None:
            return self._units, None
        groups = self._numbers.groups
        if not groups:
            return self._scene.object_units(), None
        used = np.zeros(self._numbers.count, np.bool_)
        for sets in self._sets.values():
            for at in sets.values():
                used[self._spool.get_set(at)] = True
        for at in self._boxes.values():
            used[self._spool.get_boxes(at)[0]] = True
        return grouped_units(self._scene, groups, used[: self._scene.object_count])


def grouped_units(
    scene: Scene,
    groups: Sequence[tuple[int, ...]],
    named: np.ndarray[tuple[int], np.dtype[np.bool_]],
) -> tuple[Units, Int32]:
    """Units where groups are named: every object that is in no such group or is `named` itself,
    (n,) bool, and then the groups, by their objects; and the unit of each object and of each group,
    (n + g,) int32, -1 for an object that is none."""
    grouped = np.zeros(scene.object_count, np.bool_)
    for objects in groups:
        grouped[list(objects)] = True
    single = np.flatnonzero(~grouped | named)
    # Groups by their objects, whatever was named first.
    order = sorted(range(len(groups)), key=lambda at: groups[at])
    unit_of = np.full(scene.object_count + len(groups), -1, np.int32)
    unit_of[single] = np.arange(len(single))
    for place, at in enumerate(order):
        unit_of[scene.object_count + at] = len(single) + place
    units = scene.object_units()
    members: list[Int64] = [np.array(groups[at], np.int64) for at in order]
    objects_of = np.concatenate([single, *members])
    lengths = np.concatenate([np.ones(len(single), np.int64), [len(one) for one in members]])
    sizes = units.sizes[objects_of]
    ends = np.concatenate([[0], np.cumsum(sizes)])
    offsets = ends[np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)]
    triangles = units.gather(objects_of.astype(np.int32))
    return Units(offsets.astype(np.int64), triangles, "object or group"), unit_of


def _nodes(scene: Scene) -> dict[int | str, tuple[int, ...]]:
    """By glTF node the objects that it has: one, or those of its instances."""
    found: dict[int | str, tuple[int, ...]] = {}
    if scene.nodes is None:
        return found
    order = np.argsort(scene.nodes, kind="stable")
    nodes, starts = np.unique(scene.nodes[order], return_index=True)
    for node, members in zip(nodes.tolist(), np.split(order, starts[1:]), strict=True):
        if node >= 0:
            found[node] = tuple(members.tolist())
    return found


def _check_views(row: Row, views: Sequence[str]) -> None:
    """Raise InputError unless a frame has one set for all its views, or one for each."""
    if list(row.sets) == [ALL_VIEWS]:
        return
    known = ", ".join(map(shown_name, views[:_VIEWS_SHOWN]))
    fix = f"write a list for all views, or one for each of {known}"
    if list(views) == [ALL_VIEWS]:
        fix = "the frame has one view without a name: write a list"
    unknown = [view for view in row.sets if view not in views]
    if unknown:
        problem = f"the frame has no view {shown_name(unknown[0])}"
        if unknown[0] == ALL_VIEWS:
            problem = "it has a set for all views and others by view"
    elif missing := [view for view in views if view not in row.sets]:
        problem = f"view {shown_name(missing[0])} is missing"
    else:
        return
    raise InputError(f"frame {row.frame}: {problem}", fix=fix)


def missing_frames(missing: Sequence[int], wanted: int, source: str) -> InputError:
    """What to say of frames that a recording lacks."""
    shown = ", ".join(map(str, missing[:5])) + (", …" if len(missing) > 5 else "")
    return InputError(
        f"{len(missing)} of {wanted} frames are missing: {shown}",
        source=source,
        place="frame",
        fix='write a line for each frame, "visible": [] where nothing was drawn',
    )
