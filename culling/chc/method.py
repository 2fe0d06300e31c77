"""Coherent hierarchical culling: what was seen is drawn at once, what was hidden is asked about.

J. Bittner, M. Wimmer, H. Piringer, W. Purgathofer: Coherent Hierarchical Culling: Hardware
Occlusion Queries Made Useful. Computer Graphics Forum 23(3), 2004 (`chc`).
O. Mattausch, J. Bittner, M. Wimmer: CHC++: Coherent Hierarchical Culling Revisited. Computer
Graphics Forum 27(2), 2008 (`chc++`).

A hierarchy of boxes is traversed front to back. A node that was hidden in the last frame, or was
not looked at there, is asked about by an occlusion query, and the traversal goes on elsewhere until
the answer is there; then it is opened, or left alone with all that it holds. An inner node that was
visible is opened without asking. A leaf that was visible is drawn at once; whether it still shows
is asked for the next frame's sake. What was found visible makes its ancestors visible
(`pull_up`), so that the next frame opens them: the questions move up and down in the hierarchy with
what shows.

`chc++` adds:

- Hidden nodes are gathered, and asked about together once there are `batch` of them or nothing else
  is to do: GL's state changes once for all, and draws go out together before.
- One query is about several nodes (`multi`) that are likely to stay hidden; if it passes, each is
  asked alone.
- Visible leaves are asked again every few frames (`every`), at first after a number of frames that
  is drawn by lot, so that their turns spread; and while an answer is waited for, or at the end.
- The boxes of a node's descendants stand for its own where their surfaces are not much larger
  (`tight`).
- The node of the nearest box comes first, from anywhere in the hierarchy.

What is safe, and what is not: memory only chooses what is drawn without asking. A hidden node is
hidden in this frame, by what was drawn in it before, with this frame's camera; so neither a cut nor
anything that moves makes it unsafe. With `wait=false` no answer is waited for: what was hidden is
not drawn, and asked about; the answer counts from the next frame on. What was not looked at in the
last frame, or follows a cut, is drawn. Then what comes into view is late by one frame. That is
approximate, and so is a `threshold` above 0.

Departures from the papers:

- The hierarchy's nodes have up to eight children; its leaves are the scene's objects. It is
  refitted to what moves, and never built again.
- When a GPU has an answer hangs on time, and the same input must give the same set. So an answer
  counts as there once `ahead` further nodes were looked at; nothing else hangs on that but costs.
- A box across the near plane, or around the eye, is visible without a query.
- Boxes are inflated (`boxes.conservative`).
- How likely a node is to stay hidden, which says what is asked together, was measured in the paper
  and is a fixed curve here. With `wait=false`, if such a query passes, all its nodes are visible.
- `every=1` in `chc` asks visible leaves in each frame; in 2004 that is the algorithm, and to ask
  less often an extension.
- With `query=software` a visible leaf is asked about by its box, and not by the drawing of its own
  triangles.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from heapq import heappop, heappush
from typing import ClassVar

from visref.culler import Option
from visref_culling.chc.coherent import (
    COHERENT_OPTIONS,
    MOST_TIGHT,
    CoherentCulling,
    Walk,
    within,
)
from visref_culling.chc.multiquery import chance_of_staying_hidden, multiqueries
from visref_culling.queries.under_way import BoxesUnderWay


class CHC(CoherentCulling):
    """One query at a time, depth first."""

    name = "chc"
    summary = (
        "Bittner et al. 2004: hidden nodes of a hierarchy are asked while visible ones are drawn"
    )
    options: ClassVar[Mapping[str, Option]] = {
        "every": Option(1, "frames from one query of a visible leaf to the next, 1 or more"),
        **COHERENT_OPTIONS,
    }

    def __init__(
        self,
        *,
        every: int = 1,
        wait: bool = True,
        ahead: int = 8,
        threshold: int = 0,
        query: str = "gl",
        backfaces: bool = False,
        depth: int = 24,
        fragments: bool = False,
    ) -> None:
        super().__init__(
            every=every,
            tight=0,
            wait=wait,
            ahead=ahead,
            threshold=threshold,
            query=query,
            backfaces=backfaces,
            depth=depth,
            fragments=fragments,
        )

    def push(self, walk: Walk, nodes: Iterable[int]) -> None:
        # The nearest comes off the stack first.
        walk.open += sorted(((walk.nearest[node], node) for node in nodes), reverse=True)

    def pop(self, walk: Walk) -> int:
        return walk.open.pop()[1]

    def go_on(self, walk: Walk, node: int) -> None:
        super().go_on(walk, node)
        self.flush(walk)

    def ask_hidden(self, walk: Walk, node: int) -> None:
        self.send(walk, [[node]], drawn=False)

    def ask_visible(self, walk: Walk, leaf: int) -> None:
        if not isinstance(self.under_way, BoxesUnderWay):
            self.go_on(walk, leaf)
            self.send(walk, [[leaf]], drawn=True)
            return
        unit = self.nodes.unit[leaf : leaf + 1]
        query = self.under_way.ask_around(lambda: self.draw(walk.frame, unit))
        self.enqueue(walk, query, [leaf], drawn=True, of_drawing=True)
        walk.groups += 1


class CHCPlusPlus(CoherentCulling):
    """Queries gathered, several nodes in one, the nearest node first."""

    name = "chc++"
    summary = (
        "Mattausch et al. 2008: CHC with queries gathered, of several nodes, and of visible ones "
        "only at times"
    )
    options: ClassVar[Mapping[str, Option]] = {
        "batch": Option(20, "hidden nodes gathered before they are asked about, 1 or more"),
        "multi": Option(True, "one query about several nodes that are likely to stay hidden"),
        "every": Option(5, "frames from one query of a visible leaf to the next, 1 or more"),
        "tight": Option(
            3, f"levels below a node whose boxes may stand for its own, 0 to {MOST_TIGHT}"
        ),
        **COHERENT_OPTIONS,
    }

    def __init__(
        self,
        *,
        batch: int = 20,
        multi: bool = True,
        every: int = 5,
        tight: int = 3,
        wait: bool = True,
        ahead: int = 8,
        threshold: int = 0,
        query: str = "gl",
        backfaces: bool = False,
        depth: int = 24,
        fragments: bool = False,
    ) -> None:
        super().__init__(
            every=every,
            tight=tight,
            wait=wait,
            ahead=ahead,
            threshold=threshold,
            query=query,
            backfaces=backfaces,
            depth=depth,
            fragments=fragments,
        )
        within("batch", batch, 1, None)
        self.batch, self.multi = batch, multi

    def push(self, walk: Walk, nodes: Iterable[int]) -> None:
        for node in nodes:
            heappush(walk.open, (walk.nearest[node], node))

    def pop(self, walk: Walk) -> int:
        return heappop(walk.open)[1]

    def ask_hidden(self, walk: Walk, node: int) -> None:
        walk.gathered.append(node)
        if len(walk.gathered) >= self.batch:
            self.send_gathered(walk)

    def send_gathered(self, walk: Walk) -> None:
        if walk.gathered:
            nodes, walk.gathered = walk.gathered, []
            self.send(walk, self.groups_of(walk, nodes), drawn=False)

    def groups_of(self, walk: Walk, nodes: Sequence[int]) -> list[list[int]]:
        """Which hidden nodes are asked together."""
        if not self.multi:
            return [[node] for node in nodes]
        hidden_for = walk.memory.hidden_for[list(nodes)].tolist()
        groups = multiqueries([chance_of_staying_hidden(frames) for frames in hidden_for])
        return [[nodes[place] for place in group] for group in groups]

    def ask_visible(self, walk: Walk, leaf: int) -> None:
        self.go_on(walk, leaf)
        walk.later.append(leaf)

    def while_waiting(self, walk: Walk) -> None:
        if walk.later:
            self.send(walk, [[walk.later.popleft()]], drawn=True)
