// Backface cones (culling/hzb/cones.py): nine numbers per unit, which are its centre, reach, axis,
// cosine and sine. After `box_commands.glsl`.
layout(std430, binding = 8) readonly buffer Cones { double cones_world[]; };
// What rounding here adds up to, per distance: fewer than 64 units of 2^-53.
const double CONE_ROUNDING = 64.0lf / 9007199254740992.0lf;

// Whether all triangles of the unit are for certain seen from behind.
bool faces_away(uint unit) {
    uint at = 9u * unit;
    dvec3 centre = dvec3(cones_world[at], cones_world[at + 1u], cones_world[at + 2u]);
    dvec3 axis = dvec3(cones_world[at + 4u], cones_world[at + 5u], cones_world[at + 6u]);
    double reach = cones_world[at + 3u];
    if (reach > 0.0lf) {
        return false;
    }
    bool perspective = to_window.w > 0.0lf;
    dvec3 sight = perspective ? centre - eye.xyz : look.xyz;
    double along = dot(axis, sight), across = length(cross(axis, sight));
    double least = along * cones_world[at + 7u] - across * cones_world[at + 8u]
        + (perspective ? reach : 0.0lf);
    return least > CONE_ROUNDING * length(sight);
}
