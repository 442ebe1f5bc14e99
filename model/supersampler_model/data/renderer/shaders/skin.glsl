// How a vertex of a skinned mesh is posed, now and one frame ago; the bind pose where there is no skin.

#ifdef SKINNED
in uvec4 joints;
in vec4 weights;

layout(std140) uniform Palettes {
    mat4 palette[MAX_JOINTS];
    mat4 palette_before[MAX_JOINTS];
};

mat4 pose() {
    return weights[0] * palette[joints[0]] + weights[1] * palette[joints[1]]
         + weights[2] * palette[joints[2]] + weights[3] * palette[joints[3]];
}

mat4 pose_before() {
    return weights[0] * palette_before[joints[0]] + weights[1] * palette_before[joints[1]]
         + weights[2] * palette_before[joints[2]] + weights[3] * palette_before[joints[3]];
}
#else
mat4 pose() { return mat4(1.0); }
mat4 pose_before() { return mat4(1.0); }
#endif
