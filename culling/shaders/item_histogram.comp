#version 450
// How often each id stands in the given tiles of an item buffer. A work group a tile.
layout(local_size_x = 16, local_size_y = 16) in;
layout(std430, binding = 1) readonly buffer Tiles { ivec2 corner_of_tile[]; };
layout(std430, binding = 2) buffer Histogram { uint pixels_of_id[]; };
layout(std430, binding = 3) buffer Hits { uint pixels_of_tile[]; };
uniform sampler2D items;
uniform int tile;
uniform int ids;  // 1 ... ids; 0 is the background

void main() {
    ivec2 corner = corner_of_tile[gl_WorkGroupID.x], end = min(corner + tile, textureSize(items, 0));
    uint hits = 0u;
    for (int y = corner.y + int(gl_LocalInvocationID.y); y < end.y; y += 16) {
        for (int x = corner.x + int(gl_LocalInvocationID.x); x < end.x; x += 16) {
            uvec4 bytes = uvec4(round(texelFetch(items, ivec2(x, y), 0) * 255.0));
            uint id = bytes.r | bytes.g << 8 | bytes.b << 16 | bytes.a << 24;
            if (id != 0u && id <= uint(ids)) {
                atomicAdd(pixels_of_id[id], 1u);
                hits++;
            }
        }
    }
    if (hits > 0u) {
        atomicAdd(pixels_of_tile[gl_WorkGroupID.x], hits);
    }
}
