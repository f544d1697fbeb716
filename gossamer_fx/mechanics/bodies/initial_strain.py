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
from gossamer_fx.core.forms.kinematics import Expr
from gossamer_fx.core.mesh.mesh import Mesh
from gossamer_fx.core.model.body import Array
from gossamer_fx.core.model.terms import Parameter
from gossamer_fx.mechanics.bodies.properties import cell_normals, cellwise, owned_values
from gossamer_fx.mechanics.materials.film import FilmLaw
from gossamer_fx.mechanics.terms.element_energies import StoredEnergy

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


def stored_energy(
    body: Any, numbers: tuple[Parameter, ...], quadratic: bool, **law: Any
) -> StoredEnergy:
    """The stored energy of a body on a mesh, with its prestress and thermal strain.

    Parameters of the energy are the `numbers` of its law, the prestress, and what the thermal
    strain depends on; `law` are further arguments of `StoredEnergy`.  Collective."""
    parameters = list(numbers)
    for name, unit in PRESTRESS_UNITS.items():
        coefficient = getattr(body.constants, name, None)
        if coefficient is not None:
            parameters.append(Parameter(name, unit, coefficient))
    thermal = body.thermal_strain()
    if thermal is not None:
        parameters += thermal.parameters
    return StoredEnergy(
        body.name,
        body,
        body.measure,
        body.density,
        body.dx,
        quadratic,
        thermal=thermal,
        parameters=tuple(parameters),
        **law,
    )


# ---- films ---------------------------------------------------------------------------------------


def film_tensors(mesh: Mesh, given: Tensors, what: str) -> fem.Function:
    """A function of symmetric tensors (3, 3), constant in each cell, in the unit of what was given.
    A number stands for that multiple of the unit tensor, the same in all directions.  `what` names
    the argument in messages.  Collective."""
    shape = (3, 3)
    if isinstance(given, Mapping):
        by_group = {}
        for group, value in given.items():
            by_group[group] = _tensor(value, f"{what} in '{group}'")
        return cellwise(mesh, by_group, np.zeros(shape), shape, what)
    if not callable(given):
        return cellwise(mesh, {}, _tensor(given, what), shape, what)

    def tensors(points: Array) -> Any:
        values = given(points)
        if np.shape(values) == (points.shape[1],):
            return np.eye(3)[:, :, None] * np.asarray(values)
        return values

    return cellwise(mesh, tensors, np.zeros(shape), shape, what)


def check_stress(mesh: Mesh, stresses: fem.Function, law: FilmLaw, what: str) -> None:
    """Refuse an initial stress (3, 3) [Pa] that film of a law cannot have at a small strain.
    Collective."""
    check(
        type(law).taut_strain is not FilmLaw.taut_strain,
        f"{what} is given, but {type(law).__name__} does not say which strain has it; "
        "give initial_strain.",
    )
    # Projections on the plane of each cell.
    normals = cell_normals(mesh)
    projections = np.eye(3) - normals[:, :, None] * normals[:, None, :]
    in_film = projections @ owned_values(stresses) @ projections
    largest = mesh.comm.allreduce(float(np.abs(stresses.x.array).max(initial=0.0)), MPI.MAX)
    largest_in_film = mesh.comm.allreduce(float(np.abs(in_film).max(initial=0.0)), MPI.MAX)
    check(
        largest == 0 or largest_in_film > COMPRESSION_TOLERANCE * largest,
        f"{what} is normal to the film, which bears nothing there; give a stress in its plane.",
    )
    # A law that is quadratic bears compression.
    smallest = float(np.linalg.eigvalsh(in_film).min(initial=0.0))
    check_on_all(
        mesh.comm,
        law.quadratic or smallest >= -COMPRESSION_TOLERANCE * largest_in_film,
        f"{what} is compressive ({smallest:.3g} Pa), but the film wrinkles then; "
        "give a tensile stress, or a law without wrinkles such as Linear.",
    )


def check_strain(mesh: Mesh, strains: fem.Function, what: str) -> None:
    """Refuse an initial strain, a tensor (3, 3) or a number in each cell, of -½ or less, to which
    nothing can be compressed.  Collective."""
    shape = strains.function_space.value_shape
    smallest = float(strains.x.array.min(initial=0.0))
    if shape:
        smallest = float(np.linalg.eigvalsh(strains.x.array.reshape(-1, *shape)).min(initial=0.0))
    check_on_all(
        mesh.comm,
        smallest > LEAST_STRAIN,
        f"{what} is {smallest:.3g}; "
        "a Green-Lagrange strain is above -0.5, that of a length of zero.",
    )


def strain_in_frame(tensors: fem.Function, frame: Expr) -> Expr:
    """Strain (E11, E22, 2 E12) in the frame (3, 2) of a film, of tensors (3, 3) in space."""
    tensor = _in_frame(tensors, frame)
    return ufl.as_vector([tensor[0, 0], tensor[1, 1], tensor[0, 1] + tensor[1, 0]])


def strain_of_stress(stresses: fem.Function, frame: Expr, law: FilmLaw, constants: Any) -> Expr:
    """Strain (E11, E22, 2 E12) in the frame (3, 2) of a film at which it is taut and has stresses
    (3, 3) in space [Pa]; `constants` are those of its law."""
    stress = _in_frame(stresses, frame)
    shear = (stress[0, 1] + stress[1, 0]) / 2
    S = ufl.as_vector([stress[0, 0], stress[1, 1], shear])
    return law.taut_strain(constants.thickness * S, constants)


def _tensor(value: Any, what: str) -> Array:
    """A number or a symmetric tensor (3, 3) as a tensor (3, 3) in the same unit."""
    numbers = real_numbers(value)
    if numbers is None or numbers.shape not in ((), (3, 3)) or not np.isfinite(numbers).all():
        raise InputError(
            f"{what} is {value!r}; "
            "give a number (the same in all directions) or a symmetric tensor (3, 3)."
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


# ---- cables and beams ----------------------------------------------------------------------------


def line_numbers(mesh: Mesh, given: Numbers, what: str) -> fem.Function:
    """A function that is constant in each cell of a mesh of lines, in the unit of what was given.
    Collective."""
    if callable(given) or isinstance(given, Mapping):
        return cellwise(mesh, given, 0.0, (), what)
    numbers = real_numbers(given)
    check(
        numbers is not None and numbers.shape == () and bool(np.isfinite(numbers)),
        f"{what} is {given!r}; give a number, {{group: number}} or a function of points (3, n).",
    )
    return cellwise(mesh, {}, float(given), (), what)
