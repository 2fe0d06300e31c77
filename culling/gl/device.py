"""The OpenGL context, the only one of the process, and the state that every draw states whole.

No other module makes a context. A draw or a query names its complete `State`; `Device.apply`
sets what differs and counts it, so one method's settings never leak into another's.
"""

from __future__ import annotations

import ctypes
import re
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, wraps
from importlib.resources import files
from typing import Any, NamedTuple

import glcontext  # type: ignore[import-untyped]
import moderngl
import numpy as np
from numpy.typing import NDArray

from visref.errors import InputError, NothingToJudge

# Direct state access (4.5) and early fragment tests with atomics (4.2, 4.3) are used.
GL_VERSION = 450

# Targets are kept by size. A method holds one for a frame, its item buffer another; a path
# whose frames differ in size must not pile up images.
MAX_TARGETS = 6

_COLOR = 0x1800
_DEPTH_ATTACHMENT = 0x8D00
_DEPTH_SIZE = 0x8216
_DEPTH_CLAMP = 0x864F
_CLIP_DISTANCE0 = 0x3000
_TEXTURE_2D = 0x0DE1
_DEPTH_FORMAT = {24: 0x81A6, 32: 0x8CAC}  # GL_DEPTH_COMPONENT24, GL_DEPTH_COMPONENT32F

_SIGNATURES: dict[str, tuple[Any, ...]] = {
    "glCreateTextures": (ctypes.c_uint, ctypes.c_int, ctypes.POINTER(ctypes.c_uint)),
    "glTextureStorage2D": (
        ctypes.c_uint,
        ctypes.c_int,
        ctypes.c_uint,
        ctypes.c_int,
        ctypes.c_int,
    ),
    "glDeleteTextures": (ctypes.c_int, ctypes.POINTER(ctypes.c_uint)),
    "glNamedFramebufferTexture": (ctypes.c_uint, ctypes.c_uint, ctypes.c_uint, ctypes.c_int),
    "glClearNamedFramebufferiv": (
        ctypes.c_uint,
        ctypes.c_uint,
        ctypes.c_int,
        ctypes.POINTER(ctypes.c_int),
    ),
    "glClearNamedFramebufferfv": (
        ctypes.c_uint,
        ctypes.c_uint,
        ctypes.c_int,
        ctypes.POINTER(ctypes.c_float),
    ),
    "glGetNamedFramebufferAttachmentParameteriv": (
        ctypes.c_uint,
        ctypes.c_uint,
        ctypes.c_uint,
        ctypes.POINTER(ctypes.c_int),
    ),
}


_EGL_DRAW, _EGL_READ = 0x3059, 0x305A


@cache
def _egl() -> ctypes.CDLL:
    """EGL's own functions, which say what is current."""
    egl = ctypes.CDLL("libEGL.so.1")
    handle = ctypes.c_void_p
    for name, arguments in {
        "eglGetCurrentContext": (),
        "eglGetCurrentDisplay": (),
        "eglGetCurrentSurface": (ctypes.c_int,),
        "eglMakeCurrent": (handle, handle, handle, handle),
    }.items():
        function = getattr(egl, name)
        function.argtypes = arguments
        function.restype = ctypes.c_uint if name == "eglMakeCurrent" else handle
    return egl


@contextmanager
def _theirs_again() -> Iterator[None]:
    """Makes current afterwards what is so now, if anything is."""
    egl = _egl()
    theirs, display = egl.eglGetCurrentContext(), egl.eglGetCurrentDisplay()
    drawn, read = egl.eglGetCurrentSurface(_EGL_DRAW), egl.eglGetCurrentSurface(_EGL_READ)
    try:
        yield
    finally:
        if theirs:
            egl.eglMakeCurrent(display, drawn, read, theirs)


