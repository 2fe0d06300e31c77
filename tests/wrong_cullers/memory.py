"""Wrong in what is kept from the frame before."""

from __future__ import annotations

import numpy as np

from tests.wrong_cullers import registry
from tests.wrong_cullers.depth import Depth
from tests.wrong_cullers.frustum import Frustum
from visref.culler import DrawnSet

wrong = registry.wrong("memory")


@wrong
class LastAnswer(Depth):
    """What was visible in the frame before is drawn: an answer that comes a frame late."""

    last = None

    def cull(self, camera):
        found = super().cull(camera)
        last, self.last = self.last, found
        return found if last is None else last


@wrong
class LastDepth(Depth):
    """Boxes are tested by this camera against the frame before's depth."""

    def read_back(self, camera, depth):
        usable = self.last_depth is not None and self.last_depth.shape == depth.shape
        return self.last_depth if usable else depth


@wrong
class LastFrustum(Frustum):
    """The view of the frame before is tested."""

    last = None

    def believed(self, camera):
        last, self.last = self.last, camera
        return last or camera


@wrong
class FirstAnswer(Depth):
    """The first frame's answer serves for all."""

    first = None

    def cull(self, camera):
        self.first = self.first or super().cull(camera)
        return self.first


@wrong
class CutIgnored(Depth):
    """Every second frame repeats the answer before it, a cut or no."""

    asked, count = None, 0

    def cull(self, camera):
        self.count += 1
        if self.count % 2:
            self.asked = super().cull(camera)
        return self.asked


@wrong
class CutAloneHeeded(Depth):
    """The answer is renewed at a cut only."""

    asked = None

    def cull(self, camera):
        if self.asked is None or camera.cut:
            self.asked = super().cull(camera)
        return self.asked


@wrong
class HiddenStaysHidden(Depth):
    """What was once hidden is not asked about again in the frame after."""

    hidden = np.zeros(0, np.int32)

    def cull(self, camera):
        found = super().cull(camera)
        every = np.flatnonzero(np.diff(self.scene.object_offsets))
        drawn = np.setdiff1d(found.unit_ids, self.hidden).astype(np.int32)
        self.hidden = np.setdiff1d(every, drawn)
        return DrawnSet(drawn)
