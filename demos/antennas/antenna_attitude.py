"""A membrane antenna is turned by 8° about an axis through its centre, by a torque that follows its
attitude.

The antenna (Yu, Qi, Liu & Tian, China Mechanical Engineering 36 (2025) 2284, § 3): a film of 2.1 m
× 2.1 m × 20 µm (1400 kg/m³, 2.3 GPa, residual stiffness 1/35·1e-8) and two crossed tubes on its
diagonals, outer radius R = 0.02 m, wall 0.5 mm (1560 kg/m³, 100 GPa), ν = 0.3; tied at the four
corners and at four points around the centre, the film's centre on a ball joint.  (Letter and word
of the paper's "outer diameter R" disagree: the radius is taken.)

The attitude is the rotation R of the polar decomposition F = R U of the position gradient at the
centre, R = R_w(γ) R_v(β) R_u(θ).  With attitude="mean" F is its mean over the square of the four
inner points, whatever the mesh; with "node", as printed, that at the centre node, the mean of the
triangles around it; with 3 × 3 cells of order 1 both are the same.  There acts, about the axis of
each angle,

    T = K_p (target - angle) - K_d d(angle)/dt,   K_p = I Ω²,   K_d = 2 ζ I Ω

with the moment of inertia I of the antenna about that axis, Ω = 0.6 rad/s (`rate`) and ζ = 1
(`zeta`); the paper does not print its gains.

    case 1: (0°, 0°, 8°) about w, in the plane of the film;  case 2: (8°, 0°, 0°) about u, out of it

With law="sliding" the torque is that of a sliding-mode law (Slotine & Li, Applied Nonlinear Control
(1991), § 7.2), sampled and held for 0.08 s.  With s = d(angle)/dt + Ω (angle - target) it lets |s|
fall at the rate η, and is linear in s where |s| < φ:

    T = -I (Ω d(angle)/dt + η sat(s/φ)),   η = 0.05 rad/s²,   φ = 0.02 rad/s

    ./gossamer demo antenna_attitude
    ./gossamer demo antenna_attitude case=1 law=sliding
    ./gossamer run demos/antennas/antenna_attitude.py case=2 dt=0.04 --output out/turn
    ./gossamer run demos/antennas/antenna_attitude.py law=sliding stepper=generalized_alpha
    ./gossamer run demos/antennas/antenna_attitude.py case=2 rate=2.4 zeta=0.1 attitude=node order=2
    ./gossamer report out/turn
"""

from __future__ import annotations

import inspect
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

import gossamer_fx as gx
from demos.common.command_line import named_values
from demos.common.deployment import effort, print_figures, run_case
from demos.common.figures import draw_film, finish, new_figure, save, triangles
from gossamer_fx.extend import Array, Probe, check, combine
from gossamer_fx.meshes import antenna as meshes

# Edge of the film; from the paper, as all numbers here.
SIDE = 2.1  # m
FILM = gx.Miyazaki(E=2.3e9, nu=0.3, density=1400.0, thickness=2e-5, residual_stiffness=1e-8 / 35)
# The same without wrinkling, of a shell that resists compression and bending.
SHELL = gx.Linear(E=FILM.E, nu=FILM.nu, density=FILM.density, thickness=FILM.thickness)
TUBE = {"nu": 0.3, "density": 1560.0}
BOOM_MODULUS = 100e9  # Pa
BOOM = gx.sections.tube(0.02, 5e-4, E=BOOM_MODULUS, **TUBE)
# By the number of the case.
TARGETS = {1: (0.0, 0.0, 8.0), 2: (8.0, 0.0, 0.0)}  # degrees
# Of the controlled motion: natural frequency Ω [rad/s] and damping ratio ζ.
RATE = 0.6
DAMPING = 1.0
# Of the sliding-mode law: η [rad/s²], φ [rad/s], and the time for which a torque is held [s].
REACHING = 0.05
LAYER = 0.02
PERIOD = 0.08
# By name; `dt` [s] is the step.
STEPPERS = {"midpoint": gx.Midpoint, "generalized_alpha": gx.GeneralizedAlpha}


@dataclass(frozen=True)
class Antenna:
    """Film, booms and the joints that tie them."""

    film: gx.Membrane
    booms: list[gx.Beam]
    ties: list[gx.constraints.BallJoint]
    points: np.ndarray  # A, B, C, D at the corners, E, F, G, H around the centre

    @property
    def items(self) -> list:
        return [self.film, *self.booms, *self.ties]