class State(NamedTuple):
    """Everything that a draw's outcome depends on, besides its own data.

    `depth_func` is "<", "<=" or, for no depth test at all, "". `cull_back_faces` takes counter-
    clockwise as the front. `clamp_depth` clamps depth to the range instead of clipping there.
    `add_colours` adds to the colours that are there instead of replacing them. `cut` leaves out
    what is on the wrong side of the clip plane; the program writes the distance to it.
    """

    framebuffer: moderngl.Framebuffer
    program: moderngl.Program
    depth_func: str = "<="
    depth_write: bool = True
    colour_write: bool = True
    cull_back_faces: bool = False
    clamp_depth: bool = False
    add_colours: bool = False
    cut: bool = False


@dataclass(frozen=True, eq=False)
class Target:
    """An image to draw into: (height, width) of one colour and one depth.

    `framebuffer` has both; `scratch` has the same depth with a colour attachment that nobody
    reads, for shaders that only count (Mesa drops those where colour writes are off). `depth` is
    that depth as a texture, first row at the bottom.
    """

    framebuffer: moderngl.Framebuffer
    scratch: moderngl.Framebuffer
    depth_bits: int
    depth: moderngl.Texture

    def read_depth(self) -> NDArray[np.float32]:
        """(height, width) float32 window depth in [0, 1], top row first."""
        raw = self.framebuffer.read(components=1, attachment=-1, dtype="f4")
        width, height = self.framebuffer.size
        return np.frombuffer(raw, np.float32).reshape(height, width)[::-1]

    def read_ids(self) -> NDArray[np.int32]:
        """(height, width) int32 of an integer target, top row first."""
        raw = self.framebuffer.read(components=1, dtype="i4")
        width, height = self.framebuffer.size
        return np.frombuffer(raw, np.int32).reshape(height, width)[::-1]


