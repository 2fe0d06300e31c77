// How far a position relative to the eye is on the right side of the clip plane, less all that this
// may err: two subtractions of the eye, four rounded numbers, products and sums come to 12 units of
// 2^-24 of the terms, 16 are taken. So nothing that is cut away is drawn, and hides anything.
uniform vec4 clip_plane;

float kept_by(vec3 relative) {
    vec4 terms = clip_plane * vec4(relative, 1.0);
    vec4 doubt = abs(terms);
    return terms.x + terms.y + terms.z + terms.w
        - (doubt.x + doubt.y + doubt.z + doubt.w) / 1048576.0;
}
