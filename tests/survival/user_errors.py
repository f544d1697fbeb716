"""A run whose functions fail, as a separate program: python3 -m tests.survival.user_errors FOLDER
WHAT RANK."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mpi4py import MPI

import gossamer_fx as gx
from gossamer_fx.core.checks import ending
from tests.survival.scenes import DT, GAS, fluttering_sheet

COMM = MPI.COMM_WORLD


def main() -> None:
    folder = Path(sys.argv[1])
    what = sys.argv[2]
    rank = int(sys.argv[3])

    def bad(name: str, good: Any, wrong: Any = None) -> Callable[..., Any]:
        """`good`, but on one rank, or on all (-1), an error or another value after three steps."""

        def value(at: Any) -> Any:
            time = at if isinstance(at, float) else at.time
            if name != what or time < 3 * DT or rank not in (-1, COMM.rank):
                return good
            if "--exit" in sys.argv:
                sys.exit(3)
            if wrong is None:
                raise ZeroDivisionError("of the user")
            return wrong

        return value

    if what == "scene" and rank in (-1, COMM.rank):
        ending.PATIENCE = 1.0
        raise gx.InputError("This scene is refused.")
    film = next(iter(fluttering_sheet(COMM, 2).items))
    bottle = gx.Tank(1e-3, gas=GAS, pressure=2e5, temperature=300.0, name="bottle")
    scene = gx.Scene(
        film,
        gx.Pressure(film, bad("pressure", 0.0)),
        gx.Pressure(film, bad("nan", 0.0, float("nan")), name="other pressure"),
        gx.loads.Force(film.port("bottom left"), bad("force", (0.0, 0.0, 0.0))),
        gx.loads.Force(
            film.port("top left"),
            bad("differs", (0.0, 0.0, 0.0), (0.0, 0.0, float(COMM.rank))),
            name="second",
        ),
        gx.Orifice(bottle, gx.gas.Ambient(), area=bad("valve", 1e-7), name="valve"),
    )
    events = [
        gx.At(2 * DT, then=bad("never", 0.0), name="fine"),
        gx.At(4 * DT, then=bad("event", 0.0), name="act"),
        gx.When(bad("when", 0.0), 1.0, name="look"),
    ]
    outputs = [
        gx.Ledger(folder / "ledger.csv"),
        gx.Recording(folder / "run", probes={"a": bad("probe", 1.0)}, every=1),
        gx.outputs.Probes(folder / "last.csv", {"b": lambda run: run.time}),
    ]
    saves = gx.Checkpoints(folder / "saves", every=1000)
    restart = saves.folder if "--restart" in sys.argv else None
    gx.Simulation(
        scene,
        gx.Midpoint(dt=DT),
        outputs=outputs,
        events=events,
        checkpoints=saves,
        restart=restart,
    ).run(6 * DT)


if __name__ == "__main__":
    try:
        main()
    except gx.InputError as error:
        if "raise" in sys.argv:
            raise
        print(f"told: {error}", flush=True)
        sys.exit(2)
