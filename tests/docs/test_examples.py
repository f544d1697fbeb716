"""The examples in docstrings of public classes and functions run and give what they say."""

from __future__ import annotations

import doctest
import inspect
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
import gossamer_fx.extend
from gossamer_fx.core.checks.lazy_names import public_names
from gossamer_fx.meshes.creased_strip import creased_strip
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.meshes.tube import flat_tube
from tests.small_scenes import run_until

COMM = MPI.COMM_SELF
FLAGS = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What examples may use without making it: meshes, one body of each kind, gas, runs, a
    folder."""
    folder = tmp_path_factory.mktemp("examples")
    mesh = sheet(COMM, 4, 4)
    curve = line(COMM, [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)], 4)
    law = gx.Miyazaki(2.5e9, 0.34, density=1420.0, thickness=25e-6)
    stiff = gx.Linear(70e9, 0.3, density=2700.0, thickness=1e-3)
    section = gx.sections.tube(0.02, 5e-4, E=100e9, nu=0.3, density=1560.0)
    hub = gx.RigidBody(10.0, (1.0, 1.0, 1.5), comm=COMM, name="hub")
    mass = gx.PointMass(1.0, (0.0, 0.0, -1.0), comm=COMM)
    air = gx.IdealGas(gamma=1.4, R=287.0)
    tank = gx.Tank(1e-3, gas=air, pressure=2e5, temperature=300.0, name="tank")
    return {
        "gx": gx,
        "np": np,
        "comm": COMM,
        "folder": folder,
        "mesh": mesh,
        "curve": curve,
        "law": law,
        "film": gx.Membrane(mesh, law),
        "tube": gx.Membrane(flat_tube(COMM, 0.2, 0.05, cells=4, compartments=2), law, name="tube"),
        "plate": gx.Plate(mesh, stiff),
        "creased": gx.Membrane(creased_strip(COMM, 2, 1, 0.1, 0.1), law, name="creased"),
        "cable": gx.Cable(curve, gx.CableLaw(1e4, 0.01)),
        "beam": gx.Beam(curve, section),
        "hub": hub,
        "mass": mass,
        "air": air,
        "tank": tank,
        "orbit": gx.orbit.Orbit(gx.orbit.Elements(7e6)),
        "run": gx.Simulation(gx.Scene(hub, mass, tank), gx.Midpoint(dt=0.1)),
        "recorded": recorded_fall(folder / "fall"),
    }


def recorded_fall(folder: Path) -> gx.plot.RunReader:
    """The record of a film that falls for two steps."""
    law = gx.Miyazaki(2.5e9, 0.34, density=1420.0, thickness=25e-6)
    film = gx.Membrane(sheet(COMM, 4, 4), law, name="film")
    run_until(
        0.02,
        film,
        gx.Gravity(film, (0.0, 0.0, -9.81)),
        dt=0.01,
        outputs=[gx.Recording(folder, every=1, title="A fall")],
    )
    return gx.plot.RunReader(folder)


def examples(name: str, names: dict[str, Any] | None = None) -> list[doctest.DocTest]:
    """Doctests of a public name: of a class those of its methods, too."""
    finder = doctest.DocTestFinder(exclude_empty=True)
    found = finder.find(attrgetter(name)(gx), f"gx.{name}", globs=dict(names or {}))
    return [test for test in found if test.examples]


@pytest.mark.parametrize("name", public_names())
def test_there_is_an_example(name: str) -> None:
    assert examples(name)


OWN_PARTS = {name: getattr(gossamer_fx.extend, name) for name in dir(gossamer_fx.extend)}
# Aliases of NumPy's types, e.g. `Array`, have examples of NumPy.
EXTENSION = [
    f"extend.{name}"
    for name, it in OWN_PARTS.items()
    if inspect.isroutine(it) or inspect.isclass(it)
]
TESTED = [name for name in [*public_names(), *EXTENSION] if examples(name)]


@pytest.mark.parametrize("name", TESTED)
def test_examples_give_what_they_say(name: str, scene: dict[str, Any]) -> None:
    said: list[str] = []
    names = scene
    if name.startswith("extend."):
        names = scene | OWN_PARTS  # as after `from gossamer_fx.extend import ...`
    for test in examples(name, names):
        runner = doctest.DocTestRunner(optionflags=FLAGS)
        runner.run(test, out=said.append)
        assert runner.failures == 0, "".join(said)


def test_the_page_on_results_has_the_signature_of_best_surface() -> None:
    import dataclasses
    import inspect

    from gossamer_fx.analysis import BestSurface, best_surface

    text = (Path(__file__).resolve().parents[2] / "docs" / "howto" / "results.md").read_text()
    call = next(line for line in text.splitlines() if line.startswith("`gx.analysis.best_surface("))
    for name in list(inspect.signature(best_surface).parameters)[2:]:
        assert f"{name}=" in call
    for field in dataclasses.fields(BestSurface):
        assert f"`{field.name}`" in text
