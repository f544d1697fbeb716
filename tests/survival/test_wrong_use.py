"""Wrong use of the whole public API, each case in a separate process: a sentence, or the right
result.

Single arguments of another kind, sign or size, and functions that misbehave, are generated in
tests/unit/test_bad_input.py and tests/unit/test_hostile_arguments.py; refusals whose words count
are in tests/unit/test_refused_scenes.py, test_mesh.py and test_mesh_quality.py.  Here are other
arguments that do not fit each other, files, orders of calls, objects that are used twice or
changed, and geometry that cannot be.

    ./gossamer python -m pytest -s tests/survival/test_wrong_use.py    # counts by class
"""

from __future__ import annotations

import json
import math
import os
import resource
import signal
import traceback
from collections import Counter
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.app.cli.command import main as command
from gossamer_fx.meshes.airbag import airbag
from gossamer_fx.meshes.arrays import mesh_of_arrays
from gossamer_fx.meshes.creased import creased_film
from gossamer_fx.meshes.disc import quarter_disc, ring
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.meshes.tube import flat_tube
from tests.sentences import is_line_of_command, is_sentence
from tests.small_scenes import AIR, LINEAR, WRINKLING, body, film, plate, tank

pytestmark = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="a fork has no other ranks")

ONE = MPI.COMM_SELF
ZERO = (0.0, 0.0, 0.0)
X = (1.0, 0.0, 0.0)
Z = (0.0, 0.0, 1.0)
# Seconds after which a case counts as hanging: many times what the slowest one takes.
HANGS = 150
# Bytes that a case may take, so that one that asks for all of them fails alone.
MEMORY = 4 * 2**30
LONGEST_SENTENCE = 700
REFUSED = (gx.InputError, gx.StepFailure, gx.NoEquilibrium, gx.OutputFailure)

FABRIC = {"E1": 1e9, "E2": 1e8, "nu12": 0.3, "G12": 1e8, "density": 1400.0, "thickness": 1e-4}

Case = Callable[[Path], Any]


# ---- parts ---------------------------------------------------------------------------------------


def mass(name: str = "mass", at: Any = ZERO) -> gx.PointMass:
    return gx.PointMass(1.0, at, comm=ONE, name=name)


def bag(**options: Any) -> gx.Membrane:
    return gx.Membrane(airbag(ONE, 1.0, 2), WRINKLING, **options)


def simulation(*parts: Any, dt: float = 1e-4, **options: Any) -> gx.Simulation:
    return gx.Simulation(gx.Scene(*parts), gx.Midpoint(dt=dt), **options)


def run(*parts: Any, until: Any = 2e-4, **options: Any) -> gx.Simulation:
    made = simulation(*parts, **options)
    made.run(until=until)
    return made


def held(load: Callable[[gx.Membrane], Any] | None = None, **options: Any) -> gx.Equilibrium:
    """The equilibrium of a film between two edges, with a load."""
    sail = film(**options)
    loads = [load(sail)] if load is not None else []
    made = gx.Equilibrium(gx.Scene(sail, gx.Fixed(sail, "left"), gx.Fixed(sail, "right"), *loads))
    made.find()
    return made


def with_film(part: Callable[[gx.Membrane], Any], **options: Any) -> gx.Simulation:
    sail = film(**options)
    return run(sail, part(sail))


def energy(run: gx.Simulation) -> float:
    return float(run.totals.energy)


def same(one: float, other: float) -> bool:
    return math.isclose(one, other, rel_tol=1e-9, abs_tol=1e-12)


def arrays(points: Any, cells: Any, **groups: Any) -> gx.Mesh:
    """A mesh of given points and triangles."""
    given = {name: np.array(nodes) for name, nodes in groups.items()}
    return mesh_of_arrays(ONE, lambda: (np.array(points, float), np.array(cells), given))


SQUARE = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
TRIANGLES = [(0, 1, 2), (0, 2, 3)]


def of_arrays(points: Any = SQUARE, cells: Any = TRIANGLES, **groups: Any) -> gx.Simulation:
    return run(gx.Membrane(arrays(points, cells, **groups), LINEAR))


def of_gmsh(build: Callable[[Any], Any]) -> Any:
    return run(gx.Membrane(gx.gmsh_mesh(build, ONE), LINEAR))


def rectangle(model: Any, size: float = 0.5) -> None:
    model.occ.addRectangle(0, 0, 0, 1, 1)
    model.occ.synchronize()
    model.mesh.setSize(model.getEntities(0), size)
    model.mesh.generate(2)


def written(path: Path, text: str | bytes) -> Path:
    """A file with a text or bytes."""
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def saved(at: Path) -> Path:
    """The checkpoints of a run in a folder."""
    run(film(), checkpoints=gx.Checkpoints(at / "saves", every=1))
    return at / "saves"


def recorded(at: Path) -> gx.plot.RunReader:
    run(film(), outputs=[gx.Recording(at / "run", every=1, probes={"a": lambda run: run.time})])
    return gx.plot.RunReader(at / "run")


def said(words: list[str], capture: Any = None) -> Any:
    """The command, with what it prints instead of an error as an error of the package."""
    import contextlib
    import io

    err = io.StringIO()
    with contextlib.redirect_stderr(err):
        try:
            code = command(words)
        except SystemExit as leave:
            code = leave.code
    if code in (1, 2):
        # Lines of progress may come before.
        *_, last = err.getvalue().splitlines(keepends=True)
        assert is_line_of_command(last), err.getvalue()
        raise gx.InputError(err.getvalue().strip())
    return "taken"


# ---- meshes --------------------------------------------------------------------------------------

