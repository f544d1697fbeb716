"""Invalid input is refused in one sentence that names it, before anything is computed, on any
number of ranks."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable
from operator import attrgetter
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.app.cli.command import main
from gossamer_fx.app.cli.user_files import guarded
from gossamer_fx.core.checks.lazy_names import public_names
from gossamer_fx.mechanics.contact.obstacles import Obstacle
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.meshes.sphere import sphere
from gossamer_fx.solve.scene.scene import Item
from tests.unit.public_calls import UNCALLED, Inputs, make_inputs, spoiled, valid_calls

AIR = gx.IdealGas(gamma=1.4, R=287.0)
LAW = gx.Miyazaki(
    E=1e9,
    nu=0.3,
    density=1400.0,
    thickness=1e-4,
)
WORLD = MPI.COMM_WORLD
# Letters of a message: the longest one lists the names of all fields.
LONGEST_MESSAGE = 300


def film(**options) -> gx.Membrane:
    return gx.Membrane(sheet(WORLD, 2, 2), LAW, **options)


def cable(**options) -> gx.Cable:
    return gx.Cable(
        line(WORLD, [(0, 0, 0), (1, 0, 0)], 2),
        gx.CableLaw(1e3, 1.0),
        **options,
    )


def beam(**options) -> gx.Beam:
    section = gx.sections.solid_circle(
        0.1,
        E=1e9,
        nu=0.3,
        density=1000.0,
    )
    return gx.Beam(
        line(WORLD, [(0, 0, 0), (1, 0, 0)], 2),
        section,
        **options,
    )


def attitude(**options) -> gx.control.AttitudeControl:
    body = gx.RigidBody(1.0, (1.0, 1.0, 1.0))
    return gx.control.AttitudeControl(
        body.frame(),
        (0.0, 0.0, 0.0),
        stiffness=1.0,
        damping=1.0,
        **options,
    )


def tank(**options) -> gx.Tank:
    return gx.Tank(
        1e-3,
        gas=AIR,
        pressure=1e5,
        temperature=300.0,
        **options,
    )


def not_a_number(x: np.ndarray) -> np.ndarray:
    """Finite but for the points with x > 0.9: on two ranks perhaps on one of them only."""
    return np.where(x[0] > 0.9, np.nan, 0.0 * x)


def flipped_pillow(reverse: bool) -> gx.Mesh:
    """Two sheets on one curve loop; as gmsh makes them, both normals point up."""

    def build(model) -> None:
        geo = model.geo
        points = [geo.addPoint(x, y, 0) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]
        lines = [geo.addLine(points[i], points[(i + 1) % 4]) for i in range(4)]
        loop = geo.addCurveLoop(lines)
        sheets = [geo.addPlaneSurface([loop]) for _ in range(2)]
        for side in lines:
            geo.mesh.setTransfiniteCurve(side, 5)
        for one in sheets:
            geo.mesh.setTransfiniteSurface(one, "AlternateLeft")
        geo.synchronize()
        model.addPhysicalGroup(2, sheets, name="film")
        model.mesh.generate(2)
        if reverse:
            model.mesh.reverse([(2, sheets[1])])

    return gx.gmsh_mesh(build, WORLD)


def quadrilaterals(model) -> None:
    model.occ.addRectangle(0, 0, 0, 1, 1)
    model.occ.synchronize()
    model.mesh.generate(2)
    model.mesh.recombine()


def chamber_of(mesh: gx.Mesh) -> gx.Scene:
    return gx.Scene(
        gx.Chamber(
            gx.Membrane(mesh, LAW),
            gas=AIR,
            pressure=1.0,
            temperature=300.0,
            dead_volume=1e-3,
        )
    )


CASES: dict[str, tuple[Callable[[], object], str]] = {
    "missing file": (lambda: gx.read_mesh("nowhere/pillow.msh", WORLD), "nowhere/pillow.msh"),
    "mesh without the tag": (lambda: gx.Fixed(film(), "rim"), "rim"),
    "negative thickness": (
        lambda: gx.Miyazaki(
            E=1e9,
            nu=0.3,
            density=1.0,
            thickness=-1e-4,
        ),
        "thickness",
    ),
    "zero modulus": (
        lambda: gx.Linear(
            E=0.0,
            nu=0.3,
            density=1.0,
            thickness=1e-4,
        ),
        "E",
    ),
    "infinite density": (
        lambda: gx.Linear(
            E=1e9,
            nu=0.3,
            density=np.inf,
            thickness=1e-4,
        ),
        "density",
    ),
    "nu = 0.51": (
        lambda: gx.Miyazaki(
            E=1e9,
            nu=0.51,
            density=1.0,
            thickness=1e-4,
        ),
        "nu",
    ),
    "nu = -1": (
        lambda: gx.Linear(
            E=1e9,
            nu=-1.0,
            density=1.0,
            thickness=1e-4,
        ),
        "nu",
    ),
    "residual = 2": (
        lambda: gx.Miyazaki(
            E=1e9,
            nu=0.3,
            density=1.0,
            thickness=1e-4,
            residual_stiffness=2.0,
        ),
        "residual",
    ),
    "residual of a tension field": (
        lambda: gx.TensionField(
            E=1e9,
            nu=0.3,
            density=1.0,
            thickness=1e-4,
            residual_stiffness=1e-3,
        ),
        "TensionField",
    ),
    "order 3": (lambda: film(order=3), "order"),
    "negative pressure": (
        lambda: gx.Tank(
            1e-3,
            gas=AIR,
            pressure=-1e5,
            temperature=300.0,
        ),
        "pressure",
    ),
    "negative temperature": (lambda: gx.gas.Reservoir(1e5, -3.0), "temperature"),
    "negative surroundings": (lambda: gx.gas.Ambient(-1.0), "Ambient"),
    "gamma = 1": (lambda: gx.IdealGas(gamma=1.0, R=287.0), "gamma"),
    "R = 0": (lambda: gx.IdealGas(gamma=1.4, R=0.0), "R"),
    "chamber without volume": (
        lambda: gx.Chamber(gas=AIR, pressure=1e5, temperature=300.0),
        "chamber",
    ),
    "flat chamber": (
        lambda: gx.Scene(
            gx.Chamber(
                gx.Membrane(flipped_pillow(True), LAW),
                gas=AIR,
                pressure=1.0,
                temperature=300.0,
            )
        ).compile(),
        "dead_volume",
    ),
    "open surface": (lambda: chamber_of(sheet(WORLD, 2, 2)).compile(), "open"),
    "inconsistent orientation": (lambda: chamber_of(flipped_pillow(False)).compile(), "normals"),
    "orifice into itself": (lambda: gx.Orifice(*[tank()] * 2, area=1e-6), "orifice"),
    "orifice into a film": (
        lambda: gx.Orifice(tank(), film(), area=1e-6),
        "b is of the kind Membrane",
    ),
    "negative orifice": (
        lambda: gx.Orifice(tank(), gx.gas.Ambient(), area=-1e-6),
        "area",
    ),
    "discharge coefficient 2": (
        lambda: gx.Orifice(
            tank(),
            gx.gas.Ambient(),
            area=1e-6,
            discharge_coefficient=2.0,
        ),
        "discharge_coefficient",
    ),
    "negative valve": (
        lambda: (
            gx.Midpoint(dt=0.1)
            .start(gx.Scene(gx.Orifice(tank(), gx.gas.Ambient(), area=lambda t: -t)).compile())
            .step(0.1)
        ),
        "area",
    ),
    "two gases": (
        lambda: gx.Scene(
            gx.Orifice(
                tank(),
                gx.Tank(
                    1.0,
                    gas=gx.IdealGas(gamma=1.67, R=2077.0),
                    pressure=1.0,
                    temperature=300.0,
                    name="helium",
                ),
                area=1e-6,
            )
        ).compile(),
        "helium",
    ),
    "reservoir alone": (lambda: gx.Scene(gx.gas.Reservoir(1e5, 300.0)).compile(), "chamber"),
    "duplicate names": (lambda: gx.Scene(film(), film()), "'film'"),
    "empty scene": (lambda: gx.Scene(), "empty"),
    "no part of a scene": (lambda: gx.Scene(LAW), "Miyazaki"),
    "part that does nothing": (
        lambda: gx.Scene(film(), SimpleNamespace(name="idle")),
        "is not a scene item",
    ),
    "NaN displacement": (
        lambda: gx.Scene(film(displacement=not_a_number)).compile(),
        "displacement",
    ),
    "NaN velocity": (lambda: gx.Scene(film(velocity=not_a_number)).compile(), "velocity"),
    "dt = 0": (lambda: gx.Midpoint(dt=0.0), "dt"),
    "dt < 0": (lambda: gx.Midpoint(dt=-1e-3), "dt"),
    "dt is not a number": (lambda: gx.Midpoint(dt=np.nan), "dt"),
    "endless run": (
        lambda: gx.Simulation(gx.Scene(film()), gx.Midpoint(dt=1e-3)).run(until=np.nan),
        "until",
    ),
    "every = 0": (lambda: gx.outputs.VTU("x.pvd", every=0), "every"),
    "unknown field": (
        lambda: gx.Simulation(
            gx.Scene(film()),
            gx.Midpoint(dt=1e-3),
            outputs=[gx.outputs.VTU("out/x.pvd", fields=("stres",))],
        ),
        "stres",
    ),
    "no damping": (lambda: gx.Damping(film()), "damping"),
    "fourth component": (lambda: gx.Fixed(film(), "left", components=(3,)), "components"),
    "massless point": (lambda: gx.PointMass(0.0), "mass"),
    "soft spring": (
        lambda: gx.connectors.AxialSpring(
            gx.PointMass(1.0).port(),
            -1.0,
            direction=(1, 0, 0),
        ),
        "stiffness",
    ),
    "linear film on curved triangles": (
        lambda: gx.Membrane(sphere(WORLD, 1.0, 8, order=2), LAW),
        "order",
    ),
    "displacement in the plane": (
        lambda: gx.Scene(film(displacement=lambda x: x[:2])).compile(),
        "(3, n)",
    ),
    "velocity of a cable in the plane": (
        lambda: gx.Scene(cable(velocity=lambda x: x[:2])).compile(),
        "(3, n)",
    ),
    "velocity of a beam in the plane": (
        lambda: gx.Scene(beam(velocity=lambda x: x[:2])).compile(),
        "(3, n)",
    ),
    "velocity without points": (lambda: film(velocity=(0.0, 0.0, 1.0)), "velocity"),
    "quadrilaterals": (lambda: gx.gmsh_mesh(quadrilaterals, WORLD), "Quadrilateral"),
    "no elements": (lambda: gx.gmsh_mesh(lambda model: None, WORLD), "no triangles"),
    "gravity is not a number": (lambda: gx.Gravity(film(), (0.0, 0.0, np.nan)), "g is"),
    "pressure is not a number": (lambda: gx.Pressure(film(), np.nan), "Pressure: pressure is nan"),
    "endless orifice": (
        lambda: gx.Orifice(tank(), gx.gas.Ambient(), area=np.inf),
        "area",
    ),
    "cold surroundings": (lambda: gx.gas.Ambient(1.0, -3.0), "temperature"),
    "wall of a reservoir": (
        lambda: gx.gas.WallHeat(
            gx.gas.Reservoir(1e5, 300.0),
            1.0,
            temperature=300.0,
        ),
        "WallHeat: chamber is of the kind Reservoir",
    ),
    "surface of curves": (
        lambda: gx.Scene(
            gx.Chamber(
                film(),
                gas=AIR,
                pressure=1.0,
                temperature=300.0,
                dead_volume=1e-3,
                surface=("left",),
            )
        ).compile(),
        "left",
    ),
    "point in the plane": (lambda: gx.PointMass(1.0, (0.0, 0.0)), "position"),
    "spring along nothing": (
        lambda: gx.connectors.AxialSpring(
            gx.PointMass(1.0).port(),
            1.0,
            direction=(0, 0, 0),
        ),
        "direction",
    ),
    "no Gauss points": (lambda: gx.steppers.PathAverage(points=0), "points"),
    "no iterations": (lambda: gx.Tolerances(max_iterations=0), "iterations"),
    "tolerance is not a number": (lambda: gx.Tolerances(relative=np.nan), "relative"),
    "halvings = -1": (
        lambda: gx.Simulation(
            gx.Scene(film()),
            gx.Midpoint(dt=1e-3),
            halvings=-1,
        ),
        "halvings",
    ),
    "back in time": (
        lambda: gx.Simulation(gx.Scene(film()), gx.Midpoint(dt=1e-3)).run(until=-1.0),
        "until",
    ),
    "axes that are a word": (lambda: attitude(axes="xyz"), "axes"),
    "axes of two columns": (lambda: attitude(axes=((1, 0), (0, 1), (0, 0))), "axes"),
    "left-handed axes": (lambda: attitude(axes=((1, 0, 0), (0, 1, 0), (0, 0, -1))), "right-handed"),
    "a mass that encloses": (
        lambda: gx.Chamber(
            gx.PointMass(1.0),
            gas=AIR,
            pressure=1.0,
            temperature=300.0,
            dead_volume=1e-3,
        ),
        "enclosure is of the kind PointMass",
    ),
    "start from a scene": (lambda: gx.StartFrom(gx.Scene(film())), "system is of the kind Scene"),
    "port of a missing node": (lambda: gx.Port(gx.PointMass(1.0), (7,)), "its nodes are 0 to 0"),
    "port of a node below zero": (
        lambda: gx.Port(gx.PointMass(1.0), (-1,)),
        "its nodes are 0 to 0",
    ),
    "checkpoints that are a word": (
        lambda: gx.Simulation(
            gx.Scene(film()),
            gx.Midpoint(dt=1e-3),
            checkpoints="saves",
        ),
        "give a Checkpoints",
    ),
    "checkpoints that are a recording": (
        lambda: gx.Simulation(
            gx.Scene(film()),
            gx.Midpoint(dt=1e-3),
            checkpoints=gx.Recording("saves"),
        ),
        "give a Checkpoints",
    ),
    "null character in a checkpoint's name": (
        lambda: gx.Simulation(
            gx.Scene(film()),
            gx.Midpoint(dt=1e-3),
            restart="a\0b",
        ),
        "null characters",
    ),
    "null character in the log's name": (lambda: gx.run.log_to(WORLD, "a\0b"), "null characters"),
    "null character in a picture's name": (lambda: gx.plot.Picture("a\0b.png"), "null characters"),
    "null character in a mesh's name": (lambda: gx.read_mesh("a\0b.msh", WORLD), "a\\x00b.msh"),
    "a file's name that has no bytes": (lambda: gx.Ledger("\ud800.csv"), "Ledger: path is"),
    "line break in a group's name": (lambda: gx.Fixed(film(), "left\nright"), "left\\nright"),
    "tolerance that any state meets": (lambda: gx.Tolerances(relative=3.7), "below 1"),
    "scalar tolerance that any state meets": (lambda: gx.Tolerances(scalars=1.0), "below 1"),
    "residual that any state meets": (lambda: gx.analysis.Continuation(tolerance=3.7), "below 1"),
    "inner residual that any state meets": (
        lambda: gx.analysis.Continuation(inner_tolerance=1.0),
        "below 1",
    ),
    "crease of a cable": (
        lambda: gx.connectors.Crease(cable(), "line", stiffness=1.0),
        "body is of the kind Cable; give a Membrane",
    ),
    "start from a point mass": (lambda: gx.StartFrom(gx.PointMass(1.0)), "the system of an"),
    "radius that is a word": (
        lambda: gx.Contact(cable(), distance=1e-3, radius={"cable": "thin"}),
        "values are each a number",
    ),
    "slip velocity of no body": (
        lambda: gx.Contact(
            film(),
            distance=1e-3,
            friction=0.1,
            slip_velocity=1e90,
        ),
        "slip_velocity is 1e+90 m/s",
    ),
    "number whose square overflows": (lambda: gx.PointMass(1e300), "a size between 1e-100 and"),
    "whole number beyond all floats": (lambda: gx.PointMass(10**400), "a size between 1e-100 and"),
    "rest curvature that returns words": (
        lambda: gx.Plate(
            sheet(WORLD, 2, 2),
            gx.Linear(1e9, 0.3, density=1400.0, thickness=1e-4),
            rest_curvature=lambda X: ["a", "b", "c"],
        ),
        "its rest_curvature function: it returns ['a', 'b', 'c']",
    ),
    "complex rest curvature": (
        lambda: gx.Plate(
            sheet(WORLD, 2, 2),
            gx.Linear(1e9, 0.3, density=1400.0, thickness=1e-4),
            rest_curvature=lambda X: 1j * np.zeros((3, 3, X.shape[1])),
        ),
        "its rest_curvature function: it returns an array (3, 3, ",
    ),
    "piston without area": (
        lambda: gx.gas.Piston(
            gx.PointMass(1.0).port(),
            0.0,
            direction=(1, 0, 0),
        ),
        "area",
    ),
}


@pytest.mark.mpi
@pytest.mark.parametrize("case", CASES)
def test_one_sentence(case: str) -> None:
    act, culprit = CASES[case]
    with pytest.raises(gx.InputError) as caught:
        act()
    message = str(caught.value)
    assert culprit in message
    assert "\n" not in message and message.endswith(".") and 20 < len(message) < LONGEST_MESSAGE


@pytest.mark.mpi
def test_unwritable_folder(folder: Path) -> None:
    blocked = folder / "a file"
    if WORLD.rank == 0:
        blocked.write_text("")
    WORLD.barrier()
    with pytest.raises(gx.InputError, match="a file"):
        gx.Simulation(
            gx.Scene(film()),
            gx.Midpoint(dt=1e-3),
            outputs=[gx.Ledger(blocked / "ledger.csv")],
        )


# ---- generated: every public name ----------------------------------------------------------------


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Inputs:
    return make_inputs(WORLD.bcast(tmp_path_factory.mktemp("inputs")))


def test_every_public_name_has_a_valid_call(folder: Path, inputs: Inputs) -> None:
    measured = set(valid_calls(folder, inputs)) | UNCALLED
    assert measured == set(public_names())


@pytest.mark.mpi
def test_every_valid_call_is_taken(folder: Path, inputs: Inputs) -> None:
    """Otherwise a spoiled call could be refused for another reason than its spoiled argument."""
    refused = []
    for name, call in valid_calls(folder, inputs).items():
        try:
            attrgetter(name)(gx)(**call)
        except Exception as error:
            refused.append(f"{name}: {type(error).__name__}: {error}")
    assert not refused, "\n".join(refused)
    logging.getLogger("gossamer_fx").handlers.clear()


def test_lists_and_arrays_are_taken_where_tuples_are(folder: Path, inputs: Inputs) -> None:
    refused = []
    tried = 0
    for name, call in valid_calls(folder, inputs).items():
        for argument, value in call.items():
            if not isinstance(value, tuple | list) or not value:
                continue
            others: list[object] = [list(value), tuple(value)]
            if all(isinstance(one, int | float) for one in value):
                others.append(np.array(value))
            for other in others:
                tried += 1
                try:
                    made = attrgetter(name)(gx)(**call | {argument: other})
                    if isinstance(made, Item) and not isinstance(made, gx.Frame | Obstacle):
                        gx.Scene(made).compile()
                except Exception as error:
                    refused.append(f"{name}({argument}={other!r}): {type(error).__name__}: {error}")
    assert not refused, "\n".join(refused)
    assert tried > 180
    logging.getLogger("gossamer_fx").handlers.clear()


@pytest.mark.mpi
def test_every_argument_of_another_kind_is_one_sentence(folder: Path, inputs: Inputs) -> None:
    """One argument of every public call is replaced by a value that it cannot have."""
    tried = 0
    silent = []
    for name, call in valid_calls(folder, inputs).items():
        for argument, bad in spoiled(call):
            tried += 1
            try:
                attrgetter(name)(gx)(**call | {argument: bad})
            except gx.InputError as error:
                message = str(error)
                if (
                    "\n" in message
                    or not message.endswith(".")
                    or not 20 < len(message) < LONGEST_MESSAGE
                ):
                    silent.append(f"{name}({argument}={bad!r}): {message}")
            except Exception as error:
                silent.append(f"{name}({argument}={bad!r}) raises {type(error).__name__}: {error}")
            else:
                silent.append(f"{name}({argument}={bad!r}) is taken")
    assert not silent, "\n".join(silent)
    assert tried > 600
    measured = {path.name for path in folder.iterdir()}
    assert measured <= {"log.txt"}
    logging.getLogger("gossamer_fx").handlers.clear()


def test_unknown_and_missing_arguments_are_one_sentence() -> None:
    with pytest.raises(
        gx.InputError, match=r"Tank: the argument 'volume' is missing; .* volume, gas, pressure"
    ):
        gx.Tank(gas=AIR, pressure=1e5, temperature=300.0)
    with pytest.raises(
        gx.InputError, match=r"Midpoint: there is no .*'step'; its arguments are: dt, rule, tol"
    ):
        gx.Midpoint(dt=0.1, step=2)


# ---- what was written before is kept -------------------------------------------------------------


@pytest.mark.mpi
def test_a_refused_run_destroys_nothing(folder: Path) -> None:
    """Outputs that are asked for before the one that is refused leave the files of an earlier run
    alone."""
    names = ["ledger.csv", "probes.csv"]
    if WORLD.rank == 0:
        for name in names:
            (folder / name).write_text("precious")
    WORLD.barrier()
    outputs = [
        gx.Ledger(folder / "ledger.csv"),
        gx.outputs.Probes(folder / "probes.csv", {"a": lambda run: 1.0}),
        gx.outputs.VTU(folder / "a.pvd", fields=("stres",)),
    ]
    with pytest.raises(gx.InputError, match="stres"):
        gx.Simulation(
            gx.Scene(film()),
            gx.Midpoint(dt=1e-3),
            outputs=outputs,
        )
    measured = [(folder / name).read_text() for name in names]
    assert measured == ["precious"] * 2


def test_pictures_and_reports_do_not_fall_on_folders(tmp_path: Path) -> None:
    run = gx.Simulation(
        gx.Scene(film()),
        gx.Midpoint(dt=1e-3),
        outputs=[gx.Recording(tmp_path / "run", every=1)],
    )
    run.run(until=2e-3)
    recorded = gx.plot.RunReader(tmp_path / "run")
    (tmp_path / "folder.gif").mkdir()
    for draw in (
        lambda path: gx.plot.curves(recorded, path),
        lambda path: gx.plot.field(
            recorded,
            "state",
            times=[0.0],
            path=path,
        ),
        lambda path: gx.plot.strip(recorded, "state", path=path),
        lambda path: gx.plot.animate(recorded, "state", path=path),
        lambda path: gx.write_report(recorded, path),
    ):
        with pytest.raises(
            gx.InputError, match=r"folder.gif', which is a folder; give the name of a file\."
        ):
            draw(tmp_path / "folder.gif")


# ---- the command line ----------------------------------------------------------------------------

GOOD = """
import gossamer_fx as gx
from gossamer_fx.meshes.sheet import sheet
def build(comm, cells=2, until=2e-3):
    law = gx.Linear(E=1e9, nu=0.3, density=1400.0, thickness=1e-4)
    film = gx.Membrane(sheet(comm, cells, cells), law)
    return gx.Case(gx.Scene(film), gx.Midpoint(dt=1e-3), until=until)
