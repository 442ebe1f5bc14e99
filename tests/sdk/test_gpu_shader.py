"""Shaders: imports, declarations that the entry point reaches, and loops that are written out."""

import pytest

from supersampler.backends.gpu.shader import MAX_ROUNDS, parse, reachable_code, unroll

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


def test_used_declarations_keep_their_order_and_comments_and_others_are_left_out() -> None:
    code = reachable_code([parse(SHARED), parse(ENTRY), parse("// Never used.\n\nconst LAST = 1;\n")])
    assert code.startswith(SHARED.partition("const WIDE")[0])
    assert "var<storage, read> near: array<f32>;   // 4 a thread\n" in code
    assert "// Twice a value; calls nothing of `idle`.\nfn twice" in code
    places = [code.index(text) for text in ("const WIDE", "fn twice", "// The entry point.", "fn main")]
    assert places == sorted(places)
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
    assert "var<private>" not in reachable_code([parse(source)])


def test_an_invalid_declaration_is_refused() -> None:
    with pytest.raises(ValueError, match="no declaration"):
        parse("const SIDE = 4")
    with pytest.raises(KeyError):
        reachable_code([parse("const SIDE = 4;")])


def test_loops_inside_of_loops_are_written_out_where_they_are_marked() -> None:
    inner = "for (var i = 0; i < 2; i++) { g(j, i); }"
    outer = "/* unroll */ for (var j = 0; j < 2; j++) {{ {} }}"
    rolled = unroll(outer.format(inner))
    assert rolled.count(inner) == 2
    assert rolled.count("const j") == 2
    assert unroll(outer.format(f"/* unroll */ {inner}")).count("g(j, i)") == 4


PLAIN, LONG = (
    "for (var i = 0; i < 2; i++) { g(i); }",
    f"for (var i = 0; i < {MAX_ROUNDS + 1}; i++) {{ g(i); }}",
)
ROUNDS = "\n".join(f"{{ const i: i32 = {i}; g(i); }}" for i in (-1, 0, 1))


@pytest.mark.parametrize(
    ("code", "written"),
    [
        (
            "    /* unroll */ for (var i = 0u; i < 2u; i++) { sum += x[i]; }\n",
            "    { const i: u32 = 0u; sum += x[i]; }\n{ const i: u32 = 1u; sum += x[i]; }\n",
        ),
        (
            "const TAPS = 1;\nfn f() { /* unroll */ for (var i = -1; i <= TAPS; i++) { g(i); } }",
            f"const TAPS = 1;\nfn f() {{ {ROUNDS} }}",
        ),
        (
            "/* unroll */ for (var i = 0; i < 1; i++) {\n    g(i);   // } break\n}\nh();",
            "{ const i: i32 = 0;\n    g(i);   // } break\n}\nh();",
        ),
        (PLAIN, PLAIN),
        (f"/* unroll */ {LONG}", LONG),
    ],
    ids=["marked", "an included end that is a constant", "braces in comments", "not marked", "long"],
)
def test_a_marked_loop_is_a_block_with_a_constant_for_each_round(code: str, written: str) -> None:
    assert unroll(code) == written


@pytest.mark.parametrize(
    ("loop", "problem"),
    [
        ("for (var i = 4; i > 0; i--) { g(i); }", "no loop that can be unrolled: .*i--"),
        ("for (var i = 0; i < count; i++) { g(i); }", "count is not a constant number"),
        ("for (var i = 0; i < 2; i++) { if (x) { continue; } }", "no break or continue"),
        ("for (var i = 0; i < 2; i++) { g(i);", "without an end"),
    ],
)
def test_a_marked_loop_of_another_form_is_refused(loop: str, problem: str) -> None:
    with pytest.raises(ValueError, match=problem):
        unroll(f"/* unroll */ {loop}")
