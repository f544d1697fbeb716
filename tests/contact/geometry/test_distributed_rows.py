"""Rows that ranks share have the numbers that one rank would give them."""

from __future__ import annotations

import numpy as np
import pytest

from gossamer_fx.core.algebra.rank_exchange import RankExchange
from gossamer_fx.mechanics.contact.geometry.facets import DistributedRows
from gossamer_fx.mechanics.contact.geometry.surface_share import SharedPoints, SurfacePoints


@pytest.mark.mpi
def test_rows_are_numbered_in_their_order_on_any_number_of_ranks(comm):
    rng = np.random.default_rng(comm.rank)
    rows = np.unique(rng.integers(0, 9, size=(20, 2)), axis=0)
    found = DistributedRows(comm, rows, bound=9)
    everything = np.concatenate(comm.allgather(rows))
    distinct = np.unique(everything, axis=0)
    assert found.count == len(distinct)
    assert np.array_equal(distinct[found.numbers], rows)
    # A row has the lowest rank that has it.
    of_rank = np.repeat(np.arange(comm.size), comm.allgather(len(rows)))
    for row, owner in zip(rows, found.owners, strict=True):
        assert owner == of_rank[(everything == row).all(axis=1)].min()


@pytest.mark.mpi
def test_values_of_a_row_are_summed_over_the_ranks_that_have_it(comm):
    # Each rank has the rows from its number on; row k is on k + 1 ranks, or on all.
    rows = np.arange(comm.rank, 6)[:, None]
    found = DistributedRows(comm, rows, bound=6)
    sums = found.sums(np.full(len(rows), 1.0))
    assert sums.tolist() == [min(k + 1, comm.size) for k in range(comm.rank, 6)]


@pytest.mark.mpi
def test_a_rank_without_rows_takes_part(comm):
    rows = np.zeros((0, 2), dtype=np.int64)
    if comm.rank == comm.size - 1:
        rows = np.array([[3, 1], [3, 2]])
    found = DistributedRows(comm, rows, bound=4)
    assert found.count == 2
    assert found.numbers.tolist() == list(range(len(rows)))


@pytest.mark.mpi
def test_answers_come_back_in_the_order_of_the_questions(comm):
    rng = np.random.default_rng(comm.rank)
    ranks = rng.integers(0, comm.size, size=50)
    exchange = RankExchange(comm, ranks)
    asked = 100 * comm.rank + np.arange(50)
    received = exchange.send(asked)
    assert (received // 100 == exchange.source).all()
    answers = exchange.answer(np.stack([received, np.full(len(received), comm.rank)], axis=1))
    assert np.array_equal(answers[:, 0], asked)
    assert np.array_equal(answers[:, 1], ranks)
    # Messages go only to ranks for which there are rows.
    assert exchange.message_count == len(set(ranks.tolist()) - {comm.rank})


@pytest.mark.mpi
def test_a_point_has_one_value_on_all_ranks_that_know_it(comm):
    """That of its owner, the least one, or the sum; each rank knows most of twelve points, of which
    the ranks own every second, or third and so on."""
    rng = np.random.default_rng(comm.rank)
    every: np.ndarray = np.arange(12)
    owner = every % comm.size
    number = every[(owner == comm.rank) | (rng.uniform(size=12) < 0.7)]
    nothing = np.zeros(len(number), dtype=np.int64)
    points = SurfacePoints(
        number=number,
        owner=owner[number],
        body=nothing,
        nodes=number[:, None],
        weights=np.ones((len(number), 1)),
        area=np.ones(len(number)),
    )
    shared = SharedPoints(comm, points)
    assert np.array_equal(shared.is_own, owner[number] == comm.rank)

    values = rng.uniform(size=len(number))
    of_ranks = comm.allgather((comm.rank, number, values))
    table = np.full((comm.size, 12), np.nan)
    for rank, numbers, values_there in of_ranks:
        table[rank, numbers] = values_there

    spread = values.copy()
    shared.spread(spread)
    assert np.array_equal(spread, table[owner[number], number])
    least = values.copy()
    shared.take_minimum(least)
    assert np.array_equal(least, np.nanmin(table, axis=0)[number])
    sums = values.copy()
    shared.take_sum(sums)
    assert sums == pytest.approx(np.nansum(table, axis=0)[number], rel=1e-15)
