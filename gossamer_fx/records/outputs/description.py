"""Description of a compiled scene: as data for a file, and as lines of text."""

from __future__ import annotations

import shlex
import sys
import time
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from gossamer_fx.core.mesh.quality import box, corner_points, sizes
from gossamer_fx.core.model.body import Body, MeshBody
from gossamer_fx.mechanics.terms.masses import KineticEnergy
from gossamer_fx.mechanics.terms.rows import AttachedKineticEnergy
from gossamer_fx.solve.view import StateView
from gossamer_fx.version import VERSION

Description = dict[str, Any]

# Packages whose versions may change results; they are recorded with a run.
_PACKAGES = ("fenics-dolfinx", "fenics-ufl", "petsc4py", "mpi4py", "numpy", "gmsh")

# Digits of a commit, and characters of a command line, that are recorded with a run.
_COMMIT_DIGITS = 10
_LONGEST_COMMAND = 500


def describe(run: StateView) -> Description:
    """Bodies, items, gas, energies and momenta of the present state, as data for `run.json`.

    Masses [kg], areas [m²], lengths [m], boxes [m], pressures [Pa], temperatures [K], volumes [m³],
    energies [J], momenta [kg m/s, kg m²/s].  Collective; the same on every rank.
    """
    system = run.system
    totals = run.totals
    massive: set[Body] = set()  # bodies with a mass
    for term in system.unknowns.terms:
        if isinstance(term, KineticEnergy):
            massive.add(term.body)
        if isinstance(term, AttachedKineticEnergy):
            massive.update(port.body for ports in term.ports for port in ports)
    # Joints add frames to sections of beams, which have no mass and which a user does not know as
    # bodies.
    bodies = {}
    section_frames = []
    for body in system.unknowns.bodies:
        if body in massive:
            bodies[body.name] = _body(run, body)
        else:
            section_frames.append(body.name)
    chambers = {}
    for name, state in run.chambers.items():
        chambers[name] = {
            "pressure": state.pressure,
            "temperature": state.temperature,
            "volume": state.volume,
            "mass": state.mass,
        }
    items = {
        item.name: type(item).__name__ for item in run.scene.items if not isinstance(item, Body)
    }
    return {
        "unknowns": system.unknowns.numbering.size + system.matrices.scalar_count,
        "ranks": run.comm.size,
        "bodies": bodies,
        "section frames": section_frames,
        "items": items,
        "chambers": chambers,
        "energies": {"kinetic": totals.kinetic, **totals.stored},
        "momentum": totals.momentum.tolist(),
        "angular momentum": totals.angular_momentum.tolist(),
    }


def _body(run: StateView, body: Body) -> Description:
    """Kind, size, mass [kg], surrounding box [m] and law of a body, as data for JSON.  Collective.

    Returns:
        a dictionary; on a mesh with the number of cells, the order, and the area [m²] or length
        [m].
    """
    nodes = body.block.index_map.size_global
    positions = run.system.unknowns.state[body].node_positions()
    found: Description = {
        "kind": type(body).__name__,
        "nodes": nodes,
        "unknowns": nodes * body.block.size,
        "mass": _mass(run, body),
        "box": [corner.tolist() for corner in box(run.comm, positions)],
    }
    if isinstance(body, MeshBody):
        domain = body.space.mesh
        dimension = domain.topology.dim
        own_size = float(sizes(corner_points(domain)).sum())
        found["cells"] = domain.topology.index_map(dimension).size_global
        found["order"] = body.space.ufl_element().degree
        measure = "length"
        if dimension == 2:
            measure = "area"
        found[measure] = run.comm.allreduce(own_size)
        mesh = getattr(body, "mesh", None)
        # Bodies of users have a function space, and not always a mesh with groups.
        if mesh is not None:
            found["groups"] = sorted(mesh.groups)
    # Films and cables have a law, beams a section.
    for name in ("law", "section"):
        law = getattr(body, name, None)
        if is_dataclass(law):
            numbers = {field.name: getattr(law, field.name) for field in fields(law)}
            found["law"] = [type(law).__name__, numbers]
    return found