class Device:
    """A GL context with its programs and targets. Get the process's one from `device()`."""

    def __init__(self) -> None:
        try:
            loader = glcontext.get_backend_by_name("egl")(mode="standalone", glversion=GL_VERSION)
            self.context = moderngl.create_context(
                standalone=True, context=loader, require=GL_VERSION
            )
        except Exception as error:
            # glcontext and moderngl raise bare Exceptions, whatever the cause.
            raise NothingToJudge(
                f"no OpenGL {GL_VERSION / 100:.1f} context can be made through EGL ({error}); "
                "install a driver with EGL, such as Mesa (libegl1 libgl1 libgl1-mesa-dri)"
            ) from error
        self.thread = threading.get_ident()
        self._handle = _egl().eglGetCurrentContext()
        self.gl = {
            name: ctypes.CFUNCTYPE(None, *arguments)(loader.load_opengl_function(name))
            for name, arguments in _SIGNATURES.items()
        }
        info = self.context.info
        self.subpixel_bits = int(info["GL_SUBPIXEL_BITS"])
        self.max_side = min(int(info["GL_MAX_TEXTURE_SIZE"]), *info["GL_MAX_VIEWPORT_DIMS"])
        self.max_block_bytes = int(info["GL_MAX_SHADER_STORAGE_BLOCK_SIZE"])
        self.context.front_face = "ccw"
        self.context.cull_face = "back"
        self.context.blend_func = moderngl.ONE, moderngl.ONE
        self._programs: dict[tuple[str, str, str | None], moderngl.Program] = {}
        self._computes: dict[str, moderngl.ComputeShader] = {}
        self._targets: OrderedDict[tuple[int, int, int, str, int], tuple[Target, list[Any]]] = (
            OrderedDict()
        )
        self._state: State | None = None
        self._home = self.context.framebuffer([self.context.texture((1, 1), 1)])
        self._queries: list[moderngl.Query] = []

    @contextmanager
    def current(self) -> Iterator[None]:
        """Makes the context current, and afterwards the one that was so before, if there was any.
        (glcontext leaves none current when it leaves one.)"""
        if _egl().eglGetCurrentContext() == self._handle:
            yield
            return
        with _theirs_again(), self.context:
            yield

    def report(self) -> dict[str, str | int]:
        """What works on this machine: renderer, version and the limits that matter here."""
        info = self.context.info
        attached = ctypes.c_int(0)
        framebuffer = self.target(1, 1).framebuffer
        self.gl["glGetNamedFramebufferAttachmentParameteriv"](
            framebuffer.glo, _DEPTH_ATTACHMENT, _DEPTH_SIZE, ctypes.byref(attached)
        )
        return {
            "renderer": info["GL_RENDERER"],
            "version": info["GL_VERSION"],
            "sub-pixel bits": self.subpixel_bits,
            "depth bits": attached.value,
            "largest image side": self.max_side,
            "largest storage block (bytes)": self.max_block_bytes,
        }

    def program(self, vertex: str, fragment: str, geometry: str | None = None) -> moderngl.Program:
        """The program of two or three files in `culling/shaders`, compiled once."""
        key = (vertex, fragment, geometry)
        if key not in self._programs:
            self._programs[key] = self.context.program(
                vertex_shader=shader_source(vertex),
                fragment_shader=shader_source(fragment),
                geometry_shader=None if geometry is None else shader_source(geometry),
            )
        return self._programs[key]

    def compute(self, shader: str) -> moderngl.ComputeShader:
        """The compute shader of a file in `culling/shaders`, compiled once."""
        if shader not in self._computes:
            self._computes[shader] = self.context.compute_shader(shader_source(shader))
        return self._computes[shader]

    def queries(self, count: int) -> list[moderngl.Query]:
        """At least `count` sample queries. moderngl cannot free one, so they are shared."""
        while len(self._queries) < count:
            self._queries.append(self.context.query(samples=True))
        return self._queries

    def target(
        self,
        width: int,
        height: int,
        depth_bits: int = 24,
        dtype: str = "f1",
        channels: int = 1,
    ) -> Target:
        """The image of this size, its content left from whoever used it last.

        `depth_bits` 24 (fixed point) or 32 (floating point); `dtype` "f1" for an 8-bit colour,
        "i4" for ids, "f4" for sums; `channels` of the colour and of the scratch image. Good until
        `MAX_TARGETS` others were asked for.
        """
        key = (width, height, depth_bits, dtype, channels)
        if key in self._targets:
            self._targets.move_to_end(key)
            return self._targets[key][0]
        if max(width, height) > self.max_side:
            raise InputError(
                f"an image of {width} by {height} pixels is more than this OpenGL can draw",
                place="width" if width >= height else "height",
                fix=f"give at most {self.max_side} pixels on a side",
            )
        while len(self._targets) >= MAX_TARGETS:
            _, (_, parts) = self._targets.popitem(last=False)
            # moderngl goes back to the framebuffer that was in use, so it must be a living one.
            self._home.use()
            self._state = None
            for part in parts:
                part.release()
        depth = _DepthTexture(self, width, height, depth_bits)
        colours = [
            self.context.texture((width, height), channels, dtype=dtype),
            self.context.texture((width, height), channels, dtype="f1"),
        ]
        framebuffers = []
        for colour in colours:
            framebuffer = self.context.framebuffer([colour])
            self.gl["glNamedFramebufferTexture"](
                framebuffer.glo, _DEPTH_ATTACHMENT, depth.name.value, 0
            )
            framebuffers.append(framebuffer)
        # Not owned: it goes with `_DepthTexture`.
        sampled = self.context.external_texture(depth.name.value, (width, height), 1, 0, "f4")
        made = Target(framebuffers[0], framebuffers[1], depth_bits, sampled)
        self._targets[key] = (made, [*framebuffers, *colours, depth])
        return made

    def begin_frame(self) -> None:
        """Count the state changes to come from scratch, whatever drew before this frame."""
        self._state = None

    def apply(self, state: State) -> int:
        """Make this the GL state; returns how many of its parts had to change."""
        before, self._state = self._state, state
        context, framebuffer = self.context, state.framebuffer
        if before is None or before.framebuffer is not framebuffer:
            framebuffer.use()
        framebuffer.depth_mask = state.depth_write
        framebuffer.color_mask = (state.colour_write,) * 4
        flags = moderngl.DEPTH_TEST if state.depth_func else moderngl.NOTHING
        if state.cull_back_faces:
            flags |= moderngl.CULL_FACE
        if state.add_colours:
            flags |= moderngl.BLEND
        context.enable_only(flags)
        if state.depth_func:
            context.depth_func = state.depth_func
        (context.enable_direct if state.clamp_depth else context.disable_direct)(_DEPTH_CLAMP)
        (context.enable_direct if state.cut else context.disable_direct)(_CLIP_DISTANCE0)
        if before is None:
            return len(state)
        return sum(old != new for old, new in zip(before, state, strict=True))

    def clear(self, state: State) -> int:
        """Clear the state's framebuffer (which it must let be written): colour to 0, depth
        to 1. Returns the state changes."""
        changes = self.apply(state)
        state.framebuffer.clear(depth=1.0)
        return changes

    def clear_colour(self, framebuffer: moderngl.Framebuffer) -> None:
        """Set every pixel of a normalised image to 0, leaving its depth."""
        zeros = (ctypes.c_float * 4)()
        self.gl["glClearNamedFramebufferfv"](framebuffer.glo, _COLOR, 0, zeros)

    def clear_ids(self, state: State, value: int) -> int:
        """Set every pixel of an integer image to `value`, leaving its depth. Returns the
        state changes."""
        changes = self.apply(state)
        four = (ctypes.c_int * 4)(*[value] * 4)
        self.gl["glClearNamedFramebufferiv"](state.framebuffer.glo, _COLOR, 0, four)
        return changes


