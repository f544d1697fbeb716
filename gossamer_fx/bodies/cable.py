"""Cables: lines without bending stiffness."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import ufl
from dolfinx.mesh import Mesh as DolfinxMesh

from gossamer_fx.bodies.curve import Curve
from gossamer_fx.bodies.meshed import PointFunction, checked, positions
from gossamer_fx.checks.arguments import check_arguments
from gossamer_fx.checks.errors import check
from gossamer_fx.forms.kinematics import Expr, bar_strain
from gossamer_fx.forms.strain_path import Piece
from gossamer_fx.materials.film import constants, parameters
from gossamer_fx.materials.thermal import ThermalExpansion
from gossamer_fx.mesh.mesh import Mesh
from gossamer_fx.model.body import Array
from gossamer_fx.model.state import State
from gossamer_fx.model.terms import Term
from gossamer_fx.terms.element_energies import StoredEnergy
from gossamer_fx.terms.masses import KineticEnergy


class BarLaw:
    """Base of the laws of cables: an energy per reference length of ε = ½(λ² - 1).

    Attributes:
        line_density: mass per reference length [kg/m].
        quadratic: whether the energy is quadratic in ε.
    """

    line_density: float
    quadratic: bool = False

    def energy(self, e: Expr, c: Any) -> Expr:
        """Stored energy per unit reference length [J/m] of e = (ε,)."""
        raise NotImplementedError

    def constants(self, mesh: DolfinxMesh) -> SimpleNamespace:
        """The numbers of the law as constants `c` of a mesh."""
        return constants(self, mesh)

    def pieces(self, e0: Expr, e1: Expr, c: Any) -> list[Piece]:
        """Pieces of the path from e0 to e1 with exact averages; none: Gauss points take them."""
        return []

    def _check_line_density(self) -> None:
        """Check that the mass per length [kg/m] is positive."""
        value = self.line_density
        check(
            math.isfinite(value) and value > 0,
            f"{type(self).__name__}: line_density is {value!r}; give a positive number.",
        )


@check_arguments
@dataclass(frozen=True)
class CableLaw(BarLaw):
    """St. Venant-Kirchhoff bar: W = ½ EA ε² per reference length, ε = ½(λ² - 1); its tension is N = EA ε λ.

    Args:
        EA: axial stiffness [N], positive.
        line_density: mass per reference length [kg/m], positive.

    Raises:
        InputError: a number that is not positive.

    Example:
        >>> gx.CableLaw(1e4, 0.01).EA
        10000.0
    """

    EA: float
    line_density: float

    quadratic = True

    def __post_init__(self) -> None:
        """Check the arguments."""
        check(
            math.isfinite(self.EA) and self.EA > 0,
            f"{type(self).__name__}: EA is {self.EA!r}; give a positive number.",
        )
        self._check_line_density()

    def energy(self, e: Expr, c: Any) -> Expr:
        """Stored energy per unit reference length [J/m] of e = (ε,)."""
        return c.EA / 2 * e[0] ** 2


@check_arguments
@dataclass(frozen=True)
class TensionOnly(CableLaw):
    """A bar as of `CableLaw` in tension, which stores nothing where it is slack.

    Args:
        EA: axial stiffness [N], positive.
        line_density: mass per reference length [kg/m], positive.

    Raises:
        InputError: a number that is not positive.

    Example:
        >>> gx.Cable(curve, gx.TensionOnly(1e4, 0.01)).name
        'cable'
    """

    quadratic = False

    def energy(self, e: Expr, c: Any) -> Expr:
        return c.EA / 2 * ufl.max_value(e[0], 0.0) ** 2


@check_arguments
class Cable(Curve):
    """A cable whose stress-free shape is the mesh.

    Kinetic energy ½∫μ|v|² dS, stored energy ∫W(ε) dS with the Green-Lagrange strain ε = ½(x'·x' - 1); dS is the
    reference length.

    Args:
        mesh: line elements in space.
        law: `CableLaw`, `TensionOnly` or `TabulatedCable`.
        order: 1 (constant strain) or 2.
        thermal: thermal expansion, with the temperature of the cable; default none.
        displacement: initial displacement [m], a function of the points (3, n) that returns (3, n); default none.
        velocity: initial velocity [m/s], given in the same way.
        name: name in messages and output.

    Example:
        >>> law = gx.CableLaw(1e4, 0.01)
        >>> cable = gx.Cable(curve, law, velocity=lambda X: np.array([[0.0], [0.0], [1.0]]) * X[0])
        >>> cable.port("end").nodes
        (4,)
    """

    def __init__(
        self,
        mesh: Mesh | DolfinxMesh,
        law: BarLaw,
        *,
        order: int = 1,
        thermal: ThermalExpansion | None = None,
        displacement: PointFunction | None = None,
        velocity: PointFunction | None = None,
        name: str = "cable",
    ) -> None:
        check(order in (1, 2), f"Cable '{name}': order is {order!r}; use 1 or 2.")
        super().__init__("Cable", name, mesh, order, 3)
        self.law = law
        self.constants = law.constants(self.mesh.domain)
        self._take_expansion("Cable", thermal)
        self._displacement = checked(displacement, f"Cable '{name}': its displacement", mesh.comm)
        self._velocity = checked(velocity, f"Cable '{name}': its velocity", mesh.comm)

    def terms(self, start: State) -> Iterable[Term]:
        """Kinetic and stored energy of the cable."""
        numbers = parameters(self.law, self.constants)
        yield KineticEnergy(
            self,
            lambda v, w: self.constants.line_density * ufl.inner(v, w) * self.mass_dx,
            parameters=numbers,
        )
        thermal = self._thermal_strain("Cable", components=1)
        yield StoredEnergy(
            self.name,
            self,
            bar_strain,
            self.density,
            self.dx,
            self.law.quadratic,
            lambda e0, e1: self.law.pieces(e0, e1, self.constants),
            thermal=thermal,
            parameters=numbers if thermal is None else numbers + thermal.parameters,
        )

    def density(self, e: Expr) -> Expr:
        """Stored energy per unit reference length."""
        return self.law.energy(e, self.constants)

    @cached_property
    def _start(self) -> tuple[Array, Array]:
        return positions(self.space, self._displacement, self._velocity)
