"""What a case becomes with less in it, or with simpler numbers: one function per kind of change.

Each gives a new case and leaves the rest as it is. Whether it still shows the fault is for who asks
to try.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from visref.camera import Camera
from visref.camera_path import CameraPath, Frame
from visref.scene import Alpha, Float32, Float64, Int64, Scene
from visref.search.case import Case, given_names, masks_of

Bool = NDArray[np.bool_]


def with_frames(case: Case, frames: Sequence[Frame]) -> Case:
    return replace(case, path=CameraPath(frames, case.path.source))


def each_frame(case: Case, change: Callable[[Frame], Frame]) -> Case:
    return with_frames(case, [change(frame) for frame in case.path.frames])


def each_camera(case: Case, change: Callable[[Camera], Camera]) -> Case:
    def changed(frame: Frame) -> Frame:
        return replace(frame, cameras=tuple(map(change, frame.cameras)))

    return each_frame(case, changed)


# Less of it.


def only_frames(case: Case, kept: Sequence[int]) -> Case:
    """The frames at these places, ascending."""
    shapes = {index: shapes[list(kept)] for index, shapes in case.shapes.items()}
    frames = [case.path.frames[at] for at in kept]
    return replace(case, path=CameraPath(frames, case.path.source), shapes=shapes)


def only_views(case: Case, kept: Collection[str]) -> Case:
    """The views of these names. Raises InputError where a frame is left without one."""

    def changed(frame: Frame) -> Frame:
        return replace(frame, cameras=tuple(one for one in frame.cameras if one.view in kept))

    return each_frame(case, changed)


def only_objects(case: Case, kept: Collection[str]) -> Case:
    """The objects of these names, with all their triangles."""
    scene = case.scene
    objects = np.array([name in kept for name in scene.names], np.bool_)
    return _taken(case, objects, objects[scene.object_of_triangle])


def only_triangles(case: Case, kept: Sequence[int]) -> Case:
    """The triangles with these ids; an object stays, whatever is left of it."""
    triangles = np.zeros(case.scene.triangle_count, np.bool_)
    triangles[list(kept)] = True
    return _taken(case, np.ones(case.scene.object_count, np.bool_), triangles)


def _taken(case: Case, objects: Bool, triangles: Bool) -> Case:
    """Some objects, (n,) bool, and some of the triangles, (t,) bool, with the vertices that these
    use."""
    scene, starts = case.scene, case.vertex_starts
    faces = scene.triangles[triangles]
    used, renumbered = np.unique(faces, return_inverse=True)
    sizes = np.bincount(scene.object_of_triangle[triangles], minlength=scene.object_count)[objects]
    numbers = np.cumsum(objects) - 1
    shapes: dict[int, Float32] = {}
    for index, own in case.shapes.items():
        rows = used[(used >= starts[index]) & (used < starts[index + 1])] - starts[index]
        if objects[index] and len(rows):
            shapes[int(numbers[index])] = own[:, rows]
    names = tuple(name for name, stays in zip(scene.names, objects, strict=True) if stays)
    gone = set(scene.names) - set(names)
    frames = case.path.frames
    if gone:
        frames = tuple(_without(frame, gone) for frame in frames)
    given = given_names(
        names, [n for n, stays in zip(scene.given_names, objects, strict=True) if stays], frames
    )
    taken = Scene(
        vertices=scene.vertices[used],
        triangles=renumbered.reshape(-1, 3).astype(np.int32),
        object_offsets=np.concatenate([[0], np.cumsum(sizes)]),
        names=names,
        one_sided=scene.one_sided[triangles],
        alpha=scene.alpha[triangles],
        source=scene.source,
        masks=masks_of(scene, triangles),
        origin=scene.origin,
        given_names=given,
        paths=given,
    )
    return replace(case, scene=taken, path=CameraPath(frames, case.path.source), shapes=shapes)


def _without(frame: Frame, gone: Collection[str]) -> Frame:
    return replace(
        frame,
        world_from_object={n: m for n, m in frame.world_from_object.items() if n not in gone},
        absent=tuple(name for name in frame.absent if name not in gone),
    )


def told_apart(case: Case) -> Case:
    """Each object under a name of its own."""
    return replace(
        case, scene=replace(case.scene, given_names=case.scene.names, paths=case.scene.names)
    )


# Plainer materials.


def opaque(case: Case, objects: Collection[str]) -> Case:
    """These objects without alpha masks and glass."""
    scene = case.scene
    chosen = _triangles_of(scene, objects)
    alpha = np.where(chosen, np.uint8(Alpha.OPAQUE), scene.alpha)
    masks = scene.masks
    if masks is not None:
        row = np.where(chosen, np.int32(-1), masks.row)
        masks = replace(masks, row=row).take(np.arange(len(row)))
        masks = masks if (masks.row >= 0).any() else None
    return replace(case, scene=replace(scene, alpha=alpha, masks=masks))


def two_sided(case: Case, objects: Collection[str]) -> Case:
    scene = case.scene
    sides = scene.one_sided & ~_triangles_of(scene, objects)
    return replace(case, scene=replace(scene, one_sided=sides))


def _triangles_of(scene: Scene, objects: Collection[str]) -> Bool:
    chosen = np.array([name in objects for name in scene.names], np.bool_)
    result: Bool = chosen[scene.object_of_triangle]
    return result


# Less motion.


def stopped(case: Case, objects: Collection[str]) -> Case:
    """These objects as they stand in the last frame, for good; there in every frame, unless they
    are absent in the last."""
    last = len(case.path) - 1
    scene = case.scene
    inputs = case.inputs()
    now = inputs.timeline.at(last)
    chosen = [index for index, name in enumerate(scene.names) if name in objects]
    vertices, triangles = scene.vertices.copy(), scene.triangles.copy()
    absent = set(case.path.frames[last].absent)
    for index in chosen:
        if scene.names[index] in absent:
            continue
        rows = slice(*case.vertex_starts[index : index + 2])
        part = slice(*scene.object_offsets[index : index + 2])
        vertices[rows] = now.vertices[rows]
        triangles[part] = now.triangles[part]
    frames = [
        replace(
            _without(frame, objects),
            absent=tuple(dict.fromkeys(
                [*(n for n in frame.absent if n not in objects), *sorted(absent & set(objects))]
            )),
        )
        for frame in case.path.frames
    ]  # fmt: skip
    shapes = {index: own for index, own in case.shapes.items() if index not in chosen}
    return replace(
        case,
        scene=replace(scene, vertices=vertices, triangles=triangles),
        path=CameraPath(frames, case.path.source),
        shapes=shapes,
    )


def with_absences(case: Case, kept: Collection[tuple[int, str]]) -> Case:
    """Absent only what is absent in a frame, by its place, and is among these."""
    return with_frames(
        case,
        [
            replace(frame, absent=tuple(name for name in frame.absent if (at, name) in kept))
            for at, frame in enumerate(case.path.frames)
        ],
    )


def rounded_poses(case: Case, digits: int, *, only_moved: bool = False) -> Case:
    """Every matrix with so many digits after the point; with `only_moved` as a translation."""

    def plain(matrix: Float64) -> Float64:
        result = np.eye(4)
        if not only_moved:
            result[:3, :3] = np.round(matrix[:3, :3], digits) + 0.0
        result[:3, 3] = np.round(matrix[:3, 3], digits) + 0.0
        return result

    return each_frame(
        case,
        lambda frame: replace(
            frame,
            world_from_object={n: plain(m) for n, m in frame.world_from_object.items()},
        ),
    )


# Another place, and simpler numbers.


def moved_by(case: Case, step: Float64) -> Case:
    """The whole case under a rigid motion, (4, 4) float64, of the world, whose origin is then at
    zero."""
    scene = case.scene
    absolute = scene.vertices.astype(np.float64) + scene.origin

    def put(points: Float64) -> Float32:
        result: Float32 = (points @ step[:3, :3].T + step[:3, 3]).astype(np.float32)
        return result

    vertices = put(absolute)
    posed = {name for frame in case.path.frames for name in frame.world_from_object}
    starts = case.vertex_starts
    for index, name in enumerate(scene.names):
        if name in posed:
            # Its matrix moves along instead.
            rows = slice(*starts[index : index + 2])
            vertices[rows] = scene.vertices[rows]
    shapes = {
        index: put(own.astype(np.float64).reshape(-1, 3) + scene.origin).reshape(own.shape)
        for index, own in case.shapes.items()
    }
    frames = [
        replace(
            frame,
            cameras=tuple(_moved_camera(camera, step) for camera in frame.cameras),
            world_from_object={
                name: step @ frame.world_from_object.get(name, np.eye(4)) for name in posed
            },
        )
        for frame in case.path.frames
    ]
    return replace(
        case,
        scene=replace(scene, vertices=vertices, origin=np.zeros(3)),
        path=CameraPath(frames, case.path.source),
        shapes=shapes,
    )


def _moved_camera(camera: Camera, step: Float64) -> Camera:
    plane = camera.clip_plane
    if plane is not None:
        normal = step[:3, :3] @ np.array(plane[:3])
        a, b, c = normal.tolist()
        plane = (a, b, c, plane[3] - float(normal @ step[:3, 3]))
    return replace(camera, world_from_camera=step @ camera.world_from_camera, clip_plane=plane)


def to_the_eye(case: Case, *, turned: bool) -> Case:
    """The case moved so that the last frame's first camera is at the origin, and, if `turned`,
    looks down -Z."""
    last = case.path.frames[-1].cameras[0]
    step = np.eye(4)
    if turned:
        step[:3, :3] = last.world_from_camera[:3, :3].T
    step[:3, 3] = -step[:3, :3] @ last.world_from_camera[:3, 3]
    result = moved_by(case, step)
    pose = np.eye(4)
    if not turned:
        pose[:3, :3] = last.world_from_camera[:3, :3]

    def put(camera: Camera) -> Camera:
        # What stood there stands exactly there.
        same = np.allclose(camera.world_from_camera, pose, rtol=0.0, atol=1e-12)
        return replace(camera, world_from_camera=pose) if same else camera

    return each_camera(result, put)


def rounded_vertices(case: Case, digits: int, kept: Collection[int]) -> Case:
    """All vertices but those with the ids `kept` with so many digits after the point (fewer than
    none: whole tens, and so on), shapes too."""
    chosen = np.ones(len(case.scene.vertices), np.bool_)
    chosen[list(kept)] = False
    vertices = np.where(chosen[:, None], rounded(case.scene.vertices, digits), case.scene.vertices)
    starts = case.vertex_starts
    shapes = {
        index: np.where(
            chosen[starts[index] : starts[index + 1], None], rounded(own, digits), own
        ).astype(np.float32)
        for index, own in case.shapes.items()
    }
    return replace(case, scene=replace(case.scene, vertices=vertices), shapes=shapes)


def rounded(values: Float32, digits: int) -> Float32:
    """To so many digits after the point, in decimals, then to float32."""
    result: Float32 = (np.round(values.astype(np.float64), digits) + 0.0).astype(np.float32)
    return result


def not_so_short(case: Case, digits: int) -> Int64:
    """(k,) int64, the vertices that have more digits after the point."""
    vertices = case.scene.vertices
    long = (rounded(vertices, digits) != vertices).any(axis=1)
    for index, own in case.shapes.items():
        start, end = case.vertex_starts[index : index + 2]
        long[start:end] |= (rounded(own, digits) != own).any(axis=(0, 2))
    return np.flatnonzero(long)


def aimed(case: Case) -> Case:
    """Each perspective camera turned to where its shifted image's middle is, without the shift."""

    def put(camera: Camera) -> Camera:
        if camera.yfov is None:
            return camera
        ahead = math.tan(camera.yfov / 2) / camera.height
        # The middle of an image has a = 2 shift_x and b = -2 shift_y.
        back = np.array([-2.0 * camera.shift_x_px * ahead, 2.0 * camera.shift_y_px * ahead, 1.0])
        back /= np.linalg.norm(back)
        right = np.cross([0.0, 1.0, 0.0], back)
        right /= np.linalg.norm(right)
        turn = np.eye(4)
        turn[:3, :3] = np.stack([right, np.cross(back, right), back], axis=1)
        pose = camera.world_from_camera @ turn
        return replace(camera, world_from_camera=pose, shift_x_px=0.0, shift_y_px=0.0)

    return each_camera(case, put)


