"""A judgement from NumPy arrays: three squares, two cameras, two cullers, a run folder."""

import numpy as np

from visref import Camera, CameraPath, Inputs, Scene, judge_to_folder, look_at, make_culler

square = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32)
faces = np.array([[0, 1, 2], [0, 2, 3]])
places = {"front": (0, 0, 0), "behind": (0, 0, -1), "beside": (4, 0, 0)}
scene = Scene.from_objects([(name, square + place, faces) for name, place in places.items()])
poses = [look_at((x, 0, 4), (x, 0, 0)) for x in (0, 3)]
path = CameraPath(tuple(Camera(pose, 320, 240, near=0.1, yfov=0.8) for pose in poses))
cullers = [(name, make_culler(name)) for name in ("none", "frustum")]
inputs = Inputs(scene, path, range(len(path)), engine="exact")
outcome = judge_to_folder(inputs, cullers, "run")
for judged in outcome.cullers:
    sums = judged.totals
    print(f"{judged.spec}: {sums.drawn} drawn, {sums.visible} visible, {judged.status}")
