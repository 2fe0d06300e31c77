"""Coherent hierarchical culling with one step broken."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from tests.mutants.common import COMMON, RemovedObjectsDrawn, common
from tests.mutants.harness import Suite, Trace, breaks, equivalent, mutant, not_here
from visref.camera_path import Frame
from visref.conformance.moving import moved, posed
from visref.conformance.scenes import Case, box, case, panel, pixel_panel, together
from visref.conformance.scenes import camera as camera_at
from visref_culling.boxes.conservative import inflated
from visref_culling.chc import CHC, CHCPlusPlus
from visref_culling.chc.nodes import INNER, Nodes
from visref_culling.queries.software_depth import SoftwareBuffer
from visref_culling.queries.under_way import BoxesUnderWay, SoftwareBoxes

SUITE = Suite(
    {
        "U1": "a box that the near plane cuts is asked about",
        "U2": "of the nodes of a query that passes, the first alone is visible",
        "U3": "the answer of one query taken for that of the next",
        "U4": "the last frame's answer counts in this one",
        "U5": "the last frame's answer counts after a cut",
        "U6": "boxes that stand for a node's own left where they were",
        "U7": "the boxes of inner nodes not refitted",
        "U8": "queries under way dropped once all nodes were looked at",
        "U9": "depth mask left on in queries",
        "U10": "of an opened node only the children that were visible are looked at",
        "U11": "a query of several nodes draws the first one's box",
        "U12": "the last of the boxes that stand for a node's own is left out",
        "U13": "what is known before a cut counts after it, where no answer is waited for",
        "U14": "answers that are not waited for come two frames late",
        "W15": "what holds a visible node stays hidden",
        "W16": "what holds nothing visible stays visible",
        "W17": "a visible leaf is never asked again",
        "W18": "all nodes of a query that passes are visible",
        "W19": "asked before what is visible is drawn",
        "W20": "the farthest child first",
        "W21": "what a hidden node holds is asked about",
    },
    watched=("coming_out_of_hiding", "crowd", "jump_cuts"),
)

ONE = SUITE.method("chc", CHC)
SEVERAL = SUITE.method("chc++", CHCPlusPlus)
SOFTWARE = SUITE.method("chc-software", CHC, query="software")
LATE = SUITE.method("chc-late", CHC, wait=False)
SEVERAL_LATE = SUITE.method("chc++-late", CHCPlusPlus, wait=False)

BY_GL = (ONE, SEVERAL)
WAITING = (ONE, SEVERAL, SOFTWARE)
NOT_WAITING = (LATE, SEVERAL_LATE)
HIDING = "coming_out_of_hiding"

SUITE.kept_by(ONE, SOFTWARE, LATE)
SUITE.kept_by(SEVERAL, SEVERAL_LATE, every=2)


# Contracts.


def is_leaf(trace: Trace, node: int) -> bool:
    return bool(trace.culler.nodes.unit[node] != INNER)


def below(trace: Trace, node: int) -> set[int]:
    """All nodes that a node holds."""
    nodes = trace.culler.nodes
    children = range(nodes.first_child[node], nodes.end_child[node])
    return set(children).union(*(below(trace, child) for child in children))


def opened(trace: Trace) -> Iterator[int]:
    """Nodes that were opened or drawn because they had been visible."""
    for look in trace.of("look"):
        if look["was_visible"] and not look["sure"]:
            yield look["node"]


def visible(trace: Trace) -> set[int]:
    """The nodes that a frame found visible."""
    memory = trace.culler.memory_of_view[trace.camera.view]
    looked = {look["node"] for look in trace.of("look")}
    return {node for node in np.flatnonzero(memory.visible).tolist() if node in looked}


@SUITE.contract
def what_holds_something_visible_is_visible(trace: Trace) -> Iterator[str]:
    """Each visible node's parent."""
    found = visible(trace)
    for node in found:
        parent = int(trace.culler.nodes.parent[node])
        if parent >= 0 and parent not in found:
            yield f"node {parent} is hidden, and holds {node}, which is visible"


@SUITE.contract
def what_was_opened_and_holds_nothing_visible_is_hidden(trace: Trace) -> Iterator[str]:
    """An inner node that was not asked about itself."""
    found = visible(trace)
    for node in opened(trace):
        if not is_leaf(trace, node) and node in found and not below(trace, node) & found:
            yield f"node {node} stays visible"


