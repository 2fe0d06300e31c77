#version 450
layout(early_fragment_tests) in;
layout(std430, binding = 2) writeonly buffer Seen { uint seen_of_box[]; };
flat in int box;
layout(location = 0) out float scratch;

void main() {
    // No atomic: whichever fragment comes last, it is 1 that is written.
    seen_of_box[box] = 1u;
    scratch = 1.0;
}
