"""The glTF extensions that visref knows, and which of them change what is seen.

docs/formats.md lists each and says how it is taken. Source: the glTF 2.0 extension registry
(Khronos Group), all ratified extensions and those of vendors that it lists.
"""

from __future__ import annotations

MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")

# They move, hide or open triangles, and are read.
READ = {
    "ADOBE_materials_thin_transparency",
    "EXT_mesh_gpu_instancing",
    "KHR_animation_pointer",
    "KHR_draco_mesh_compression",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_transmission",
    "KHR_materials_variants",
    "KHR_mesh_quantization",
    "KHR_node_visibility",
    "MSFT_lod",
    *MESHOPT,
}

# They change how a surface looks or sounds, or what is known of it, and never which is nearest.
HARMLESS = {
    "ADOBE_materials_clearcoat_specular",
    "ADOBE_materials_clearcoat_tint",
    "AGI_articulations",
    "AGI_stk_metadata",
    "CESIUM_primitive_outline",
    "EXT_instance_features",
    "EXT_lights_ies",
    "EXT_lights_image_based",
    "EXT_mesh_features",
    "EXT_mesh_manifold",
    "EXT_structural_metadata",
    "EXT_texture_avif",
    "EXT_texture_webp",
    "FB_geometry_metadata",
    "GOOGLE_texture_basis",
    "KHR_audio_emitter",
    "KHR_environment_map",
    "KHR_lights_punctual",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_diffuse_transmission",
    "KHR_materials_dispersion",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_iridescence",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_unlit",
    "KHR_materials_volume",
    "KHR_materials_volume_scatter",
    "KHR_node_hoverability",
    "KHR_node_selectability",
    "KHR_texture_basisu",
    "KHR_texture_transform",
    "KHR_xmp",
    "KHR_xmp_json_ld",
    "MSFT_lighting_common",
    "MSFT_packing_normalRoughnessMetallic",
    "MSFT_packing_occlusionRoughnessMetallic",
    "MSFT_texture_dds",
}


def is_known(extension: str) -> bool:
    return extension in READ or extension in HARMLESS
