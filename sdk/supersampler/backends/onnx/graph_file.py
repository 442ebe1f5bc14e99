"""Reads an .onnx file (protobuf's wire format) as far as it takes to see that it holds a plain graph.

ONNX Runtime would follow external data to any file, and look for custom operators; neither is for a model
that somebody mails. Field numbers are those of onnx.proto (onnx 1.23, IR version 14); others are passed over,
as all readers of protobuf do.
"""

from collections.abc import Iterator, Mapping

DOMAINS = {"", "ai.onnx"}
"""Of operators that ONNX itself defines."""
_DEPTH = 32  # of graphs in nodes in graphs; each level takes three
_FIELDS = 4_000_000  # of all messages; the largest graph that ships has 40,000
_VARINT, _BYTES, _FIXED = 0, 2, {1: 8, 5: 4}  # wire types; bytes of those of a fixed size

_DOMAIN, _REFUSED = "domain", "refused"
_MESSAGES: Mapping[str, Mapping[int, str]] = {
    "model": {7: "graph", 8: "opset", 20: _REFUSED, 25: "function"},
    "graph": {1: "node", 5: "tensor", 15: "sparse tensor"},
    "node": {5: "attribute", 7: _DOMAIN},
    "attribute": {
        5: "tensor", 6: "graph", 10: "tensor", 11: "graph", 22: "sparse tensor", 23: "sparse tensor",
    },
    "function": {7: "node", 9: "opset", 10: _DOMAIN, 11: "attribute"},
    "opset": {1: _DOMAIN},
    "tensor": {13: _REFUSED, 14: _REFUSED},
    "sparse tensor": {1: "tensor", 2: "tensor"},
}  # fmt: skip
"""What there is to look at in a message, by the field's number: messages, domains' names, and what is not to
be: training_info of a model, external_data and data_location of a tensor."""


def refusal_of(content: bytes) -> str | None:
    """Say why a file is none that ONNX Runtime is to see; None where it may.

    Args:
        content: of the file.
    """
    if content[4:8] == b"ORTM":
        return "is in ONNX Runtime's own format; want ONNX's"
    left, graphs = _FIELDS, 0
    waiting = [("model", 0, len(content), 0)]
    try:
        while waiting:
            message, start, end, depth = waiting.pop()
            kinds = _MESSAGES[message]
            for number, at, stop in _fields(content, start, end):
                left -= 1
                if left < 0 or depth > 3 * _DEPTH:
                    return f"holds more than {_FIELDS} fields, or graphs in graphs {_DEPTH} deep"
                kind = kinds.get(number)
                if kind is None:
                    continue
                if kind == _REFUSED:
                    if at == stop == 0:  # a number that is zero: data is here
                        continue
                    what = {"model": "training information", "tensor": "data in other files"}[message]
                    return f"has {what}, which is not read"
                if stop < 0:
                    return f"is damaged: field {number} of a {message} is a number"
                if kind == _DOMAIN:
                    domain = content[at:stop].decode(errors="replace")
                    if domain not in DOMAINS:
                        return f"has operators of {domain[:80]!r}; want those of ONNX alone"
                else:
                    graphs += kind == "graph"
                    waiting.append((kind, at, stop, depth + 1))
    except (IndexError, ValueError) as error:
        return f"is damaged: {error}"
    return None if graphs else "holds no graph"


def _fields(content: bytes, at: int, end: int) -> Iterator[tuple[int, int, int]]:
    """Yield the fields of a message that lies from `at` to `end`: number, and where its bytes begin and end.

    Of a number 0 and 0 where it is zero, else 0 and -1.

    Raises:
        IndexError, ValueError: it is damaged.
    """
    while at < end:
        tag, at = _varint(content, at)
        number, wire = tag >> 3, tag & 7
        if not 1 <= number < 1 << 29:
            raise ValueError(f"field {number}")
        first = at
        if wire == _VARINT:
            value, at = _varint(content, at)
            first, last = 0, -1 if value else 0
        elif wire == _BYTES:
            size, first = _varint(content, at)
            at = last = first + size
        elif wire in _FIXED:
            at = last = first + _FIXED[wire]
        else:
            raise ValueError(f"wire type {wire}")
        if at > end:
            raise ValueError("a field ends beyond its message")
        yield number, first, last


def _varint(content: bytes, at: int) -> tuple[int, int]:
    """A number of seven bits a byte, and where it ends."""
    byte = content[at]
    if byte < 128:
        return byte, at + 1
    value, shift = byte & 127, 7
    while shift < 70:
        at += 1
        byte = content[at]
        value |= (byte & 127) << shift
        if byte < 128:
            return value, at + 1
        shift += 7
    raise ValueError("a number of more than ten bytes")
