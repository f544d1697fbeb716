"""What cables and beams have in common: a mesh of line elements in space."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING

import ufl
from dolfinx import fem
from dolfinx.mesh import Mesh as DolfinxMesh

from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.mesh.mesh import Mesh
from gossamer_fx.core.model.body import Block
from gossamer_fx.mechanics.bodies.initial_strain import (
    Numbers,
    check_one_given,
    check_strain,
    line_numbers,
)
from gossamer_fx.mechanics.bodies.meshed import Meshed

if TYPE_CHECKING:
    from gossamer_fx.mechanics.materials.thermal import ThermalExpansion
    from gossamer_fx.mechanics.terms.thermal_strain import ThermalStrain


class Curve(Meshed):
    """A body on line elements: `size` numbers a node, Lagrange elements of an `order`."""

    # of its law or section, as coefficients of forms; EA [N] where there is one
    constants: SimpleNamespace

    def __init__(
        self,
        kind: str,
        name: str,
        mesh: Mesh | DolfinxMesh,
        order: int,
        size: int,
    ) -> None:
        """Check that the mesh consists of lines, and make the space of the coordinates.
        Collective.

        Args:
            kind, name: class and name of the body, for messages.
            mesh: of line elements in three dimensions [m].
            order: of the Lagrange elements, 1 or 2.
            size: numbers a node: 3 of the position [m], and 3 of each director (an axis of the
                section).

        Raises:
            InputError: the mesh has other cells, or the order is not possible.
        """
        self.mesh = mesh if isinstance(mesh, Mesh) else Mesh(mesh)
        domain = self.mesh.domain
        check(
            domain.topology.dim == 1 and domain.geometry.dim == 3,
            f"{kind} '{name}': the mesh has cells of dimension {domain.topology.dim} in "
            f"{domain.geometry.dim}-D space; "
            "give line elements in 3-D.",
        )
        self.name = name
        self.comm = domain.comm
        self.order = order
        self.space = fem.functionspace(domain, ("Lagrange", order, (size,)))
        self.block = Block(self.space.dofmap.index_map, size)
        # the strain of the element is taken where it does not lock
        self.dx = ufl.Measure("dx", domain, metadata={"quadrature_degree": max(2 * (order - 1), 1)})
        self.mass_dx = ufl.Measure("dx", domain, metadata={"quadrature_degree": 2 * order})

    def _take_prestress(self, tension: Numbers | None, strain: Numbers | None) -> None:
        """Add an initial axial strain or force to the constants of the body.

        Args:
            tension: force [N]: a number, {group of the mesh: number}, or a function of points (3,
                n) that returns (n,); None: none.
            strain: Green-Lagrange strain (dimensionless), given in the same way.

        Raises:
            InputError: both are given, or something that is not finite or has another form.
        """
        # A restart compares these arguments, see `outputs.arguments`.
        self._initial_tension = tension
        self._initial_strain = strain
        check_one_given(self.name, strain, tension, "initial_tension")
        if strain is not None:
            what = f"'{self.name}': its initial_strain"
            self.constants.initial_strain = line_numbers(self.mesh, strain, what)
            check_strain(self.mesh, self.constants.initial_strain, what)
        if tension is not None:
            what = f"'{self.name}': its initial_tension"
            self.constants.initial_tension = line_numbers(self.mesh, tension, what)

    @property
    def initial_strain(self) -> Expr | None:
        """Initial axial strain ε0 (dimensionless) as a UFL expression; None without prestress.

        It was given itself, or follows from the initial tension N0 [N] by ε0 = N0/EA.
        """
        strain = getattr(self.constants, "initial_strain", None)
        if strain is not None:
            return strain
        tension = getattr(self.constants, "initial_tension", None)
        if tension is not None:
            # At the natural length the axial force is EA ε0.
            return tension / self.constants.EA
        return None

    @property
    def initial_force(self) -> Expr | None:
        """Axial force [N] in the shape of the mesh, a UFL expression; None without prestress."""
        strain = self.initial_strain
        if strain is None:
            return None
        return self.constants.EA * strain

    def _take_expansion(self, kind: str, thermal: ThermalExpansion | None) -> None:
        """Set the thermal expansion, which must be one along the line."""
        self.thermal = thermal
        if thermal is not None:
            # Imported here: a body without thermal expansion does not load it.
            from gossamer_fx.mechanics.bodies.thermal_expansion import (
                check_expansion,
                check_no_gradient,
            )

            check_expansion(thermal, f"{kind} '{self.name}'", has_axes=False)
            check_no_gradient(thermal, f"{kind} '{self.name}'")

    def _thermal_strain(self, kind: str, components: int) -> ThermalStrain | None:
        """The thermal strain of the line for one compiled scene; None without thermal expansion.

        Collective.

        Args:
            components: number of strains of the body.  The first is the axial one (dimensionless)
                and expands with the temperature [K]; the others are not affected.

        Raises:
            InputError: a temperature is given for a group that does not consist of line elements.
        """
        if self.thermal is None:
            return None
        from gossamer_fx.mechanics.bodies.thermal_expansion import metric_strain, thermal_strain

        return thermal_strain(
            self,
            lambda alphas, ΔT: ufl.as_vector(
                [metric_strain(alphas[0], ΔT)] + [0 * ΔT] * (components - 1)
            ),
            f"{kind} '{self.name}'",
        )
