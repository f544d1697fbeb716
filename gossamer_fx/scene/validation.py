"""Validation of a scene before it is computed: errors, and warnings.

Errors are sentences that are raised as `InputError`; warnings are told once each, by the logger `gossamer_fx` on
rank 0.  All checks are local to the ranks but for sums, and cost less than compiling one form.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from mpi4py import MPI

from gossamer_fx.bodies.meshed import Meshed
from gossamer_fx.checks.errors import check
from gossamer_fx.forms.spaces import cell_nodes
from gossamer_fx.mesh.edges import edges_of
from gossamer_fx.mesh.quality import (
    corner_points,
    crossings,
    extent,
    folded,
    open_seams,
    shape_quality,
    sizes,
    turned_inside,
)
from gossamer_fx.model.body import Array, Body, MeshBody, is_body, is_on_mesh

LOG = logging.getLogger("gossamer_fx")

_FLAT, _SLIVER = 1e-9, 5e-4  # qualities of triangles without area, and of aspect ratio about 3000
_THICK = 0.1  # of a film's extent
_THIN = 1e-4  # of a plate's smallest cell
# smallest and largest values of what is built or flown, in SI units, and the unit that is probably meant beyond
_USUAL = {
    "E": (1e4, 2e12, "Pa"),
    "thickness": (1e-8, 1e-2, "m"),
    "density": (0.1, 3e4, "kg/m³"),
    "line_density": (1e-9, 1e4, "kg/m"),
    "temperature": (1.0, 1e4, "K"),
    "pressure": (0.0, 1e9, "Pa"),
    "outer_radius": (1e-6, 1e2, "m"),
}
_EXTENT = (1e-4, 1e5)  # m

_told: set[str] = set()


def validate(items: Iterable[Any], comm: MPI.Intracomm) -> None:
    """Check the meshes of the bodies and the sizes of numbers.

    Raises:
        InputError: cells without area or length, curved cells that turn inside.
    """
    for words in warnings(list(items)):
        if words not in _told and comm.rank == 0:
            LOG.warning(words)
        _told.add(words)


def warnings(items: list[Any]) -> Iterator[str]:
    """Sentences about what is possible but probably not meant, the same on every rank."""
    for item in items:
        if is_body(item) and is_on_mesh(item):
            yield from _of_mesh(item)
        for holder in (item, getattr(item, "law", None)):
            yield from _of_numbers(item.name, holder)


def _of_mesh(body: MeshBody) -> Iterator[str]:
    domain, comm = body.space.mesh, body.comm
    corners, size = corner_points(domain), extent(domain)
    kind = "triangle" if corners.shape[1] == 3 else "line element"
    quality = shape_quality(corners) if corners.shape[1] == 3 else sizes(corners) / (size or 1.0)
    flat, slivers = comm.allreduce(
        np.array([(quality < _FLAT).sum(), (quality < _SLIVER).sum()])
    ).tolist()
    check(
        flat == 0,
        f"'{body.name}' has {flat} {kind}{'s' * (flat > 1)} of no size, the nodes of which are in one place or on a "
        "line; mesh it again, or remove duplicate nodes.",
    )
    if not _EXTENT[0] <= size <= _EXTENT[1]:
        yield f"The mesh of '{body.name}' is {size:.3g} m large; lengths are in metres."
    seams = open_seams(domain, body.mesh.groups if isinstance(body, Meshed) else {})
    if seams:
        yield (
            f"{seams} boundary edges of '{body.name}' coincide without being joined; if this is a seam, glue it by "
            "removing duplicate nodes (gmsh: model.mesh.removeDuplicateNodes), and if it is a slit, name its two sides."
        )
    if corners.shape[1] == 3:
        turned = turned_inside(domain)
        check(
            turned == 0,
            f"'{body.name}' has {turned} curved triangles that turn inside out near a corner; mesh it finer there, or "
            "with plane triangles.",
        )
        if slivers:
            worst = comm.allreduce(float(quality.min(initial=1.0)), op=MPI.MIN)
            yield (
                f"'{body.name}' has {slivers} slivers among its triangles (worst quality {worst:.1e}, one is "
                "equilateral); they cost accuracy and iterations."
            )
        table = edges_of(domain)
        count, directions = table.tally(np.arange(len(corners), dtype=np.int32))
        opposite = comm.allreduce(int(((count == 2) & (directions != 0)).sum()))
        if opposite:
            yield (
                f"Normals of '{body.name}' change sides at {opposite} edges: pressure would push to both sides (gmsh: "
                "model.mesh.reverse)."
            )
        upside_down = folded(table)
        if upside_down:
            yield f"'{body.name}' has {upside_down} triangles upside down on their neighbours; look at its mesh."
        thickness = getattr(getattr(body, "law", None), "thickness", 0.0)
        smallest = comm.allreduce(float(np.sqrt(sizes(corners)).min(initial=np.inf)), op=MPI.MIN)
        if getattr(body, "bends", False) and 0 < thickness < _THIN * smallest:
            yield (
                f"The plate '{body.name}' is {thickness / smallest:.1g} of its smallest cells thick: they carry a "
                f"compressive strain of {(math.pi * thickness / smallest) ** 2 / 48:.0e} before they bend; a Membrane "
                "does as well and costs less."
            )
        if thickness > _THICK * size:
            yield f"The film '{body.name}' is {thickness:.3g} m thick and {size:.3g} m large; thickness is in metres."


def _of_numbers(name: str, holder: Any) -> Iterator[str]:
    for attribute, (least, most, unit) in (_USUAL | getattr(holder, "USUAL", {})).items():
        value = getattr(holder, attribute, None)
        if isinstance(value, int | float) and not least <= value <= most:
            yield f"'{name}': {attribute} = {value:g} {unit} is unusual; numbers are in SI units."


def self_intersections(bodies: list[Body]) -> Iterator[str]:
    """Sentences about films that pierce themselves at the start; this costs more than the rest, hence on request."""
    for body in bodies:
        if not is_on_mesh(body) or body.space.mesh.topology.dim != 2:
            continue
        n = body.space.mesh.topology.index_map(2).size_local
        dofs = cell_nodes(body.space)[:n, :3].astype(np.int64)
        nodes = body.space.dofmap.index_map.local_to_global(dofs.ravel().astype(np.int32)).reshape(
            -1, 3
        )
        pierced = crossings(body.comm, _positions(body)[dofs], nodes.astype(np.int64))
        if pierced:
            yield f"'{body.name}' pierces itself at the start in {pierced} triangles; nothing keeps them apart."


def _positions(body: MeshBody) -> Array:
    """Initial positions of all local nodes (n, 3)."""
    from dolfinx import fem

    x = fem.Function(body.space)
    owned, _ = body.initial_state()
    x.x.array[: len(owned)] = owned
    x.x.scatter_forward()
    positions: Array = x.x.array.reshape(-1, 3)
    return positions