@SUITE.contract
def a_visible_leaf_is_asked_again(trace: Trace) -> Iterator[str]:
    """In each frame with `every=1`; with `every=2` in one of two frames."""
    every = trace.culler.every
    if every > 2:
        return
    asked = {node for ask in trace.of("ask") for node in ask["nodes"]}
    leaves = {node for node in opened(trace) if is_leaf(trace, node)}
    if every == 2:
        if trace.before is None or trace.camera.cut:
            return
        leaves &= set(opened(trace.before))
        asked |= {node for ask in trace.before.of("ask") for node in ask["nodes"]}
    yield from (f"leaf {leaf} is not asked again" for leaf in sorted(leaves - asked))


@SUITE.contract
def nodes_that_pass_together_are_asked_alone(trace: Trace) -> Iterator[str]:
    """Where answers are waited for."""
    if not trace.culler.waits:
        return
    due: set[int] = set()
    for event in trace.events:
        if event.step == "answer" and event.data["passed"] and len(event.data["nodes"]) > 1:
            due |= set(event.data["nodes"])
        if event.step == "ask" and len(event.data["nodes"]) == 1:
            due -= set(event.data["nodes"])
    yield from (f"node {node} is not asked alone" for node in sorted(due))


@SUITE.contract
def what_shows_is_drawn_before_the_next_question(trace: Trace) -> Iterator[str]:
    """So that it hides what is asked about."""
    unit = trace.culler.nodes.unit
    drawn: set[int] = set()
    due: set[int] = set()
    for event in trace.events:
        if event.step == "look":
            node, now = event.data["node"], event.data["was_visible"] or event.data["sure"]
            due |= {int(unit[node])} if now and is_leaf(trace, node) else set()
        elif event.step == "answer" and trace.culler.waits:
            alone = event.data["passed"] and len(event.data["nodes"]) == 1
            nodes = event.data["nodes"] if alone else ()
            due |= {int(unit[node]) for node in nodes if is_leaf(trace, node)}
        elif event.step == "draw":
            drawn |= set(event.data["units"].tolist())
        elif event.step == "ask":
            late = due - drawn
            yield from (f"unit {one} is drawn after a question" for one in sorted(late))


@SUITE.contract
def nearer_siblings_are_looked_at_first(trace: Trace) -> Iterator[str]:
    """By the least depth of what they hold."""
    nodes, camera, scene = trace.culler.nodes, trace.camera, trace.scene
    last: dict[int, float] = {}
    for look in trace.of("look"):
        node = look["node"]
        leaves = below(trace, node) | {node}
        units = [int(nodes.unit[leaf]) for leaf in leaves if is_leaf(trace, leaf)]
        low = scene.object_bounds[units, 0].min(axis=0)
        high = scene.object_bounds[units, 1].max(axis=0)
        corners = np.array(list(itertools.product(*np.stack([low, high]).T)))
        depth = float(((corners - camera.eye) @ camera.forward).min())
        parent = int(nodes.parent[node])
        # Boxes are inflated by a part of their size.
        if depth < last.get(parent, -np.inf) - 0.02 * (1.0 + abs(depth)):
            yield f"node {node} comes after a farther one"
        last[parent] = depth


@SUITE.contract
def what_a_hidden_node_holds_is_not_looked_at(trace: Trace) -> Iterator[str]:
    """In the frame in which it is found hidden."""
    hidden = {
        node for answer in trace.of("answer") if not answer["passed"] for node in answer["nodes"]
    }
    looked = {look["node"] for look in trace.of("look")}
    for node in sorted(hidden):
        if below(trace, node) & looked:
            yield f"node {node} is hidden, and what it holds is looked at"


@SUITE.contract
def nothing_is_known_after_a_cut(trace: Trace) -> Iterator[str]:
    """Where no answer is waited for, all that is in the view is then drawn."""
    if trace.culler.waits or not (trace.before is None or trace.camera.cut):
        return
    for look in trace.of("look"):
        if not look["was_visible"]:
            yield f"node {look['node']} is taken for hidden"


@SUITE.contract
def an_answer_counts_from_the_next_frame_on(trace: Trace) -> Iterator[str]:
    """Of a leaf, that is looked at again."""
    if trace.before is None or trace.camera.cut:
        return
    passed = {
        node: answer["passed"]
        for answer in trace.before.of("answer")
        for node in answer["nodes"]
        if is_leaf(trace, node) and (not answer["passed"] or len(answer["nodes"]) == 1)
    }
    for look in trace.of("look"):
        known = passed.get(look["node"])
        if known is not None and known != look["was_visible"]:
            yield f"leaf {look['node']} is taken for {'hidden' if known else 'visible'}"


