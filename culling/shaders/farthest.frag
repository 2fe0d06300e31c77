#version 450
// The farthest depth of a texel's pixels: scale x scale of them, counted from the bottom left,
// fewer where the image ends.
uniform sampler2D depth;
uniform int scale;
uniform float copy_error;

void main() {
    ivec2 low = scale * ivec2(gl_FragCoord.xy);
    ivec2 high = min(low + scale, textureSize(depth, 0));
    float farthest = 0.0;
    for (int y = low.y; y < high.y; y++) {
        for (int x = low.x; x < high.x; x++) {
            farthest = max(farthest, texelFetch(depth, ivec2(x, y), 0).r);
        }
    }
    // Outward: too far a depth only draws too much.
    gl_FragDepth = min(1.0, farthest + copy_error);
}
