#version 450
// A shadow volume's vertex: a caster's own, or the same moved along the light's ray to a plane.
// A vertex that is not moved lands where `mesh.vert` puts it, to the bit.
layout(location = 0) in vec3 vertex_world;
layout(location = 1) in int caster;
layout(std430, binding = 3) readonly buffer Extents {
    vec2 planes_of_caster[];  // distances along the light: light cap, dark cap
};
uniform vec3 eye_high;
uniform vec3 eye_low;
uniform mat4 clip_from_relative;
uniform vec4 light_relative;  // from the eye to a spot light, 1; or the sun's direction, 0
uniform vec4 distance_row;    // distance along the light of a position relative to the eye
uniform int vertices;         // indices from here on are of moved vertices
invariant gl_Position;

void main() {
    precise vec3 vertex_relative = (vertex_world - eye_high) - eye_low;
    vec2 planes = planes_of_caster[caster];
    float distance = dot(distance_row.xyz, vertex_relative) + distance_row.w;
    bool dark = gl_VertexID >= vertices;
    float plane = dark ? planes.y : planes.x;
    // No vertex is moved towards the light.
    if (!dark && plane <= distance) {
        gl_Position = clip_from_relative * vec4(vertex_relative, 1.0);
    } else if (isinf(plane)) {
        vec3 away = light_relative.w == 0.0 ? light_relative.xyz : vertex_relative - light_relative.xyz;
        gl_Position = clip_from_relative * vec4(away, 0.0);
    } else {
        plane = max(plane, distance);
        vec3 moved = light_relative.w == 0.0
            ? vertex_relative + (plane - distance) * light_relative.xyz
            : light_relative.xyz + (vertex_relative - light_relative.xyz) * (plane / distance);
        gl_Position = clip_from_relative * vec4(moved, 1.0);
    }
}
