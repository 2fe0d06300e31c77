#version 450
// A box as one triangle strip of 14 vertices, wound counter-clockwise seen from outside.
// Vertex id = 16 * box + place in the strip, so that `first` picks a box and instances go on.
layout(std430, binding = 1) readonly buffer Boxes { float corner_relative[]; };
uniform mat4 clip_from_relative;
uniform float depth_shift_ndc;
uniform bool corners_only;  // drawn as 8 points
flat out int box;

// Which coordinate is the greater one (bit 0 x, bit 1 y, bit 2 z) at each place of the strip.
const int STRIP[14] = int[14](6, 7, 2, 3, 1, 7, 5, 6, 4, 2, 0, 1, 4, 5);

void main() {
    box = (gl_VertexID >> 4) + gl_InstanceID;
    int corner = corners_only ? gl_VertexID & 7 : STRIP[gl_VertexID & 15];
    vec3 at;
    for (int axis = 0; axis < 3; axis++) {
        at[axis] = corner_relative[6 * box + 3 * ((corner >> axis) & 1) + axis];
    }
    gl_Position = clip_from_relative * vec4(at, 1.0);
    // Towards the eye: too near a box only draws too much.
    gl_Position.z -= depth_shift_ndc * gl_Position.w;
}
