#version 450
// One sprite, tested by one lookup: is its square's farthest depth nearer than the sprite?
layout(location = 0) in vec3 centre_world;
uniform vec3 eye_high;
uniform vec3 eye_low;
uniform mat4 clip_from_relative;
uniform ivec2 image_px;
uniform int side_px;
uniform float depth_shift;  // towards the eye, in window depth
uniform bool culled;
#include "n_buffer.glsl"
layout(std430, binding = 2) writeonly buffer Drawn { uint is_drawn[]; };
out Sprite {
    ivec2 corner_px;  // top left, y down
    float depth_ndc;
    bool drawn;
} sprite;

bool shows(ivec2 corner_px, float depth_ndc) {
    ivec4 r = ivec4(max(corner_px, ivec2(0)), min(corner_px + side_px, image_px) - 1);
    if (r.x > r.z || r.y > r.w) {
        return false;  // beside the image
    }
    // Nearer than it is: too near a sprite is only drawn in vain.
    return !culled || 0.5 * depth_ndc + 0.5 - depth_shift <= n_buffer_one(r);
}

void main() {
    precise vec3 centre_relative = (centre_world - eye_high) - eye_low;
    vec4 clip = clip_from_relative * vec4(centre_relative, 1.0);
    sprite.corner_px = ivec2(0);
    sprite.depth_ndc = 0.0;
    sprite.drawn = false;
    if (clip.w > 0.0 && abs(clip.z) <= clip.w) {
        vec2 ndc = clip.xy / clip.w;
        vec2 corner = 0.5 * vec2(image_px) * vec2(1.0 + ndc.x, 1.0 - ndc.y) - 0.5 * float(side_px);
        // To the nearest pixel border. Far outside is outside; an int holds what is left.
        corner = clamp(floor(corner + 0.5), vec2(-side_px), vec2(image_px));
        sprite.corner_px = ivec2(corner);
        sprite.depth_ndc = clip.z / clip.w;
        sprite.drawn = shows(sprite.corner_px, sprite.depth_ndc);
    }
    is_drawn[gl_VertexID] = uint(sprite.drawn);
}
