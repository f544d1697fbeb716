"""The hub of IKAROS swings in its open sail: how fast, and how its swing dies away.

The open sail spins steadily at 2.5 rpm; the hub is given a little more spin than that.  Tethers
that pull with the centrifugal force of the sail turn it back: as of a sail that is rigid in its
plane the swing has

    ω² = k (1/I + 1/J),    k = Σ T R r/l

(`ikaros.steady`).  That is for small swings: turned by θ, a tether of the length l gets longer by R
r θ²/(2 l), from some 0.003 rad on by more than the 10 µm by which its tension stretches it; tethers
and film then pull harder, and the swing gets faster.  The swing s = ω_hub - ω_sail is fitted by
exp(-δ t) (a cos ωt + b sin ωt) + c.

Sail and tethers are those of stage 2 (`ikaros.py`): viscosity of the film 1e-4 s, dampers of 0 or
100 N s/m in the tethers.  Of the flight neither frequency nor decay were published.

    ./gossamer demo ikaros_swing
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI
from scipy.optimize import curve_fit

import gossamer_fx as gx
from demos.common.deployment import dissipation, print_figures, run_case
from demos.common.figures import BLUE, GREY, RED, finish, new_figure, save
from demos.common.spinning import spins
from demos.sails import ikaros
from gossamer_fx.extend import Array, check


def main(
    comm: MPI.Comm = MPI.COMM_WORLD,
    extra: float = 3e-4,
    damping: float = 1e-4,
    tether_damping: float = 0.0,
    until: float = 240.0,
    dt: float = 0.2,
    pitch: float = 0.64,
    rpm: float = 2.5,
    tape: float = 0.0,
) -> dict[str, Any]:
    """Let the hub swing, with `extra` [rpm] more spin than the sail at first; see `ikaros.build`
    for the rest.

    Returns the frequency [Hz] and that of the closed form, the decay δ [1/s], what the fit leaves
    of the swing, the energy of the swing at the start [J], energy_error, what was dissipated, by
    each cause [J], steps, iterations (a step), seconds, and the times [s] and the swing at them
    [rad/s].
    """
    search, stiffness, J = ikaros.steady(comm, pitch, rpm, held=False, tape=tape)
    inertia = ikaros.HUB_INERTIA[2]
    # Frequency of two bodies with inertias I and J about an axis, which a spring of stiffness k
    # joins.
    ω = math.sqrt(stiffness * (1 / inertia + 1 / J))
    items, film, hub = ikaros.swinging(
        comm, search, pitch, rpm, extra, damping, tether_damping, tape
    )
    scene = gx.Scene(*items)  # type: ignore[arg-type]
    probes = spins(hub, film)
    run, series = run_case(gx.Case(scene, gx.Midpoint(dt=dt), until=until, probes=probes))
    # Spin of the hub against the sail; that of both together does not change.
    swing = series["hub"] - series["sail"]
    found = fit(np.asarray(series.time), swing)
    return {
        "frequency": found[1] / (2 * math.pi),
        "closed_form": ω / (2 * math.pi),
        "decay": found[0],
        "misfit": found[2],
        # Kinetic energy of the relative spin: half its square times the reduced inertia I J/(I +
        # J).
        "swing": (extra * ikaros.RPM) ** 2 / (1 / inertia + 1 / J) / 2,
        "energy_error": abs(run.energy_error),
        **dissipation(run),
        "steps": run.step,
        "iterations": run.iterations / run.step,
        "seconds": run.seconds,
        "times": np.asarray(series.time),
        "swings": swing,
    }


def draw(results: dict[float, dict[str, Any]], path: Path) -> None:
    """The swings from several initial spins over the time, and their frequencies over their size.

    Args:
        results: of `main`, by `extra` [rpm].
        path: of the picture.
    """
    figure = new_figure(width=10.0, height=3.9)
    left, right = figure.subplots(1, 2, width_ratios=(1.6, 1.0))
    # Only as many results are drawn as there are colours.
    for (extra, found), colour in zip(results.items(), (BLUE, GREY, RED), strict=False):
        first = extra * ikaros.RPM
        swing = found["swings"] / first
        left.plot(found["times"], swing, color=colour, lw=1.2, label=f"{extra:g} rpm")
    # The first half of the run, so that single swings can be told apart.
    left.set_xlim(0.0, 120.0)
    label = "spin of the hub against the sail / first"
    finish(left, "time [s]", label, title="first spin", loc="lower right")
    frequencies = [1e3 * found["frequency"] for found in results.values()]
    right.semilogx(list(results), frequencies, "o-", color=BLUE, label="computed")
    closed_form = 1e3 * next(iter(results.values()))["closed_form"]
    right.axhline(closed_form, color=GREY, ls="--", label="small swings, closed form")
    finish(right, "first spin of the hub [rpm]", "frequency [mHz]")
    save(figure, path, "IKAROS: the hub swings in its open sail")


def fit(t: Array, s: Array) -> tuple[float, float, float]:
    """Fit of exp(-δ t) (a cos ωt + b sin ωt) + c to s: δ [1/s], ω [rad/s], and the residual, rms
    over rms."""

    def damped(t: Array, δ: float, ω: float, a: float, b: float, c: float) -> Array:
        return np.exp(-δ * t) * (a * np.cos(ω * t) + b * np.sin(ω * t)) + c

    # Times just before the swing changes sign; two in a row are half a period apart.
    zeros = t[:-1][np.diff(np.sign(s)) != 0]
    check(
        len(zeros) > 2,
        f"The hub has turned back less than twice in {t[-1]:.3g} s; choose a larger until.",
    )
    ω = math.pi * (len(zeros) - 1) / (zeros[-1] - zeros[0])
    best, _ = curve_fit(damped, t, s, p0=(0.0, ω, float(s[0]), 0.0, 0.0))
    left = s - damped(t, *best)
    return float(best[0]), abs(float(best[1])), float(np.std(left) / np.std(s))


# Units of the figures.
UNITS = {"frequency": "Hz", "closed_form": "Hz", "decay": "1/s", "swing": "J", "dissipated": "J"}

if __name__ == "__main__":
    # Runs with dampers in the tethers are printed only.
    undamped = {}
    for more in (3e-4, 0.03, 0.2):
        for dampers in (0.0, 100.0):
            result = main(extra=more, tether_damping=dampers)
            if dampers == 0.0:
                undamped[more] = result
            print_figures({"extra [rpm]": more, "dampers [N s/m]": dampers, **result}, UNITS)
    if MPI.COMM_WORLD.rank == 0:
        draw(undamped, Path("out/ikaros_swing/ikaros_swing.png"))
