// Looking up an N-buffer (culling/n_buffer): the join over a rectangle of pixels, x0, y0, x1, y1
// inclusive, y down, clipped to the image and not empty. The same squares as cover.py's.
// Who defines N_BUFFER_COUNTED has a buffer block with a uint `n_buffer_lookups`, which counts.
uniform sampler2DArray n_buffer;
uniform bool n_buffer_farthest;

float n_buffer_join(float a, float b) {
    return n_buffer_farthest ? max(a, b) : min(a, b);
}

float n_buffer_square(ivec2 start, int level) {
#ifdef N_BUFFER_COUNTED
    atomicAdd(n_buffer_lookups, 1u);
#endif
    return texelFetch(n_buffer, ivec3(start, level), 0).x;
}

// The smallest i with 2^i >= n.
int n_buffer_level(int n) {
    return n <= 1 ? 0 : findMSB(n - 1) + 1;
}

float n_buffer_one(ivec4 r) {
    ivec2 size = r.zw - r.xy + 1;
    return n_buffer_square(r.xy, n_buffer_level(max(size.x, size.y)));
}

float n_buffer_four(ivec4 r) {
    ivec2 size = r.zw - r.xy + 1;
    int level = max(n_buffer_level(max(size.x, size.y)) - 1, 0);
    int half_side = (1 << level) >> 1;
    bool row = size.y <= half_side, column = size.x <= half_side;
    level -= int(row || column);
    int side = 1 << level;
    ivec2 last = max(r.zw - side + 1, r.xy);
    float depth = n_buffer_square(r.xy, level);
    for (int k = 1; k < 4; k++) {
        ivec2 start;
        if (row) {
            start = ivec2(min(r.x + k * side, last.x), r.y);
        } else if (column) {
            start = ivec2(r.x, min(r.y + k * side, last.y));
        } else {
            start = ivec2((k & 1) == 0 ? r.x : last.x, (k & 2) == 0 ? r.y : last.y);
        }
        depth = n_buffer_join(depth, n_buffer_square(start, level));
    }
    return depth;
}
