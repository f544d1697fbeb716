"""For how long a gradient of a deployment predicts finite changes: the folded tube and the spinning
disc.

At some times t of a run the exact derivative g(t) = dJ/dθ of a result J is taken, and J is computed
again with the parameter changed by a relative change δ.  The gradient predicts the change up to the
first time at which

    |J(t; θ (1 + δ)) - J(t; θ) - δ θ g(t)| > `TOLERATED` max over s ≤ t of |δ θ g(s)|      (1)

The maximum is there since a result may pass through a time at which its derivative vanishes.

    scene           result                      parameter
    tube            enclosed volume             pressure of the tank
    damped tube     enclosed volume             pressure of the tank
    disc            mean radius of the tips     spin at the start

They are the scenes of demos/common/flat_rooted_tube.py, without and with viscosity of the film, and
of the demo `spin_deployment`, which has some.  They have what a gradient needs: a contact of given
stiffness, steps of equal length, and a valve that is open at the start.  The steps are so short
that none is rejected: a step that is solved in two halves in one of two runs parts them by itself.

The columns "warned" compare this with what `gx.analysis.gradient` says: from which time on it
warns, and for how long it predicts a relative change according to its warning at that time.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common import flat_rooted_tube
from demos.sails import spin_deployment
from demos.studies.engine.study import Study
from gossamer_fx.analysis.sensitivity.transient import GROWTH_TO_WARN_OF
from gossamer_fx.extend import Array, Result

# Relative error of a predicted change that is tolerated.
TOLERATED = 0.1

CHANGES = (1e-6, 1e-4, 1e-2)
FRAMES = 12

# Stiffness of contact [N/m³]: enough to stop what closes at 30 and 8 m/s within the activation
# distance.
TUBE_CONTACT = 5e8
DISC_CONTACT = 2e7

# Viscosity of the film over its stiffness [s], as in the demo `opening_time`.
TUBE_DAMPING = 2e-5

TUBE_PRESSURE = 1.5e6  # of the tank [Pa]
DISC_SPIN = 8.0  # revolutions a second


@dataclass(frozen=True)
class Deployment:
    """A run that can be made with a changed parameter.

    Attributes:
        run: at its start.
        result: of which the gradient is taken.
        by: names of the variables of the gradient.
        direction: change of each variable for a relative change of the parameter of one.
    """

    run: gx.Simulation
    result: Any
    by: list[str]
    direction: dict[str, Array]


class MeanRadius:
    """Mean distance [m] of ports of one body from the z axis, with its derivative."""

    def __init__(self, ports: list[Any]) -> None:
        self._ports = ports
        self._body = ports[0].body

    def _points(self, run: Any) -> Array:
        """Positions (n, 2) of the ports in the plane, on all ranks."""
        return run.system.unknowns.state.vectors(self._ports)[:, :2]

    def value(self, run: Any) -> float:
        """The mean of the radii in the present state of a run."""
        return float(np.linalg.norm(self._points(run), axis=1).mean())

    def derivative(self, run: Any) -> dict[Any, Array]:
        """Derivative with respect to the coordinates of the body on this rank."""
        body = self._body
        points = self._points(run)
        outwards = points / np.linalg.norm(points, axis=1)[:, None] / len(points)
        owned = run.system.unknowns.block(body).owned
        first, last = body.block.index_map.local_range
        found = np.zeros(((owned.stop - owned.start) // 3, 3))
        for port, direction in zip(self._ports, outwards, strict=True):
            # Tips are mesh nodes, which one rank owns.
            node = port.nodes[0]
            if first <= node < last:
                found[node - first, :2] += direction
        return {body: found.ravel()}


def tube(comm: MPI.Comm, change: float, until: float, h: float, damping: float = 0.0) -> Deployment:
    """The folded tube with the pressure of its tank changed by a relative change."""
    case = flat_rooted_tube.build(
        comm,
        pressure=TUBE_PRESSURE * (1 + change),
        rise=0.0,
        contact_stiffness=TUBE_CONTACT,
        damping=damping,
        until=until,
    )
    run = simulation(case, h)
    film = _film(run)
    return Deployment(
        run,
        gx.analysis.EnclosedVolume(film),
        ["tank.pressure"],
        {"tank.pressure": np.array([TUBE_PRESSURE])},
    )


def damped_tube(comm: MPI.Comm, change: float, until: float, h: float) -> Deployment:
    """The same with viscosity of the film."""
    return tube(comm, change, until, h, damping=TUBE_DAMPING)


def disc(comm: MPI.Comm, change: float, until: float, h: float) -> Deployment:
    """The disc on its hub with its spin changed by a relative change."""
    case = spin_deployment.build(
        comm, rev=DISC_SPIN * (1 + change), contact_stiffness=DISC_CONTACT, until=until
    )
    run = simulation(case, h)
    film = _film(run)
    radius = MeanRadius([film.port(f"tip {k}") for k in range(6)])
    # All initial velocities are proportional to the spin.
    velocities = run.system.unknowns.v0.array_r
    direction = {
        f"{body.name}.initial_velocity": np.array(velocities[run.system.unknowns.block(body).owned])
        for body in run.system.unknowns.bodies
    }
    result = gx.analysis.Functional(radius.value, radius.derivative, unit="m")
    return Deployment(run, result, list(direction), direction)


def simulation(case: gx.Case, h: float) -> gx.Simulation:
    """The run of a case with steps of equal length."""
    stepper = gx.Midpoint(dt=h, tolerances=gx.Tolerances(relative=1e-13))
    return gx.Simulation(case.scene, stepper, outputs=[])


def _film(run: gx.Simulation) -> gx.Membrane:
    """The film of a scene."""
    return next(body for body in run.system.unknowns.bodies if isinstance(body, gx.Membrane))


SCENES = {"tube": tube, "damped tube": damped_tube, "disc": disc}
# End of the run and length of a step [s].  The disc is open at its end.  The tube opens within 6
# ms, but its gradient predicts nothing long before.
TIMES = {"tube": (1.2e-3, 1e-5), "damped tube": (4.8e-3, 1e-5), "disc": (0.24, 4e-4)}


def problem(comm: MPI.Comm, scene: str, share: float = 1.0) -> Mapping[str, float]:
    """Compare gradients with changed runs; `share` is the part of the deployment that is
    followed."""
    began = time.process_time()
    end, h = TIMES[scene]
    # A whole number of steps between two frames.
    steps = max(round(share * end / h / FRAMES), 1)
    times = steps * h * np.arange(1, FRAMES + 1)
    build = SCENES[scene]
    usual = build(comm, 0.0, float(times[-1]), h)
    tape = gx.analysis.RunTape(usual.run)
    values = []
    slopes = []
    growths = []
    # One recording serves all times: the backward pass leaves the run where it was.
    for t in times:
        usual.run.run(until=float(t))
        found = gx.analysis.gradient(tape, of=usual.result, by=usual.by)
        values.append(found.value)
        slopes.append(sum(found[name].along(usual.direction[name]) for name in usual.by))
        growths.append(found.growth or 1.0)
    result: dict[str, float] = {}
    # Not only the summary: the picture shows the error at each time.
    for change in CHANGES:
        errors = _errors(
            build(comm, change, float(times[-1]), h), times, change, values, np.array(slopes)
        )
        for k, error in enumerate(errors):
            result[f"error {change:g} at {k}"] = float(error)
        # From the first failure on: a later agreement would be chance.
        wrong = np.flatnonzero(errors > TOLERATED)
        last = wrong[0] if len(wrong) else FRAMES
        result[f"predicts {change:g} [ms]"] = 1e3 * times[last - 1] if last else 0.0
    for k, t in enumerate(times):
        result[f"time {k}"] = float(t)
        result[f"growth {k}"] = float(growths[k])
    result |= warned(times, np.array(growths))
    result["growth"] = growths[-1]
    result["energy_error"] = abs(usual.run.energy_error)
    result["rejected"] = usual.run.substeps
    result["unknowns"] = usual.run.system.unknowns.numbering.size
    result["steps"] = usual.run.step
    result["seconds"] = time.process_time() - began
    return result


def _errors(
    changed: Deployment, times: Array, change: float, values: list[float], slopes: Array
) -> Array:
    """The relative errors (1) of the predicted changes at the times."""
    differences = []
    for t, value in zip(times, values, strict=True):
        changed.run.run(until=float(t))
        differences.append(changed.result(changed.run) - value)
    predicted = change * slopes
    largest = np.maximum.accumulate(np.abs(predicted))
    return np.abs(np.array(differences) - predicted) / largest


def warned(times: Array, growths: Array) -> dict[str, float]:
    """From which time on a gradient warns [ms], and for how long it then predicts [ms], by its
    warning.

    A time of a warning that was not given is not a number.
    """
    warns = np.flatnonzero(growths >= GROWTH_TO_WARN_OF)
    found = {"warned at [ms]": math.nan}
    found |= {f"warned {change:g} [ms]": math.nan for change in CHANGES}
    if not len(warns):
        return found
    first = warns[0]
    rate = math.log(growths[first]) / times[first]
    found["warned at [ms]"] = 1e3 * float(times[first])
    for change in CHANGES:
        found[f"warned {change:g} [ms]"] = 1e3 * math.log(1 / change) / rate
    return found


def draw(results: list[Result], path: Path) -> None:
    """Errors of the predicted changes over the time, and the growth of each scene."""
    from demos.common.figures import BLUE, GREEN, GREY, RED, finish, new_figure, save

    figure = new_figure(10.0, 4.2)
    panels = figure.subplots(1, max(len(results), 1), squeeze=False)[0]
    titles = {
        "tube": "folded tube: volume by tank pressure",
        "damped tube": "the same with a viscous film",
        "disc": "spinning disc: radius of tips by spin",
    }
    for axes, result in zip(panels, results, strict=True):
        milliseconds = 1e3 * np.array([result.numbers[f"time {k}"] for k in range(FRAMES)])
        for change, colour in zip(CHANGES, (BLUE, GREEN, RED), strict=True):
            errors = [result.numbers[f"error {change:g} at {k}"] for k in range(FRAMES)]
            label = f"change of {change:g}"
            axes.semilogy(milliseconds, errors, "o-", ms=3, color=colour, label=label)
        axes.axhline(TOLERATED, color=GREY, ls="--", lw=1, label="tolerated, 10 %")
        at = result.numbers.get("warned at [ms]", math.nan)
        if math.isfinite(at):
            axes.axvline(at, color=GREY, ls=":", lw=1.5, label="a warning is given")
        axes.set_title(titles[result.values["scene"]], fontsize=10)
        finish(axes, "t [ms]", "error of the predicted change, relative")
    save(figure, path)


STUDY = Study(
    "gradient_horizon",
    "For how long gradients of deployments predict finite changes",
    problem,
    {"scene": ["tube", "damped tube", "disc"]},
    lambda case: 1.0,
    quick={"scene": ["tube"]},
    quick_options={"share": 0.1},
    shows=("predicts 0.01 [ms]", "growth"),
    limits={"energy_error": 1e-8},
    # The times for which they stay below the tolerated error, and the errors of the largest change,
    # are compared.
    not_repeatable={
        f"error {change:g} at {k}": "the difference of two runs has few digits beyond round-off"
        for change in CHANGES[:-1]
        for k in range(FRAMES)
    },
    columns=(
        "".join(f"predicts {change:g} [ms], " for change in CHANGES)
        + "warned at [ms], "
        + "".join(f"warned {change:g} [ms], " for change in CHANGES)
        + "growth, energy_error, rejected, unknowns, steps, seconds"
    ),
    draw=draw,
)
