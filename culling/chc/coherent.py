"""What both methods share: nodes that are remembered, and questions that are under way."""

from __future__ import annotations

from abc import abstractmethod
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from visref.camera import Camera
from visref.culler import Option, Promise
from visref.errors import InputError
from visref.scene import Float64, Scene, Units
from visref_culling.boxes.conservative import (
    inflated,
    meets_frustum,
    nearest_depth,
    round_outward,
)
from visref_culling.chc.memory import Memory, drawn_by_lot
from visref_culling.chc.nodes import INNER, NO_PARENT, Nodes
from visref_culling.gl.changes import Changes
from visref_culling.gl.item_buffer import GLRaster
from visref_culling.gl.view import View
from visref_culling.method import GL_OPTIONS, QUERY_OPTIONS, Asked, Frame, GLCuller, phase
from visref_culling.queries.software_depth import SoftwareBuffer
from visref_culling.queries.under_way import BoxesUnderWay, SoftwareBoxes, UnderWay

MOST_TIGHT = 5


@dataclass(frozen=True)
class Question:
    """A query under way: its number and the nodes it is about; whether they are drawn already, and
    whether it is about that drawing and not about boxes; after how many nodes that were looked at
    it was sent, and with which others."""

    query: int
    nodes: tuple[int, ...]
    drawn: bool
    of_drawing: bool
    sent_at: int
    group: int


@dataclass(eq=False)
class Walk:
    """One frame's traversal. Of all nodes: `boxes`, (n, 2, 3) float64, inflated, relative to the
    eye; `inside`, whether they meet the view; `sure`, whether they are visible without a query;
    `nearest`, the least view depth.

    `open`: nodes to look at, as the method keeps them; `gathered`: hidden nodes to ask about;
    `later`: visible leaves to ask about; `waiting`: units to draw before the next query; `awaited`:
    how many questions are about what is not drawn yet.
    """

    frame: Frame
    memory: Memory
    boxes: Float64
    inside: list[bool]
    sure: list[bool]
    nearest: list[float]
    open: list[tuple[float, int]] = field(default_factory=list)
    questions: deque[Question] = field(default_factory=deque)
    gathered: list[int] = field(default_factory=list)
    later: deque[int] = field(default_factory=deque)
    waiting: list[int] = field(default_factory=list)
    awaited: int = 0
    looked: int = 0
    groups: int = 0
    waited_for: int = -1


COHERENT_OPTIONS: dict[str, Option] = {
    "wait": Option(
        True, "wait for hidden nodes' answers; else they count a frame later, not conservative"
    ),
    "ahead": Option(8, "nodes looked at while an answer is under way, 1 or more"),
    "threshold": Option(0, "samples up to which a node is hidden; above 0 not conservative"),
    "query": Option(
        "gl", "GL's occlusion queries, or a depth buffer on the CPU", ("gl", "software")
    ),
    "backfaces": QUERY_OPTIONS["backfaces"],
    **GL_OPTIONS,
}