# What is unsafe.


@mutant("U1", of=BY_GL, caught_by="cut_open_by_the_near_plane")
class CutOpenByTheNearPlane:
    """A box that the near plane cuts is asked about, and its part before the plane is not there."""

    def needs_no_query(self, view, boxes):
        return ((boxes[:, 0] <= 0.0) & (boxes[:, 1] >= 0.0)).all(axis=1)

    def query_state(self, state):
        return super().query_state(state)._replace(clamp_depth=False)


@mutant("U2", of=(SEVERAL,), caught_by=HIDING)
class FirstAloneShows:
    """If a query of several nodes passes, the first of them is asked alone, and no other."""

    def passed_together(self, walk, question):
        self.send(walk, [[question.nodes[0]]], drawn=False)


@mutant("U3", of=BY_GL, caught_by=HIDING)
class AnswerOfTheQueryBefore:
    """A query's answer is read from the place of the one before."""

    def queries_under_way(self):
        class Shifted(BoxesUnderWay):
            def samples(self, query):
                return super().samples(max(query - 1, 0))

        made = super().queries_under_way()
        made.__class__ = Shifted
        return made


@mutant("U4", of=BY_GL, caught_by=HIDING)
class AnswersNotWaitedFor:
    """What was hidden in the last frame is not drawn, and the answer counts in the next."""

    def __init__(self, **options):
        super().__init__(**options)
        self.waits = False


@mutant("U5", of=BY_GL, caught_by="cut_out_of_hiding")
class AnswersOfBeforeTheCut:
    """In a frame after a cut the answers of the frame before it count."""

    def cull(self, camera):
        self.waits = not camera.cut
        return super().cull(replace(camera, cut=False))


class AsHeldBefore:
    """Boxes of the pose in which the scene was met."""

    def prepare(self, scene):
        units = super().prepare(scene)
        self.first_boxes = self.nodes.boxes.copy()
        return units


@mutant("U6", of=(SEVERAL,), caught_by="carried_about")
class TightBoxesAtRest(AsHeldBefore):
    """The boxes that are drawn for a query are those of the pose at rest."""

    def walk(self, frame):
        walk = super().walk(frame)
        boxes = inflated(frame.view, self.first_boxes)
        self.under_way.begin(frame.view, frame.target, boxes, frame.stats)
        return walk


@mutant("U7", of=BY_GL, caught_by="out_of_its_group")
class InnerBoxesAtRest(AsHeldBefore):
    """What moves out of its node's box is looked for in that box."""

    def refit(self):
        super().refit()
        first = vars(self).get("first_boxes")
        if first is not None:
            inner = self.nodes.unit == INNER
            self.nodes.boxes[inner] = first[inner]


@mutant("U8", of=WAITING, caught_by="stacks_of_sheets")
class QuestionsDropped:
    """Once no node is left to look at, the answers under way are not read."""

    def traverse(self, walk):
        while walk.open:
            if walk.questions and self.is_there(walk):
                self.take(walk)
            else:
                self.look_at(walk, self.pop(walk))
                if not walk.open:
                    self.send_gathered(walk)
        walk.questions.clear()


@mutant("U9", of=BY_GL, caught_by="stacks_of_sheets")
class DepthMaskLeftOn:
    """Query boxes write their depth, and hide what is asked after them."""

    def query_state(self, state):
        return super().query_state(state)._replace(depth_write=True)


@mutant("U10", of=WAITING, caught_by=HIDING)
class OnlyVisibleChildren:
    """Children that were hidden are not looked at while their parent is visible."""

    def push(self, walk, nodes):
        memory = walk.memory
        super().push(
            walk, [node for node in nodes if memory.visible[node] or not memory.looked_last(node)]
        )


@mutant("U11", of=(SEVERAL,), caught_by=HIDING)
class OnlyTheFirstBoxAsked:
    """A query draws the boxes of the first of its nodes."""

    def queries_under_way(self):
        class First(BoxesUnderWay):
            def ask(self, ranges):
                return super().ask(list(ranges)[:1])

        made = super().queries_under_way()
        made.__class__ = First
        return made


