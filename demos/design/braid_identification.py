"""Moduli of a braided inflatable tube from one measured curve, and the curves that they predict at
other pressures.

A tube of braided fabric with axial cords is bent by two loads
(`demos/validation/models/braided_tube.py`, tests of NASA and the University of Maine).  The source
gives membrane stiffnesses of the braid at each pressure.  Fitted are two factors, the same for all
pressures,

    stretching      of A11, A12 and A22, along and around the tube
    shear           of A66

such that the load over the deflection of midspan is the measured one at one pressure.  The tests at
the other pressures are predictions, with the standard deviation that the fit leaves.

The residual at each deflection is the load P less the measured load y at the computed deflection w,

    r = (P - y(w))/σ,    dr/dθ = (dP/dθ - y'(w) dw/dθ)/σ

P is a multiplier of the constraint that lowers the loads, and a result with derivatives like any
coordinate.  A tube with another stiffness is made with another stress-free shape, as the inflated
diameter and span are measured.  The derivative through this shape is that by the mesh nodes,
"wall.shape".

σ is a per cent of the largest load, of the order of what two tests of one tube differ by.  Where
the scatter of the fit is above 1, the model is not right to this, and the errors are widened by the
scatter.

    ./gossamer demo braid_identification
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

import gossamer_fx as gx
from demos.common.deployment import print_figures
from demos.common.figures import BLUE, GREY, RED, finish, new_figure, save
from demos.validation.engine.case import Measured, Test, read_case
from demos.validation.models import braided_tube
from gossamer_fx.analysis.sensitivity.static import StaticGradients
from gossamer_fx.extend import Array, Objective, System

CASES = Path(__file__).parents[1] / "validation" / "cases"
NAMES = ("stretching", "shear")
# Moduli of the law that are proportional to each factor.
MODULI = {"stretching": ("E1", "E2"), "shear": ("G12",)}

# Cells over half of the section.
CELLS = 6
# Depths to which the loads are lowered in the fit and in the predictions [m].
DEPTHS = (0.004, 0.012, 0.03, 0.06, 0.1)
# Standard deviation of a measured load over the largest one of its curve.
LOAD_ERROR = 0.01
# Relative step of the differences of two stretches, which are known to 1e-13.
STRETCH_STEP = 1e-5


class Load(Objective):
    """The total load [N] of a bending test as a result with derivatives: the multiplier of its
    constraint."""

    unit = "N"

    def __init__(self, model: braided_tube.Model) -> None:
        self._model = model

    def _index(self, system: System) -> slice:
        """Own entries of the multiplier in vectors of the system; none on other ranks."""
        from gossamer_fx.mechanics.terms.point_constraints import PointConstraint

        terms = [term for term in system.unknowns.terms if isinstance(term, PointConstraint)]
        number = next(k for k, term in enumerate(terms) if term.name == self._model.load.name)
        # Multipliers are numbered behind the bodies.
        return system.unknowns.numbering.owned(len(system.unknowns.bodies) + number)

    def __call__(self, run: Any) -> float:
        """The load: two bands, of each of which a half is modelled."""
        own = float(run.system.unknowns.q0.array_r[self._index(run.system)].sum())
        return 4 * float(run.system.comm.allreduce(own))

    def add_derivative(
        self, system: System, by_position: PETSc.Vec, by_velocity: PETSc.Vec
    ) -> None:
        """Add 4 at the multiplier."""
        with by_position as values:
            values[self._index(system)] += 4.0


@dataclass(frozen=True)
class Curve:
    """A measured or computed curve.

    Attributes:
        w: deflections of midspan (n,) [m].
        P: total loads (n,) [N].
    """

    w: Array
    P: Array


def tube_of(test: Test, factors: Sequence[float]) -> braided_tube.Tube:
    """The tube of a test with factors of its stiffnesses."""
    tube = braided_tube.Tube.read(test.inputs)
    A11, A12, A22, A66 = tube.stiffnesses
    stretching, shear = factors
    scaled = (stretching * A11, stretching * A12, stretching * A22, shear * A66)
    return dataclasses.replace(tube, stiffnesses=scaled)


def measured_curve(test: Test) -> Curve:
    """Deflections [m] and loads [N] that were measured."""
    measured: Measured = test.measured[0]
    return Curve(1e-3 * measured.x, measured.y)


def bend(
    comm: MPI.Intracomm,
    test: Test,
    factors: Sequence[float],
    cells: int,
    with_gradients: bool = True,
) -> tuple[Curve, list[list[gx.analysis.Gradient]]]:
    """Lower the loads; the computed curve, and the gradients of load and height of midspan at its
    points.

    The gradients are by the factors.
    """
    tube = tube_of(test, factors)
    model = braided_tube.build(tube, comm, cells)
    equilibrium = gx.Equilibrium(model.scene)
    load = Load(model)
    height = gx.probes.Position(model.middle, "z")
    first = float(model.middle.initial()[2])
    directions = [shape_change(test, model.film, factors, k) for k in range(len(NAMES))]
    w = []
    P = []
    gradients = []
    # Derivatives need an equilibrium, also to be set up.
    equilibrium.find()
    by = [f"wall.{name}" for name in ("E1", "E2", "G12", "shape")]
    # One object for all depths: forms are derived once.
    derivatives = StaticGradients(equilibrium, by)
    for depth in DEPTHS:
        equilibrium.find(at=float(depth))
        w.append(first - height(equilibrium))
        P.append(load(equilibrium))
        if not with_gradients:
            continue
        derivatives.factorise()
        of_point = []
        for result in (load, height):
            found = derivatives.of(result)
            slopes = []
            for k, name in enumerate(NAMES):
                slope = found["wall.shape"].along(directions[k])
                for modulus in MODULI[name]:
                    value = getattr(model.film.law, modulus)
                    slope += found[f"wall.{modulus}"].along(value / factors[k])
                slopes.append(gx.analysis.Derivative(name, found.unit, np.array([slope]), None))
            of_point.append(gx.analysis.Gradient(found.value, found.unit, tuple(slopes)))
        gradients.append(of_point)
    return Curve(np.array(w), np.array(P)), gradients


def shape_change(test: Test, film: gx.Membrane, factors: Sequence[float], number: int) -> Array:
    """The derivative of the coordinates of the mesh nodes of this rank by one of the factors (k,).

    The mesh is as long as 1/λ_L and as wide as 1/λ_H.
    """
    logarithms = []
    for sign in (1, -1):
        changed = list(factors)
        changed[number] += sign * STRETCH_STEP
        logarithms.append(np.log(tube_of(test, changed).stretches()))
    along, around = (logarithms[0] - logarithms[1]) / (2 * STRETCH_STEP)
    # The nodes of the mesh, which is of order 1, in the order of the derivative by the shape.
    from gossamer_fx.analysis.sensitivity.variables import MeshNodes

    X = MeshNodes(film.mesh.domain).get().reshape(-1, 3)
    change: Array = -X * np.array([along, around, around])
    return change.ravel()


def identify(
    comm: MPI.Intracomm, tests: Sequence[Test], cells: int, iterations: int = 12
) -> gx.analysis.Fit:
    """Fit the factors to the curves of some tests."""
    curves = [measured_curve(test) for test in tests]

    def residuals(values: dict[str, Array]) -> list[gx.analysis.Gradient]:
        factors = [float(values[name][0]) for name in NAMES]
        found = []
        for test, curve in zip(tests, curves, strict=True):
            computed, gradients = bend(comm, test, factors, cells)
            for w, P, (of_load, of_height) in zip(computed.w, computed.P, gradients, strict=True):
                found.append(_residual(curve, w, P, of_load, of_height))
        return found

    # The stiffnesses of the source.
    start = dict.fromkeys(NAMES, 1.0)
    return gx.analysis.fit_runs(
        residuals,
        start,
        measured=[0.0] * len(DEPTHS) * len(tests),
        uncertainty=LOAD_ERROR,
        bounds=dict.fromkeys(NAMES, (0.2, 5.0)),
        iterations=iterations,
        tolerance=1e-6,
        comm=comm,
    )


def _residual(
    curve: Curve, w: float, P: float, of_load: gx.analysis.Gradient, of_height: gx.analysis.Gradient
) -> gx.analysis.Gradient:
    """The difference of a load from the measured curve over its largest load, with its
    derivatives."""
    largest = float(curve.P.max())
    k = int(np.clip(np.searchsorted(curve.w, w), 1, len(curve.w) - 1))
    rise = curve.P[k] - curve.P[k - 1]
    steepness = rise / (curve.w[k] - curve.w[k - 1])
    y = curve.P[k - 1] + steepness * (w - curve.w[k - 1])
    slopes = []
    for name in NAMES:
        # The deflection is the height at first less the height.
        slope = of_load[name].values + steepness * of_height[name].values
        slopes.append(gx.analysis.Derivative(name, "1", slope / largest, None))
    return gx.analysis.Gradient((P - y) / largest, "1", tuple(slopes))


def deviation(found: gx.analysis.Fit, gradients: Sequence[Sequence[gx.analysis.Gradient]]) -> Array:
    """Standard deviation [N] of each load that was computed with the factors of a fit (n,)."""
    slopes = []
    for of_load, _ in gradients:
        slopes.append([of_load[name].values[0] for name in NAMES])
    J = np.array(slopes)
    return np.sqrt(np.einsum("ij,jk,ik->i", J, found.covariance, J))


def error_of(curve: Curve, computed: Curve) -> float:
    """Mean size of the relative errors of a computed curve, within the measured deflections."""
    inside = (computed.w >= curve.w[0]) & (computed.w <= curve.w[-1])
    y = np.interp(computed.w[inside], curve.w, curve.P)
    return float(np.abs(computed.P[inside] / y - 1).mean())


def main(
    angle: int = 71,
    fitted: str = "1 up, 69 kPa",
    predicted: Sequence[str] = ("1 up, 34 kPa", "1 up, 103 kPa", "1 up, 138 kPa", "2 up, 69 kPa"),
    cells: int = CELLS,
    output: str | Path | None = None,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
) -> dict[str, float]:
    """Fit one test of the tubes of a braid angle [degrees] and predict others; a picture in
    `output`.

    Returns:
        The factors, their standard deviations, the scatter of the fit, and for each predicted test
        the mean error of its loads with the stiffnesses of the source and with the fitted ones, and
        the mean standard deviation of the predictions, over the loads.
    """
    began = time.process_time()
    case = read_case(CASES / f"hiad_{angle}.toml", ["braided_tube"])
    tests = {test.name: test for test in case.tests}
    found = identify(comm, [tests[fitted]], cells)
    factors = [float(found.parameters[name][0]) for name in NAMES]
    result: dict[str, float] = {}
    for name, factor in zip(NAMES, factors, strict=True):
        result[name] = factor
        result[f"{name}, standard deviation"] = float(found.errors[name][0])
    result["scatter"] = found.scatter
    drawn = []
    # The fitted test, too: its errors are what a model with two numbers leaves.
    for name in (fitted, *predicted):
        test = tests[name]
        measured = measured_curve(test)
        first, _ = bend(comm, test, (1.0, 1.0), cells, with_gradients=False)
        after, gradients = bend(comm, test, factors, cells)
        spread = deviation(found, gradients)
        drawn.append((name, measured, first, after, spread))
        result[f"{name}: error of the source"] = error_of(measured, first)
        result[f"{name}: error"] = error_of(measured, after)
        result[f"{name}: standard deviation"] = float((spread / after.P).mean())
    if output is not None and comm.rank == 0:
        draw(drawn, Path(output) / "braid_identification.png")
    result["Jacobians"] = found.iterations
    result["seconds"] = time.process_time() - began
    return result


def draw(tests: Sequence[tuple[str, Curve, Curve, Curve, Array]], path: Path) -> None:
    """Measured, first and fitted curves of each test, the fitted ones with two standard
    deviations."""
    columns = math.ceil(len(tests) / 2)
    figure = new_figure(3.6 * columns, 6.0)
    panels = figure.subplots(2, columns, squeeze=False).ravel()
    for axes, (name, measured, first, after, spread) in zip(panels, tests, strict=False):
        axes.plot(1e3 * measured.w, measured.P, color=GREY, lw=2, label="measured")
        axes.plot(1e3 * first.w, first.P, "s--", ms=3, color=RED, label="source's stiffnesses")
        axes.errorbar(
            1e3 * after.w, after.P, yerr=2 * spread, fmt="o-", ms=3, color=BLUE, label="fitted, 2σ"
        )
        axes.set_title(name, fontsize=10)
        axes.set_ylim(bottom=0.0)
        finish(axes, "deflection of midspan [mm]", "load [N]", loc="lower right")
    panels[0].set_title(f"{tests[0][0]} (fitted)", fontsize=10)
    for axes in panels[len(tests) :]:
        axes.set_axis_off()
    save(figure, path)


if __name__ == "__main__":
    print_figures(main(output="out/braid_identification"))
