"""fp16 and int8 networks lose little PSNR at the end of a sequence."""

from studies.precision import (
    PRECISIONS,
    markdown_table,
    measure_precision,
    precision_record,
)


def test_each_precision_is_scored_where_references_are_and_costs_little() -> None:
    frames = 0

    def count() -> None:
        nonlocal frames
        frames += 1

    results = measure_precision(["court"], ["classifier-small"], (64, 36), 32, samples=4, on_frame=count)
    assert frames == 32
    assert [r.precision for r in results] == list(PRECISIONS)
    first, half, small = results
    assert 15.0 < first.psnr < 45.0
    assert abs(half.psnr - first.psnr) < 0.05
    assert abs(small.psnr - first.psnr) < 0.5
    assert abs(small.tpsnr - first.tpsnr) < 0.5
    table = markdown_table(precision_record(results, (64, 36), 32, 2.0))
    assert f"| court | classifier-small | {first.psnr:.2f} |" in table
