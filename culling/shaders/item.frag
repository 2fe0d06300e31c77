#version 450
layout(std430, binding = 0) readonly buffer Triangles { int triangle_of_primitive[]; };
layout(location = 0) out int item;

void main() {
    item = triangle_of_primitive[gl_PrimitiveID];
}
