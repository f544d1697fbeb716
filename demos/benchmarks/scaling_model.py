"""A model of strong and weak scaling, from parts that are measured on one and two ranks.

A Newton iteration of a film with N unknowns on P cores takes

    t = N/P (law + m tangent + m rest) + o N/P m (factorisation + k application)      (1)
        + N/P (coarse product)/i + (coarse factorisation)/i + k (coarse solution)
        + messages (latency + bytes/bandwidth) + reductions 2 log2(P) latency

    k    Krylov iterations, i Newton iterations of a step
    o    nodes of a rank with the cells by which parts overlap, over its own: (1 + 4/s)², s =
         √(N/3P)
    m    cores of a node over those that saturate its memory, where there are more: matrices are
         streamed through memory
    rest products and vectors of the Krylov method, and what a step does once
    coarse factorisation and solution take a n^b of the coarse unknowns n = N/30, which MUMPS hardly
    divides; messages of an iteration and their bytes are those of two ranks, times the neighbours
    of a rank (6 on many ranks), bytes with the length of a boundary, √(N/P)

Measured are all parts on one rank at two sizes, and messages, bytes and reductions on two.  The
machine is described by arguments: a network's latency and bandwidth, cores of a node and how many
saturate it.
"""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path

from contestants import SELF, run
from problems import Figures

from gossamer_fx.analysis.cases.case_set import Judgement

# Cells along a side of the sheet, small and large: exponents follow from both, parts from the large
# one.
SIZES = (80, 160)
QUICK_SIZES = (40, 80)
STEPS = 3
TIMEOUT = 1800.0  # s
# Factor between a predicted and a measured iteration, beyond which the model is wrong.
LARGEST_MISS = 3.0

# Neighbours of a part of a film that is divided into many.
NEIGHBOURS = 6

# Unknowns of a node, cells by which parts overlap on each side, and unknowns over coarse ones.
NODE_SIZE = 3
OVERLAP = 2
COARSENING = 30

UNKNOWNS = (1e5, 1e6, 1e7)
CORES = (16, 128, 1024)


@dataclass(frozen=True)
class Machine:
    """What a cluster adds to the measured core.

    Attributes:
        latency: of a message [s].
        bandwidth: of messages [bytes/s].
        node_cores: cores that share a memory.
        saturating_cores: how many of them use all of its bandwidth.
    """

    latency: float = 2e-6
    bandwidth: float = 1e10
    node_cores: int = 64
    saturating_cores: int = 16

    def contention(self, cores: int) -> float:
        """By which factor a part that streams through memory takes longer than on one core."""
        return max(1.0, min(cores, self.node_cores) / self.saturating_cores)


@dataclass(frozen=True)
class PowerLaw:
    """Seconds a n^b of a part with n unknowns."""

    factor: float
    exponent: float

    @classmethod
    def through(cls, small: tuple[float, float], large: tuple[float, float]) -> PowerLaw:
        """Return the law through two points of a size and seconds."""
        exponent = math.log(large[1] / small[1]) / math.log(large[0] / small[0])
        return cls(large[1] / large[0] ** exponent, exponent)

    def seconds(self, size: float) -> float:
        return self.factor * size**self.exponent


