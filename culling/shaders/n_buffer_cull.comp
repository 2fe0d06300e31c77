#version 450
// Which units to draw, and their draw commands: a work item a unit. `occluders`: those seen in the
// last frame. Else all that the N-buffer does not hide, but for the occluders, drawn already.
layout(local_size_x = 64) in;
#include "box_commands.glsl"
#include "n_buffer.glsl"
uniform bool occluders;
uniform bool one_square;

bool looked_up = false;

bool shows() {
    double nearest = least(depth_row.xyz);
    if (nearest <= growth.w) {
        return true;
    }
    ivec4 r = clipped(box_window());
    if (r.x > r.z || r.y > r.w) {
        return false;
    }
    looked_up = true;
    double depth = window_depth(nearest);
    float farthest = one_square ? n_buffer_one(r) : n_buffer_four(r);
    return depth <= double(farthest);
}

void main() {
    uint unit = gl_GlobalInvocationID.x;
    if (unit >= units) {
        return;
    }
    bool filled = load_box(unit), draw;
    if (occluders) {
        draw = filled && (seen[unit] & 1u) != 0u && can_occlude[unit] != 0u && in_frustum();
        drawn[unit] = uint(draw);
    } else {
        bool visible = filled && in_frustum() && shows();
        draw = visible && drawn[unit] == 0u;
        seen[unit] = uint(visible) | uint(looked_up) << 1;
        drawn[unit] |= uint(draw) << 1;
    }
    write_commands(unit, draw);
}
