"""Every fault of the suite that loses objects."""

from __future__ import annotations

from tests.causes.cases import cases
from tests.causes.fault import Fault
from tests.causes.mutants import mutants
from tests.causes.reported import later, newest, recent, reported
from tests.causes.wrong import recordings, wrong

EVERY = (*mutants(), *wrong(), *recordings(), *cases(), *reported(), *later(), *recent(), *newest())
FAULTS: dict[str, Fault] = {fault.name: fault for fault in sorted(EVERY, key=str)}