@mutant("U12", of=(SEVERAL,), caught_by=HIDING)
class LastTightBoxLeftOut:
    """Of the boxes that stand for a node's own the last is not drawn."""

    def boxes_of(self, node):
        first, end = super().boxes_of(node)
        return first, max(end - 1, first + 1)


@mutant("M5", of=WAITING, caught_by="appearing_and_vanishing")
class NoNodeForWhatAppears:
    """What is absent when the scene is met has no leaf, then or later."""

    def nodes_of(self, units):
        return Nodes(self.tree.ids, self.tight)


# Where no answer is waited for.


@mutant("U13", of=NOT_WAITING, contract="nothing_is_known_after_a_cut")
class KnownAcrossACut:
    """A cut is overlooked."""

    def memory_for(self, camera):
        return super().memory_for(replace(camera, cut=False))


@mutant("U14", of=NOT_WAITING, contract="an_answer_counts_from_the_next_frame_on")
class TwoFramesLate:
    """A node is drawn by what was known of it a frame earlier."""

    def walk(self, frame):
        walk = super().walk(frame)
        self.then = vars(self).get("now", walk.memory.visible)
        self.now = walk.memory.visible.copy()
        return walk

    def was_visible(self, walk, node):
        if not walk.memory.looked_last(node):
            return True
        return bool(self.then[node])


# What is wasteful.


@mutant("W15", of=BY_GL, contract="what_holds_something_visible_is_visible")
class NothingPulledUp:
    """What is found visible is visible alone."""

    def pull_up(self, walk, node):
        walk.memory.visible[node] = True


@mutant("W16", of=BY_GL, contract="what_was_opened_and_holds_nothing_visible_is_hidden")
class OnceVisibleStaysOpen:
    """An inner node that was visible once is opened for good."""

    def go_on(self, walk, node):
        super().go_on(walk, node)
        if self.nodes.unit[node] == INNER:
            walk.memory.visible[node] = True


@mutant("W17", of=(ONE,), contract="a_visible_leaf_is_asked_again")
@mutant("W17", of=(SEVERAL,), contract="a_visible_leaf_is_asked_again", every=2)
class NeverAskedAgain:
    """What was visible once is visible while it is in view."""

    def is_due(self, walk, leaf):
        return False


@mutant("W18", of=(SEVERAL,), contract="nodes_that_pass_together_are_asked_alone")
class AllThatPassTogetherShow:
    """If a query of several nodes passes, all of them are visible."""

    def passed_together(self, walk, question):
        for node in question.nodes:
            self.found_visible(walk, node, new=True)
            self.go_on(walk, node)


@mutant("W19", of=(SEVERAL,), contract="what_shows_is_drawn_before_the_next_question")
class DrawnAtTheEnd:
    """What is visible is drawn when all answers are there."""

    def flush(self, walk):
        pass

    def end(self, walk):
        super().flush(walk)
        walk.later.clear()
        super().end(walk)


@mutant("W20", of=BY_GL, contract="nearer_siblings_are_looked_at_first")
class FarthestFirst:
    """Nodes are taken from far to near."""

    def walk(self, frame):
        walk = super().walk(frame)
        walk.nearest = [-depth for depth in walk.nearest]
        return walk


@mutant("W21", of=BY_GL, contract="what_a_hidden_node_holds_is_not_looked_at")
class HiddenNodesOpened:
    """Whatever a node's query says, its children are asked about."""

    def take(self, walk, *, in_time=True):
        nodes = list(walk.questions[0].nodes)
        before = walk.memory.hidden_for[nodes].copy()
        super().take(walk, in_time=in_time)
        for node in np.array(nodes)[walk.memory.hidden_for[nodes] > before].tolist():
            if self.nodes.unit[node] == INNER and in_time:
                self.go_on(walk, node)


@breaks("an_answer_counts_from_the_next_frame_on", of=(LATE,))
class NothingRemembered:
    """Each frame is the first."""

    def was_visible(self, walk, node):
        return True


# What any method can get wrong.

common("G2 G9 G10 G14 G15 M1 M2 M3 M5 M6", of=BY_GL)
common("G12", of=BY_GL, caught_by="crowd")
common("G13", of=BY_GL, caught_by="revealed_behind_glass")
common("M4", of=BY_GL, caught_by="without_the_wall")
common("G10", of=(SOFTWARE,), caught_by="walk_through_a_city")
common("G13 G15 M1 M2 M5 M6", of=(SOFTWARE,))


