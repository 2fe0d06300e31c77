#version 450
// The box's id, from 1 on, as the bytes of a colour; the least byte is red.
flat in int box;
layout(location = 0) out vec4 id_bytes;

void main() {
    uvec4 bytes = (uvec4(box + 1) >> uvec4(0, 8, 16, 24)) & 255u;
    id_bytes = vec4(bytes) / 255.0;
}
