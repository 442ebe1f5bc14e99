"""A shader holds what its entry point needs, and no more."""

import pytest

from supersampler.backends.gpu.shader import needed, parsed

SHARED = """// Shared functions.
// They are in every pass.

const SIDE = 4;          // of a tile
const WIDE = SIDE + 2;   // of a tile and its neighbours
const HEIGHT = 3;

struct Pair {
    idle: f32,
    near: f32,
}

@group(0) @binding(0) var<storage, read> near: array<f32>;   // 4 a thread
@group(0) @binding(1) var<storage, read> indirect: array<f32>;
@group(0) @binding(2) var<storage, read> idle: array<f32>;

// Twice a value; calls nothing of `idle`.
fn twice(x: f32) -> f32 { return 2.0 * x; }
fn never(i: u32) -> f32 { return idle[i]; }
"""
ENTRY = """// The entry point.

fn read(i: u32) -> f32 { return twice(indirect[i]); }

@compute @workgroup_size(WIDE)
fn main() {
    // idle is not read here
    let pair = Pair(0.0, near[0] + read(0u));
    let x = pair.idle;
}
"""


def test_what_main_needs_is_kept_in_order_with_its_comments() -> None:
    code = needed([parsed(SHARED), parsed(ENTRY)])
    assert code.startswith(
        "// Shared functions.\n// They are in every pass.\n\nconst SIDE = 4;          // of a tile\n"
    )
    assert "var<storage, read> near: array<f32>;   // 4 a thread\n" in code
    assert "// Twice a value; calls nothing of `idle`.\nfn twice" in code
    assert (
        code.index("const WIDE")
        < code.index("fn twice")
        < code.index("// The entry point.")
        < code.index("fn main")
    )


def test_what_main_does_not_need_is_left_out() -> None:
    code = needed([parsed(SHARED), parsed(ENTRY), parsed("// Never used.\n\nconst LAST = 1;\n")])
    for name in ("HEIGHT", "var<storage, read> idle", "never", "LAST", "Never used"):
        assert name not in code, name


def test_parameters_and_local_names_hide_resources() -> None:
    source = """var<private> samples: f32;
var<private> light: f32;
fn read(samples: f32) -> f32 {
    let light = samples;
    return light;
}
fn main() { _ = read(1.0); }
"""
    assert "var<private>" not in needed([parsed(source)])


def test_what_is_no_declaration_is_refused() -> None:
    with pytest.raises(ValueError, match="no declaration"):
        parsed("const SIDE = 4")
    with pytest.raises(KeyError):
        needed([parsed("const SIDE = 4;")])
