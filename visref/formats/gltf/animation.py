"""A glTF file's animations (section 3.11): what their channels change, and its value at a time.

Read are a node's translation, rotation, scale and morph weights, and by `KHR_animation_pointer`
these, a mesh's weights and a node's visibility. What else a pointer changes is not played, and
`unplayed` says what of that bears on what is seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from visref.formats.gltf.accessors import read_floats
from visref.formats.gltf.document import Document
from visref.formats.gltf.nodes import have_length
from visref.formats.gltf.values import Json
from visref.scene import Float64, Int64, unique_names

TRANSFORMS = {"translation": "VEC3", "rotation": "VEC4", "scale": "VEC3"}
WEIGHTS, VISIBLE = "weights", "visible"
_VISIBLE_POINTER = "extensions/KHR_node_visibility/visible"
_INTERPOLATIONS = ("LINEAR", "STEP", "CUBICSPLINE")


@dataclass(frozen=True, eq=False)
class Target:
    """What one channel changes: `kind` ("nodes" or "meshes"), the number in that list, and `path`,
    one of `TRANSFORMS`, `WEIGHTS` or `VISIBLE`. `sampler`: where its keys stand."""

    kind: str
    index: int
    path: str
    sampler: Json


@dataclass(frozen=True, eq=False)
class Channel:
    """One animated property: key times (k,) float64 and values (k, width) float64, or (3k, width)
    for a cubic spline (in-tangent, value, out-tangent of each key)."""

    target: Target
    times: Float64
    values: Float64
    interpolation: str

    def at(self, times: Float64) -> Float64:
        """(n, width) float64: the property at each time, (n,); before the first key and after the
        last, those hold."""
        left, right, u, span = between(self.times, times)
        step = keys_apart(self.interpolation)
        turns = self.target.path == "rotation"
        rows = (left * step, right * step)
        return interpolated(self.interpolation, turns, self.values, rows, u[:, None], span[:, None])


def keys_apart(interpolation: str) -> int:
    """How many rows of a channel's values belong to each key."""
    return 3 if interpolation == "CUBICSPLINE" else 1


def between(keys: Float64, times: Float64) -> tuple[Int64, Int64, Float64, Float64]:
    """Of each time, (n,): the numbers of the keys to its left and right, how far it is from one to
    the other (0 to 1), and what lies between them in seconds."""
    clamped = np.clip(times, keys[0], keys[-1])
    right = np.clip(np.searchsorted(keys, clamped, side="right"), 1, max(1, len(keys) - 1))
    left = right - 1
    if len(keys) == 1:
        right = left
    span = np.where(right > left, keys[right] - keys[left], 1.0)
    return left, right, (clamped - keys[left]) / span, span


def interpolated(
    interpolation: str,
    turns: bool,
    values: Float64,
    rows: tuple[Int64, Int64],
    u: Float64,
    span: Float64,
) -> Float64:
    """(n, width) float64: values between two keys each, whose first rows in `values` are `rows`,
    (n,) each, at the share `u`, (n, 1), of `span`, (n, 1) seconds. `turns`: they are quaternions.
    """
    left, right = rows
    if interpolation == "CUBICSPLINE":
        # Cubic Hermite spline (appendix C.5).
        u2, u3 = u * u, u * u * u
        result: Float64 = (
            (2.0 * u3 - 3.0 * u2 + 1.0) * values[left + 1]
            + span * (u3 - 2.0 * u2 + u) * values[left + 2]
            + (3.0 * u2 - 2.0 * u3) * values[right + 1]
            + span * (u3 - u2) * values[right]
        )
        return result
    if interpolation == "STEP":
        return values[np.where(u[:, 0] >= 1.0, right, left)]
    if turns:
        return _slerp(values[left], values[right], u)
    return (1.0 - u) * values[left] + u * values[right]


def _slerp(a: Float64, b: Float64, u: Float64) -> Float64:
    """Spherical interpolation of (n, 4) quaternions the short way (appendix C.4)."""
    a = a / np.linalg.norm(a, axis=1, keepdims=True)
    b = b / np.linalg.norm(b, axis=1, keepdims=True)
    b = np.where((a * b).sum(axis=1, keepdims=True) < 0.0, -b, b)
    # Twice the half angle's arctangent: accurate for small angles, where acos is not.
    angle = 2.0 * np.arctan2(
        np.linalg.norm(a - b, axis=1, keepdims=True), np.linalg.norm(a + b, axis=1, keepdims=True)
    )
    sine = np.sin(angle)
    straight = sine == 0.0
    safe = np.where(straight, 1.0, sine)
    result: Float64 = (
        np.where(straight, 1.0 - u, np.sin((1.0 - u) * angle) / safe) * a
        + np.where(straight, u, np.sin(u * angle) / safe) * b
    )
    return result


