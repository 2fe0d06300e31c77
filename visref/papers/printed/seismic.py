"""The slides on seismic visualisation: what is printed there."""

from __future__ import annotations

from visref.papers.published import Printed, PrintedWords

PLACE = "Conclusions and Future Work"
WORKS = Printed(100, PLACE, "1:100 reduction works")
WORST_FILL = Printed(3, PLACE, "worst case: requires three times the fill rate")
STALLS = Printed(1, PLACE, "stalls graphics pipe only once per frame")

REDUCTION_WORKS = PrintedWords("reduction works", PLACE)