# The image.


def resized(case: Case, width: int, height: int) -> Case:
    """All views at this size, with the field of view that they have."""

    def put(camera: Camera) -> Camera:
        shift = camera.shift_x_px * width / camera.width, camera.shift_y_px * height / camera.height
        return replace(camera, width=width, height=height, shift_x_px=shift[0], shift_y_px=shift[1])

    return each_camera(case, put)


def cut_out(case: Case, x: int, y: int, width: int, height: int) -> Case:
    """Of every view the part whose first pixel is (x, y): the same samples, by a shorter field of
    view and a shifted lens (up to rounding)."""

    def put(camera: Camera) -> Camera:
        share = height / camera.height
        # a = 2 (x + shift) + 1 - width of a pixel stays what it was.
        shift_x = camera.shift_x_px + x + (width - camera.width) / 2
        shift_y = camera.shift_y_px + y + (height - camera.height) / 2
        lens: dict[str, float] = {}
        if camera.yfov is not None:
            lens["yfov"] = 2.0 * math.atan(math.tan(camera.yfov / 2) * share)
        else:
            assert camera.ymag is not None
            lens["ymag"] = camera.ymag * share
        return replace(
            camera,
            width=width,
            height=height,
            shift_x_px=shift_x,
            shift_y_px=shift_y,
            **lens,  # type: ignore[arg-type]
        )

    return each_camera(case, put)


def with_lens(case: Case, values: Mapping[str, object]) -> Case:
    """All cameras with these fields; those that the camera's projection lacks are left out."""

    def put(camera: Camera) -> Camera:
        own = {k: v for k, v in values.items() if getattr(camera, k) is not None or v is None}
        return replace(camera, **own)  # type: ignore[arg-type]

    return each_camera(case, put)