@dataclass(frozen=True)
class Parts:
    """Measured parts of a Newton iteration; seconds are of CPU.

    Attributes:
        law, tangent, rest, factorisation, application: of one unknown [s]; of an application for
            one Krylov iteration.
        coarse_product: of one unknown and step [s].
        coarse_factorisation, coarse_solution: by number of coarse unknowns; of a step, of a Krylov
            iteration.
        newton, krylov: iterations of a step, and for one of Newton's.
        messages: of one rank to one neighbour.
        boundary_bytes: of these messages, for the root of one unknown of a rank.
        reductions: over all ranks.
    """

    law: float
    tangent: float
    rest: float
    factorisation: float
    application: float
    coarse_product: float
    coarse_factorisation: PowerLaw
    coarse_solution: PowerLaw
    newton: float
    krylov: float
    messages: float
    boundary_bytes: float
    reductions: float

    @classmethod
    def measured(cls, small: Figures, large: Figures, two: Figures) -> Parts:
        """Return the parts of one rank at two sizes, and of two ranks at the large one."""
        size = large["dofs"]
        per_unknown = {
            name: 1e-3 * large[f"{name} [ms]"] / size
            for name in (
                "law and forces",
                "tangent",
                "factorisation",
                "application",
                "coarse product",
            )
        }
        coarse = {
            name: PowerLaw.through(
                (small["dofs"] / COARSENING, 1e-3 * small[f"{name} [ms]"]),
                (size / COARSENING, 1e-3 * large[f"{name} [ms]"]),
            )
            for name in ("coarse factorisation", "coarse solution")
        }
        krylov = large["Krylov/Newton"]
        known = (
            large["law and forces [ms]"]
            + large["tangent [ms]"]
            + large["factorisation [ms]"]
            + krylov * (large["application [ms]"] + large["coarse solution [ms]"])
            + (large["coarse product [ms]"] + large["coarse factorisation [ms]"])
            / large["Newton/step"]
        )
        return cls(
            rest=1e-3 * max(large["iteration [ms]"] - known, 0.0) / size,
            law=per_unknown["law and forces"],
            tangent=per_unknown["tangent"],
            factorisation=per_unknown["factorisation"],
            application=per_unknown["application"],
            coarse_product=per_unknown["coarse product"],
            coarse_factorisation=coarse["coarse factorisation"],
            coarse_solution=coarse["coarse solution"],
            newton=large["Newton/step"],
            krylov=krylov,
            messages=two["messages"],
            boundary_bytes=two["message bytes"] / math.sqrt(two["dofs"] / 2),
            reductions=two["reductions"],
        )

    def iteration(self, unknowns: float, cores: int, machine: Machine) -> dict[str, float]:
        """Return the seconds of the parts of one Newton iteration by equation (1)."""
        local = unknowns / cores
        overlap = 1.0
        neighbours = 0
        if cores > 1:
            side = math.sqrt(local / NODE_SIZE)
            overlap = (1 + 2 * OVERLAP / side) ** 2
            neighbours = min(cores - 1, NEIGHBOURS)
        coarse = unknowns / COARSENING
        contention = machine.contention(cores)
        sent = neighbours * self.messages * machine.latency
        # A rank in the middle has boundaries on all sides, one of two has one: their bytes add up
        # to four.
        sent += min(neighbours, 4) * self.boundary_bytes * math.sqrt(local) / machine.bandwidth
        rounds = 2 * math.log2(cores)
        return {
            "law, forces": local * self.law,
            "tangent": local * self.tangent * contention,
            "rest": local * self.rest * contention,
            "factorisation": overlap * local * self.factorisation * contention,
            "application": overlap * local * self.krylov * self.application * contention,
            "coarse product": local * self.coarse_product * contention / self.newton,
            "coarse factorisation": self.coarse_factorisation.seconds(coarse) / self.newton,
            "coarse solution": self.krylov * self.coarse_solution.seconds(coarse),
            "messages": sent,
            "reductions": self.reductions * rounds * machine.latency,
        }


