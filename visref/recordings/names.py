"""What a name in a recording means: an object, or the objects of a group.

An object is named by its own name, by its path from the root (`house/kitchen/chair`), or by the
name that visref gives it (`chair#2`). A group is named by its name or path, which an object's
own name goes before if it is only one's; `group:NAME` is always the group. A leading slash makes a
name a path, where it would be one of several. A name of several objects and no group, or of
several groups, is none.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from functools import cached_property

from visref.errors import InputError
from visref.scene import Group, Scene
from visref.wording import counted, did_you_mean

_GROUP = "group:"
# So many are listed of what may be many.
_SHOWN = 5


class Names:
    """The names of a scene's objects and groups."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._groups: dict[str, list[Group]] = defaultdict(list)
        for group in scene.groups:
            for key in {group.name, group.path}:
                self._groups[key].append(group)
        # A group's own objects do not count as bearers of its name and path.
        inside: set[tuple[int, str, str]] = set()
        for group in scene.groups:
            for member in group.objects:
                inside.update(((member, "name", group.name), (member, "path", group.path)))
        self._by_name: dict[str, list[int]] = defaultdict(list)
        self._by_path: dict[str, list[int]] = defaultdict(list)
        for index, (name, path) in enumerate(zip(scene.given_names, scene.paths, strict=True)):
            if (index, "name", name) not in inside:
                self._by_name[name].append(index)
            if (index, "path", path) not in inside:
                self._by_path[path].append(index)

    def meanings(self, name: str) -> list[tuple[int, ...]]:
        """The object ids that a name may stand for: one tuple where it is plain, none where it
        is unknown, several where it is ambiguous."""
        if name.startswith(_GROUP) and (groups := self._groups.get(name[len(_GROUP) :])):
            return [group.objects for group in groups]
        if name.startswith("/"):
            at_path = self._by_path.get(name[1:], [])
            groups = [group for group in self._scene.groups if group.path == name[1:]]
            if at_path or groups:
                return [(i,) for i in at_path] or [group.objects for group in groups]
        objects = {*self._by_name.get(name, ()), *self._by_path.get(name, ())}
        known_as = self._scene.id_of_name.get(name)
        if known_as is not None and self._scene.given_names[known_as] != name:
            objects.add(known_as)
        bearers = [group.objects for group in self._groups.get(name, ())]
        # Where several bear it, and a group too, it is the group's.
        if len(objects) == 1 or (objects and not bearers):
            return [(i,) for i in sorted(objects)]
        return bearers

    def resolved(self, places: Mapping[str, str], source: str) -> dict[str, tuple[int, ...]]:
        """The object ids of each name. `places` says of each where it stands first.

        Raises one InputError for all unknown names, else one for all ambiguous ones.
        """
        found = {name: self.meanings(name) for name in places}
        unknown = [name for name, meanings in found.items() if not meanings]
        if unknown:
            raise InputError(
                _listed(unknown, "the scene has no object named"),
                source=source,
                place=places[unknown[0]],
                fix=did_you_mean(unknown[0], self._usable, "use the names of `visref objects`"),
            )
        ambiguous = [name for name, meanings in found.items() if len(meanings) > 1]
        if ambiguous:
            candidates = found[ambiguous[0]]
            shown = [self._candidate(ids) for ids in candidates[:_SHOWN]]
            shown += ["…"] if len(candidates) > _SHOWN else []
            raise InputError(
                f"{_listed(ambiguous, 'ambiguous is')}, which may be {', '.join(shown)}",
                source=source,
                place=places[ambiguous[0]],
                fix="give ids, paths from the root, or the names of `visref objects`",
            )
        return {name: meanings[0] for name, meanings in found.items()}

    def _candidate(self, ids: tuple[int, ...]) -> str:
        scene = self._scene
        if len(ids) > 1:
            return f"a group of {len(ids)} from object {ids[0]} on"
        (index,) = ids
        written = (scene.paths[index], f"/{scene.paths[index]}", scene.names[index])
        plain = [name for name in written if len(self.meanings(name)) == 1]
        return f"{index} ('{plain[0]}')" if plain else str(index)

    @cached_property
    def _usable(self) -> list[str]:
        """All that may be written and is plain, own names before paths."""
        scene = self._scene
        every: Iterable[str] = (*scene.given_names, *scene.paths, *scene.names, *self._groups)
        return [name for name in dict.fromkeys(every) if len(self.meanings(name)) == 1]


def shown_name(name: str) -> str:
    """A name in quotes, cut after 200 characters."""
    return repr(name) if len(name) <= 200 else f"{name[:200]!r}…"


def _listed(names: list[str], what: str) -> str:
    """`what 'a'`, or `what 'a', nor 3 other names: 'b', 'c', …`."""
    first, others = names[0], names[1:]
    if not others:
        return f"{what} {shown_name(first)}"
    shown = ", ".join(map(shown_name, others[: _SHOWN - 1]))
    more = ", …" if len(others) > _SHOWN - 1 else ""
    return f"{what} {shown_name(first)} and {counted(len(others), 'other')} ({shown}{more})"
