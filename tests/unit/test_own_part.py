"""The page "Your own item" of CONTRIBUTING: its code is run as a reader would, and conserves."""

from __future__ import annotations

import ast
import re
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import gossamer_fx as gx
from gossamer_fx.extend import LawOfRows
from tests import own_part
from tests.small_scenes import run_until

PAGE = Path(__file__).parents[2] / "CONTRIBUTING.md"


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> ModuleType:
    [code] = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert len(code.splitlines()) <= 60
    file = tmp_path_factory.mktemp("own") / "bending_spring.py"
    file.write_text(code, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(file.parent)
        return import_module("bending_spring")


def test_the_page_imports_the_public_interface_only() -> None:
    [code] = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    modules = {
        node.module
        for node in ast.walk(ast.parse(code))
        if isinstance(node, ast.ImportFrom) and str(node.module).startswith("gossamer_fx")
    }
    assert modules == {"gossamer_fx.extend"}


@pytest.mark.mpi
def test_a_port_outside_the_scene_is_refused_on_all_ranks(own: ModuleType, comm) -> None:
    """A part whose `requires` forgets a body: the rank that evaluates its measure sees it first."""

    class Forgetful(own.BendingSpring):
        def requires(self):
            return []

    masses = [gx.PointMass(1.0, (float(k), 0.0, 0.0), name=f"m{k}", comm=comm) for k in range(3)]
    spring = Forgetful(tuple(mass.port() for mass in masses), stiffness=1.0, hardening=1.0)
    scene = gx.Scene(masses[0], masses[1], spring)
    with pytest.raises(gx.InputError, match="'bending spring' has a port of 'm2'"):
        scene.compile()


def swinging(own: ModuleType, hardening: float = 2e3, dt: float = 1e-2) -> gx.Simulation:
    places = ((-1.0, 0.0, 0.0), (0.0, 0.2, 0.0), (1.0, 0.0, 0.1))
    speeds = ((0.0, 1.0, 0.0), (0.3, 0.0, 2.0), (0.0, -1.0, 0.5))
    masses = [
        gx.PointMass(1.0 + k, x, velocity=v, name=f"m{k}")
        for k, (x, v) in enumerate(zip(places, speeds, strict=True))
    ]
    a, b, c = (m.port() for m in masses)
    return gx.Simulation(
        gx.Scene(own.BendingSpring((a, b, c), 50.0, hardening)), gx.Midpoint(dt=dt)
    )


def test_the_part_of_the_page_conserves(own: ModuleType) -> None:
    run = swinging(own)
    run.run(until=3.0)
    assert run.totals.stored["bending spring"] > 0 and run.iterations > 300
    assert abs(run.energy_error) < 1e-10
    assert np.abs(run.totals.momentum - run.first.momentum).max() < 1e-11
    assert np.abs(run.totals.angular_momentum - run.first.angular_momentum).max() < 1e-10


def test_its_frequency_is_that_of_the_linear_spring(own: ModuleType) -> None:
    """Small motions of a symmetric triple with masses m, 2m, m: ω² = k (1/m + 4/(2m) + 1/m) =
    4k/m."""
    masses = [
        gx.PointMass(m, x, velocity=v, name=n)
        for m, x, v, n in (
            (1.0, (-1.0, 0.0, 0.0), (0.0, 1e-3, 0.0), "left"),
            (2.0, (0.0, 0.0, 0.0), (0.0, -1e-3, 0.0), "middle"),
            (1.0, (1.0, 0.0, 0.0), (0.0, 1e-3, 0.0), "right"),
        )
    ]
    a, b, c = (m.port() for m in masses)
    quarter = np.pi / 2 / np.sqrt(4 * 50.0)
    run = run_until(quarter, own.BendingSpring((a, b, c), 50.0, 1.0), dt=quarter / 200)
    assert run.totals.kinetic < 1e-6 * run.totals.energy


def test_a_wrong_number_is_told_in_one_sentence(own: ModuleType) -> None:
    with pytest.raises(gx.InputError, match="hardening"):
        swinging(own, hardening=-1.0)


@pytest.mark.mpi
def test_its_energy_has_gradients(own: ModuleType, comm) -> None:
    """A middle point that a force F pushes aside, both others held: k e' = F with e = ½ |2 b|², so
    ψ = F²/(8k), and dψ/dk = -F²/(8k²)."""
    middle = gx.PointMass(1.0, (0.0, 0.0, 0.0), name="middle", comm=comm)
    a, c = (gx.Ground((x, 0.0, 0.0)) for x in (-1.0, 1.0))

    class OnGround(own.BendingSpring):
        def requires(self):
            return [middle]

    spring = OnGround((a, middle.port(), c), 50.0, 1e-9, name="spring")
    scene = gx.Scene(middle, spring, gx.loads.Force(middle.port(), (0.0, 0.0, 3.0)))
    equilibrium = gx.Equilibrium(scene, gx.analysis.Continuation(tolerance=1e-13))
    equilibrium.find()
    found = gx.analysis.gradient(equilibrium, of=gx.analysis.Energy(), by=["spring.stiffness"])
    assert found.value == pytest.approx(9.0 / (8 * 50.0), rel=1e-6)
    assert found["spring.stiffness"].values == pytest.approx([-9.0 / (8 * 50.0**2)], rel=1e-6)


@pytest.fixture(scope="module")
def slider() -> dict[str, Any]:
    """What the section on a spring with friction of the tutorial defines."""
    section = "A spring with friction"
    code = own_part.code_of(section)
    law = code[code.index("def slider") : code.index("@dataclass")]
    assert len(law.strip().splitlines()) <= 25
    return vars(own_part.module_of(section))


@pytest.mark.mpi
def test_a_law_with_history_goes_on_after_a_restart(
    slider: dict[str, Any], comm, folder: Path
) -> None:
    """Two masses, on two ranks if there are: the run that was stopped in the middle ends as the one
    that was not, and what friction takes is lost."""

    def run(until: float, **options: Any) -> gx.Simulation:
        masses = [
            gx.PointMass(1.0, (x, 0.0, 0.0), velocity=(v, 0.0, 0.0), name=f"m{x}", comm=comm)
            for x, v in ((0.0, -0.3), (1.0, 0.5))
        ]
        a, b = (mass.port() for mass in masses)
        made = gx.Simulation(
            gx.Scene(*masses, slider["SlidingSpring"]((a, b))), gx.Midpoint(dt=5e-3), **options
        )
        made.run(until=until)
        return made

    whole = run(0.6)
    run(0.3, checkpoints=gx.Checkpoints(folder))
    rest = run(0.6, restart=folder)
    assert rest.totals.losses == pytest.approx(whole.totals.losses, rel=1e-12)
    assert rest.totals.kinetic == pytest.approx(whole.totals.kinetic, rel=1e-12)
    for made in (whole, rest):
        assert abs(made.energy_error) < 1e-12
        assert np.abs(made.totals.momentum - made.first.momentum).max() < 1e-12
    assert whole.totals.losses["slider"] > 0.05


@pytest.mark.mpi
def test_its_law_is_compiled(slider: dict[str, Any], comm) -> None:
    law = LawOfRows(slider["slider"], 1, {"k": None, "L": None, "F": None}, comm, variables=1)
    assert law.derivatives == "compiled"
