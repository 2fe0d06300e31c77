#version 450
// Level 0 of a litmap's N-buffer.
layout(local_size_x = 16, local_size_y = 16) in;
layout(r32f, binding = 0) uniform writeonly image2DArray levels;
layout(std430, binding = 1) readonly buffer Distances { uint distance_of_lexel[]; };

void main() {
    ivec2 size = imageSize(levels).xy, at = ivec2(gl_GlobalInvocationID.xy);
    if (all(lessThan(at, size))) {
        float distance = uintBitsToFloat(distance_of_lexel[at.y * size.x + at.x]);
        imageStore(levels, ivec3(at, 0), vec4(distance));
    }
}
