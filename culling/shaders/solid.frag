#version 450
// A masked triangle's depth, only where its mask is certainly solid.
//
// Certain is what `visref.masks.hits.state_at` calls SOLID at the pixel's sample, so that whatever
// is hidden behind is hidden by a triangle that the truth takes for solid too. This is so because
//
// 1. The box looked up here holds the one looked up there. Both are the texture coordinates at the
//    sample, plus and minus their greatest change over the corners of the doubled footprint. Here
//    they are quotients of forms linear in a and b (Cramer's rule for the ray and the plane), so the
//    corners are exact but for rounding. With u = 2^-53, S the farthest corner's distance, w the
//    direction's length: a form errs by at most 2^6 u S^2 w, and `below` relatively by at most
//    2^-20 / (16 u) <= 2^-29, as `least_below` sees to; there, the hit errs by at most
//    2^17 u S^2 w / below, as the triangle is not thinner than 1 : 2^10. `error` is 2^-26 S^2 w,
//    more than all these together; it is added once for the centre and once for the corners.
// 2. The box is widened as there: by half a texel, but not for a nearest sampler; and for that one
//    it shrinks to the point, but for `error`, only where this larger box is under a texel, too.
// 3. What is looked up are the least alphas of whole blocks, rounded down to 8 bits, times the
//    triangle's least vertex alpha: never more than the least alpha there.
//
// Where any of this does not hold, and where a corner's ray is level with the plane or meets it
// behind the eye, nothing is written, which only draws more.
layout(std430, binding = 6) readonly buffer Tables { int table[]; };
layout(std430, binding = 7) readonly buffer Least { uint bytes_of_word[]; };
uniform dvec4 samples;  // a at the left column, its step; b at the bottom row, its step
uniform int textures_at, levels_at;
// Colour is not written; but where a shader that discards has none, llvmpipe (Mesa 22.3) spoils it.
layout(location = 0) out float colour;
flat in int row;
flat in dvec3 u_form, v_form, below_form;
flat in dvec2 first_uv, uv_reach;
flat in double error, least_below;

const int MOST = 24;  // blocks looked up, about

int alpha_at(int place) {
    return int((bytes_of_word[place >> 2] >> (8 * (place & 3))) & 255u);
}

// As `visref.masks.lookup.texel_intervals`: two intervals of texels, the second may be empty.
ivec4 texels(int low, int high, int size, int wrap) {
    if (wrap == 2) {
        return ivec4(clamp(low, 0, size - 1), clamp(high, 0, size - 1), 0, -1);
    }
    int period = wrap == 1 ? 2 * size : size;
    if (high - low + 1 >= period) {
        return ivec4(0, size - 1, 0, -1);
    }
    // GLSL leaves % of negative numbers undefined.
    int first = low >= 0 ? low % period : period - 1 - (-1 - low) % period;
    int last = first + high - low;
    if (wrap == 0) {
        return last < size ? ivec4(first, last, 0, -1) : ivec4(first, size - 1, 0, last - size);
    }
    int from_first = first < size ? first : period - 1 - first;
    int turned = last % period;
    int from_last = turned < size ? turned : period - 1 - turned;
    int least = min(from_first, from_last), greatest = max(from_first, from_last);
    if ((first <= size - 1 && last >= size - 1) || last >= 3 * size - 1) {
        greatest = size - 1;
    }
    if (first <= 2 * size - 1 && last >= 2 * size - 1) {
        least = 0;
    }
    return ivec4(least, greatest, 0, -1);
}

int blocks(ivec4 spans, int k) {
    int count = (spans.y >> k) - (spans.x >> k) + 1;
    return spans.w < spans.z ? count : count + (spans.w >> k) - (spans.z >> k) + 1;
}

// The texels of a box along an axis; x > y where they cannot be named.
ivec4 touched(double centre, double spread, double reach, int size, int wrap) {
    // Rounding of these sums, and of those in float64 there, is 2^4 u of their terms at most.
    double slack = ((abs(centre) + spread) * double(size) + 1.0lf) / 1099511627776.0lf;
    double low = floor((centre - spread) * double(size) - reach - slack);
    double high = floor((centre + spread) * double(size) + reach + slack);
    if (!(low > -1e8lf && high < 1e8lf)) {
        return ivec4(1, 0, 0, -1);
    }
    return texels(int(low), int(high), size, wrap);
}

void main() {
    colour = 1.0;
    double a = samples.x + samples.y * double(floor(gl_FragCoord.x));
    double b = samples.z + samples.w * double(floor(gl_FragCoord.y));
    dvec3 here = dvec3(1.0lf, a, b);
    double below = dot(below_form, here);
    double way = below < 0.0lf ? -1.0lf : 1.0lf;
    double nearest = way * below;
    if (!(nearest > least_below)) {
        discard;
    }
    dvec2 shift = dvec2(dot(u_form, here), dot(v_form, here)) / below;
    dvec2 half_box = dvec2(0.0lf);
    double least = nearest;
    for (int i = 0; i < 4; i++) {
        dvec3 corner = here + dvec3(0.0lf, (i & 1) == 0 ? 2.0lf : -2.0lf, i < 2 ? 2.0lf : -2.0lf);
        double there = dot(below_form, corner);
        if (!(way * there > least_below)) {
            discard;
        }
        least = min(least, way * there);
        dvec2 moved = dvec2(dot(u_form, corner), dot(v_form, corner)) / there;
        half_box = max(half_box, abs(moved - shift));
    }
    dvec2 rounding = error * (1.0lf / nearest + 1.0lf / least) * uv_reach;
    dvec2 spread = half_box + rounding;
    dvec2 centre = first_uv + shift;

    int texture_at = textures_at + 4 * table[6 * row];
    ivec2 size = ivec2(table[texture_at], table[texture_at + 1]);
    int threshold = table[6 * row + 3];
    bool shown = gl_FrontFacing || table[6 * row + 4] == 0;
    double reach = 0.5lf;
    if (table[6 * row + 5] != 0) {
        reach = 0.0lf;
        if (all(lessThan(spread * dvec2(size), dvec2(0.999lf)))) {
            spread = rounding;
        }
    }
    ivec4 columns = touched(centre.x, spread.x, reach, size.x, table[6 * row + 1]);
    ivec4 rows = touched(centre.y, spread.y, reach, size.y, table[6 * row + 2]);
    if (!shown || columns.x > columns.y || rows.x > rows.y) {
        discard;
    }
    int k = 0;
    while (blocks(columns, k) * blocks(rows, k) > MOST && k < 20) {
        k++;
    }
    int level_at = levels_at + 2 * (table[texture_at + 2] + min(k, table[texture_at + 3] - 1));
    int start = table[level_at], width = table[level_at + 1];
    int alpha = 255;
    for (int part = 0; part < 4; part++) {
        ivec2 xs = (part & 1) == 0 ? columns.xy : columns.zw;
        ivec2 ys = (part & 2) == 0 ? rows.xy : rows.zw;
        if (xs.y < xs.x || ys.y < ys.x) {
            continue;
        }
        for (int y = ys.x >> k; y <= ys.y >> k; y++) {
            for (int x = xs.x >> k; x <= xs.y >> k; x++) {
                alpha = min(alpha, alpha_at(start + y * width + x));
            }
        }
    }
    if (alpha < threshold) {
        discard;
    }
}
