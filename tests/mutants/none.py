"""No culling: nothing of it can be broken but that all is drawn."""

from __future__ import annotations

from tests.mutants.common import COMMON, common
from tests.mutants.harness import Suite, mutant, not_here
from visref_culling.baselines import NoCulling

SUITE = Suite({"U1": "something is left out after all"})
NONE = (SUITE.method("none", NoCulling),)

common("M5", of=NONE)
REST = [id for id in COMMON if id != "M5"]
not_here(" ".join(REST), NONE, "everything is drawn: nothing is projected, tested or asked")


@mutant("U1", of=NONE, caught_by="crowd")
class LastLeftOut:
    """The list of units ends one too early."""

    def in_frustum(self, view):
        return super().in_frustum(view)[:-1]
