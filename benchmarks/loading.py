"""A process of its own that loads a scene: `python loading.py SCENE [build]`.

It prints JSON: seconds of processor time, the objects and triangles, and the most memory that
loading took beyond what imports had taken. It needs few names of visref, so that another
checkout's Python may run it.
"""

from __future__ import annotations

import json
import resource
import sys
import time

import numpy as np

try:
    from visref import load_scene
except ImportError:  # As it was called before there were public names.
    from visref.loading import load_scene
from visref.engines.embree import EmbreeEngine
from visref.scene import Scene


def peak_bytes() -> int:
    # Linux counts in KiB, and macOS in bytes.
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def main() -> None:
    points = np.zeros((3, 3), np.float32)
    points[1, 0] = points[2, 1] = 1.0
    # What is imported, compiled or read with the first scene does not count.
    EmbreeEngine(Scene.from_objects([("first", points, np.array([[0, 1, 2]]))])).close()
    before, start = peak_bytes(), time.process_time()
    scene = load_scene(sys.argv[1])
    told = {
        "load_s": time.process_time() - start,
        "load_bytes": peak_bytes() - before,
        "objects": scene.object_count,
        "triangles": scene.triangle_count,
    }
    if "build" in sys.argv[2:]:
        start = time.process_time()
        EmbreeEngine(scene).close()
        told["build_s"] = time.process_time() - start
        told["build_bytes"] = peak_bytes() - before
    print(json.dumps(told))


if __name__ == "__main__":
    main()
