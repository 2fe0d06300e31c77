"""The compiled loop over the vertices of a skin, of which NumPy would make dozens of passes."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from visref.compiled import njit


@njit(error_model="numpy")
def blend(
    points: NDArray[Any],
    joints: NDArray[Any],
    weights: NDArray[Any],
    matrices: NDArray[Any],
    result: NDArray[Any],
) -> None:
    """Linear blend skinning: the matrices (j, 4, 4) of each vertex's joints (v, k), added with
    their weights (v, k) and divided by the weights' sum, move its point (v, 3) to `result` (v, 3).

    Float64 throughout; each sum goes from the first joint to the last, and from x to z."""
    for vertex in range(len(points)):
        total = 0.0
        for k in range(joints.shape[1]):
            total += weights[vertex, k]
        for row in range(3):
            a, b, c, d = 0.0, 0.0, 0.0, 0.0
            for k in range(joints.shape[1]):
                weight, joint = weights[vertex, k], joints[vertex, k]
                a += weight * matrices[joint, row, 0]
                b += weight * matrices[joint, row, 1]
                c += weight * matrices[joint, row, 2]
                d += weight * matrices[joint, row, 3]
            moved = d / total + a / total * points[vertex, 0]
            moved += b / total * points[vertex, 1]
            moved += c / total * points[vertex, 2]
            result[vertex, row] = moved
