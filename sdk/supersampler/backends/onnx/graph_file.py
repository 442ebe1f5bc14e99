"""Check that an .onnx file from an unknown source holds a plain graph, before ONNX Runtime loads it.

ONNX Runtime would read external data from any file, and load custom operators. This module reads protobuf's
wire format, with the field numbers of onnx.proto (onnx 1.23, IR version 14), and skips other fields.
"""

from collections.abc import Iterator, Mapping

DOMAINS = {"", "ai.onnx"}
"""Domains of ONNX's own operators."""
_MAX_DEPTH = 32  # of nested graphs; a level takes three messages: graph, node, attribute
_MAX_FIELDS = 4_000_000  # the largest shipped graph has 40,000
_VARINT, _BYTES, _FIXED = 0, 2, {1: 8, 5: 4}  # wire types, and bytes of the fixed-size ones

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
"""Fields of each message that are read: nested messages, domains, and refused fields (training_info of a
model, external_data and data_location of a tensor)."""


def refusal_of(content: bytes) -> str | None:
    """Return why ONNX Runtime must not load a file with this content; None if it may."""
    if content[4:8] == b"ORTM":
        return "is in ONNX Runtime's own format; want ONNX's"
    fields, graphs = 0, 0
    waiting = [("model", 0, len(content), 0)]
    try:
        while waiting:
            message, start, end, depth = waiting.pop()
            kinds = _MESSAGES[message]
            for number, at, stop in _fields(content, start, end):
                fields += 1
                if fields > _MAX_FIELDS or depth > 3 * _MAX_DEPTH:
                    return f"holds more than {_MAX_FIELDS} fields, or graphs in graphs {_MAX_DEPTH} deep"
                kind = kinds.get(number)
                if kind is None:
                    continue
                if kind == _REFUSED:
                    if at == stop == 0:  # the number 0: the data is in this file
                        continue
                    what = {"model": "training information", "tensor": "data in other files"}[message]
                    return f"has {what}, which is not read"
                if stop < 0:
                    return f"is damaged: field {number} of a {message} is a number"
                if kind == _DOMAIN:
                    domain = content[at:stop].decode(errors="replace")
                    if domain not in DOMAINS:
                        return f"has operators of {domain[:80]!r}; want only ONNX's own"
                else:
                    graphs += kind == "graph"
                    waiting.append((kind, at, stop, depth + 1))
    except (IndexError, ValueError) as error:
        return f"is damaged: {error}"
    return None if graphs else "holds no graph"


def _fields(content: bytes, at: int, end: int) -> Iterator[tuple[int, int, int]]:
    """Yield the fields of a message from `at` to `end`: field number, first byte, and one past the last byte.

    A field that holds a number has (0, 0) for the bytes if it is zero, else (0, -1).

    Raises:
        IndexError, ValueError: the message is damaged.
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
    """Return a number, encoded in seven bits per byte, and one past its last byte."""
    value = 0
    for i in range(10):
        byte = content[at + i]
        value |= (byte & 127) << 7 * i
        if byte < 128:
            return value, at + i + 1
    raise ValueError("a number of more than ten bytes")
