"""A scene pays for what it contains: modules, kernels and blocks of a lone film, calls and objects
of an iteration."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from mpi4py import MPI
from petsc4py import PETSc

import gossamer_fx as gx
from gossamer_fx.core.forms.compilation import compile_form
from gossamer_fx.mechanics.gas import patches
from gossamer_fx.meshes.airbag import airbag
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.solve.solvers.newton import Newton
from tests import small_scenes
from tests.hanging import HANG_TIMEOUT
from tests.survival.on_ranks import complete

WRINKLING = "gx.Miyazaki(E=1e9, nu=0.3, density=1400.0, thickness=1e-4)"
TAUT = "gx.Linear(E=1e9, nu=0.3, density=1400.0, thickness=1e-4)"

# "LAW" stands for one of these laws.
FILM_ALONE = """
import json, sys
from mpi4py import MPI
import gossamer_fx as gx
from gossamer_fx.meshes.sheet import sheet

film = gx.Membrane(sheet(MPI.COMM_WORLD, 2, 2), LAW)
run = gx.Simulation(gx.Scene(film), gx.Midpoint(dt=1e-3))
run.run(until=2e-3)
system = run.system
print(json.dumps({
    "modules": sorted(sys.modules),
    "unknowns": system.unknowns.numbering.size,
    "scalar unknowns": len(system.equations.scalar_unknowns),
    "compiled": sorted(type(terms).__name__ for terms in system.equations.compiled),
    "stiffness": system.matrices.K is not None,
    "constraints": system.equations.constraints is not None,
    "searching": len(system.equations.active_sets),
}))
"""

ABSENT = ("erfa", "matplotlib", "pyvista", "slepc4py", "adios4dolfinx", "h5py")
ABSENT_PARTS = {
    "gas",
    "constraints",
    "connectors",
    "contact",
    "loads",
    "control",
    "orbit",
    "analysis",
    "reduction",
    "plot",
    "cli",
    "algebra.dihedral_angle",
    "solvers.coarse_space",
    "solvers.condensed_constraints",
    "solvers.two_level",
    "materials.elastica",
    "probes.flight",
    "outputs.vtu",
    "outputs.recording",
    "terms.loads",
    "terms.point_constraints",
    "terms.rows",
    "terms.quadratic_energies",
    "materials.thermal",
    "terms.thermal_strain",
    "bodies.thermal_expansion",
}


def run_alone(cache: Path, law: str = WRINKLING) -> dict:
    result = subprocess.run(
        [sys.executable, "-c", FILM_ALONE.replace("LAW", law)],
        capture_output=True,
        text=True,
        env=os.environ | {"XDG_CACHE_HOME": str(cache)},
        check=True,
        timeout=HANG_TIMEOUT,
    )
    return dict(json.loads(result.stdout.splitlines()[-1]))


def test_a_lone_film_pays_for_itself_only_and_once(tmp_path: Path) -> None:
    seen = run_alone(tmp_path)
    loaded = {m.split(".")[0] for m in seen["modules"]}
    assert not loaded & set(ABSENT)
    assert "scipy.linalg" not in seen["modules"]
    ours = [m.removeprefix("gossamer_fx.") for m in seen["modules"] if m.startswith("gossamer_fx.")]
    # Rooms and modules by their names within their houses.
    inside = {m.partition(".")[2] for m in ours}
    assert {"system.system", "bodies.membrane"} <= inside
    assert not {m for m in inside if m in ABSENT_PARTS or m.split(".")[0] in ABSENT_PARTS}
    assert seen["unknowns"] == 3 * 9
    assert seen["compiled"] == ["ElementEnergies", "Masses"]
    assert not any(
        seen[what] for what in ("scalar unknowns", "stiffness", "constraints", "searching")
    )
    # mass, residual, tangent, energy; strain, linearised strain, response of any path and of those
    # that stay taut, wrinkled or slack, which of these a path is, and the energy density
    kernels = sorted(p.name for p in tmp_path.rglob("libffcx_*.c"))
    forms = [k for k in kernels if "_forms_" in k]
    expressions = [k for k in kernels if "_expressions_" in k]
    assert (len(forms), len(expressions)) == (4, 8)
    # A second run compiles nothing.
    before = {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*.so")}
    run_alone(tmp_path)
    assert {p: p.stat().st_mtime_ns for p in tmp_path.rglob("*.so")} == before


def test_a_film_that_never_wrinkles_needs_no_law_kernel(tmp_path: Path) -> None:
    seen = run_alone(tmp_path, TAUT)
    assert not [module for module in seen["modules"] if "law_kernel" in module]
    assert not list(tmp_path.rglob("gossamer_law_*"))


@pytest.mark.parametrize(
    ("rule", "count"), [(gx.steppers.PathAverage(), 3), (gx.steppers.EndPoint(), 2)]
)
def test_a_film_round_gas_has_the_forms_that_its_rule_uses(rule, count, monkeypatch):
    """Where forces act at the end of a step, none in the middle."""
    compiled = []

    def noted(form):
        compiled.append(form)
        return compile_form(form)

    monkeypatch.setattr(patches, "compile_form", noted)
    film = gx.Membrane(airbag(MPI.COMM_SELF, 0.85, 2), small_scenes.WRINKLING)
    bag = gx.Chamber(film, gas=small_scenes.AIR, pressure=1e5, temperature=300.0, dead_volume=1e-3)
    gx.Scene(bag).compile(rule)
    assert len(compiled) == count


def test_an_obstacle_loads_no_sparse_matrices() -> None:
    """They take longer to load than all that describes an obstacle."""
    program = """
