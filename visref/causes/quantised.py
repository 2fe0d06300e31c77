"""Depths that are rounded too coarsely."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from visref.causes.rectangles import asked, kept
from visref.causes.sights import At, Tell, Told
from visref.causes.texels import finite_far
from visref.scene import Float64

Round = Callable[[Any], Any]


def in_steps(
    steps: int, how: Round, at: At, *, linear: bool
) -> Callable[[Float64], Float64] | None:
    """Depths, (…) float64, in so many steps of window depth, or (`linear`) of view depth."""
    camera, far = at.camera, finite_far(at)
    if not camera.is_perspective and not math.isfinite(camera.near):
        return None
    hyperbolic = camera.is_perspective and not linear

    def read(image: Float64) -> Float64:
        with np.errstate(divide="ignore", invalid="ignore"):
            if hyperbolic:
                span = 1.0 / camera.near - 1.0 / far
                window = (1.0 / camera.near - 1.0 / image) / span
                whole = np.clip(how(window * steps) / steps, 0.0, 1.0)
                back = 1.0 / (1.0 / camera.near - whole * span)
            else:
                window = (image - camera.near) / (far - camera.near)
                whole = np.clip(how(window * steps) / steps, 0.0, 1.0)
                back = camera.near + whole * (far - camera.near)
        return np.asarray(np.where(np.isinf(image), np.inf, back))

    return read


def as_half(at: At) -> Callable[[Float64], Float64]:
    """Depths as float16."""

    def read(image: Float64) -> Float64:
        with np.errstate(over="ignore"):
            return np.asarray(image.astype(np.float16).astype(np.float64))

    return read


Reader = Callable[[At], Callable[[Float64], Float64] | None]


def read_by(reader: Reader, key: object, *, box: bool) -> Tell:
    """`box`: the box's depth is rounded too."""

    def tell(at: At) -> Told:
        read = reader(at)
        if read is None:
            return None
        layers = at.now.kept(("read", key), lambda: at.now.layers().mapped(read))
        depth = read(at.boxes.nearest) if box else at.boxes.nearest
        return kept(at, asked(at, at.boxes.rectangles, depth, layers=layers).passing > 0)

    return tell


def steps(bits: int, how: Round, *, linear: bool) -> Reader:
    return lambda at: in_steps((1 << bits) - 1, how, at, linear=linear)


QUANTISED: dict[str, Tell] = {
    **{
        f"{bits} bits{' of view depth' * linear}, {name}{', box too' * box}": read_by(
            steps(bits, how, linear=linear), (bits, how, linear), box=box
        )
        for linear in (False, True)
        for bits in ((8,) if linear else (8, 16))
        for name, how in (("nearest", np.rint), ("down", np.floor))
        for box in (False, True)
    },
    **{f"half{', box too' * box}": read_by(as_half, "half", box=box) for box in (False, True)},
}