def _mass(run: StateView, body: Body) -> float:
    """Mass of a body [kg]: e·M e, where e moves it along x by one and nothing else.  Collective."""
    system = run.system
    owned = system.unknowns.block(body).owned
    along_x = np.zeros(owned.stop - owned.start)
    # The first vector of each node is its position; others are directors, which do not move.
    along_x.reshape(-1, 3)[:: body.block.size // 3, 0] = 1.0
    motion = system.unknowns.numbering.vector()
    motion.array[owned] = along_x
    momentum = system.unknowns.M.createVecLeft()
    system.unknowns.M.mult(motion, momentum)
    return float(motion.dot(momentum))


def versions() -> dict[str, str]:
    """Versions of this package and of those that it is built on, by name.

    Packages that are not installed are left out.
    """
    found = {"gossamer_fx": VERSION}
    for name in _PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


def origin() -> dict[str, str]:
    """What makes a run: the command line, the time, and the commit of this package if it is that of
    a checkout."""
    found = {"command": _command(), "date": time.strftime("%Y-%m-%d %H:%M"), "commit": _commit()}
    return {name: value for name, value in found.items() if value}


def _command() -> str:
    """The command line, with the package by its name and a script by that of its file."""
    program = Path(sys.argv[0] if sys.argv else "")
    name = "gossamer" if program.name == "__main__.py" else program.name
    words = sys.argv[1:]
    # The folder is where the page is.
    return shlex.join([name, *words])[:_LONGEST_COMMAND]


@cache
def _commit() -> str:
    """The commit of the checkout that this package is in, without a call of git; empty if it is in
    none, e.g. as it is installed."""
    try:
        folder = Path(__file__).parents[3] / ".git"
        # In a further work tree it is a file that names the folder.
        if folder.is_file():
            folder = Path(folder.read_text().removeprefix("gitdir:").strip())
        head = (folder / "HEAD").read_text().strip()
        if not head.startswith("ref: "):
            return head[:_COMMIT_DIGITS]
        reference = head.removeprefix("ref: ")
        common = folder / "commondir"
        if common.is_file():
            folder = folder / common.read_text().strip()
        if (folder / reference).is_file():
            return (folder / reference).read_text().strip()[:_COMMIT_DIGITS]
        for line in (folder / "packed-refs").read_text().splitlines():
            if line.endswith(f" {reference}"):
                return line[:_COMMIT_DIGITS]
    except (OSError, ValueError):
        pass
    return ""


def lines(about: Mapping[str, Any]) -> list[str]:
    """A description of a run as lines of text: one for each body and chamber."""
    ranks = f"{about['ranks']} ranks"
    if about["ranks"] == 1:
        ranks = "1 rank"
    rows = [("unknowns", f"{about['unknowns']} on {ranks}")]
    for name, body in about["bodies"].items():
        rows.append((f"body '{name}'", ", ".join(_body_words(body))))
        if "law" in body:
            law, numbers = body["law"]
            values = [f"{key} {number_text(value)}" for key, value in numbers.items()]
            rows.append(("", f"{law}: {', '.join(values)}"))
    if about["section frames"]:
        names = [f"'{name}'" for name in about["section frames"]]
        rows.append(("section frames", ", ".join(names)))
    if about["items"]:
        items = [f"{kind} '{name}'" for name, kind in about["items"].items()]
        rows.append(("other items", ", ".join(items)))
    for name, gas in about["chambers"].items():
        state = (
            f"{gas['pressure']:.6g} Pa, {gas['temperature']:.6g} K, {gas['volume']:.6g} m³, "
            f"{gas['mass']:.6g} kg"
        )
        rows.append((f"gas in '{name}'", state))
    mass = sum(body["mass"] for body in about["bodies"].values())
    rows.append(("mass", f"{mass:.6g} kg"))
    energies = [f"{name} {energy:.6g} J" for name, energy in about["energies"].items()]
    rows.append(("energies", ", ".join(energies)))
    width = max(len(name) for name, _ in rows) + 2
    return [name.ljust(width) + words for name, words in rows]


def _body_words(body: Mapping[str, Any]) -> list[str]:
    """The kind, size and mass of a body in words, e.g. "120 cells of order 1", "mass 0.3 kg"."""
    words = [body["kind"]]
    if "cells" in body:
        words.append(f"{body['cells']} cells of order {body.get('order', '?')}")
    words.append(f"{body['unknowns']} unknowns")
    words.append(f"mass {body['mass']:.6g} kg")
    for what, unit in (("area", "m²"), ("length", "m")):
        if what in body:
            words.append(f"{what} {body[what]:.6g} {unit}")
    # Bodies of users need not have them.
    if "groups" in body:
        words.append(f"groups: {', '.join(body['groups']) or 'none'}")
    return words


def number_text(value: Any) -> str:
    """A number with six digits; any other value as it is."""
    if isinstance(value, float):
        return f"{value:.6g}"
    return str(value)
