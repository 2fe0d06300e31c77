#version 450
// Which units to draw, and their draw commands, by a pyramid of depth.
layout(local_size_x = 64) in;
#include "box_commands.glsl"
#include "cones.glsl"
#include "hzb.glsl"
// What is drawn: what the last frame saw; what the last frame's pyramid does not hide from where
// its camera stood; or what this frame's does not hide, but for what is drawn already.
const int REMEMBERED = 0, BY_THE_LAST = 1, BY_THIS = 2;
uniform int step;
uniform bool past;  // whether there is a last frame
uniform int side;  // texels of a lookup
uniform bool cones;  // what faces away is not drawn
uniform bool spheres;  // a sphere around the box is looked up, and not the box

bool looked_up = false;

// x0, y0, x1, y1 of the sphere around the box, not clipped; `nearest` its least view depth, beyond
// the near plane. The greatest and least of x / w over a ball are where the plane x = t w touches it.
dvec4 sphere_window(double radius, dvec3 centre) {
    dvec4 result;
    for (int axis = 0; axis < 2; axis++) {
        double sign = axis == 0 ? 1.0lf : -1.0lf;
        dvec3 a = sign * clip_row(axis).xyz, b = clip_row(3).xyz;
        double x = dot(a, centre) + sign * clip_row(axis).w, w = dot(b, centre) + clip_row(3).w;
        double square = radius * radius;
        double p = w * w - square * dot(b, b), q = x * w - square * dot(a, b);
        double root = sqrt(max(q * q - p * (x * x - square * dot(a, a)), 0.0lf));
        // A ball that nearly reaches the eye's plane: anything may be before it.
        bool wide = p <= 1e-6lf * w * w;
        result[axis] = wide ? -1e300lf : 0.5lf * image[axis] * (1.0lf + (q - root) / p);
        result[axis + 2] = wide ? 1e300lf : 0.5lf * image[axis] * (1.0lf + (q + root) / p);
    }
    return result;
}

bool shows() {
    dvec3 centre = 0.5lf * (low + high);
    // Rounding adds less to a sphere's rectangle than a billionth of its size.
    double radius = 0.5lf * length(high - low) * (1.0lf + 1e-9lf);
    double nearest = spheres ? dot(depth_row.xyz, centre) - radius * length(depth_row.xyz)
                             : least(depth_row.xyz);
    if (nearest <= growth.w) {
        return true;
    }
    dvec4 window = spheres ? sphere_window(radius, centre) : box_window();
    dvec2 size = image.xy;
    if (step == BY_THE_LAST && (any(lessThan(window.xy, dvec2(0.0lf)))
                                || any(greaterThanEqual(window.zw, size)))) {
        // The last frame did not look there.
        return true;
    }
    ivec4 r = clipped(window);
    if (r.x > r.z || r.y > r.w) {
        return false;
    }
    looked_up = true;
    return window_depth(nearest) <= double(hzb_farthest(r, side));
}

void main() {
    uint unit = gl_GlobalInvocationID.x;
    if (unit >= units) {
        return;
    }
    bool draw = load_box(unit) && in_frustum() && !(cones && faces_away(unit));
    if (step == BY_THIS) {
        bool visible = draw && shows();
        draw = visible && drawn[unit] == 0u;
        seen[unit] = uint(visible) | uint(looked_up) << 1;
        drawn[unit] |= uint(draw) << 1;
    } else {
        if (step == REMEMBERED) {
            draw = draw && (seen[unit] & 1u) != 0u && can_occlude[unit] != 0u;
        } else if (draw && past) {
            view_base = 17;
            load_box(unit);
            draw = shows();
            view_base = 0;
        }
        drawn[unit] = uint(draw);
        // Where no second test follows, this is what was seen.
        seen[unit] = (step == BY_THE_LAST ? uint(draw) : seen[unit] & 1u) | uint(looked_up) << 1;
    }
    write_commands(unit, draw);
}