def antenna(
    comm: MPI.Comm,
    film_cells: int,
    boom_elements: int,
    order: int = 1,
    shell: bool = False,
    stiffer: float = 1.0,
) -> Antenna:
    """The antenna in the plane z = 0, centre at the origin, stress-free; its film may be a `shell`
    that does not wrinkle, and its booms may be `stiffer` by a factor."""
    section = gx.sections.tube(0.02, 5e-4, E=stiffer * BOOM_MODULUS, **TUBE)
    mesh = meshes.film(comm, film_cells, SIDE)
    if shell:
        film: gx.Membrane = gx.Plate(mesh, SHELL, name="film")
    else:
        film = gx.Membrane(mesh, FILM, order=order)
    booms = [
        gx.Beam(meshes.boom(comm, boom_elements, SIDE, diagonal), section, name=f"boom {k + 1}")
        for k, diagonal in enumerate(meshes.DIAGONALS)
    ]
    # A to D, then E to H.
    points = meshes.tie_points(SIDE)
    # Point k lies on diagonal k mod 2.
    ties = [
        gx.constraints.BallJoint(
            film.port_at(point), booms[k % 2].port_at(point), name=f"tie {'ABCDEFGH'[k]}"
        )
        for k, point in enumerate(points)
    ]
    return Antenna(film, booms, ties, points)


def inertia() -> np.ndarray:
    """Moments of inertia about u, v, w [kg m²] of the undeformed antenna; those of the tubes'
    sections left out."""
    # m a²/12 about an axis in the plane; twice as much about the normal.
    film = FILM.density * FILM.thickness * SIDE**4 / 12
    length = SIDE * 2**0.5
    boom = BOOM.line_density * length**3 / 12
    return np.array([film + boom, film + boom, 2 * (film + boom)])


def angles_and_rates(control: gx.control.AttitudeControl, run: gx.Simulation) -> Array:
    """The three controlled angles [rad], then their rates [rad/s], (6,)."""
    # Directors of the patch give R, and R the three angles.
    state = run.system.unknowns.state
    X = state.vectors(control.frame.directors).ravel()
    V = state.rates(control.frame.directors).ravel()
    return np.concatenate(control.angles_and_rates(X, V, control.reference()))


def measured_frames(
    film: gx.Membrane, points: np.ndarray, cells: int, order: int
) -> dict[str, gx.Frame]:
    """The frames whose directors give the position gradient, by the values of `attitude`; `points`
    are A to H."""
    centre = film.port_at((0, 0, 0))
    inner = [film.port_at(point) for point in points[4:]]
    frames = {"mean": gx.control.patch(centre, inner)}
    # The centre is that of a cell, whose corners are these points, or of four cells, whose centres
    # they are: half of a cell away along both axes.
    cells_of_middle_third = cells - 2 * round(cells / 3)
    half_cell = SIDE / 6 / cells_of_middle_third
    near = [film.port_at(half_cell * np.sign(point)) for point in points[4:]]
    if order == 1:
        frames["node"] = gx.control.patch(centre, near)
        return frames
    # The derivative at the end of an edge of order 2, times its length: -3 f(0) + 4 f(½) - f(1).
    arms = []
    for point, corner in zip(points[4:], near, strict=True):
        middle = film.port_at(half_cell / 2 * np.sign(point))
        arms.append(combine((-3.0, 4.0, -1.0), (centre, middle, corner)))
    frames["node"] = gx.Frame(centre, tuple(arms))
    return frames


def sliding_mode(
    control: gx.control.AttitudeControl, inertias: Array, rate: float
) -> gx.control.Feedback:
    """The sliding-mode law on the frame and with the angles of a control, which is left out of the
    scene; its commands are torques in space axes [N m]."""

    def measure(k: int) -> Probe:
        return lambda run: float(angles_and_rates(control, run)[k])

    def law(t: float, values: Array) -> Array:
        angles = values[:3]
        rates = values[3:]
        s = rates + rate * (angles - control.target)
        reaching = REACHING * np.clip(s / LAYER, -1.0, 1.0)
        return control.in_space(angles, -inertias * (rate * rates + reaching))

    torque = gx.control.BodyTorque(control.frame)
    return gx.control.Feedback([measure(k) for k in range(6)], law, [torque], period=PERIOD)


