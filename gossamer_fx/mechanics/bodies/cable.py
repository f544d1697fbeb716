"""Curves, i.e. bodies on line elements in space, and cables: curves without bending stiffness."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property
from types import SimpleNamespace
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
import ufl
from dolfinx.mesh import Mesh as DolfinxMesh

from gossamer_fx.core.checks.arguments import Range, check_arguments, positive
from gossamer_fx.core.checks.errors import check, check_on_all
from gossamer_fx.core.checks.relations import at_most_one
from gossamer_fx.core.forms.compilation import constant
from gossamer_fx.core.forms.kinematics import Expr, bar_strain, line_derivative
from gossamer_fx.core.forms.strain_path import Piece, energy_gradient, mean_of_positive_part
from gossamer_fx.core.mesh.mesh import Mesh
from gossamer_fx.core.model.body import Array
from gossamer_fx.core.model.state import State
from gossamer_fx.core.model.terms import Term
from gossamer_fx.mechanics.bodies.initial_strain import (
    Numbers,
    check_strain,
    line_numbers,
    stored_energy,
)
from gossamer_fx.mechanics.bodies.meshed import Meshed, PointFunction, checked, positions
from gossamer_fx.mechanics.materials.film import constants, parameters
from gossamer_fx.mechanics.terms.masses import KineticEnergy

if TYPE_CHECKING:
    from gossamer_fx.mechanics.materials.thermal import ThermalExpansion


LineDensity = Annotated[float, positive("kg/m")]


class BarLaw:
    """Base of the laws of cables: an energy per reference length of ε = ½(λ² - 1), λ the stretch.

    Attributes:
        line_density: mass per reference length [kg/m].
        quadratic: whether the energy is quadratic in ε.
    """

    line_density: float

    @property
    def quadratic(self) -> bool:
        """Whether the energy is quadratic in the Green strain ε."""
        return False

    @property
    def has_history(self) -> bool:
        """Whether the force depends on the strains of the past; then only tapes take the law."""
        return False

    def energy(self, e: Expr, c: Any) -> Expr:
        """Stored energy per unit reference length [J/m] of e = (ε,)."""
        raise NotImplementedError

    def constants(self, mesh: DolfinxMesh) -> SimpleNamespace:
        """The numbers of the law as UFL constants of a mesh: the argument `c` of other methods."""
        return constants(self, mesh)

    def pieces(self, e0: Expr, e1: Expr, c: Any) -> list[Piece]:
        """Pieces of the path of a step from e0 to e1, each with its exact mean stress; an empty
        list: the stress is averaged at Gauss points."""
        return []


@check_arguments
@dataclass(frozen=True)
class CableLaw(BarLaw):
    """A bar whose energy is quadratic in its strain: W = ½ EA ε² or ½ EA (λ - 1)² per reference
    length, with ε = ½(λ² - 1).  Its tension is N = EA ε λ (St. Venant-Kirchhoff) or EA (λ - 1).

    Args:
        EA: axial stiffness [N], positive.
        line_density: mass per reference length [kg/m], positive.
        strain: "green" for ε, "engineering" for λ - 1, as most programs have it.  At 1 % the
            tensions differ by 1.5 %.

    Raises:
        InputError: a number that is not positive, another strain.

    Example:
        >>> gx.CableLaw(1e4, 0.01).EA
        10000.0
        >>> rope = gx.Cable(curve, gx.CableLaw(1e4, 0.01, strain="engineering"))
    """

    EA: Annotated[float, positive("N")]
    line_density: LineDensity
    _: KW_ONLY
    strain: Literal["green", "engineering"] = "green"

    @property
    def quadratic(self) -> bool:
        """Whether the energy is quadratic in the Green strain ε."""
        return self.strain == "green"

    def energy(self, e: Expr, c: Any) -> Expr:
        return c.EA / 2 * self._law_strain(e) ** 2

    def _law_strain(self, e: Expr) -> Expr:
        """ε, or λ - 1 for an engineering law, of e = (ε,)."""
        return e[0] if self.strain == "green" else engineering_strain(e)

    def pieces(self, e0: Expr, e1: Expr, c: Any) -> list[Piece]:
        """None for a quadratic energy, whose stress at the middle is exact; else the whole path.

        Of Green strains its mean stress is EA ε_m.  Of engineering strains x, with the mean force
        EA x_m and Δε = λ_m Δx, the stress S = EA x_m/λ_m has S Δε = ΔW exactly."""
        if self.quadratic:
            return []
        return [Piece(0.0, 1.0, lambda ea, eb: self._mean_stress(ea, eb, c))]

    def _mean_stress(self, e0: Expr, e1: Expr, c: Any) -> Expr:
        """Mean stress (1,) [N] of the path from e0 to e1, see `pieces`."""
        x0 = self._law_strain(e0)
        x1 = self._law_strain(e1)
        force = c.EA * self._mean(x0, x1)
        if self.strain == "engineering":
            force /= 1 + (x0 + x1) / 2
        return ufl.as_vector([force])

    def _mean(self, x0: Expr, x1: Expr) -> Expr:
        """Average, over the path from x0 to x1, of the strain that bears; here all of it."""
        return (x0 + x1) / 2

    def green_strain(self, share: Expr) -> Expr:
        """The strain ε with which the cable has the tension N in the shape of its mesh, from the
        number `share` = N/EA."""
        if self.strain == "green":
            return share
        # EA x/(1 + x) = N, as the stress EA x/λ along ε acts on the length 1.
        x = share / (1 - share)
        return x * (1 + x / 2)


@check_arguments
@dataclass(frozen=True)
class TensionOnly(CableLaw):
    """A bar as of `CableLaw`, with the same arguments, in tension; it stores nothing where it is
    slack.

    Example:
        >>> gx.Cable(curve, gx.TensionOnly(1e4, 0.01)).name
        'cable'
    """

    @property
    def quadratic(self) -> bool:
        """Whether the energy is quadratic in the Green strain ε."""
        # Its stress has a kink at zero strain, where the path of a step is divided.
        return False

    def energy(self, e: Expr, c: Any) -> Expr:
        return c.EA / 2 * ufl.max_value(self._law_strain(e), 0.0) ** 2

    def _mean(self, x0: Expr, x1: Expr) -> Expr:
        return mean_of_positive_part(x0, x1)


# The smallest λ².  Iterates of the strain may be below -½, where λ would be imaginary.
MIN_SQUARED_STRETCH = 1e-6


def engineering_strain(e: Expr) -> Expr:
    """x = λ - 1 of e = (ε,), without the difference of nearly equal numbers."""
    squared = ufl.max_value(1 + 2 * e[0], MIN_SQUARED_STRETCH)
    return (squared - 1) / (ufl.sqrt(squared) + 1)


class Curve(Meshed):
    """A body on line elements.  Its constants include EA [N] if its law or section has one."""

    strains = 1  # number of its strains

    def _take_prestress(self, tension: Numbers | None, strain: Numbers | None) -> None:
        """Add an initial axial force [N] or Green-Lagrange strain to the constants of the body."""
        # A restart compares these arguments, see `outputs.output`.
        self._initial_tension = tension
        self._initial_strain = strain
        if strain is not None:
            what = f"'{self.name}': its initial_strain"
            self.constants.initial_strain = line_numbers(self.mesh, strain, what)
            check_strain(self.mesh, self.constants.initial_strain, what)
        if tension is not None:
            what = f"'{self.name}': its initial_tension"
            self.constants.initial_tension = line_numbers(self.mesh, tension, what)

    @property
    def initial_strain(self) -> Expr | None:
        """Initial axial strain ε0, given itself or as N0/EA of the initial tension N0 [N]; None
        without prestress."""
        strain = getattr(self.constants, "initial_strain", None)
        if strain is not None:
            return strain
        tension = getattr(self.constants, "initial_tension", None)
        if tension is not None:
            return self._strain_of_tension(tension / self.constants.EA)
        return None

    def _strain_of_tension(self, share: Expr) -> Expr:
        """The initial strain of a tension N0 in the shape of the mesh, from `share` = N0/EA; here
        of a law that is linear in the strain."""
        return share

    @property
    def initial_force(self) -> Expr | None:
        """Axial force [N] in the shape of the mesh; None without prestress."""
        strain = self.initial_strain
        if strain is None:
            return None
        return self.constants.EA * strain

    def _free_strain(self, alphas: tuple[Expr, ...], ΔT: Expr) -> Expr:
        from gossamer_fx.mechanics.bodies.thermal_expansion import metric_strain

        # The axial strain is the first; the others do not change.
        axial = metric_strain(alphas[0], ΔT)
        return ufl.as_vector([axial] + [0 * ΔT] * (self.strains - 1))


@check_arguments(at_most_one("length_factor", "initial_tension", "initial_strain"))
class Cable(Curve):
    """A cable whose stress-free shape is the mesh, unless it is prestressed or shortened.

    Kinetic energy ½∫μ|v|² dS, stored energy ∫W(ε + ε0) dS with the Green-Lagrange strain ε =
    ½(x'·x' - 1) and the initial strain ε0; dS is the natural length and x' the derivative with
    respect to it.

    Args:
        mesh: line elements in space.
        law: `CableLaw`, `TensionOnly` or `TabulatedCable`.
        order: 1 (constant strain) or 2.
        thermal: thermal expansion, with the temperature of the cable; default none.
        length_factor: natural length over that of the mesh; below 1 for a cable that is cut shorter
            than the line on which it is mounted, e.g. a foreshortened tendon.
        initial_tension: tension N0 [N] of the cable at its natural length, of a `CableLaw` or
            `TensionOnly`: a number; {group: number} of curves of the mesh, elsewhere none; or a
            function of points (3, n) that returns (n,).
        initial_strain: ε0 in place of a tension, given in the same way.
        displacement: initial displacement [m], a function of the points (3, n) that returns (3, n);
            default none.
        velocity: initial velocity [m/s], given in the same way.
        name: name in messages and output.

    Raises:
        InputError: a mesh, order or length_factor out of range, both initial tension and strain, an
            initial tension with a law that does not say which strain has it.

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
        order: Annotated[int, Range(1, 2)] = 1,
        thermal: ThermalExpansion | None = None,
        length_factor: Annotated[float, positive()] = 1.0,
        initial_tension: Numbers | None = None,
        initial_strain: Numbers | None = None,
        displacement: PointFunction | None = None,
        velocity: PointFunction | None = None,
        name: str = "cable",
    ) -> None:
        check(
            not law.has_history,
            f"Cable '{name}': its law has an unloading curve, whose history only a Tape has; "
            "bond a tape to a film, or give a law without unloading.",
        )
        self._take_mesh(name, mesh, order, size=3, dim=1)
        self.law = law
        self.constants = law.constants(self.mesh.domain)
        self._take_expansion(thermal)
        self.length_factor = length_factor
        self._length_ratio: Expr | None = None
        if length_factor != 1:
            self._length_ratio = constant(self.mesh.domain, length_factor)
        check(
            initial_tension is None or isinstance(law, CableLaw),
            f"'{name}': its initial_tension is given, "
            f"but {type(law).__name__} does not say which strain has it; give initial_strain.",
        )
        self._take_prestress(initial_tension, initial_strain)
        tensions = np.zeros(0)
        if initial_tension is not None:
            tensions = self.constants.initial_tension.x.array
        if isinstance(law, CableLaw) and law.strain == "engineering":
            check_on_all(
                self.comm,
                bool((tensions < law.EA).all()),
                f"Cable '{name}': its initial_tension is {tensions.max(initial=0.0):g} N, "
                f"and the law has {law.EA:g} N at most at the natural length; give less.",
            )
        if isinstance(law, TensionOnly):
            check_on_all(
                self.comm,
                bool((tensions >= 0).all()),
                f"Cable '{name}': its initial_tension is {tensions.min(initial=0.0):g} N, "
                "which a law without compression does not bear; "
                "give a positive number, or a CableLaw.",
            )
        self._displacement = checked(displacement, f"Cable '{name}': its displacement", mesh.comm)
        self._velocity = checked(velocity, f"Cable '{name}': its velocity", mesh.comm)

    def _strain_of_tension(self, share: Expr) -> Expr:
        # Other laws have no initial tension.
        return self.law.green_strain(share) if isinstance(self.law, CableLaw) else share

    def measure(self, x: Expr) -> Expr:
        """Green-Lagrange strain (ε,) of the positions x (3,) [m], a UFL vector, which the law
        takes. It is measured from the natural length, which may differ from that of the mesh by a
        factor, and contains the initial strain."""
        strain = bar_strain(x)[0]
        if self._length_ratio is not None:
            # x' with respect to the natural length is that of the mesh over the ratio of both.
            strain = strain / self._length_ratio**2 + (1 / self._length_ratio**2 - 1) / 2
        initial = self.initial_strain
        if initial is not None:
            strain = strain + initial
        return ufl.as_vector([strain])

    def per_mesh_length(self, value: Expr) -> Expr:
        """A quantity per length of the mesh, of one per natural length."""
        if self._length_ratio is None:
            return value
        return value * self._length_ratio

    def terms(self, start: State) -> Iterable[Term]:
        """Kinetic and stored energy, as integrals over the length of the mesh."""
        numbers = parameters(self.law, self.constants)
        yield KineticEnergy(
            self,
            lambda v, w: (
                self.per_mesh_length(self.constants.line_density) * ufl.inner(v, w) * self.mass_dx
            ),
            parameters=numbers,
        )
        yield stored_energy(
            self,
            numbers,
            self.law.quadratic,
            pieces=self._pieces,
        )

    def _pieces(self, e0: Expr, e1: Expr) -> list[Piece]:
        """The pieces of the law, with stresses [N] of `density`, which is per length of the
        mesh."""

        def scaled(piece: Piece) -> Piece:
            return replace(piece, stress=lambda ea, eb: self.per_mesh_length(piece.stress(ea, eb)))

        return [scaled(piece) for piece in self.law.pieces(e0, e1, self.constants)]

    def density(self, e: Expr) -> Expr:
        """Stored energy per unit length of the mesh [J/m] of the strain e = (ε,)."""
        return self.per_mesh_length(self.law.energy(e, self.constants))

    @property
    def initial_force(self) -> Expr | None:
        """Tension [N] in the shape of the mesh; None without prestress. A cable that is cut short
        has one, too."""
        if self.initial_strain is None and self.length_factor >= 1:
            return None
        x = ufl.SpatialCoordinate(self.mesh.domain)
        return self.axial_force(x, energy_gradient(self.density, self.measure(x)))

    def axial_force(self, q: Expr, S: Expr) -> Expr:
        """Tension N = W'(ε) λ [N] at the positions q (3,), with the stretch λ from the natural
        length.  S (1,) [N] is the stress of `density`, which is per length of the mesh: W' times
        the natural length over that of the mesh."""
        dx = line_derivative(q)
        stretch = ufl.sqrt(ufl.dot(dx, dx))
        if self._length_ratio is not None:
            # One ratio turns S into W', the other x' into the stretch from the natural length.
            stretch = stretch / self._length_ratio**2
        return S[0] * stretch

    def axial_strain(self, e: Expr) -> Expr:
        """Engineering strain λ - 1 of the strain e = (ε,) of `measure` less the thermal strain."""
        return engineering_strain(e)

    @cached_property
    def _start(self) -> tuple[Array, Array]:
        return positions(self.space, self._displacement, self._velocity)
