"""Pictures of a judged frame: the shaded scene, who was drawn for what, and what is missing.

They are made from the visibility buffer alone, so they show what the verdict rests on and
need no GL. Hatching and rings say a second time what the colours do.
"""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from visref.camera import Camera
from visref.judging.frame import SettledFrame
from visref.judging.judge import FrameVerdict
from visref.judging.misses import MissKind
from visref.run_folder.colours import (
    MISSED_RGB,
    MOVED_RGB,
    SUPERFLUOUS_RGB,
    pastel,
    srgb,
    vivid,
)
from visref.run_folder.layout import PAGE_WIDTH_PX, page_shape, slug
from visref.run_folder.owners import owner_picture
from visref.run_folder.rows import PictureSet
from visref.run_folder.silhouettes import borders, silhouettes
from visref.scene import Float32, Float64, Int32, Int64, Scene, Units
from visref.visibility import FrameTruth, VisibilityBuffer, hit_depths

# A missed patch smaller than this (page pixels) gets a ring, or nobody would find it.
RING_BELOW_PX = 40
MAX_RINGS = 60
# How far a ring's white halo reaches from its line, in page pixels.
_RING_HALO = 3.4

_SKY_TOP = np.array([0.73, 0.82, 0.91], np.float32)
_SKY_FOOT = np.array([0.95, 0.96, 0.97], np.float32)
# Right, up, back in camera space: over the viewer's left shoulder.
_LIGHT = np.array([-0.42, 0.72, 0.55]) / math.sqrt(0.42**2 + 0.72**2 + 0.55**2)
_JPEG = {"quality": 84, "optimize": True}
# A twentieth larger than at its smallest, in less than half of the time.
_PNG = {"compress_level": 6}


@dataclass(frozen=True)
class _Ring:
    """A marker around a missed patch, in page pixels."""

    x: float
    y: float
    radius: float

    def around(self, shape: tuple[int, int]) -> tuple[tuple[slice, slice], Float64]:
        """The part of an image of `shape` that the ring may touch, and there the distance of each
        pixel's centre from its line, in pixels."""
        reach = self.radius + _RING_HALO
        rows = slice(max(int(self.y - reach), 0), min(int(self.y + reach) + 1, shape[0]))
        columns = slice(max(int(self.x - reach), 0), min(int(self.x + reach) + 1, shape[1]))
        y, x = np.mgrid[rows, columns]
        return (rows, columns), np.abs(np.hypot(x + 0.5 - self.x, y + 0.5 - self.y) - self.radius)


@dataclass(frozen=True, eq=False)
class _Shared:
    """What all cullers' pictures of one view of a frame have in common: the files, and the shaded
    scene, (h, w) uint8 grey at the page's size; `empty`, (h, w) bool, where nothing is seen."""

    files: dict[str, str]
    grey: NDArray[np.uint8]
    empty: NDArray[np.bool_]


class Seen:
    """What is seen of one view of a frame, packed: who owns its samples."""

    def __init__(self, camera: Camera, triangle: Int32) -> None:
        self.camera = camera
        self._packed = zlib.compress(np.ascontiguousarray(triangle, "<i4").tobytes(), 1)

    def truth(self, scene: Scene) -> FrameTruth:
        """The truth as pictures need it: depths where the shaded scene is looked at."""
        camera, stride = self.camera, _stride(self.camera)
        shape = camera.height, camera.width
        triangle = np.frombuffer(zlib.decompress(self._packed), "<i4").reshape(shape)
        depth = np.full(shape, np.inf)
        y, x = np.nonzero(triangle[::stride, ::stride] >= 0)
        sample = (y * stride) * np.int64(camera.width) + x * stride
        hits = hit_depths(scene, camera, sample, triangle.reshape(-1)[sample].astype(np.int32))
        # Of a triangle seen edge-on it may be anything.
        depth.reshape(-1)[sample] = np.clip(hits, camera.near, camera.far)
        return FrameTruth(camera, "", VisibilityBuffer(triangle.astype(np.int32), depth))


@dataclass(frozen=True, eq=False)
class Sketch:
    """All that one culler's pictures of a view of a frame are drawn from. `superfluous`, (k,) int32
    units; `missed`, (h, w) bool at the page's size; `moved`, (n,) bool objects, None where nothing
    ever moves; `frame` and `stem` name the files."""

    culler: str
    stem: str
    frame: int
    seen: Seen
    units: Units
    superfluous: Int32
    missed: NDArray[np.bool_]
    rings: list[_Ring]
    moved: NDArray[np.bool_] | None


