#version 450
// A sprite's square, whole pixels at one depth; none for a hidden one.
layout(points) in;
layout(triangle_strip, max_vertices = 4) out;
uniform ivec2 image_px;
uniform int side_px;
in Sprite {
    ivec2 corner_px;
    float depth_ndc;
    bool drawn;
} sprite[];

void main() {
    if (!sprite[0].drawn) {
        return;
    }
    for (int k = 0; k < 4; k++) {
        vec2 at = vec2(sprite[0].corner_px + side_px * ivec2(k & 1, k >> 1)) / vec2(image_px);
        gl_Position = vec4(2.0 * at.x - 1.0, 1.0 - 2.0 * at.y, sprite[0].depth_ndc, 1.0);
        EmitVertex();
    }
    EndPrimitive();
}
