"""Every pair of columns of an orthogonal array has every pair of levels equally often."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from gossamer_fx.app.sweep.orthogonal_arrays import orthogonal_array
from gossamer_fx.core.checks.errors import InputError

LEVELS = {
    "L4": [2] * 3,
    "L8": [2] * 7,
    "L9": [3] * 4,
    "L12": [2] * 11,
    "L16": [2] * 15,
    "L18": [2] + [3] * 7,
    "L27": [3] * 13,
}


@pytest.mark.parametrize("name", LEVELS)
def test_pairs_of_levels_are_equally_frequent(name):
    table = orthogonal_array(name)
    expected = (int(name[1:]), len(LEVELS[name]))
    assert table.shape == expected
    assert (table.max(axis=0) + 1).tolist() == LEVELS[name]
    for i, j in combinations(range(table.shape[1]), 2):
        counts = np.zeros((LEVELS[name][i], LEVELS[name][j]), dtype=int)
        np.add.at(counts, (table[:, i], table[:, j]), 1)
        assert (counts == counts[0, 0]).all()


def test_an_unknown_array_is_refused():
    with pytest.raises(InputError, match="L4, L8, L9, L12, L16, L18, L27"):
        orthogonal_array("L10")
