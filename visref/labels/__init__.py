"""Labels for people who make data: every object of every frame, hidden ones too.

A truth says who owns which samples; a label says of each object besides how large it would be if it
stood alone, how much of that shows, and what hides the rest. `docs/labels.md` defines each column.

`frame` makes them, from `silhouettes` (each object alone, by `kernels`) and `tally` (whose samples
those are); `table`, `images`, `coco` and `bop` write them; `writing` does so for a run.
"""
