// The mean of all samples of one pixel.

uniform sampler2D sample_colors;
uniform int side;  // side x side samples a pixel
layout(location = 0) out vec4 out_mean;

void main() {
    ivec2 corner = ivec2(gl_FragCoord.xy) * side;
    vec4 sum = vec4(0.0);
    for (int y = 0; y < side; y++) {
        for (int x = 0; x < side; x++) {
            sum += texelFetch(sample_colors, corner + ivec2(x, y), 0);
        }
    }
    out_mean = sum / float(side * side);
}
