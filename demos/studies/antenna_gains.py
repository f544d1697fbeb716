"""Over which gains a membrane antenna that is turned out of its plane overshoots and vibrates.

The paper of the demo `antenna_attitude` does not print its gains.  Its antenna, turned by 8° out of
its plane, vibrates visibly, with an error of at most 2.5 %.  Varied are the natural frequency and
the damping ratio of the controlled motion, and what the control measures: the gradient of a film of
order 1 as a mean over the middle square, or that of a film of order 2 at the centre node.  A run
ends at Ω t = 24, as the 40 s of the paper with Ω = 0.6 rad/s.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mpi4py import MPI

from demos.antennas.antenna_attitude import main
from demos.studies.engine.study import Claim, Study
from gossamer_fx.extend import Result

# Arguments of the demo.
MODELS: dict[str, dict[str, Any]] = {
    "membrane, mean": {},
    "membrane P2, node": {"order": 2, "attitude": "node"},
}
PAPER = 0.025  # largest error after the turn, relative
FIGURES = ("overshoot", "residual")
STEP = 0.1  # Ω h


def problem(
    comm: MPI.Comm, model: str, zeta: float, rate: float, end: float = 24.0
) -> dict[str, float]:
    """One turn by 8° out of the plane until Ω t = `end`, with the numbers of `main` that are of one
    value."""
    dt = STEP / rate
    found = main(2, comm=comm, rate=rate, zeta=zeta, until=end / rate, dt=dt, **MODELS[model])
    return {name: value for name, value in found.items() if isinstance(value, float | int)}


def draw(results: list[Result], path: Path) -> None:
    """Overshoot and residual vibration over the frequency of the controlled motion."""
    from demos.common.figures import BLUE, RED, finish, new_figure, save

    figure = new_figure(10.0, 4.0)
    done = [result for result in results if not result.failed]
    for axes, name in zip(figure.subplots(1, 2), FIGURES, strict=True):
        for model, colour in zip(MODELS, (BLUE, RED), strict=True):
            for zeta, line in ((1.0, "-"), (0.2, ":")):
                curve = [r for r in done if r.values["model"] == model and r.values["zeta"] == zeta]
                rates = [r.values["rate"] for r in curve]
                values = [100 * r.numbers[name] for r in curve]
                label = f"{model}, ζ = {zeta:g}"
                axes.plot(rates, values, line, marker="o", ms=3, color=colour, label=label)
        # A short run may end before it overshoots: zero has no place on a logarithmic axis.
        has_values = any(r.numbers[name] > 0 for r in done)
        axes.set(xscale="log", yscale="log" if has_values else "linear")
        finish(axes, "Ω of the gains [rad/s]", f"{name} [%]")
    axes.axhline(100 * PAPER, color="black", lw=0.8)
    axes.annotate("largest error of the paper", (0.7, 100 * PAPER), va="bottom", fontsize=8)
    save(figure, path, "The antenna, turned by 8° out of its plane")


STUDY = Study(
    "antenna_gains",
    "Gains, overshoot and residual vibration of a membrane antenna",
    problem,
    {"model": list(MODELS), "zeta": [1.0, 0.2], "rate": [0.6, 9.6]},
    lambda case: 1.0,
    quick={"model": ["membrane, mean", "membrane P2, node"], "zeta": [0.2], "rate": [9.6]},
    quick_options={"end": 1.2},
    shows=("overshoot", "residual"),
    claims=(
        # Of docs/sources.md: a slow control by the mean has no overshoot with ζ = 1, and about a
        # half with ζ = 0.2; what vibrates is left of the node's.
        Claim("overshoot", 0.0, 0.01, {"model": "membrane, mean", "zeta": 1.0}),
        Claim("overshoot", 0.50, 0.55, {"model": "membrane, mean", "zeta": 0.2, "rate": 0.6}),
        Claim("residual", 0.021, 0.0245, {"model": "membrane, mean", "zeta": 0.2, "rate": 0.6}),
        Claim("residual", 0.010, 0.013, {"model": "membrane P2, node", "zeta": 1.0, "rate": 0.6}),
    ),
    limits={"energy_error": 1e-9},
    columns="overshoot, residual, angle_error, other_angle, energy_error, newton_per_step, seconds",
    # A stiff control of a soft film may leave no step that converges.
    may_fail=True,
    draw=draw,
)
