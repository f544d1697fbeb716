"""Films: membranes without bending stiffness on a triangle mesh in space."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import Mesh as DolfinxMesh

from gossamer_fx.bodies.ports import global_node, interpolated, local_nodes
from gossamer_fx.errors import check
from gossamer_fx.kinematics import Expr, frame, green_lagrange, surface_gradient
from gossamer_fx.materials import FilmLaw, constants
from gossamer_fx.mesh import Mesh
from gossamer_fx.parts import Array, Block, Kinetic, Part, Port, Stored

PointFunction = Callable[[Array], Array]


class Membrane:
    """A film whose stress-free shape is the mesh.

    Kinetic energy ½∫ρt |v|² dA, stored energy ∫W(E) dA with the Green-Lagrange strain of the surface; dA is the
    reference area.

    Args:
        mesh: triangles in space, flat or curved.
        law: energy per unit area, e.g. `Miyazaki`.
        order: 1 (constant strain) or 2.
        displacement: initial displacement [m], a function of the points (3, n) that returns (3, n); default none.
        velocity: initial velocity [m/s], likewise.
        name: name in messages and output.
    """

    def __init__(
        self,
        mesh: Mesh | DolfinxMesh,
        law: FilmLaw,
        *,
        order: int = 1,
        displacement: PointFunction | None = None,
        velocity: PointFunction | None = None,
        name: str = "film",
    ) -> None:
        self.mesh = mesh if isinstance(mesh, Mesh) else Mesh(mesh)
        domain = self.mesh.domain
        check(
            domain.topology.dim == 2 and domain.geometry.dim == 3,
            f"Membrane '{name}': the mesh has cells of dimension {domain.topology.dim} in {domain.geometry.dim}-D "
            "space; give triangles in 3-D.",
        )
        check(order in (1, 2), f"Membrane '{name}': order is {order!r}; use 1 or 2.")
        check(
            order >= domain.geometry.cmap.degree,
            f"Membrane '{name}': a film of order {order} cannot take the curved shape of a mesh of order "
            f"{domain.geometry.cmap.degree} without stress; use order=2, or mesh with plane triangles.",
        )
        self.name, self.law, self.order, self.comm = name, law, order, domain.comm
        self.space = fem.functionspace(domain, ("Lagrange", order, (3,)))
        self.block = Block(self.space.dofmap.index_map, 3)
        self.constants = constants(law, domain)
        self._frame = frame(domain)
        self._displacement = _checked(displacement, f"Membrane '{name}': its displacement")
        self._velocity = _checked(velocity, f"Membrane '{name}': its velocity")
        degree = max(2 * (order - 1), 1)
        self.dx = ufl.Measure("dx", domain, metadata={"quadrature_degree": degree})
        self.mass_dx = ufl.Measure("dx", domain, metadata={"quadrature_degree": 2 * order})

    def measure(self, x: Expr) -> Expr:
        """Green-Lagrange strain (E11, E22, 2 E12) of the positions x."""
        return green_lagrange(self.deformation(x))

    def deformation(self, x: Expr) -> Expr:
        """F (3x2) of the positions x."""
        return surface_gradient(x, self._frame)

    def density(self, e: Expr) -> Expr:
        """Stored energy per unit reference area."""
        return self.law.energy(e, self.constants)

    @property
    def area_density(self) -> Expr:
        """Mass per unit reference area [kg/m²]."""
        return self.constants.density * self.constants.thickness

    def parts(self) -> Iterable[Part]:
        yield Kinetic(self, lambda v, w: self.area_density * ufl.inner(v, w) * self.mass_dx)
        yield Stored(self.name, self, self.measure, self.density, self.dx, self.law.quadratic)

    def initial_state(self) -> tuple[Array, Array]:
        x, v = fem.Function(self.space), fem.Function(self.space)
        x.interpolate(lambda X: X)
        if self._displacement is not None:
            u = fem.Function(self.space)
            u.interpolate(self._displacement)
            x.x.array[:] += u.x.array
        if self._velocity is not None:
            v.interpolate(self._velocity)
        owned = self.block.index_map.size_local * 3
        return x.x.array[:owned].copy(), v.x.array[:owned].copy()

    def describe(self, node: int) -> str:
        x, y, z = self.space.tabulate_dof_coordinates()[node]
        return f"at the node ({x:.6g}, {y:.6g}, {z:.6g}) m of the mesh"

    def nodes(self, group: str) -> np.ndarray:
        """Local nodes (owned and ghost) of a named group of the mesh."""
        return local_nodes(self.space, self.mesh, group)

    def port(self, group: str) -> Port:
        """The node of a named point of the mesh."""
        return Port(self, (global_node(self, self.mesh, group),))

    def port_at(self, point: Sequence[float]) -> Port:
        """The point that is at `point` [m] of the mesh, also between nodes."""
        return interpolated(self, point)


def _checked(function: PointFunction | None, what: str) -> PointFunction | None:
    """The function, with a check of what it returns."""
    if function is None:
        return None
    check(callable(function), f"{what} is {function!r}; give a function of the points (3, n) that returns (3, n).")

    def values(points: Array) -> Array:
        result = np.asarray(function(points), dtype=float)
        check(
            result.shape == points.shape,
            f"{what} function returns an array {result.shape} for points {points.shape}; it must return (3, n).",
        )
        return result

    return values