def in_software(name: str, about: str, begin) -> type:
    """A culler's step whose software boxes are others: `begin` changes them once they are made."""

    class Boxes(SoftwareBoxes):
        def begin(self, view, target, boxes, stats):
            before = self.buffer.depth.copy()
            super().begin(view, target, boxes, stats)
            begin(self, before)

    class Step:
        def queries_under_way(self):
            made = super().queries_under_way()
            made.__class__ = Boxes
            return made

    return type(name, (Step,), {"__doc__": about})


def _shorter(made, before):
    made.rectangles[:, 2:] = np.maximum(made.rectangles[:, 2:] - 1, made.rectangles[:, :2])


def _euclidean(made, before):
    low, high = made.boxes[:, 0], made.boxes[:, 1]
    made.depths = np.linalg.norm(np.maximum(np.maximum(low, -high), 0.0), axis=1)


def _of_centres(made, before):
    made.depths = made.boxes.mean(axis=1) @ made.view.depth_row


def _kept(made, before):
    if before.shape == made.buffer.depth.shape:
        made.buffer.depth[:] = before


mutant("G4", of=(SOFTWARE,), caught_by="peeking_by_a_pixel")(
    in_software("LastColumnLeftOut", "Rectangles end a column and a row early.", _shorter)
)
mutant("G5", of=(SOFTWARE,), caught_by="slanting_wall_before_a_screen")(
    in_software("EuclideanDistance", "A nearest point's distance is compared.", _euclidean)
)
mutant("G6", of=(SOFTWARE,), caught_by="slanting_wall_before_a_screen")(
    in_software("DepthOfTheCentre", "The centre stands for the nearest point.", _of_centres)
)
mutant("G11", of=(SOFTWARE,), caught_by="jump_cuts")(
    in_software("BufferOfTheLastFrame", "The depth buffer is not emptied.", _kept)
)


@mutant("M3", of=(SOFTWARE,), caught_by="sliding_door")
class SoftwareDepthAtItsOldPlace:
    """The software buffer's triangles are moved a change late."""

    def software_buffer(self):
        class Late(SoftwareBuffer):
            def update(self, scene):
                last, self.coming = vars(self).get("coming", self.scene), scene
                super().update(last)

        made = super().software_buffer()
        made.__class__ = Late
        return made


@mutant("M4", of=(SOFTWARE,), caught_by="without_the_wall")
class RemovedObjectsInTheSoftwareBuffer(RemovedObjectsDrawn):
    """What is absent keeps its triangles in the software buffer, and its box."""

    def prepare(self, scene):
        self.kept_triangles = scene.triangles.copy()
        return super().prepare(scene)

    def software_buffer(self):
        owner = self

        class Kept(SoftwareBuffer):
            def update(self, scene):
                owner.kept_triangles[scene.present] = scene.triangles[scene.present]
                super().update(replace(scene, triangles=owner.kept_triangles.copy(), absent=None))

        made = super().software_buffer()
        made.__class__ = Kept
        return made


not_here(
    "G1 G3 G4 G5 G6 G7",
    BY_GL,
    "the rasteriser projects and rounds the box and compares the depths: nothing is tested, "
    "and nothing read back, on the CPU",
)
not_here(
    "G8",
    WAITING,
    "an object's own depth is not there when its box is asked to say whether it is drawn",
)
not_here("G11", BY_GL, "no depth is kept from one frame to the next")
not_here("U2 U11", (ONE, SOFTWARE), "a query is about one node")
not_here("U6 U12", (ONE, SOFTWARE), "a node's own box is asked about")
not_here("U13 U14", WAITING, "answers are waited for")
not_here("W18 W19", (ONE, SOFTWARE), "a query is about one node, and follows what is drawn at once")
not_here("G2 G9 G12 G14 U1 U3 U9", (SOFTWARE,), "no box is rasterised, and no sample counted")
not_here("G7", (SOFTWARE,), "the depth is read as it was written")
not_here("U4 U5 U7 W15 W16 W17 W20 W21", (SOFTWARE,), "the traversal is chc's")
equivalent(
    "G1",
    (SOFTWARE,),
    "a corner behind the eye makes the least depth negative, which nothing hides",
)
equivalent(
    "G3",
    (SOFTWARE,),
    "in whole pixels, sides rounded to nearest hold exactly the pixels whose centres lie in the "
    "unrounded rectangle, and the box is inflated by more than a centre can be off",
)
UNSAFE = [id for id in (*COMMON, *SUITE.ids) if id not in ("U13", "U14") and id[0] != "W"]
not_here(" ".join(UNSAFE), NOT_WAITING, "they promise nothing: what they leave out is measured")
not_here(
    " ".join(id for id in SUITE.ids if id.startswith("W")),
    NOT_WAITING,
    "the traversal is that of the methods that wait",
)


