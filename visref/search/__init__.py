"""Finding a culler's faults, and the smallest scenes that show them.

`case` is a scene, its poses and its cameras as plain values, and as two files; `suspects` makes the
culler that is tried, `judging` tries it.
"""
