"""A model of the time of a Newton iteration on many cores, from what one core needs.

Parts of an iteration of the free sheet are timed on one core at two sizes.  Laws, forms, incomplete
factorisations and vectors are linear functions of the unknowns of a rank; the constant is what the
interpreter needs.  Several ranks also copy their parts, and factorise what these overlap of others.
The costs of a V-cycle are linear, too, and its parts overlap by patches.  The factorisation
of the coarse matrix, which all ranks make, or of the last level of a V-cycle is timed for its size.

Messages and reductions are those that `rank_counts` counts in a Krylov iteration.  Of the last
levels the rank with most of them has one message each way for each large patch of its group, and
for each rank with unknowns of the last level.  Cores are taken to be as fast together as one alone:
the memory of a node that all its cores use is not modelled.
"""

from __future__ import annotations

import math
import time
from functools import cache
from typing import NamedTuple

import numpy as np
from newton_times import choose_levels, profile
from petsc4py import PETSc
from scipy.sparse import csr_matrix, diags, eye, kron

from gossamer_fx.solve.solvers import factorisation
from gossamer_fx.solve.solvers.coarse_space import (
    MAX_UNKNOWNS_FACTORISED,
    MAX_UNKNOWNS_ON_ONE_RANK,
    NODES_PER_LARGE_PATCH,
    NODES_PER_PATCH,
    PATCHES_PER_GROUP,
    SMOOTHER_OVERLAP,
)
from gossamer_fx.solve.solvers.factorisation import OVERLAP

Figures = dict[str, float]

# Coarse unknowns of a patch of flat film, and unknowns of a node.
COARSE_UNKNOWNS_OF_PATCH = 9
UNKNOWNS_OF_NODE = 3
BYTES_OF_NUMBER = 8

# What `./gossamer bench rank_counts` counts on eight ranks for the sheet of 44 thousand unknowns,
# with a coarse space of one, two and three levels: messages to each neighbour and reductions for a
# Krylov iteration and its share of Newton's.
MESSAGES_TO_NEIGHBOUR = {1: 8.6, 2: 8.8, 3: 11.7}
# Of them those of the mesh; the others are short.
MESSAGES_OF_MESH = 6.2
REDUCTIONS = {1: 7.3, 2: 6.7, 3: 7.0}
# Krylov iterations there over those of one rank.  Of linear solves to 1e-8 (`-gx_ksp_rtol 1e-8`),
# as the few of ordinary solves differ by a tenth from one division of the mesh to the next; means
# of six divisions or more, whose standard deviation is 0.06.
KRYLOV_GROWTH = {1: 1.17, 2: 1.29, 3: 1.37}
# Krylov iterations for one of Newton's on one rank.
KRYLOV = 5.0
# Neighbours of a rank that has some on all sides.
NEIGHBOURS = 8
# Solutions whose mean time is taken.
SOLUTIONS = 20
# Set-ups of the coarse space for one of Newton's iterations: one in a step.
COARSE_SET_UPS = 0.27

# A cluster, assumed: latency between nodes [s], and bandwidth of a node [bytes/s], 200 Gbit/s of
# HDR InfiniBand, that its ranks share.  A reduction takes ⌈log2 ranks⌉ latencies (doubling:
# Thakur, Rabenseifner & Gropp, IJHPCA 19 (2005) 49).
LATENCY = 2e-6
RANKS_OF_NODE = 64
BANDWIDTH = 25e9 / RANKS_OF_NODE

CORES = (2, 16, 128, 1024)
SIZES = (1e5, 1e6, 1e7)


class Line(NamedTuple):
    """Seconds that grow linearly with the unknowns."""

    constant: float
    slope: float