@dataclass(frozen=True, eq=False)
class Animations:
    """What all animations of a file change, an entry for each in the file's order. Raises
    InputError naming the place where a channel names what there is not.

    `places`: where they stand. `unplayed`: what pointers change that is not played.
    """

    document: Document
    places: list[Json] = field(default_factory=list)
    targets: list[list[Target]] = field(default_factory=list)
    unplayed: list[str] = field(default_factory=list)
    _times: dict[int, Float64] = field(default_factory=dict)
    _counts: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for animation in self.document.entries("animations"):
            self.places.append(animation)
            self.targets.append(self._targets(animation))

    @cached_property
    def clips(self) -> tuple[str, ...]:
        """Their names, each once: repeats get `#2`, `#3`, …; one without is `animation`."""
        named = [animation.get("name") for animation in self.places]
        return unique_names(["animation" if n is None else n.text() or "animation" for n in named])

    def _targets(self, animation: Json) -> list[Target]:
        samplers = animation["samplers"].items()
        result = []
        taken = set()
        for channel in animation["channels"].items():
            index = channel["sampler"].integer()
            if index >= len(samplers):
                channel["sampler"].fail(f"samplers[{index}] is named of {len(samplers)}")
            found = self._target(channel["target"])
            if found is None:
                continue
            if found in taken:
                channel.fail(f"another channel animates {found[2]} of {found[0]}[{found[1]}] too")
            taken.add(found)
            result.append(Target(*found, samplers[index]))
        return result

    def _target(self, target: Json) -> tuple[str, int, str] | None:
        """The list, the number in it, and the path; None for what is not played."""
        path = target["path"].text()
        if path == "pointer":
            return self._pointed(target)
        node = target.get("node")
        if node is None:
            return None  # An extension may say what this animates (section 3.11).
        if path not in (*TRANSFORMS, WEIGHTS):
            target["path"].fail(f"'{path}' is not translation, rotation, scale or weights")
        self.document.entry("nodes", node)
        return "nodes", node.integer(), path

    def _pointed(self, target: Json) -> tuple[str, int, str] | None:
        extension = target.extension("KHR_animation_pointer")
        if extension is None:
            target.fail("its path is a pointer, and it has no KHR_animation_pointer")
        pointer = extension["pointer"]
        parts = pointer.text().split("/", 3)
        kind, path = (parts[1], parts[3]) if len(parts) == 4 else ("", "")
        if kind in ("nodes", "meshes", "materials") and not parts[2].isdecimal():
            pointer.fail(f"{parts[2][:40]!a} is no index")
        path = VISIBLE if path == _VISIBLE_POINTER else path
        played = (*TRANSFORMS, WEIGHTS, VISIBLE) if kind == "nodes" else (WEIGHTS,)
        if kind in ("nodes", "meshes") and path in played:
            index = int(parts[2][:20])
            if index >= len(self.document.entries(kind)):
                pointer.fail(f"{kind}[{index}] is named of {len(self.document.entries(kind))}")
            return kind, index, path
        if kind in ("nodes", "meshes") or (kind == "materials" and _hides(path)):
            self.unplayed.append(pointer.text())
        return None

    def channel(self, target: Target) -> Channel:
        """A target's keys. Raises InputError naming the place."""
        sampler = target.sampler
        named = sampler.get("interpolation")
        interpolation = "LINEAR" if named is None else named.text()
        if interpolation not in _INTERPOLATIONS:
            sampler.fail(f"interpolation '{interpolation}' is not known")
        if target.path == VISIBLE and interpolation != "STEP":
            sampler.fail("visibility is animated by steps alone", "set interpolation to STEP")
        times = self._keys(sampler["input"])
        output = sampler["output"]
        kind = TRANSFORMS.get(target.path, "SCALAR")
        values = read_floats(self.document, output, (kind,), integers=True).astype(np.float64)
        expected = len(times) * keys_apart(interpolation)
        if target.path == WEIGHTS:
            count = self._morph_targets(target)
            expected *= count
        if len(values) != expected:
            sampler.fail(f"{len(values)} output values where {expected} belong to its times")
        if not np.isfinite(values).all():
            output.fail("a value is NaN or infinite")
        if target.path == "rotation" and interpolation != "CUBICSPLINE" and not have_length(values):
            output.fail("a rotation of zero or infinite length")
        if target.path == WEIGHTS:
            values = values.reshape(-1, count)
        if target.path in TRANSFORMS:
            entry = self.document.entries("nodes")[target.index]
            if "matrix" in entry.value:
                entry.fail("an animated node has a matrix", "give translation, rotation, scale")
        return Channel(target, times, values, interpolation)

    def _keys(self, reference: Json) -> Float64:
        """Key times; the channels that share them share the array too."""
        index = reference.integer()
        if index not in self._times:
            raw = read_floats(self.document, reference, ("SCALAR",))
            times: Float64 = raw[:, 0].astype(np.float64)
            if not np.isfinite(times).all() or (np.diff(times) <= 0.0).any():
                reference.fail("its times do not increase")
            self._times[index] = times
        return self._times[index]

    def _morph_targets(self, target: Target) -> int:
        """How many weights the animated mesh has."""
        mesh = self.document.entries(target.kind)[target.index]
        if target.kind == "nodes":
            if "mesh" not in mesh.value:
                target.sampler.fail(f"it animates the weights of {mesh.place}, which has no mesh")
            mesh = self.document.entry("meshes", mesh["mesh"])
        if mesh.place not in self._counts:
            self._counts[mesh.place] = morph_targets(mesh)
        count = self._counts[mesh.place]
        if not count:
            target.sampler.fail(f"it animates the weights of {mesh.place}, which has no targets")
        return count


