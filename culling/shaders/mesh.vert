#version 450
// vertex - eye is one correctly rounded subtraction, so its error is relative to the distance
// from the eye and not to the world's origin; `precise` forbids to reorder it.
layout(location = 0) in vec3 vertex_world;
uniform vec3 eye_high;
uniform vec3 eye_low;
uniform mat4 clip_from_relative;
#include "clip_plane.glsl"
invariant gl_Position;
out float gl_ClipDistance[1];

void main() {
    precise vec3 vertex_relative = (vertex_world - eye_high) - eye_low;
    gl_Position = clip_from_relative * vec4(vertex_relative, 1.0);
    gl_ClipDistance[0] = kept_by(vertex_relative);
}