class Model:
    """Times of an iteration [s], fitted to the profiles of a small and a large sheet, and to those
    with a V-cycle."""

    def __init__(self, sheets: tuple[Figures, Figures], cycles: tuple[Figures, Figures]) -> None:
        self._sizes = sheets[0]["dofs"], sheets[1]["dofs"]
        self.forms = self._line(sheets, "law", "residual", "tangent")
        self.vectors = self._line(sheets, "rest")
        self.factors = self._line(sheets, "incomplete factorisation")
        small, large = (figures["copy on several ranks [s]"] for figures in sheets)
        self.copies = self._fitted(small, large)
        self.applications = self._line(sheets, "applications", per_krylov=True)
        self.coarse_matrix = self._line(sheets, "coarse matrix")
        self.prolongations = self._line(sheets, "prolongations", per_krylov=True)
        self.cycle_set_up = self._line(cycles, "coarse factors")
        self.cycle = self._line(cycles, "coarse solutions", per_krylov=True)

    def _seconds(
        self, sheets: tuple[Figures, Figures], parts: tuple[str, ...], per_krylov: bool
    ) -> tuple[float, float]:
        """Seconds of some parts in an iteration of the small and the large sheet."""
        both = []
        for figures in sheets:
            seconds = sum(figures[f"{part} [ms]"] for part in parts) / 1e3
            both.append(seconds / figures["Krylov/Newton"] if per_krylov else seconds)
        return both[0], both[1]

    def _line(self, sheets: tuple[Figures, Figures], *parts: str, per_krylov: bool = False) -> Line:
        return self._fitted(*self._seconds(sheets, parts, per_krylov))

    def _fitted(self, small: float, large: float) -> Line:
        """The line through the seconds of the small and the large sheet."""
        slope = (large - small) / (self._sizes[1] - self._sizes[0])
        return Line(max(small - slope * self._sizes[0], 0.0), slope)

    def parts(self, unknowns: float, ranks: int) -> dict[str, float]:
        """Seconds of the parts of an iteration of a sheet on some ranks."""
        own = unknowns / ranks
        levels = _levels(unknowns, ranks)
        # Between one rank and eight the factor grows with the logarithm.
        krylov = KRYLOV * KRYLOV_GROWTH[len(levels)] ** min(math.log2(ranks) / 3, 1.0)
        side = math.sqrt(own / UNKNOWNS_OF_NODE)
        with_overlap = own * _enlargement(side, OVERLAP, ranks)
        sides, neighbours = _neighbours(ranks)
        sent = sides * side * OVERLAP * UNKNOWNS_OF_NODE * BYTES_OF_NUMBER
        messages = MESSAGES_OF_MESH * (neighbours * LATENCY + sent / BANDWIDTH)
        more = MESSAGES_TO_NEIGHBOUR[len(levels)] - MESSAGES_OF_MESH
        messages += more * neighbours * LATENCY
        reduction = math.ceil(math.log2(ranks)) * LATENCY
        constant = (
            self.forms.constant
            + self.vectors.constant
            + self.factors.constant
            + self.coarse_matrix.constant
            + krylov * (self.applications.constant + self.prolongations.constant)
        )
        cycle = 0.0
        if len(levels) > 1:
            side_in_patches = math.sqrt(levels[0] / COARSE_UNKNOWNS_OF_PATCH / ranks)
            cycle = (self.cycle_set_up.slope + krylov * self.cycle.slope) * own
            cycle *= _enlargement(side_in_patches, SMOOTHER_OVERLAP, ranks)
            constant += self.cycle_set_up.constant + krylov * self.cycle.constant
            sent = sides * side_in_patches * COARSE_UNKNOWNS_OF_PATCH * BYTES_OF_NUMBER
            messages += more * sent / BANDWIDTH
            messages += 2 * _partners_of_last_levels(levels, ranks) * LATENCY
        factors, solution = factorised(levels[-1], by_mumps=len(levels) == 1)
        copies = self.copies.slope if ranks > 1 else 0.0
        return {
            "laws and forms": self.forms.slope * own,
            "incomplete factors": with_overlap
            * (copies + self.factors.slope + krylov * self.applications.slope),
            "vectors": self.vectors.slope * own,
            "coarse matrix": (self.coarse_matrix.slope + krylov * self.prolongations.slope) * own,
            "V-cycle": cycle,
            "last level": COARSE_SET_UPS * factors + krylov * solution,
            "messages": krylov * messages,
            "reductions": krylov * REDUCTIONS[len(levels)] * reduction,
            "interpreter": constant,
        }