MESHES: dict[str, Case] = {
    "one triangle": lambda at: of_arrays(SQUARE[:3], [(0, 1, 2)]).time == 2e-4,
    "unused nodes": lambda at: of_arrays([*SQUARE, (9, 9, 9)]).time == 2e-4,
    "a negative node": lambda at: of_arrays(SQUARE, [(0, 1, -1)]),
    "a node that is not there": lambda at: of_arrays(SQUARE, [(0, 1, 99)]),
    "nodes that are floats": lambda at: of_arrays(SQUARE, [(0.5, 1.0, 2.0)]),
    "cells of four nodes": lambda at: of_arrays(SQUARE, [(0, 1, 2, 3)]),
    "no cells": lambda at: of_arrays(SQUARE, np.zeros((0, 3), int)),
    "points in a plane of two coordinates": lambda at: of_arrays([p[:2] for p in SQUARE]),
    "points of 1e200 m": lambda at: of_arrays(1e200 * np.array(SQUARE)),
    "far from the origin": lambda at: of_arrays(np.add(SQUARE, [1e12, 0, 0])),
    "complex points": lambda at: mesh_of_arrays(
        ONE, lambda: (1j * np.array(SQUARE), np.array(TRIANGLES), {})
    ),
    "arrays that are lists": lambda at: mesh_of_arrays(ONE, lambda: (SQUARE, TRIANGLES, {})),
    "a group of nodes that are not there": lambda at: gx.Fixed(
        gx.Membrane(arrays(SQUARE, TRIANGLES, rim=[[7, 8]]), LINEAR), "rim"
    ),
    "a group across a cell": lambda at: gx.Fixed(
        gx.Membrane(
            arrays([*SQUARE, (2, 0, 0), (2, 1, 0)], [*TRIANGLES, (1, 4, 5)], rim=[[0, 4]]), LINEAR
        ),
        "rim",
    ),
    "opposite normals": lambda at: of_arrays(SQUARE, [(0, 1, 2), (0, 3, 2)]).time == 2e-4,
    "two parts": lambda at: (
        of_arrays([*SQUARE[:3], (5, 0, 0), (6, 0, 0), (6, 1, 0)], [(0, 1, 2), (3, 4, 5)]).time
        == 2e-4
    ),
    "parts at one node": lambda at: (
        of_arrays([*SQUARE[:3], (-1, 0, 0), (0, -1, 0)], [(0, 1, 2), (0, 3, 4)]).time == 2e-4
    ),
    "a fold over itself": lambda at: (
        of_arrays([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0.1, 0.1, 0)], [(0, 1, 2), (0, 1, 3)]).time
        == 2e-4
    ),
    "a mesh of a mesh": lambda at: gx.Membrane(film(), LINEAR),
    "a domain for a mesh": lambda at: (
        run(gx.Membrane(sheet(ONE, 2, 2).domain, LINEAR)).time == 2e-4
    ),
    "lines for a film": lambda at: gx.Membrane(line(ONE, [ZERO, X], 2), LINEAR),
    "triangles for a cable": lambda at: gx.Cable(sheet(ONE, 1, 1), gx.CableLaw(1.0, 1.0)),
    "gmsh not meshed": lambda at: of_gmsh(
        lambda model: (model.occ.addRectangle(0, 0, 0, 1, 1), model.occ.synchronize())
    ),
    "gmsh of solids": lambda at: of_gmsh(
        lambda model: (
            model.occ.addBox(0, 0, 0, 1, 1, 1),
            model.occ.synchronize(),
            model.mesh.generate(3),
        )
    ),
    "gmsh of order three": lambda at: of_gmsh(
        lambda model: (rectangle(model), model.mesh.setOrder(3))
    ),
    "gmsh ended by the user": lambda at: of_gmsh(lambda model: __import__("gmsh").finalize()),
    "gmsh in gmsh": lambda at: of_gmsh(lambda model: gx.gmsh_mesh(rectangle, ONE)),
    "cells of 1e-7 m": lambda at: of_gmsh(lambda model: rectangle(model, 1e-7)),
    "an exit in gmsh": lambda at: of_gmsh(lambda model: exit(3)),
    "1e9 cells": lambda at: sheet(ONE, 10**9, 1),
    "1e9 elements": lambda at: line(ONE, [ZERO, X], 10**9),
    "a line of no length": lambda at: line(ONE, [ZERO, ZERO], 2),
    "a line that comes back": lambda at: (
        run(gx.Cable(line(ONE, [ZERO, X, ZERO], 2), gx.CableLaw(1e5, 0.1))).time == 2e-4
    ),
    "a closed line of two points": lambda at: line(ONE, [ZERO, X], 1, closed=True),
    "elements of another count": lambda at: line(ONE, [ZERO, X], [1, 2]),
    "points of two numbers": lambda at: line(ONE, [(0, 0), (1, 0)], 2),
    "a ring with two cells around": lambda at: ring(ONE, 1.0, 2.0, 1, 2).cells == 8,
    "a disc of 1e8 cells": lambda at: quarter_disc(ONE, 10**8),
    "a tube of 1e7 compartments": lambda at: flat_tube(ONE, 1.0, 0.1, 4, 10**7),
    "a creased film that crosses itself": lambda at: creased_film(
        ONE, [(0, 0), (1, 1), (1, 0), (0, 1)], [], [0.3] * 4
    ),
    "a creased film of tiny cells": lambda at: creased_film(
        ONE, [(0, 0), (1, 0), (1, 1), (0, 1)], [], [1e-7] * 4
    ),
    "a crease outside the film": lambda at: (
        creased_film(ONE, [(0, 0), (1, 0), (1, 1), (0, 1)], [((5, 5), (6, 6))], [0.3] * 4).cells > 8
    ),
    "a group of dimension seven": lambda at: gx.Mesh(
        sheet(ONE, 1, 1).domain, {"left": (7, np.zeros(1, dtype=np.int32))}
    ).group("left"),
    "a group by number": lambda at: sheet(ONE, 1, 1).group(3),
    "a communicator that is null": lambda at: sheet(MPI.COMM_NULL, 1, 1),
}

MESH_FILES: dict[str, Case] = {
    "empty": lambda at: gx.read_mesh(written(at / "a.msh", ""), ONE),
    "a folder": lambda at: gx.read_mesh(at, ONE),
    "a device": lambda at: gx.read_mesh("/dev/null", ONE),
    "a fifo": lambda at: (os.mkfifo(at / "a.msh"), gx.read_mesh(at / "a.msh", ONE)),
    "binary noise": lambda at: gx.read_mesh(written(at / "a.msh", os.urandom(5000)), ONE),
    "noise behind a header": lambda at: gx.read_mesh(
        written(at / "a.msh", b"$MeshFormat\n4.1 1 8\n" + os.urandom(5000)), ONE
    ),
    "a header alone": lambda at: gx.read_mesh(
        written(at / "a.msh", "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n"), ONE
    ),
    "a loop of links": lambda at: (
        (at / "a.msh").symlink_to(at / "a.msh"),
        gx.read_mesh(at / "a.msh", ONE),
    ),
    "a name of 5000 letters": lambda at: gx.read_mesh("a" * 5000, ONE),
    "a billion nodes said": lambda at: gx.read_mesh(
        written(
            at / "a.msh",
            "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 99999999 1 99999999\n$EndNodes\n",
        ),
        ONE,
    ),
}

# ---- drawings ------------------------------------------------------------------------------------


def drawn(at: Path, draw: Callable[[Any], Any], size: float = 0.3, **options: Any) -> gx.Mesh:
    import ezdxf

    document = ezdxf.new("R2010")
    document.header["$INSUNITS"] = 6
    draw(document.modelspace())
    document.saveas(at / "a.dxf")
    return gx.patterns.read_dxf(at / "a.dxf", ONE, size=size, **options)


def polygon(model: Any, *points: Any, **attributes: Any) -> None:
    model.add_lwpolyline(points, close=True, dxfattribs=attributes)


def square(model: Any, x: float = 0.0, y: float = 0.0, side: float = 1.0, **given: Any) -> None:
    polygon(model, (x, y), (x + side, y), (x + side, y + side), (x, y + side), **given)


def nested(model: Any, depth: int, copies: int, itself: bool = False) -> None:
    """Blocks in blocks, each `copies` times the one below, the first a square."""
    blocks = [model.doc.blocks.new(f"b{k}") for k in range(depth)]
    square(blocks[0])
    for k in range(1, depth):
        for copy in range(copies):
            blocks[k].add_blockref(f"b{k - 1}", (2 * copy * 2**k, 0))
    if itself:
        blocks[0].add_blockref(f"b{depth - 1}", (3, 3))
    model.add_blockref(f"b{depth - 1}", (0, 0))


def panels(mesh: gx.Mesh) -> int:
    return sum(name.startswith("panel") and "/" not in name for name in mesh.groups)


def array_of_panels(model: Any) -> None:
    square(model.doc.blocks.new("b"), side=0.5)
    insert = model.add_blockref("b", (0, 0))
    insert.grid(size=(2, 3), spacing=(1.0, 1.0))


def reference(model: Any) -> None:
    square(model)
    model.doc.add_xref_def("missing.dxf", "other")
    model.add_blockref("other", (5, 5))


def inclined(model: Any) -> None:
    model.add_polyline3d([(0, 0, 0), (1, 0, 0), (1, 1, 1), (0, 1, 1)], close=True)


def tilted(model: Any) -> None:
    model.add_circle((0, 0), 1.0, dxfattribs={"extrusion": (0, 0.6, 0.8)})


