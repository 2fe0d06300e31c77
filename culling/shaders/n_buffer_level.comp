#version 450
// One level of an N-buffer from the level below: the join of the four pixels that are half a
// square apart. A pixel outside the image does not count.
layout(local_size_x = 16, local_size_y = 16) in;
layout(r32f, binding = 0) uniform readonly image2DArray below;
layout(r32f, binding = 1) uniform writeonly image2DArray above;
uniform int level;
uniform bool farthest;

float joined(float depth, ivec2 at, ivec2 size) {
    if (any(greaterThanEqual(at, size))) {
        return depth;
    }
    float other = imageLoad(below, ivec3(at, level - 1)).x;
    return farthest ? max(depth, other) : min(depth, other);
}

void main() {
    ivec2 size = imageSize(above).xy, at = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(at, size))) {
        return;
    }
    int half_side = 1 << (level - 1);
    float depth = imageLoad(below, ivec3(at, level - 1)).x;
    depth = joined(depth, at + ivec2(half_side, 0), size);
    depth = joined(depth, at + ivec2(0, half_side), size);
    depth = joined(depth, at + ivec2(half_side, half_side), size);
    imageStore(above, ivec3(at, level), vec4(depth));
}
