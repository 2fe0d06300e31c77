#version 450
layout(early_fragment_tests) in;
layout(std430, binding = 2) buffer Counts { uint samples_of_box[]; };
flat in int box;
layout(location = 0) out float scratch;

void main() {
    atomicAdd(samples_of_box[box], 1u);
    scratch = 1.0;
}
