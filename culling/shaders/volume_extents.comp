#version 450
// Between which planes each caster's shadow volume is kept, and its draw commands: a work item a
// caster, run once with the litmap of the nearest distances and then with that of the farthest.
layout(local_size_x = 64) in;
layout(std430, binding = 1) readonly buffer Rectangles { ivec4 lexels_of_caster[]; };
layout(std430, binding = 2) readonly buffer Ranges { vec2 range_of_caster[]; };
layout(std430, binding = 3) buffer Extents { vec2 planes_of_caster[]; };
layout(std430, binding = 4) buffer Commands { uint commands[]; };
#include "n_buffer.glsl"
uniform bool farthest;
uniform uint casters;
uniform uint lists;      // of commands, of five words for each caster
uniform float light_near;

const float INFINITE = uintBitsToFloat(0x7F800000u);

void main() {
    uint caster = gl_GlobalInvocationID.x;
    if (caster >= casters) {
        return;
    }
    ivec4 r = lexels_of_caster[caster];
    bool empty = r.x > r.z || r.y > r.w;
    if (!farthest) {
        planes_of_caster[caster].x = empty ? INFINITE : n_buffer_four(r);
        return;
    }
    vec2 range = range_of_caster[caster];  // the caster's own distances from the light
    float least = planes_of_caster[caster].x;
    float greatest = empty ? 0.0 : n_buffer_four(r);
    vec2 planes = vec2(-INFINITE, greatest);
    bool kept;
    if (range.x <= light_near) {
        // It reaches to the light or behind it, where nothing can be projected on a plane.
        planes.y = INFINITE;
        kept = range.y > light_near;
    } else {
        // Nothing is seen there; or nothing behind the caster.
        kept = least <= greatest && range.x <= greatest;
        // The light cap may move only where the whole caster is nearer to the light: moved vertex
        // by vertex, a cap that the plane cuts would lie behind the triangle that it belongs to.
        if (range.y <= least) {
            planes.x = least;
        }
    }
    planes_of_caster[caster] = planes;
    for (uint list = 0u; list < lists; list++) {
        commands[5u * (list * casters + caster) + 1u] = uint(kept);
    }
}
