// For methods without a table of phases. It takes the place of phases.wgsl.

fn follow_jitter() {}
