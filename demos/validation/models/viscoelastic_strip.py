"""A strip of viscoelastic film whose strain is that of a test.

The material is known by its creep: the strain under a constant stress is this stress times

    D(t) = D0 + Σ D_j (1 - exp(-t/τ_j))                                                         (1)

at the reference temperature T0.  The film of `gx.loads.Viscoelasticity` relaxes instead.  With the
Laplace transform s D(s) = D0 + Σ D_j/(1 + s τ_j) its modulus is

    1/(s D(s)) = 1/D0 - Σ E_k/(1 + s ρ_k),     E(t) = E∞ + Σ E_k exp(-t/ρ_k)                    (2)

where -1/ρ_k are the roots of s D(s), one between each two neighbouring -1/τ_j.

Time is shifted by temperature and stress: the material ages by dψ = dt/(a_T a_s),

    ln a_T = -(Q/R) (1/T0 - 1/T),     a_s = x/sinh x,  x = V s/(R T)                            (3)

with the activation energy Q, the activation volume V and the largest stress s so far.  The strip is
computed in ψ.  The shift of a step is that of the largest stress up to its start.
"""

from __future__ import annotations

import math
import time

import numpy as np
from mpi4py import MPI
from scipy.optimize import brentq

import gossamer_fx as gx
from demos.validation.engine.case import Array, Inputs
from demos.validation.engine.comparison import Predicted, Prediction
from gossamer_fx.extend import check
from meshes.line import line

# Of an ideal gas [J/(mol K)].
R = 8.3145
# Steps between two readings.
STEPS = 4
QUICK_STEPS = 1
# Branches that relax within this part of the shortest step do not act.
FAST = 1e-2
# A strip without inertia, as far as round-off allows [kg/m]; its section is 1 m².
LINE_DENSITY = 1e-6
# Longest step in the time of the material [s]; next to a much longer one the short steps would be
# round-off.
LONGEST = 1e6


def relaxation(instantaneous: float, compliances: Array, times: Array) -> tuple[Array, Array]:
    """E_k [Pa] and ρ_k [s] of (2).

    Args:
        instantaneous: D0 [1/Pa].
        compliances: D_j [1/Pa].
        times: τ_j [s], which grow.
    """

    def transform(s: float) -> float:
        return instantaneous + float((compliances / (1 + s * times)).sum())

    roots = []
    # Each root lies left of -1/τ of its branch; that of the fastest before D0 is reached.
    ends = [*(-1 / times).tolist()]
    first = ends[0] * (1 + compliances.sum() / instantaneous) * 2
    for right, left in zip(ends, [first, *ends[:-1]], strict=True):
        roots.append(brentq(transform, left * (1 - 1e-12), right * (1 + 1e-12), rtol=1e-14))
    s = np.array(roots)
    slopes = (compliances * times / (1 + s[:, None] * times) ** 2).sum(axis=1)
    return 1 / (-s * slopes), -1 / s


def predict(inputs: Inputs, comm: MPI.Intracomm, quick: bool) -> Prediction:
    """Stress [Pa] against time [s], and the work [J/m³] that the strip has lost at the end."""
    begun = time.process_time()
    readings = inputs.numbers("times", "s")
    strains = inputs.numbers("strains", "1")
    check(
        len(readings) == len(strains) > 2 and bool((np.diff(readings) > 0).all()),
        f"{inputs.where}: give as many strains as times, which must grow.",
    )
    instantaneous = inputs.number("instantaneous_compliance", "1/Pa", above=0)
    factor = inputs.number("compliance_factor", "1", above=0)
    branches, times = relaxation(
        factor * instantaneous,
        factor * inputs.numbers("compliances", "1/Pa"),
        inputs.numbers("retardation_times", "s"),
    )
    limit = 1 / (factor * instantaneous) - float(branches.sum())
    temperature = inputs.number("temperature", "K", above=0)
    reference = inputs.number("reference_temperature", "K", above=0)
    energy = inputs.number("activation_energy", "J/mol", above=0)
    volume = inputs.number("activation_volume", "m3/mol", above=0)
    by_stress = inputs.word("shift_by_stress", ("yes", "no")) == "yes"
    shift = float(np.exp(-energy / R * (1 / reference - 1 / temperature)))

    # Between readings strains are on straight lines.
    count = QUICK_STEPS if quick else STEPS
    parts = np.arange((len(readings) - 1) * count + 1) / count
    t = np.interp(parts, np.arange(len(readings)), readings)
    strain = np.interp(t, readings, strains)
    acts = times > FAST * np.diff(t).min() / shift
    strip = Strip(comm, limit, branches[acts] / limit, times[acts])
    stress = []
    at = []
    largest = 0.0
    for number, duration in enumerate(np.diff(t).tolist()):
        x = max(volume * largest / (R * temperature), 1e-9) if by_stress else 1e-9
        value, passed = strip.stretch(
            duration * math.sinh(x) / (shift * x), float(strain[number + 1])
        )
        stress.append(value)
        at.append(float(t[number]) + passed * duration)
        largest = max(largest, value)
    curve = np.interp(readings, at, stress)
    work = float((np.array(stress) * np.diff(strain)).sum())
    quantities = {
        "stress": Predicted(curve, readings),
        "lost work": Predicted(work),
        "largest stress": Predicted(max(stress)),
    }
    details = {
        "instantaneous modulus [Pa]": 1 / (factor * instantaneous),
        "steps": float(len(stress)),
        "seconds": time.process_time() - begun,
    }
    return Prediction(quantities, details)


class Strip:
    """A strip of 1 m² that is stretched step by step.

    Args:
        comm: ranks.
        stiffness: of the part that does not relax [Pa].
        ratios: of the branches to it.
        times: of the branches [s].
    """

    def __init__(self, comm: MPI.Intracomm, stiffness: float, ratios: Array, times: Array) -> None:
        # Times of the material [s] and strains, up to the end of the present step.
        self._times = [0.0]
        self._strains = [0.0]
        cable = gx.Cable(
            line(comm, [(0, 0, 0), (1, 0, 0)], 2),
            gx.CableLaw(EA=stiffness, line_density=LINE_DENSITY),
        )
        end = gx.Fixed(cable, "end", motion=self._moved)
        branches = gx.loads.Viscoelasticity(cable, ratios=ratios.tolist(), times=times.tolist())
        scene = gx.Scene(gx.Fixed(cable, "start"), end, branches)
        self._run = gx.Simulation(scene, gx.Midpoint(dt=LONGEST))
        self._force = gx.probes.Reaction(end, "x")

    def _moved(self, X: Array, t: float) -> Array:
        """Displacement [m] of the end, whose strain of Green is that of the test."""
        strain = np.interp(t, self._times, self._strains)
        return np.stack([(np.sqrt(1 + 2 * strain) - 1) * X[0], 0 * X[1], 0 * X[2]])

    def stretch(self, duration: float, strain: float) -> tuple[float, float]:
        """Stretch to a strain within a time of the material [s].

        Returns:
            a stress [Pa], and the part of the stretch that had passed then: half of it where one
            step was enough.
        """
        steps = self._run.step
        self._times.append(self._times[-1] + duration)
        self._strains.append(strain)
        self._run.run(until=self._times[-1])
        # The force is that in the middle of the last step, S times the stretch there.
        passed = 1 - 0.5 / (self._run.step - steps)
        before, after = self._strains[-2:]
        strain = before + passed * (after - before)
        return self._force(self._run) / math.sqrt(1 + 2 * strain), passed
