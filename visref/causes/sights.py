"""A moment as one camera sees it, with what hypotheses ask of it: boxes, depths, who is visible."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.camera_path import CameraPath
from visref.causes.boxes import Boxes
from visref.causes.evidence import Answers, Membership
from visref.causes.layers import Layers, LayersKept, draw, turned
from visref.engines.base import TruthEngine
from visref.scene import Alpha, Float64, Int32, Int64, Scene, Units
from visref.timeline import Timeline

Bool = NDArray[np.bool_]
T = TypeVar("T")

# How the variants begin of what a clip plane does not cut.
CLIP_PLANE = "clip plane"
# Causes that need glass, masks, what moves, a lens shift, a roll, or several views.
SPECIAL = frozenset(
    {
        "glass-solid",
        "masks-solid",
        "masked-left-out",
        "glass-left-out",
        "removed-still-hides",
        "appeared-unknown",
        "rest-pose",
        "old-pose",
        "old-occluders",
        "no-lens-shift",
        "lens-shift-reversed",
        "roll-ignored",
        "first-view-only",
        "other-view",
    }
)
# In the variants in which the depth that is asked holds the unit itself.
OWN_TOO = ", own depth too"
# So many moments are kept: what all hypotheses look at for one answer.
KEPT = 32
# Bytes of their layers, those of some twenty pictures of 1280 x 960: of what is drawn, which is
# asked for again by other answers, and of what is made of that for a cause or two.
DRAWN_BYTES, MADE_BYTES = 320 << 20, 192 << 20
# In place of a frame: the rest pose.
AT_REST = -1


@dataclass(frozen=True, eq=False)
class Shown:
    """(k,) int32 `triangles` that own or share a sample of a view, or are or may be seen there
    through a mask or as glass, ascending, and (k,) int64 at how many `samples` each."""

    triangles: Int32
    samples: Int64


class Moments:
    """The moments of a run, made when they are asked for. `path`: relative to the scene's origin.
    `frames`: those that the cullers were asked about, in order."""

    def __init__(
        self,
        timeline: Timeline,
        path: CameraPath,
        frames: Sequence[int],
        make_engine: Callable[[], TruthEngine],
    ) -> None:
        self.timeline, self.path = timeline, path
        self.frames = tuple(frames)
        self._place = {frame: i for i, frame in enumerate(self.frames)}
        self._make_engine = make_engine
        self._engine: TruthEngine | None = None
        self._seen: dict[tuple[int, str], Shown] = {}
        # (n, 2, 3) the objects' boxes in their own space, once somebody asks.
        self.homes: Float64 | None = None

    def before(self, frame: int, count: int) -> int | None:
        """The frame that was asked about `count` frames before, None where there is none."""
        at = self._place[frame] - count
        return self.frames[at] if at >= 0 else None

    def place(self, frame: int) -> int:
        """Which of the frames asked about it is, from 0."""
        return self._place[frame]

    def cameras(self, frame: int) -> tuple[Camera, ...]:
        return self.path.views(frame)

    def since_cut(self, frame: int) -> int:
        """The first frame after the last cut at or before this one, or of all."""
        for at in range(self._place[frame], 0, -1):
            if self.cameras(self.frames[at])[0].cut:
                return self.frames[at]
        return self.frames[0]

    def engine(self, scene: Scene) -> TruthEngine:
        """The run's engine, on the scene of a moment."""
        if self._engine is None:
            self._engine = self._make_engine()
        if self._engine.scene is not scene and scene.moving is not None:
            self._engine.pose(scene)
        return self._engine

    def seen(self, frame: int, view: str) -> Shown:
        """What shows in a view of a frame."""
        if (frame, view) not in self._seen:
            camera = next(one for one in self.cameras(frame) if one.view == view)
            self._seen[frame, view] = self.cast(self.timeline.at(frame), camera)
        return self._seen[frame, view]

    def cast(self, scene: Scene, camera: Camera) -> Shown:
        """What some camera sees of the scene of a moment."""
        truth = self.engine(scene).frame(camera)
        # The background's -1 is the first place.
        samples = np.bincount(truth.buffer.triangle.reshape(-1) + 1, minlength=1)[1:]
        samples = np.pad(samples, (0, scene.triangle_count - len(samples)))
        for more in (truth.ties.triangle, truth.doubt.triangle, truth.blend.triangle):
            samples += np.bincount(more, minlength=scene.triangle_count)
        triangles = np.flatnonzero(samples).astype(np.int32)
        return Shown(triangles, samples[triangles])

    def owners(self, scene: Scene, camera: Camera) -> Int32:
        """(height, width) int32, the triangles that own the samples of a view, -1 for none."""
        return self.engine(scene).frame(camera).buffer.triangle.copy()

    def close(self) -> None:
        if self._engine is not None:
            self._engine.close()
            self._engine = None


