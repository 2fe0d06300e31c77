"""The GL context and its state."""

import threading

import moderngl
import pytest

from visref.errors import InputError, NothingToJudge
from visref_culling.gl import device as module
from visref_culling.gl.device import MAX_TARGETS, Device, State, device

pytestmark = pytest.mark.gl


def test_report_names_the_renderer_and_a_24_bit_depth_buffer():
    report = device().report()
    assert report["renderer"]
    assert report["depth bits"] == 24
    assert report["sub-pixel bits"] >= 4  # OpenGL's least


def test_context_is_one_for_the_process():
    assert device() is device()


def test_context_is_refused_to_another_thread():
    device()
    caught = []

    def ask():
        try:
            device()
        except RuntimeError as error:
            caught.append(str(error))

    thread = threading.Thread(target=ask)
    thread.start()
    thread.join()
    assert caught == ["the OpenGL context belongs to another thread"]


def test_no_context_is_nothing_to_judge_in_one_line(monkeypatch):
    def refuse(name):
        raise ImportError("libEGL.so.1: cannot open shared object file")

    monkeypatch.setattr(module.glcontext, "get_backend_by_name", refuse)
    with pytest.raises(NothingToJudge, match=r"libEGL\.so\.1.*install a driver") as caught:
        Device()
    assert "\n" not in str(caught.value)


def test_targets_are_reused_by_size_and_never_more_than_a_few():
    gl = device()
    first = gl.target(8, 9)
    assert gl.target(8, 9) is first
    assert gl.target(8, 9, 32) is not first
    for width in range(10, 10 + 2 * MAX_TARGETS):
        gl.target(width, 3)
    assert len(gl._targets) == MAX_TARGETS
    assert gl.target(8, 9) is not first


def test_image_larger_than_gl_allows_is_bad_input():
    with pytest.raises(InputError, match="give at most"):
        device().target(device().max_side + 1, 1)


def test_depth_comes_back_top_row_first_in_either_format():
    gl = device()
    program = gl.program("mesh.vert", "plain.frag")
    for bits in (24, 32):
        target = gl.target(4, 3, bits)
        gl.clear(State(target.framebuffer, program))
        target.framebuffer.clear(depth=0.25, viewport=(0, 2, 4, 1))  # GL's top row
        depth = target.read_depth()
        assert depth.shape == (3, 4)
        assert abs(depth[0] - 0.25).max() <= 2.0**-24
        assert (depth[1:] == 1.0).all()


def test_apply_sets_and_counts_only_what_differs():
    gl = device()
    program = gl.program("mesh.vert", "plain.frag")
    state = State(gl.target(4, 4).framebuffer, program)
    gl.apply(state)
    assert gl.apply(state) == 0
    quiet = state._replace(depth_write=False, colour_write=False, clamp_depth=True)
    assert gl.apply(quiet) == 3
    assert not state.framebuffer.depth_mask
    assert gl.apply(state) == 3
    assert state.framebuffer.depth_mask
    assert state.framebuffer.color_mask == (True,) * 4
    assert gl.context.error == "GL_NO_ERROR"


def test_broken_shader_is_loud(tmp_path, monkeypatch):
    (tmp_path / "shaders").mkdir()
    (tmp_path / "shaders" / "bad.vert").write_text("#version 450\nnonsense")
    (tmp_path / "shaders" / "bad.frag").write_text("#version 450\nvoid main() {}")
    monkeypatch.setattr(module, "files", lambda package: tmp_path)
    with pytest.raises(moderngl.Error):
        device().program("bad.vert", "bad.frag")
