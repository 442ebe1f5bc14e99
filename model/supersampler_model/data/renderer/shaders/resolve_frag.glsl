// Statistics of a pixel's samples: mean, extremes, and distance of normals from the first sample's.

uniform sampler2D sample_colors;   // rgb, depth
uniform sampler2D sample_normals;  // octahedral: smooth, mapped
uniform int side;                  // side x side samples per pixel
layout(location = 0) out vec4 out_mean;   // rgb, spread of mapped normals
layout(location = 1) out vec4 out_min;  // rgb, depth
layout(location = 2) out vec4 out_max;   // rgb, depth
layout(location = 3) out float out_spread;

vec3 decoded(vec2 p) {
    if (p.x > 1.5) {
        return vec3(0.0);
    }
    vec3 n = vec3(p, 1.0 - abs(p.x) - abs(p.y));
    float fold = max(-n.z, 0.0);
    n.xy -= vec2(n.x < 0.0 ? -fold : fold, n.y < 0.0 ? -fold : fold);
    return normalize(n);
}

float l1(vec3 a, vec3 b) {
    return dot(abs(a - b), vec3(1.0));
}

void main() {
    ivec2 corner = ivec2(gl_FragCoord.xy) * side;
    vec4 encoded = texelFetch(sample_normals, corner, 0);
    vec3 first_smooth = decoded(encoded.xy), first_mapped = decoded(encoded.zw);
    vec4 low = texelFetch(sample_colors, corner, 0), high = low;
    vec3 sum = vec3(0.0);
    float spread = 0.0, mapped_spread = 0.0;
    for (int y = 0; y < side; y++) {
        for (int x = 0; x < side; x++) {
            vec4 color = texelFetch(sample_colors, corner + ivec2(x, y), 0);
            vec4 normals = texelFetch(sample_normals, corner + ivec2(x, y), 0);
            sum += color.rgb;
            low = min(low, color);
            high = max(high, color);
            if (normals != encoded) {
                spread = max(spread, l1(decoded(normals.xy), first_smooth));
                mapped_spread = max(mapped_spread, l1(decoded(normals.zw), first_mapped));
            }
        }
    }
    out_mean = vec4(sum / float(side * side), mapped_spread);
    out_min = low;
    out_max = high;
    out_spread = spread;
}
