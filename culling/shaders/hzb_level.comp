#version 450
// One level of a depth pyramid from the level below: the farthest of 2 x 2 texels. The last texel of
// a row or column takes all that is left, three of an odd number.
layout(local_size_x = 16, local_size_y = 16) in;
layout(r32f, binding = 0) uniform readonly image2D below;
layout(r32f, binding = 1) uniform writeonly image2D above;

void main() {
    ivec2 size = imageSize(above), at = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(at, size))) {
        return;
    }
    ivec2 source = imageSize(below), first = 2 * at, last = min(first + 1, source - 1);
    last.x = at.x == size.x - 1 ? source.x - 1 : last.x;
    last.y = at.y == size.y - 1 ? source.y - 1 : last.y;
    float depth = 0.0;
    for (int y = first.y; y <= last.y; y++) {
        for (int x = first.x; x <= last.x; x++) {
            depth = max(depth, imageLoad(below, ivec2(x, y)).x);
        }
    }
    imageStore(above, at, vec4(depth));
}
