"""What a compiled scene contains, as data for a file, and as lines for people."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from importlib import metadata
from typing import Any

import numpy as np

from gossamer_fx.mesh.quality import box, corner_points, sizes
from gossamer_fx.model.body import Body, is_body, is_on_mesh
from gossamer_fx.probes.run import Run
from gossamer_fx.terms.masses import KineticEnergy, NodeKineticEnergy
from gossamer_fx.version import VERSION

Description = dict[str, Any]

_PACKAGES = ("fenics-dolfinx", "fenics-ufl", "petsc4py", "mpi4py", "numpy", "gmsh", "adios2")


def describe(run: Run) -> Description:
    """Bodies, roles, gas, energies and momenta of the present state; the same on every rank.

    Bodies are what has a mass; the frames that joints add to sections of beams are named apart from them.

    Masses [kg], areas [m²], lengths [m], boxes [m], pressures [Pa], temperatures [K], volumes [m³], energies [J].
    """
    system, totals = run.system, run.totals
    roles = Counter(type(part).__name__ for part in system.terms)
    others = [item for item in run.scene.items if not is_body(item)]
    massive = {
        part.body for part in system.terms if isinstance(part, KineticEnergy | NodeKineticEnergy)
    }
    return {
        "unknowns": system.numbering.size + sum(border.size for border in system.scalar_unknowns),
        "ranks": run.comm.size,
        "bodies": {body.name: _body(run, body) for body in system.bodies if body in massive},
        "section frames": [body.name for body in system.bodies if body not in massive],
        "roles": dict(sorted(roles.items())),
        "items": {item.name: type(item).__name__ for item in others},
        "chambers": {
            name: {
                "pressure": s.pressure,
                "temperature": s.temperature,
                "volume": s.volume,
                "mass": s.mass,
            }
            for name, s in run.chambers.items()
        },
        "energies": {"kinetic": totals.kinetic, **totals.stored},
        "momentum": totals.momentum.tolist(),
        "angular momentum": totals.angular_momentum.tolist(),
    }


def _body(run: Run, body: Body) -> Description:
    system, comm = run.system, run.comm
    nodes = body.block.index_map.size_global
    found: Description = {
        "kind": type(body).__name__,
        "nodes": nodes,
        "unknowns": nodes * body.block.size,
    }
    owned = system.block(body).owned
    first = system.numbering.vector()
    along = np.zeros(owned.stop - owned.start)
    along.reshape(-1, 3)[:: body.block.size // 3, 0] = 1.0
    first.array[owned] = along
    weight = system.M.createVecLeft()
    system.M.mult(first, weight)
    found["mass"] = float(first.dot(weight))
    x = system.state[body].positions()
    found["box"] = [corner.tolist() for corner in box(comm, x)]
    if is_on_mesh(body):
        domain = body.space.mesh
        dim = domain.topology.dim
        found["cells"] = domain.topology.index_map(dim).size_global
        found["order"] = body.space.ufl_element().degree
        found["area" if dim == 2 else "length"] = comm.allreduce(
            float(sizes(corner_points(domain)).sum())
        )
    for name in ("law", "section"):
        law = getattr(body, name, None)
        if is_dataclass(law):
            found["law"] = type(law).__name__, {f.name: getattr(law, f.name) for f in fields(law)}
    return found


def versions() -> dict[str, str]:
    """Of this project and what it stands on."""
    return {"gossamer_fx": VERSION} | {
        name: version for name in _PACKAGES if (version := _version(name))
    }


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return ""


def lines(about: Mapping[str, Any]) -> list[str]:
    """A description for the terminal."""
    rows: list[tuple[str, str]] = [
        ("unknowns", f"{about['unknowns']} on {about['ranks']} rank{'s' * (about['ranks'] > 1)}")
    ]
    for name, body in about["bodies"].items():
        words = [body["kind"]]
        if "cells" in body:
            words.append(f"{body['cells']} cells of order {body['order']}")
        words.append(f"{body['unknowns']} unknowns")
        words.append(f"mass {body['mass']:.6g} kg")
        words += [
            f"{what} {body[what]:.6g} {unit}"
            for what, unit in (("area", "m²"), ("length", "m"))
            if what in body
        ]
        rows.append((f"body '{name}'", ", ".join(words)))
        if "law" in body:
            law, numbers = body["law"]
            rows.append(
                ("", f"{law}: " + ", ".join(f"{key} {value:.6g}" for key, value in numbers.items()))
            )
    if about.get("section frames"):  # descriptions of older runs have none
        rows.append(("section frames", ", ".join(f"'{name}'" for name in about["section frames"])))
    rows.append(
        ("parts per role", ", ".join(f"{role} {n}" for role, n in about["roles"].items()) or "none")
    )
    if about["items"]:
        rows.append(
            ("other items", ", ".join(f"{kind} '{name}'" for name, kind in about["items"].items()))
        )
    for name, gas in about["chambers"].items():
        rows.append(
            (
                f"gas in '{name}'",
                f"{gas['pressure']:.6g} Pa, {gas['temperature']:.6g} K, {gas['volume']:.6g} m³, {gas['mass']:.6g} kg",
            )
        )
    rows.append(("mass", f"{sum(body['mass'] for body in about['bodies'].values()):.6g} kg"))
    rows.append(
        (
            "energies",
            ", ".join(f"{name} {energy:.6g} J" for name, energy in about["energies"].items()),
        )
    )
    width = max(len(name) for name, _ in rows) + 2
    return [name.ljust(width) + words for name, words in rows]
