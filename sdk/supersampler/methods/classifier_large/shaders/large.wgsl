// Size of the history, 1.4 times the display, rounded up. Same as `large_size` (methods/spec.py).

fn large_size() -> vec2i { return (7 * vec2i(params.display) + 4) / 5; }