@dataclass(eq=False)
class Place:
    """A scene, and its units as one culler knows them."""

    scene: Scene
    units: Units
    members: Membership

    @cached_property
    def bounds(self) -> Float64:
        """(u, 2, 3) float64."""
        return self.scene.bounds_of(self.units)

    @cached_property
    def unit_of(self) -> Int32:
        return self.members.first_of(self.scene.triangle_count)

    def samples(self, shown: Shown) -> Int64:
        """(u,) int64, at how many samples each unit shows."""
        unit, at = self.members.units(shown.triangles.astype(np.int64))
        found = np.bincount(unit, shown.samples[at], minlength=self.units.count)
        return found.astype(np.int64)


@dataclass(eq=False)
class Sight:
    """One camera on a place; no other sight of a culler has its `key`. `seen`: (u,) bool, the units
    that show, by the truth; `samples`: (u,) int64, at how many samples."""

    frame: int
    key: tuple[int, str, int | None]
    camera: Camera
    place: Place
    shown: Callable[[], Shown]
    owners: Callable[[], Int32]
    drawn: LayersKept
    made: LayersKept
    _last: tuple[Int32, Boxes] | None = None

    @cached_property
    def seen(self) -> Bool:
        return self.samples > 0

    @cached_property
    def samples(self) -> Int64:
        return self.place.samples(self.shown())

    @cached_property
    def _owners(self) -> Int32:
        return self.owners()

    @cached_property
    def seen_anywhere(self) -> Bool:
        """(u,) bool, the units that own samples."""
        return self.seen_in(slice(None), slice(None))

    def seen_in(self, rows: slice, columns: slice) -> Bool:
        """(u,) bool, the units that own samples of a part of the image."""
        # The background's -1 is the last place.
        owns = np.zeros(self.place.scene.triangle_count + 1, np.bool_)
        owns[self._owners[rows, columns].reshape(-1)] = True
        unit, _ = self.place.members.units(np.flatnonzero(owns[:-1]))
        result = np.zeros(self.place.units.count, np.bool_)
        result[unit] = True
        return result

    def boxes(self, ids: Int32, camera: Camera | None = None) -> Boxes:
        if camera is not None:
            return Boxes(camera, self.place.bounds[ids])
        # Several hypotheses, one after the other, are about the same boxes.
        if self._last is None or self._last[0] is not ids:
            self._last = ids, Boxes(self.camera, self.place.bounds[ids])
        return self._last[1]

    def layers(
        self,
        *,
        by: int = 1,
        masks: bool = False,
        glass: bool = False,
        back_faces: bool = False,
        unclipped: bool = False,
        before_near: bool = False,
    ) -> Layers:
        """What hides, triangle by triangle: by default what is opaque and turned this way, between
        near, far and clip plane. `by`: drawn at such a fraction of the size."""
        scene = self.place.scene
        # Where there is no such thing, the layers are those without.
        masks, glass = masks and scene.has_mask, glass and scene.has_blend
        back_faces = back_faces and scene.has_one_sided
        unclipped = unclipped and self.camera.clip_plane is not None
        key = (by, masks, glass, back_faces, unclipped, before_near)

        def make() -> Layers:
            taken = self.camera if by == 1 else _smaller(self.camera, by)
            kinds = [Alpha.OPAQUE, *[Alpha.MASK] * masks, *[Alpha.BLEND] * glass]
            solid = np.isin(scene.alpha, kinds)
            if not back_faces and scene.has_one_sided:
                solid &= ~(scene.one_sided & ~facing(scene, taken))
            if unclipped:
                taken = replace(taken, clip_plane=None)
            if before_near:
                near = 1e-3 * taken.near if taken.is_perspective else taken.near - 1e6
                taken = replace(taken, near=near)
            layers = Layers.empty(taken.height, taken.width)
            draw(
                layers,
                scene.vertices,
                scene.triangles,
                taken,
                np.flatnonzero(solid),
                self.place.unit_of,
            )
            return layers

        return self.drawn.get((self.key, key), make)

    def kept(self, key: Hashable, make: Callable[[], Layers]) -> Layers:
        """Layers made of those of this sight, once, or again where they were given up."""
        return self.made.get((self.key, key), make)


