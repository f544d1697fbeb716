"""Arguments that do not fit each other, the mesh or the files of a run: each is refused in one
sentence, on any number of ranks.

Values of another kind, sign or size than an argument has are generated in test_bad_input.py.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.meshes.creased_strip import creased_strip
from gossamer_fx.meshes.sheet import sheet
from gossamer_fx.meshes.sphere import sphere
from gossamer_fx.meshes.tube import flat_tube
from tests.sentences import assert_sentence
from tests.small_scenes import (
    AIR,
    LINEAR,
    MATERIAL,
    beam,
    body,
    cable,
    film,
    plate,
    tank,
    three_sheets,
)

WORLD = MPI.COMM_WORLD
OUTSIDE = gx.gas.Ambient(1.0)
RUBBER = gx.materials.NeoHooke(4e5, density=950.0, thickness=1e-3)
ORIGIN = (0.0, 0.0, 0.0)
Z = (0.0, 0.0, 1.0)
# Longest sentence [characters]: it lists the fields, or the arguments that are known.
LONGEST = 700
Case = tuple[Callable[[], object], str]


def tube(**options: Any) -> gx.Membrane:
    return gx.Membrane(flat_tube(WORLD, 0.2, 0.06, 2), LINEAR, **options)


def creased() -> gx.Membrane:
    return gx.Membrane(creased_strip(WORLD, 2, 1, 0.1, 0.1), LINEAR)


def chamber(*films: Any, **options: Any) -> gx.Chamber:
    return gx.Chamber(*films, gas=AIR, pressure=1.0, temperature=300.0, **options)


def control(**options: Any) -> gx.control.AttitudeControl:
    gains = {"stiffness": 1.0, "damping": 1.0}
    return gx.control.AttitudeControl(body().frame(), ORIGIN, **gains, **options)


def compiled(*parts: Any) -> Any:
    return gx.Scene(*parts).compile()


def run(*parts: Any, until: Any = 2e-5, **options: Any) -> gx.Simulation:
    made = gx.Simulation(gx.Scene(*parts), gx.Midpoint(dt=1e-5), **options)
    made.run(until=until)
    return made


def found(*parts: Any, at: Any = 0.0) -> gx.Equilibrium:
    made = gx.Equilibrium(gx.Scene(*parts))
    made.find(at=at)
    return made


def supported(sail: gx.Membrane) -> gx.Equilibrium:
    """The equilibrium of a film that two edges support."""
    return found(sail, gx.Fixed(sail, "left"), gx.Fixed(sail, "right"))


def reaction_about(point: Any) -> Any:
    sail = film()
    support = gx.Fixed(sail, "left")
    return found(sail, support).reaction(support, point)


def loaded(load: Callable[[gx.Membrane], Any]) -> gx.Simulation:
    """A run of a film and a load on it."""
    sail = film()
    return run(sail, load(sail))


def not_a_number(x: np.ndarray) -> np.ndarray:
    """Finite but for the points with x > 0.9: on two ranks perhaps on one of them only."""
    return np.where(x[0] > 0.9, np.nan, 0.0 * x)


def flipped_pillow(reverse: bool) -> gx.Membrane:
    """Two sheets on one curve loop; as gmsh makes them, both normals point up."""

    def build(model: Any) -> None:
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

    return gx.Membrane(gx.gmsh_mesh(build, WORLD), LINEAR)


def quadrilaterals(model: Any) -> None:
    model.occ.addRectangle(0, 0, 0, 1, 1)
    model.occ.synchronize()
    model.mesh.generate(2)
    model.mesh.recombine()


def filled(model: Any) -> None:
    model.occ.addBox(0, 0, 0, 1, 1, 1)
    model.occ.synchronize()
    model.mesh.generate(3)


def branched() -> gx.Membrane:
    return gx.Membrane(three_sheets(), LINEAR)


MESHES: list[Case] = [
    (lambda: gx.read_mesh("nowhere/pillow.msh", WORLD), "nowhere/pillow.msh"),
    (lambda: gx.gmsh_mesh(quadrilaterals, WORLD), "Quadrilateral"),
    (lambda: gx.gmsh_mesh(lambda model: None, WORLD), "no triangles"),
    (lambda: gx.gmsh_mesh(filled, WORLD), "fills a volume"),
    (lambda: gx.Membrane(sphere(WORLD, 1.0, 8, order=2), LINEAR), "order"),
    (lambda: film(order=3), "order"),
    (lambda: gx.Fixed(film(), "rim"), "rim"),
    (lambda: gx.Fixed(film(), "left\nright"), "left\\nright"),
    (lambda: compiled(gx.Fixed(film(), "left ")), "'left '"),
    (lambda: film().port_at((5.0, 0.0, 0.0)), "away"),
    (lambda: film().port_at((0.5, 0.5)), "three"),
    (lambda: film().port("left"), "one point"),
    (lambda: beam().frame("curve"), "curve"),
    (lambda: gx.Port(gx.PointMass(1.0), (7,)), "its nodes are 0 to 0"),
    (lambda: gx.Port(gx.PointMass(1.0), (-1,)), "its nodes are 0 to 0"),
    (lambda: gx.Port(gx.PointMass(1.0), (0,), vectors=(1,)), "for each node, 0 to 0"),
    (lambda: gx.Port(gx.PointMass(1.0), (0,), vectors=(-1,)), "for each node, 0 to 0"),
    (lambda: gx.Port(gx.PointMass(1.0), (0,), vectors=(0, 0)), "for each node, 0 to 0"),
]

PICTURES: list[Case] = [
    (lambda: gx.plot.Picture("a.png", colour="thickness"), "give 'state' or 'group'"),
]

LAWS: list[Case] = [
    (lambda: gx.Miyazaki(**MATERIAL | {"nu": 0.51}), "nu"),
    (lambda: gx.Miyazaki(**MATERIAL, residual_stiffness=2.0), "residual"),
    (lambda: gx.TensionField(**MATERIAL, residual_stiffness=1e-3), "TensionField"),
    (lambda: gx.Elastica(**MATERIAL, half_wavelength=1e-4), "half_wavelength"),
    (lambda: gx.IdealGas(gamma=1.0, R=287.0), "gamma"),
    (lambda: gx.PointMass(1e300), "a size between 1e-100 and"),
    (lambda: gx.PointMass(10**400), "a size between 1e-100 and"),
    (lambda: gx.RigidBody(1.0, (1.0, 1.0, 3.0)), "inertia"),
    (lambda: body(attitude=np.diag((1.0, 1.0, -1.0))), "rotation"),
    (lambda: gx.Tolerances(relative=3.7), "below 1"),
    (lambda: gx.Tolerances(scalars=1.0), "below 1"),
    (lambda: gx.analysis.Continuation(tolerance=3.7), "below 1"),
    (lambda: gx.analysis.Continuation(inner_tolerance=1.0), "below 1"),
]

STATES: list[Case] = [
    (lambda: compiled(film(displacement=not_a_number)), "displacement"),
    (lambda: compiled(film(velocity=not_a_number)), "velocity"),
    (lambda: compiled(film(displacement=lambda x: x[:2])), "(3, n)"),
    (lambda: compiled(cable(velocity=lambda x: x[:2])), "(3, n)"),
    (lambda: compiled(beam(velocity=lambda x: x[:2])), "(3, n)"),
    (lambda: gx.StartFrom(gx.PointMass(1.0)), "the system of an"),
    (lambda: run(film(name="b"), gx.StartFrom(supported(film()).system)), "'b'"),
    (lambda: run(tube(), gx.StartFrom(supported(film()).system)), "mesh"),
]

SCENES: list[Case] = [
    (lambda: gx.Scene(), "empty"),
    (lambda: gx.Scene(LINEAR), "Linear"),
    (lambda: gx.Scene(film(), SimpleNamespace(name="idle")), "gossamer_fx.extend.Item"),
    (lambda: gx.Scene(film(), gx.At(1.0, stop=True)), "an event to a Simulation"),
    (lambda: gx.Scene(film(), film()), "'film'"),
    (lambda: run(film(), until=np.nan), "until"),
    (lambda: run(film(), until="1"), "until"),
    (lambda: run(film(velocity=lambda X: X * np.nan)), "it returns nan in an array (3, "),
    (lambda: run(film(), until=-1.0), "until"),
    (lambda: run(film(), checkpoints=gx.Recording("saves")), "give a Checkpoints"),
    (lambda: run(film(), restart="a\0b"), "null characters"),
    (lambda: run(film(), outputs=[gx.outputs.VTU("out/x.pvd", fields=("stres",))]), "stres"),
    (lambda: run(film(), outputs=[gx.Checkpoints("saves")]), "outputs"),
    (
        lambda: run(
            film(),
            outputs=[gx.Series({"x": gx.probes.Position(film(name="b").port("top left"), "x")})],
        ),
        "'b'",
    ),
]

SUPPORTS_AND_LOADS: list[Case] = [
    (lambda: gx.Fixed(film(), "left", components=(3,)), "components"),
    (lambda: gx.Fixed(film(), "left", components=()), "components"),
    (lambda: gx.Damping(film()), "stiffness_factor is 0.0"),
    (lambda: gx.Fixed(film(), "left", rotation=True), "a Plate"),
    (lambda: gx.Fixed(cable(), "start", direction=Z), "Beam"),
    (lambda: loaded(lambda sail: gx.loads.EdgeMoment(sail, "left", moment=1.0)), "EdgeMoment"),
    (lambda: gx.loads.EdgeLoad(branched(), "seam", normal_force=1.0), "sheets meet"),
    (lambda: gx.loads.Force(body().vector(1), (1.0, 0.0, 0.0)), "give a point"),
    (lambda: gx.gas.Piston(body().vector(1), 1e-2, direction=Z), "give a point"),
    (lambda: control(axes=((1, 0), (0, 1), (0, 0))), "axes"),
    (lambda: control(axes=((1, 0, 0), (0, 1, 0), (0, 0, -1))), "right-handed"),
]

STATICS: list[Case] = [
    (lambda: found(tank()), "body"),
    (lambda: found(film(), at="1"), "at is '1'"),
    (lambda: (lambda sail: found(sail, gx.Gravity(sail)))(film()), "No equilibrium"),
    (lambda: reaction_about("xyz"), "three numbers"),
    (lambda: supported(film()).reaction(film()), "support"),
    (lambda: supported(film()).reaction(gx.Fixed(film(), "left")), "scene"),
    (lambda: supported(film()).joint_force(gx.Fixed(film(), "left")), "joint"),
    (lambda: gx.analysis.modes(supported(film()), 10**4), "modes"),
    (lambda: run(film(), halvings=3, control=gx.StepControl()), "a min_step instead"),
    (
        lambda: (lambda sail: gx.fields.field_values(supported(sail), sail, field="heat"))(film()),
        "heat",
    ),
    (lambda: gx.fields.positions(supported(film()), film(name="b")), "'b'"),
]

GAS: list[Case] = [
    (lambda: chamber(), "volume is None"),
    (lambda: compiled(chamber(flipped_pillow(True))), "dead_volume"),
    (lambda: compiled(chamber(film(), dead_volume=1e-3)), "open"),
    (lambda: compiled(chamber(flipped_pillow(False), dead_volume=1e-3)), "normals"),
    (lambda: compiled(chamber(film(), dead_volume=1e-3, surface=("left",))), "left"),
    (lambda: compiled(chamber(tube(), dead_volume=1e-3, surface=("wing",))), "wing"),
    (lambda: compiled(chamber(tube(), rings=(gx.gas.Ring(film(), "wing"),))), "wing"),
    (lambda: compiled(chamber(tube(), rings=(gx.gas.Ring(film(), "left"),))), "on another film"),
    (
        lambda: (
            lambda bag: compiled(*[chamber(bag, dead_volume=1e-3, name=name) for name in "ab"])
        )(tube()),
        "Two chambers",
    ),
    (lambda: gx.Orifice(*[tank()] * 2, area=1e-6), "give two volumes"),
    (
        lambda: compiled(gx.Orifice(OUTSIDE, gx.gas.Ambient(2.0, name="other"), area=1e-6)),
        "no chamber or tank",
    ),
    (
        lambda: gx.Orifice(tank(), OUTSIDE, area=1e-6, discharge_coefficient=2.0),
        "discharge_coefficient",
    ),
    (lambda: run(gx.Orifice(tank(), OUTSIDE, area=lambda t: -t)), "area"),
    (
        lambda: compiled(
            gx.Orifice(tank(), tank(gas=gx.IdealGas(1.67, 2077.0), name="helium"), area=1e-6)
        ),
        "the same name 'gas'",
    ),
    (lambda: compiled(gx.gas.Ambient(1e5, 300.0, name="reservoir")), "chamber"),
]

PLATES_AND_CONTACT: list[Case] = [
    (lambda: plate(order=1), "order"),
    (lambda: gx.Plate(sheet(WORLD, 2, 2), RUBBER), "NeoHooke has no bending stiffness"),
    (lambda: plate(rest_curvature=np.diag((0.0, 0.0, 1.0))), "symmetric"),
    (lambda: plate(hinges=("left",)), "left"),
    (lambda: plate(hinges=("middle",)), "middle"),
    (lambda: loaded(lambda sail: gx.connectors.Crease(sail, "left", stiffness=1e-3)), "left"),
    (lambda: compiled(gx.connectors.Crease(creased(), "fold", stiffness=1e-3)), "fold"),
    (lambda: gx.Contact(distance=1e-3), "Contact"),
    (lambda: gx.Contact(LINEAR, distance=1e-3), "Contact"),
    (lambda: gx.Contact(film(), distance=1e-3, law="glue"), "glue"),
    (lambda: gx.Contact(film(), distance=0.0), "distance"),
    (lambda: gx.Contact(film(), distance=1e-3, stiffness=-1.0), "stiffness"),
    (lambda: gx.Contact(film(), distance=1e-3, friction=-0.1), "friction"),
    (lambda: gx.Contact(film(), distance=1e-3, friction=0.1, slip_velocity=0.0), "slip_velocity"),
    (
        lambda: gx.Contact(film(), distance=1e-3, friction=0.1, slip_velocity=1e90),
        "slip_velocity is 1e+90 m/s",
    ),
    (
        lambda: run(
            gx.Contact(
                film(),
                gx.contact.Plane(point=(0.5, 0.5, 0.0), normal=(1.0, 0.0, 0.0)),
                distance=1e-3,
            )
        ),
        "touch something at the start",
    ),
]

JOINTS: list[Case] = [
    (lambda: (lambda a: gx.constraints.FixedJoint(a.frame(), a.frame()))(body()), "itself"),
    (
        lambda: run(
            gx.constraints.BallJoint(body().port((1.0, 0.0, 0.0)), body(name="other").port())
        ),
        "apart",
    ),
    (
        lambda: gx.constraints.RevoluteJoint(
            body().frame(), body(name="other").frame(), axis=ORIGIN
        ),
        "axis",
    ),
    (lambda: run(gx.constraints.Link(body().port(), body(name="other").port())), "length"),
    (
        lambda: run(gx.connectors.Damper(body().port(), body(name="other").port(), damping=1.0)),
        "coincide",
    ),
    (
        lambda: gx.connectors.Rope(gx.Ground(Z), gx.Ground(ORIGIN), length=1.0, stiffness=1.0),
        "ground",
    ),
    (
        lambda: gx.connectors.AxialSpring(gx.PointMass(1.0).port(), 1.0, direction=(0, 0, 0)),
        "direction",
    ),
    (lambda: beam(normal=(1.0, 0.0, 0.0)), "normal"),
]


def flown(part: Callable[[gx.Membrane, gx.orbit.Orbit], Any], **options: Any) -> gx.Simulation:
    """A run of a film in an orbit with a part that needs both."""
    orbit = gx.orbit.Orbit(gx.orbit.Elements(7e6), **options)
    sail = film()
    return run(sail, orbit, part(sail, orbit))


ORBITS: list[Case] = [
    (lambda: gx.orbit.Elements(7e6, 1.5), "e is 1.5"),
    (lambda: flown(gx.orbit.SolarPressure), "Sun"),
    (
        lambda: flown(lambda sail, orbit: gx.orbit.Orbit(gx.orbit.Elements(8e6), name="other")),
        "2 orbits",
    ),
    (lambda: gx.orbit.Orbit(gx.orbit.Elements(7e6), sun=Z, shadow="soft"), "soft"),
    (lambda: gx.orbit.Orbit(gx.orbit.Elements(7e6), mu=4.283e13), "give the radius"),
    (
        lambda: flown(
            lambda sail, orbit: gx.orbit.Drag(
                sail, orbit, atmosphere=gx.orbit.ExponentialAtmosphere(1e-9, 1e5, scale_height=1e4)
            ),
            mu=4.283e13,
            radius=3.4e6,
        ),
        "give the rotation",
    ),
    (
        lambda: gx.orbit.Orbit(gx.orbit.Elements(7e6), mu=4.283e13, radius=3.4e6, gravity="J2"),
        "leave out gravity",
    ),
    (lambda: gx.orbit.Orbit(gx.orbit.Elements(7e6), epoch="yesterday"), "yesterday"),
    (lambda: flown(lambda sail, orbit: gx.orbit.SolarPressure(cable(), orbit), sun=Z), "Cable"),
]

# Refused for what is in a part of the mesh, which one rank may have and another one not.
OF_PARTS_OF_MESHES = [*MESHES, *STATES, *STATICS, *GAS]
CASES = [*OF_PARTS_OF_MESHES, *SCENES, *SUPPORTS_AND_LOADS, *PLATES_AND_CONTACT]
CASES += [*JOINTS, *ORBITS, *LAWS, *PICTURES]
REFUSALS = (gx.InputError, gx.StepFailure, gx.NoEquilibrium)


@pytest.mark.mpi(len(OF_PARTS_OF_MESHES))
@pytest.mark.parametrize(("act", "culprit"), CASES, ids=[culprit for _, culprit in CASES])
def test_it_is_refused_in_one_sentence(act: Callable[[], object], culprit: str) -> None:
    with pytest.raises(REFUSALS) as caught:
        act()
    assert_sentence(caught.value, culprit, longest=LONGEST)


# ---- files of a run ------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a file, an empty folder, and checkpoints and the recording of a run."""
    folder = tmp_path_factory.mktemp("files")
    (folder / "file").write_text("")
    (folder / "empty").mkdir()
    outputs = [gx.Recording(folder / "run", every=1)]
    run(film(), outputs=outputs, checkpoints=gx.Checkpoints(folder / "saves"))
    return folder