class Painter:
    """Draws the pictures of frames into `folder`, which stands in the run folder.

    The shaded scene and the objects' ids are drawn once for all cullers that are judged in a view
    of a frame, by the truth as it was cast (`see`), else by that of the first of them: the others'
    differ by what exact arithmetic corrected where they lost samples.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._at: tuple[int, str] | None = None
        self._shared: _Shared | None = None
        # Of the frame at hand, by view: as it was cast, and packed once it is needed.
        self._frame: int | None = None
        self._cast: dict[str, FrameTruth] = {}
        self._seen: dict[str, Seen] = {}

    def see(self, frame: int, truth: FrameTruth) -> None:
        """The truth of a view of a frame, before it is judged."""
        self._begin(frame)
        self._cast[truth.camera.view] = truth

    def _begin(self, frame: int) -> None:
        if self._frame != frame:
            self._frame, self._cast, self._seen = frame, {}, {}

    def sketch(
        self,
        settled: SettledFrame,
        verdict: FrameVerdict,
        *,
        stem: str,
        culler: str,
        frame: int,
        moved: NDArray[np.bool_] | None = None,
    ) -> Sketch:
        """One culler's view of a frame, as far as it must be looked at while its truth is at hand.

        `stem` is the culler's part of the file names. In the shaded scene, the objects that
        `moved`, (n,) bool, are outlined.
        """
        scene, truth = settled.scene, settled.truth
        camera, missed = truth.camera, settled.walk.lost_samples
        self._begin(frame)
        if camera.view not in self._seen:
            cast = self._cast.get(camera.view, truth)
            self._seen[camera.view] = Seen(camera, cast.buffer.triangle)
        shape = page_shape(camera.width, camera.height)
        return Sketch(
            culler,
            stem,
            frame,
            self._seen[camera.view],
            settled.units,
            verdict.superfluous_units,
            _shrunk(missed, camera, shape),
            _rings(scene, truth, verdict, missed, shape),
            moved,
        )

    def paint(self, sketch: Sketch, scene: Scene, truth: FrameTruth | None = None) -> PictureSet:
        """Draw a view of a frame, of the `scene` as it stands there, by its `truth` if that is
        still at hand. Superfluous units show as silhouettes through the scene, missed samples as
        they are, with rings around small patches."""
        camera = sketch.seen.camera
        shape = page_shape(camera.width, camera.height)
        view = camera.view
        at = f"{sketch.frame:05d}-{slug(view)}" if view else f"{sketch.frame:05d}"
        shared = self._shared
        if shared is None or self._at != (sketch.frame, view):
            self._at = sketch.frame, view
            truth = truth or sketch.seen.truth(scene)
            shared = self._shared = self._draw_shared(at, scene, truth, sketch.moved, shape)
        files = dict(shared.files)
        superfluous = silhouettes(scene, camera, sketch.units, sketch.superfluous, shape)
        overlay = _overlay(shared.grey, shared.empty, superfluous, sketch.missed, sketch.rings)
        files["drawn"] = self._save("drawn", f"{sketch.stem}-{at}-drawn.jpg", overlay)
        if sketch.missed.any() or sketch.rings:
            errors = _errors(shared.empty, sketch.missed, sketch.rings)
            files["errors"] = self._save("errors", f"{sketch.stem}-{at}-errors.png", errors)
        return PictureSet(sketch.culler, sketch.frame, files, view)

    def draw(
        self,
        settled: SettledFrame,
        verdict: FrameVerdict,
        *,
        stem: str,
        culler: str,
        frame: int,
        moved: NDArray[np.bool_] | None = None,
    ) -> PictureSet:
        """Both at once."""
        sketch = self.sketch(settled, verdict, stem=stem, culler=culler, frame=frame, moved=moved)
        truth = self._cast.get(settled.truth.camera.view, settled.truth)
        return self.paint(sketch, settled.scene, truth)

    def _draw_shared(
        self,
        at: str,
        scene: Scene,
        truth: FrameTruth,
        moved: NDArray[np.bool_] | None,
        shape: tuple[int, int],
    ) -> _Shared:
        shaded = _resized(_shade(scene, truth), shape)
        picture = _with_moved(scene, truth, shaded, moved, shape)
        owner = _owner_objects(scene, _nearest(truth.buffer.triangle, shape))
        files = {
            "picture": self._save("picture", f"frame-{at}.jpg", picture),
            "ids": self._save("ids", f"frame-{at}-ids.png", _id_picture(scene, owner)),
            "owners": self._save("owners", f"frame-{at}-owners.png", owner_picture(owner)),
        }
        return _Shared(files, np.asarray(shaded.convert("L")), owner < 0)

    def _save(self, what: str, name: str, image: Image.Image) -> str:
        """The file's name in the run folder."""
        options: dict[str, Any] = _PNG
        if name.endswith(".jpg"):
            options = {**_JPEG, "subsampling": 2 if what == "picture" else 0}
        self._folder.mkdir(parents=True, exist_ok=True)
        image.save(self._folder / name, **options)
        return f"{self._folder.name}/{name}"


