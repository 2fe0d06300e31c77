"""Shaders with a fault put in."""

from __future__ import annotations

from visref_culling.gl.device import shader_source


def edited(shader: str, *changes: tuple[str, str]) -> str:
    """A shader's text with each change made; every one has to apply."""
    text = shader_source(shader)
    for old, new in changes:
        assert old in text, f"{shader} no longer says {old!r}"
        text = text.replace(old, new)
    return text
