"""Initial strain of films and lines: prestress.

A body's law is a function of the strain e(x) + e0.  e(x) is the strain from the mesh to the
positions x, and e0 the initial strain: the body in the shape of its mesh has the stress W'(e0).  As
e0 does not depend on x, the sum is quadratic in x like e(x), so that steps conserve energy and
momenta as without it.

An initial stress is converted to the strain that has it, by the stiffness of taut film.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI

from gossamer_fx.core.checks.errors import InputError, check, check_on_all, real_numbers
from gossamer_fx.core.forms.backend import cell_nodes
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.mesh.mesh import Mesh
from gossamer_fx.core.mesh.quality import area_vectors, corner_points
from gossamer_fx.core.model.body import Array
from gossamer_fx.core.model.parameters import Parameter
from gossamer_fx.mechanics.bodies.properties import cellwise
from gossamer_fx.mechanics.materials.film import FilmLaw

# A tensor (3, 3), or a number for one that is the same in all directions; {group: tensor or
# number}; or a function of points (3, n) that returns (3, 3, n) or (n,).
Tensors = (
    float | Array | Sequence[Sequence[float]] | Mapping[str, Any] | Callable[[Array], Array] | None
)

# A number; {group: number}; or a function of points (3, n) that returns (n,).
Numbers = float | Mapping[str, float] | Callable[[Array], Array]

# Compression, or asymmetry, over the largest stress that is round-off of the user's numbers.
COMPRESSION_TOLERANCE = 1e-9
ASYMMETRY_TOLERANCE = 1e-12

# Green-Lagrange strain of a length that is compressed to nothing.
LEAST_STRAIN = -0.5


# SI units of the coefficients of prestress, by their names among the constants of a body.
PRESTRESS_UNITS = {"initial_strain": "", "initial_stress": "Pa", "initial_tension": "N"}


def prestress_parameters(constants: Any) -> tuple[Parameter, ...]:
    """The prestress of a body as parameters of its stored energy; empty without prestress."""
    found = []
    for name, unit in PRESTRESS_UNITS.items():
        coefficient = getattr(constants, name, None)
        if coefficient is not None:
            found.append(Parameter(name, unit, coefficient))
    return tuple(found)


def check_one_given(name: str, strain: Any, stress: Any, stress_name: str) -> None:
    """Refuse an initial strain in addition to an initial stress or tension."""
    check(
        strain is None or stress is None,
        f"'{name}': initial_strain and {stress_name} are both given; give one of them.",
    )


# ---- films ---------------------------------------------------------------------------------------


def film_tensors(mesh: Mesh, given: Tensors, what: str) -> fem.Function:
    """A function of symmetric tensors, constant in each cell, from what a user gave.  Collective.

    Args:
        mesh: triangles of the film.
        given: a number or tensor (3, 3); {group of surfaces: number or tensor}, elsewhere zero; or
            a function of the cells' midpoints (3, n) [m] that returns (n,) or (3, 3, n).  A number
            stands for that multiple of the unit tensor.
        what: subject of the messages.

    Returns:
        Function with values (3, 3) in the unit of what was given: strains, or stresses [Pa].

    Raises:
        InputError: a value of another form, not finite or not symmetric, or a group that is not one
            of triangles.
    """
    if isinstance(given, Mapping):
        by_group = {}
        for group, value in given.items():
            by_group[group] = _tensor(value, f"{what} in '{group}'")
        return cellwise(mesh, by_group, np.zeros((3, 3)), (3, 3), what)
    return cellwise(mesh, _GivenTensors(given, what), np.zeros((3, 3)), (3, 3), what)


def check_stress(mesh: Mesh, stresses: fem.Function, law: FilmLaw, what: str) -> None:
    """Refuse an initial stress that film of a law cannot have at a small strain.  Collective.

    Args:
        mesh: triangles of the film.
        stresses: a tensor (3, 3) [Pa] in each cell.
        law: energy of the film; `taut_strain` is its strain under a given stress.
        what: subject of the messages.

    Raises:
        InputError: the law cannot be inverted, or the film would wrinkle under the stress.
    """
    check(
        type(law).taut_strain is not FilmLaw.taut_strain,
        f"{what} is given, but {type(law).__name__} does not say which strain has it; give "
        "initial_strain.",
    )
    in_film = _projected(mesh, stresses)
    largest = float(np.abs(stresses.x.array).max(initial=0.0))
    largest_in_film = float(np.abs(in_film).max(initial=0.0))
    largest, largest_in_film = mesh.comm.allreduce(np.array([largest, largest_in_film]), MPI.MAX)
    check(
        largest == 0 or largest_in_film > COMPRESSION_TOLERANCE * largest,
        f"{what} is normal to the film, which bears nothing there; give a stress in its plane.",
    )
    if not law.quadratic:
        _check_tensile(mesh, in_film, what)


def check_strain(mesh: Mesh, strains: fem.Function, what: str) -> None:
    """Refuse an initial strain of -½ or less, to which nothing can be compressed.  Collective.

    Args:
        mesh: cells of the body.
        strains: a tensor (3, 3), or a number, in each cell: Green-Lagrange strains.
        what: subject of the messages.

    Raises:
        InputError: on all ranks.
    """
    shape = strains.function_space.value_shape
    smallest = float(strains.x.array.min(initial=0.0))
    if shape:
        smallest = float(np.linalg.eigvalsh(strains.x.array.reshape(-1, *shape)).min(initial=0.0))
    check_on_all(
        mesh.comm,
        smallest > LEAST_STRAIN,
        f"{what} is {smallest:.3g}; a Green-Lagrange strain is above -0.5, that of a length of "
        "zero.",
    )


def strain_in_frame(tensors: fem.Function, frame: Expr) -> Expr:
    """Strain (E11, E22, 2 E12) in the frame (3, 2) of a film, of tensors (3, 3) in space."""
    tensor = _in_frame(tensors, frame)
    return ufl.as_vector([tensor[0, 0], tensor[1, 1], tensor[0, 1] + tensor[1, 0]])


def strain_of_stress(stresses: fem.Function, frame: Expr, law: FilmLaw, constants: Any) -> Expr:
    """Strain (E11, E22, 2 E12) of taut film in its frame (3, 2), of stresses (3, 3) in space
    [Pa]."""
    stress = _in_frame(stresses, frame)
    shear = (stress[0, 1] + stress[1, 0]) / 2
    S = ufl.as_vector([stress[0, 0], stress[1, 1], shear])
    return law.taut_strain(constants.thickness * S, constants)


class _GivenTensors:
    """A tensor, a number or a function of points, as a function of points (3, n) that returns (3,
    3, n)."""

    def __init__(self, given: Tensors, what: str) -> None:
        """Check a tensor; a function is checked by the caller, when it returns.

        Args:
            given: a number, a tensor (3, 3), or a function of points (3, n) [m].
            what: name of the argument, for messages.

        Raises:
            InputError: an array that is not a tensor.
        """
        self._function = given if callable(given) else None
        self._tensor: Array = np.zeros((3, 3))
        if not callable(given) and not isinstance(given, Mapping):
            self._tensor = _tensor(given, what)

    def __call__(self, points: Array) -> Any:
        """Tensors (3, 3, n) at points (3, n) [m], in the unit of what the user gave.

        Numbers (n,) of a user's function become multiples of the unit tensor; other results are
        returned as they are, for the caller to check.
        """
        count = points.shape[1]
        if self._function is None:
            return np.repeat(self._tensor[:, :, None], count, axis=2)
        values = self._function(points)
        if np.shape(values) == (count,):
            return np.eye(3)[:, :, None] * np.asarray(values)
        return values


def _tensor(value: Any, what: str) -> Array:
    """A number or a symmetric tensor (3, 3) as a tensor (3, 3) in the same unit.

    Raises:
        InputError: it is something else, not finite or not symmetric.
    """
    numbers = real_numbers(value)
    if numbers is None or numbers.shape not in ((), (3, 3)) or not np.isfinite(numbers).all():
        raise InputError(
            f"{what} is {value!r}; give a number (the same in all directions) or a symmetric "
            "tensor (3, 3)."
        )
    if numbers.shape == ():
        return np.asarray(float(numbers) * np.eye(3))
    asymmetry = np.abs(numbers - numbers.T).max()
    check(
        bool(asymmetry <= ASYMMETRY_TOLERANCE * np.abs(numbers).max()),
        f"{what} is {value!r}, which is not symmetric; give a symmetric tensor (3, 3).",
    )
    return np.asarray((numbers + numbers.T) / 2)


def _in_frame(tensors: fem.Function, frame: Expr) -> Expr:
    """Components (2, 2) in the frame of a film of tensors (3, 3) in space."""
    return ufl.dot(frame.T, ufl.dot(tensors, frame))


def _projected(mesh: Mesh, stresses: fem.Function) -> Array:
    """Parts in the film of the stresses (n, 3, 3) [Pa] of this rank's n cells."""
    owned = mesh.domain.topology.index_map(2).size_local
    nodes = cell_nodes(stresses.function_space)[:owned].ravel()
    tensors = stresses.x.array.reshape(-1, 3, 3)[nodes]
    normals = area_vectors(corner_points(mesh.domain))[:owned]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    # Projections on the plane of each cell.
    projections = np.eye(3) - normals[:, :, None] * normals[:, None, :]
    in_film: Array = projections @ tensors @ projections
    return in_film