import sys
import gossamer_fx as gx

gx.contact.Plane(point=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0))
print("scipy.sparse" in sys.modules)
"""
    result = complete([sys.executable, "-c", program])
    assert result.stdout.split() == ["False"]


# ---- an iteration --------------------------------------------------------------------------------


def a_sheet() -> gx.Scene:
    film = gx.Membrane(sheet(MPI.COMM_SELF, 13, 13), small_scenes.WRINKLING)
    return gx.Scene(film, gx.Gravity(film), gx.Fixed(film, "left"))


def a_bag_with_a_tank() -> gx.Scene:
    film = gx.Membrane(airbag(MPI.COMM_SELF, 0.85, 8), small_scenes.WRINKLING)
    air = gx.gas.Ambient(1e5, 300.0)
    bag = gx.Chamber(
        film,
        gas=small_scenes.AIR,
        pressure=1.01e5,
        temperature=300.0,
        dead_volume=1e-2,
        outside=air,
    )
    tank = gx.Tank(volume=1e-3, gas=small_scenes.AIR, pressure=3e5, temperature=300.0)
    return gx.Scene(film, bag, tank, gx.Orifice(tank, bag, area=1e-4))


def ten_cables() -> gx.Scene:
    law = gx.CableLaw(EA=1e4, line_density=0.1)
    cables = []
    for k in range(10):
        ends = [(0.0, float(k), 0.0), (4.0, float(k), 0.0)]
        cables.append(gx.Cable(line(MPI.COMM_SELF, ends, 16), law, name=f"cable {k}"))
    return gx.Scene(*cables, *[gx.Gravity(cable) for cable in cables])


def petsc_objects() -> int:
    """How many objects PETSc has made so far."""
    latest = PETSc.Viewer().create(MPI.COMM_SELF)
    number = latest.id
    latest.destroy()
    return number


# Calls of Python functions in one iteration, measured: 139, 399 and 1299; before 196, 515 and 2554.
@pytest.mark.parametrize(
    ("make", "most_calls"), [(a_sheet, 200), (a_bag_with_a_tank, 600), (ten_cables, 1700)]
)
def test_an_iteration_makes_few_calls_and_no_object_of_petsc(make, most_calls, monkeypatch):
    calls = 0
    objects = 0
    iterations = 0
    solve = Newton.solve

    def count(frame, event, argument):
        nonlocal calls
        calls += event == "call"

    def counted(newton, *arguments):
        nonlocal objects, iterations
        before = petsc_objects()
        sys.setprofile(count)
        try:
            return solve(newton, *arguments)
        finally:
            sys.setprofile(None)
            # `petsc_objects` makes one itself.
            objects += petsc_objects() - before - 1
            iterations += newton.iterations

    run = gx.Simulation(make(), gx.Midpoint(dt=1e-3))
    # The first steps set up what lasts for a run.
    run.run(until=2e-3)
    monkeypatch.setattr(Newton, "solve", counted)
    run.run(until=8e-3)
    assert iterations >= 6
    assert objects == 0
    assert calls < most_calls * iterations
