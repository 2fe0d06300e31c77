"""A run on a cluster of machines, by Dask: stretches of frames as tasks, and one run folder.

A task is a function of what was asked and of which frames: it judges them as any worker does
(`visref.shares`) and returns the files of a part, which are kept (`visref.kept`) and merged
(`visref.merging`) like all others: the bytes are those of one process.
"""

from visref.cluster.running import judging_on_dask
from visref.cluster.scheduler import LOCAL, connected

__all__ = ["LOCAL", "connected", "judging_on_dask"]
