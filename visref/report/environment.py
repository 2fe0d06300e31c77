"""The Jinja environment of every page."""

from __future__ import annotations

from functools import cache

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from visref.report import words
from visref.wording import legible


@cache
def page_environment(package: str) -> Environment:
    """Templates of a package, and the reports' own beside them: style sheet, table, and filters.
    Text is escaped; a name that a template misspells is an error."""
    environment = Environment(
        loader=ChoiceLoader([PackageLoader(package), PackageLoader("visref.report")]),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=_legible,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"count": words.count}
    return environment


def _legible(value: object) -> object:
    """What an expression of a template gives: a name's invisible characters are shown."""
    return legible(value) if isinstance(value, str) and not isinstance(value, Markup) else value