def _smaller(camera: Camera, by: int) -> Camera:
    """The view at a fraction of the size, rounded up."""
    return replace(
        camera,
        width=-(-camera.width // by),
        height=-(-camera.height // by),
        shift_x_px=camera.shift_x_px / by,
        shift_y_px=camera.shift_y_px / by,
    )


def facing(scene: Scene, camera: Camera, *, axis: bool = False, eye: bool = False) -> Bool:
    """(t,) bool, the triangles whose front the camera sees. `axis`: asked of the view's axis in
    place of the ray; `eye`: of the eye, whatever the projection."""
    orthographic = not (camera.is_perspective or eye)
    towards = -camera.forward if axis or orthographic else camera.eye
    return turned(scene.vertices, scene.triangles, towards, not (axis or orthographic))


class Sights:
    """The sights of one culler's units, a few kept at a time, and its own answers."""

    def __init__(self, moments: Moments, answers: Answers) -> None:
        self.moments, self.answers, self.units = moments, answers, answers.units
        units = answers.units
        self._members = Membership(units)
        self._places: dict[int, Place] = {}
        self._sights: dict[tuple[int, str, int | None], Sight] = {}
        self._drawn, self._made = LayersKept(DRAWN_BYTES), LayersKept(MADE_BYTES)

    @cached_property
    def shares_triangles(self) -> bool:
        """Whether a triangle is in two units."""
        return len(np.unique(self.units.triangles)) < len(self.units.triangles)

    def place(self, scene: Scene) -> Place:
        known = self._places.get(id(scene))
        if known is None or known.scene is not scene:
            if len(self._places) > KEPT:
                self._places.pop(next(iter(self._places)))
            known = self._places[id(scene)] = Place(scene, self.units, self._members)
        return known

    def sight(self, frame: int, view: str, standing: int | None = None) -> Sight:
        """A frame as one view sees it; `standing`: the scene of another frame before its camera,
        or that at rest (`AT_REST`)."""
        key = frame, view, standing
        if key not in self._sights:
            if len(self._sights) > KEPT:
                self._sights.pop(next(iter(self._sights)))
            camera = next(one for one in self.moments.cameras(frame) if one.view == view)
            timeline = self.moments.timeline
            at = frame if standing is None else standing
            scene = timeline.still if at == AT_REST else timeline.at(at)
            self._sights[key] = Sight(
                frame,
                key,
                camera,
                self.place(scene),
                lambda: (
                    self.moments.seen(frame, view)
                    if standing is None
                    else self.moments.cast(scene, camera)
                ),
                lambda: self.moments.owners(scene, camera),
                self._drawn,
                self._made,
            )
        return self._sights[key]


@dataclass(eq=False)
class At:
    """A view of an answer, for hypotheses: which of the units `ids` would be kept?

    `frame`: the answer's. `too_small`: (k,) bool, units whose box was found not to hold them.
    `own`: a unit's own depth hides too.
    """

    sights: Sights
    frame: int
    view: str
    ids: Int32
    too_small: Bool
    own: bool = False

    @cached_property
    def now(self) -> Sight:
        return self.sights.sight(self.frame, self.view)

    @cached_property
    def with_own(self) -> At:
        """The same, where a unit's own depth hides too."""
        other = replace(self, own=True)
        other.__dict__["boxes"] = self.boxes
        return other

    @property
    def camera(self) -> Camera:
        return self.now.camera

    @property
    def scene(self) -> Scene:
        return self.now.place.scene

    @cached_property
    def boxes(self) -> Boxes:
        return self.now.boxes(self.ids)

    def before(self, count: int) -> Sight | None:
        """The same view, so many frames before."""
        return self.then(self.sights.moments.before(self.frame, count))

    def then(self, frame: int | None) -> Sight | None:
        if frame is None:
            return None
        views = [one.view for one in self.sights.moments.cameras(frame)]
        return self.sights.sight(frame, self.view) if self.view in views else None

    def other_views(self) -> list[Sight]:
        cameras = self.sights.moments.cameras(self.frame)
        return [self.sights.sight(self.frame, c.view) for c in cameras if c.view != self.view]

    def objects(self) -> Int64:
        """(k,) the object of each unit's first triangle, -1 for one without."""
        units = self.sights.units
        result = np.full(len(self.ids), -1, np.int64)
        filled = units.sizes[self.ids] > 0
        first = units.triangles[units.offsets[self.ids[filled]]]
        result[filled] = self.scene.object_of_triangle[first]
        return result

    def any_triangle(self, flags: Bool) -> Bool:
        """(k,) bool, whether a unit holds a triangle of (t,) flags."""
        return self._over(flags, np.maximum)

    def every_triangle(self, flags: Bool) -> Bool:
        """(k,) bool, whether all of a unit's triangles are among (t,) flags, and there are some."""
        filled: Bool = self.sights.units.sizes[self.ids] > 0
        return ~self._over(~flags, np.maximum) & filled

    def _over(self, flags: Bool, how: np.ufunc) -> Bool:
        units = self.sights.units.take(self.ids)
        result = np.zeros(units.count, np.bool_)
        filled = units.sizes > 0
        if filled.any():
            values = flags[units.triangles].astype(np.uint8)
            result[filled] = how.reduceat(values, units.offsets[:-1][filled]).astype(np.bool_)
        return result


Told = Bool | None
# Which of the units a culler would keep that errs so, (k,) bool, None where it says nothing here.
Tell = Callable[[At], Told]


@dataclass(frozen=True)
class Hypothesis:
    """A cause, in one of the ways in which a culler may err so (`variant`). `odd`: such a way is
    seldom met. `many`: it is believed of many misses only. `answer`: what it keeps is the culler's
    whole answer, of another moment or about another thing. `depth`: it says what hides, so that it
    is about a culler that asks for that. `fact`: it holds only where the answers themselves are
    such, as an empty one. `some`: it is about some units only, found from other answers.
    `cut`: it says where each answer ends, so that what was drawn cannot speak against it."""

    cause: str
    variant: str
    tell: Tell
    odd: bool = False
    many: bool = False
    answer: bool = False
    depth: bool = False
    fitted: bool = False
    fact: bool = False
    some: bool = False
    cut: bool = False

    def of_some(self, tell: Tell) -> Hypothesis:
        """The same, about some units only, as `tell` says."""
        return replace(self, variant=f"{self.variant}, of some", tell=tell, some=True)

    @property
    def special(self) -> bool:
        """Whether it can be got wrong only where scene or camera have something of the kind."""
        return self.cause in SPECIAL or self.variant.startswith(CLIP_PLANE)

    @property
    def own(self) -> bool:
        """Whether the depth that is asked holds the unit itself."""
        return OWN_TOO in self.variant


def by_code(
    groups: Mapping[str, Mapping[str, Tell]],
    *,
    odd: bool = False,
    many: bool = False,
    answer: bool = False,
    depth: bool = False,
    fact: bool = False,
) -> list[Hypothesis]:
    """Hypotheses from {cause: {variant: tell}}, in order."""
    return [
        Hypothesis(cause, variant, tell, odd, many, answer, depth, fact=fact)
        for cause, variants in groups.items()
        for variant, tell in variants.items()
    ]