"""
SCENES = {
    "no file": (None, [], "no.py"),
    "no text": ("\0", [], "scene.py"),
    "no Python": ("def build(comm:\n", [], "line 1: SyntaxError"),
    "no build": ("x = 1\n", [], "no function build"),
    "build without comm": ("def build():\n    pass\n", [], "'comm'"),
    "build of nothing": ("def build(comm):\n    pass\n", [], "returns NoneType"),
    "import of nothing": ("import gossamer_fy\n", [], "line 1: ModuleNotFoundError"),
    "an error inside": ("def build(comm):\n    return 1 / 0\n", [], "line 2: ZeroDivisionError"),
    "an exit inside": ("raise SystemExit\n", [], "line 1: SystemExit"),
    "a scene that cannot be": (GOOD.replace("1400.0", "-1.0"), [], "density"),
    "an option that is unknown": (GOOD, ["cell=3"], "'cell'"),
    "an option without value": (GOOD, ["cells"], "'cells'"),
    "an option of another kind": (GOOD, ["until=long"], "until"),
    "a value that is missing": (GOOD.replace("cells=2", "cells"), [], "cells"),
    "nothing to restart from": (GOOD, ["--restart"], "checkpoint"),
    "a checkpoint that is nowhere": (GOOD, ["--restart", "saved"], "no checkpoint in 'saved'"),
    "no ranks": (GOOD, ["--ranks", "0"], "'0'"),
    "unknown flag": (GOOD, ["--fast"], "--fast"),
    "a log that cannot be": (GOOD, ["--log", "scene.py/log.txt"], "log.txt"),
}


@pytest.mark.parametrize("case", SCENES)
def test_run_of_a_bad_scene_is_one_sentence(case: str, tmp_path: Path, monkeypatch, capsys) -> None:
    text, words, culprit = SCENES[case]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.path", [*__import__("sys").path])
    if text is not None:
        Path("scene.py").write_text(text)
    try:
        code = main(["run", "scene.py" if text is not None else "no.py", "-o", "run", *words])
    except SystemExit as leave:
        code = leave.code
    out, err = capsys.readouterr()
    assert code == 2 and not out
    assert (
        err.startswith("gossamer: ")
        and err.count("\n") == 1
        and err.endswith(".\n")
        and culprit in err
    )


def test_a_signal_in_a_scene_is_no_error_of_its_file(capsys) -> None:
    def stop() -> None:
        raise gx.run.Interrupted(15)

    with pytest.raises(gx.run.Interrupted):
        guarded(MPI.COMM_SELF, Path("scene.py"), False, stop)
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize(
    "words, culprit",
    [
        (["plot", "run", "--field", "stres"], "stres"),
        (["plot", "run", "--time", "9"], "t = 9 s"),
        (["plot", "run", "--time", "soon"], "soon"),
        (["plot", "run", "--strip", "-3"], "-3"),
        (["plot", "run", "--strip", "3", "--curves"], "one of them"),
        (["plot", "run", "--output", "a.png"], "--output"),
        (["plot", "run", "--animate", "avi"], "avi"),
        (["plot", "nowhere"], "nowhere"),
        (["report", "nowhere"], "nowhere"),
        (["report", "run", "--output", "scene.py/report.html"], "report.html"),
        (["plot"], "run"),
        (["show", "run"], "show"),
    ],
)
def test_looking_at_what_is_not_there_is_one_sentence(
    words, culprit, tmp_path: Path, monkeypatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("scene.py").write_text(GOOD)
    measured = main(["run", "scene.py", "-o", "run", "--quiet"])
    assert measured == 0
    capsys.readouterr()
    try:
        code = main(words)
    except SystemExit as leave:
        code = leave.code
    _, err = capsys.readouterr()
    assert code in (1, 2)
    assert (
        err.startswith("gossamer: ")
        and err.count("\n") == 1
        and err.endswith(".\n")
        and culprit in err
    )


SPHERE = """
import gossamer_fx as gx
from gossamer_fx.meshes.sphere import sphere

