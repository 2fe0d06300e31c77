"""Ask the depth buffer whether meshes would show: an occlusion query for each unit's triangles.

The triangles are those that `Geometry` draws, by the same shader, so where a unit's own depth is
in the buffer its fragments are equal to it and pass. All queries go out, then all answers come
in: one wait. Depth and image are read only.
"""

from __future__ import annotations

import numpy as np

from visref.culler import QueryStats
from visref.scene import Int64
from visref_culling.gl.device import State, Target
from visref_culling.gl.geometry import Geometry, view_uniforms
from visref_culling.gl.view import View
from visref_culling.queries.occlusion_query import StateHook


def ask_meshes(
    geometry: Geometry,
    view: View,
    target: Target,
    unit_ids: Int64,
    stats: QueryStats,
    *,
    state_hook: StateHook = lambda state: state,
) -> Int64:
    """Samples of each unit, (k,) int64, that are not behind the target's depth. `state_hook`
    sees the GL state before it is set."""
    if not len(unit_ids):
        return np.zeros(0, np.int64)
    samples, changes = _samples(geometry, view, target, unit_ids, "<=", state_hook)
    stats.queries = (stats.queries or 0) + len(unit_ids)
    stats.queries_passed = (stats.queries_passed or 0) + int(np.count_nonzero(samples))
    stats.batches = (stats.batches or 0) + 1
    stats.state_changes = (stats.state_changes or 0) + changes
    return samples


def mesh_fragments(geometry: Geometry, view: View, target: Target, unit_ids: Int64) -> Int64:
    """Samples that each unit covers, (k,) int64, hidden ones included. Beside a frame, not in
    it: nothing is counted."""
    return _samples(geometry, view, target, unit_ids, "", lambda state: state)[0]


def _samples(
    geometry: Geometry,
    view: View,
    target: Target,
    unit_ids: Int64,
    depth_func: str,
    state_hook: StateHook,
) -> tuple[Int64, int]:
    device = geometry.device
    view_uniforms(geometry.program, view)
    base = State(
        target.framebuffer,
        geometry.program,
        depth_func,
        depth_write=False,
        colour_write=False,
        cut=view.is_cut,
    )
    pool = device.queries(len(unit_ids))
    changes = 0
    for query, unit in zip(pool, unit_ids.tolist(), strict=False):
        with query:
            for part in geometry.classes:
                count = int(part.count[unit])
                if count:
                    state = base._replace(cull_back_faces=part.one_sided)
                    changes += device.apply(state_hook(state))
                    part.vertex_array.render(vertices=count, first=int(part.first[unit]))
    # Reading a result waits until the query has finished.
    samples = [query.samples for query, _ in zip(pool, unit_ids, strict=False)]
    return np.array(samples, np.int64), changes
