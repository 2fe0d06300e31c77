#version 450
// Depths from a texture, first row at the bottom.
uniform sampler2D depth;

void main() {
    gl_FragDepth = texelFetch(depth, ivec2(gl_FragCoord.xy), 0).r;
}
