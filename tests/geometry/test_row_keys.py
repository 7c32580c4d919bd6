"""Numbers of rows, beside what numpy finds of the rows."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from urbantwin.geometry import row_keys

FAR = 2**61


@given(
    arrays(
        np.int64,
        array_shapes(min_dims=2, max_dims=2, min_side=0, max_side=9),
        elements=st.integers(-3, 3) | st.sampled_from([-FAR, FAR, 2**31]),
    ).filter(lambda rows: rows.shape[1] > 0)
)
def test_they_are_equal_and_in_order_as_the_rows_are(rows: np.ndarray) -> None:
    wanted, found = (
        np.unique(one, axis=0, return_index=True, return_inverse=True, return_counts=True)[1:]
        for one in (rows, row_keys(rows))
    )
    for mine, theirs in zip(found, wanted, strict=True):
        np.testing.assert_array_equal(mine.ravel(), theirs.ravel())
