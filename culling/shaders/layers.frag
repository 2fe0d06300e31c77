#version 450
// Each fragment before the depth that is there, or level with it: sample, triangle, depth.
layout(early_fragment_tests) in;
layout(std430, binding = 0) readonly buffer Triangles { int triangle_of_primitive[]; };
layout(std430, binding = 1) buffer Count { uint count; };
layout(std430, binding = 2) writeonly buffer Hits { uint hits[]; };
uniform uint capacity;
uniform int first_primitive;
uniform ivec2 size;
layout(location = 0) out float scratch;

void main() {
    uint place = atomicAdd(count, 1u);
    if (place < capacity) {
        ivec2 pixel = ivec2(gl_FragCoord.xy);
        hits[3u * place] = uint((size.y - 1 - pixel.y) * size.x + pixel.x);
        hits[3u * place + 1u] = uint(triangle_of_primitive[first_primitive + gl_PrimitiveID]);
        hits[3u * place + 2u] = floatBitsToUint(gl_FragCoord.z);
    }
    scratch = 1.0;
}