def morph_targets(mesh: Json) -> int:
    """How many morph targets a mesh has."""
    lists = [primitive.get("targets") for primitive in mesh["primitives"].items()]
    return max((len(targets.items()) for targets in lists if targets is not None), default=0)


def _hides(path: str) -> bool:
    """Whether a material's property at `path` changes what it hides."""
    return path.endswith(("alphaCutoff", "baseColorFactor", "diffuseFactor", "transmissionFactor"))


class Bank:
    """Channels of one path and interpolation, all sampled at one time at once."""

    def __init__(self, channels: Sequence[Channel], key_sets: Sequence[int]) -> None:
        """`key_sets`: of each channel, the number of its keys among those of `Playback`."""
        first = channels[0]
        self.path = first.target.path
        self.kind = first.target.kind
        self.interpolation = first.interpolation
        self.indices: Int64 = np.array([channel.target.index for channel in channels], np.int64)
        self.key_sets = np.array(key_sets, np.int64)
        sizes = [len(channel.values) for channel in channels]
        self.starts: Int64 = np.cumsum([0, *sizes[:-1]])
        self.values: Float64 = np.concatenate([channel.values for channel in channels])

    def at(self, left: Int64, right: Int64, u: Float64, span: Float64) -> Float64:
        """(c, width) float64, each channel's value; the arguments are those of each set of keys."""
        step = keys_apart(self.interpolation)
        mine = self.key_sets
        rows = (self.starts + left[mine] * step, self.starts + right[mine] * step)
        u, span = u[mine, None], span[mine, None]
        turns = self.path == "rotation"
        return interpolated(self.interpolation, turns, self.values, rows, u, span)


class Playback:
    """One animation's channels, put together so that sampling them costs little."""

    def __init__(self, channels: Sequence[Channel]) -> None:
        self.keys: list[Float64] = []
        numbers: dict[int, int] = {}
        alike: dict[tuple[str, str, str, int], list[tuple[Channel, int]]] = {}
        for channel in channels:
            number = numbers.setdefault(id(channel.times), len(self.keys))
            if number == len(self.keys):
                self.keys.append(channel.times)
            width = channel.values.shape[1]
            group = (channel.target.kind, channel.target.path, channel.interpolation, width)
            alike.setdefault(group, []).append((channel, number))
        sizes = [len(keys) for keys in self.keys]
        self.all_keys: Float64 = np.concatenate([np.zeros(0), *self.keys])
        self.starts: Int64 = np.cumsum([0, *sizes])[:-1]
        self.last: Int64 = np.array(sizes, np.int64) - 1
        self.low: Float64 = np.array([keys[0] for keys in self.keys])
        self.high: Float64 = np.array([keys[-1] for keys in self.keys])
        self.banks = [
            Bank([channel for channel, _ in members], [number for _, number in members])
            for members in alike.values()
        ]

    def at(self, time_s: float) -> list[tuple[Bank, Float64]]:
        """Each bank with its channels' values, (c, width) float64, at a time in seconds."""
        if not self.banks:
            return []
        # As `between` does it, for one time and many sets of keys.
        count = len(self.keys)
        found = [int(keys.searchsorted(time_s, "right")) for keys in self.keys]
        right: Int64 = np.minimum(np.maximum(np.array(found, np.int64), 1), self.last)
        left = np.maximum(right - 1, 0)
        before, after = (self.all_keys[self.starts + places] for places in (left, right))
        span = np.where(right > left, after - before, 1.0)
        clamped = np.minimum(np.maximum(np.full(count, time_s), self.low), self.high)
        u = (clamped - before) / span
        return [(bank, bank.at(left, right, u, span)) for bank in self.banks]
