#version 450
// A triangle's id where its mask lets it be seen. The texture is read here and not by a sampler:
// the numbers are the file's, the filter's weights float32, on every driver. One lookup in the full
// image; a mip level would mix in texels from outside the pixel.
layout(std430, binding = 0) readonly buffer Triangles { int triangle_of_primitive[]; };
uniform usampler2D texels;  // row 0 at v = 0
uniform ivec2 wrap;         // per axis 0: repeat, 1: mirrored repeat, 2: clamp to edge
uniform bool nearest;
uniform dvec3 scale_factor_cutoff;
in vec2 uv;
in float alpha;
flat in vec2 range;
layout(location = 0) out int item;

int wrapped(int i, int size, int way) {
    if (way == 2) {
        return clamp(i, 0, size - 1);
    }
    int period = way == 1 ? 2 * size : size;
    // GLSL leaves % of negative numbers undefined.
    int place = i >= 0 ? i % period : period - 1 - (-1 - i) % period;
    return place < size ? place : period - 1 - place;
}

float texel(ivec2 at, ivec2 size) {
    ivec2 place = ivec2(wrapped(at.x, size.x, wrap.x), wrapped(at.y, size.y, wrap.y));
    return float(texelFetch(texels, place, 0).r);
}

float texture_alpha() {
    ivec2 size = textureSize(texels, 0);
    vec2 at = uv * vec2(size);
    if (nearest) {
        return texel(ivec2(floor(at)), size);
    }
    vec2 corner = floor(at - 0.5);
    vec2 weight = at - 0.5 - corner;
    ivec2 low = ivec2(corner);
    float a = texel(low, size), b = texel(low + ivec2(1, 0), size);
    float c = texel(low + ivec2(0, 1), size), d = texel(low + ivec2(1, 1), size);
    float mean = mix(mix(a, b, weight.x), mix(c, d, weight.x), weight.y);
    // Rounding does not take a mean out of its numbers.
    return clamp(mean, min(min(a, b), min(c, d)), max(max(a, b), max(c, d)));
}

void main() {
    double scale = scale_factor_cutoff.x, factor = scale_factor_cutoff.y;
    double cutoff = scale_factor_cutoff.z;
    // In this order and in float64, as `visref.masks.lookup` compares.
    double seen = double(texture_alpha()) / scale * factor * double(clamp(alpha, range.x, range.y));
    if (cutoff > 0.0lf && seen < cutoff) {
        discard;
    }
    item = triangle_of_primitive[gl_PrimitiveID];
}
