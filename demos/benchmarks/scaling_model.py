"""A model of the time of a Newton iteration on many cores, from what one core needs.

Parts of an iteration of the free sheet are timed on one core at two sizes.  Laws, forms, incomplete
factorisations and vectors are linear functions of the unknowns of a rank; the constant is what the
interpreter needs.  A rank also factorises what its part overlaps of others.  The coarse matrix is
factorised on every rank, and its costs are power laws of its size.  The costs of a V-cycle, timed
on one core, are linear, too, but that its smoother overlaps by a patch; one rank factorises the
matrix of its last level.

Messages and reductions are those that `rank_counts` counts in a Krylov iteration.  Of the last
levels the rank with most of them has one message each way for each large patch of its group, and
for each rank with unknowns of the last level.  Cores are taken to be as fast together as one alone:
the memory of a node that all its cores use is not modelled.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from newton_times import choose_levels, profile

from gossamer_fx.solve.solvers.coarse_space import (
    MAX_UNKNOWNS_FACTORISED,
    MAX_UNKNOWNS_ON_ONE_RANK,
    NODES_PER_LARGE_PATCH,
    NODES_PER_PATCH,
    PATCHES_PER_GROUP,
)
from gossamer_fx.solve.solvers.factorisation import OVERLAP

Figures = dict[str, float]

# Coarse unknowns of a patch of flat film, and unknowns of a node.
COARSE_UNKNOWNS_OF_PATCH = 9
UNKNOWNS_OF_NODE = 3
BYTES_OF_NUMBER = 8

# What a rank with neighbours on all sides needs for a Krylov iteration and its share of Newton's,
# as `./gossamer bench rank_counts` counts on eight ranks for a coarse space of one, two and three
# levels: messages to each neighbour and reductions.
NEIGHBOURS = 8
MESSAGES_TO_NEIGHBOUR = {1: 6.6, 2: 12.2, 3: 16.9}
REDUCTIONS = {1: 7.4, 2: 7.8, 3: 8.2}
# Krylov iterations for one of Newton's on one rank, and the factor on eight ranks or more.
KRYLOV = 5.0
KRYLOV_GROWTH = 1.3
# Patches by which the smoothed parts of a V-cycle overlap.
OVERLAP_OF_PATCHES = 1

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


class Power(NamedTuple):
    """Seconds that grow with a power of the coarse unknowns."""

    factor: float
    exponent: float

    def __call__(self, coarse_unknowns: float) -> float:
        return self.factor * coarse_unknowns**self.exponent


class Model:
    """Times of an iteration [s], fitted to the profiles of a small and a large sheet, and to those
    with a V-cycle."""

    def __init__(self, sheets: tuple[Figures, Figures], cycles: tuple[Figures, Figures]) -> None:
        self._sizes = sheets[0]["dofs"], sheets[1]["dofs"]
        self.forms = self._line(sheets, "law", "residual", "tangent")
        self.vectors = self._line(sheets, "rest")
        self.factors = self._line(sheets, "incomplete factorisation")
        self.applications = self._line(sheets, "applications", per_krylov=True)
        self.coarse_matrix = self._line(sheets, "coarse matrix")
        self.coarse_factors = self._power(sheets, "coarse factors")
        self.coarse_solution = self._power(sheets, "coarse solutions", per_krylov=True)
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
        small, large = self._seconds(sheets, parts, per_krylov)
        slope = (large - small) / (self._sizes[1] - self._sizes[0])
        return Line(max(small - slope * self._sizes[0], 0.0), slope)

    def _power(self, sheets: tuple[Figures, Figures], part: str, per_krylov: bool = False) -> Power:
        small, large = self._seconds(sheets, (part,), per_krylov)
        of_small, of_large = (_levels(size, 1)[0] for size in self._sizes)
        exponent = math.log(large / small) / math.log(of_large / of_small)
        return Power(large / of_large**exponent, exponent)

    def parts(self, unknowns: float, ranks: int) -> dict[str, float]:
        """Seconds of the parts of an iteration of a sheet on some ranks."""
        own = unknowns / ranks
        krylov = KRYLOV
        if ranks > 1:
            # Between one rank and eight the factor grows with the logarithm.
            krylov *= KRYLOV_GROWTH ** min(math.log2(ranks) / 3, 1.0)
        side = math.sqrt(own / UNKNOWNS_OF_NODE)
        with_overlap = own * _enlargement(side, OVERLAP, ranks)
        sides, neighbours = _neighbours(ranks)
        sent = sides * side * OVERLAP * UNKNOWNS_OF_NODE * BYTES_OF_NUMBER
        messages = MESSAGES_TO_NEIGHBOUR[1] * (neighbours * LATENCY + sent / BANDWIDTH)
        reduction = math.ceil(math.log2(ranks)) * LATENCY
        constant = (
            self.forms.constant
            + self.vectors.constant
            + self.factors.constant
            + self.coarse_matrix.constant
            + krylov * (self.applications.constant + self.prolongations.constant)
        )
        levels = _levels(unknowns, ranks)
        cycle = 0.0
        if len(levels) > 1:
            side_in_patches = math.sqrt(levels[0] / COARSE_UNKNOWNS_OF_PATCH / ranks)
            cycle = (self.cycle_set_up.slope + krylov * self.cycle.slope) * own
            cycle *= _enlargement(side_in_patches, OVERLAP_OF_PATCHES, ranks)
            constant += self.cycle_set_up.constant + krylov * self.cycle.constant
            sent = sides * side_in_patches * COARSE_UNKNOWNS_OF_PATCH * BYTES_OF_NUMBER
            more = MESSAGES_TO_NEIGHBOUR[len(levels)] - MESSAGES_TO_NEIGHBOUR[1]
            messages += more * (neighbours * LATENCY + sent / BANDWIDTH)
            messages += 2 * _partners_of_last_levels(levels, ranks) * LATENCY
        return {
            "laws and forms": self.forms.slope * own,
            "incomplete factors": self.factors.slope * with_overlap
            + krylov * self.applications.slope * with_overlap,
            "vectors": self.vectors.slope * own,
            "coarse matrix": (self.coarse_matrix.slope + krylov * self.prolongations.slope) * own,
            "V-cycle": cycle,
            "last level": self.coarse_factors(levels[-1])
            + krylov * self.coarse_solution(levels[-1]),
            "messages": krylov * messages,
            "reductions": krylov * REDUCTIONS[len(levels)] * reduction,
            "interpreter": constant,
        }


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
        partners += PATCHES_PER_GROUP
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
