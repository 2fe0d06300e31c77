#version 450
// Which units to draw, and their draw commands: a work item a unit. `occluders`: those seen in the
// last frame. Else all that the N-buffer does not hide, but for the occluders, drawn already.
// In double precision, step by step as `culling.view` and `culling.rectangles` have it.
layout(local_size_x = 64) in;
struct Range { uint first, count; };
layout(std430, binding = 1) readonly buffer Bounds { double bounds_world[]; };
layout(std430, binding = 2) readonly buffer Occludes { uint can_occlude[]; };
layout(std430, binding = 3) buffer Seen { uint seen[]; };  // 1 visible, 2 looked up
layout(std430, binding = 4) buffer Drawn { uint drawn[]; };  // 1 as an occluder, 2 after the test
layout(std430, binding = 5) readonly buffer Ranges { Range range_of[]; };
layout(std430, binding = 6) writeonly buffer Commands { uint commands[]; };
layout(std430, binding = 7) readonly buffer View {
    dvec4 planes[7];
    dvec4 clip_rows[4];
    dvec4 depth_row;
    dvec4 eye;  // and its greatest component
    dvec4 growth;  // per distance, per distance or in all for a pixel, per coordinate; near
    dvec4 to_window;  // slope, offset, shift; 1 for a perspective view
    dvec4 image;  // width, height; planes; classes
};
#include "n_buffer.glsl"
uniform bool occluders;
uniform bool one_square;
uniform uint units;

bool looked_up = false;
dvec3 low, high;  // the unit's inflated box, relative to the eye

double least(dvec3 row) {
    return dot(row, dvec3(row.x > 0.0lf ? low.x : high.x, row.y > 0.0lf ? low.y : high.y,
                          row.z > 0.0lf ? low.z : high.z));
}

double most(dvec3 row) {
    return -least(-row);
}

void inflate() {
    dvec3 reach = max(abs(low), abs(high));
    dvec3 world = max(abs(low + eye.xyz), abs(high + eye.xyz));
    double distance = length(reach);
    double grow = growth.x * distance + growth.y * (to_window.w > 0.0lf ? distance : 1.0lf)
        + growth.z * (max(world.x, max(world.y, world.z)) + eye.w);
    low -= grow;
    high += grow;
}

bool in_frustum() {
    for (int k = 0; k < int(image.z); k++) {
        if (most(planes[k].xyz) + planes[k].w < 0.0lf) {
            return false;
        }
    }
    return true;
}

// x0, y0, x1, y1 of a box wholly beyond the near plane, clipped to the image.
ivec4 rectangle() {
    dvec2 size = image.xy, first = dvec2(1e300lf), last = dvec2(-1e300lf);
    for (int corner = 0; corner < 8; corner++) {
        dvec4 at = dvec4((corner & 1) == 0 ? low.x : high.x, (corner & 2) == 0 ? low.y : high.y,
                         (corner & 4) == 0 ? low.z : high.z, 1.0lf);
        double w = dot(clip_rows[3], at);
        dvec2 ndc = dvec2(dot(clip_rows[0], at), -dot(clip_rows[1], at)) / w;
        dvec2 window = 0.5lf * size * (1.0lf + ndc);
        first = min(first, window);
        last = max(last, window);
    }
    first = floor(min(max(first, dvec2(0.0lf)), size));
    last = floor(max(min(last, size - 1.0lf), dvec2(-1.0lf)));
    return ivec4(ivec2(first), ivec2(last));
}

bool shows() {
    double nearest = least(depth_row.xyz);
    if (nearest <= growth.w) {
        return true;
    }
    ivec4 r = rectangle();
    if (r.x > r.z || r.y > r.w) {
        return false;
    }
    double ndc = to_window.x * nearest + to_window.y;
    if (to_window.w > 0.0lf) {
        ndc /= nearest;
    }
    looked_up = true;
    double depth = clamp(0.5lf * (ndc - to_window.z) + 0.5lf, 0.0lf, 1.0lf);
    float farthest = one_square ? n_buffer_one(r) : n_buffer_four(r);
    return depth <= double(farthest);
}

void main() {
    uint unit = gl_GlobalInvocationID.x;
    if (unit >= units) {
        return;
    }
    for (int axis = 0; axis < 3; axis++) {
        low[axis] = bounds_world[6u * unit + uint(axis)] - eye[axis];
        high[axis] = bounds_world[6u * unit + 3u + uint(axis)] - eye[axis];
    }
    bool filled = low.x <= high.x, draw;
    if (filled) {
        inflate();
    }
    if (occluders) {
        draw = filled && (seen[unit] & 1u) != 0u && can_occlude[unit] != 0u && in_frustum();
        drawn[unit] = uint(draw);
    } else {
        bool visible = filled && in_frustum() && shows();
        draw = visible && drawn[unit] == 0u;
        seen[unit] = uint(visible) | uint(looked_up) << 1;
        drawn[unit] |= uint(draw) << 1;
    }
    // A slot a unit: which are drawn never changes the order.
    for (uint k = 0u; k < uint(image.w); k++) {
        uint slot = k * units + unit;
        commands[5u * slot] = draw ? range_of[slot].count : 0u;
        commands[5u * slot + 1u] = 1u;
        commands[5u * slot + 2u] = range_of[slot].first;
        commands[5u * slot + 3u] = 0u;
        commands[5u * slot + 4u] = 0u;
    }
}
