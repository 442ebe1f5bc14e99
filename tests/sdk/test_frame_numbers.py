"""Tests of ranges of frame numbers, for numbers by chance."""

import re
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from supersampler import ArgumentError
from supersampler.cli.results import FRAMES, RunRecord, read_run_record
from supersampler.io.shot.format import LARGEST_NUMBER
from supersampler.io.shot.numbered import FrameNumbers


@st.composite
def ranges(draw: st.DrawFn, largest: int = 400) -> FrameNumbers:
    """Any ascending ranges; some of them are adjacent, some are one number."""
    one_number = st.booleans()
    bounds = sorted(draw(st.lists(st.integers(-largest, largest), min_size=1, max_size=24, unique=True)))
    found: list[tuple[int, int]] = []
    while bounds:
        first = bounds.pop(0)
        found.append((first, first if not bounds or draw(one_number) else bounds.pop(0)))
    return FrameNumbers(tuple(found))


@given(ranges(LARGEST_NUMBER))
def test_the_text_of_numbers_is_parsed_to_the_same_numbers(numbers: FrameNumbers) -> None:
    assert FrameNumbers.parse(str(numbers), "--frames") == numbers
    spaced = re.sub(r"(?<=\d)-", " - ", str(numbers))
    assert FrameNumbers.parse(spaced.replace(",", " , "), "--frames") == numbers


@given(ranges())
def test_numbers_are_those_of_the_ranges_in_ascending_order(numbers: FrameNumbers) -> None:
    want = sorted({n for first, last in numbers.ranges for n in range(first, last + 1)})
    assert [*numbers] == want
    assert (len(numbers), numbers.first, numbers.last) == (len(want), want[0], want[-1])
    assert [n for n in range(-402, 402) if n in numbers] == want


@given(ranges())
def test_position_is_the_inverse_of_indexing(numbers: FrameNumbers) -> None:
    every = [*numbers]
    assert [numbers[position] for position in range(len(numbers))] == every
    assert [numbers.position(number) for number in every] == [*range(len(numbers))]
    for position in (-1, len(numbers)):
        with pytest.raises(IndexError):
            numbers[position]
    for number in {*range(-402, 402)}.difference(every):
        with pytest.raises(ValueError, match=f"{number} is not in"):
            numbers.position(number)


@given(ranges(60), ranges(60))
def test_ranges_overlap_where_they_share_a_number(one: FrameNumbers, other: FrameNumbers) -> None:
    assert one.overlaps(other) == other.overlaps(one) == (not {*one}.isdisjoint(other))


@given(ranges(LARGEST_NUMBER), ranges(LARGEST_NUMBER))
def test_labels_of_different_ranges_differ_and_are_parts_of_file_names(
    one: FrameNumbers, other: FrameNumbers
) -> None:
    assert (one.label == other.label) == (one == other)
    assert re.fullmatch(r"[0-9a-f_-]{4,80}", one.label)


@given(ranges(LARGEST_NUMBER))
def test_the_record_of_any_ranges_is_found_again(
    tmp_path_factory: pytest.TempPathFactory, numbers: FrameNumbers
) -> None:
    folder = tmp_path_factory.mktemp("out")
    record = RunRecord({FRAMES: str(numbers)}, {"####.exr": 1})
    record.write(folder)
    assert read_run_record(folder, record.file_name) == record
    assert [path.name for path in folder.iterdir()] == [record.file_name]


@given(st.text("0123456789-, ax:#", max_size=12))
def test_any_text_is_refused_or_is_that_of_ascending_numbers(text: str) -> None:
    with suppress(ArgumentError):  # and no other error
        numbers = FrameNumbers.parse(text, "--frames")
        parsed = [
            [int(number) for number in re.findall(r"(?:(?<=\d)-)?\s*(-?\d+)", part)]
            for part in text.split(",")
        ]
        assert numbers == FrameNumbers(tuple((part[0], part[-1]) for part in parsed))
        assert parsed == sorted(map(sorted, parsed))


@pytest.mark.parametrize("text", ["1000000001", "5-1000000001", "99999999999"])
def test_numbers_beyond_the_largest_are_refused(text: str) -> None:
    with pytest.raises(ArgumentError, match="want frame numbers"):
        FrameNumbers.parse(text, "--frames")