FILES: list[tuple[Callable[[Path], object], str]] = [
    (lambda at: run(film(), restart=at / "file"), "file"),
    (lambda at: run(film(), restart=at / "empty"), "checkpoint"),
    (lambda at: run(film(name="sail"), restart=at / "saves"), "is of another scene"),
    (
        lambda at: (lambda sail: run(sail, gx.Gravity(sail), restart=at / "saves"))(film()),
        "gravity",
    ),
    (lambda at: run(film(), restart=at / "saves", until=1e-6), "later"),
    (lambda at: run(film(), outputs=[gx.Ledger(at / ("a" * 300))]), "a" * 20),
    (lambda at: run(film(), outputs=[gx.Recording(at / "r", {"film": ["heat"]})]), "heat"),
    (lambda at: run(film(), outputs=[gx.Recording(at / "r", {"wing": ["state"]})]), "wing"),
    (lambda at: gx.plot.field(read(at), "state", times=[], path=at / "a.png"), "time"),
    (lambda at: gx.plot.field(read(at), "state", times=[9.0], path=at / "a.png"), "9"),
    (lambda at: gx.plot.strip(read(at), "heat", path=at / "a.png"), "heat"),
    (lambda at: gx.plot.animate(read(at), "state", path=at / "a.txt"), ".gif"),
]


def read(files: Path) -> gx.plot.RunReader:
    return gx.plot.RunReader(files / "run")


@pytest.mark.skipif(WORLD.size > 1, reason="damage of files is tested on ranks in tests/survival")
@pytest.mark.parametrize(("act", "culprit"), FILES, ids=[culprit for _, culprit in FILES])
def test_files_are_refused_in_one_sentence(
    files: Path, act: Callable[[Path], object], culprit: str
) -> None:
    with pytest.raises((*REFUSALS, gx.OutputFailure)) as caught:
        act(files)
    assert_sentence(caught.value, culprit, longest=LONGEST)
