// The mean of the samples where nothing moves, shared by its passes. Twin of ops/convergence.py.
// import params
// import colors
// import sampling

const MAX_STATIC_MOTION = 1.0 / 256.0;
const READY = 1.4;
const PERIOD = 3.75;
const DOUBTED = 0.5;   // what opens where only the pattern differs

fn is_moving(motion: vec2f) -> bool { return dot(motion, motion) > MAX_STATIC_MOTION * MAX_STATIC_MOTION; }
