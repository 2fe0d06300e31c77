"""Which culler runs where."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

from visref.culler import Culler
from visref.errors import InputError
from visref.plug_ins.in_process import CullerGuarded
from visref.plug_ins.process import CullerApart
from visref.registry import CULLERS, available, find_culler, make_culler

# Long for any frame, and for what a method builds from a scene; short for a job in CI.
DEFAULT_TIME_LIMIT_S = 120.0

# The cullers that come with visref share its process, and its GL context.
_OURS = "visref_culling."


@dataclass(frozen=True)
class Making:
    """How plug-ins are run: in this process or, each in one of its own, with `time_limit_s` seconds
    per call and `memory_limit` bytes (None: without limit). `say` is given what they print: a spec
    and a line."""

    in_process: bool = False
    time_limit_s: float | None = DEFAULT_TIME_LIMIT_S
    memory_limit: int | None = None
    say: Callable[[str, str], None] | None = None


@contextmanager
def making_cullers(specs: Sequence[str], making: Making) -> Iterator[list[tuple[str, Culler]]]:
    """A culler for each spec, beside it; who uses it closes it, and no process of its own is left
    when the block ends.

    Raises InputError for a spec that names nothing and for an option that there is not; what else
    goes wrong is that culler's fault, when it is prepared.
    """
    check_time_limit(making.time_limit_s)
    with ExitStack() as closing:
        yield [(spec, _make(spec, making, closing)) for spec in specs]


def check_cullers(specs: Sequence[str]) -> None:
    """Raise InputError for a spec of ours that names nothing, or an option that there is not. No
    culler is made: one on OpenGL starts threads, which a copy of this process would not have."""
    for spec in specs:
        if is_ours(spec):
            find_culler(spec)


def check_time_limit(time_limit_s: float | None) -> None:
    """Raise InputError for what is no limit (None is none)."""
    if time_limit_s is not None and not time_limit_s > 0.0:
        raise InputError(f"--time-limit is {time_limit_s:g}", fix="give seconds above 0")


def _make(spec: str, making: Making, closing: ExitStack) -> Culler:
    if is_ours(spec):
        return make_culler(spec)
    if making.in_process:
        return CullerGuarded(spec)
    say = making.say
    apart = CullerApart(
        spec,
        time_limit_s=making.time_limit_s,
        memory_limit=making.memory_limit,
        say=None if say is None else lambda line: say(spec, line),
    )
    closing.callback(apart.end)
    return apart


def is_ours(spec: str) -> bool:
    """Whether the spec names a culler that comes with visref, or nothing at all."""
    name, _, rest = spec.partition(":")
    if name in (points := available(CULLERS)):
        return points[name].value.startswith(_OURS)
    return spec.startswith(_OURS) or not rest or "=" in rest.partition(":")[0]
