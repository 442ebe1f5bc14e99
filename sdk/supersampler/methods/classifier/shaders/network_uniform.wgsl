// The weights of a pass, in a uniform buffer: GPUs read constants without a load where all threads read the same.

@group(1) @binding(9) var<uniform> network: array<vec4u, NETWORK_SIZE>;
