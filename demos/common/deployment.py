"""Shared by the demos: run a case, collect the figures of the run, and print them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.extend import Array, Output, Probe

# Units of the figures of deployments by the beginnings of their names; the longest one counts.
UNITS = {
    **dict.fromkeys(("energy", "dissipated", "to_be_lost", "fold_energy", "crease"), "J"),
    **dict.fromkeys(("time", "when", "opened", "halfway", "arrived"), "s"),
    **dict.fromkeys(("radius", "largest_radius", "smallest_radius", "released_radius"), "m"),
    **dict.fromkeys(("span", "reach", "tip_distance", "farthest"), "m"),
    "spin": "rad/s",
    "crease_angle": "relative",
    "pressure": "Pa",
    "tip_speed": "m/s",
    "nutation": "deg",
}


def deployment_case(
    items: Sequence[object],
    title: str,
    probes: Mapping[str, Probe],
    until: float,
    control: gx.StepControl,
    dt: float,
    max_iterations: int = 40,
    frames: int = 80,
    events: Sequence[gx.When] = (),
) -> gx.Case:
    """The deployment of a folded film.

    Args:
        items: of the scene.
        title, probes, until, frames, events: of the case.
        control: of the steps.
        dt: first step [s].
        max_iterations: Newton iterations after which a step is rejected.
    """
    # The first guess of a step may press layers together: its residual is not a measure of the
    # forces.
    tolerances = gx.Tolerances(relative=1e-13, max_iterations=max_iterations)
    return gx.Case(
        gx.Scene(*items),  # type: ignore[arg-type]
        gx.Midpoint(dt=dt, tolerances=tolerances),
        until=until,
        title=title,
        probes=probes,
        control=control,
        frames=frames,
        events=events,
    )


def run_case(
    case: gx.Case,
    output: str | Path | None = None,
    name: str = "",
    fractions: Sequence[float] = (),
    view: gx.plot.View | None = None,
    stepper: Any = None,
) -> tuple[gx.Simulation, gx.Series]:
    """Run a case to its end; returns the run and the values of its probes.

    Args:
        case: the case.
        output: folder for the recording and the picture; None: nothing is written.
        name: of the picture, without its suffix.
        fractions: times of the picture, as fractions of the case's duration; none: no picture.
        view: from which the picture is drawn.
        stepper: instead of the case's.
    """
    series = gx.Series(case.probes)
    outputs: list[Output] = [gx.outputs.Progress(), series]
    if output is not None:
        folder = Path(output)
        outputs.append(case.recording(folder, overwrite=True))
        if fractions:
            times = [fraction * case.until for fraction in fractions]
            look = {} if view is None else {"view": view}
            outputs.append(gx.plot.Picture(folder / f"{name}.png", times, title=case.title, **look))
    run = replace(case, stepper=stepper or case.stepper).simulation(outputs)
    run.run(until=case.until)
    if output is not None and fractions and run.comm.rank == 0:
        print(f"picture written to {Path(output) / name}.png")
    return run, series


def run_figures(run: gx.Simulation, series: gx.Series) -> dict[str, float]:
    """Figures of a whole run.

    Returns:
        energy_error: error of the energy balance over the largest energy, without sign.
        rejected: number of rejected steps, each of which was made of two halves instead.
        steps: number of steps.
        iterations: Newton iterations per step.
        seconds: wall time [s].
        penetrations: largest number of edges that intersect triangles after any step; nan if the
            case has no probe of this name.
    """
    penetrations = math.nan
    if "penetrations" in series.probes:
        penetrations = float(series["penetrations"].max())
    return {
        "energy_error": abs(run.energy_error),
        "rejected": run.substeps,
        "steps": run.step,
        "iterations": run.iterations / run.step,
        "seconds": run.seconds,
        "penetrations": penetrations,
    }


def effort(run: gx.Simulation) -> dict[str, float]:
    """Error of the energy balance with its sign, Newton iterations per step, rejected steps
    (substeps), unknowns (dofs) and wall time [s] of a run."""
    return {
        "energy_error": run.energy_error,
        "newton_per_step": run.iterations / run.step,
        "substeps": run.substeps,
        "dofs": run.system.unknowns.numbering.size,
        "seconds": run.seconds,
    }


def dissipation(run: gx.Simulation) -> dict[str, float]:
    """Energy that a run has dissipated [J]: in all, and by each item of the scene that
    dissipates."""
    by_part = {f"dissipated by {name}": loss for name, loss in run.totals.losses.items()}
    return {"dissipated": run.totals.dissipated, **by_part}


def smooth(share: float) -> float:
    """From 0 to 1 with a share from 0 to 1, without a jerk at its ends."""
    share = min(max(share, 0.0), 1.0)
    return share * share * (3 - 2 * share)


def smooth_start(t: float, ramp: float) -> float:
    """Distance at the time t over the final speed [s], of a motion from rest whose speed grows
    smoothly within the time `ramp` [s]."""
    share = min(t / ramp, 1.0)
    return ramp * (share**3 - share**4 / 2) + max(t - ramp, 0.0)


def fold_angles(creases: Sequence[gx.connectors.Crease]) -> dict[str, Probe]:
    """Probes of the mean angle of each crease [rad]."""
    return {f"{crease.name} [rad]": gx.probes.FoldAngle(crease) for crease in creases}


def crease_figures(run: gx.Simulation, series: gx.Series, case: gx.Case) -> dict[str, float]:
    """Energies and angles of the creases of a case that has the probes of `fold_angles`.

    Returns:
        fold_energy: Σ ½ k θ² L [J] over the creases, with their angles θ at the start.  It is the
            energy at the start of creases that are flat at rest, and the work that flattens
            creases at rest in their folds.
        crease_start, crease_end: stored energy of the creases [J].
        crease_loss: energy [J] that creases have dissipated by yielding.
        crease_angle: mean of |θ| at the end over that at the start, weighted by length.
        None of them if the case has no crease.
    """
    creases = [item for item in case.scene.items if isinstance(item, gx.connectors.Crease)]
    if not creases:
        return {}
    fold_energy = 0.0
    weights = []
    before = []
    after = []
    for crease in creases:
        # k L [N m/rad] of the whole line, of which each rank has a part.
        stiffness = crease.body.comm.allreduce(float(crease.energy.stiffness.sum()))
        # Valleys are positive and mountains negative, so that their mean would vanish.
        angles = series[f"{crease.name} [rad]"]
        fold_energy += stiffness * float(angles[0]) ** 2 / 2
        weights.append(stiffness)
        before.append(abs(float(angles[0])))
        after.append(abs(float(angles[-1])))
    # Creases that are elastic have no entry.
    losses = run.totals.losses
    return {
        "fold_energy": fold_energy,
        "crease_start": sum(run.first.stored[crease.name] for crease in creases),
        "crease_end": sum(run.totals.stored[crease.name] for crease in creases),
        "crease_loss": sum(losses.get(crease.name, 0.0) for crease in creases),
        "crease_angle": float(np.dot(weights, after) / np.dot(weights, before)),
    }


def first_time(time: Array, values: Array, limit: float) -> float:
    """First time [s] at which values are at a limit or beyond; infinite if they never are."""
    reached = np.flatnonzero(np.asarray(values) >= limit)
    if not len(reached):
        return math.inf
    return float(time[reached[0]])


def print_figures(
    figures: Mapping[str, Any], units: Mapping[str, str] = MappingProxyType({})
) -> None:
    """Print figures, one a line, on the first rank; arrays are left out.

    Args:
        figures: by their names.
        units: of figures whose names do not state them, by the beginnings of their names, e.g.
            `UNITS`.
    """
    if MPI.COMM_WORLD.rank:
        return
    for name, value in figures.items():
        if isinstance(value, str):
            print(f"{name:48} {value}")
        elif np.isscalar(value):
            print(f"{_with_unit(name, units):48} {value:.6g}")


def _with_unit(name: str, units: Mapping[str, str]) -> str:
    """The words of a key, with the unit of the longest beginning that it has."""
    words = name.replace("_", " ")
    beginnings = [beginning for beginning in units if name.startswith(beginning)]
    if not beginnings or name.endswith(("]", "_error", "_drift")):
        return words
    return f"{words} [{units[max(beginnings, key=len)]}]"


def square_millimetres(area: Probe) -> Probe:
    """The probe of an area [m²] in mm²."""
    return lambda run: 1e6 * area(run)
