"""A model of the time of a Newton iteration on many cores, from what one core needs.

Parts of an iteration of the free sheet are timed on one core at two sizes.  Laws, forms, incomplete
factorisations and vectors are linear functions of the unknowns of a rank; the constant is what the
interpreter needs.  A rank also factorises what its part overlaps of others.  The coarse matrix is
factorised on every rank, and its costs are power laws of its size; where it has a V-cycle, it is
smoothed in parts, and each rank factorises the matrix of the large patches.

Messages and reductions are those that `rank_counts` counts in a Krylov iteration.  Cores are taken
to be as fast together as one alone: the memory of a node that all its cores use is not modelled.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from newton_times import profile

from gossamer_fx.solve.solvers.coarse_space import (
    MAX_UNKNOWNS_FACTORISED,
    NODES_PER_LARGE_PATCH,
    NODES_PER_PATCH,
)
from gossamer_fx.solve.solvers.factorisation import OVERLAP

Figures = dict[str, float]

# Coarse unknowns of a patch of flat film, and unknowns of a node.
COARSE_UNKNOWNS_OF_PATCH = 9
UNKNOWNS_OF_NODE = 3
BYTES_OF_NUMBER = 8

# What a rank with neighbours on all sides needs for a Krylov iteration and its share of Newton's,
# as `./gossamer bench rank_counts` counts: messages to each neighbour and reductions, where the
# coarse matrix is factorised and where it has a V-cycle.
NEIGHBOURS = 8
MESSAGES_TO_NEIGHBOUR = {"factorised": 6.0, "V-cycle": 17.0}
REDUCTIONS = {"factorised": 7.0, "V-cycle": 11.0}
# Krylov iterations for one of Newton's on one rank, and the factor on eight ranks or more.
KRYLOV = 5.0
KRYLOV_GROWTH = 1.3
# Smoothing of the coarse level: sweeps of an incomplete factorisation in a V-cycle.
SWEEPS = 4

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
    """Times of an iteration [s], fitted to the profiles of a small and a large sheet."""

    def __init__(self, small: Figures, large: Figures) -> None:
        self._sizes = small["dofs"], large["dofs"]
        self._small = small
        self._large = large
        self.forms = self._line("law", "residual", "tangent")
        self.vectors = self._line("rest")
        self.factors = self._line("incomplete factorisation")
        self.applications = self._line("applications", per_krylov=True)
        self.coarse_matrix = self._line("coarse matrix")
        self.coarse_factors = self._power("coarse factors")
        self.coarse_solution = self._power("coarse solutions", per_krylov=True)

    def _seconds(self, parts: tuple[str, ...], per_krylov: bool) -> tuple[float, float]:
        """Seconds of some parts in an iteration of the small and the large sheet."""
        both = []
        for figures in (self._small, self._large):
            seconds = sum(figures[f"{part} [ms]"] for part in parts) / 1e3
            both.append(seconds / figures["Krylov/Newton"] if per_krylov else seconds)
        return both[0], both[1]

    def _line(self, *parts: str, per_krylov: bool = False) -> Line:
        small, large = self._seconds(parts, per_krylov)
        slope = (large - small) / (self._sizes[1] - self._sizes[0])
        return Line(max(small - slope * self._sizes[0], 0.0), slope)

    def _power(self, part: str, per_krylov: bool = False) -> Power:
        small, large = self._seconds((part,), per_krylov)
        of_small, of_large = (_coarse_unknowns(size, 1, NODES_PER_PATCH) for size in self._sizes)
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
        with_overlap = own * _enlargement(side, ranks)
        set_up, solution = self._coarse(unknowns, ranks)
        sides, neighbours = _neighbours(ranks)
        sent = sides * side * OVERLAP * UNKNOWNS_OF_NODE * BYTES_OF_NUMBER
        solver = "factorised" if _is_factorised(unknowns, ranks) else "V-cycle"
        exchange = neighbours * LATENCY + sent / BANDWIDTH
        reduction = math.ceil(math.log2(ranks)) * LATENCY
        constant = (
            self.forms.constant
            + self.vectors.constant
            + self.factors.constant
            + self.coarse_matrix.constant
            + krylov * self.applications.constant
        )
        return {
            "laws and forms": self.forms.slope * own,
            "incomplete factors": self.factors.slope * with_overlap
            + krylov * self.applications.slope * with_overlap,
            "vectors": self.vectors.slope * own,
            "coarse matrix": self.coarse_matrix.slope * own,
            "coarse factors": set_up,
            "coarse solutions": krylov * solution,
            "messages": krylov * MESSAGES_TO_NEIGHBOUR[solver] * exchange,
            "reductions": krylov * REDUCTIONS[solver] * reduction,
            "interpreter": constant,
        }

    def _coarse(self, unknowns: float, ranks: int) -> tuple[float, float]:
        """Seconds of the factors of the coarse space, and of one solution."""
        coarse = _coarse_unknowns(unknowns, ranks, NODES_PER_PATCH)
        if _is_factorised(unknowns, ranks):
            return self.coarse_factors(coarse), self.coarse_solution(coarse)
        large = _coarse_unknowns(unknowns, ranks, NODES_PER_LARGE_PATCH)
        own = coarse / ranks
        factors = self.factors.slope * own + self.coarse_factors(large)
        smoothing = SWEEPS * self.applications.slope * own
        return factors, smoothing + self.coarse_solution(large)


def _coarse_unknowns(unknowns: float, ranks: int, nodes_of_patch: int) -> int:
    """Coarse unknowns of a sheet, whose nodes of a rank are halved until patches are small
    enough."""
    nodes = unknowns / UNKNOWNS_OF_NODE / ranks
    halvings = max(math.ceil(math.log2(nodes / nodes_of_patch)), 0)
    return ranks * 2**halvings * COARSE_UNKNOWNS_OF_PATCH


def _is_factorised(unknowns: float, ranks: int) -> bool:
    """Whether the coarse matrix is factorised; else it has a V-cycle."""
    return _coarse_unknowns(unknowns, ranks, NODES_PER_PATCH) * ranks <= MAX_UNKNOWNS_FACTORISED


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


def _enlargement(side: float, ranks: int) -> float:
    """Nodes of a rank's part with overlap over those without."""
    sides, _ = _neighbours(ranks)
    return (1 + sides * OVERLAP / (2 * side)) ** 2


def scaling_model(small: int = 40, large: int = 160, steps: int = 3) -> Figures:
    """Predicted speed-ups of sheets of some sizes on many cores; prints the parts of an iteration,
    and as the first bottleneck the part that exceeds its share of one core's time by most."""
    fitted = Model(profile(small, steps), profile(large, steps))
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
