#version 450
// A rectangle of pixels at one depth, as a strip of four vertices.
uniform vec4 sides_ndc;  // left, bottom, right, top
uniform float depth_ndc;

void main() {
    float x = (gl_VertexID & 1) == 0 ? sides_ndc.x : sides_ndc.z;
    float y = (gl_VertexID & 2) == 0 ? sides_ndc.y : sides_ndc.w;
    gl_Position = vec4(x, y, depth_ndc, 1.0);
}
