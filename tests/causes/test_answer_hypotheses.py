"""Answers of another moment, view or object, other poses, and what is left out whatever is there:
which objects of small scenes each mistake would drop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.causes.small import (
    Stage,
    at,
    block,
    cases_of,
    check,
    claims,
    hypothesis,
    named,
    names,
    plain,
    sheet,
    wide,
)
from visref.camera import look_at
from visref.camera_path import CameraPath, Frame
from visref.causes.evidence import Answers
from visref.causes.in_view import kept_by_depth
from visref.causes.sights import Sights
from visref.conformance.building import Case, box, case, panel
from visref.conformance.moving import about, moved, posed
from visref.scene import Alpha, Units

# A row of posts along x, 8 apart, seen in turn: a view 16 wide about x = 8 k sees, of posts at
# 8 i + 4, those of i = k - 1 and k.


def along(x, view="", **changes):
    pose = look_at((8.0 * x, 0.0, 0.0), (8.0 * x, 0.0, -1.0))
    return replace(plain(16, 16, **changes), world_from_camera=pose, view=view)


def posts(count):
    return [(f"post{i}", box((8 * i + 3, -1, -6), (8 * i + 5, 1, -5))) for i in range(count)]


LAST = 10
AGES = {
    "one-frame-late": 1,
    "two-frames-late": 2,
    **{f"n-frames-late: {n} frames": n for n in (3, 4, 5, 6, 8)},
    "first-answer-kept": LAST,
}
EVERY_POST = {f"post{i}" for i in range(LAST + 1)}


def all_but(*kept):
    """The other posts, as claims write them."""
    return " ".join(sorted(EVERY_POST - {f"post{i}" for i in kept}))


def passing_by(answers_of=None):
    """Frame k looks at x = 8 k: of the last, 10, posts 9 and 10 show, in the one before 8 and 9."""
    built = case(posts(LAST + 1), [along(k) for k in range(LAST + 1)])
    drawn = {}
    if answers_of is not None:
        seen = [f"post{answers_of - 1}", f"post{answers_of}"][answers_of == 0 :]
        drawn = {(answers_of, ""): seen, (LAST, ""): seen}
    return Stage(built, LAST, drawn=drawn)


def repeating(age):
    def repeated():
        return passing_by(LAST - age)

    repeated.__name__ = f"repeated_{age}"
    return repeated


def at_the_start():
    return replace(passing_by(), frame=0)


def with_cuts():
    """Cut at frames 7 and 10, which look at x of 56 and 80: before the last cut x was 72."""
    views = [along(k, cut=k in (7, LAST)) for k in range(LAST + 1)]
    return Stage(case(posts(LAST + 1), views), LAST)


def three_after_a_cut():
    views = [along(k, cut=k == 7) for k in range(LAST + 1)]
    return Stage(case(posts(LAST + 1), views), LAST)


def repeated_across_a_cut():
    seen = ["post8", "post9"]
    return replace(with_cuts(), drawn={(9, ""): seen, (LAST, ""): seen})


def repeated_since_a_cut():
    seen = ["post6", "post7"]
    return replace(three_after_a_cut(), drawn={(7, ""): seen, (LAST, ""): seen})


def repeated_since_before_a_cut():
    seen = ["post5", "post6"]
    return replace(three_after_a_cut(), drawn={(6, ""): seen, (LAST, ""): seen})


def _late_lines(how, name, age):
    cause, _, variant = name.partition(": ")
    variants = "; ".join(f"{variant}, {one}" if variant else one for one in how)
    then = LAST - age
    return f"{cause}: {variants} -> {all_but(then - 1, then)}"


LATE = [
    *claims(
        passing_by,
        *(_late_lines(("what shows", "boxes"), name, age) for name, age in AGES.items()),
        f"last-view: -> {all_but(8, 9)}",
        # No answers are known.
        "one-frame-late: repeated -> says nothing",
        "first-answer-kept: repeated -> says nothing",
        "across-a-cut: what shows; since, what shows; from before, what shows -> says nothing",
        "other-view: what shows; before, what shows; view -> says nothing",
        "first-view-only: what shows; view -> says nothing",
        seen=False,
    ),
    *(
        claim
        for name, age in AGES.items()
        for claim in claims(repeating(age), _late_lines(("repeated",), name, age), seen=False)
    ),
    # What was drawn two frames before is not what was drawn in the one before.
    *claims(repeating(2), "one-frame-late: repeated -> says nothing"),
    *claims(
        at_the_start,
        "one-frame-late: what shows; boxes -> says nothing",
        "first-answer-kept: what shows; boxes; nothing new -> says nothing",
        "last-view: -> says nothing",
        "old-depth: then; not cleared -> says nothing",
    ),
    *claims(
        with_cuts,
        f"across-a-cut: what shows; boxes -> {all_but(8, 9)}",
        seen=False,
    ),
    *claims(repeated_across_a_cut, f"across-a-cut: repeated -> {all_but(8, 9)}", seen=False),
    *claims(repeated_since_a_cut, f"across-a-cut: since, repeated -> {all_but(6, 7)}", seen=False),
    *claims(
        three_after_a_cut,
        "across-a-cut: what shows; boxes -> says nothing",
        f"across-a-cut: since, what shows; since, boxes -> {all_but(6, 7)}",
        f"across-a-cut: from before, what shows; from before, boxes -> {all_but(5, 6)}",
        seen=False,
    ),
    *claims(
        repeated_since_before_a_cut,
        f"across-a-cut: from before, repeated -> {all_but(5, 6)}",
        seen=False,
    ),
]


def two_views(view, frame=1):
    """In frame f the left view looks at x = 16 f and the right one 8 beside it: in frame 1 left
    shows posts 1 and 2, right 2 and 3; in frame 0 right shows 0 and 1."""
    frames = [Frame((along(2 * f, "left"), along(2 * f + 1, "right"))) for f in (0, 1)]
    built = case(posts(5), [along(0)])
    return Stage(Case(built.scene, CameraPath(frames)), frame, view)


def left_view():
    return two_views("left")


def right_view():
    return two_views("right")


def right_repeats_left():
    drawn = {(1, "left"): ["post1", "post2"], (1, "right"): ["post1", "post2"]}
    return replace(right_view(), drawn=drawn)


def left_repeats_right():
    drawn = {(0, "right"): ["post0", "post1"], (1, "left"): ["post0", "post1"]}
    return replace(left_view(), drawn=drawn)


def both_repeat_right():
    drawn = {(1, "right"): ["post2", "post3"], (1, "left"): ["post2", "post3"]}
    return replace(left_view(), drawn=drawn)


VIEWS = [
    *claims(
        right_view,
        "first-view-only: view; what shows; boxes -> post0 post3 post4",
        "other-view: view; what shows; boxes -> post0 post3 post4",
        "other-view: before, what shows; before, boxes -> post0 post3 post4",
        seen=False,
    ),
    *claims(
        left_view,
        "first-view-only: what shows; boxes; repeated -> says nothing",
        # In the first view its own sides are those that should be.
        "first-view-only: view -> post0 post3 post4",
        "other-view: view; what shows; boxes -> post0 post1 post4",
        "other-view: before, what shows; before, boxes -> post2 post3 post4",
        seen=False,
    ),
    *claims(
        right_repeats_left,
        "first-view-only: repeated -> post0 post3 post4",
        "other-view: repeated; before, repeated -> post0 post3 post4",
        seen=False,
    ),
    *claims(left_repeats_right, "other-view: before, repeated -> post2 post3 post4", seen=False),
    *claims(both_repeat_right, "other-view: repeated -> post0 post1 post4", seen=False),
]


# Another object's answer.


AWAY = moved(x=100.0)
HERE = moved()


def neighbours():
    """Of these, by id, 'hidden' is behind the wall and 'out' beside the view. From front to back:
    front, wall, hidden, beyond, last."""
    view = plain()
    return Stage(
        case(
            [
                ("wall", sheet(view, (1, 12), (1, 12), 10.0)),
                ("front", sheet(view, (3, 6), (3, 6), 5.0)),
                ("hidden", sheet(view, (8, 10), (4, 6), 20.0)),
                ("beyond", sheet(view, (20, 24), (3, 6), 30.0)),
                ("out", panel((40.0, 44.0), (0.0, 4.0), -8.0)),
                ("last", sheet(view, (20, 24), (15, 19), 40.0)),
            ],
            [view],
        )
    )


def many():
    """More objects than a byte can number."""
    dots = [(f"dot{i}", panel((i - 150.0, i - 149.2), (0.0, 0.8), -5.0)) for i in range(258)]
    return Stage(case(dots, [plain()]))


def namesakes():
    view = plain()
    places = [("tree", 2), ("bush", 8), ("tree", 14), ("tree", 20)]
    return Stage(case([(n, sheet(view, (x, x + 3), (3, 9), 9.0)) for n, x in places], [view]))


def left_out_once():
    """Of what is in the view in both frames the culler left 'late' and 'again' out in the first,
    'aside' was out of the view then."""
    view = plain()
    objects = [
        (name, sheet(view, (2 + 7 * i, 6 + 7 * i), (4, 9), 9.0))
        for i, name in enumerate(("late", "again", "kept", "aside"))
    ]
    frames = [
        Frame((view,), world_from_object={"aside": AWAY}),
        Frame((view,), world_from_object={"aside": HERE}),
    ]
    drawn = {(0, ""): ["kept"], (1, ""): ["kept", "again", "aside"]}
    return Stage(posed(objects, frames), 1, drawn=drawn)


def missed_from_some_time_on():
    """In the third of three frames the culler misses three objects that it missed in the second:
    'start' was missed in the first too, 'drawn' was drawn then, and 'rightly' was left out rightly,
    as it stood aside."""
    view = plain()
    objects = [
        (name, sheet(view, (2 + 7 * i, 6 + 7 * i), (4, 9), 9.0))
        for i, name in enumerate(("start", "drawn", "kept", "rightly"))
    ]
    frames = [Frame((view,), world_from_object={"rightly": there}) for there in (AWAY, HERE, HERE)]
    lost = ["start", "drawn", "rightly"]
    return Stage(
        posed(objects, frames),
        2,
        drawn={(0, ""): ["kept", "drawn"], (1, ""): ["kept"], (2, ""): ["kept"]},
        missed={(0, ""): ["start"], (1, ""): lost, (2, ""): lost},
    )


IDS = [
    *claims(
        neighbours,
        "ids-shifted: +1, what shows; +1, boxes -> front beyond last",
        "ids-shifted: +1, in the view -> beyond last",
        "ids-shifted: -1, what shows; -1, boxes -> wall beyond last",
        "ids-shifted: -1, in the view -> wall last",
        "ids-shifted: in order -> beyond",
        "ids-shifted: in order, the first lost -> front beyond",
        # By number they are asked wall, front, hidden, beyond, last.
        "ids-shifted: by number -> beyond",
        "ids-wrap: 256; 65536 -> says nothing",
        "same-names: -> says nothing",
    ),
    *claims(many, "ids-wrap: 256 -> dot256 dot257", seen=False),
    *claims(
        left_out_once,
        "first-answer-kept: left out before -> late again",
        "first-answer-kept: nothing new -> late again aside",
    ),
    # That what is missed was missed before explains nothing.
    *claims(missed_from_some_time_on, "first-answer-kept: nothing new -> rightly"),
    *claims(namesakes, "same-names: -> tree#2 tree#3"),
]


def test_ids_of_two_bytes_wrap_at_65536():
    asked = at(many)
    units = Units(np.zeros(65538 + 1, np.int64), np.zeros(0, np.int32))
    sights = Sights(asked.sights.moments, Answers(units))
    last = np.array([0, 65535, 65536, 65537], np.int32)
    kept = hypothesis("ids-wrap", "65536").tell(replace(asked, sights=sights, ids=last))
    assert kept.tolist() == [True, True, False, False]


# Where things stood. All is asked of the last of three frames; `AWAY` is out of the view.


def coming_and_going():
    """Each thing was out of the view at one time: in the rest pose, in the first frame, in the one
    before."""
    view = plain()
    names_of = ("rest", "first", "before", "still")
    objects = [
        (n, sheet(view, (4 + 7 * i, 8 + 7 * i), (4, 8), 9.0)) for i, n in enumerate(names_of)
    ]
    points, faces = objects[0][1]
    objects[0] = ("rest", (points + np.array([100.0, 0.0, 0.0]), faces))
    back = moved(x=-100.0)
    where = [
        {"rest": back, "first": AWAY, "before": HERE},
        {"rest": back, "first": HERE, "before": AWAY},
        {"rest": back, "first": HERE, "before": HERE},
    ]
    return Stage(posed(objects, [Frame((view,), world_from_object=w) for w in where]), 2)


def out_of_hiding():
    """The same, behind a wall in place of out of the view, which is as long as the image."""
    view = plain()
    names_of = ("rest", "first", "before", "still")
    objects = [("wall", sheet(view, (0, 31), (0, 9), 10.0))]
    objects += [
        (n, sheet(view, (4 + 7 * i, 8 + 7 * i), (14, 18), 20.0)) for i, n in enumerate(names_of)
    ]
    # Up by ten pixels all of it is hidden.
    up, down = moved(y=10.0), moved(y=-10.0)
    points, faces = objects[1][1]
    objects[1] = ("rest", (points + np.array([0.0, 10.0, 0.0]), faces))
    where = [
        {"rest": down, "first": up, "before": HERE},
        {"rest": down, "first": HERE, "before": up},
        {"rest": down, "first": HERE, "before": HERE},
    ]
    return Stage(posed(objects, [Frame((view,), world_from_object=w) for w in where]), 2)


def doors():
    """Each thing was behind a door at one time: in the rest pose, in the first frame, in the one
    before. The doors stand open 50 farther back, behind the things."""
    view = plain()
    objects, columns = [], {"rest": (2, 10.0), "first": (12, 60.0), "before": (22, 60.0)}
    for name, (x, depth) in columns.items():
        objects.append((f"{name}_door", sheet(view, (x, x + 8), (2, 12), depth)))
        objects.append((name, sheet(view, (x + 2, x + 6), (4, 9), 20.0)))
    objects.append(("still", sheet(view, (4, 8), (16, 20), 20.0)))
    opened, shut = moved(z=-50.0), moved(z=50.0)
    where = [
        {"rest_door": opened, "first_door": shut, "before_door": HERE},
        {"rest_door": opened, "first_door": HERE, "before_door": shut},
        {"rest_door": opened, "first_door": HERE, "before_door": HERE},
    ]
    return Stage(posed(objects, [Frame((view,), world_from_object=w) for w in where]), 2)


def turned_upright():
    """The plank lies behind a wall of 8 by 4 at rest, 6 by 1.2; turned upright it shows above and
    below, from -3 to 3. About its own middle its box at rest still lies behind the wall."""
    objects = [
        ("wall", panel((-4.0, 4.0), (-2.0, 2.0), -10.0)),
        ("plank", box((-3.0, -0.6, -20.4), (3.0, 0.6, -20.0))),
        ("still", panel((8.0, 12.0), (-2.0, 2.0), -10.0)),
    ]
    turn = about((0.0, 0.0, -20.2), np.pi / 2, axis=2)
    frames = [Frame((plain(),), world_from_object={"plank": m}) for m in (HERE, turn)]
    return Stage(posed(objects, frames), 1)


def standing_still():
    return Stage(case([("sheet", sheet(plain(), (3, 9), (3, 9), 9.0))], [plain(), plain()]), 1)


def a_wall_removed():
    """The first wall went in the last frame, the second in the one before; the third is there."""
    view = plain()
    objects = []
    for i, name in enumerate(("first", "second", "third")):
        x = 1 + 10 * i
        objects.append((f"{name}_wall", sheet(view, (x, x + 8), (2, 12), 10.0)))
        objects.append((name, sheet(view, (x + 2, x + 6), (4, 16), 20.0)))
    objects[1] = ("first", sheet(view, (3, 7), (4, 9), 20.0))
    objects[3] = ("second", sheet(view, (13, 17), (4, 9), 20.0))
    gone = [(), ("second_wall",), ("first_wall", "second_wall")]
    return Stage(posed(objects, [Frame((view,), absent=one) for one in gone]), 2)


def some_appeared():
    """'late' was absent at first, 'gone' in between, 'still' never; nothing is absent now."""
    view = plain()
    objects = [
        (n, sheet(view, (x, x + 4), (3, 9), 9.0))
        for n, x in (("late", 2), ("gone", 10), ("still", 18))
    ]
    gone = [("late",), ("gone",), ()]
    return Stage(posed(objects, [Frame((view,), absent=one) for one in gone]), 2)


POSES = [
    *claims(
        coming_and_going,
        "rest-pose: view; boxes; wholly -> rest",
        "rest-pose: first frame's view; first frame's boxes -> first",
        "old-pose: view; boxes -> before",
        "bounds-too-small: rest pose's, moved ->",
        "appeared-unknown: absent at first; absent before -> says nothing",
        "removed-still-hides: -> says nothing",
    ),
    *claims(
        out_of_hiding,
        "rest-pose: view; first frame's view ->",
        "old-pose: view ->",
        "rest-pose: boxes; wholly -> rest",
        "rest-pose: first frame's boxes -> first",
        "old-pose: boxes -> before",
    ),
    *claims(
        doors,
        "old-occluders: then; then and now -> before",
        "old-occluders: at rest -> rest",
        "old-occluders: first frame, then; first frame, then and now -> first",
        "old-depth: then; not cleared -> before",
    ),
    *claims(turned_upright, "bounds-too-small: rest pose's, moved -> plank"),
    *claims(
        standing_still,
        "rest-pose: view; boxes; wholly; first frame's view; first frame's boxes -> says nothing",
        "old-pose: view; boxes -> says nothing",
        "old-occluders: then; at rest; first frame, then -> says nothing",
        "bounds-too-small: rest pose's, moved -> says nothing",
    ),
    *claims(a_wall_removed, "removed-still-hides: -> first second"),
    *claims(
        some_appeared,
        "appeared-unknown: absent at first -> late",
        "appeared-unknown: absent before -> late gone",
    ),
]


# What is left out whatever is there.


def materials():
    view = plain()
    objects = [
        ("fence", sheet(view, (2, 6), (2, 6), 9.0)),
        ("pane", sheet(view, (10, 14), (2, 6), 9.0)),
        ("wall", sheet(view, (18, 22), (2, 6), 9.0)),
    ]
    built = case(objects, [view], alpha={"fence": Alpha.MASK, "pane": Alpha.BLEND})
    # A house with a window and one with a hedge: the first triangle of each is glass, or masked.
    more = [
        ("glazed", sheet(view, (2, 6), (12, 16), 9.0)),
        ("hedged", sheet(view, (10, 14), (12, 16), 9.0)),
    ]
    both = case([*objects, *more], [view]).scene
    alpha = np.concatenate(
        [built.scene.alpha, [Alpha.BLEND, Alpha.OPAQUE, Alpha.MASK, Alpha.OPAQUE]]
    )
    return Stage(Case(replace(both, alpha=alpha.astype(np.uint8)), CameraPath([view])))


def faces():
    """Seen along -Z. 'front' and 'back' are sheets that face the eye and do not; 'ball' is
    closed, its first triangle at the back; of the marked ones, one-sided, 'front1' faces the
    eye."""
    view = plain()
    front, back = sheet(view, (2, 6), (2, 6), 9.0), sheet(view, (9, 13), (2, 6), 9.0)
    marked = sheet(view, (16, 20), (2, 6), 9.0)
    points, triangles = block(view, (1.7, 5.3), (11.7, 15.3), (8.0, 12.0))
    behind = [i for i, t in enumerate(triangles) if (points[t, 2] < -11.0).all()]
    order = [*behind, *(i for i in range(12) if i not in behind)]
    ball, ball1 = (points, triangles[order]), (points + np.array([9.0, 0.0, 0.0]), triangles[order])
    objects = [
        ("front", front),
        ("back", (back[0], back[1][:, ::-1])),
        ("front1", marked),
        ("ball", ball),
        ("ball1", ball1),
    ]
    return Stage(case(objects, [view], one_sided=("front1", "ball1")))


def facing(view, normal, centre):
    """A square of 2 by 2 whose front looks along a normal of no y."""
    normal = np.array(normal, float) / np.linalg.norm(normal)
    aside, up = np.cross([0.0, 1.0, 0.0], normal), np.array([0.0, 1.0, 0.0])
    ends = [np.array(centre) + a * aside + b * up for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    return np.array(ends), np.array([[0, 1, 2], [0, 2, 3]])


def by_the_axis():
    """At (8, 0, -10) a normal of (-1, 0, -0.2) looks to the eye: (-8, 0, 10) times it is 6.
    Along the view's axis, (0, 0, 1), it is -0.2: away."""
    view = wide()
    return Stage(
        case(
            [
                ("aslant", facing(view, (-1, 0, -0.2), (8, 3, -10))),
                ("aslant1", facing(view, (-1, 0, -0.2), (8, -3, -10))),
                ("ahead", facing(view, (0, 0, 1), (-4, 3, -10))),
                ("ahead1", facing(view, (0, 0, 1), (-4, -3, -10))),
            ],
            [view],
            one_sided=("aslant1", "ahead1"),
        )
    )