# Scenes.


def behind_a_wall(rng: np.random.Generator) -> list:
    """A wall, many boxes behind it, and some beside it. Neighbours are far from others, so that the
    hierarchy has many nodes that hold hidden things alone."""
    objects = [("wall", panel((-1.5, 1.5), (-6.0, 6.0), -6.0))]
    for number in range(48):
        x, y = -1.9 + 0.55 * (number % 8), -2.4 + 0.9 * (number // 8)
        centre = np.array([x, y, -9.5 - rng.uniform(0.0, 0.4)])
        objects.append((f"behind {number}", box(centre - 0.1, centre + 0.1)))
    for number in range(8):
        x = (-1.0 if number % 2 else 1.0) * rng.uniform(2.2, 2.6)
        centre = np.array([x, rng.uniform(-2.0, 2.0), -6.5])
        objects.append((f"beside {number}", box(centre - 0.15, centre + 0.15)))
    return objects


@SUITE.scene("shows what a wall hid for some frames as the camera moves aside")
def coming_out_of_hiding(rng: np.random.Generator) -> Case:
    """The camera stands still for a while, before it moves to either side."""
    still = camera_at()
    right, left = camera_at(eye=(3.0, 0.0, 0.0)), camera_at(eye=(-3.0, 0.0, 0.0))
    views = [still] * 4 + [right, right, left, left, still, still]
    return case(behind_a_wall(rng), views)


@SUITE.scene("shows what a wall hid before the camera cuts to its side")
def cut_out_of_hiding(rng: np.random.Generator) -> Case:
    """As `coming_out_of_hiding`, by a cut."""
    still, aside = camera_at(), camera_at(eye=(3.0, 0.0, 0.0), cut=True)
    return case(behind_a_wall(rng), [still, still, aside])


@SUITE.scene("shows what alone is seen by rays that enter its box before the near plane")
def cut_open_by_the_near_plane(rng: np.random.Generator) -> Case:
    """A wall right behind the near plane hides where its box would be entered behind it; the object
    reaches past the eye, and the wall, which comes first, farther past it."""
    view = camera_at(near=1.0)
    past = np.array([[-0.5, 0.0, 1.0], [-0.5, 0.01, 1.0], [-0.5, 0.0, 0.99]])
    wall = together(
        pixel_panel(view, (-1.5, 58.5), (-1.5, 49.5), 1.01), (past, np.array([[0, 1, 2]]))
    )
    far = pixel_panel(view, (59.5, 65.5), (10.5, 30.5), 8.0)
    # Rays to column 58 meet x = 0.617 behind the wall, those to column 59 before the near plane.
    behind = np.array([[0.617, 0.0, 0.5], [0.617, 0.01, 0.5], [0.617, 0.0, 0.49]])
    seen = together(far, (behind, np.array([[0, 1, 2]])))
    return case([("wall", wall), ("seen", seen)], [view, view])


@SUITE.scene("shows what moves out of the box of its neighbours")
def out_of_its_group(rng: np.random.Generator) -> Case:
    """Boxes beside the view, of which one after the other comes into it."""
    objects = behind_a_wall(rng)
    for number in range(16):
        x = 60.0 + number
        objects.append((f"far {number}", box((x, -0.5, -20.0), (x + 0.5, 0.5, -19.0))))
    frames = [Frame((camera_at(),)) for _ in range(2)]
    for number in range(0, 16, 3):
        where = {f"far {number}": moved(x=-54.0 - number)}
        frames.append(Frame((camera_at(),), world_from_object=where))
    return posed(objects, frames)


@SUITE.scene("shows what a wall hid once the wall is gone")
def without_the_wall(rng: np.random.Generator) -> Case:
    """The camera stands still, and the wall is there for some frames."""
    gone = [(), (), (), ("wall",), (), (), ("wall",)]
    return posed(behind_a_wall(rng), [Frame((camera_at(),), absent=names) for names in gone])
