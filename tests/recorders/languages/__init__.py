"""Programs that make the calls, in each language that has a recorder. A program prints a line per
recording: `ok`, or what `close` told."""

import pytest

from tests.recorders.languages.base import Language
from tests.recorders.languages.c import build_c, build_cpp
from tests.recorders.languages.csharp import build_csharp
from tests.recorders.languages.godot import build_gdscript
from tests.recorders.languages.rust import build_rust
from tests.recorders.languages.scripts import build_javascript, build_python

LANGUAGES = (
    Language("c", ("gcc",), build_c),
    Language("c++", ("g++",), build_cpp),
    Language("javascript", ("node",), build_javascript),
    Language("python", (), build_python),
    Language("rust", ("rustc",), build_rust),
    Language("csharp", ("mcs", "mono"), build_csharp),
    Language("gdscript", ("godot4|godot3-server",), build_gdscript),
)
QUICK = ("c", "javascript", "python")


def each(*names: str) -> pytest.MarkDecorator:
    """A test for each language of these names, or of all; what compiles long is slow."""
    chosen = [
        pytest.param(
            one,
            marks=[pytest.mark.needs(*one.needs)] + [pytest.mark.slow] * (one.name not in QUICK),
            id=one.name,
        )
        for one in LANGUAGES
        if not names or one.name in names
    ]
    return pytest.mark.parametrize("language", chosen)