@cache
def factorised(coarse_unknowns: int, by_mumps: bool) -> tuple[float, float]:
    """Seconds in which MUMPS or PETSc factorises a coarse matrix again, and solves with it: that of
    a square grid of patches, each coupled with its eight neighbours."""
    side = round(math.sqrt(coarse_unknowns / COARSE_UNKNOWNS_OF_PATCH))
    line = diags([1.0, 1.0, 1.0], [-1, 0, 1], shape=(side, side))
    coupled = kron(kron(line, line), np.ones((COARSE_UNKNOWNS_OF_PATCH,) * 2))
    # Positive definite, as the diagonal exceeds the sum of the others in a row.
    A = csr_matrix(coupled + 100.0 * eye(coupled.shape[0]))
    index = PETSc.IntType
    matrix = PETSc.Mat().createAIJ(
        A.shape, csr=(A.indptr.astype(index), A.indices.astype(index), A.data)
    )
    x, b = matrix.createVecs()
    b.set(1.0)
    pc = PETSc.PC().create()
    pc.setType("lu")
    if by_mumps:
        factorisation.choose(pc)
    pc.setOperators(matrix)
    factorisation.set_up(pc)
    pc.apply(b, x)
    matrix.scale(2.0)
    started = time.process_time()
    factorisation.set_up(pc)
    set_up = time.process_time() - started
    started = time.process_time()
    for _ in range(SOLUTIONS):
        pc.apply(b, x)
    return set_up, (time.process_time() - started) / SOLUTIONS


def _levels(unknowns: float, ranks: int) -> list[int]:
    """Coarse unknowns of a sheet, of the levels of its coarse space from the finest: the nodes of a
    rank are halved until patches are small enough, and large patches until groups are."""
    nodes = unknowns / UNKNOWNS_OF_NODE / ranks
    patches = ranks * _parts(nodes / NODES_PER_PATCH)
    levels = [patches * COARSE_UNKNOWNS_OF_PATCH]
    if levels[0] * ranks > MAX_UNKNOWNS_FACTORISED:
        large_patches = ranks * _parts(nodes / NODES_PER_LARGE_PATCH)
        levels.append(large_patches * COARSE_UNKNOWNS_OF_PATCH)
        if levels[1] > MAX_UNKNOWNS_ON_ONE_RANK:
            groups = _parts(large_patches / PATCHES_PER_GROUP)
            levels.append(groups * COARSE_UNKNOWNS_OF_PATCH)
    return levels


def _parts(excess: float) -> int:
    """The number of parts of a set with too many members by this factor, by halving it."""
    return int(2 ** max(math.ceil(math.log2(excess)), 0))


def _partners_of_last_levels(levels: list[int], ranks: int) -> int:
    """Ranks with which the first one exchanges unknowns of the last levels of a V-cycle."""
    partners = min(ranks, levels[-1] // COARSE_UNKNOWNS_OF_PATCH)
    if len(levels) > 2:
        large_patches = levels[1] / COARSE_UNKNOWNS_OF_PATCH
        partners += math.ceil(PATCHES_PER_GROUP * ranks / large_patches)
    return partners - 1


def _neighbours(ranks: int) -> tuple[float, int]:
    """Sides of a rank's part that it shares, in lengths of a square of the same area, and its
    neighbours, of the rank with most of them."""
    if ranks == 1:
        return 0.0, 0
    if ranks == 2:
        # Halves of a square share its side.
        return math.sqrt(2), 1
    if ranks == 4:
        return 2.0, 3
    return 4.0, NEIGHBOURS


def _enlargement(side: float, overlap: int, ranks: int) -> float:
    """The size of a rank's part with overlap over that without; both are counted in cells or
    patches."""
    sides, _ = _neighbours(ranks)
    return (1 + sides * overlap / (2 * side)) ** 2


def scaling_model(small: int = 40, large: int = 160, steps: int = 3) -> Figures:
    """Predicted speed-ups of sheets of some sizes on many cores; prints the parts of an iteration,
    and as the first bottleneck the part that exceeds its share of one core's time by most."""
    choose_levels(1)
    sheets = profile(small, steps), profile(large, steps)
    choose_levels(3)
    cycles = profile(small, steps), profile(large, steps)
    fitted = Model(sheets, cycles)
    figures = {}
    for unknowns in SIZES:
        on_one = fitted.parts(unknowns, 1)
        for cores in CORES:
            parts = fitted.parts(unknowns, cores)
            seconds = sum(parts.values())
            speed_up = sum(on_one.values()) / seconds
            excess = {what: part - on_one[what] / cores for what, part in parts.items()}
            bottleneck = max(excess, key=excess.__getitem__)
            milliseconds = ", ".join(f"{what} {1e3 * part:.2g}" for what, part in parts.items())
            print(f"{unknowns:.0e} unknowns on {cores} cores: speed-up {speed_up:.3g},")
            print(f"    efficiency {speed_up / cores:.0%}, first bottleneck {bottleneck}")
            print(f"    {1e3 * seconds:.3g} ms: {milliseconds}")
            figures[f"{unknowns:.0e} on {cores}"] = speed_up
    return figures
