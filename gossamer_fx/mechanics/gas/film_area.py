"""The deformed area of a film, or of a part of it, as the area of an opening: films that leak."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import ufl
from dolfinx import fem, la
from mpi4py import MPI

from gossamer_fx.core.checks.arguments import check_arguments
from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.forms.compilation import compile_form
from gossamer_fx.core.forms.kinematics import area_vector
from gossamer_fx.core.model.body import Array, has_nodal_unknowns
from gossamer_fx.core.model.item import Item
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.bodies.properties import cells_of_group
from gossamer_fx.mechanics.terms.assembly import Assembly


def named_triangles(film: Membrane, surface: tuple[str, ...], user: str) -> np.ndarray:
    """Return the local triangles (n,) of named groups, owned and ghost, in rising order; of the
    whole film if no group is named.  `InputError`: a group is not one of triangles."""
    if not surface:
        return all_triangles(film)
    return np.unique(np.concatenate([cells_of_group(film.mesh, name, user) for name in surface]))


def all_triangles(film: Membrane) -> np.ndarray:
    """All local triangles of a film (owned and ghost).  `InputError`: it is a reduced film."""
    check(
        has_nodal_unknowns(film),
        f"'{film.name}' is a reduced film, whose triangles are samples; gas needs the film itself.",
    )
    index_map = film.mesh.domain.topology.index_map(2)
    return np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)


@check_arguments
@dataclass(frozen=True, eq=False)
class FilmArea:
    """The deformed area [m²] of a film as the `area` of an opening, half a step ahead of the known
    state like that of a `Ring`.

    Args:
        body: the film.
        surface: names of groups of its triangles; empty for the whole film.

    Example:
        >>> outside = gx.gas.Ambient(1e5, 300.0)
        >>> fabric = gx.gas.FilmArea(film)
        >>> leak = gx.Orifice(tank, outside, area=fabric, discharge_coefficient=0.01)
    """

    body: Membrane
    surface: tuple[str, ...] = ()

    def requires(self) -> Iterable[Item]:
        """The film, which joins the scene with the opening."""
        yield self.body

    def compile(self, system: Assembly) -> CompiledFilmArea:
        """The area in a running scene.  Collective."""
        return CompiledFilmArea(self, system)


class CompiledFilmArea:
    """A `FilmArea` in a running scene: A = ∫ |n| dA_0 of the area vector n per reference area."""

    def __init__(self, area: FilmArea, system: Assembly) -> None:
        film = area.body
        self._film = film
        self._system = system
        self._owned = system.block(film).owned
        self._x = fem.Function(film.space)
        domain = film.mesh.domain
        cells = named_triangles(film, area.surface, f"FilmArea of '{film.name}'")
        owned = domain.topology.index_map(2).size_local
        # |n| is not polynomial for curved triangles: the degree of its square is enough.
        dx = ufl.Measure(
            "dx",
            domain,
            subdomain_data=[(1, cells[cells < owned])],
            subdomain_id=1,
            metadata={"quadrature_degree": 4 * (film.order - 1)},
        )
        n = area_vector(film.deformation(self._x))
        size = ufl.sqrt(ufl.dot(n, n)) * dx
        self._size = compile_form(size)
        self._slope = compile_form(ufl.derivative(size, self._x, ufl.TestFunction(film.space)))

    def aperture(self, h: float) -> float:
        """The area [m²] at q0 + ½ h v0 for a step of length h [s].  Collective."""
        self._predict(h)
        share = float(fem.assemble_scalar(self._size))
        return float(self._film.comm.allreduce(share, op=MPI.SUM))

    def aperture_gradient(self, h: float) -> Array:
        """Derivative [m] of the area of `aperture` by the owned unknowns of the film at q0,
        flattened; that by v0 is ½ h times as large.  Collective."""
        self._predict(h)
        vector = fem.assemble_vector(self._slope)
        vector.scatter_reverse(la.InsertMode.add)
        return vector.array[: self._owned.stop - self._owned.start].copy()

    def add_own(self, values: Array, gradient: Array) -> None:
        """Add a gradient of `aperture_gradient` to this rank's part of a vector of the system."""
        values[self._owned] += gradient

    def _predict(self, h: float) -> None:
        """Set the positions [m] at the middle of the coming step."""
        start = self._system.q0.array_r[self._owned]
        velocity = self._system.v0.array_r[self._owned]
        self._film.reconstruct(self._x, start + h / 2 * velocity)