def shader_source(name: str) -> str:
    """The text of a shader, with each line `#include "FILE"` replaced by that file's text."""
    text = (files("visref_culling") / "shaders" / name).read_text(encoding="utf-8")
    return re.sub(
        r'^#include "([\w.]+)"$', lambda line: shader_source(line[1]), text, flags=re.MULTILINE
    )


def set_uniform(
    program: moderngl.Program | moderngl.ComputeShader, name: str, value: bytes
) -> None:
    """Write a uniform of a program from its bytes."""
    uniform = program[name]
    assert isinstance(uniform, moderngl.Uniform)
    uniform.write(value)


class _DepthTexture:
    """A depth image of a stated format, which moderngl alone cannot ask for."""

    def __init__(self, device: Device, width: int, height: int, depth_bits: int) -> None:
        self.device = device
        self.name = ctypes.c_uint(0)
        device.gl["glCreateTextures"](_TEXTURE_2D, 1, ctypes.byref(self.name))
        device.gl["glTextureStorage2D"](
            self.name.value, 1, _DEPTH_FORMAT[depth_bits], width, height
        )

    def release(self) -> None:
        self.device.gl["glDeleteTextures"](1, ctypes.byref(self.name))


_shared: Device | None = None


def device() -> Device:
    """The process's GL context, made at the first call.

    Raises NothingToJudge where none can be made, RuntimeError from any thread but the one
    that made it (a GL context belongs to one thread).
    """
    global _shared
    if _shared is None:
        with _theirs_again():
            _shared = Device()
    if _shared.thread != threading.get_ident():
        raise RuntimeError("the OpenGL context belongs to another thread")
    if not _egl().eglGetCurrentContext():
        # Somebody else's was, and is gone.
        _shared.context.__enter__()  # type: ignore[no-untyped-call]
    return _shared


# What of a class with GL resources is called from outside.
_CALLED = frozenset(
    ("__init__", "prepare", "update", "cull", "cull_joint", "see", "item_buffer", "image", "close")
) | {
    # of an engine
    "frame",
    "pose",
    "pixels_differ",
    "describe",
}


class UsesDevice:
    """A base of classes whose calls use the context: it is current during each of them, whatever
    somebody else in the process has made current, and theirs is current again afterwards."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        for name in _CALLED & vars(cls).keys():
            setattr(cls, name, _with_our_context(vars(cls)[name]))


def _with_our_context(call: Callable[..., Any]) -> Callable[..., Any]:
    @wraps(call)
    def calling(*arguments: Any, **options: Any) -> Any:
        with device().current():
            return call(*arguments, **options)

    return calling
