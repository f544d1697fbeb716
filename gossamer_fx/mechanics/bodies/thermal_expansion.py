"""Thermal expansion of bodies on meshes: strains and curvatures of a temperature in space and
time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from numbers import Real
from typing import Any

import numpy as np
import ufl
from dolfinx import fem

from gossamer_fx.core.checks.errors import check, check_on_all
from gossamer_fx.core.checks.user_functions import ask_points
from gossamer_fx.core.forms.backend import cell_nodes
from gossamer_fx.core.forms.compilation import constant
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.mesh.mesh import Mesh
from gossamer_fx.core.model.body import Array, Indices
from gossamer_fx.core.model.terms import Parameter
from gossamer_fx.mechanics.bodies.properties import cells_of_group
from gossamer_fx.mechanics.materials.thermal import Temperature, ThermalExpansion
from gossamer_fx.mechanics.terms.thermal_strain import ThermalStrain


class TemperatureInTime:
    """A temperature [K], or a difference of temperatures, in space and time; `elsewhere` in cells
    that are in no group, and refused below `lowest` in messages about `what`.

    Attributes:
        in_time: whether a function of the user is to be asked at every time.
    """

    def __init__(
        self, mesh: Mesh, given: Temperature, *, elsewhere: float, lowest: float, what: str
    ) -> None:
        self._comm = mesh.domain.comm
        self._elsewhere = elsewhere
        self._lowest = lowest
        self._what = what
        # Values, their cells (None: all of them), and their name in messages.
        self._parts: list[tuple[Any, Indices | None, str]] = []
        if isinstance(given, Mapping):
            for group, value in given.items():
                self._parts.append(
                    (value, cells_of_group(mesh, group, what), f"{what} in '{group}'")
                )
        else:
            self._parts.append((given, None, what))
        self.in_time = any(not isinstance(value, Real) for value, _, _ in self._parts)

    def set(self, function: fem.Function, t: float) -> None:
        """Set a scalar function, discontinuous between cells, to the temperatures [K] at a time t
        [s], ghosts included.  Collective."""
        space = function.function_space
        values = function.x.array
        values[:] = self._elsewhere
        points = space.tabulate_dof_coordinates().T
        for value, cells, what in self._parts:
            nodes = cell_nodes(space)
            if cells is not None:
                nodes = nodes[cells]
            nodes = np.unique(nodes.ravel())
            values[nodes] = self._ask(value, points[:, nodes], t, what)
        is_possible = bool((values >= self._lowest).all())
        check_on_all(
            self._comm,
            is_possible,
            f"{self._what} is below {self._lowest:g} K at t = {t:.6g} s; "
            "give absolute temperatures.",
        )

    def _ask(self, value: Any, points: Array, t: float, what: str) -> Array:
        """Temperatures (n,) [K] at points (3, n) [m], from a number or a user's function.
        Collective for a function."""
        count = points.shape[1]
        if isinstance(value, Real):
            return np.full(count, float(value))

        def at_points() -> Any:
            found = value(points, t)
            # A temperature that is the same everywhere may be one number.
            return np.full(count, found) if np.ndim(found) == 0 else found

        return ask_points(self._comm, f"{what} at t = {t:.6g} s", at_points, (count,))


def check_expansion(thermal: ThermalExpansion, what: str, *, has_axes: bool, bends: bool) -> None:
    """Refuse two coefficients of expansion for a law without axes, and a difference of temperature
    across the thickness of a body that does not bend."""
    check(
        len(thermal.alphas) == 1 or has_axes,
        f"{what}: alpha has two numbers, but its law has no axes; give one number.",
    )
    check(
        thermal.gradient is None or bends,
        f"{what}: gradient is given, but only a Plate bends by it; leave it out.",
    )


def metric_strain(alpha: Expr, ΔT: Expr) -> Expr:
    """½ (λ² - 1) of the stretch λ = 1 + α ΔT, without the difference of nearly equal numbers."""
    elongation = alpha * ΔT
    return elongation * (1 + elongation / 2)


def film_strain(alphas: tuple[Expr, ...], ΔT: Expr, c: Any) -> Expr:
    """Thermal strain (E11, E22, 2 E12) of a film in the frame of its mesh: ½(λ² - 1) of the stretch
    λ = 1 + α ΔT along each axis.  `alphas` [1/K] is one coefficient, or those along the two axes,
    of which `c` has cosine and sine."""
    if len(alphas) == 1:
        e = metric_strain(alphas[0], ΔT)
        return ufl.as_vector([e, e, 0 * e])
    first = metric_strain(alphas[0], ΔT)
    second = metric_strain(alphas[1], ΔT)
    # Squares of cosine and sine.
    c2 = c.cosine**2
    s2 = c.sine**2
    shear = 2 * c.cosine * c.sine * (first - second)
    return ufl.as_vector([c2 * first + s2 * second, s2 * first + c2 * second, shear])


def thermal_strain(
    body: Any, strain: Callable[[tuple[Expr, ...], Expr], Expr], what: str
) -> ThermalStrain:
    """The thermal strain of a body on a mesh, and the function of its temperature, for one compiled
    scene.  `strain` is a function of the coefficients of expansion [1/K] and T - T0 [K] that
    returns the strains as a UFL vector.  Collective."""
    thermal: ThermalExpansion = body.thermal
    domain = body.mesh.domain
    alphas = tuple(constant(domain, alpha) for alpha in thermal.alphas)
    reference = constant(domain, thermal.reference)
    given = thermal.reference if thermal.temperature is None else thermal.temperature
    temperature = TemperatureInTime(
        body.mesh,
        given,
        elsewhere=thermal.reference,
        lowest=0.0,
        what=f"{what}: its temperature",
    )
    # Of one order less than positions, as strains are: a linear temperature then bends no cell.
    space = fem.functionspace(domain, ("Discontinuous Lagrange", body.order - 1))
    names = ("alpha",) if len(alphas) == 1 else ("alpha1", "alpha2")
    parameters = [Parameter(name, "1/K", one) for name, one in zip(names, alphas, strict=True)]
    parameters.append(Parameter("reference_temperature", "K", reference))
    return ThermalStrain(
        lambda T: strain(alphas, T - reference),
        space,
        temperature.set,
        in_time=temperature.in_time,
        parameters=tuple(parameters),
    )


@dataclass(frozen=True, eq=False)
class ThermalCurvature:
    """Curvature [1/m] that a difference of temperature across its thickness gives to a free plate.

    Attributes:
        curvature: (2, 2) in the frame of the mesh, an expression of the difference.
        difference: T_front - T_back [K], a function that is constant in each cell.
        set: gives a function of the same space the differences at a time [s].  Collective.
    """

    curvature: Expr
    difference: fem.Function
    set: Callable[[fem.Function, float], None]


def thermal_curvature(plate: Any) -> ThermalCurvature:
    """The curvature without moments that a difference of temperature gives to a plate: -α ΔT/t
    along each axis, with the coefficient of expansion α [1/K], ΔT = T_front - T_back [K] and the
    thickness t [m].  Collective."""
    thermal: ThermalExpansion = plate.thermal
    domain = plate.mesh.domain
    # Constants of the law: thickness [m]; with axes cosine and sine of the first one.
    c = plate.constants
    given = TemperatureInTime(
        plate.mesh,
        thermal.gradient if thermal.gradient is not None else 0.0,
        elsewhere=0.0,
        lowest=-np.inf,
        what=f"Plate '{plate.name}': its gradient of temperature",
    )
    difference = fem.Function(fem.functionspace(domain, ("Discontinuous Lagrange", 0)))
    # The front expands more, so that the plate bends away from its front.
    per_alpha = -difference / c.thickness
    alphas = [constant(domain, alpha) * per_alpha for alpha in thermal.alphas]
    if len(alphas) == 1:
        curvature = alphas[0] * ufl.Identity(2)
    else:
        axes = ufl.as_matrix([[c.cosine, -c.sine], [c.sine, c.cosine]])
        in_axes = ufl.as_matrix([[alphas[0], 0], [0, alphas[1]]])
        curvature = ufl.dot(axes, ufl.dot(in_axes, axes.T))
    return ThermalCurvature(curvature, difference, given.set)
