"""Scenes of every kind whose parameters can be replaced by bad ones, and bad inputs written by
hand."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.creased_strip import creased_strip
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.meshes.tube import flat_tube

ALONE = MPI.COMM_SELF
LAW = {"E": 1e9, "nu": 0.3, "density": 1400.0, "thickness": 1e-4}
AIR = {"gamma": 1.4, "R": 287.0}
MESHES = {
    "sheet": sheet(ALONE, 2, 2),
    "tube": flat_tube(ALONE, 0.2, 0.06, 2),
    "line": line(ALONE, [(0, 0, 0), (1, 0, 0)], 2),
    "creased": creased_strip(ALONE, 2, 1, 0.1, 0.1),
}


def raises(*args: Any) -> Any:
    raise ZeroDivisionError("division by zero")


# values that none of a kind may have
BAD: dict[str, list[Any]] = {
    "positive": [
        -1.0,
        0.0,
        math.nan,
        math.inf,
        -math.inf,
        "1.0",
        None,
        1j,
        [],
        {},
        (1.0, 2.0),
        np.ones(3),
    ],
    "number": [math.nan, math.inf, "1.0", 1j, [], {}, (1.0, 2.0), np.ones(3)],
    "vector": [
        (1.0, 2.0),
        "xyz",
        (math.nan, 0, 0),
        (0, math.inf, 0),
        5.0,
        [],
        {},
        np.eye(3),
        ("a", "b", "c"),
        1j,
    ],
    "direction": [
        (1.0, 2.0),
        "xyz",
        (math.nan, 0, 0),
        (0.0, 0.0, 0.0),
        5.0,
        [],
        {},
        ("a", "b", "c"),
    ],
    "of time": [
        raises,
        lambda t: "much",
        lambda t: None,
        lambda t: np.ones(7),
        lambda t: math.nan,
        lambda: 1.0,
        "t",
        {},
    ],
    "of points": [
        raises,
        lambda X: "much",
        lambda X: None,
        lambda X: X[:2],
        lambda X: math.nan * X,
        lambda: 1.0,
        "x",
        3.0,
    ],
    "of points and time": [
        raises,
        lambda X, t: "much",
        lambda X, t: None,
        lambda X, t: X[:1],
        lambda X, t: math.inf + X,
        lambda X: X,
        "x",
        3.0,
    ],
    "group": ["nowhere", "", None, 3, ("left",), "left ", "Left", b"left"],
    "body": [None, "film", 3.0, LAW, MESHES["sheet"], gx.IdealGas(**AIR)],
    "port": [None, "tip", 3.0, (0.0, 0.0, 0.0), MESHES["sheet"]],
    "frame": [None, "hub", 3.0, gx.Ground((0.0, 0.0, 0.0)), gx.PointMass(1.0)],
    "count": [-1, 1.5, math.nan, "2", None, [], 1j],
    "components": [(), (3,), (-1,), "xy", (0.5,), None, 7],
    "path": ["a\0b", "\ud800", 3.0, None, "file/within", "folder.d"],
    "list": [5.0, "text", [None], [3.0], {"a": 1}],
}

# ---- complete scenes -----------------------------------------------------------------------------

Call = Callable[..., Any]


def film_scene(n: dict[str, Any]) -> gx.Simulation:
    law = gx.Miyazaki(
        n["E"],
        n["nu"],
        density=n["density"],
        thickness=n["thickness"],
        residual_stiffness=n["residual"],
    )
    film = gx.Membrane(MESHES["sheet"], law, velocity=n["velocity"], displacement=n["displacement"])
    parts = [
        gx.Gravity(film, n["g"]),
        gx.Damping(film, mass_factor=n["damping"]),
        gx.Pressure(film, n["pressure"]),
    ]
    parts += [
        gx.Fixed(film, n["group"], components=n["components"]),
        gx.Fixed(film, "right", motion=n["motion"], components=(2,)),
    ]
    parts += [
        gx.loads.Force(film.port("top left"), n["force"]),
        gx.loads.EdgeLoad(film, "top", force=n["load"]),
    ]
    return simulated(gx.Scene(*parts), n)


def gas_scene(n: dict[str, Any]) -> gx.Simulation:
    film = gx.Membrane(MESHES["tube"], gx.Linear(**LAW))
    gas = gx.IdealGas(n["gamma"], n["R"])
    bag = gx.Chamber(
        film,
        gas=gas,
        pressure=n["pressure"],
        temperature=n["temperature"],
        dead_volume=n["dead_volume"],
    )
    tank = gx.Tank(n["volume"], gas=gas, pressure=1e5, temperature=300.0)
    parts = [
        bag,
        gx.Orifice(tank, bag, area=n["valve"], discharge_coefficient=n["discharge"]),
        gx.Orifice(
            bag,
            gx.gas.Ambient(n["outside"]),
            area=n["area"],
            name="vent",
        ),
    ]
    return simulated(
        gx.Scene(*parts, gx.gas.WallHeat(bag, n["conductance"], temperature=n["wall"])), n
    )


def plate_scene(n: dict[str, Any]) -> gx.Simulation:
    plate = gx.Plate(
        MESHES["sheet"],
        gx.Linear(**LAW),
        rest_curvature=n["curvature"],
        hinges=n["hinges"],
    )
    clamp = gx.Fixed(
        plate,
        n["group"],
        rotation=True,
        direction=n["direction"],
        motion=n["motion"],
    )
    return simulated(gx.Scene(clamp, gx.loads.EdgeMoment(plate, "right", moment=n["moment"])), n)


def crease_scene(n: dict[str, Any]) -> gx.Simulation:
    film = gx.Membrane(MESHES["creased"], gx.Linear(**LAW))
    return simulated(
        gx.Scene(
            gx.connectors.Crease(
                film,
                n["edges"],
                stiffness=n["stiffness"],
                rest_angle=n["rest"],
                yield_angle=n["yields"],
            )
        ),
        n,
    )


def contact_scene(n: dict[str, Any]) -> gx.Simulation:
    film = gx.Membrane(MESHES["sheet"], gx.Linear(**LAW))
    floor = gx.contact.Plane(point=n["point"], normal=n["normal"])
    touch = gx.Contact(
        film,
        floor,
        distance=n["distance"],
        stiffness=n["stiffness"],
        friction=n["friction"],
    )
    return simulated(gx.Scene(film, touch), n)


def orbit_scene(n: dict[str, Any]) -> gx.Simulation:
    film = gx.Membrane(MESHES["sheet"], gx.Linear(**LAW))
    orbit = gx.orbit.Orbit(gx.orbit.Elements(n["a"], n["e"]), sun=n["sun"], mu=n["mu"])
    optics = gx.orbit.Optics(n["reflectivity"], n["specular"])
    return simulated(gx.Scene(film, orbit, gx.orbit.SolarPressure(film, orbit, optics=optics)), n)


def boom_scene(n: dict[str, Any]) -> gx.Simulation:
    boom = gx.Beam(
        MESHES["line"],
        gx.sections.tube(
            n["radius"],
            n["wall"],
            E=1e11,
            nu=0.3,
            density=1560.0,
        ),
        normal=n["normal"],
    )
    tape = gx.Cable(
        MESHES["line"],
        gx.CableLaw(n["EA"], n["mu"]),
        velocity=n["velocity"],
        name="tape",
    )
    hub = gx.RigidBody(
        n["mass"],
        n["inertia"],
        position=n["position"],
        spin=n["spin"],
        comm=ALONE,
    )
    weight = gx.PointMass(n["weight"], (1.0, 0.0, 0.0), comm=ALONE)
    parts = [
        gx.Fixed(
            boom,
            n["group"],
            rotation=True,
            direction=n["direction"],
            twist=n["twist"],
        ),
        gx.Fixed(tape, "start"),
    ]
    parts += [
        gx.connectors.Rope(
            boom.port("end"),
            hub.port(),
            length=n["length"],
            stiffness=n["stiffness"],
            damping=n["damping"],
        )
    ]
    parts += [
        gx.constraints.BallJoint(n["port"] or weight.port(), tape.port("end")),
        gx.loads.Torque(hub.frame(), n["torque"]),
    ]
    return simulated(gx.Scene(*parts), n)


def static_scene(n: dict[str, Any]) -> Any:
    film = gx.Membrane(MESHES["sheet"], gx.Linear(**LAW))
    edge = gx.RigidRegion(film, n["group"], sliding=n["sliding"], fixed_components=n["held"])
    pull = gx.loads.Force(edge.port(), n["force"]), gx.loads.Torque(edge.line, n["torque"])
    held = gx.Fixed(film, "film", components=(2,)), gx.Fixed(film, "left", components=(0, 1))
    search = gx.analysis.Continuation(
        tolerance=n["residual"],
        first_step=n["step"],
        growth_factor=n["growth"],
        cut_factor=n["cut"],
    )
    found = gx.Equilibrium(gx.Scene(edge, *pull, *held), search)
    found.find(at=n["at"])
    found.reaction(held[1], n["about"])
    return found.system


def run_scene(n: dict[str, Any]) -> gx.Simulation:
    film = gx.Membrane(MESHES["sheet"], gx.Linear(**LAW))
    outputs = [
        gx.Ledger(n["ledger"]),
        gx.outputs.Probes(n["probes"], {"a": n["probe"]}, every=n["every"]),
        *n["outputs"],
    ]
    control = gx.StepControl(
        target_iterations=n["iterations"],
        error=n["error"],
        max_factor=n["growth"],
        min_factor=n["cut"],
    )
    run = gx.Simulation(
        gx.Scene(film, gx.RigidMotion(n["spin"], n["velocity"], centre=n["centre"])),
        gx.Midpoint(n["dt"], tolerances=gx.Tolerances(n["relative"], scalars=n["border"])),
        outputs=outputs,
        halvings=n["halvings"],
        control=control,
        events=n["events"],
        checkpoints=gx.Checkpoints(n["saves"], keep=n["keep"]),
    )
    run.run(until=n["until"])
    return run


def simulated(scene: gx.Scene, n: dict[str, Any]) -> gx.Simulation:
    run = gx.Simulation(scene, gx.Midpoint(dt=n["dt"]), halvings=1)
    run.run(until=n["until"])
    return run


def still(X: np.ndarray, t: float = 0.0) -> np.ndarray:
    return 0 * X


ROUND = {"dt": (1e-5, "positive"), "until": (2e-5, "number")}


def scenes(folder: Path) -> dict[str, tuple[Call, dict[str, tuple[Any, str]]]]:
    """By name: what runs it, and its parameters with their kinds; in `folder` are a "file" and a
    "folder.d"."""
    z = (0.0, 0.0, 1.0)
    return {
        "film": (
            film_scene,
            ROUND
            | {name: (value, "positive") for name, value in LAW.items() if name != "nu"}
            | {"nu": (0.3, "number"), "residual": (1e-6, "number"), "damping": (0.1, "positive")}
            | {"velocity": (still, "of points"), "displacement": (still, "of points")}
            | {
                "g": (z, "vector"),
                "pressure": (lambda t: 1.0, "of time"),
                "group": ("left", "group"),
            }
            | {"components": ((0, 1, 2), "components"), "motion": (still, "of points and time")}
            | {"force": (lambda t: (0.0, 0.0, 0.0), "of time"), "load": (z, "vector")},
        ),
        "gas": (
            gas_scene,
            ROUND
            | {name: (value, "positive") for name, value in AIR.items()}
            | {
                "pressure": (100.0, "positive"),
                "temperature": (300.0, "positive"),
                "dead_volume": (1e-3, "number"),
            }
            | {
                "volume": (1e-3, "positive"),
                "valve": (lambda t: 1e-8, "of time"),
                "discharge": (0.8, "positive"),
            }
            | {"outside": (1e3, "number"), "area": (1e-8, "number"), "conductance": (0.1, "number")}
            | {"wall": (300.0, "positive")},
        ),
        "plate": (
            plate_scene,
            ROUND
            | {
                "curvature": (np.diag((1.0, 0.0, 0.0)), "direction"),
                "hinges": ((), "list"),
                "group": ("left", "group"),
            }
            | {
                "direction": ((-1.0, 0.0, 0.0), "direction"),
                "motion": (still, "of points and time"),
            }
            | {"moment": (lambda t: 0.0, "of time")},
        ),
        "crease": (
            crease_scene,
            ROUND
            | {
                "edges": ("crease", "group"),
                "stiffness": (1e-3, "positive"),
                "rest": (0.1, "number"),
            }
            | {"yields": (0.5, "number")},
        ),
        "contact": (
            contact_scene,
            ROUND
            | {
                "distance": (1e-2, "positive"),
                "stiffness": (1e3, "number"),
                "friction": (0.1, "number"),
            }
            | {"point": ((0.0, 0.0, -1.0), "vector"), "normal": (z, "direction")},
        ),
        "orbit": (
            orbit_scene,
            ROUND
            | {
                "a": (7e6, "positive"),
                "e": (0.01, "number"),
                "sun": (z, "direction"),
                "mu": (3.986e14, "positive"),
            }
            | {"reflectivity": (0.8, "number"), "specular": (0.9, "number")},
        ),
        "boom": (
            boom_scene,
            ROUND
            | {"radius": (0.02, "positive"), "wall": (5e-4, "positive"), "normal": (z, "direction")}
            | {"EA": (1e5, "positive"), "mu": (0.1, "positive"), "velocity": (still, "of points")}
            | {
                "mass": (1.0, "positive"),
                "inertia": ((1.0, 1.0, 1.0), "direction"),
                "position": (z, "vector"),
            }
            | {
                "spin": ((0.0, 0.0, 0.0), "vector"),
                "weight": (1.0, "positive"),
                "group": ("start", "group"),
            }
            | {"direction": ((1.0, 0.0, 0.0), "direction"), "twist": (lambda t: 0.0, "of time")}
            | {
                "length": (2.0, "positive"),
                "stiffness": (1.0, "positive"),
                "damping": (0.1, "number"),
            }
            | {"port": (None, "number"), "torque": (lambda t: (0.0, 0.0, 0.0), "of time")},
        ),
        "static": (
            static_scene,
            {"group": ("right", "group"), "sliding": (False, "list"), "held": ((2,), "components")}
            | {
                "force": ((10.0, 0.0, 0.0), "vector"),
                "torque": (lambda t: (0.0, 0.0, 0.0), "of time"),
            }
            | {
                "residual": (1e-8, "positive"),
                "step": (2e-3, "positive"),
                "growth": (1.6, "positive"),
            }
            | {
                "cut": (0.5, "positive"),
                "at": (0.0, "number"),
                "about": ((0.0, 0.0, 0.0), "vector"),
            },
        ),
        "run": (
            run_scene,
            {
                "dt": (1e-4, "positive"),
                "until": (2e-4, "number"),
                "halvings": (3, "count"),
                "keep": (2, "count"),
            }
            | {
                "iterations": (15, "positive"),
                "error": (1e-3, "number"),
                "growth": (1.5, "positive"),
            }
            | {"cut": (0.5, "positive"), "relative": (1e-10, "number"), "border": (1e-12, "number")}
            | {
                "spin": (z, "vector"),
                "velocity": (z, "vector"),
                "centre": (z, "vector"),
                "every": (1, "count"),
            }
            | {
                "ledger": ("ledger.csv", "path"),
                "probes": ("probes.csv", "path"),
                "saves": ("saves", "path"),
            }
            | {
                "probe": (lambda run: 0.0, "of time"),
                "outputs": ((), "list"),
                "events": ((), "list"),
            },
        ),
    }


def generated(folder: Path) -> Iterator[tuple[str, Callable[[], Any]]]:
    """Every bad value of every parameter of every scene: its description, and the act."""
    for scene, (act, parameters) in scenes(folder).items():
        usual = {name: value for name, (value, _) in parameters.items()}
        for name, (_, kind) in parameters.items():
            for bad in BAD[kind]:
                if not _fits(scene, name, bad):
                    yield (
                        f"{scene}: {name} = {bad!r}",
                        lambda act=act, n=usual | {name: bad}: act(n),
                    )


# bad values that some parameters may have after all
MAY: dict[str, set[str]] = {
    "plate curvature": {"{}"},
    "orbit mu": {"None"},
    "boom port": {"[]", "{}", "array([1., 1., 1.])"},
    "run saves": {"'folder.d'"},
    "run outputs": {"5.0"},
}


def _fits(scene: str, name: str, bad: Any) -> bool:
    return repr(bad) in MAY.get(f"{scene} {name}", set())


# ---- by hand -------------------------------------------------------------------------------------


def three_sheets(model: Any) -> None:
    points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1)]
    surface = model.addDiscreteEntity(2)
    model.mesh.addNodes(2, surface, [], np.ravel(points))
    model.mesh.addElementsByType(surface, 2, [], np.ravel([(0, 1, 2), (0, 1, 3), (0, 1, 4)]) + 1)
    seam = model.addDiscreteEntity(1)
    model.mesh.addElementsByType(seam, 1, [], [1, 2])
    model.addPhysicalGroup(1, [seam], name="seam")
    model.addPhysicalGroup(2, [surface], name="film")


def handwritten(folder: Path) -> dict[str, tuple[Callable[[], Any], str]]:
    """By name: the act, and a word that its sentence must have."""
    law = gx.Linear(**LAW)
    air = gx.IdealGas(**AIR)
    z = (0.0, 0.0, 1.0)
    origin = (0.0, 0.0, 0.0)

    def film(**options: Any) -> gx.Membrane:
        return gx.Membrane(MESHES["sheet"], law, **options)

    def plate(**options: Any) -> gx.Plate:
        return gx.Plate(MESHES["sheet"], law, **options)

    def beam(**options: Any) -> gx.Beam:
        return gx.Beam(
            MESHES["line"], gx.sections.tube(0.02, 5e-4, E=1e11, nu=0.3, density=1560.0), **options
        )

    def cable(**options: Any) -> gx.Cable:
        return gx.Cable(MESHES["line"], gx.CableLaw(1e5, 0.1), **options)

    def tank(**options: Any) -> gx.Tank:
        return gx.Tank(1e-3, gas=air, pressure=1e5, temperature=300.0, **options)

    def bag(**options: Any) -> gx.Chamber:
        return gx.Chamber(
            gx.Membrane(MESHES["tube"], law, name="bag"),
            gas=air,
            pressure=1.0,
            temperature=300.0,
            **options,
        )

    def body(**options: Any) -> gx.RigidBody:
        return gx.RigidBody(1.0, (1.0, 1.0, 1.0), comm=ALONE, **options)

    def mass(**options: Any) -> gx.PointMass:
        return gx.PointMass(1.0, comm=ALONE, **options)

    def run(*parts: Any, until: Any = 2e-5, **options: Any) -> gx.Simulation:
        made = gx.Simulation(gx.Scene(*parts), gx.Midpoint(dt=1e-5), **options)
        made.run(until=until)
        return made

    def found(*parts: Any, at: Any = 0.0) -> gx.Equilibrium:
        made = gx.Equilibrium(gx.Scene(*parts))
        made.find(at=at)
        return made

    def saved() -> Path:
        where = folder / "saves"
        if not where.is_dir():
            run(film(), checkpoints=gx.Checkpoints(where))
        return where

    def damaged(change: Callable[[Path], Any]) -> Any:
        import shutil

        where = folder / "damaged"
        shutil.rmtree(where, ignore_errors=True)
        shutil.copytree(saved(), where)
        change(next(iter(sorted(where.glob("step-*"), reverse=True))))
        return run(film(), restart=where)

    def recorded() -> gx.plot.RunReader:
        where = folder / "run"
        if not where.is_dir():
            run(film(), outputs=[gx.Recording(where, every=1)])
        return gx.plot.RunReader(where)

    held = found_film = film()
    good = gx.Fixed(held, "left"), gx.Fixed(held, "right")
    quiet = gx.Equilibrium(gx.Scene(found_film, *good))
    quiet.find()
    A = body()
    B = body(name="other")
    folded = gx.Membrane(MESHES["creased"], law)
    orbit = gx.orbit.Orbit(gx.orbit.Elements(7e6), sun=z)
    cases: dict[str, tuple[Callable[[], Any], str]] = {
        # restarts and files
        "restart from a file": (lambda: run(film(), restart=folder / "file"), "file"),
        "restart from an empty folder": (
            lambda: run(film(), restart=folder / "folder.d"),
            "checkpoint",
        ),
        "restart from nowhere": (lambda: run(film(), restart=folder / "nowhere"), "nowhere"),
        "restart that is a number": (lambda: run(film(), restart=7), "restart"),
        "restart of another film": (
            lambda: run(film(name="sail"), restart=saved()),
            "is of another scene",
        ),
        "restart of another order": (lambda: run(film(order=2), restart=saved()), "checkpoint"),
        "restart with a part more": (
            lambda: run(film(), gx.Pressure(film(), 1.0), restart=saved()),
            ".",
        ),
        "restart with gravity more": (
            lambda: (lambda f: run(f, gx.Gravity(f), restart=saved()))(film()),
            "gravity",
        ),
        "restart back in time": (lambda: run(film(), restart=saved(), until=1e-6), "later"),
        "changes without restart": (lambda: run(film(), changes=["film"]), "restart"),
        "changes of what is not there": (
            lambda: run(film(), restart=saved(), changes=["wing"]),
            "wing",
        ),
        "a checkpoint with an empty file": (
            lambda: damaged(lambda p: (p / "run.json").write_bytes(b"")),
            "run.json",
        ),
        "a checkpoint that is a list": (
            lambda: damaged(lambda p: (p / "run.json").write_text("[]")),
            "run.json",
        ),
        "a checkpoint without values": (
            lambda: damaged(lambda p: (p / "rank-0000.npz").unlink()),
            "rank-0000",
        ),
        "a checkpoint with half its values": (
            lambda: damaged(
                lambda p: (p / "rank-0000.npz").write_bytes(
                    (p / "rank-0000.npz").read_bytes()[:200]
                )
            ),
            "rank-0000",
        ),
        "outputs that are one": (lambda: run(film(), outputs=gx.Ledger(folder / "l.csv")), "list"),
        "a ledger among events": (lambda: run(film(), events=[gx.Ledger(folder / "l.csv")]), "."),
        "a checkpoint among outputs": (
            lambda: run(film(), outputs=[gx.Checkpoints(folder / "c")]),
            "outputs",
        ),
        "a name longer than files have": (
            lambda: run(film(), outputs=[gx.Ledger(folder / ("a" * 300))]),
            "a" * 20,
        ),
        "a folder below a file": (
            lambda: run(film(), outputs=[gx.Ledger(folder / "file" / "l.csv")]),
            "l.csv",
        ),
        "a probe of another film": (
            lambda: run(
                film(),
                outputs=[
                    gx.Series({"x": gx.probes.Position(film(name="b").port("top left"), "x")})
                ],
            ),
            "'b'",
        ),
        "a probe of a fourth axis": (lambda: gx.probes.Position(film().port("top left"), "w"), "w"),
        "a probe that fails": (
            lambda: run(film(), outputs=[gx.Series({"x": raises})]),
            "ZeroDivisionError",
        ),
        "a recording of no field": (
            lambda: run(film(), outputs=[gx.Recording(folder / "r", {"film": ["heat"]})]),
            "heat",
        ),
        "a recording of no body": (
            lambda: run(film(), outputs=[gx.Recording(folder / "q", {"wing": ["state"]})]),
            "wing",
        ),
        "a picture of no time": (
            lambda: gx.plot.field(recorded(), "state", times=[], path=folder / "a.png"),
            "time",
        ),
        "a picture of a late time": (
            lambda: gx.plot.field(recorded(), "state", times=[9.0], path=folder / "a.png"),
            "9",
        ),
        "a picture of an unknown field": (
            lambda: gx.plot.strip(recorded(), "heat", path=folder / "a.png"),
            "heat",
        ),
        "an animation as text": (
            lambda: gx.plot.animate(recorded(), "state", path=folder / "a.txt"),
            ".gif",
        ),
        "an event that calls nothing": (
            lambda: run(film(), events=[gx.At(1e-5, then="stop")]),
            "then",
        ),
        "an event of the past": (lambda: gx.At(-1.0), "time"),
        # statics
        "no body at rest": (lambda: found(tank()), "body"),
        "a time that is a word": (lambda: found(film(), at="1"), "at"),
        "the reaction of a body": (lambda: quiet.reaction(found_film), "support"),
        "the reaction of another support": (
            lambda: quiet.reaction(gx.Fixed(film(), "left")),
            "scene",
        ),
        "the reaction about a word": (lambda: quiet.reaction(good[0], "xyz"), "three numbers"),
        "the force of no joint": (lambda: quiet.joint_force(good[0]), "joint"),
        "half a mode": (lambda: gx.analysis.modes(quiet, 0), "count"),
        "modes below zero": (lambda: gx.analysis.modes(quiet, 1, above=-1.0), "above"),
        "modes of more than there are": (lambda: gx.analysis.modes(quiet, 10**4), "modes"),
        "a sheet that falls": (
            lambda: (lambda f: found(f, gx.Gravity(f)))(film()),
            "No equilibrium",
        ),
        "a field that is not": (
            lambda: gx.fields.field_values(quiet, found_film, field="heat"),
            "heat",
        ),
        "positions of another film": (lambda: gx.fields.positions(quiet, film(name="b")), "b"),
        "a start from other bodies": (
            lambda: run(film(name="b"), gx.StartFrom(quiet.system)),
            "'b'",
        ),
        "a start from another mesh": (
            lambda: run(gx.Membrane(MESHES["tube"], law), gx.StartFrom(quiet.system)),
            "mesh",
        ),
        # gas
        "a tank into itself": (lambda: (lambda t: gx.Orifice(t, t, area=1e-6))(tank()), "orifice"),
        "a vent of a film": (lambda: gx.Orifice(film(), gx.gas.Ambient(1.0), area=1e-6), "chamber"),
        "a vent between surroundings": (
            lambda: run(gx.Orifice(gx.gas.Ambient(1.0), gx.gas.Ambient(2.0), area=1e-6)),
            ".",
        ),
        "a valve that closes below nothing": (
            lambda: run(gx.Orifice(tank(), gx.gas.Ambient(1.0), area=lambda t: -1e-6)),
            "area",
        ),
        "a part of the surface that is not": (lambda: run(bag(surface=("wing",))), "wing"),
        "a ring that is not": (lambda: run(bag(rings=(gx.gas.Ring(film(), "wing"),))), "wing"),
        "a ring of a rim": (lambda: run(bag(rings=(gx.gas.Ring(film(), "left"),))), "."),
        "a chamber and a volume": (
            lambda: gx.Chamber(gas=air, pressure=1.0, temperature=300.0, volume=-1.0),
            "volume",
        ),
        "two chambers in one film": (
            lambda: (
                lambda f: run(
                    *(
                        gx.Chamber(
                            f,
                            gas=air,
                            pressure=1.0,
                            temperature=300.0,
                            dead_volume=1e-3,
                            name=n,
                        )
                        for n in "ab"
                    )
                )
            )(gx.Membrane(MESHES["tube"], law)),
            ".",
        ),
        # plates, creases, contact
        "a plate that wrinkles twice": (lambda: gx.Plate(MESHES["sheet"], law, order=1), "order"),
        "a plate out of plane curved": (
            lambda: plate(rest_curvature=np.diag((0.0, 0.0, 1.0))),
            "symmetric",
        ),
        "a hinge on the rim": (lambda: plate(hinges=("left",)), "left"),
        "a hinge that is not": (lambda: plate(hinges=("middle",)), "middle"),
        "a clamp of a film": (lambda: gx.Fixed(film(), "left", rotation=True), "a Plate"),
        "a moment on a film": (
            lambda: run(gx.loads.EdgeMoment(film(), "left", moment=1.0)),
            "EdgeMoment",
        ),
        "a crease on the rim": (
            lambda: run(gx.connectors.Crease(film(), "left", stiffness=1e-3)),
            "left",
        ),
        "a crease that yields at once": (
            lambda: gx.connectors.Crease(folded, "crease", stiffness=1e-3, yield_angle=-0.1),
            "yield",
        ),
        "contact with nothing": (lambda: gx.Contact(distance=1e-3), "Contact"),
        "contact of a law": (lambda: gx.Contact(law, distance=1e-3), "Contact"),
        "a law of contact that is not": (
            lambda: gx.Contact(film(), distance=1e-3, law="glue"),
            "glue",
        ),
        "a sphere without size": (lambda: gx.contact.Sphere(centre=origin, radius=0.0), "radius"),
        "a film through the floor": (
            lambda: run(
                film(),
                gx.Contact(
                    film(name="b"),
                    gx.contact.Plane(point=(0.5, 0.5, 0.0), normal=(1.0, 0.0, 0.0)),
                    distance=1e-3,
                ),
            ),
            ".",
        ),
        # lines, bodies, joints
        "a joint of a body to itself": (
            lambda: gx.constraints.FixedJoint(A.frame(), A.frame()),
            "itself",
        ),
        "a joint apart": (
            lambda: run(A, B, gx.constraints.BallJoint(A.port((1.0, 0.0, 0.0)), B.port())),
            "apart",
        ),
        "a joint about nothing": (
            lambda: gx.constraints.RevoluteJoint(A.frame(), B.frame(), axis=origin),
            "axis",
        ),
        "a link of no length": (
            lambda: run(A, B, gx.constraints.Link(A.port(), B.port())),
            "length",
        ),
        "a rope of the ground": (
            lambda: gx.connectors.Rope(
                gx.Ground(z),
                gx.Ground(origin),
                length=1.0,
                stiffness=1.0,
            ),
            "ground",
        ),
        "a rope that drives": (
            lambda: gx.connectors.Rope(
                A.port(),
                gx.Ground(z),
                length=1.0,
                stiffness=1.0,
                damping=-1.0,
            ),
            "damping",
        ),
        "a damper between one point and itself": (
            lambda: run(A, B, gx.connectors.Damper(A.port(), B.port(), damping=1.0)),
            "coincide",
        ),
        "a port far away": (lambda: film().port_at((5.0, 0.0, 0.0)), "away"),
        "a port in the plane": (lambda: film().port_at((0.5, 0.5)), "three"),
        "a port of a curve": (lambda: film().port("left"), "one point"),
        "a frame of two points": (lambda: beam().frame("curve"), "curve"),
        "a turned cable": (lambda: gx.Fixed(cable(), "start", direction=z), "Beam"),
        "a beam along its normal": (lambda: beam(normal=(1.0, 0.0, 0.0)), "normal"),
        "a body with an inertia that none has": (
            lambda: gx.RigidBody(1.0, (1.0, 1.0, 3.0)),
            "inertia",
        ),
        "a mirrored body": (lambda: body(attitude=np.diag((1.0, 1.0, -1.0))), "rotation"),
        "a load on three sheets": (
            lambda: gx.loads.EdgeLoad(
                gx.Membrane(gx.gmsh_mesh(three_sheets, ALONE), law), "seam", force=(1.0, 0.0, 0.0)
            ),
            "several sheets meet",
        ),
        "a normal load on three sheets": (
            lambda: gx.loads.EdgeLoad(
                gx.Membrane(gx.gmsh_mesh(three_sheets, ALONE), law), "seam", normal_force=1.0
            ),
            "several sheets meet",
        ),
        # orbit
        "an orbit through the ground": (lambda: gx.orbit.Elements(7e6, 1.5), "e"),
        "an orbit without Sun in sunlight": (
            lambda: (lambda f, o: run(f, o, gx.orbit.SolarPressure(f, o)))(
                film(), gx.orbit.Orbit(gx.orbit.Elements(7e6))
            ),
            "Sun",
        ),
        "two orbits": (
            lambda: run(film(), orbit, gx.orbit.Orbit(gx.orbit.Elements(8e6), name="other")),
            "orbit",
        ),
        "a shadow that is not": (
            lambda: gx.orbit.Orbit(gx.orbit.Elements(7e6), sun=z, shadow="soft"),
            "soft",
        ),
        "an epoch that is none": (
            lambda: gx.orbit.Orbit(gx.orbit.Elements(7e6), epoch="yesterday"),
            "yesterday",
        ),
        "sunlight on a cable": (lambda: gx.orbit.SolarPressure(cable(), orbit), "Cable"),
    }
    return cases
