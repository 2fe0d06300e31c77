#version 450
// Level 0 of a depth pyramid: the depth buffer as it is, with the first row at the top.
layout(local_size_x = 16, local_size_y = 16) in;
layout(r32f, binding = 0) uniform writeonly image2D base;
uniform sampler2D depth_buffer;

void main() {
    ivec2 size = imageSize(base), at = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(at, size))) {
        return;
    }
    float depth = texelFetch(depth_buffer, ivec2(at.x, size.y - 1 - at.y), 0).x;
    imageStore(base, at, vec4(depth));
}
