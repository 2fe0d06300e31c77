#version 450
// A masked triangle on its way to `solid.frag`: what does not change over it. The vertex is number
// 3 * (row in the tables) + corner.
layout(std430, binding = 4) readonly buffer Corners { float world_of[]; };  // 9 a triangle
layout(std430, binding = 5) readonly buffer Coordinates { double uv_of[]; };  // 6 a triangle
uniform vec3 eye_high;
uniform vec3 eye_low;
uniform mat4 clip_from_relative;
#include "clip_plane.glsl"
uniform dvec3 eye, forward, right_step, up_step;
uniform bool perspective;
// Upper bounds: of the length (sum of components) of a ray's direction, and of how far from the
// eye it starts.
uniform dvec2 way_side;
invariant gl_Position;
out float gl_ClipDistance[1];
flat out int row;
// Linear forms in (1, a, b): texture coordinates less the first corner's, times `below`.
flat out dvec3 u_form, v_form, below_form;
flat out dvec2 first_uv, uv_reach;
flat out double error, least_below;

double size(dvec3 x) {
    return abs(x.x) + abs(x.y) + abs(x.z);
}

// (v_j - s) x (v_k - s) . d for the ray e + s + t d, as a form.
dvec3 form(dvec3 vj, dvec3 vk) {
    dvec3 m = cross(vj, vk);
    if (perspective) {
        return dvec3(dot(m, forward), dot(m, right_step), dot(m, up_step));
    }
    dvec3 aside = cross(forward, vk - vj);
    return dvec3(dot(m, forward), dot(aside, right_step), dot(aside, up_step));
}

void main() {
    row = gl_VertexID / 3;
    vec3 world[3];
    dvec2 uv[3];
    for (int i = 0; i < 3; i++) {
        int at = 9 * row + 3 * i;
        world[i] = vec3(world_of[at], world_of[at + 1], world_of[at + 2]);
        uv[i] = dvec2(uv_of[6 * row + 2 * i], uv_of[6 * row + 2 * i + 1]);
    }
    // As in mesh.vert, to the bit.
    vec3 vertex_world = world[gl_VertexID % 3];
    precise vec3 vertex_relative = (vertex_world - eye_high) - eye_low;
    gl_Position = clip_from_relative * vec4(vertex_relative, 1.0);
    gl_ClipDistance[0] = kept_by(vertex_relative);

    dvec3 v0 = dvec3(world[0]) - eye, v1 = dvec3(world[1]) - eye, v2 = dvec3(world[2]) - eye;
    dvec3 e1 = dvec3(world[1]) - dvec3(world[0]), e2 = dvec3(world[2]) - dvec3(world[0]);
    dvec3 n = cross(e1, e2);
    dvec3 form1 = form(v2, v0), form2 = form(v0, v1);
    dvec2 d1 = uv[1] - uv[0], d2 = uv[2] - uv[0];
    u_form = d1.x * form1 + d2.x * form2;
    v_form = d1.y * form1 + d2.y * form2;
    below_form = dvec3(dot(n, forward), 0.0lf, 0.0lf);
    if (perspective) {
        below_form = dvec3(dot(n, forward), dot(n, right_step), dot(n, up_step));
    }
    first_uv = uv[0];
    uv_reach = abs(d1) + abs(d2);
    double reach = max(max(size(v0), size(v1)), size(v2)) + way_side.y;
    error = (1.0lf / 67108864.0lf) * reach * reach * way_side.x;
    double room = size(e1) * size(e2);
    double widest = max(max(abs(n.x), abs(n.y)), abs(n.z));
    // A triangle so thin that its plane is badly known is never certain.
    least_below = widest > room / 1024.0lf ? room * way_side.x / 1048576.0lf : 1e300lf;
}