def _check_tensile(mesh: Mesh, in_film: Array, what: str) -> None:
    """Check that film which bears no compression is not compressed by its initial stress, (n, 3, 3)
    [Pa].  Collective.

    Raises:
        InputError: on all ranks, if a principal stress in the film is negative beyond round-off.
    """
    smallest = float(np.linalg.eigvalsh(in_film).min(initial=0.0))
    largest = float(np.abs(in_film).max(initial=0.0))
    check_on_all(
        mesh.comm,
        smallest >= -COMPRESSION_TOLERANCE * largest,
        f"{what} is compressive ({smallest:.3g} Pa), but the film wrinkles then; give a tensile "
        "stress, or a law "
        "without wrinkles such as Linear.",
    )


# ---- cables and beams ----------------------------------------------------------------------------


def line_numbers(mesh: Mesh, given: Numbers, what: str) -> fem.Function:
    """A function that is constant in each cell of a mesh of lines, from what a user gave.
    Collective.

    Args:
        mesh: line elements.
        given: a number; {group of curves: number}, elsewhere zero; or a function of the cells'
            midpoints (3, n) [m] that returns (n,).  In any unit, e.g. N for a tension.
        what: subject of the messages.

    Raises:
        InputError: something else is given, or a number that is not finite.
    """
    if callable(given) or isinstance(given, Mapping):
        return cellwise(mesh, given, 0.0, (), what)
    numbers = real_numbers(given)
    check(
        numbers is not None and numbers.shape == () and bool(np.isfinite(numbers)),
        f"{what} is {given!r}; give a number, {{group: number}} or a function of points (3, n).",
    )
    return cellwise(mesh, {}, float(given), (), what)
