"""A violation in JSON, as `expected.json` of a fault and `summary.json` of a search have it."""

from __future__ import annotations

import math
from typing import Any

from visref.run_folder.json_fields import Fields
from visref.search.judging import Kind, Violation


def violation_json(violation: Violation) -> dict[str, Any]:
    """In JSON values."""
    hidden = violation.kind is Kind.SUPERFLUOUS
    witness = {
        "view": violation.seen_in,
        "x": violation.x,
        "y": violation.y,
        "triangle": violation.triangle,
        "depth": None if hidden else violation.depth,
    }
    return {
        "kind": violation.kind.value,
        "object": violation.object,
        "object_name": violation.name,
        "frame": violation.frame,
        "view": violation.view,
        "samples": violation.samples,
        "owned": None if hidden else violation.owned,
        "unit": violation.unit if hidden else None,
        "cause": violation.cause,
        "other_causes": list(violation.others),
        "witness": witness if violation.x >= 0 else None,
    }


def read_violation(fields: Fields) -> Violation:
    """Raises InputError naming the place of anything wrong."""
    kind = Kind(fields.text("kind", among=tuple(Kind)))
    x, y, triangle, depth, seen_in = -1, -1, -1, math.nan, ""
    if not fields.is_null("witness"):
        witness = fields.inner("witness")
        x, y = witness.whole("x"), witness.whole("y")
        triangle = witness.whole("triangle", least=-1)
        depth = math.nan if witness.is_null("depth") else witness.number("depth")
        seen_in = witness.text("view")
    return Violation(
        kind=kind,
        frame=fields.whole("frame"),
        view=fields.text("view"),
        object=fields.whole("object"),
        name=fields.text("object_name"),
        samples=fields.whole("samples"),
        owned=0 if fields.is_null("owned") else fields.whole("owned", least=1),
        x=x,
        y=y,
        triangle=triangle,
        depth=depth,
        seen_in=seen_in,
        unit=-1 if fields.is_null("unit") else fields.whole("unit"),
        cause=fields.text("cause"),
        others=fields.text_list("other_causes"),
    )
