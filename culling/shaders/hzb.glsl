// Looking up a depth pyramid (culling/hzb): the farthest depth over a rectangle of pixels, x0, y0,
// x1, y1 inclusive, y down, within the image and not empty. `side`: how many texels on a side of
// the finest level that is looked up, 2 or 1.
uniform sampler2D pyramid;

float hzb_farthest(ivec4 r, int side) {
    // Mesa's llvmpipe answers textureSize for neighbours of different levels alike.
    ivec2 size = textureSize(pyramid, 0), first, last;
    int level = 0;
    while (true) {
        ivec2 end = max(size >> level, 1) - 1;
        first = min(r.xy >> level, end);
        last = min(r.zw >> level, end);
        if (all(lessThan(last - first, ivec2(side)))) {
            break;
        }
        level++;
    }
    float depth = texelFetch(pyramid, first, level).x;
    depth = max(depth, texelFetch(pyramid, ivec2(last.x, first.y), level).x);
    depth = max(depth, texelFetch(pyramid, ivec2(first.x, last.y), level).x);
    return max(depth, texelFetch(pyramid, last, level).x);
}
