// Boxes against a camera, and the draw commands of those that are drawn, for compute shaders that
// decide about all units at once: a work item a unit. In double precision, step by step as
// `culling.gl.view` and `culling.boxes` have it.
struct Range { uint first, count; };
layout(std430, binding = 1) readonly buffer Bounds { double bounds_world[]; };
layout(std430, binding = 2) readonly buffer Occludes { uint can_occlude[]; };
layout(std430, binding = 3) buffer Seen { uint seen[]; };  // 1 visible, 2 looked up
layout(std430, binding = 4) buffer Drawn { uint drawn[]; };  // 1 before the test, 2 after it
layout(std430, binding = 5) readonly buffer Ranges { Range range_of[]; };
layout(std430, binding = 6) writeonly buffer Commands { uint commands[]; };
// 17 rows a camera: this frame's, and, for who needs it, the last frame's.
layout(std430, binding = 7) readonly buffer View { dvec4 view_rows[]; };
uniform uint units;

int view_base = 0;  // where the camera's rows begin
#define plane_row(k) view_rows[view_base + (k)]
#define clip_row(k) view_rows[view_base + 7 + (k)]
#define depth_row view_rows[view_base + 11]
#define eye view_rows[view_base + 12]  // and its greatest component
#define growth view_rows[view_base + 13]  // per distance, per distance or in all for a pixel, per coordinate; near
#define to_window view_rows[view_base + 14]  // slope, offset, shift; 1 for a perspective view
#define image view_rows[view_base + 15]  // width, height; planes; classes
#define look view_rows[view_base + 16]  // where it looks

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
        if (most(plane_row(k).xyz) + plane_row(k).w < 0.0lf) {
            return false;
        }
    }
    return true;
}

// Where a corner of a box wholly beyond the near plane falls, in pixels from the upper left.
dvec2 corner_window(int corner) {
    dvec4 at = dvec4((corner & 1) == 0 ? low.x : high.x, (corner & 2) == 0 ? low.y : high.y,
                     (corner & 4) == 0 ? low.z : high.z, 1.0lf);
    double w = dot(clip_row(3), at);
    dvec2 ndc = dvec2(dot(clip_row(0), at), -dot(clip_row(1), at)) / w;
    return 0.5lf * image.xy * (1.0lf + ndc);
}

// The pixels x0, y0, x1, y1 that a rectangle of the window touches, clipped to the image.
ivec4 clipped(dvec4 window) {
    dvec2 size = image.xy, first = window.xy, last = window.zw;
    first = floor(min(max(first, dvec2(0.0lf)), size));
    last = floor(max(min(last, size - 1.0lf), dvec2(-1.0lf)));
    return ivec4(ivec2(first), ivec2(last));
}

// The rectangle of the window that a box wholly beyond the near plane takes.
dvec4 box_window() {
    dvec4 window = dvec4(dvec2(1e300lf), dvec2(-1e300lf));
    for (int corner = 0; corner < 8; corner++) {
        dvec2 at = corner_window(corner);
        window = dvec4(min(window.xy, at), max(window.zw, at));
    }
    return window;
}

// The unit's box relative to the camera's eye, inflated; false for a unit without one.
bool load_box(uint unit) {
    for (int axis = 0; axis < 3; axis++) {
        low[axis] = bounds_world[6u * unit + uint(axis)] - eye[axis];
        high[axis] = bounds_world[6u * unit + 3u + uint(axis)] - eye[axis];
    }
    bool filled = low.x <= high.x;
    if (filled) {
        inflate();
    }
    return filled;
}

// Window depth of a view depth beyond the near plane.
double window_depth(double nearest) {
    double ndc = to_window.x * nearest + to_window.y;
    if (to_window.w > 0.0lf) {
        ndc /= nearest;
    }
    return clamp(0.5lf * (ndc - to_window.z) + 0.5lf, 0.0lf, 1.0lf);
}

// A slot a unit: which are drawn never changes the order.
void write_commands(uint unit, bool draw) {
    for (uint k = 0u; k < uint(image.w); k++) {
        uint slot = k * units + unit;
        commands[5u * slot] = draw ? range_of[slot].count : 0u;
        commands[5u * slot + 1u] = 1u;
        commands[5u * slot + 2u] = range_of[slot].first;
        commands[5u * slot + 3u] = 0u;
        commands[5u * slot + 4u] = 0u;
    }
}
