"""glTF 2.0 read straight from its accessors with NumPy, for geometry, hierarchy and cameras.

Why not through trimesh, which reads every other format here: measured with trimesh 5.2, it
turns a node's several primitives into several nodes, lists meshes that no node uses, ignores
EXT_mesh_gpu_instancing, fails inside EXT_meshopt_compression, decodes every image, drops
cameras' animation, and without a Draco decoder returns vertices that are all zero. Objects,
their order and their names are what a verdict is about, so they are read from the file itself.

Source: Khronos Group, "glTF 2.0 Specification" (section numbers in the modules refer to it).
"""
