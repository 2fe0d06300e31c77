#version 450
// One sprite, tested by one lookup or four: is its square's farthest depth nearer than the sprite?
layout(location = 0) in vec3 centre_world;
uniform vec3 eye_high;
uniform vec3 eye_low;
uniform mat4 clip_from_relative;
uniform ivec2 image_px;
uniform int side_px;
uniform float depth_shift;  // towards the eye, in window depth
uniform bool culled;
uniform bool four_squares;
layout(std430, binding = 3) buffer Lookups { uint n_buffer_lookups; };
#define N_BUFFER_COUNTED
#include "n_buffer.glsl"
layout(std430, binding = 2) writeonly buffer Record { uint record_of_sprite[]; };
out Sprite {
    ivec2 corner_px;  // top left, y down
    float depth_ndc;
    bool drawn;
} sprite;

// In the record.
const uint DRAWN = 1u, IN_IMAGE = 2u;

// The sprite's pixels x0, y0, x1, y1, inclusive, clipped to the image.
ivec4 square(ivec2 corner_px) {
    return ivec4(max(corner_px, ivec2(0)), min(corner_px + side_px, image_px) - 1);
}

bool shows(ivec4 r, float depth_ndc) {
    // Nearer than it is: too near a sprite is only drawn in vain.
    float farthest = four_squares ? n_buffer_four(r) : n_buffer_one(r);
    return 0.5 * depth_ndc + 0.5 - depth_shift <= farthest;
}

void main() {
    precise vec3 centre_relative = (centre_world - eye_high) - eye_low;
    vec4 clip = clip_from_relative * vec4(centre_relative, 1.0);
    sprite.corner_px = ivec2(0);
    sprite.depth_ndc = 0.0;
    sprite.drawn = false;
    record_of_sprite[gl_VertexID] = 0u;
    if (clip.w > 0.0 && abs(clip.z) <= clip.w) {
        vec2 ndc = clip.xy / clip.w;
        vec2 corner = 0.5 * vec2(image_px) * vec2(1.0 + ndc.x, 1.0 - ndc.y) - 0.5 * float(side_px);
        // To the nearest pixel border. Far outside is outside; an int holds what is left.
        corner = clamp(floor(corner + 0.5), vec2(-side_px), vec2(image_px));
        sprite.corner_px = ivec2(corner);
        sprite.depth_ndc = clip.z / clip.w;
        ivec4 r = square(sprite.corner_px);
        if (r.x <= r.z && r.y <= r.w) {
            sprite.drawn = !culled || shows(r, sprite.depth_ndc);
            record_of_sprite[gl_VertexID] = IN_IMAGE + (sprite.drawn ? DRAWN : 0u);
        }
    }
}