def control_probes(
    control: gx.control.AttitudeControl,
    other: gx.control.AttitudeControl,
    feedback: gx.control.Feedback | None,
) -> dict[str, Probe]:
    """The three controlled angles [deg], and the torques [N m] about their axes, those of a
    feedback about axes in space; the angles that another control, left out of the scene, would
    measure."""

    def angle(control: gx.control.AttitudeControl, axis: int) -> Probe:
        return lambda run: float(np.degrees(angles_and_rates(control, run)[axis]))

    def torque(axis: int) -> Probe:
        if feedback is not None:
            return lambda run: float(feedback.commands(run)[axis])
        return lambda run: float(control.torques[axis])

    found: dict[str, Probe] = {}
    for k, axis in enumerate("uvw"):
        found[f"angle {axis} [deg]"] = angle(control, k)
        found[f"other angle {axis} [deg]"] = angle(other, k)
        found[f"torque {axis} [N m]"] = torque(k)
    return found


def build(
    comm: MPI.Comm,
    case: int = 1,
    cells: int = 3,
    elements: int = 6,
    until: float = 40.0,
    dt: float = 0.02,
    order: int = 1,
    law: str = "pd",
    stepper: str = "midpoint",
    attitude: str = "mean",
    rate: float = RATE,
    zeta: float = DAMPING,
    shell: bool = False,
) -> gx.Case:
    """The antenna and its control; it records angles, torques and the displacement of the corner A.

    Args:
        case: 1 or 2.
        cells: squares along a side of the film.
        elements: of a boom.
        until, dt: end of the run and step [s].
        order: of the film.
        law: "pd" or "sliding".
        stepper: one of `STEPPERS`.
        attitude: gradient that is measured, and on which the torque acts: "mean" or "node".
        rate, zeta: natural frequency [rad/s] and damping ratio of the controlled motion.
        shell: a film that does not wrinkle, see `antenna`.
    """
    check(
        law in ("pd", "sliding") and stepper in STEPPERS and attitude in ("mean", "node"),
        f"law is {law!r}, stepper {stepper!r} and attitude {attitude!r}; "
        f"give pd or sliding, one of {', '.join(STEPPERS)}, and mean or node.",
    )
    check(cells >= 3, f"cells is {cells}; give 3 or more, so that the film has E to H as nodes.")
    model = antenna(comm, cells, elements, order, shell)
    corner = model.film.port_at(model.points[0])
    I = inertia()  # noqa: E741 (as in the formula)
    controls = {
        name: gx.control.AttitudeControl(
            frame, np.radians(TARGETS[case]), stiffness=I * rate**2, damping=2 * zeta * I * rate
        )
        for name, frame in measured_frames(
            model.film, model.points, cells, 2 if shell else order
        ).items()
    }
    control = controls.pop(attitude)
    feedback = sliding_mode(control, I, rate) if law == "sliding" else None
    centre = model.film.port_at((0, 0, 0))
    joint = gx.constraints.BallJoint(centre, gx.Ground((0, 0, 0)), name="centre")
    scene = gx.Scene(*model.items, joint, feedback or control)
    probes = control_probes(control, *controls.values(), feedback)
    probes |= {f"A {axis} [m]": gx.probes.Displacement(corner, axis) for axis in "xyz"}
    # The torque begins at zero, so that the first residuals are small: `floor` ends their
    # iteration.
    tolerances = gx.Tolerances(relative=1e-12, floor=1.0)
    return gx.Case(
        scene,
        STEPPERS[stepper](dt=dt, tolerances=tolerances),
        until=until,
        title=f"The membrane antenna, turned: case {case}",
        probes=probes,
    )


def main(
    case: int = 1, output: str | Path | None = None, comm: MPI.Comm = MPI.COMM_WORLD, **given: Any
) -> dict:
    """Control `case` of what `build` makes of the numbers given; angles in degrees, torques in N m,
    over the time.

    Relative to the angle of the case: angle_error at the end; overshoot; residual, the largest
    error in the last quarter of the run; other_angle, the largest difference to the attitude that
    is not controlled.  With `output`, a folder: the recording of the run, and a picture.  "film"
    are the corners of the triangles of this rank at the end [m], "booms" the nodes of the booms.
    """
    turn = build(comm, case, **given)
    # Times of the picture, scaled with a shorter run.
    looks = (0.05, 0.1, 0.2, 0.4, 1.0)
    run, series = run_case(turn, output, "antenna", looks)
    angles, others, torques, moved = (
        np.array([series[f"{what} {axis} [{unit}]"] for axis in axes]).T
        for what, axes, unit in (
            ("angle", "uvw", "deg"),
            ("other angle", "uvw", "deg"),
            ("torque", "uvw", "N m"),
            ("A", "xyz", "m"),
        )
    )
    target = np.array(TARGETS[case])
    errors = np.abs(angles - target).max(axis=1) / target.max()
    # The vibration that is left: in the last quarter of the run.
    is_late = series.time >= 0.75 * series.time[-1]
    return {
        "angle_error": float(errors[-1]),
        "overshoot": float((angles @ target).max() / (target @ target) - 1),
        "residual": float(errors[is_late].max()),
        "other_angle": float(np.abs(others - angles).max() / target.max()),
        "angles": angles,
        "torque": torques,
        "time": series.time,
        "point_A": moved,
        "film": film_at_end(run),
        "booms": booms_at_end(run),
        **effort(run),
    }


