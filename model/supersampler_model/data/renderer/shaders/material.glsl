// A material: constants, and the textures that multiply them.

layout(std140) uniform Surface {
    vec4 base_color;  // rgb
    vec4 material;    // roughness, metallic, specular, alpha cutoff (-1: none)
    vec4 emissive;    // rgb
    vec4 has_maps;    // base colour, normal, ORM, emissive: 1 or 0
};

uniform sampler2D base_color_map;
uniform sampler2D normal_map;
uniform sampler2D orm_map;
uniform sampler2D emissive_map;

struct Shaded {
    vec3 world;
    vec3 smooth_normal;
    vec3 normal;
    vec3 base_color;
    vec3 emission;
    float occlusion;
    float roughness;
    float metallic;
    float specular;
};
