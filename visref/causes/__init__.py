"""Why things were missed: hypotheses about the culler, held against what it drew and lost.

No verdict rests on any of this. It is computed in float64 where the verdict is exact.
"""
