import dataclasses

import numpy as np
import pytest

from evaluation.described import make_objects, on_circle
from lookonce.evaluation import DescribedObjects


def _fields():
    objects = make_objects(on_circle([0, 1, 2]), [1, 2, 3], [0, 0, 1])
    return {field.name: getattr(objects, field.name) for field in dataclasses.fields(objects)}


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        pytest.param(
            "descriptors",
            np.eye(3),
            r"descriptors: expected \(N, D\) float32, got \(3, 3\) float64",
            id="descriptor-dtype",
        ),
        pytest.param("descriptors", np.zeros((3, 2), np.float32), "unit length", id="zero-vector"),
        pytest.param("descriptors", np.full((3, 2), np.nan, np.float32), "unit length", id="nan-vector"),
        pytest.param("identities", [1, 2, 3], r"identities: expected \(3,\) int64, got list", id="list"),
        pytest.param("identities", np.zeros(2, np.int64), r"identities: expected \(3,\) int64, got \(2,\)", id="rows"),
        pytest.param("sequences", np.zeros(3, np.int32), "sequences: .* int32", id="sequence-dtype"),
        pytest.param("frames", np.array([0, -1, 2]), "frames: expected 0 to", id="negative-frame"),
        pytest.param("frames", np.array([0, 1, 2**31]), "frames: expected 0 to", id="frame-too-late"),
        pytest.param("times_s", np.array([0, 1, np.inf]), "times_s: expected finite", id="time"),
        pytest.param("heights_px", np.array([1, 0, 1], np.float32), "heights_px: .* above 0", id="no-height"),
        pytest.param("widths_px", np.array([1, np.nan, 1], np.float32), "widths_px: .* above 0", id="nan-width"),
    ],
)
def test_wrong_field_is_refused(field, value, message):
    with pytest.raises(ValueError, match=message):
        DescribedObjects(**{**_fields(), field: value})


@pytest.mark.parametrize(
    "rows",
    [
        pytest.param(np.array([2, 0]), id="rows"),
        pytest.param(np.array([True, False, True]), id="mask"),
        pytest.param(slice(1, 3), id="slice"),
        pytest.param(np.zeros(0, np.int64), id="none"),
    ],
)
def test_chosen_rows_keep_all_fields_aligned(rows):
    fields = _fields()
    chosen = DescribedObjects(**fields)[rows]
    for name, values in fields.items():
        np.testing.assert_array_equal(getattr(chosen, name), values[rows])
    assert len(chosen) == len(fields["frames"][rows])
