"""Marked loops of shaders are written out, round by round."""

import pytest

from supersampler.backends.gpu.shader import MAX_ROUNDS, unrolled


def test_a_marked_loop_is_a_block_with_a_constant_for_each_round() -> None:
    code = "    /* unroll */ for (var i = 0u; i < 2u; i++) { sum += x[i]; }\n"
    written = "    { const i: u32 = 0u; sum += x[i]; }\n{ const i: u32 = 1u; sum += x[i]; }\n"
    assert unrolled(code) == written


def test_an_end_may_be_a_constant_and_may_be_included() -> None:
    code = "const TAPS = 1;\nfn f() { /* unroll */ for (var i = -1; i <= TAPS; i++) { g(i); } }"
    rounds = "\n".join(f"{{ const i: i32 = {i}; g(i); }}" for i in (-1, 0, 1))
    assert unrolled(code) == f"const TAPS = 1;\nfn f() {{ {rounds} }}"


def test_loops_inside_of_loops_are_written_out_where_they_are_marked() -> None:
    inner = "for (var i = 0; i < 2; i++) { g(j, i); }"
    outer = "/* unroll */ for (var j = 0; j < 2; j++) {{ {} }}"
    rolled = unrolled(outer.format(inner))
    assert rolled.count(inner) == 2
    assert rolled.count("const j") == 2
    assert unrolled(outer.format(f"/* unroll */ {inner}")).count("g(j, i)") == 4


def test_braces_and_words_in_comments_do_not_count() -> None:
    code = "/* unroll */ for (var i = 0; i < 1; i++) {\n    g(i);   // } break\n}\nh();"
    assert unrolled(code) == "{ const i: i32 = 0;\n    g(i);   // } break\n}\nh();"


def test_loops_that_are_not_marked_and_long_ones_stay() -> None:
    code = "for (var i = 0; i < 2; i++) { g(i); }"
    assert unrolled(code) == code
    long = f"for (var i = 0; i < {MAX_ROUNDS + 1}; i++) {{ g(i); }}"
    assert unrolled(f"/* unroll */ {long}") == long


@pytest.mark.parametrize(
    ("loop", "problem"),
    [
        ("for (var i = 4; i > 0; i--) { g(i); }", "no loop that can be unrolled: .*i--"),
        ("for (var i = 0; i < count; i++) { g(i); }", "count is no constant number"),
        ("for (var i = 0; i < 2; i++) { if (x) { continue; } }", "no break or continue"),
        ("for (var i = 0; i < 2; i++) { g(i);", "without an end"),
    ],
)
def test_a_marked_loop_of_another_form_is_refused(loop: str, problem: str) -> None:
    with pytest.raises(ValueError, match=problem):
        unrolled(f"/* unroll */ {loop}")
