#version 450
// Scatters the samples seen from their lit side into the litmaps: the least and the greatest
// distance along the light of what is seen in each lexel. A work item a sample.
//
// A sample is written to every lexel under its footprint: all points within `doubt` of it, which
// is how far the rasteriser may put the sample and a shadow's face apart. Outward: too large a
// footprint only clamps less.
layout(local_size_x = 16, local_size_y = 16) in;
// Distances are not negative, and their bits are in the order of the numbers.
layout(std430, binding = 1) buffer Nearest { uint nearest_of_lexel[]; };
layout(std430, binding = 2) buffer Farthest { uint farthest_of_lexel[]; };
uniform sampler2D depth_buffer;
uniform sampler2D unlit;
uniform vec3 forward;
uniform vec3 right_step;
uniform vec3 up_step;
uniform vec2 shift_px;
uniform float near;
uniform vec3 doubt;         // in all, for each unit of depth, for its square
// Of a position relative to the eye: x and y in lexels (of a spot light: times the distance along
// the light), the distance along the light, and in fourth place its divisor.
uniform mat4 light_from_relative;
uniform vec2 lexels_per_unit; // of length: at any distance, or of a spot light at distance 1
uniform float light_near;
uniform ivec2 lexels;

void main() {
    ivec2 size = textureSize(depth_buffer, 0), at = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(at, size))) {
        return;
    }
    float window = texelFetch(depth_buffer, at, 0).x;
    if (window == 1.0 || texelFetch(unlit, at, 0).x > 0.0) {
        return;  // nothing is seen, or nothing that a shadow could darken
    }
    float depth = near / (1.0 - window);
    vec2 ab = vec2(2 * at + 1 - size) + vec2(2.0, -2.0) * shift_px;
    vec3 relative = depth * (forward + ab.x * right_step + ab.y * up_step);
    float apart = doubt.x + (doubt.y + doubt.z * depth) * depth;
    vec4 light = light_from_relative * vec4(relative, 1.0);
    float divisor = light.w - (lexels_per_unit.y > 0.0 ? apart : 0.0);
    if (light.z - apart < light_near || divisor <= 0.0) {
        return;  // beside the light
    }
    vec2 lexel = light.xy / light.w;
    // Moving by `apart` moves a lexel by so many, and of a spot light changes the divisor.
    vec2 footprint = vec2(apart * lexels_per_unit.x);
    if (lexels_per_unit.y > 0.0) {
        footprint = apart * (lexels_per_unit.y + abs(lexel)) / divisor;
    }
    ivec2 first = ivec2(floor(clamp(lexel - footprint, vec2(0.0), vec2(lexels))));
    ivec2 last = ivec2(floor(clamp(lexel + footprint, vec2(-1.0), vec2(lexels) - 0.5)));
    uint nearest = floatBitsToUint(max(light.z - apart, 0.0));
    uint farthest = floatBitsToUint(light.z + apart);
    for (int y = first.y; y <= last.y; y++) {
        for (int x = first.x; x <= last.x; x++) {
            atomicMin(nearest_of_lexel[y * lexels.x + x], nearest);
            atomicMax(farthest_of_lexel[y * lexels.x + x], farthest);
        }
    }
}
