// Declarations shared by all stages. Matrices are column-major, as in GL.

layout(std140) uniform View {
    mat4 world_to_clip;         // now, without jitter
    mat4 world_to_clip_before;  // one frame ago, without jitter
    mat4 clip_to_ray;           // (x, y, 1, 0) of the clip plane to a direction in the world
    vec4 window;                // clip.xy of what is drawn = clip.xy * window.xy + clip.w * window.zw
    vec4 eye;                   // world; w: near
    vec4 right;                 // world directions of the camera
    vec4 up;
    vec4 grid;                  // xy: pixels that motion is counted in; z: width of texture filters, pixels of what is drawn
};

layout(std140) uniform Draw {
    mat4 model;
    mat4 model_before;
    mat4 normal_model;  // inverse transpose
    vec4 draw;          // x: factor of the emissive colour; y: thin and still, z: thin and moving, w: moving otherwise
};
