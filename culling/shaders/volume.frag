#version 450
// What a face of a shadow volume behind the visible surface adds to the count there.
uniform float outward;  // 1 where front faces look out of the volume, -1 where they look in
layout(location = 0) out float count;

void main() {
    count = gl_FrontFacing ? -outward : outward;
}