class CoherentCulling(GLCuller):
    """What both methods share: nodes that are remembered, and questions that are under way."""

    notes_asked = True

    def __init__(
        self,
        *,
        every: int,
        tight: int,
        wait: bool,
        ahead: int,
        threshold: int,
        query: str,
        backfaces: bool,
        depth: int,
        fragments: bool,
    ) -> None:
        super().__init__(depth=depth, fragments=fragments)
        within("every", every, 1, None)
        within("tight", tight, 0, MOST_TIGHT)
        within("ahead", ahead, 1, None)
        within("threshold", threshold, 0, None)
        if threshold and query == "software":
            raise InputError(
                "query=software counts no samples", place="threshold", fix="leave threshold out"
            )
        self.every, self.tight, self.waits, self.ahead = every, tight, wait, ahead
        self.threshold, self.software = threshold, query == "software"
        self.query_back_faces = backfaces
        if threshold or not wait:
            self.promise = Promise.APPROXIMATE

    def prepare(self, scene: Scene) -> Units:
        units = super().prepare(scene)
        self.nodes = self.nodes_of(units)
        self.refit()
        self.memory_of_view: dict[str, Memory] = {}
        self.under_way = self.queries_under_way()
        return units

    def follow(self, changes: Changes) -> None:
        super().follow(changes)
        self.refit()
        if isinstance(self.under_way, SoftwareBoxes):
            self.under_way.buffer.update(self.scene)

    # The steps.

    def nodes_of(self, units: Units) -> Nodes:
        # What is absent now may appear, and needs a leaf.
        there = self.tree.ids
        absent = np.setdiff1d(np.flatnonzero(units.sizes), there)
        return Nodes(np.concatenate([there, absent]), self.tight)

    def refit(self) -> None:
        self.nodes.refit(self.unit_boxes)

    def software_buffer(self) -> SoftwareBuffer:
        occludes = self.occluders(self.scene)
        return SoftwareBuffer(self.scene, self.units, occludes, marks_only=False)

    def queries_under_way(self) -> UnderWay:
        if self.software:
            return SoftwareBoxes(self.software_buffer())
        return BoxesUnderWay(
            self.queries,
            cull_back_faces=not self.query_back_faces,
            state_hook=self.query_state,
        )

    def raster_of(self, scene: Scene) -> GLRaster | None:
        return None if self.software else super().raster_of(scene)

    def memory_for(self, camera: Camera) -> Memory:
        """What the camera's view remembers; nothing in its first frame and after a cut."""
        if camera.cut or camera.view not in self.memory_of_view:
            self.memory_of_view[camera.view] = Memory(self.nodes.count)
        return self.memory_of_view[camera.view]

    def in_view(self, view: View, boxes: Float64) -> list[bool]:
        """(n) bool, False for nodes that hold nothing or lie wholly outside the view."""
        result: list[bool] = (self.nodes.there & meets_frustum(view, boxes)).tolist()
        return result

    def was_visible(self, walk: Walk, node: int) -> bool:
        """Whether to draw or open the node without an answer. What was not looked at in the last
        frame is hidden until it is asked about, or visible where no answer is waited for."""
        if not walk.memory.looked_last(node):
            return not self.waits
        return bool(walk.memory.visible[node])

    def is_due(self, walk: Walk, leaf: int) -> bool:
        """Whether a visible leaf is asked again."""
        memory = walk.memory
        return bool(memory.due[leaf] <= memory.frame)

    def passes_one(self, samples: int) -> bool:
        """Whether a query means visible, from its passing samples."""
        return bool(self.passes(np.array([samples]) - self.threshold)[0])

    def boxes_of(self, node: int) -> tuple[int, int]:
        """The range of nodes whose boxes stand for the node's."""
        return int(self.nodes.first_tight[node]), int(self.nodes.end_tight[node])

    def pull_up(self, walk: Walk, node: int) -> None:
        """The node is visible, and so is what holds it."""
        visible, parent = walk.memory.visible, self.nodes.parent
        while node != NO_PARENT and not visible[node]:
            visible[node] = True
            node = int(parent[node])

    @abstractmethod
    def push(self, walk: Walk, nodes: Iterable[int]) -> None:
        """Nodes to look at."""

    @abstractmethod
    def pop(self, walk: Walk) -> int:
        """The node to look at next."""

    @abstractmethod
    def ask_hidden(self, walk: Walk, node: int) -> None:
        """A node that was not visible."""

    @abstractmethod
    def ask_visible(self, walk: Walk, leaf: int) -> None:
        """A leaf that was visible; draws it."""

    def send_gathered(self, walk: Walk) -> None:
        """Nothing else is left to look at."""

    def while_waiting(self, walk: Walk) -> None:
        """What there is to do before an answer that is not there yet."""

    # The method.

    def begin(self, camera: Camera) -> Frame:
        return self.open(camera)

    def decide(self, frame: Frame) -> None:
        frame.ids = np.arange(self.units.count)
        if not self.nodes.count:
            return
        with phase(frame.stats, "sort"):
            walk = self.walk(frame)
        self.push(walk, [self.nodes.count - 1])
        self.traverse(walk)
        self.end(walk)
        walk.memory.frame += 1

    def walk(self, frame: Frame) -> Walk:
        view = frame.view
        boxes = inflated(view, self.nodes.boxes)
        self.under_way.begin(view, frame.target, boxes, frame.stats)
        frame.stats.tests_skipped = 0
        return Walk(
            frame,
            self.memory_for(view.camera),
            boxes,
            self.in_view(view, boxes),
            self.needs_no_query(view, boxes).tolist(),
            nearest_depth(view, boxes).tolist(),
        )

    def traverse(self, walk: Walk) -> None:
        while walk.open or (self.waits and walk.awaited):
            if self.waits and walk.questions and (not walk.open or self.is_there(walk)):
                if not self.is_there(walk):
                    self.wait(walk)
                self.take(walk)
            else:
                self.look_at(walk, self.pop(walk))
                if not walk.open:
                    self.send_gathered(walk)

    def is_there(self, walk: Walk) -> bool:
        """Whether the next answer counts as there."""
        return walk.looked - walk.questions[0].sent_at >= self.ahead

    def wait(self, walk: Walk) -> None:
        self.while_waiting(walk)
        question = walk.questions[0]
        # Queries that went out together are waited for together, and none about what is drawn.
        if not question.drawn and question.group != walk.waited_for:
            walk.waited_for = question.group
            walk.frame.stats.batches = (walk.frame.stats.batches or 0) + 1

    def look_at(self, walk: Walk, node: int) -> None:
        walk.looked += 1
        if not walk.inside[node]:
            return
        memory, leaf = walk.memory, self.nodes.unit[node] != INNER
        was_visible = self.was_visible(walk, node)
        if not memory.looked_last(node):
            memory.due[node] = memory.hidden_for[node] = 0
        memory.visible[node] = False
        memory.looked[node] = memory.frame
        self.observe("look", node=node, was_visible=was_visible, sure=walk.sure[node])
        if walk.sure[node]:
            self.pull_up(walk, node)
            self.go_on(walk, node)
        elif not was_visible:
            self.ask_hidden(walk, node)
        elif leaf and self.is_due(walk, node):
            self.ask_visible(walk, node)
        else:
            stats = walk.frame.stats
            stats.tests_skipped = (stats.tests_skipped or 0) + 1
            if leaf:
                self.pull_up(walk, node)
            self.go_on(walk, node)

    def go_on(self, walk: Walk, node: int) -> None:
        """The node is visible: its children come next, or its unit is drawn."""
        unit = int(self.nodes.unit[node])
        if unit == INNER:
            self.push(walk, range(self.nodes.first_child[node], self.nodes.end_child[node]))
        else:
            walk.waiting.append(unit)

    def send(self, walk: Walk, groups: Iterable[Sequence[int]], *, drawn: bool) -> None:
        """Queries that go out together, each about some nodes."""
        self.flush(walk)
        for nodes in groups:
            with phase(walk.frame.stats, "query"):
                query = self.under_way.ask([self.boxes_of(node) for node in nodes])
            self.enqueue(walk, query, nodes, drawn=drawn)
        walk.groups += 1

    def enqueue(
        self,
        walk: Walk,
        query: int,
        nodes: Sequence[int],
        *,
        drawn: bool,
        of_drawing: bool = False,
    ) -> None:
        question = Question(query, tuple(nodes), drawn, of_drawing, walk.looked, walk.groups)
        walk.questions.append(question)
        if not drawn:
            walk.awaited += 1
            units = self.nodes.unit[list(nodes)]
            walk.frame.note_asked(units[units != INNER])
        self.observe("ask", nodes=question.nodes, drawn=drawn)

    def take(self, walk: Walk, *, in_time: bool = True) -> None:
        """The answer of the question that was sent first. One that is not in time changes nothing
        in this frame."""
        question = walk.questions.popleft()
        walk.awaited -= not question.drawn
        with phase(walk.frame.stats, "query"):
            samples = self.under_way.samples(question.query)
        self.note_boxes(walk, question, samples)
        passed = self.passes_one(samples)
        self.observe("answer", nodes=question.nodes, samples=samples, passed=passed)
        if not passed:
            walk.memory.hidden_for[list(question.nodes)] += 1
        elif len(question.nodes) > 1 and in_time:
            self.passed_together(walk, question)
        else:
            for node in question.nodes:
                self.found_visible(walk, node, new=not question.drawn)
                if in_time and not question.drawn:
                    self.go_on(walk, node)

    def passed_together(self, walk: Walk, question: Question) -> None:
        """One of several nodes shows, or more of them do."""
        self.send(walk, [[node] for node in question.nodes], drawn=False)

    def found_visible(self, walk: Walk, node: int, *, new: bool) -> None:
        self.pull_up(walk, node)
        memory = walk.memory
        memory.hidden_for[node] = 0
        if new or memory.due[node] == 0:
            memory.due[node] = memory.frame + 1 + drawn_by_lot(node, memory.frame, self.every)
        else:
            memory.due[node] = memory.frame + self.every

    def end(self, walk: Walk) -> None:
        """What is left to draw, and answers that count from the next frame on."""
        if walk.later:
            self.send(walk, [[leaf] for leaf in walk.later], drawn=True)
            walk.later.clear()
        self.flush(walk)
        while walk.questions:
            self.take(walk, in_time=False)

    def flush(self, walk: Walk) -> None:
        """Draw what waits."""
        if walk.waiting:
            units = np.array(walk.waiting)
            walk.waiting.clear()
            self.draw(walk.frame, units)
            with phase(walk.frame.stats, "query"):
                self.under_way.drawn(units)

    def note_boxes(self, walk: Walk, question: Question, samples: int) -> None:
        """For counting fragments, of what GL was asked."""
        if self.count_fragments and not self.software and not question.of_drawing:
            places = np.concatenate([np.arange(*self.boxes_of(node)) for node in question.nodes])
            boxes = round_outward(walk.boxes[places])
            walk.frame.asked.append(Asked(boxes, np.full(len(boxes), samples), False))


def within(name: str, value: int, least: int, most: int | None) -> None:
    if value < least or (most is not None and value > most):
        until = "or more" if most is None else f"to {most}"
        raise InputError(f"{name} is {value}", place=name, fix=f"give {least} {until}")
