"""Latches, universal joints and end stops of hinges: what an impact takes, and what it leaves."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from mpi4py import MPI

import gossamer_fx as gx
from demos.methods import latched_boom
from tests.small_scenes import run_until

COMM = MPI.COMM_WORLD
Z = (0.0, 0.0, 1.0)
MIDPOINT = gx.Midpoint(0.07)


def bar(name: str, comm: MPI.Intracomm = COMM, **more) -> gx.RigidBody:
    return gx.RigidBody(1.0, (1.0, 1.0, 1.0), comm=comm, name=name, **more)


def two_bars(comm: MPI.Intracomm = COMM, **arguments) -> gx.constraints.Latch:
    """Two free bars on one hinge, the second of which turns with 1 rad/s."""
    one = bar("one", comm)
    other = bar("other", comm, spin=Z)
    hinge = gx.constraints.RevoluteJoint(one.frame(), other.frame(), axis=Z)
    return gx.constraints.Latch(hinge, **arguments)


def closed_and_opened(latch: gx.constraints.Latch) -> list:
    return [
        gx.When(latch.position, 0.5, then=latch.engage, name="it closes"),
        gx.At(2.0, then=latch.release, name="it opens"),
    ]


@pytest.mark.mpi
def test_two_bars_lose_a_quarter_of_a_joule() -> None:
    """The reduced inertia of ½ kg m² has ½·½·1² J; both turn together with ½ rad/s."""
    latch = two_bars()
    events = closed_and_opened(latch)
    run = gx.Simulation(gx.Scene(latch), MIDPOINT, events=events)
    run.run(until=1.9)
    assert latch.is_engaged(run)
    assert run.totals.losses["latch"] == pytest.approx(0.25, rel=1e-9)
    assert run.totals.kinetic == pytest.approx(0.25, rel=1e-9)
    assert run.totals.angular_momentum == pytest.approx([0, 0, 1], abs=1e-13)
    assert abs(run.energy_error) < 1e-13
    assert latch.position(run) == pytest.approx(0.5, abs=1e-6)
    run.run(until=3.0)
    assert not latch.is_engaged(run)
    assert run.totals.losses["latch"] == pytest.approx(0.25, rel=1e-9)


def test_generalised_alpha_refuses_a_latch() -> None:
    with pytest.raises(gx.InputError, match=r"has a latch, .* use Midpoint"):
        gx.Simulation(gx.Scene(two_bars()), gx.GeneralizedAlpha(dt=0.07))


@pytest.mark.mpi(1)
@pytest.mark.parametrize("stop", [0.21, 1.0, 2.5])
def test_a_restart_knows_whether_it_is_latched(folder: Path, stop: float) -> None:
    """Before the latch engages, while it holds and after it was released."""
    latch = two_bars()
    events = closed_and_opened(latch)
    first = gx.Simulation(
        gx.Scene(latch), MIDPOINT, events=events, checkpoints=gx.Checkpoints(folder)
    )
    first.run(until=stop)
    again = two_bars()
    run = gx.Simulation(gx.Scene(again), MIDPOINT, events=closed_and_opened(again), restart=folder)
    assert again.is_engaged(run) == (0.5 < stop < 2.0)
    first.run(until=3.0)
    run.run(until=3.0)
    assert run.totals.losses == pytest.approx(first.totals.losses, rel=1e-9)
    assert run.system.unknowns.q0.array_r == pytest.approx(
        first.system.unknowns.q0.array_r, abs=1e-9
    )
    assert abs(run.energy_error) < 1e-13


@pytest.mark.mpi
def test_a_latch_holds_where_another_scene_starts() -> None:
    """The moment that has closed it opens the hinge no further."""
    one = bar("one")
    other = bar("other")
    hinge = gx.constraints.RevoluteJoint(one.frame(), other.frame(), axis=Z)
    latch = gx.constraints.Latch(hinge)
    items = [latch, gx.loads.Torque(other.frame(), (0.0, 0.0, 1.0))]
    event = gx.When(latch.position, 0.5, then=latch.engage, stop=True)
    before = gx.Simulation(gx.Scene(*items), gx.Midpoint(0.01), events=[event])
    before.run(until=3.0)
    after = run_until(0.1, *items, gx.StartFrom(before.system), dt=0.01)
    assert latch.is_engaged(after)
    # The other scene had turned as a whole: angles count from the bodies as they were made.
    assert latch.position(after) == pytest.approx(latch.position(before), abs=1e-12)


def test_a_tumbling_pair_keeps_both_momenta() -> None:
    """Two bars whose common tumbling has (0.4, 0.3, 0) rad/s, of which one turns with 2 rad/s about
    the hinge."""
    motion = {"velocity": (0.0, 1.4, -0.21), "spin": (0.4, 0.3, 2.0)}
    still = {"velocity": (0.0, 0.0, 0.15), "spin": (0.4, 0.3, 0.0)}
    one = gx.RigidBody(1.0, (0.3, 1.0, 1.2), position=(-0.5, 0, 0), name="one", **still)
    other = gx.RigidBody(2.0, (0.2, 0.9, 1.0), position=(0.7, 0, 0), name="other", **motion)
    origin = (0.0, 0.0, 0.0)
    hinge = gx.constraints.RevoluteJoint(one.frame_at(origin), other.frame_at(origin), axis=Z)
    latch = gx.constraints.Latch(hinge, angle=1.0)
    events = [gx.When(latch.position, 1.0, then=latch.engage)]
    run = gx.Simulation(gx.Scene(latch), gx.Midpoint(0.02), events=events)
    before = run.totals
    run.run(until=3.0)
    assert latch.is_engaged(run)
    assert run.totals.losses["latch"] > 0.01 * before.kinetic
    assert run.totals.momentum == pytest.approx(before.momentum, abs=1e-12)
    assert run.totals.angular_momentum == pytest.approx(before.angular_momentum, abs=1e-11)
    assert abs(run.energy_error) < 1e-11


def test_a_load_opens_the_latch() -> None:
    """A moment that rises by 1 N m/s on the second of two held bars, half of which passes the
    latch."""
    latch = two_bars(name="weak")
    body = latch.joint.b.origin.body
    torque = gx.loads.Torque(body.frame(), lambda t: (0.0, 0.0, t))
    events = [
        gx.When(latch.position, 0.1, then=latch.engage),
        gx.When(latch.load, 1.0, then=latch.release, stop=True),
    ]
    run = gx.Simulation(gx.Scene(latch, torque), gx.Midpoint(0.01), events=events)
    run.run(until=5.0)
    assert run.time == pytest.approx(2.0, abs=0.02)
    assert not latch.is_engaged(run)


@pytest.mark.mpi
def test_a_rail_is_held_and_its_carriage_bounces_not() -> None:
    """1 kg with 2 m/s on a rail of 3 kg: ½·(3/4)·2² J are lost, and both go on with ½ m/s."""
    rail = gx.RigidBody(3.0, (1.0, 1.0, 1.0), name="rail")
    carriage = gx.RigidBody(1.0, (1.0, 1.0, 1.0), name="carriage", velocity=(2, 0, 0))
    joint = gx.constraints.PrismaticJoint(rail.frame(), carriage.frame(), axis=(1, 0, 0))
    latch = gx.constraints.Latch(joint)
    events = [gx.When(latch.position, 0.3, then=latch.engage)]
    run = gx.Simulation(gx.Scene(latch), MIDPOINT, events=events)
    run.run(until=1.0)
    assert run.totals.losses["latch"] == pytest.approx(1.5, rel=1e-12)
    assert latch.position(run) == pytest.approx(0.3, abs=1e-6)
    velocity = gx.probes.Velocity(carriage.port((0.0, 0.0, 0.0)), "x")
    assert velocity(run) == pytest.approx(0.5, rel=1e-12)


def test_a_latch_that_is_closed_at_the_start_opens() -> None:
    one = bar("one", spin=Z)
    other = bar("other", spin=Z)
    hinge = gx.constraints.RevoluteJoint(one.frame(), other.frame(), axis=Z)
    latch = gx.constraints.Latch(hinge, engaged=True, angle=0.4)
    torque = gx.loads.Torque(other.frame(), (0.0, 0.0, 1.0))
    events = [gx.At(0.5, then=latch.release)]
    run = gx.Simulation(gx.Scene(latch, torque), gx.Midpoint(0.01), events=events)
    run.run(until=0.5)
    assert latch.position(run) == pytest.approx(0.0, abs=1e-12)
    run.run(until=1.0)
    # The moment of 1 N m turns the second bar against the first: ½·1·0.5².
    assert latch.position(run) == pytest.approx(0.125, rel=1e-4)
    assert run.totals.losses["latch"] == 0.0


def test_what_is_held_already_is_not_latched() -> None:
    latch = two_bars()
    twin = gx.constraints.Latch(latch.joint, name="twin")
    events = [gx.At(0.1, then=latch.engage), gx.At(0.2, then=twin.engage)]
    run = gx.Simulation(gx.Scene(latch, twin), MIDPOINT, events=events)
    with pytest.raises(gx.InputError, match="'latch', 'twin' follow from the others"):
        run.run(until=1.0)
    assert not twin.is_engaged(run)


def test_gradients_refuse_a_latch_by_name() -> None:
    latch = two_bars(name="lock")
    run = gx.Simulation(gx.Scene(latch), MIDPOINT)
    with pytest.raises(gx.InputError, match="'lock' has no gradient"):
        tape = gx.analysis.RunTape(run)
        run.run(until=0.1)
        gx.analysis.gradient(tape, of=gx.analysis.Energy(), by=["other.spin"])
    clamp, spring = held_down()
    run = gx.Simulation(gx.Scene(clamp, spring), MIDPOINT)
    with pytest.raises(gx.InputError, match="'weld' has no gradient"):
        tape = gx.analysis.RunTape(run)
        run.run(until=0.1)
        gx.analysis.gradient(tape, of=gx.analysis.Energy(), by=["other.spin"])


def held_down(comm: MPI.Intracomm = COMM) -> tuple[gx.constraints.HoldDown, gx.connectors.Stop]:
    """Bodies of 1 and 3 kg that a joint presses on a spring, which has 60/2·0.1² J = 0.3 J."""
    one = bar("one", comm)
    other = gx.RigidBody(3.0, (1.0, 1.0, 1.0), comm=comm, name="other")
    weld = gx.constraints.FixedJoint(one.frame(), other.frame(), name="weld")
    ends = (one.port_at((-0.1, 0, 0)), other.port_at((0.1, 0, 0)))
    return gx.constraints.HoldDown(weld), gx.connectors.Stop(*ends, stiffness=60.0, length=0.3)


@pytest.mark.mpi
@pytest.mark.parametrize("by", ["time", "force"])
def test_bodies_separate_when_a_joint_is_released(by: str) -> None:
    """The speeds are as 3 to 1, and have the energy of the spring; nothing is lost.  The joint
    bears 6 N of the spring, and a pull on both sides that rises by 1 N/s."""
    clamp, spring = held_down()
    pulls = []
    for side, sign in ((clamp.a, -1.0), (clamp.b, 1.0)):
        middle = side.origin.body.port_at((0, 0, 0))
        pull = gx.loads.Force(middle, lambda t, s=sign: (s * t, 0.0, 0.0), name=f"pull {sign}")
        pulls.append(pull)
    force = gx.probes.JointForce(clamp, "x")
    if by == "time":
        released = gx.At(1.0, then=clamp.release)
        run = gx.Simulation(gx.Scene(clamp, spring), MIDPOINT, events=[released])
        run.run(until=0.9)
        assert force(run) == pytest.approx(-6.0, rel=1e-9)
        assert run.totals.kinetic == pytest.approx(0.0, abs=1e-20)
        run.run(until=3.0)
        assert not clamp.is_engaged(run)
        assert force(run) == 0.0
        assert run.totals.kinetic == pytest.approx(0.3, rel=1e-9)
        speeds = [
            gx.probes.Velocity(side.origin.body.port_at((0, 0, 0)), "x")(run)
            for side in (clamp.a, clamp.b)
        ]
        assert speeds[0] == pytest.approx(-3 * speeds[1], rel=1e-9)
    else:
        released = gx.When(force, -8.0, falling=True, then=clamp.release, stop=True)
        scene = gx.Scene(clamp, spring, *pulls)
        run = gx.Simulation(scene, gx.Midpoint(0.01), events=[released])
        run.run(until=5.0)
        assert run.time == pytest.approx(2.0, abs=0.02)
        assert not clamp.is_engaged(run)
    assert run.totals.dissipated == 0.0
    assert abs(run.energy_error) < 1e-12
    assert run.totals.momentum == pytest.approx([0, 0, 0], abs=1e-12)


@pytest.mark.parametrize("stop", [0.5, 1.5])
def test_a_restart_knows_whether_a_joint_was_released(folder: Path, stop: float) -> None:
    runs = []
    for options in ({"checkpoints": gx.Checkpoints(folder)}, {"restart": folder}):
        clamp, spring = held_down()
        events = [gx.At(1.0, then=clamp.release)]
        run = gx.Simulation(gx.Scene(clamp, spring), MIDPOINT, events=events, **options)
        run.run(until=stop)
        assert clamp.is_engaged(run) == (stop < 1.0)
        runs.append(run)
    for run in runs:
        run.run(until=2.0)
    assert runs[1].system.unknowns.q0.array_r == pytest.approx(
        runs[0].system.unknowns.q0.array_r, abs=1e-9
    )
    assert runs[1].totals.kinetic == pytest.approx(0.3, rel=1e-9)


TABLE = {"angle": [-0.5, -0.2, 0.0, 0.2, 0.5], "moment": [-0.1, -1.0, 0.0, 1.0, 0.1]}


def test_a_table_of_moments_keeps_its_energy() -> None:
    """A bar swings through the peaks of a tape spring, of which the static moment is the table's
    and the energy its integral."""
    one = bar("one", spin=(0.0, 0.0, 1.0))
    sides = {"a": gx.ground_frame(), "b": one.frame(), "axis": Z}
    hinge = gx.constraints.RevoluteJoint(**sides)
    # Rows behind the last peak move the middle of the table, and with it the angle's jump.
    columns = {"angle": [*TABLE["angle"], 4.0], "moment": [*TABLE["moment"], 0.1]}
    tape = gx.connectors.TabulatedTorsion(**sides, **columns, name="tape")
    angle = gx.constraints.Latch(hinge)
    run = gx.Simulation(gx.Scene(angle, tape), gx.Midpoint(0.02))
    largest = 0.0
    for _ in range(400):
        run.run(until=run.time + 0.02)
        φ = abs(angle.position(run))
        largest = max(largest, φ)
        # ½ φ²·5 up to 0.2, then a line that falls from 1 to 0.1 N m, then 0.1 N m.
        beyond = min(max(φ - 0.2, 0.0), 0.3)
        energy = 2.5 * min(φ, 0.2) ** 2 + beyond - 1.5 * beyond**2 + 0.1 * max(φ - 0.5, 0.0)
        assert run.totals.stored["tape"] == pytest.approx(energy, abs=1e-12)
    assert abs(run.energy_error) < 1e-12
    # ½ kg m² (1 rad/s)² = 0.265 J + 0.1 N m (φ - 0.5).
    assert largest == pytest.approx(0.5 + (0.5 - 0.265) / 0.1, abs=2e-3)


@pytest.mark.mpi
@pytest.mark.parametrize("moment", [0.5, -0.8])
def test_a_table_of_moments_in_equilibrium(moment: float) -> None:
    one = bar("one")
    sides = {"a": gx.ground_frame(), "b": one.frame(), "axis": Z}
    tape = gx.connectors.TabulatedTorsion(**sides, **TABLE)
    hinge = gx.constraints.RevoluteJoint(**sides)
    angle = gx.constraints.Latch(hinge)
    push = gx.loads.Torque(one.frame(), (0.0, 0.0, moment))
    equilibrium = gx.Equilibrium(gx.Scene(angle, tape, push))
    assert equilibrium.find().regular
    assert angle.position(equilibrium) == pytest.approx(0.2 * moment, rel=1e-6)


def test_bad_tables_of_moments_are_refused() -> None:
    sides = {"a": gx.ground_frame(), "b": bar("one").frame(), "axis": Z}
    for columns, words in (
        ({"moment": [0.0, 1.0]}, "angle has 5 and moment has 2 entries"),
        (
            {"angle": [0.0, 0.1, 0.1, 0.2, 0.3]},
            r"angle is \[0\.0, 0\.1, 0\.1, 0\.2, 0\.3\], whose number 3 does not fit",
        ),
        ({"angle": [-3.0, 0.1, 0.2, 0.3, 4.0]}, "over less than a turn"),
    ):
        with pytest.raises(gx.InputError, match=words):
            gx.connectors.TabulatedTorsion(**sides, **(TABLE | columns))


def test_bad_latches_are_refused() -> None:
    one = bar("one")
    ball = gx.constraints.BallJoint(one.port((0, 0, 0)), gx.Ground((0, 0, 0)))
    with pytest.raises(gx.InputError, match="joint"):
        gx.constraints.Latch(ball)  # type: ignore[arg-type]
    rail = gx.constraints.PrismaticJoint(one.frame(), gx.ground_frame(), axis=Z)
    with pytest.raises(gx.InputError, match=r"angle is 7\.0 rad"):
        two_bars(angle=7.0)
    with pytest.raises(gx.InputError, match="has no angle"):
        gx.constraints.Latch(rail, angle=1.0)
    stranger = two_bars(name="stranger")
    run = gx.Simulation(gx.Scene(one), MIDPOINT)
    with pytest.raises(gx.InputError, match="'stranger' is not in the scene"):
        stranger.engage(run)
    with pytest.raises(gx.InputError, match="'weld' is not in the scene"):
        held_down()[0].release(run)
    with pytest.raises(
        gx.InputError, match=r"limits is \(1\.0, 0\.0\), whose number 2 does not fit"
    ):
        gx.connectors.TorsionStop(
            one.frame(), gx.ground_frame(), axis=Z, stiffness=1.0, limits=(1.0, 0.0)
        )
    with pytest.raises(gx.InputError, match="right angle"):
        gx.constraints.UniversalJoint(one.frame(), gx.ground_frame(), axis_a=Z, axis_b=(0, 1, 1))


def test_a_universal_joint_passes_a_torque_on() -> None:
    """It bends about both arms of its cross and does not twist: a torque of 1 N m about the common
    axis turns both bars of 1 kg m² together."""
    one = bar("one")
    other = bar("other")
    cross = gx.constraints.UniversalJoint(
        one.frame(), other.frame(), axis_a=(1, 0, 0), axis_b=(0, 1, 0)
    )
    twist = gx.loads.Torque(one.frame(), Z)
    run = gx.Simulation(gx.Scene(cross, twist), gx.Midpoint(0.01))
    run.run(until=1.0)
    for body in (one, other):
        assert gx.probes.AngularVelocity(body.frame(), "z")(run) == pytest.approx(0.5, rel=1e-9)
    bend = gx.loads.Torque(one.frame(), (1.0, 0.5, 0.0))
    run = gx.Simulation(gx.Scene(cross, bend), gx.Midpoint(0.01))
    run.run(until=1.0)
    arm = run.system.unknowns.state.vector(one.frame().directors[0])
    across = run.system.unknowns.state.vector(other.frame().directors[1])
    assert arm @ across == pytest.approx(0.0, abs=1e-10)
    assert gx.probes.AngularVelocity(other.frame(), "x")(run) == pytest.approx(0.0, abs=0.1)
    assert abs(run.energy_error) < 1e-12


def test_end_stops_return_the_energy_of_the_impact() -> None:
    """A bar between stops at ±0.5 rad, at 1 rad/s: each contact takes π √(I/k)."""
    one = bar("one", spin=Z)
    sides = {"a": gx.ground_frame(), "b": one.frame(), "axis": Z}
    hinge = gx.constraints.RevoluteJoint(**sides)
    stop = gx.connectors.TorsionStop(**sides, stiffness=400.0, limits=(-0.5, 0.5))
    angle = gx.constraints.Latch(hinge)
    run = gx.Simulation(gx.Scene(angle, stop), gx.Midpoint(0.002))
    contact = math.pi / math.sqrt(400.0)
    run.run(until=0.5 + contact + 0.3)
    assert angle.position(run) == pytest.approx(0.2, abs=1e-3)
    run.run(until=0.5 + contact + 1.0 + contact + 0.3)
    assert angle.position(run) == pytest.approx(-0.2, abs=1e-3)
    assert abs(run.energy_error) < 1e-12
    assert run.totals.kinetic == pytest.approx(0.5, rel=1e-9)


@pytest.mark.mpi
@pytest.mark.parametrize(("hinges", "left"), [("springs", 1e-8), ("tape springs", 0.0)])
def test_a_boom_stands_still_when_its_last_hinge_has_latched(hinges: str, left: float) -> None:
    """Without momentum a rigid body is at rest: the latches have taken all energy but that of the
    springs, which are 1e-4 of their way from their rest; tape springs are straight."""
    found = latched_boom.main(bars=2, dt=0.02, hinges=hinges)
    assert found["latched"] == 2
    assert found["kinetic energy left"] < 1e-20
    assert found["taken by the latches"] == pytest.approx(1 - left, abs=1e-9)
    assert abs(found["energy_error"]) < 1e-10
    assert found["angular_momentum"] < 1e-11
