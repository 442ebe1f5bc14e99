"""Write out the loops of a shader that are marked with `/* unroll */`.

wgpu adds a counter to every loop, and drivers then unroll none: vectors and arrays that a loop indexes stay
in memory. Written out, the indices are constants. Mark small loops that index; others only cost time to
compile.
"""

import re
from collections.abc import Mapping

MOST_ROUNDS = 16
"""Loops with more rounds stay loops: they would take long to compile."""
_MARK = "/* unroll */"
_LOOP = re.compile(r"/\* unroll \*/ for \(var (\w+) = (-?\d+)(u?); \1 (<=?) (\w+); \1\+\+\) \{")
_CONSTANT = re.compile(r"^const (\w+) = (\d+)u?;", re.MULTILINE)
_JUMP = re.compile(r"\b(?:break|continue)\b")
_COMMENT = re.compile(r"//[^\n]*")


def unrolled(code: str) -> str:
    """Write out marked loops: a block with a constant for each round.

    A marked loop is `/* unroll */ for (var i = FIRST; i < END; i++) {`, or with `<=`. FIRST is a number; END
    is a number or a constant of the module that is a number. The loop neither breaks nor continues.

    Raises:
        ValueError: a marked loop is of another form.
    """
    return _written(code, {name: int(value) for name, value in _CONSTANT.findall(code)})


def _written(code: str, constants: Mapping[str, int]) -> str:
    before, mark, _ = code.partition(_MARK)
    if not mark:
        return code
    loop = _LOOP.match(code, len(before))
    if loop is None:
        raise ValueError(f"no loop that can be unrolled: {_line(code, len(before))}")
    name, first, unsigned, sign, last = loop.groups()
    end = _closing(code, loop.end())
    if last not in constants and not last.removesuffix("u").isdigit():
        raise ValueError(f"{last} is no constant number: {_line(code, len(before))}")
    stop = (constants[last] if last in constants else int(last.removesuffix("u"))) + (sign == "<=")
    body, after = _written(code[loop.end() : end], constants), _written(code[end + 1 :], constants)
    if _JUMP.search(_COMMENT.sub("", body)):
        raise ValueError(f"a loop that is unrolled has no break or continue: {_line(code, len(before))}")
    if stop - int(first) > MOST_ROUNDS:
        return f"{before}{loop[0].removeprefix(_MARK + ' ')}{body}}}{after}"
    kind = "u32" if unsigned else "i32"
    rounds = [f"{{ const {name}: {kind} = {i}{unsigned};{body}}}" for i in range(int(first), stop)]
    return before + "\n".join(rounds) + after


def _closing(code: str, begin: int) -> int:
    """Return where the block ends whose first character is at `begin`."""
    depth = 1
    for at, letter in enumerate(_COMMENT.sub(lambda comment: " " * len(comment[0]), code[begin:])):
        depth += (letter == "{") - (letter == "}")
        if depth == 0:
            return begin + at
    raise ValueError(f"a block without an end: {_line(code, begin)}")


def _line(code: str, at: int) -> str:
    return code[at:].partition("\n")[0].strip()