def by_the_eye():
    """Seen along -Z without perspective, a normal of (1, 0, 0.2) at (8.4, 0, -10) looks this way;
    to the eye, (-8.4, 0, 10), it is -6.4: away."""
    view = plain()
    return Stage(
        case(
            [
                ("aslant", facing(view, (1, 0, 0.2), (8.4, 3, -10))),
                ("aslant1", facing(view, (1, 0, 0.2), (8.4, -3, -10))),
                ("ahead", facing(view, (0, 0, 1), (-4, 3, -10))),
                ("ahead1", facing(view, (0, 0, 1), (-4, -3, -10))),
            ],
            [view],
            one_sided=("aslant1", "ahead1"),
        )
    )


LEFT_OUT = [
    *claims(
        materials,
        "masked-left-out: any -> fence hedged",
        "masked-left-out: whole -> fence",
        "glass-left-out: any -> pane glazed",
        "glass-left-out: whole -> pane",
        "back-faces: one-sided reversed; one-sided by axis; one-sided by the first -> says nothing",
    ),
    *claims(
        neighbours,
        "masked-left-out: any; whole -> says nothing",
        "glass-left-out: any; whole -> says nothing",
    ),
    *claims(
        faces,
        "back-faces: reversed -> front front1",
        "back-faces: one-sided reversed -> front1",
        "back-faces: two-sided -> back",
        "back-faces: by the first triangle -> back ball ball1",
        "back-faces: one-sided by the first -> ball1",
    ),
    *claims(
        by_the_axis,
        "back-faces: by the view's axis -> aslant aslant1",
        "back-faces: one-sided by axis -> aslant1",
        "back-faces: two-sided ->",
        "back-faces: by the eye; one-sided by the eye -> says nothing",
    ),
    *claims(
        by_the_eye,
        "back-faces: by the eye -> aslant aslant1",
        "back-faces: one-sided by the eye -> aslant1",
        "back-faces: two-sided; by the view's axis ->",
    ),
]

CLAIMS = [*LATE, *VIEWS, *IDS, *POSES, *LEFT_OUT]


@pytest.mark.parametrize("claimed", cases_of(CLAIMS), ids=named)
def test_answer_of_another_drops_what_it_would(claimed):
    check(*claimed)


@pytest.mark.parametrize(
    "build", dict.fromkeys(c.build for c in POSES + LEFT_OUT), ids=lambda b: b.__name__
)
def test_the_right_test_keeps_what_shows(build):
    asked = at(build)
    kept = kept_by_depth(asked, asked.boxes)
    assert names(asked, asked.now.seen) <= names(asked, kept)