def build(comm):
    law = gx.Miyazaki(1e9, 0.3, density=1000.0, thickness=1e-4)
    film = gx.Membrane(sphere(comm, 1.0, 10), law)
    return gx.Case(gx.Scene(film, gx.Pressure(film, 1.0)), gx.Midpoint(dt=1e-3), until=2e-3)
"""


def test_a_dry_run_shows_the_side_of_the_normals(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    Path("sphere.py").write_text(SPHERE)
    assert main(["run", "sphere.py", "--dry-run"]) == 0
    said = capsys.readouterr().out
    assert re.search(r"'film' encloses [34]\.\d+ m³, and its normals point outwards\n", said)
    Path("scene.py").write_text(GOOD)
    assert main(["run", "scene.py", "--dry-run"]) == 0
    # A sheet has no inside.
    assert "normals" not in capsys.readouterr().out


@pytest.mark.mpi
def test_bodies_on_other_ranks_are_refused(comm) -> None:
    """A hub without `comm` is on all ranks, its film on one."""
    sail = gx.Membrane(sheet(MPI.COMM_SELF, 2, 2), LAW, name="sail")
    scene = gx.Scene(sail, gx.RigidBody(1.0, (1.0, 1.0, 1.0), name="hub", comm=comm))
    if comm.size == 1:
        # The same rank in both.
        assert scene.compile().numbering.size == 27 + 18
        return
    with pytest.raises(gx.InputError, match=r"'hub' is on 2 ranks and 'sail' on 1.*same comm"):
        scene.compile()


def test_a_run_is_kept_and_can_go_on(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    Path("scene.py").write_text(GOOD)
    assert main(["run", "scene.py", "--dry-run"]) == 0
    assert "Membrane, 8 cells" in capsys.readouterr().out and not Path("out").exists()
    assert main(["run", "scene.py", "--quiet"]) == 0
    ledger = Path("out/scene/ledger.csv").read_text()
    assert main(["run", "scene.py", "--quiet"]) == 2
    assert "holds a run already" in capsys.readouterr().err
    assert Path("out/scene/ledger.csv").read_text() == ledger
    measured = main(["run", "scene.py", "--quiet", "--restart", "until=4e-3"])
    assert measured == 0
    assert Path("out/scene/ledger.csv").read_text().startswith(ledger)
    assert main(["run", "scene.py", "--quiet", "--overwrite"]) == 0
    assert Path("out/scene/ledger.csv").read_text() == ledger
    measured = gx.plot.RunReader("out/scene").times
    assert measured == pytest.approx([0.0, 1e-3, 2e-3])
