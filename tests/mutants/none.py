"""No culling: nothing of it can be broken but that all is drawn."""

from __future__ import annotations

from tests.mutants.common import COMMON
from tests.mutants.harness import Suite, mutant, not_here
from visref_culling.baselines import NoCulling

SUITE = Suite({"U1": "something is left out after all"})
NONE = (SUITE.method("none", NoCulling),)

not_here(" ".join(COMMON), NONE, "everything is drawn: nothing is projected, tested or asked")


@mutant("U1", of=NONE, caught_by="crowd")
class LastLeftOut:
    """The list of units ends one too early."""

    def in_frustum(self, view):
        return super().in_frustum(view)[:-1]
