"""A valid call of every public class and function, from which bad ones are made by changing one
argument."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.creased_strip import creased_strip
from gossamer_fx.meshes.line import line
from gossamer_fx.meshes.sheet import EDGES, sheet
from gossamer_fx.presets.fibres import VECTRAN_HT
from gossamer_fx.presets.films import KAPTON_HN

WORLD = MPI.COMM_WORLD
Call = dict[str, Any]

# Results and errors, which users do not make, and what takes any number of arguments or none.
UNCALLED = {
    "orbit.MagneticDipole",  # needs ERFA
    "orbit.HeatBalance",
    "steppers.EndPoint",
    "analysis.BestSurface",
    "analysis.StressPeak",
    "analysis.Derivative",
    "analysis.RunTape",
    "analysis.EquilibriumFound",
    "analysis.EquilibriumPath",
    "analysis.EquilibriumResult",
    "analysis.ReachedPrestress",
    "analysis.Convergence",
    "analysis.Spread",
    "analysis.Verdict",
    "analysis.Gradient",
    "analysis.Fit",
    "analysis.Optimum",
    "InputError",
    "run.Interrupted",
    "Mesh",
    "analysis.Mode",
    "analysis.HarmonicResponse",
    "analysis.RandomResponse",
    "analysis.StateSpace",
    "NoEquilibrium",
    "OutputFailure",
}
UNCALLED |= {
    "Contact",
    "gas.LinearTable",
    "probes.Crossings",
    "StepFailure",
    "StartFrom",
    "Scene",
    "outputs.Progress",
    "patterns.Gores",
    "patterns.read_dxf",  # needs ezdxf; tests/unit/test_drawings.py
    "patterns.read_surface",  # needs a file; tests/unit/test_pattern_surfaces.py
    "patterns.Deviation",
    "patterns.SeamLine",
    "patterns.Panels",
    "patterns.Strips",
    "patterns.FormSurface",
}


@dataclass(frozen=True)
class Inputs:
    """What some calls read: a recorded run and mode, a mesh file, and an equilibrium with its
    modes."""

    film: gx.Membrane
    equilibrium: gx.Equilibrium
    modes: list[gx.analysis.Mode]
    run: Path
    mesh_file: Path
    mode: Path


def energy_of_a_run(values: dict[str, Any]) -> gx.analysis.Gradient:
    """An energy and its derivative by the modulus of a film, as a run gives it."""
    by_modulus = gx.analysis.Derivative("film.E", "J/Pa", 2e-9 * values["film.E"], None)
    return gx.analysis.Gradient(float((values["film.E"] ** 2).sum()), "J", (by_modulus,))


def make_inputs(folder: Path) -> Inputs:
    """Make them in a folder that is the same on every rank; collective."""
    law = gx.Linear(1e9, 0.3, density=1400.0, thickness=1e-4)
    film = gx.Membrane(sheet(WORLD, 2, 2), law, displacement=lambda X: 1e-3 * X)
    scene = gx.Scene(film, *(gx.Fixed(film, edge) for edge in EDGES))
    equilibrium = gx.Equilibrium(scene)
    equilibrium.find()
    moving = gx.Membrane(sheet(WORLD, 2, 2), law, velocity=lambda X: 0.1 * X)
    run = gx.Simulation(
        gx.Scene(moving),
        gx.Midpoint(dt=1e-3),
        outputs=[gx.Recording(folder / "run", every=1, probes={"clock [s]": lambda run: run.time})],
    )
    run.run(until=3e-3)

    def write(model: Any) -> None:
        import gmsh

        triangle(model)
        gmsh.write(str(folder / "triangle.msh"))

    gx.gmsh_mesh(write, WORLD)
    WORLD.barrier()
    modes = gx.analysis.modes(equilibrium, 1)
    (mode,) = gx.outputs.record_modes(equilibrium, modes, folder / "modes", frames=2)
    return Inputs(film, equilibrium, modes, folder / "run", folder / "triangle.msh", mode)


def triangle(model: Any) -> None:
    """A mesh of few cells."""
    points = [model.geo.addPoint(x, y, 0, 0.5) for x, y in ((0, 0), (1, 0), (0, 1))]
    lines = [model.geo.addLine(points[i], points[(i + 1) % 3]) for i in range(3)]
    model.geo.addPlaneSurface([model.geo.addCurveLoop(lines)])
    model.geo.synchronize()
    model.mesh.generate(2)


def valid_calls(folder: Path, inputs: Inputs) -> dict[str, Call]:
    """Arguments that are taken, by the names of gossamer_fx: those given here, and defaults.

    What is written is in `folder`.
    """
    calls: dict[str, Call] = {}

    def add(name: str, /, **given: Any) -> None:
        parameters = inspect.signature(attrgetter(name)(gx)).parameters.values()
        usual = {one.name: one.default for one in parameters if one.default is not one.empty}
        calls[name] = usual | given

    reader = gx.plot.RunReader(inputs.run)
    tension = gx.analysis.Prestress(1e9, 0.3, density=1400.0, thickness=1e-4, tension=10.0)
    soap = gx.Membrane(sheet(WORLD, 2, 2), tension, name="soap film")
    gas = gx.IdealGas(gamma=1.4, R=287.0)
    mesh = sheet(WORLD, 2, 2)
    curve = line(WORLD, [(0, 0, 0), (1, 0, 0)], 2)
    tube = {"E": 1e11, "nu": 0.3, "density": 1560.0}
    section = gx.sections.tube(0.02, 5e-4, **tube)
    film_law = {"E": 1e9, "nu": 0.3, "density": 1400.0, "thickness": 1e-4}
    fabric = {"E1": 1e9, "E2": 1e8, "nu12": 0.3, "G12": 1e8, "density": 1400.0, "thickness": 1e-4}
    law = gx.Miyazaki(**film_law)
    film = gx.Membrane(mesh, law)
    beam = gx.Beam(curve, section)
    plate = gx.Plate(mesh, gx.Linear(**film_law))
    creased = gx.Membrane(creased_strip(WORLD, 2, 1, 0.1, 0.1), law)
    scene = gx.Scene(film)
    touching = gx.Contact(film, distance=1e-3)
    motion = gx.reduction.Snapshots(film)
    motion.positions.append(np.sin(film.initial_state()[0].reshape(-1, 3) ** 2))
    block = gx.RigidBody(1.0, (1.0, 1.0, 1.0))
    other = gx.RigidBody(1.0, (1.0, 1.0, 1.0), name="other")
    A = block.frame()
    B = other.frame()
    P = gx.PointMass(1.0, (1.0, 0.0, 0.0)).port()
    Q = gx.Ground((0.0, 0.0, 0.0))
    spring = gx.connectors.Spring(P, Q, stiffness=1.0, length=0.9)
    tank = gx.Tank(1e-3, gas=gas, pressure=1e5, temperature=300.0)
    cable_law = {"EA": 1e5, "line_density": 0.1}
    z = (0.0, 0.0, 1.0)
    ends = [(film.port("bottom left"), film.port("bottom right"))]
    hinge = {"a": A, "b": B, "axis": z}
    edges = dict.fromkeys(
        ("EA", "GA2", "GA3", "EI2", "EI3", "GJ", "line_density", "rotary2", "rotary3"), 1.0
    )
    orbit = gx.orbit.Orbit(gx.orbit.Elements(7e6), sun=z)
    add("orbit.Accommodation", normal=0.9, tangential=0.9)
    add("orbit.Air", density=1e-12, molecule=1e-26)
    add("loads.AirDrag", body=film, density=0.1, wind=z)
    add("gas.Ambient", pressure=1.0)
    add("gas.Antoine", A=9.0, B=2000.0)
    blower_curve = gx.gas.LinearTable((0.0, 0.02), (1000.0, 0.0))
    add("gas.Blower", a=gx.gas.Ambient(1e5), b=tank, curve=blower_curve)
    add("gas.FilmArea", body=film)
    heat = {"coefficient": 5.0, "temperature": 280.0}
    add("gas.FilmHeat", chamber=tank, area=gx.gas.FilmArea(film), **heat)
    add("gas.Inflator", b=tank, gas=gas, mass_flow=1e-3, temperature=500.0)
    add("gas.Mixture", fractions={gas: 1.0})
    pipe = {"diameter": 1e-3, "length": 1.0, "friction": 0.02}
    add("gas.Pipe", a=tank, b=gx.gas.Ambient(), **pipe)
    polynomials = ((0.0, 0.0, 3.5, 0.0, 0.0, 0.0, 0.0),)
    ranges = {"temperatures": (200.0, 6000.0), "coefficients": polynomials}
    add("gas.PolynomialGas", R=287.0, **ranges, enthalpy_298=3e5)
    add("gas.PorousFilm", a=tank, b=gx.gas.Ambient(), area=1e-3, viscous=1e3)
    add("gas.Regulator", a=gx.gas.Ambient(1e6), b=tank, area=1e-6, pressure=1e5, droop=1e3)
    add("gas.Sublimation", b=tank, gas=gas, pressure=10.0, temperature=300.0, area=0.01)
    add("gas.Valve", a=tank, b=gx.gas.Ambient(), area=1e-6, opens=1e3)
    add("probes.AxialStrain", line=spring)
    add("probes.Tension", line=spring, which="least")
    add("probes.Length", line=spring)
    add("probes.AngularVelocity", frame=A, axis="x")
    add("probes.AreaFraction", body=film, state="taut")
    add("probes.StateArea", body=film, state="taut", group="film")
    add("probes.SurfaceError", film=film, surface="sphere", quantity="tilt")
    add("probes.LargestStress", film=film, limit=1e6)
    add("analysis.best_surface", state=gx.Equilibrium(scene), film=film, surface="plane")
    add("analysis.largest_stress", state=gx.Equilibrium(scene), film=film, limit=1e6)
    add("analysis.Rate", of=gx.analysis.EnclosedVolume(film))
    add(
        "analysis.point_stiffness",
        equilibrium=inputs.equilibrium,
        port=inputs.film.port_at((0.4, 0.4, 0.0)),
    )
    add("At", time=0.1)
    add("connectors.AttachedMass", port=film.port("bottom left"), mass=1.0)
    add("probes.Attitude", orbit=orbit, of=film, axis="along")
    add("control.AttitudeControl", frame=A, target=z, stiffness=1.0, damping=1.0, period=0.1)
    add("control.BodyTorque", frame=A)
    add("control.Thruster", frame=A, direction=z)
    wheel = gx.control.ReactionWheel(A, z, inertia=1.0)
    add("control.ReactionWheel", frame=A, axis=z, inertia=1.0)
    add(
        "control.Feedback",
        measures=[lambda run: 0.0],
        law=lambda t, values: values,
        actuators=[wheel],
        period=0.1,
    )
    add("connectors.AxialSpring", port=P, stiffness=1.0, direction=z, origin=z)
    add("constraints.BallJoint", a=P, b=gx.Ground((1.0, 0.0, 0.0)))
    add("Beam", mesh=curve, section=section)
    add("contact.Box", centre=z, sizes=(1.0, 1.0, 1.0), name="box")
    add("Cable", mesh=curve, law=gx.CableLaw(**cable_law))
    add("CableLaw", **cable_law)
    add("analysis.StaticCase", equilibrium=gx.Equilibrium(scene))
    add("Case", scene=scene, stepper=gx.Midpoint(dt=0.1), until=1.0, frames=10)
    add("loads.Centrifugal", body=film, spin=z, centre=z)
    add("Chamber", gas=gas, pressure=1e5, temperature=300.0, volume=1.0)
    add("Checkpoints", folder=folder / "checkpoints", minutes=10.0)
    add("probes.ContactForce", contact=touching, body=film, axis="x")
    add("probes.ContactGap", contact=touching)
    add("probes.ContactArea", contact=touching, body=film)
    add("probes.ContactPressure", contact=touching, body=film)
    add("analysis.Continuation")
    add(
        "connectors.Crease",
        body=creased,
        edges="crease",
        stiffness=1e-3,
        rest_angle=1.0,
        yield_angle=0.5,
    )
    add("contact.Cone", start=z, end=(1.0, 0.0, 0.0), radii=(0.0, 0.1))
    add("contact.Cylinder", start=z, end=(1.0, 0.0, 0.0), radius=0.1)
    add("probes.FoldAngle", crease=gx.connectors.Crease(creased, "crease", stiffness=1e-3))
    add("connectors.Damper", a=P, b=Q, damping=1.0)
    add("Damping", body=film, mass_factor=1.0, loss_factor=0.01, frequency=1e3, tension_only=True)
    add("probes.Displacement", port=P, axis="x")
    add(
        "orbit.Drag",
        body=film,
        orbit=orbit,
        atmosphere=gx.orbit.ExponentialAtmosphere(1e-12, 4e5, scale_height=6e4),
        rotation=1e-5,
    )
    add(
        "constraints.Driven",
        body=block,
        axis=z,
        angle=lambda t: t,
        displacement=lambda t: (t, 0.0, 0.0),
    )
    add("analysis.EnclosedVolume", film=film)
    add("analysis.ChamberPressure", chamber=tank)
    add("analysis.CrossingTime", of=gx.analysis.EnclosedVolume(film), value=1e-3)
    add("analysis.Energy")
    add(
        "analysis.TravellingWaves",
        forward=1.0,
        backward=0.0,
        forward_frequency=2.0,
        backward_frequency=0.0,
    )
    add(
        "analysis.travelling_waves",
        time=np.arange(20.0),
        cosine=np.cos(np.arange(20.0)),
        sine=np.sin(np.arange(20.0)),
    )
    add("analysis.Frequency", equilibrium=inputs.equilibrium, number=1)
    add(
        "analysis.PointStiffness",
        equilibrium=inputs.equilibrium,
        port=inputs.film.port_at((0.5, 0.5, 0.0)),
        direction=(0.0, 0.0, 1.0),
    )
    add("analysis.SmoothStress", film=film, exponent=20.0, limit=1e6, group="film")
    add("analysis.Limit", of=gx.analysis.Energy(), low=0.0, high=1.0)
    add("analysis.Functional", value=lambda run: 0.0, derivative=lambda run: {}, unit="m")
    add("analysis.Integral", body=film, form=lambda q: q[2] * film.dx, unit="m³")
    add("analysis.EdgeCable", body=film, edges="left", force=1.0)
    add("loads.EdgeLoad", body=film, edges="left", force=z)
    add("loads.EdgeMoment", body=plate, edges="left", moment=1.0)
    add(
        "materials.Fabric",
        warp=([0.0, 0.01, 0.03], [0.0, 2e3, 20e3]),
        weft=([0.0, 0.03], [0.0, 3e3]),
        shear=([0.0, 0.1], [0.0, 500.0]),
        density=800.0,
        thickness=3e-4,
        direction=(1.0, 0.0, 0.0),
    )
    add("materials.MooneyRivlin", C1=1e5, C2=1e4, density=950.0, thickness=1e-3)
    add("materials.NeoHooke", shear_modulus=1e5, density=950.0, thickness=1e-3)
    add("Elastica", **film_law, half_wavelength=0.01)
    add("orbit.Elements", a=7e6)
    add("orbit.elements_of", r=(7e6, 0.0, 0.0), v=(0.0, 7.5e3, 0.0), mu=4e14)
    add("Equilibrium", scene=scene)
    add("orbit.ExponentialAtmosphere", density=1.0, altitude=1.0, scale_height=1.0)
    add("Fixed", body=beam, group="start", direction=(1.0, 0.0, 0.0), motion=lambda x, t: 0 * x)
    add("constraints.FixedJoint", a=A, b=B)
    add("loads.Force", port=P, force=z)
    add("Frame", origin=Q, directors=(Q, Q, Q))
    add("probes.GasFlow", opening=gx.Orifice(tank, gx.gas.Ambient(), area=1e-6))
    add("probes.GasState", chamber=tank, quantity="pressure")
    add("GeneralizedAlpha", dt=1e-3)
    add("Gravity", body=film, g=z)
    add("Ground", vector=z)
    add("IdealGas", gamma=1.4, R=287.0)
    add("probes.JointForce", joint=gx.constraints.BallJoint(P, Q), axis="x")
    add("Ledger", path=folder / "ledger.csv")
    add("Linear", **film_law)
    add("constraints.Link", a=P, b=Q)
    add("probes.MeanSpin", body=film)
    add("probes.AngularMomentum", axis="z", frame=gx.ground_frame())
    add("probes.Nutation", frame=gx.ground_frame())
    add("probes.Imbalance", ports=[P, P], frame=gx.ground_frame())
    add("probes.Waves", ports=[P, P, P, P], frame=gx.ground_frame(), number=1)
    add("Membrane", mesh=mesh, law=law)
    add("LinearOrthotropic", **fabric, direction=(1.0, 0.0, 0.0))
    add("materials.AroundAxis", axis=(0.0, 0.0, 1.0))
    add("Midpoint", dt=1e-3, rule=gx.steppers.PathAverage(), tolerances=gx.Tolerances())
    add("probes.LoadResultant", about=orbit, load="drag", action="force", axis="x")
    add("Miyazaki", **film_law)
    add("Orthotropic", **fabric, direction=(1.0, 0.0, 0.0))
    add("Orifice", a=tank, b=gx.gas.Ambient(), area=1e-6)
    add("orbit.Optics")
    add("orbit.Sunlight", body=film, direction=z, groups={"film": gx.orbit.Optics()})
    add("orbit.Orbit", start=gx.orbit.Elements(7e6), sun=z, mu=1e14, radius=3e6)
    add("probes.OrbitState", orbit=orbit, quantity="a")
    add("steppers.PathAverage")
    add("steppers.VariationalMidpoint", dt=1e-3)
    add("probes.Penetrations", contact=touching)
    add("plot.Picture", path=folder / "a.png", times=(0.1,))
    add("gas.Piston", port=P, area=1.0, direction=z)
    add("Plate", mesh=mesh, law=law)
    add("contact.Plane", point=z, normal=z, friction=0.1)
    add("PointMass", mass=1.0, position=z, velocity=z)
    add("probes.PolarPosition", port=P, frame=B)
    add("Port", body=film, nodes=(0,))
    add("probes.Position", port=P, axis="x")
    add("Pressure", body=film, pressure=1.0)
    water = gx.loads.UniformFluid(1000.0)
    add("loads.FluidPressure", body=film, fluid=water, side="inside")
    add("loads.UniformFluid", density=1000.0)
    add("loads.StandardAtmosphere", altitude=1000.0)
    add("analysis.Prestress", **film_law, tension=10.0)
    add("constraints.PrismaticJoint", **hinge)
    add("constraints.CylindricalJoint", **hinge)
    add("constraints.UniversalJoint", a=A, b=B, axis_a=z, axis_b=(1.0, 0.0, 0.0))
    add("constraints.Latch", joint=gx.constraints.RevoluteJoint(A, B, axis=z), angle=0.1)
    add("constraints.HoldDown", joint=gx.constraints.RevoluteJoint(A, B, axis=z))
    add("connectors.TorsionStop", **hinge, stiffness=1.0, limits=(-0.1, 0.1))
    table = {"angle": [-1.0, 0.0, 1.0], "moment": [-1.0, 0.0, 1.0]}
    add("connectors.TabulatedTorsion", **hinge, **table, rest_angle=0.1)
    add("outputs.Probes", path=folder / "a.csv", probes={"a": lambda run: 0.0}, times=(0.1,))
    add("Recording", folder=folder / "run", fields={}, times=(0.1,))
    add("constraints.RevoluteJoint", **hinge)
    add("RigidBody", mass=1.0, inertia=(1.0, 1.0, 1.0), position=z, velocity=z, spin=z)
    add("RigidRegion", body=film, group="left", rigid_body=None)
    add("RigidMotion", spin=z, velocity=z, centre=z)
    add("probes.Reaction", of=gx.Fixed(film, "left"), axis="x")
    add("probes.RingArea", ring=gx.gas.Ring(film, "left"))
    add("gas.Ring", body=film, edges="left")
    add("connectors.Rope", a=P, b=Q, length=1.0, stiffness=1.0)
    add("connectors.RopeBundle", ends=[(P, Q)], lengths=[1.0], stiffness=1.0)
    add("sections.Section", **edges)
    add("Series", probes={"a": lambda run: 0.0})
    add("Simulation", scene=scene, stepper=gx.Midpoint(dt=0.1), outputs=[])
    add("materials.ThermalExpansion", alpha=2e-5, temperature=310.0)
    add("orbit.ThermalProperties", heat_capacity=10.0, absorptivity=0.2, emissivity=(0.1, 0.5))
    add(
        "orbit.SolarHeating",
        film=film,
        orbit=orbit,
        properties=gx.orbit.ThermalProperties(10.0, absorptivity=0.2, emissivity=0.5),
        initial_temperature=300.0,
    )
    add("orbit.SolarPressure", body=film, orbit=orbit)
    add("contact.Sphere", centre=z, radius=0.1)
    add("connectors.Spring", a=P, b=Q, stiffness=1.0, length=1.0)
    add("StepControl", error=1e-3, min_step=1e-9, max_step=1.0)
    add("connectors.Stop", a=P, b=Q, length=1.0, stiffness=1.0)
    add("probes.SunAngle", orbit=orbit, of=film)
    add("orbit.Surface", area=1.0, normal=z, centre=z)
    add("Tank", volume=1e-3, gas=gas, pressure=1e5, temperature=300.0)
    add("connectors.Tape", body=film, law=gx.CableLaw(**cable_law), bars=ends, lengths=[1.0])
    add("connectors.Tether", a=P, b=Q, length=1.0, stiffness=1.0, brake_force=0.1, total_length=2.0)
    add("TensionField", **film_law)
    add("Seam", a=film, edge_a="left", b=film, edge_b="right")
    square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
    add("patterns.height_surface", z=lambda x, y: x * y, outline=square, size=0.5)
    add("patterns.surface", source=film)
    add("patterns.gores", profile=[[0.0, 0.0], [1.0, 0.5], [0.0, 1.0]], n=4)
    add("TabulatedCable", strain=[0.0, 0.1], force=[0.0, 50.0], line_density=0.1)
    add("TensionOnly", **cable_law)
    add("Tie", a=film, group_a="left", b=plate, group_b="left")
    add("Tolerances")
    add("loads.Torque", frame=A, torque=z)
    woven = gx.Membrane(mesh, gx.LinearOrthotropic(**fabric, direction=(1.0, 0.0, 0.0)))
    add("loads.InternalFriction", body=woven, strain=z, stiffness=(1e3,), limit=(5.0,))
    add("loads.Viscoelasticity", body=beam, ratios=(0.5, 0.2), times=(1.0, 60.0))
    add("loads.flat_damping", body=film, loss_factor=0.01, band=(1.0, 1e3), tension_only=True)
    add("connectors.TorsionDamper", **hinge, damping=1.0)
    add("connectors.TorsionSpring", **hinge, stiffness=1.0)
    add("outputs.VTU", path=folder / "a.pvd", times=(0.1,))
    add("plot.Limits", low=0.0, high=1.0, part="film", each_time=False, log=False)
    add("plot.View", azimuth=0.5, elevation=0.3, follow=True)
    add("probes.Velocity", port=P, axis="x")
    add("gas.WallHeat", chamber=tank, conductance=1.0, temperature=300.0)
    add("When", probe=lambda run: 0.0, tolerance=1e-9)
    add("fields.field_values", state=gx.Equilibrium(scene), body=film, field="stress1")
    add("fields.line_values", state=gx.Equilibrium(gx.Scene(spring)), line=spring)
    add(
        "fields.LineValues",
        points=np.zeros((1, 3)),
        tension=np.zeros(1),
        strain=np.zeros(1),
        length=np.ones(1),
    )
    add("fields.positions", state=gx.Equilibrium(scene), body=film)
    add(
        "analysis.find_form",
        body=soap,
        scene=lambda: gx.Scene(*(gx.Fixed(soap, edge) for edge in EDGES)),
        change=1e-3,
        updates=20,
    )
    add("fold.Ikaros", n=4, inner=5, outer=9, pitch=0.3, gap=1e-3, hub_gap=1e-4)
    add("fold.Miura", a=0.1, b=0.1, gamma=1.0, theta=0.5, opening=1e-4, lift=1e-5)
    add("fold.Roll", length=1.0, bends=99, radius=0.03, flat=0.1, width=0.1, opening=1e-4)
    add("fold.Stow", film=film, spacing=1e-2, layers=1, up=z, gravity=9.81)
    add("fold.Star", n=8, side=0.04, columns=2, reach=20, gap=1e-4)
    add(
        "fold.TubeZigzag",
        length=0.25,
        diameter=0.03,
        cells=4,
        panels=2,
        stub=0.045,
        angle=1.4,
        opening=1e-3,
        lift=1e-4,
        shortening=0.85,
    )
    add(
        "fold.Zigzag",
        length=1.0,
        panels=5,
        width=0.1,
        opening=1e-3,
        lift=1e-4,
        bends=3,
        spacing=1e-2,
    )
    add("gmsh_mesh", build=triangle, comm=WORLD)
    add("ground_frame", point=z)
    add("run.latest_checkpoint", folder=folder)
    add("run.log_to", comm=WORLD, file=folder / "log.txt")
    add(
        "analysis.gradient",
        source=inputs.equilibrium,
        of=gx.analysis.Energy(),
        by=[f"{inputs.film.name}.E"],
    )
    add(
        "analysis.fit",
        equilibrium=inputs.equilibrium,
        of=[gx.analysis.Energy()],
        measured=[1.0],
        by=[f"{inputs.film.name}.E"],
        uncertainty=0.1,
        bounds={f"{inputs.film.name}.E": (1e8, 3e9)},
        iterations=2,
        tolerance=0.1,
    )
    add(
        "analysis.fit_runs",
        evaluate=lambda values: [energy_of_a_run(values)],
        start={"film.E": 1e9},
        measured=[1e18],
        uncertainty=1e17,
        bounds={"film.E": (0.5e9, 3e9)},
        iterations=2,
        tolerance=0.1,
    )
    add(
        "analysis.minimise",
        equilibrium=inputs.equilibrium,
        of=gx.analysis.Energy(),
        by=[f"{inputs.film.name}.E"],
        bounds={f"{inputs.film.name}.E": (1e9, 3e9)},
        limits=[gx.analysis.Limit(gx.analysis.Energy(), high=1e9)],
        iterations=1,
        tolerance=0.1,
    )
    add(
        "analysis.minimise_runs",
        evaluate=energy_of_a_run,
        start={"film.E": 1e9},
        bounds={"film.E": (0.5e9, 3e9)},
        method="L-BFGS-B",
        iterations=1,
        tolerance=0.1,
    )
    add("analysis.modes", equilibrium=inputs.equilibrium, count=1)
    vibration: Call = {
        "equilibrium": inputs.equilibrium,
        "modes": inputs.modes,
        "of": {"energy": gx.analysis.Energy()},
        "loads": [gx.Gravity(inputs.film, (0.0, 0.0, 1.0))],
        "base_acceleration": (0.0, 0.0, 0.0),
        "loss_factor": 0.01,
        "damping_ratio": 0.01,
    }
    add("analysis.harmonic_response", **vibration, frequencies=[1.0, 2.0])
    add("analysis.random_response", **vibration, density=1e-3, band=(1.0, 2.0))
    add(
        "analysis.state_space",
        **vibration
        | {
            "loads": {"weight": [gx.Gravity(inputs.film, (0.0, 0.0, 1.0))]},
            "base_acceleration": {},
        },
    )
    add("analysis.imperfect_mesh", body=inputs.film, mode=inputs.modes[0], amplitude=1e-3)
    add("analysis.equilibria", equilibrium=gx.Equilibrium(scene), starts=2, perturbation=0.01)
    add(
        "analysis.path",
        equilibrium=inputs.equilibrium,
        until=1.1,
        by="",
        start=1.0,
        first_step=0.1,
        max_steps=2,
        probes={"energy": gx.analysis.Energy()},
        branch="energy",
        outputs=[gx.Series({"energy": gx.analysis.Energy()})],
        resume=False,
        tolerance=1e-2,
    )
    add("control.patch", centre=P, points=[P, P, P])
    add("reduction.Snapshots", body=film)
    add(
        "analysis.convergence",
        quantity=lambda n: 1.0 + 1.0 / n,
        meshes=[2, 4, 8],
        sizes=[0.5, 0.25, 0.125],
        exact=1.0,
    )
    add(
        "outputs.record",
        equilibrium=inputs.equilibrium,
        outputs=[gx.Ledger(folder / "static.csv")],
        at=[0.0],
    )
    add(
        "outputs.record_modes",
        equilibrium=inputs.equilibrium,
        modes=inputs.modes,
        folder=folder / "hostile modes",
        amplitude=0.1,
        frames=2,
        overwrite=True,
    )
    add("plot.modes", folders=[inputs.mode], path=folder / "modes.png", view=None)
    add(
        "analysis.ModeShapes",
        body=inputs.film,
        equilibrium=inputs.equilibrium,
        modes=inputs.modes,
        height=0.1,
    )
    add("reduction.OutsideBasis", body=gx.reduction.reduce(film, [motion], modes=1))
    add("reduction.reduce", body=film, motions=[motion], modes=1)
    # Runs of no time: a spread is refused before any of them.
    add(
        "analysis.spread",
        case=lambda comm, **values: {"y": 1.0},
        vary={"cells": [4, 6], "nudge": [0.0, 1e-9]},
        chance=["nudge"],
        quantities=["y"],
        scales={"y": 1.0},
        limit=0.1,
        comm=WORLD,
        folder=folder / "spread",
    )
    add("sweep.Factorial", outcome=lambda comm, folder, **values: {"y": 1.0}, over={"a": [1, 2]})
    add(
        "sweep.run_factorial",
        sweep=gx.sweep.Factorial(lambda comm, folder, **values: {"y": 1.0}, {"a": [1, 2]}),
        comm=MPI.COMM_SELF,
        folder=folder / f"sweep {WORLD.rank}",
    )
    add("plot.Watch", folder=inputs.run, port=0, must_exist=True, height=500)
    # Files are exported by one process; here each rank has a folder.
    add("plot.export", run=reader, folder=folder / f"vtu {WORLD.rank}")
    add("plot.RunReader", folder=inputs.run)
    add(
        "plot.animate",
        run=reader,
        field="state",
        path=folder / "a.gif",
        seconds=0.1,
        until=1.0,
        pixels=400,
    )
    add("plot.curves", run=reader, path=folder / "a.png")
    add("plot.field", run=reader, field="state", times=(0.0,), path=folder / "a.png")
    add("plot.strip", run=reader, field="state", path=folder / "a.png")
    add("read_mesh", path=inputs.mesh_file, comm=WORLD)
    add("sections.rectangle", width2=0.1, width3=0.1, **tube)
    add("sections.solid_circle", radius=0.1, **tube)
    add("sections.tube", outer_radius=0.02, wall_thickness=5e-4, **tube)
    add("write_report", run=reader, path=folder / "a.html")
    return calls


def method_calls(inputs: Inputs) -> dict[str, tuple[Callable[..., Any], Call]]:
    """Methods that users call, by a name for messages, and arguments that are taken."""
    film = inputs.film
    mesh = sheet(WORLD, 2, 2)
    zigzag = gx.fold.Zigzag(1.0, 2)
    marked = gx.Membrane(zigzag.mark(mesh), film.law)
    stow = gx.fold.Stow(film, spacing=1e-2)
    gores = gx.patterns.gores([[0.0, 1.0], [0.5, 0.5], [1.0, 0.0]], 6)
    sewn = gx.Membrane(gores.mesh(WORLD, along=4, across=2), film.law)
    form = gx.patterns.surface(film)
    strips = form.cut(form.by_planes([[0.3, 0.0, 0.0]], (1.0, 0.0, 0.0)))
    panels = strips.flatten(film.law)
    patches = panels.films(size=0.5)
    patchwork = gx.Equilibrium(gx.Scene(*patches))
    body = gx.RigidBody(1.0, (1.0, 1.0, 1.0))
    section = gx.sections.tube(0.02, 5e-4, E=1e11, nu=0.3, density=1560.0)
    beam = gx.Beam(line(WORLD, [(0, 0, 0), (1, 0, 0)], 2), section)
    cable = gx.TabulatedCable([0.0, 0.1], [0.0, 50.0], line_density=0.1)
    elements = gx.orbit.Elements(7e6)
    support = next(item for item in inputs.equilibrium.scene.items if isinstance(item, gx.Fixed))
    derivative = gx.analysis.gradient(
        inputs.equilibrium, of=gx.analysis.Energy(), by=[f"{film.name}.E"]
    ).derivatives[0]
    point = (0.5, 0.5, 0.0)
    origin = (0.0, 0.0, 0.0)
    stiffnesses = gx.LinearOrthotropic.from_stiffnesses
    per_width = {"A11": 1e5, "A12": 3e4, "A22": 1e5, "A66": 3e4, "direction": (1.0, 0.0, 0.0)}
    return {
        "film.nodes": (film.nodes, {"group": "left"}),
        "film.port": (film.port, {"group": "top left"}),
        "film.port_at": (film.port_at, {"point": point, "snap": False}),
        "body.port": (body.port, {"point": point}),
        "body.port_at": (body.port_at, {"place": point}),
        "body.frame": (body.frame, {"point": point}),
        "body.frame_at": (body.frame_at, {"place": point}),
        "beam.frame": (beam.frame, {"group": "start"}),
        "cable.force_at": (cable.force_at, {"strain": np.array([0.05])}),
        "law.from_stiffnesses": (stiffnesses, {"thickness": 1e-4, "density": 1.0} | per_width),
        "film preset.law": (KAPTON_HN.law, {"thickness": 1e-5, "residual_stiffness": 0.0}),
        "fibre preset.law": (VECTRAN_HT.law, {"linear_density": 1e-4}),
        "fold.mark": (zigzag.mark, {"mesh": mesh}),
        "fold.start": (zigzag.start, {"film": film, "origin": origin, "turn": origin}),
        "fold.creases": (zigzag.creases, {"film": marked, "stiffness": 1.0}),
        "gores.mesh": (gores.mesh, {"comm": WORLD, "along": 2, "across": 2}),
        "gores.placed": (gores.placed, {"X": np.zeros((3, 2)), "apart": 0.1}),
        "gores.seams": (gores.seams, {"film": sewn}),
        "form.closest": (form.closest, {"points": np.zeros((1, 3))}),
        "form.by_planes": (form.by_planes, {"points": [[0.5, 0.5, 0.0]], "normal": (1, 0, 0)}),
        "stow.evacuate": (stow.evacuate, {"suction": 10.0}),
        "stow.fold": (stow.fold, {"point": (0.5, 0.0, 0.0), "towards": (1.0, 0.0, 0.0)}),
        "stow.pack": (stow.pack, {"sizes": (1.0, 1.0, 0.1)}),
        "form.geodesics": (
            form.geodesics,
            {"starts": [[0.2, 0.0, 0.0]], "ends": [[0.3, 1.0, 0.0]]},
        ),
        "form.along": (form.along, {"points": [[0.2, 0.0, 0.0], [0.3, 1.0, 0.0]]}),
        "form.cut": (form.cut, {"lines": form.by_planes([[0.5, 0, 0]], (1, 0, 0))}),
        "strips.flatten": (strips.flatten, {"law": film.law, "tension": 10.0}),
        "panels.films": (panels.films, {"size": 0.5}),
        "panels.write_svg": (panels.write_svg, {"path": inputs.run / "a.svg", "marks": 0.1}),
        "panels.seams": (panels.seams, {"films": patches}),
        "panels.cables": (panels.cables, {"films": patches}),
        "panels.deviation": (panels.deviation, {"films": patches, "at": patchwork}),
        "elements.after": (elements.after, {"t": 1.0, "mu": 1e14}),
        "elements.period": (elements.period, {"mu": 1e14}),
        "elements.state": (elements.state, {"mu": 1e14}),
        "equilibrium.find": (inputs.equilibrium.find, {"at": 0.0}),
        "equilibrium.reaction": (
            inputs.equilibrium.reaction,
            {"support": support, "about": origin},
        ),
        "derivative.along": (derivative.along, {"change": 1.0}),
    }


def spoiled(call: Call) -> Iterator[tuple[str, Any]]:
    """Arguments and values that no call of this project accepts instead of them."""
    for argument, value in call.items():
        if argument in ("build", "scene") and callable(value):
            continue
        if isinstance(value, bool):
            bad: list[Any] = ["x"]
        elif isinstance(value, int | float):
            bad = [math.nan, "x", (1.0, 2.0, 3.0, 4.0), object()]
        elif isinstance(value, tuple) and len(value) == 3 and isinstance(value[0], float):
            bad = [(math.nan, 0.0, 0.0), (0.0, math.inf, 0.0), (0.0, 0.0), "xyz", 7.0, object()]
        elif value is None:
            bad = [object()]
        elif isinstance(value, Path):
            bad = [3.7, object(), "a\0b", "\ud800"]
        else:
            bad = [3.7, object()]
        yield from ((argument, one) for one in bad)
