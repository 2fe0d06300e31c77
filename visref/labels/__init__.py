"""Labels for people who make data: every object of every frame, hidden ones too.

A truth says who owns which samples; a label says of each object besides how large it would be if it
stood alone, how much of that shows, and what hides the rest. `docs/labels.md` defines each column.
"""

from visref.labels.frame import FrameLabels, Labeller
from visref.labels.table import LabelTable

__all__ = ["FrameLabels", "LabelTable", "Labeller"]
