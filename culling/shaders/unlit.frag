#version 450
// Marks what is seen from the side that the light does not meet.
uniform bool front_is_lit;  // whether the front faces drawn face the light, or the back faces
layout(location = 0) out float unlit;

void main() {
    unlit = gl_FrontFacing == front_is_lit ? 0.0 : 1.0;
}
