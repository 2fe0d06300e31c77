#version 450
// The position as in mesh.vert, to the bit, so that equal corners have equal depths.
layout(location = 0) in vec3 vertex_world;
layout(location = 1) in vec2 vertex_uv;
layout(location = 2) in float vertex_alpha;
layout(location = 3) in vec2 alpha_range;
uniform vec3 eye_high;
uniform vec3 eye_low;
uniform mat4 clip_from_relative;
#include "clip_plane.glsl"
invariant gl_Position;
out float gl_ClipDistance[1];
out vec2 uv;
out float alpha;
flat out vec2 range;

void main() {
    precise vec3 vertex_relative = (vertex_world - eye_high) - eye_low;
    gl_Position = clip_from_relative * vec4(vertex_relative, 1.0);
    gl_ClipDistance[0] = kept_by(vertex_relative);
    uv = vertex_uv;
    alpha = vertex_alpha;
    range = alpha_range;
}