def predict(is_quick: bool, folder: Path) -> list[Judgement]:
    """Measure the parts, print and write predictions for `UNKNOWNS` on `CORES` to
    FOLDER/model/runs.csv; returns comparisons of predictions with measured times."""
    judgements = []
    small_size, large_size = QUICK_SIZES if is_quick else SIZES
    small = _measure(small_size, 1)
    large = _measure(large_size, 1)
    two = _measure(large_size, 2)
    parts = Parts.measured(small, large, two)
    machine = Machine()
    _print_parts(large, two, parts)
    # Messages here go through memory; both ranks have their own part of its bandwidth.
    here = Machine(
        latency=1e-6 * two["latency [us]"], bandwidth=1e9 * two["message bandwidth [GB/s]"]
    )
    for cores, found in ((1, small), (2, two)):
        expected = 1e3 * sum(parts.iteration(found["dofs"], cores, here).values())
        measured = found["iteration [ms]"]
        # On two ranks Krylov iterations are more: their parts overlap along one boundary only.
        words = (
            f"check: {cores} ranks, {found['dofs']:.0f} unknowns: predicted {expected:.1f} ms, "
            f"measured {measured:.1f} ms of CPU an iteration, {found['Krylov/Newton']:.1f} "
            "Krylov iterations"
        )
        print(words)
        is_near = measured / LARGEST_MISS < expected < LARGEST_MISS * measured
        judgements.append(Judgement(words, is_near))
    rows = [_row(parts, unknowns, cores, machine) for unknowns in UNKNOWNS for cores in CORES]
    print("unknowns cores      ms  speed-up  largest part")
    for row in rows:
        print(
            f"{row['unknowns']:8.0e} {row['cores']:5d} {row['iteration [ms]']:7.2f} "
            f"{row['speed-up']:9.0f}  "
            f"{row['largest part']}, {100 * float(row['its share']):.0f} %"
        )
    path = folder / "model" / "runs.csv"
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="") as file:
        table = csv.DictWriter(file, list(rows[0]))
        table.writeheader()
        table.writerows(rows)
    return judgements


def _measure(cells: int, ranks: int) -> Figures:
    return run("parts", SELF, {"n": cells, "steps": STEPS, "ranks": ranks}, TIMEOUT)


def _row(
    parts: Parts, unknowns: float, cores: int, machine: Machine
) -> dict[str, float | int | str]:
    """Return one prediction: time, speed-up over one core, efficiency, and the largest part."""
    of_one = sum(parts.iteration(unknowns, 1, machine).values())
    found = parts.iteration(unknowns, cores, machine)
    total = sum(found.values())
    largest = max(found, key=lambda name: found[name])
    # Weak scaling: the same unknowns a core, on one core.
    weak = sum(parts.iteration(unknowns / cores, 1, machine).values()) / total
    return {
        "unknowns": unknowns,
        "cores": cores,
        "iteration [ms]": 1e3 * total,
        "speed-up": of_one / total,
        "weak efficiency": weak,
        "largest part": largest,
        "its share": found[largest] / total,
        **{f"{name} [ms]": 1e3 * seconds for name, seconds in found.items()},
    }


def _print_parts(large: Figures, two: Figures, parts: Parts) -> None:
    """Print what was measured, for one unknown and one Newton iteration."""
    print(
        f"{large['dofs']:.0f} unknowns: law and forces {1e9 * parts.law:.0f} ns an unknown and "
        "iteration, tangent "
        f"{1e9 * parts.tangent:.0f}, factorisation {1e9 * parts.factorisation:.0f}, rest "
        f"{1e9 * parts.rest:.0f}, application {1e9 * parts.application:.0f} for each of "
        f"{parts.krylov:.1f} Krylov iterations; "
        f"{large['flops per unknown']:.0f} flops of PETSc's, "
        f"{large['matrix bytes per unknown']:.0f} bytes of matrix"
    )
    for name, law in (
        ("factorisation", parts.coarse_factorisation),
        ("solution", parts.coarse_solution),
    ):
        print(
            f"coarse {name}: {1e6 * law.seconds(1000):.0f} us of 1000 unknowns, exponent "
            f"{law.exponent:.2f}"
        )
    print(
        f"two ranks: {two['messages']:.0f} messages, {1e-3 * two['message bytes']:.0f} kB and "
        f"{two['reductions']:.0f} reductions an iteration of each rank; a message takes "
        f"{two['latency [us]']:.1f} us "
        f"here; memory {large['memory [GB/s]']:.0f} GB/s on one rank, {two['memory [GB/s]']:.0f} "
        "on each of two"
    )