def damaged(at: Path, seed: int) -> Any:
    """A drawing of which bytes are changed at random."""
    drawn(at, lambda model: (square(model), model.add_circle((5, 0), 1)))
    content = bytearray((at / "a.dxf").read_bytes())
    random = np.random.default_rng(seed)
    for k in random.integers(len(content) // 2, len(content), 200):
        content[k] = random.integers(256)
    written(at / "a.dxf", bytes(content))
    return panels(gx.patterns.read_dxf(at / "a.dxf", ONE, size=0.5)) == 2


DRAWINGS: dict[str, Case] = {
    "crosses itself": lambda at: drawn(at, lambda m: polygon(m, (0, 0), (1, 1), (1, 0), (0, 1))),
    "touches itself": lambda at: drawn(
        at, lambda m: polygon(m, (0, 0), (2, 0), (1, 1), (2, 2), (0, 2), (1, 1))
    ),
    "there and back": lambda at: drawn(at, lambda m: polygon(m, (0, 0), (1, 0), (2, 0))),
    "the same line twice": lambda at: drawn(at, lambda m: (square(m), square(m))),
    "tiny cells": lambda at: drawn(at, square, size=1e-7),
    "huge cells": lambda at: panels(drawn(at, square, size=1e6)) == 1,
    "a circle of 1e300": lambda at: drawn(at, lambda m: m.add_circle((0, 0), 1e300)),
    "a circle of radius nan": lambda at: drawn(at, lambda m: m.add_circle((0, 0), math.nan)),
    "a point at infinity": lambda at: drawn(
        at, lambda m: polygon(m, (0, 0), (math.inf, 0), (0, 1))
    ),
    "1e9 nested squares": lambda at: drawn(at, lambda m: nested(m, 10, 10)),
    "a block in itself": lambda at: drawn(at, lambda m: nested(m, 2, 1, itself=True)),
    "blocks 2000 deep": lambda at: panels(drawn(at, lambda m: nested(m, 2000, 1))) == 1,
    "a spline of degree 200": lambda at: drawn(
        at,
        lambda m: m.add_spline(dxfattribs={"degree": 200}).set_uniform(
            [(math.cos(k), math.sin(k), 0) for k in range(300)], degree=200
        ),
    ),
    "a spline of no points": lambda at: drawn(at, lambda m: (square(m), m.add_spline())),
    "an array of 3 x 2": lambda at: panels(drawn(at, array_of_panels)) == 6,
    "an inclined panel": lambda at: drawn(at, inclined),
    "a tilted circle": lambda at: drawn(at, tilted),
    "a hole across the outline": lambda at: drawn(at, lambda m: (square(m), square(m, 0.5, 0.5))),
    "a hole that touches": lambda at: drawn(at, lambda m: (square(m), square(m, 0.0, 0.25, 0.5))),
    "overlapping panels": lambda at: drawn(at, lambda m: (square(m), square(m, 0.9, 0.9, 5.0))),
    "a missing reference": lambda at: drawn(at, reference),
    "an insert of no block": lambda at: drawn(
        at, lambda m: (square(m), m.add_blockref("nowhere", (5, 5)))
    ),
    "a text without words": lambda at: (
        panels(drawn(at, lambda m: (square(m), m.add_text("", dxfattribs={"insert": (0.5, 0.5)}))))
        == 1
    ),
    "a name with a slash": lambda at: drawn(
        at,
        lambda m: (
            square(m, layer="0"),
            m.add_text("panel 2/0", dxfattribs={"insert": (0.5, 0.5)}),
            square(m, 3.0, layer="0"),
        ),
    ),
    "1e5 panels": lambda at: drawn(at, lambda m: [square(m, 2.0 * k) for k in range(10**5)]),
    "a scale of 1e90": lambda at: drawn(at, square, scale=1e90),
    "a line thinner than round-off": lambda at: drawn(
        at, lambda m: polygon(m, (0, 0), (1, 0), (1, 1e-12), (0, 1e-12))
    ),
    **{f"damage {k}": lambda at, k=k: damaged(at, k) for k in range(12)},
}

CONE = [[0.0, 1.0], [0.5, 0.5], [1.0, 0.0]]
PATTERNS: dict[str, Case] = {
    "1e9 cells": lambda at: gx.patterns.gores(CONE, 6).mesh(ONE, along=10**9, across=2),
    "1e9 gores": lambda at: gx.patterns.gores(CONE, 10**9).mesh(ONE, along=2, across=2),
    "seams of another film": lambda at: gx.patterns.gores(CONE, 6).seams(film()),
    "a profile that crosses the axis": lambda at: gx.patterns.gores([[1, 0], [-1, 1]], 6),
    "a profile at rest": lambda at: gx.patterns.gores([[1, 0], [1, 0]], 6),
    "a profile of complex numbers": lambda at: gx.patterns.gores([[1j, 0], [1, 1]], 6),
    "a ragged profile": lambda at: gx.patterns.gores([[1, 0], [1]], 6),
    "a profile of 1e200": lambda at: gx.patterns.gores([[1e200, 0], [1, 1]], 6),
    "Gores by hand": lambda at: gx.patterns.Gores(np.zeros(3), 6).mesh(ONE, along=2, across=1),
    "Gores of a falling count": lambda at: gx.patterns.Gores(np.array(CONE), -1).pitch,
}


# ---- laws and bodies -----------------------------------------------------------------------------


def mutated(X: np.ndarray) -> np.ndarray:
    """A displacement that changes its argument, and has the right value."""
    found = 1e-3 * X
    X += 1.0
    return found


def changed(X: np.ndarray, t: float) -> np.ndarray:
    found = 0.0 * X
    X[:] = 7.0
    return found


def table(strain: list[float], force: list[float]) -> Any:
    return gx.TabulatedCable(strain, force, line_density=0.1)


BODIES: dict[str, Case] = {
    "no rows": lambda at: table([], []),
    "one row": lambda at: table([0], [0]),
    "nan": lambda at: table([0, math.nan], [0, 5]),
    "unsorted": lambda at: table([0.01, 0], [5, 0]),
    "repeated": lambda at: table([0, 0.01, 0.01], [0, 5, 6]),
    "a table of matrices": lambda at: gx.TabulatedCable(np.eye(2), np.eye(2), line_density=1.0),
    "a port of weights": lambda at: gx.Port(film(), (0, 1), weights=(1.0,)),
    "a port of weights nan": lambda at: gx.Port(film(), (0,), weights=(math.nan,)),
    "a port of half a node": lambda at: gx.Port(film(), (0.5,)),
    "a port of no nodes": lambda at: run(sail := film(), gx.loads.Force(gx.Port(sail, ()), Z)),
    "a displacement that changes its points": lambda at: same(
        energy(run(film(displacement=mutated))), energy(run(film(displacement=lambda X: 1e-3 * X)))
    ),
    "a displacement to one point": lambda at: run(film(displacement=lambda X: -X)).time == 2e-4,
    "a displacement that turns over": lambda at: (
        run(film(displacement=lambda X: np.stack([-2 * X[0], 0 * X[0], 0 * X[0]]))).time == 2e-4
    ),
    "a velocity of bool": lambda at: run(film(velocity=lambda X: X > 9)).time == 2e-4,
    "a velocity of 1e9 m/s": lambda at: run(film(velocity=lambda X: 1e9 * X)).time == 2e-4,
    "a property of another law": lambda at: run(film(properties={"E2": 1.0})),
    "a property of words": lambda at: run(film(properties={"E": "a"})),
    "a property by a group of curves": lambda at: run(film(properties={"E": {"left": 1e9}})),
    "a negative property": lambda at: run(film(properties={"thickness": lambda X: -X[0]})),
    "a property of nan": lambda at: run(film(properties={"thickness": lambda X: np.nan * X[0]})),
    "a property of density None": lambda at: run(film(properties={"density": None})),
    "a stress of nan": lambda at: run(film(initial_stress=np.full((3, 3), math.nan))),
    "thermal without gradient": lambda at: (
        run(film(thermal=gx.materials.ThermalExpansion(1e-5))).time == 2e-4
    ),
    "thermal of a function of nan": lambda at: run(
        film(thermal=gx.materials.ThermalExpansion(1e-5, temperature=lambda X, t: math.nan))
    ),
    "hinges by word": lambda at: plate(hinges="left"),
    "a plate of a wrinkling law": lambda at: (
        run(gx.Plate(sheet(ONE, 2, 2), WRINKLING)).time == 2e-4
    ),
    "a branched beam": lambda at: (
        run(
            gx.Beam(
                gx.gmsh_mesh(tripod, ONE),
                gx.sections.tube(0.02, 5e-4, E=1e11, nu=0.3, density=1560.0),
            )
        ).time
        == 2e-4
    ),
    "an orthotropic law across the film": lambda at: run(
        gx.Membrane(sheet(ONE, 2, 2), gx.Orthotropic(**FABRIC, direction=Z))
    ),
    "nu12 of 50": lambda at: gx.Orthotropic(**FABRIC | {"nu12": 50.0}, direction=X),
    "around an axis through the film": lambda at: run(
        gx.Membrane(
            sheet(ONE, 2, 2),
            gx.LinearOrthotropic(**FABRIC, direction=gx.materials.AroundAxis(X, (0, 0.3, 0))),
        )
    ),
}


def tripod(model: Any) -> None:
    """Three line elements at one point."""
    centre = model.occ.addPoint(0, 0, 0, 1)
    for x, y in ((1, 0), (0, 1), (-1, -1)):
        model.occ.addLine(centre, model.occ.addPoint(x, y, 0, 1))
    model.occ.synchronize()
    model.mesh.generate(1)


# ---- scenes, loads, constraints ------------------------------------------------------------------


def twice(part: Any, *others: Any) -> bool:
    """Whether parts run alike in a second scene."""
    return same(energy(run(part, *others)), energy(run(part, *others)))


def of_list() -> bool:
    """A position that is changed after the mass was made from it."""
    at = [1.0, 0.0, 0.0]
    made = gx.PointMass(1.0, at, comm=ONE)
    at[0] = 5.0
    return bool(run(made).system.unknowns.state[made].positions()[0, 0] == 1.0)


def of_array() -> bool:
    """A profile that is changed after the gores were made from it."""
    profile = np.array(CONE)
    made = gx.patterns.gores(profile, 6)
    before = made.length
    profile *= 3
    return made.width(np.array([0.1]))[0] < 1.1 and made.length == before


SCENES: dict[str, Case] = {
    "a list of parts": lambda at: gx.Scene([film()]),
    "a scene in a scene": lambda at: gx.Scene(gx.Scene(film())),
    "one film twice": lambda at: (lambda sail: same(energy(run(sail, sail)), energy(run(sail))))(
        film()
    ),
    "one film in two scenes": lambda at: twice(film(velocity=lambda X: X)),
    "one mesh of two films": lambda at: (
        lambda mesh: (
            run(gx.Membrane(mesh, LINEAR, name="a"), gx.Membrane(mesh, LINEAR, name="b")).time
            == 2e-4
        )
    )(sheet(ONE, 2, 2)),
    "one contact in two scenes": lambda at: (
        lambda sail: twice(sail, gx.Contact(sail, distance=1e-3))
    )(film()),
    "a body that is not in the scene": lambda at: run(film(), gx.Gravity(mass())).time == 2e-4,
    "a list changed after use": lambda at: of_list(),
    "an array changed after use": lambda at: of_array(),
    "a name of a slash": lambda at: (
        run(film(name="a/b"), outputs=[gx.Recording(at / "run", {"a/b": ["state"]})]).time == 2e-4
    ),
    "a name of dots": lambda at: (
        run(film(name="../../a"), outputs=[gx.outputs.VTU(at / "x.pvd")]).time == 2e-4
    ),
    "a name of line breaks": lambda at: (
        run(film(name="a\nb"), outputs=[gx.Recording(at / "run")]).time == 2e-4
    ),
    "a name of 5000 letters": lambda at: (
        run(film(name="a" * 5000), outputs=[gx.Recording(at / "run")]).time == 2e-4
    ),
    "a name that is empty": lambda at: run(film(name=""), outputs=[gx.Recording(at / "run")]),
    "a name of spaces": lambda at: (
        run(film(name="  "), outputs=[gx.Recording(at / "run")]).time == 2e-4
    ),
    "a name of nulls": lambda at: (
        run(film(name="a\0b"), outputs=[gx.Recording(at / "run")]).time == 2e-4
    ),
    "a name of half a letter": lambda at: (
        run(film(name="\ud800"), outputs=[gx.Recording(at / "run")]).time == 2e-4
    ),
    "a name of markup": lambda at: (
        run(film(name="<script>x</script>"), outputs=[gx.Recording(at / "run", every=1)]),
        gx.write_report(gx.plot.RunReader(at / "run"), at / "a.html"),
        "<script>x" not in (at / "a.html").read_text(),
    )[-1],
    "names that differ in case": lambda at: run(
        film(name="a"), film(name="A"), outputs=[gx.outputs.VTU(at / "x.pvd", body=film(name="c"))]
    ),
    "other communicators": lambda at: (
        run(film(), gx.PointMass(1.0, comm=MPI.COMM_WORLD)).time == 2e-4
    ),
    "a null communicator": lambda at: run(gx.PointMass(1.0, comm=MPI.COMM_NULL)),
    "two rigid motions": lambda at: same(
        energy(run(film(), gx.RigidMotion(spin=Z), gx.RigidMotion(spin=Z, name="b"))),
        energy(run(film(), gx.RigidMotion(spin=(0.0, 0.0, 2.0)))),
    ),
    "a pressure that is a generator": lambda at: with_film(
        lambda sail: gx.Pressure(sail, lambda t: (k for k in range(3)))
    ),
    "a pressure that recurses": lambda at: with_film(lambda sail: gx.Pressure(sail, recursing)),
    "a pressure of a mass": lambda at: gx.Pressure(mass(), 1.0),
    "an edge load on a corner": lambda at: with_film(
        lambda sail: gx.loads.EdgeLoad(sail, "top left", force=Z)
    ),
    "an edge load on the film": lambda at: with_film(
        lambda sail: gx.loads.EdgeLoad(sail, "film", force=Z)
    ),
    "an edge load in space that follows": lambda at: with_film(
        lambda sail: gx.loads.EdgeLoad(sail, "left", force=Z, following=True)
    ),
    "fixed twice": lambda at: (
        lambda sail: (
            run(sail, gx.Fixed(sail, "left"), gx.Fixed(sail, "left", name="b")).time == 2e-4
        )
    )(film()),
    "fixed with two motions": lambda at: (
        lambda sail: run(
            sail,
            gx.Fixed(sail, "left", motion=lambda X, t: 0 * X + t),
            gx.Fixed(sail, "top", motion=lambda X, t: 0 * X - t, name="b"),
        )
    )(film()),
    "a motion that changes its points": lambda at: (
        with_film(lambda sail: gx.Fixed(sail, "left", motion=changed)).time == 2e-4
    ),
    "a motion that jumps": lambda at: (
        with_film(
            lambda sail: gx.Fixed(sail, "left", motion=lambda X, t: 0 * X + 1e6 * (t > 0))
        ).time
        == 2e-4
    ),
    "a motion that does not start at rest": lambda at: (
        with_film(lambda sail: gx.Fixed(sail, "left", motion=lambda X, t: 0 * X + 1.0)).time == 2e-4
    ),
    "all fixed": lambda at: with_film(lambda sail: gx.Fixed(sail, "film")).time == 2e-4,
    "components twice": lambda at: (
        with_film(lambda sail: gx.Fixed(sail, "left", components=(0, 0))).time == 2e-4
    ),
    "components of floats": lambda at: gx.Fixed(film(), "left", components=(0.0, 1.0)),
    "components and a normal": lambda at: gx.Fixed(film(), "left", components=(0,), normal=Z),
    "a tie of bodies far apart": lambda at: (lambda a, b: run(a, b, gx.Tie(a, b, group_a="left")))(
        film(), gx.Membrane(arrays(np.add(SQUARE, [9, 9, 9]), TRIANGLES), LINEAR, name="b")
    ),
    "a tie of two masses": lambda at: gx.Tie(mass(), mass("b")),
    "two seams of one edge": lambda at: (
        lambda sail: (
            run(
                sail,
                gx.Seam(sail, "left", sail, "right", name="a"),
                gx.Seam(sail, "left", sail, "top", name="b"),
            ).time
            == 2e-4
        )
    )(film()),
    "a seam to a shorter edge": lambda at: (
        lambda a, b: run(a, b, gx.Seam(a, "left", b, "bottom"))
    )(film(), gx.Membrane(sheet(ONE, 2, 2, 0.1, 1.0), LINEAR, name="b")),
    "two rigid regions of one edge": lambda at: (
        lambda sail: run(sail, gx.RigidRegion(sail, "left"), gx.RigidRegion(sail, "left", name="b"))
    )(film()),
    "a joint of two grounds": lambda at: run(
        mass(), gx.constraints.BallJoint(gx.Ground(ZERO), gx.Ground(ZERO))
    ),
    "the same joint twice": lambda at: (
        lambda a, b: run(
            a,
            b,
            gx.constraints.FixedJoint(a.frame(), b.frame(), name="one"),
            gx.constraints.FixedJoint(a.frame(), b.frame(), name="two"),
        )
    )(body(), body(name="b")),
    "joints in a loop": lambda at: (
        lambda a, b: run(
            a,
            b,
            gx.constraints.BallJoint(a.port(), b.port(), name="one"),
            gx.constraints.Link(a.port(X), b.port(X), name="two"),
        )
    )(body(), body(name="b")),
    "a joint of frames that are turned": lambda at: (
        lambda a, b: run(a, b, gx.constraints.FixedJoint(a.frame(), b.frame())).time == 2e-4
    )(body(), body(name="b", attitude=((0, 1, 0), (-1, 0, 0), (0, 0, 1)))),
    "a motor that jumps": lambda at: (
        lambda a: run(a, gx.constraints.Driven(a, Z, angle=lambda t: 100.0 * (t > 0)))
    )(body()),
    "a spring of itself": lambda at: (
        lambda a: run(a, gx.connectors.Spring(a.port(), a.port(), stiffness=1.0, length=1.0))
    )(mass()),
    "a spring of no length": lambda at: (
        lambda a, b: (
            run(a, b, gx.connectors.Spring(a.port(), b.port(), stiffness=1.0, length=1.0)).time
            == 2e-4
        )
    )(mass(), mass("b")),
    "a rope bundle of other counts": lambda at: (
        lambda a, b: gx.connectors.RopeBundle(
            ends=[(a.port(), b.port())], stiffness=1.0, lengths=[1.0, 2.0]
        )
    )(mass(), mass("b", X)),
    "a rope bundle of nothing": lambda at: gx.connectors.RopeBundle(
        ends=[], stiffness=1.0, lengths=[]
    ),
    "a rope bundle of one end": lambda at: gx.connectors.RopeBundle(
        ends=[(mass().port(),)], stiffness=1.0, lengths=[1.0]
    ),
    "a tape on corners": lambda at: gx.connectors.Tape.along_edges(
        film(), gx.CableLaw(1e5, 0.1), edges="top left"
    ),
    "a frame of one port thrice": lambda at: (
        lambda a: run(a, gx.Frame(a.port(), (a.port(), a.port(), a.port())), gx.Gravity(a))
    )(mass()),
    "a frame of two directors": lambda at: run(gx.Frame(mass().port(), (mass().port(),) * 2)),
}


def recursing(t: float) -> float:
    return recursing(t)


# ---- contact and gas -----------------------------------------------------------------------------


def touching(*more: Any, height: float = 1e-2, **options: Any) -> gx.Simulation:
    sail = film(displacement=lambda X: 0 * X + [[0], [0], [height]])
    floor = gx.contact.Plane(point=ZERO, normal=Z)
    return run(sail, gx.Contact(sail, floor, *more, **{"distance": 1e-3, **options}))


def inflated(valve: Any = 1e-6, **options: Any) -> gx.Simulation:
    pillow = bag()
    given = {"pressure": 1e5, "temperature": 300.0, "dead_volume": 1e-3, **options}
    inside = gx.Chamber(pillow, gas=AIR, **given)
    return run(pillow, inside, gx.Orifice(inside, gx.gas.Ambient(1e5), area=valve))


def sliding(**options: Any) -> gx.Simulation:
    return touching(friction=0.3, **options)


CONTACT_AND_GAS: dict[str, Case] = {
    "a film below the floor": lambda at: touching(height=-1.0),
    "a distance above the cells": lambda at: touching(distance=10.0),
    "a radius of nobody": lambda at: touching(radius={"wing": 1e-3}),
    "a radius of words": lambda at: touching(radius={"film": "a"}),
    "a radius for a floor": lambda at: touching(radius={"obstacle": 1e-3}),
    "a mass": lambda at: run(a := mass(), gx.Contact(a, distance=1e-3)),
    "masses that coincide": lambda at: (
        lambda a, b: run(a, b, gx.Contact(a, b, distance=1e-3, radius={"mass": 0.1, "b": 0.1}))
    )(mass(), mass("b")),
    "a box of axes that lean": lambda at: gx.contact.Box(
        centre=ZERO, sizes=(1.0, 1.0, 1.0), axes=(X, (1.0, 1.0, 0.0), Z)
    ),
    "a cylinder of no length": lambda at: touching(
        gx.contact.Cylinder(start=ZERO, end=ZERO, radius=1.0, name="rod")
    ),
    "a sphere around a film": lambda at: touching(
        gx.contact.Sphere(centre=ZERO, radius=9.0, name="ball"),
    ),
    "two obstacles of one name": lambda at: (
        touching(gx.contact.Sphere(centre=(0, 0, -5.0), radius=0.1)).time == 2e-4
    ),
    "an obstacle that jumps": lambda at: touching(
        gx.contact.Sphere(
            centre=(0, 0, -5.0), radius=1.0, motion=lambda t: (0, 0, 9.0 * (t > 0)), name="ball"
        )
    ),
    "an obstacle on a body that is not there": lambda at: touching(
        gx.contact.Sphere(centre=(0, 0, -5.0), radius=1.0, body=mass().port(), name="ball")
    ),
    "a valve of 1e9 m²": lambda at: inflated(valve=1e9).time == 2e-4,
    "a chamber and a volume": lambda at: gx.Chamber(
        bag(), gas=AIR, pressure=1.0, temperature=3.0, volume=1.0
    ),
    "a chamber by another name": lambda at: run(film(), tank()).chamber("bottle"),
    "a wall below zero kelvin": lambda at: run(
        film(), one := tank(), gx.gas.WallHeat(one, conductance=1.0, temperature=lambda t: -1.0)
    ),
}

# ---- steppers, runs, outputs ---------------------------------------------------------------------


def probed(at: Path, name: str) -> bool:
    """Whether no cell of the tables of a run begins as a formula."""
    probes = {name: lambda run: 1.0}
    outputs = [
        gx.Recording(at / "run", every=1, probes=probes),
        gx.outputs.Probes(at / "a.csv", probes),
    ]
    run(film(), outputs=outputs)
    heads = [path.read_text().splitlines()[0] for path in at.rglob("*.csv")]
    cells = [cell.lstrip('"') for head in heads for cell in head.split(",")]
    return not any(cell.startswith(("=", "+", "-", "@", "\t", "\r")) for cell in cells)


def again(at: Path, change: Callable[[Path], Any]) -> gx.Simulation:
    """A restart after something has happened to the folder of checkpoints."""
    folder = saved(at)
    change(folder)
    return run(film(), restart=folder, until=4e-4)


def first(folder: Path) -> Path:
    return sorted(folder.glob("step-*"))[-1]


def page(folder: Path) -> Path:
    return first(folder) / "run.json"


def reader(at: Path, change: Callable[[Path], Any]) -> Any:
    recorded(at)
    change(at / "run")
    return gx.write_report(gx.plot.RunReader(at / "run"), at / "a.html")


def stopping(run: gx.Simulation) -> None:
    run.run(until=1.0)


RUNS: dict[str, Case] = {
    "a step longer than the run": lambda at: run(mass(), dt=1.0, until=1e-3).time == 1e-3,
    "until zero": lambda at: run(mass(), until=0.0).time == 0.0,
    "until infinity": lambda at: run(mass(), until=math.inf),
    "until True": lambda at: run(mass(), until=True),
    "until NumPy's number": lambda at: run(mass(), until=np.float32(2e-4)).time > 1e-4,
    "until 1e99 s": lambda at: run(mass(), until=1e99),
    "steps of 1e-90 s": lambda at: run(mass(), dt=1e-90, until=1.0),
    "on and on": lambda at: (
        lambda made: (made.run(until=1e-4), made.run(until=3e-4), made.time == 3e-4)[-1]
    )(simulation(mass())),
    "a run in a run": lambda at: run(mass(), events=[gx.At(1e-4, then=stopping)]),
    "on after a failure": lambda at: failed_then_on(),
    "an event in the past": lambda at: run(mass(), events=[gx.At(-1.0)]),
    "an event twice": lambda at: (lambda one: run(mass(), events=[one, one]).time == 2e-4)(
        gx.At(1e-4)
    ),
    "events that are one": lambda at: run(mass(), events=gx.At(1e-4)),
    "outputs that are one": lambda at: run(mass(), outputs=gx.Ledger(at / "a.csv")),
    "an output twice": lambda at: (lambda one: run(mass(), outputs=[one, one]))(
        gx.Ledger(at / "a.csv")
    ),
    "an output in two runs": lambda at: (
        lambda one: (run(mass(), outputs=[one]), run(mass(), outputs=[one])).__len__() == 2
    )(gx.Ledger(at / "a.csv")),
    "a recording in two runs": lambda at: (
        lambda one: (run(mass(), outputs=[one]), run(mass(), outputs=[one]))
    )(gx.Recording(at / "run")),
    "a stepper in two runs": lambda at: (
        lambda step: same(
            *[
                (made := gx.Simulation(gx.Scene(mass()), step)).run(until=1e-4) or energy(made)
                for _ in range(2)
            ]
        )
    )(gx.Midpoint(dt=1e-4)),
    "a stepper that is a class": lambda at: gx.Simulation(gx.Scene(mass()), gx.Midpoint),
    "no halvings and a hard step": lambda at: (
        run(film(velocity=lambda X: 1e6 * X), dt=1.0, until=1.0, halvings=0).time == 1.0
    ),
    "a control without room": lambda at: simulation(
        mass(), control=gx.StepControl(min_step=1.0, max_step=0.5)
    ),
    "a control longer than the step": lambda at: (
        run(mass(), control=gx.StepControl(min_step=1.0)).time == 2e-4
    ),
    "records at unsorted times": lambda at: (
        run(
            mass(), outputs=[gx.Ledger(at / "l.csv"), gx.Recording(at / "run", times=(2e-4, 1e-4))]
        ).time
        == 2e-4
    ),
    "records of a body that is not there": lambda at: run(
        mass(), outputs=[gx.Recording(at / "run", {"film": ["state"]})]
    ),
    "records of fields of numbers": lambda at: gx.Recording(at / "run", {"film": [3]}),
    "a record in a file": lambda at: run(
        mass(), outputs=[gx.Recording(written(at / "run", "") / "run")]
    ),
    "a record on a file": lambda at: run(mass(), outputs=[gx.Recording(written(at / "run", ""))]),
    "a ledger on a folder": lambda at: run(mass(), outputs=[gx.Ledger(at)]),
    "a ledger on a device": lambda at: run(mass(), outputs=[gx.Ledger("/dev/full")]),
    "a ledger in proc": lambda at: run(mass(), outputs=[gx.Ledger("/proc/a.csv")]),
    "checkpoints in a file": lambda at: run(
        mass(), checkpoints=gx.Checkpoints(written(at / "saves", ""))
    ),
    "a formula for a name": lambda at: probed(at, "=cmd|' /C calc'!A0"),
    "a formula with a plus": lambda at: probed(at, "+1+1"),
    "a formula with an at": lambda at: probed(at, "@SUM(1)"),
    "a formula behind a space": lambda at: probed(at, " =1+1"),
    "a probe of a comma": lambda at: probed(at, 'a,"b'),
    "a probe of a line break": lambda at: probed(at, "a\nb"),
    "a probe without name": lambda at: probed(at, ""),
    "a probe named time": lambda at: probed(at, "time [s]"),
    "a probe that changes the run": lambda at: run(
        mass(), outputs=[gx.Series({"a": lambda run: setattr(run, "time", 9.0) or 1.0})]
    ),
    "a probe of None": lambda at: run(mass(), outputs=[gx.Series({"a": None})]),
    "a series without probes": lambda at: run(mass(), outputs=[gx.Series({})]).time == 2e-4,
    "a picture of a text file": lambda at: run(
        film(), outputs=[gx.plot.Picture(at / "a.txt", times=(1e-4,))]
    ),
    "a picture of no name": lambda at: (
        run(film(), outputs=[gx.plot.Picture(at / ".png")]).time == 2e-4
    ),
    "a picture in a file": lambda at: run(
        film(), outputs=[gx.plot.Picture(written(at / "b", "") / "a.png")]
    ),
    "progress to a word": lambda at: run(mass(), outputs=[gx.outputs.Progress("terminal")]),
    "progress to a closed file": lambda at: progress(at),
    "vtu of a mass": lambda at: run(mass(), outputs=[gx.outputs.VTU(at / "a.pvd")]),
    "a log in a folder": lambda at: gx.run.log_to(ONE, at),
    "a log in a file": lambda at: gx.run.log_to(ONE, written(at / "b", "") / "a.log"),
    "state by name": lambda at: run(mass()).system.unknowns.state["mass"],
    "a restart of nothing": lambda at: again(at, lambda folder: None).time == 4e-4,
    "a restart without a page": lambda at: again(at, lambda f: page(f).unlink()).time == 4e-4,
    "a restart of a folder for a page": lambda at: (
        again(at, lambda f: (page(f).unlink(), page(f).mkdir())).time == 4e-4
    ),
    "a restart with changes of nobody": lambda at: run(
        film(), restart=saved(at), changes=["wing"], until=4e-4
    ),
    "a report of nothing": lambda at: gx.plot.RunReader(at),
    "a report of a file": lambda at: gx.plot.RunReader(written(at / "run", "")),
    "a report of tables in UTF-16": lambda at: reader(
        at, lambda f: [one.write_bytes(one.read_text().encode("utf-16")) for one in f.glob("*.csv")]
    ),
    "a report of a huge cell": lambda at: reader(
        at, lambda f: (f / "probes.csv").write_text("step,time [s],a\n0,0," + "1" * 200_000)
    ),
    "a report in a file": lambda at: gx.write_report(
        recorded(at), written(at / "b", "") / "a.html"
    ),
    "an export in a file": lambda at: gx.plot.export(recorded(at), written(at / "b", "")),
    "a table by number": lambda at: recorded(at).table(3),
    "a table outside": lambda at: recorded(at).table("../../etc/passwd") == {},
    "values of a frame that is not there": lambda at: recorded(at).values("state", 99),
    "values of a word": lambda at: recorded(at).values("state", "first"),
    "a caption of a frame that is not there": lambda at: recorded(at).caption(99),
    "a record at a word": lambda at: recorded(at).record_at("noon"),
    "a strip of 1e9": lambda at: gx.plot.strip(
        recorded(at), "state", path=at / "a.png", count=10**9
    ),
    "an animation of 1e9 s": lambda at: gx.plot.animate(
        recorded(at), "state", path=at / "a.gif", seconds=1e9
    ),
}


def progress(at: Path) -> gx.Simulation:
    stream = (at / "log").open("w")
    stream.close()
    return run(mass(), outputs=[gx.outputs.Progress(stream)])


def failed_then_on() -> gx.Simulation:
    """A run that goes on after its load has raised an error."""
    sail = film()
    made = simulation(sail, gx.Pressure(sail, lambda t: 1 / (t < 1.5e-4)))
    for _ in range(2):
        try:
            made.run(until=3e-4)
        except gx.InputError as error:
            caught = error
    raise caught


# ---- statics, design, sweeps ---------------------------------------------------------------------


@cache
def at_rest() -> gx.Equilibrium:
    return held(displacement=lambda X: 1e-3 * X)


BY = ["film.E"]
BOUNDS = {"film.E": (5e8, 3e9)}
ENERGY = gx.analysis.Energy


def minimised(**options: Any) -> Any:
    given = {"bounds": BOUNDS, "iterations": 1, **options}
    return gx.analysis.minimise(at_rest(), of=ENERGY(), by=BY, **given)


def of_runs(evaluate: Callable[..., Any], **options: Any) -> Any:
    given = {"start": {"a": 1.0}, "iterations": 1, **options}
    return gx.analysis.minimise_runs(evaluate, **given)


def swept(at: Path, outcome: Callable[..., Any], over: Any = None) -> Any:
    """A sweep by the command over a design file that has an outcome."""
    import sys

    module = SimpleNamespace(outcome=outcome, over=over or {"a": [1, 2]})
    sys.modules["of_the_test"] = module  # type: ignore[assignment]
    imports = "import gossamer_fx as gx, of_the_test as t\n"
    design = f"{imports}SWEEP = gx.sweep.Factorial(t.outcome, t.over)\n"
    return said(["sweep", str(written(at / "design.py", design)), "-o", str(at / "out")])


ANALYSES: dict[str, Case] = {
    "a chamber of no name": lambda at: at_rest().chamber("bottle"),
    "an equilibrium that floats": lambda at: (
        gx.Equilibrium(gx.Scene(film())).find().within_tolerance
    ),
    "an equilibrium that falls": lambda at: held(lambda sail: gx.Gravity(mass("b"))),
    "an equilibrium of a load that raises": lambda at: held(
        lambda sail: gx.Pressure(sail, lambda t: 1 / 0)
    ),
    "an equilibrium of 1e60 Pa": lambda at: (
        held(lambda sail: gx.Pressure(sail, 1e60)).result.within_tolerance
    ),
    "a gradient by nobody": lambda at: gx.analysis.gradient(at_rest(), of=ENERGY(), by=["wing.E"]),
    "a gradient by nothing": lambda at: gx.analysis.gradient(at_rest(), of=ENERGY(), by=[]),
    "a gradient by a word": lambda at: gx.analysis.gradient(at_rest(), of=ENERGY(), by="film.E"),
    "a gradient of a class": lambda at: gx.analysis.gradient(at_rest(), of=ENERGY, by=BY),
    "a gradient of another film": lambda at: gx.analysis.gradient(
        at_rest(), of=gx.analysis.EnclosedVolume(bag(name="b")), by=BY
    ),
    "bounds that fall": lambda at: minimised(bounds={"film.E": (3e9, 5e8)}),
    "bounds that miss the start": lambda at: same(
        minimised(bounds={"film.E": (3e9, 4e9)}).parameters["film.E"][0], 3e9
    ),
    "bounds of three": lambda at: minimised(bounds={"film.E": (1e8, 1e9, 3e9)}),
    "bounds of nobody": lambda at: minimised(bounds={"wing.E": (1e8, 1e9)}),
    "a method of no name": lambda at: minimised(method="guess"),
    "an outcome that raises": lambda at: of_runs(lambda values: 1 / 0),
    "an outcome of None": lambda at: of_runs(lambda values: None),
    "a start of words": lambda at: of_runs(lambda values: None, start={"a": "b"}),
    "fits of nan": lambda at: gx.analysis.fit(at_rest(), of=[ENERGY()], measured=[math.nan], by=BY),
    "convergence of words": lambda at: gx.analysis.convergence(
        lambda n: "a", meshes=[1, 2, 3], sizes=[1.0, 0.5, 0.25]
    ),
    "convergence of sizes that rise": lambda at: gx.analysis.convergence(
        lambda n: 1.0 + n, meshes=[1, 2, 4], sizes=[0.25, 0.25, 0.25]
    ),
    "waves of nan": lambda at: gx.analysis.travelling_waves(
        np.arange(20.0), np.full(20, math.nan), np.ones(20)
    ),
    "a form of no scene": lambda at: gx.analysis.find_form(film(), lambda: None),
    "statics in a file": lambda at: gx.outputs.record(
        at_rest(), [gx.Ledger(written(at / "b", "") / "a.csv")], at=[0.0]
    ),
    "statics at nothing": lambda at: (
        gx.outputs.record(at_rest(), [gx.Ledger(at / "a.csv")], at=[]) is None
    ),
    "statics at words": lambda at: gx.outputs.record(
        at_rest(), [gx.Ledger(at / "a.csv")], at=["a"]
    ),
    "modes recorded of nothing": lambda at: gx.outputs.record_modes(at_rest(), [], at / "m") == [],
    "modes recorded in a file": lambda at: gx.outputs.record_modes(
        at_rest(), gx.analysis.modes(at_rest(), 1), written(at / "m", "")
    ),
    "a base of no shapes": lambda at: gx.reduction.reduce(
        film(), [gx.reduction.Snapshots(film())], modes=1
    ),
    "an outcome that raises in a sweep": lambda at: swept(at, lambda comm, folder, a: 1 / 0),
    "an outcome of a list": lambda at: swept(at, lambda comm, folder, a: [1.0]),
    "an outcome of words": lambda at: swept(at, lambda comm, folder, a: {"y": "b"}),
    "an outcome of nan": lambda at: swept(at, lambda comm, folder, a: {"y": math.nan}),
    "an outcome of other arguments": lambda at: swept(at, lambda comm, folder, b: {"y": 1.0}),
    "a formula in a table": lambda at: (
        swept(at, lambda comm, folder, a: {"y": 1.0}, {"a": ["=cmd|1", "b"]}),
        not any(
            cell.lstrip('"').startswith("=")
            for path in (at / "out").glob("*.csv")
            for row in path.read_text().splitlines()
            for cell in row.split(",")
        ),
    )[-1],
    "a sweep in a file": lambda at: (
        written(at / "out", ""),
        swept(at, lambda comm, folder, a: {"y": 1.0}),
    ),
    "a sweep over nothing": lambda at: gx.sweep.Factorial(lambda comm, folder: {}, {}),
    "a sweep over one value": lambda at: gx.sweep.Factorial(lambda comm, folder, a: {}, {"a": 3}),
    "a sweep over 1e12 runs": lambda at: swept(
        at, lambda comm, folder, **values: {"y": 1.0}, {f"a{k}": list(range(10)) for k in range(12)}
    ),
}

# ---- folds and orbits ----------------------------------------------------------------------------


def miura() -> gx.fold.Miura:
    return gx.fold.Miura(0.1, 0.1, gamma=1.0, theta=0.5)


def zigzag(cells: int, **options: Any) -> gx.Simulation:
    """A film that starts folded in four panels, whose fold lines are edges of 4 n cells only."""
    folds = gx.fold.Zigzag(1.0, 4, **options)
    sail = gx.Membrane(sheet(ONE, cells, 1), LINEAR)
    return run(sail, folds.start(sail))


def orbit(**options: Any) -> gx.orbit.Orbit:
    return gx.orbit.Orbit(gx.orbit.Elements(7e6), **options)


def flown(part: Callable[[gx.Membrane, Any], Any], **options: Any) -> gx.Simulation:
    sail = film()
    path = orbit(**options)
    return run(sail, path, part(sail, path))


FOLDS_AND_ORBITS: dict[str, Case] = {
    "marks of lines": lambda at: miura().mark(line(ONE, [ZERO, X], 2)),
    "creases of a mesh without marks": lambda at: gx.fold.Zigzag(1.0, 2).creases(
        film(), stiffness=1.0
    ),
    "a Miura on another mesh": lambda at: run(sail := film(), miura().start(sail)),
    "panels across cells": lambda at: zigzag(3),
    "panels along cells": lambda at: zigzag(4).time == 2e-4,
    "a film of another length": lambda at: run(sail := film(), gx.fold.Zigzag(2.0, 4).start(sail)),
    "two starts": lambda at: (lambda sail, folds: run(sail, folds.start(sail), folds.start(sail)))(
        film(), gx.fold.Zigzag(1.0, 2)
    ),
    "folded and displaced": lambda at: (lambda sail: run(sail, gx.fold.Zigzag(1.0, 2).start(sail)))(
        film(displacement=lambda X: 1e-3 * X)
    ),
    "a start of a film that is not there": lambda at: (
        run(mass(), gx.fold.Zigzag(1.0, 2).start(film())).time == 2e-4
    ),
    "1e9 panels": lambda at: gx.fold.Zigzag(1.0, 10**9).mark(sheet(ONE, 2, 2)),
    "an Ikaros inside out": lambda at: gx.fold.Ikaros(n=4, inner=9, outer=5, pitch=0.3),
    "an orbit below the ground": lambda at: (
        flown(
            lambda sail, path: gx.orbit.Drag(
                sail, path, atmosphere=gx.orbit.ExponentialAtmosphere(1e-12, 4e5, scale_height=6e4)
            ),
            radius=8e6,
        ).time
        == 2e-4
    ),
    "an orbit that escapes": lambda at: (
        run(film(), gx.orbit.Orbit(gx.orbit.Elements(7e12, 0.999999))).time == 2e-4
    ),
    "a load of an orbit that is not there": lambda at: (
        run(sail := film(), gx.orbit.SolarPressure(sail, orbit(sun=Z))).time == 2e-4
    ),
    "optics that add up to 2": lambda at: gx.orbit.Optics(reflectivity=1.0, specular=2.0),
    "a patch of one point": lambda at: gx.control.patch(mass().port(), [mass().port()]),
}

# ---- the command line ----------------------------------------------------------------------------

SCENE = """
import gossamer_fx as gx
def build(comm, until=2e-3):
    return gx.Case(gx.Scene(gx.PointMass(1.0, comm=comm)), gx.Midpoint(dt=1e-3), until=until)
"""


def told(at: Path, *words: str, text: str | bytes = SCENE, name: str = "scene.py") -> Any:
    scene = written(at / name, text)
    return said([str(scene) if word == "SCENE" else word for word in words])


def told_after(at: Path, change: Callable[[Path], Any], *words: str) -> Any:
    """A command about a run whose folder has changed."""
    assert told(at, "run", "SCENE", "-o", str(at / "run"), "--quiet") == "taken"
    change(at / "run")
    return said([str(at / "run") if word == "RUN" else word for word in words])


COMMANDS: dict[str, Case] = {
    "a folder for a scene": lambda at: said(["run", str(at)]),
    "a device for a scene": lambda at: said(["run", "/dev/null"]),
    "a scene in latin-1": lambda at: told(at, "run", "SCENE", text="x = 'ö'".encode("latin-1")),
    "a scene that ends itself": lambda at: told(at, "run", "SCENE", text="import os\nos._x()\n"),
    "a scene without ending": lambda at: told(at, "run", "SCENE", name="scene"),
    "a scene named like a package": lambda at: told(
        at, "run", "SCENE", "-o", str(at / "run"), "--quiet", name="numpy.py"
    ),
    "a build that is a number": lambda at: told(at, "run", "SCENE", text="build = 3\n"),
    "a build that is a class": lambda at: told(at, "run", "SCENE", text="class build: pass\n"),
    "a build that recurses": lambda at: told(
        at, "run", "SCENE", text="def build(comm):\n    return build(comm)\n"
    ),
    "an output in a file": lambda at: told(
        at, "run", "SCENE", "-o", str(written(at / "b", "") / "run")
    ),
    "an output that is a file": lambda at: told(
        at, "run", "SCENE", "-o", str(written(at / "b", ""))
    ),
    "until a list": lambda at: told(at, "run", "SCENE", "until=[1]"),
    "ranks of superscript": lambda at: told(at, "run", "SCENE", "-n", "²"),
    "a checkpoint of superscript": lambda at: told(at, "run", "SCENE", "--restart", "²"),
    "a checkpoint every 0": lambda at: told(at, "run", "SCENE", "--checkpoint", "0"),
    "changes of nobody": lambda at: told(
        at, "run", "SCENE", "--changed", "wing", "-o", str(at / "r")
    ),
    "a sweep over nothing": lambda at: told(at, "sweep", "SCENE", "--over", "until="),
    "a sweep over no name": lambda at: told(at, "sweep", "SCENE", "--over", "=1,2"),
    "a sweep over a name twice": lambda at: told(
        at, "sweep", "SCENE", "--over", "until=1,2", "until=3"
    ),
    "a sweep of unequal lists": lambda at: told(
        at, "sweep", "SCENE", "--list", "--over", "until=1,2", "until2=1"
    ),
    "a sweep over a range": lambda at: told(at, "sweep", "SCENE", "--over", "until=1:2"),
    "a sweep in a file": lambda at: told(
        at, "sweep", "SCENE", "--over", "until=1e-3,2e-3", "-o", str(written(at / "b", ""))
    ),
    "a plot at infinity": lambda at: told_after(at, lambda f: None, "plot", "RUN", "-t", "inf"),
    "a plot of 10^12 strips": lambda at: told_after(
        at, lambda f: None, "plot", "RUN", "-s", "1" + "0" * 12
    ),
    "a plot without page": lambda at: told_after(
        at, lambda f: (f / "run.json").unlink(), "plot", "RUN"
    ),
    "a report of a page of another kind": lambda at: told_after(
        at, lambda f: (f / "run.json").write_text(json.dumps({"status": 3})), "report", "RUN"
    ),
    "a report in a file": lambda at: told_after(
        at, lambda f: (f / "x").write_text(""), "report", "RUN", "-o", str(at / "run" / "x" / "y")
    ),
    "an export of nothing": lambda at: said(["export", str(at)]),
    "a demo that is not there": lambda at: said(["demo", "nothing"]),
    "no command": lambda at: said([]),
    "a command of no name": lambda at: said([""]),
    "options alone": lambda at: said(["--fast"]),
}

GROUPS = {
    "mesh": MESHES,
    "mesh file": MESH_FILES,
    "drawing": DRAWINGS,
    "pattern": PATTERNS,
    "body": BODIES,
    "scene": SCENES,
    "contact or gas": CONTACT_AND_GAS,
    "run": RUNS,
    "analysis": ANALYSES,
    "fold or orbit": FOLDS_AND_ORBITS,
    "command": COMMANDS,
}


def outcome(case: Case, at: Path) -> str:
    """The class of what a case does, and what is wrong about it."""
    try:
        result = case(at)
    except REFUSED as error:
        if is_sentence(str(error), LONGEST_SENTENCE):
            return f"sentence {error}"
        return f"traceback no sentence: {error}"
    except BaseException as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        return f"traceback {type(error).__name__}: {error} ({where.filename}:{where.lineno})"
    # Cases that may be taken say whether the result is right.
    return "taken" if result is True else f"wrong {result!r}"


def in_a_process(case: Case, at: Path) -> str:
    """The same in a fork, which may crash or hang."""
    at.mkdir(parents=True)
    answer = at.with_suffix(".answer")
    child = os.fork()
    if not child:
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.alarm(HANGS)
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        os.chdir(at)
        # Uncaught errors would end the tests of this process.
        try:
            answer.write_text(outcome(case, at), errors="replace")
        finally:
            os._exit(0)
    _, status = os.waitpid(child, 0)
    if os.WIFSIGNALED(status):
        return "hang" if os.WTERMSIG(status) == signal.SIGALRM else f"crash {os.WTERMSIG(status)}"
    return answer.read_text() if answer.exists() else "crash without words"


@pytest.fixture(scope="module")
def warm(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Modules and kernels are loaded once, and not in each process."""
    at = tmp_path_factory.mktemp("warm")
    gx.write_report(recorded(at), at / "report.html")
    touching()
    inflated()
    at_rest()
    drawn(at, square)


@pytest.mark.parametrize("every", [9, pytest.param(1, marks=pytest.mark.slow)])
def test_wrong_use_is_refused_in_a_sentence_or_harmless(
    tmp_path: Path, warm: None, every: int
) -> None:
    counts: Counter[str] = Counter()
    bad = []
    cases = [(f"{group}, {what}", case) for group in GROUPS for what, case in GROUPS[group].items()]
    for number, (what, case) in enumerate(cases[::every]):
        found = in_a_process(case, tmp_path / f"{number:03d}")
        kind = found.split(" ")[0]
        counts[kind] += 1
        if os.environ.get("SHOW"):
            print(f"  {what}: {found}", flush=True)
        if kind not in ("sentence", "taken"):
            bad.append(f"{what}: {found}")
    print(f"{counts.total()} kinds of wrong use: {dict(counts)}")
    assert not bad, "\n".join(bad)
    assert counts.total() >= (360 if every == 1 else 40)
