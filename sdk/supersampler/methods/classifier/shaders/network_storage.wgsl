// The weights of a pass, in a storage buffer: more than a uniform buffer may have.

@group(1) @binding(9) var<storage, read> network: array<vec4u, NETWORK_SIZE>;
