"""Rows of values that ranks share out are found by their names."""

import json

import numpy as np
import pytest

from gossamer_fx.core.algebra.named_rows import NamedRows


def rows(names: list[int]) -> NamedRows:
    """Rows of two values, the name and ten times the name."""
    at = np.array(names, dtype=np.int64)
    return NamedRows(at, np.stack([at, 10.0 * at], axis=1))


def test_rows_are_found_by_name_in_any_order() -> None:
    kept = rows([5, -2, 9])
    assert kept.of(np.array([9, 5])).tolist() == [[9, 90], [5, 50]]
    same = kept.of(kept.names)
    same[:] = 0
    assert kept.values[0].tolist() == [5, 50]


def test_a_name_without_a_row_gets_what_is_given_or_is_refused() -> None:
    kept = rows([5, 7])
    usual = np.full((3, 2), 0.5)
    assert kept.of(np.array([7, 6, 8]), usual).tolist() == [[7, 70], [0.5, 0.5], [0.5, 0.5]]
    assert usual.min() == 0.5
    with pytest.raises(LookupError, match="2 rows are missing"):
        kept.of(np.array([7, 6, 8]))
    nothing = rows([])
    assert nothing.of(np.array([1]), np.ones((1, 2))).tolist() == [[1, 1]]
    with pytest.raises(LookupError, match="1 rows are missing"):
        nothing.of(np.array([1]))


@pytest.mark.parametrize("names", [[], [4], [2**62, -3]])
def test_rows_come_back_from_json(names: list[int]) -> None:
    data = json.loads(json.dumps(rows(names).as_data()))
    assert NamedRows.is_data(data)
    back = NamedRows.of_data(data)
    assert back.names.tolist() == names
    assert back.values.shape == (len(names), 2)
    assert np.array_equal(back.values, rows(names).values)


def test_other_words_are_no_rows() -> None:
    for value in ({}, {"names": []}, [1], "names", {"names": [], "values": []}):
        assert not NamedRows.is_data(value)


@pytest.mark.mpi
def test_each_rank_gets_the_rows_of_all_once(comm) -> None:
    # Each rank has the row 100, and one that no other has; the last one has two.
    mine = [100, comm.size - comm.rank]
    if comm.rank == comm.size - 1:
        mine.append(-7)
    found = rows(mine).of_all_ranks(comm)
    assert found.names.tolist() == [-7, *range(1, comm.size + 1), 100]
    assert np.array_equal(found.values[:, 1], 10.0 * found.names)
