"""Validation of a scene before it is computed: errors and warnings about meshes and numbers.

Errors are raised as `InputError`.  Warnings are printed once each, by the logger `gossamer_fx` on
rank 0.  Ranks exchange only sums, and all checks together take less time than the compilation of
one form.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from dolfinx import fem
from dolfinx.mesh import Mesh as DolfinxMesh
from mpi4py import MPI

from gossamer_fx.core.checks.errors import check
from gossamer_fx.core.forms.backend import cell_nodes, geometry_element
from gossamer_fx.core.mesh.edges import edges_of
from gossamer_fx.core.mesh.quality import (
    NO_SIZE,
    aspects,
    box,
    cell_quality,
    corner_points,
    extent,
    folded,
    folded_in_plane,
    open_seams,
    share_of_bent_edges,
    turned_inside,
)
from gossamer_fx.core.model.body import Body, MeshBody
from gossamer_fx.mechanics.bodies.membrane import Membrane
from gossamer_fx.mechanics.bodies.meshed import Meshed
from gossamer_fx.mechanics.terms.scalar_unknowns import BringsScalarUnknowns

LOG = logging.getLogger("gossamer_fx")

# Quality of a triangle below which it is a sliver: an aspect ratio of about 3000.
_SLIVER = 5e-4

# A film thicker than this part of its extent probably has its thickness in millimetres.
_THICK = 0.1

# Thickness of a plate over its size and over the largest aspect ratio of its cells, below which its
# bending forces are less than the round-off of its membrane forces.  Measured with cantilevers of 8
# cells in equilibrium, t over length: aspect 1 is right down to 1e-7 and wrong at 3e-8; aspect 30
# is right down to 3e-7 with a deflection of 1e-3 of the length, and down to 3e-6 with one of 0.1;
# aspect 1000 is 1.5e6 times too stiff at 1e-4.
_ROUND_OFF_THIN = 2e-7

# Smallest and largest values of structures that are built or flown, and their unit.  Values outside
# are probably in another unit.  The films and fibres of `presets` have E from 2e9 to 5e11
# Pa, 900 to 2000 kg/m³ and 2e-6 to 1e-3 m; rubber, foams and metals extend the ranges.
# The last entry is the likely slip.
_USUAL = {
    "E": (1e4, 2e12, "Pa", ""),
    "thickness": (1e-8, 1e-2, "m", "is it in nm, µm or mm?"),
    "density": (5.0, 3e4, "kg/m³", ""),
    "line_density": (1e-9, 1e4, "kg/m", ""),
    "temperature": (1.0, 1e4, "K", "is it in degrees Celsius?"),
    "pressure": (0.0, 1e9, "Pa", ""),
    "outer_radius": (1e-6, 1e2, "m", ""),
    "g": (0.0, 1e3, "m/s²", "is it in mm/s²?"),
    "friction": (0.0, 3.0, "", "is it in per cent?"),
    "discharge_coefficient": (0.01, 1.5, "", "is it in per cent?"),
}

# Largest initial strain that rubber has.
_STRAIN = 1.0

# Mean stretch of a film by an initial displacement that is probably one.  Positions instead of it
# give two.
_STRETCH = 1.5

# Smallest and largest extent [m] of a mesh that is probably in metres.
_EXTENT = (1e-4, 1e5)
# Of a film: the largest sails that were designed are 200 m large.
_FILM_EXTENT = 300.0

# Width of a plate over its thickness below which it is too stiff in its plane by more than 3 %.
_WIDE_PLATE = 0.1

# Share of the interior edges at which neighbouring triangles enclose an angle, from which on a mesh
# is that of a curved surface; of a film with folds it is less.
_CURVED_SHARE = 0.5

# Warnings that this process has printed, or rank 0 for it.
_printed: set[str] = set()


def validate(items: Iterable[Any], comm: MPI.Intracomm) -> None:
    """Check the meshes of bodies and the magnitude of numbers; print warnings.  Collective."""
    for words in warnings(list(items)):
        if words not in _printed and comm.rank == 0:
            LOG.warning(words)
        _printed.add(words)


def warnings(items: list[Any]) -> Iterator[str]:
    """Yield warnings about meshes, and numbers of items and their laws, that are possible but
    probably wrong; the same on all ranks.  Collective, also in between: each rank has to iterate to
    the end."""
    for item in items:
        if isinstance(item, Body) and isinstance(item, MeshBody):
            yield from _of_mesh(item)
            yield from _of_strain(item)
            yield from _of_displacement(item)
            yield from _of_properties(item)
        for holder in (item, getattr(item, "law", None)):
            yield from _of_numbers(item.name, holder)
        yield from _of_gas(item)
        # Obstacles are not items of a scene: a contact has them.
        for obstacle in getattr(item, "obstacles", ()):
            yield from _of_numbers(f"{obstacle.name} of {item.name}", obstacle)
        yield from item.warnings(items)


def _of_mesh(body: MeshBody) -> Iterator[str]:
    """Yield warnings about the mesh of one body: its size [m], open seams, slivers, normals that
    change sides, triangles upside down, and the thickness of plates.  Cells of no size, and curved
    ones that turn inside out, raise `InputError`.  Collective."""
    domain = body.space.mesh
    comm = body.comm
    corners = corner_points(domain)
    size = extent(domain)
    kind = "triangle" if corners.shape[1] == 3 else "line element"
    quality = cell_quality(corners, size)
    counts = np.array([(quality < NO_SIZE).sum(), (quality < _SLIVER).sum()])
    flat, slivers = comm.allreduce(counts).tolist()
    check(
        flat == 0,
        f"'{body.name}' has {flat} {kind}{'s' * (flat > 1)} of no size, the nodes of "
        "which are at one point or on a line; mesh it again, or remove duplicate nodes.",
    )
    if not _EXTENT[0] <= size <= _EXTENT[1]:
        yield f"The mesh of '{body.name}' is {size:.3g} m large; lengths are in metres."
    elif corners.shape[1] == 3 and size > _FILM_EXTENT:
        yield (
            f"The film '{body.name}' is {size:.3g} m large, which is unusual; lengths are in "
            "metres: is the mesh in millimetres?"
        )
    groups = {}
    if isinstance(body, Meshed):
        groups = body.mesh.groups
    seams = open_seams(domain, groups)
    if seams:
        yield (
            f"{seams} boundary edges of '{body.name}' coincide without being joined; "
            "if this is a seam, glue it by removing duplicate nodes (gmsh: "
            "model.mesh.removeDuplicateNodes), and if it is a slit, name its two sides."
        )
    if corners.shape[1] == 3:
        turned = turned_inside(domain)
        check(
            turned == 0,
            f"'{body.name}' has {turned} curved triangles that turn inside out near a corner; "
            "mesh it finer there, or with plane triangles.",
        )
        if slivers:
            worst = comm.allreduce(float(quality.min(initial=1.0)), op=MPI.MIN)
            yield (
                f"'{body.name}' has {slivers} slivers among its triangles (worst quality "
                f"{worst:.1e}, one is equilateral); they cost accuracy and iterations."
            )
        table = edges_of(domain)
        count, directions = table.tally(np.arange(len(corners), dtype=np.int32))
        opposite = comm.allreduce(int(((count == 2) & (directions != 0)).sum()))
        if opposite:
            yield (
                f"Normals of '{body.name}' change sides at {opposite} edges: "
                "pressure would push to both sides; make or read the mesh with orient=True, "
                "or turn surfaces (gmsh: model.mesh.reverse)."
            )
        upside_down = folded(table)
        in_plane, share = folded_in_plane(table)
        if in_plane:
            yield (
                f"'{body.name}' has {in_plane} triangles upside down in its plane, "
                f"{share:.2g} of its area, "
                "so that it covers a part of the plane more than once and has a wrong stiffness; "
                "mesh it again, or move back the nodes that crossed an edge."
            )
        elif upside_down:
            yield (
                f"'{body.name}' has {upside_down} triangles upside down on their neighbours; "
                "look at its mesh."
            )
        is_flat_of_order_2 = (
            isinstance(body, Membrane)
            and not body.bends
            and body.order == 2
            and geometry_element(domain).degree == 1
        )
        if is_flat_of_order_2 and share_of_bent_edges(table) > _CURVED_SHARE:
            yield (
                f"'{body.name}' is of order 2 on a curved mesh of plane triangles, which cut off "
                "what the surface bulges over them, as those of order 1 do; make the mesh of order "
                "2 (gmsh: model.mesh.setOrder(2))."
            )
        thickness = getattr(getattr(body, "law", None), "thickness", 0.0)
        varying = getattr(getattr(body, "constants", None), "thickness", None)
        if isinstance(varying, fem.Function):
            thickness = _ends(varying)[-1]
        bends = getattr(body, "bends", False) and thickness > 0
        aspect = comm.allreduce(float(aspects(corners).max(initial=1.0)), op=MPI.MAX)
        if bends and thickness < _ROUND_OFF_THIN * aspect * size:
            yield (
                f"The plate '{body.name}' is {thickness / size:.1g} of its size thick, "
                f"and its cells have aspect ratios of up to {aspect:.3g}: below a thickness "
                f"of {_ROUND_OFF_THIN * aspect:.1g} its bending forces are less than the round-off "
                "of its membrane forces, and it may be too stiff by any factor; "
                "give cells of aspect near one, or a Membrane."
            )
        width = _width(domain) if bends else size
        if bends and thickness > _WIDE_PLATE * width:
            factor = 1 + 3 * (thickness / width) ** 2
            yield (
                f"The plate '{body.name}' is {thickness:.3g} m thick and {width:.3g} m wide: in "
                f"its plane it is too stiff by 1 + 3 (t/b)² = {factor:.3g}; "
                "take a Beam for so narrow a strip."
            )
        if thickness > _THICK * size:
            yield (
                f"The film '{body.name}' is {thickness:.3g} m thick and {size:.3g} m large; "
                "thickness is in metres."
            )


def _width(domain: DolfinxMesh) -> float:
    """The second largest extent [m] of a mesh along the principal axes of its nodes, e.g. the width
    of a strip.  Collective."""
    comm = domain.comm
    x = domain.geometry.x
    sums = comm.allreduce(np.concatenate([x.sum(axis=0), [len(x)]]))
    arms = x - sums[:3] / sums[3]
    axes = np.linalg.eigh(comm.allreduce(arms.T @ arms))[1]
    low, high = box(comm, arms @ axes)
    return float(np.sort(high - low)[1])


def _of_numbers(name: str, holder: Any) -> Iterator[str]:
    """Warnings about numbers of an item or its law that are probably in another unit."""
    for attribute, usual in (_USUAL | getattr(holder, "USUAL", {})).items():
        value = getattr(holder, attribute, None)
        if attribute == "g" and isinstance(value, tuple):
            value = float(np.linalg.norm(value))
        if isinstance(value, int | float):
            yield from _of_number(name, attribute, value, usual)


def _of_number(
    name: str, attribute: str, value: float, usual: tuple[float, float, str, str]
) -> Iterator[str]:
    """A warning if a number is out of its usual range: least, most, unit and the likely slip."""
    least, most, unit, slip = usual
    if least <= value <= most:
        return
    with_unit = f" {unit}" if unit else ""
    question = f": {slip}" if slip else "."
    yield (
        f"'{name}': {attribute} = {value:g}{with_unit} is unusual, "
        f"{least:g} to {most:g}{with_unit} is not; numbers are in SI units{question}"
    )


def _of_properties(body: MeshBody) -> Iterator[str]:
    """Warnings about properties that differ from cell to cell.  Collective."""
    for attribute, usual in _USUAL.items():
        field = getattr(getattr(body, "constants", None), attribute, None)
        if isinstance(field, fem.Function):
            for value in _ends(field):
                yield from _of_number(body.name, attribute, value, usual)


def _ends(field: fem.Function) -> tuple[float, ...]:
    """The least and the largest value of a field, once if they are equal.  Collective."""
    comm = field.function_space.mesh.comm
    own = field.x.array
    least = comm.allreduce(float(own.min(initial=np.inf)), op=MPI.MIN)
    most = comm.allreduce(float(own.max(initial=-np.inf)), op=MPI.MAX)
    return (least, most) if most > least else (least,)


def _of_gas(item: Any) -> Iterator[str]:
    """Warnings about the gas of an item, and about boundaries of gas that are not items."""
    if not isinstance(item, BringsScalarUnknowns):
        return
    # Imported here, as scenes without gas must not pay for it.
    from gossamer_fx.mechanics.gas.contract import Holder

    for attribute in ("a", "b", "outside"):
        boundary = getattr(item, attribute, None)
        if isinstance(boundary, Holder):
            yield from _of_numbers(boundary.name, boundary)
            yield from _of_gas(boundary)
    gas = getattr(item, "gas", None)
    for species in getattr(gas, "species", ()):
        yield from _of_numbers(species.name, species)


def _of_strain(body: MeshBody) -> Iterator[str]:
    """Warnings about an initial strain that is probably in per cent or ppm.  Collective."""
    strains = getattr(getattr(body, "constants", None), "initial_strain", None)
    if strains is None:
        return
    own = float(np.abs(strains.x.array).max(initial=0.0))
    largest = body.comm.allreduce(own, op=MPI.MAX)
    if largest > _STRAIN:
        yield (
            f"'{body.name}': initial_strain = {largest:g} is unusual, up to {_STRAIN:g} is not; "
            "it is a ratio of lengths."
        )


def _of_displacement(body: MeshBody) -> Iterator[str]:
    """Warnings about an initial displacement of a film, not of rubber, that is probably the
    position of the points.  Collective."""
    # The unknowns of a reduced film are coefficients of its modes.
    if not isinstance(body, Membrane) or body.full is not body:
        return
    start = body.initial_state()[0].reshape(-1, 3)
    mesh = body.space.tabulate_dof_coordinates()
    corners = cell_nodes(body.space)[:, :3]
    # Ghost nodes have no start; a mean needs no cells that have some.
    corners = corners[(corners < len(start)).all(axis=1)]
    lengths = []
    for points in (start, mesh):
        sides = points[corners] - points[np.roll(corners, 1, axis=1)]
        lengths.append(np.linalg.norm(sides, axis=2).sum())
    deformed, own = body.comm.allreduce(np.array(lengths)).tolist()
    if deformed <= _STRETCH * own:
        return
    # Imported here, as scenes without rubber must not pay for it.
    from gossamer_fx.mechanics.materials.rubber import MooneyRivlin, NeoHooke

    if not isinstance(body.law, NeoHooke | MooneyRivlin):
        yield (
            f"The initial displacement of '{body.name}' stretches it to {deformed / own:.2g} times "
            "its size; a displacement is the new position less that on the mesh."
        )
