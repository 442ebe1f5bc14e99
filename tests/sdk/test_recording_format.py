"""Records come back as they were written, whatever numbers they hold; bytes of a stranger do no harm."""

import json
import struct
import tempfile
import zlib
from pathlib import Path

import hypothesis.extra.numpy as arrays_of
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from supersampler.errors import RecordingError
from supersampler.recording.format import MAGIC, Record, RecordWriter, is_recording, read_records

NUMBERS = st.one_of(
    arrays_of.boolean_dtypes(),
    arrays_of.integer_dtypes(endianness="?"),
    arrays_of.unsigned_integer_dtypes(endianness="?"),
    arrays_of.floating_dtypes(endianness="?", sizes=(16, 32, 64)),
)
ARRAYS = arrays_of.arrays(NUMBERS, arrays_of.array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=3))
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=4,
)
RECORDS = st.builds(
    Record,
    st.text(),
    st.dictionaries(st.text().filter(lambda name: name not in ("record", "arrays")), JSON, max_size=2),
    st.dictionaries(st.text(), ARRAYS, max_size=2),
)


def written(records: list[Record], folder: str) -> Path:
    path = Path(folder) / "file"
    writer = RecordWriter(path)
    for record in records:
        writer.write(record)
    writer.close()
    return path


def assert_same(one: Record, other: Record) -> None:
    assert (one.kind, one.values, list(one.arrays)) == (other.kind, other.values, list(other.arrays))
    for a, b in zip(one.arrays.values(), other.arrays.values(), strict=True):
        assert (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes())


@settings(max_examples=40)
@given(st.lists(RECORDS, max_size=2), st.data())
def test_records_come_back_and_a_cut_file_ends_with_the_last_whole_one(
    records: list[Record], data: st.DataObject
) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = written(records, folder)
        for record, again in zip(records, read_records(path), strict=True):
            assert_same(record, again)
        size = data.draw(st.integers(len(MAGIC), path.stat().st_size))
        path.write_bytes(path.read_bytes()[:size])
        for record, again in zip(records, read_records(path), strict=False):
            assert_same(record, again)


@settings(max_examples=40)
@given(st.lists(RECORDS, min_size=1, max_size=1), st.data())
def test_a_changed_byte_is_found(records: list[Record], data: st.DataObject) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = written(records, folder)
        content = bytearray(path.read_bytes())
        content[data.draw(st.integers(0, len(content) - 1))] ^= data.draw(st.integers(1, 255))
        path.write_bytes(content)
        with pytest.raises(RecordingError, match=r"damaged|is not a recording"):
            list(read_records(path))


def of_stranger(path: Path, text: bytes, data: bytes = b"") -> Path:
    head = struct.pack("<QII", len(text) + len(data), len(text), zlib.crc32(text + data))
    path.write_bytes(MAGIC + head + struct.pack("<I", zlib.crc32(head)) + text + data)
    return path


@pytest.mark.parametrize(
    "listed",
    [
        [["a", "|O", [1]]],
        [["a", "|V8", [1]]],
        [["a", "<f8,<f8", [1]]],
        [["a", "<f3", [1]]],
        [["a", "<f8", [2]]],
        [["a", "<f8", [-1]]],
        [["a", "<f8", [1.0]]],
        [["a", "<f8", [2**62, 2**62]]],
        [["a", "<f8"]],
        [["a", 8, [1]]],
        7,
    ],
)
def test_arrays_that_are_no_plain_numbers_are_refused_before_room_is_made(
    listed: object, tmp_path: Path
) -> None:
    text = json.dumps({"record": "step", "arrays": listed}).encode()
    with pytest.raises(RecordingError, match="damaged record at byte 8"):
        list(read_records(of_stranger(tmp_path / "file", text, bytes(8))))


@pytest.mark.parametrize("text", [b"", b"[]", b"{}", b"\xff", b"[" * 100_000, b'{"record": "step"}'])
def test_text_that_no_writer_writes_is_refused(text: bytes, tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="damaged record"):
        list(read_records(of_stranger(tmp_path / "file", text)))


def test_what_cannot_be_read_back_is_not_written(tmp_path: Path) -> None:
    writer = RecordWriter(tmp_path / "file")
    with pytest.raises(TypeError, match="a is object"):
        writer.write(Record("step", arrays={"a": np.array([None])}))
    with pytest.raises(ValueError, match="JSON"):
        writer.write(Record("step", {"exposure": float("nan")}))
    writer.write(Record("reset"))
    writer.close()
    assert [record.kind for record in read_records(writer.path)] == ["reset"]
    assert is_recording(writer.path)
    assert not is_recording(tmp_path)
    assert not is_recording(Path(__file__))