def film_at_end(run: gx.Simulation) -> Array:
    """Positions (n, 3, 3) [m] of the corners of the film's triangles on this rank."""
    film = next(body for body in run.system.unknowns.bodies if isinstance(body, gx.Membrane))
    return triangles(run.system, film)


def booms_at_end(run: gx.Simulation) -> list[Array]:
    """Positions (n, 3) [m] of the nodes of each boom on this rank, from end to end."""
    found = []
    for boom in run.system.unknowns.bodies:
        if isinstance(boom, gx.Beam):
            x = run.system.unknowns.state[boom].local_positions()
            along = boom.space.tabulate_dof_coordinates()[: len(x), 0]
            found.append(x[np.argsort(along)])
    return found


def settling_time(time: Array, angle: Array, target: float, part: float) -> float:
    """The time [s] from which on an angle stays within a part of its target."""
    # The last time outside; inside from the next one on.
    outside = np.flatnonzero(np.abs(angle - target) > part * abs(target))
    last = outside[-1] if len(outside) else 0
    return float(time[last])


def draw_both(results: dict[int, dict], path: Path) -> None:
    """The turned antenna, and angles, torques and displacements of A of both cases over the
    time."""
    figure = new_figure(width=12.0, height=7.0)
    left, right = figure.subfigures(1, 2, width_ratios=(1.0, 2.0))
    axes = right.subplots(3, 2, sharex=True)
    # One column of curves for each case, and the antenna at its end.
    for k, (case, result) in enumerate(results.items()):
        film = left.add_subplot(2, 1, k + 1, projection="3d", computed_zorder=False)
        draw_film(film, result["film"], view=(35.0, -60.0), zoom=0.85)
        for boom in result["booms"]:
            film.plot(*boom.T, color="black", lw=2.0, zorder=10)
        film.set_title(f"case {case}: at {result['time'][-1]:g} s")
        # The angle that the case turns.
        axis = int(np.argmax(np.abs(TARGETS[case])))
        target = TARGETS[case][axis]
        settled = [
            settling_time(result["time"], result["angles"][:, axis], target, part)
            for part in (0.05, 0.02, 0.002)
        ]
        words = ", ".join(f"{t:.1f}" for t in settled)
        axes[0, k].set_title(f"case {case}: within 5, 2, 0.2 % after {words} s", fontsize=9)
        # Numbers of the paper's figures with these axes.
        numbers = {1: ("Fig. 10", "Fig. 11", "Fig. 12"), 2: ("Fig. 14", "", "Fig. 15")}[case]
        rows = (
            ("angle [deg]", result["angles"], ("θ about u", "β about v", "γ about w")),
            ("torque [N m]", result["torque"], ("about u", "about v", "about w")),
            ("displacement of A [m]", result["point_A"], ("X", "Y", "Z")),
        )
        for ax, (label, values, names), number in zip(axes[:, k], rows, numbers, strict=True):
            for component, name in zip(values.T, names, strict=True):
                ax.plot(result["time"], component, label=name)
            finish(ax, "", label, title=number or None)
        axes[-1, k].set_xlabel("time [s]")
    save(figure, path)


if __name__ == "__main__":
    # e.g. case=1 law=sliding
    parameters = list(inspect.signature(build).parameters.values())[1:]
    given = named_values(sys.argv[1:], {one.name: one.default for one in parameters})
    cases = [given.pop("case")] if "case" in given else [*TARGETS]
    check(set(cases) <= set(TARGETS), f"There is no case {cases[0]}; give 1 or 2.")
    results = {
        case: main(case=case, output=f"out/antenna_attitude/case {case}", **given) for case in cases
    }
    # Of one rank only: the mesh of a picture is that of rank 0.
    if MPI.COMM_WORLD.size == 1 and len(results) == len(TARGETS):
        draw_both(results, Path("out/antenna_attitude/antenna_attitude.png"))
    for case, result in results.items():
        print_figures({"case": case} | result)