def _stride(camera: Camera) -> int:
    """Every how many-th sample the shaded picture takes: two a page pixel are plenty."""
    return max(1, camera.width // (2 * PAGE_WIDTH_PX))


def _shade(scene: Scene, truth: FrameTruth) -> Float32:
    """The shaded scene, (h, w, 3) float32 in 0…1, with a colour an object, light from over
    the shoulder, darkened creases, outlines and haze."""
    camera = truth.camera
    stride = _stride(camera)
    triangle = truth.buffer.triangle[::stride, ::stride]
    depth = truth.buffer.depth[::stride, ::stride]
    hit = triangle >= 0
    height, width = triangle.shape
    sky = _SKY_TOP + np.linspace(0.0, 1.0, height, dtype=np.float32)[:, None] * (
        _SKY_FOOT - _SKY_TOP
    )
    image = np.broadcast_to(sky[:, None], (height, width, 3)).copy()
    if not hit.any():
        return image
    owns = np.zeros(scene.triangle_count, np.bool_)
    owns[triangle[hit]] = True
    owners = np.flatnonzero(owns)
    slot = np.zeros(scene.triangle_count, np.int32)
    slot[owners] = np.arange(len(owners), dtype=np.int32)
    colour = _lit_colours(scene, camera, owners)[slot[triangle[hit]]]

    far = _nearness_scale(camera, depth, hit)
    around = _blurred(far, max(2, width // 60))
    crease = np.clip(0.9 * (far - around)[hit], -0.12, 0.4)
    haze = 0.38 * far[hit] ** 2
    colour *= (1.0 - crease)[:, None] * _outline(scene, triangle)[hit][:, None]
    colour += haze[:, None] * (image[hit] - colour)
    image[hit] = np.clip(colour, 0.0, 1.0)
    return image


def _lit_colours(scene: Scene, camera: Camera, triangles: Int64) -> Float32:
    """(k, 3) float32 sRGB: the objects' colours under the light, two-sided."""
    objects, which = np.unique(scene.object_of_triangle[triangles], return_inverse=True)
    base = pastel(objects)[which]
    return srgb(base * light_on(scene, camera, triangles)[:, None]).astype(np.float32)


def light_on(scene: Scene, camera: Camera, triangles: Int64) -> Float64:
    """(k,) float64: how brightly triangles are lit, two-sided, from 0.26 to 1.04."""
    corners = scene.vertices[scene.triangles[triangles]].astype(np.float64)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1)
    normal /= np.where(length > 0.0, length, 1.0)[:, None]
    towards = camera.eye - corners[:, 0] if camera.is_perspective else -camera.forward[None]
    normal *= np.where((normal * towards).sum(axis=1) < 0.0, -1.0, 1.0)[:, None]
    in_camera = normal @ camera.world_from_camera[:3, :3]
    light: Float64 = 0.34 + 0.62 * np.maximum(in_camera @ _LIGHT, 0.0) + 0.08 * in_camera[:, 1]
    return light


def _nearness_scale(camera: Camera, depth: NDArray[np.float64], hit: NDArray[np.bool_]) -> Float32:
    """(h, w) float32: 0 at the nearest sample, 1 at (nearly) the farthest and in the sky.

    By the logarithm of depth in perspective, as the eye takes it.
    """
    values = np.log(depth[hit]) if camera.is_perspective else depth[hit]
    low = float(values.min())
    # One sliver at the horizon must not flatten everything else.
    high = float(np.quantile(values, 0.98, method="lower"))
    result = np.ones(depth.shape, np.float32)
    result[hit] = np.clip((values - low) / max(high - low, 1e-9), 0.0, 1.0)
    return result


def _blurred(image: Float32, radius: int) -> Float32:
    """Two passes of a box of some (2 * radius + 1) pixels in each direction, on an image of a
    `radius`-th of the size: so smooth, it shows no more."""
    step = max(1, radius // 5)
    small = np.asarray(Image.fromarray(image).reduce(step))
    small = _boxed(_boxed(small, radius // step), radius // step)
    height, width = image.shape
    # The reduced pixels at the rim stand for what of the image there is.
    box = (0.0, 0.0, width / step, height / step)
    spread = Image.fromarray(small).resize((width, height), Image.Resampling.BILINEAR, box)
    return np.asarray(spread)


def _boxed(image: Float32, radius: int) -> Float32:
    span = 2 * radius + 1
    for axis in (0, 1):
        pad = [(0, 0), (0, 0)]
        pad[axis] = (radius + 1, radius)
        total = np.cumsum(np.pad(image, pad, mode="edge"), axis=axis, dtype=np.float64)
        if axis == 0:
            image = ((total[span:] - total[:-span]) / span).astype(np.float32)
        else:
            image = ((total[:, span:] - total[:, :-span]) / span).astype(np.float32)
    return image


def _owner_objects(scene: Scene, triangle: Int32) -> Int32:
    """Objects in place of triangles, -1 for the background."""
    return np.where(triangle >= 0, scene.object_of_triangle[triangle], -1).astype(np.int32)


def _outline(scene: Scene, triangle: Int32) -> Float32:
    """(h, w) float32 factors: less than 1 where one object ends and another begins."""
    result = np.ones(triangle.shape, np.float32)
    result[borders(_owner_objects(scene, triangle))] = 0.72
    return result


def _resized(image: Float32, shape: tuple[int, int]) -> Image.Image:
    picture = Image.fromarray(np.round(image * 255.0).astype(np.uint8))
    return picture.resize((shape[1], shape[0]), Image.Resampling.LANCZOS)


def _shrunk(samples: Int64, camera: Camera, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """(h, w) bool, True where any of these samples falls into the page pixel."""
    result = np.zeros(shape, np.bool_)
    y, x = np.divmod(samples, camera.width)
    result[y * shape[0] // camera.height, x * shape[1] // camera.width] = True
    return result


def _with_moved(
    scene: Scene,
    truth: FrameTruth,
    picture: Image.Image,
    moved: NDArray[np.bool_] | None,
    shape: tuple[int, int],
) -> Image.Image:
    """The shaded scene, on which the objects that moved are tinted, with a line two pixels wide
    around each."""
    if moved is None or not moved.any():
        return picture
    owner = _owner_objects(scene, _nearest(truth.buffer.triangle, shape))
    owner = np.where(moved[owner] & (owner >= 0), owner, -1).astype(np.int32)
    edge = borders(owner)
    edge[1:] |= edge[:-1]
    edge[:, 1:] |= edge[:, :-1]
    image = np.asarray(picture, np.float32) / 255.0
    strength = np.where(edge, 0.95, np.where(owner >= 0, 0.3, 0.0))
    _blend(image, strength.astype(np.float32), MOVED_RGB)
    return Image.fromarray(np.round(image * 255.0).astype(np.uint8))


def _nearest(buffer: Int32, shape: tuple[int, int]) -> Int32:
    """The buffer at the page's pixels, one sample each."""
    height, width = buffer.shape
    y = (2 * np.arange(shape[0]) + 1) * height // (2 * shape[0])
    x = (2 * np.arange(shape[1]) + 1) * width // (2 * shape[1])
    picked: Int32 = buffer[y[:, None], x[None, :]]
    return picked


def _rings(
    scene: Scene, truth: FrameTruth, verdict: FrameVerdict, missed: Int64, shape: tuple[int, int]
) -> list[_Ring]:
    """Rings around the missed objects whose lost samples span only a small patch."""
    camera = truth.camera
    scale = shape[1] / camera.width
    columns = verdict.misses.columns
    # In the misses' order: those that lose most come first, and of these there may be thousands.
    listed = np.flatnonzero(~verdict.misses.are(MissKind.TIE))
    owner = _owner_objects(scene, truth.buffer.triangle.reshape(-1)[missed])
    y, x = np.divmod(missed, camera.width)
    extent = np.stack([-x, x, -y, y])
    most = np.full((4, scene.object_count + 1), np.iinfo(np.int64).min)
    for side, values in zip(most, extent, strict=True):
        # The last place is the background's.
        np.maximum.at(side, owner, values)
    most = most[:, columns.object[listed]]
    # What owns none of the lost samples, as glass, is marked where its witness is.
    mine = np.array([view == camera.view for view in verdict.misses.views])
    alone = most[1] < 0
    here = mine[columns.view[listed]]
    y, x = np.divmod(columns.sample[listed], camera.width)
    low_x, high_x, low_y, high_y = np.where(alone, np.stack([-x, x, -y, y]), most) * (
        np.array([[-1], [1], [-1], [1]])
    )
    span = np.maximum(high_x - low_x, high_y - low_y) + 1
    marked = (~alone | here) & (span * scale < RING_BELOW_PX)
    first = np.flatnonzero(marked)[:MAX_RINGS]
    return [
        _Ring(
            float((low_x[at] + high_x[at] + 1) / 2 * scale),
            float((low_y[at] + high_y[at] + 1) / 2 * scale),
            float(span[at] * scale / 2 + 9.0),
        )
        for at in first
    ]


def _overlay(
    grey: NDArray[np.uint8],
    empty: NDArray[np.bool_],
    superfluous: Int32,
    missed: NDArray[np.bool_],
    rings: list[_Ring],
) -> Image.Image:
    """Visible in blue, superfluous hatched in orange through it, missed in vermilion."""
    height, width = grey.shape
    inside = superfluous >= 0
    y, x = np.indices((height, width), np.int32, sparse=True)
    line = (x + y) % 8 < 3
    what = np.where(inside, np.where(line, _HATCHED, _COVERED), _PLAIN)
    what[borders(superfluous)] = _EDGE
    what[missed] = _MISSED
    pixels = _overlay_colours()[empty.astype(np.intp), what, grey]
    for ring in rings:
        part, distance = ring.around((height, width))
        image = pixels[part].astype(np.float32) / 255.0
        halo = np.clip(_RING_HALO - distance, 0.0, 1.0).astype(np.float32)
        _blend(image, halo, (255, 255, 255))
        _blend(image, np.clip(2.0 - distance, 0.0, 1.0).astype(np.float32), MISSED_RGB)
        pixels[part] = np.round(image * 255.0)
    return Image.fromarray(pixels)


# What the picture of what was drawn shows at a pixel.
_PLAIN, _COVERED, _HATCHED, _EDGE, _MISSED = range(5)


@cache
def _overlay_colours() -> NDArray[np.uint8]:
    """(2, 5, 256, 3) uint8: the colours of that picture, where something is seen and where nothing
    is, by what it shows there and by the shaded scene's grey."""
    dark, light = np.array([0.05, 0.17, 0.29]), np.array([0.74, 0.88, 0.98])
    image = np.empty((2, 5, 256, 3), np.float32)
    image[0] = dark + (light - dark) * np.linspace(0.0, 1.0, 256)[:, None]
    image[1] = 0.955, 0.96, 0.965
    for what, strength in ((_COVERED, 0.16), (_HATCHED, 0.8), (_EDGE, 0.95)):
        _blend(image[:, what], np.full((2, 256), strength, np.float32), SUPERFLUOUS_RGB)
    _blend(image[:, _MISSED], np.ones((2, 256), np.float32), MISSED_RGB)
    return np.round(image * 255.0).astype(np.uint8)


def _blend(image: Float32, strength: Float32, rgb: tuple[int, int, int]) -> None:
    """Lay a colour over the image in place, as strongly as `strength` (h, w) says."""
    image += strength[..., None] * (np.array(rgb, np.float32) / 255.0 - image)


def _id_picture(scene: Scene, owner: Int32) -> Image.Image:
    colours = np.concatenate([vivid(np.arange(scene.object_count)), np.zeros((1, 3), np.uint8)])
    return Image.fromarray(colours[owner])


def _errors(empty: NDArray[np.bool_], missed: NDArray[np.bool_], rings: list[_Ring]) -> Image.Image:
    """The missed samples alone, over the silhouette of the scene."""
    index = np.where(empty, 0, 1).astype(np.uint8)
    for ring in rings:
        part, distance = ring.around(missed.shape)
        index[part][distance < 1.2] = 3
    index[missed] = 2
    picture = Image.fromarray(index)
    picture.putpalette([14, 18, 23, 52, 62, 74, *MISSED_RGB, 255, 255, 255])
    return picture
