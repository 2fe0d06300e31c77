"""Is it the input? Whether a recording fits another path than the one it is judged by."""

from visref.alignment.hypotheses import HYPOTHESES, Cell, Hypothesis
from visref.alignment.search import Alignment, best_alignment
from visref.alignment.sentence import misaligned

__all__ = ["HYPOTHESES", "Alignment", "Cell", "Hypothesis", "best_alignment", "misaligned"]
