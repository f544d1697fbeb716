"""What deployment demos share: how a case is run to its end, what its books say, how curves are kept, and units."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import gossamer_fx as gx
from gossamer_fx.outputs.output import Output, Probe

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BY = "dissipated by "  # before the name of a cause


def deploy(
    case: gx.Case, output: str | Path | None, name: str, parts: Sequence[float], view: gx.plot.View
) -> tuple[gx.Simulation, gx.Series]:
    """Run a case to its end; with `output`, a folder: its recording, and NAME.png at these parts of its time."""
    series = gx.Series(case.probes)
    outputs: list[Output] = [gx.outputs.Progress(), series]
    if output is not None:
        folder, looks = Path(output), [part * case.until for part in parts]
        outputs += [
            case.recording(folder),
            gx.plot.Picture(folder / f"{name}.png", looks, title=case.title, view=view),
        ]
    run = case.simulation(outputs)
    run.run(until=case.until)
    return run, series


def books(run: gx.Simulation, series: gx.Series) -> dict[str, float]:
    """Closing error of the energy, halved steps, steps, iterations a step, seconds, and the most edges that pierced."""
    return {
        "energy_error": abs(run.energy_error),
        "halved": run.substeps,
        "steps": run.step,
        "iterations": run.iterations / run.step,
        "seconds": run.seconds,
        "penetrations": float(series["penetrations"].max())
        if "penetrations" in series.probes
        else math.nan,
    }


def losses(run: gx.Simulation) -> dict[str, float]:
    """Energy dissipated [J], and by each cause."""
    each = {f"{BY}{name}": loss for name, loss in run.totals.losses.items()}
    return {"dissipated": run.totals.dissipated, **each}


def by_cause(found: Mapping[str, float]) -> str:
    """The losses of a run in words, behind their sum."""
    each = [
        f"{loss:.3g} J by {name.removeprefix(BY)}"
        for name, loss in found.items()
        if name.startswith(BY)
    ]
    return f" ({', '.join(each)})" if each else ""


def say_books(found: Mapping[str, float], kept: str, error: str, pierced: str = "the film") -> None:
    """The books in words; beside the energy, `kept` closes to the number `error`."""
    print(f"Edges that pierced {pierced} in any step: {found['penetrations']:.0f}.")
    print(
        f"Energy closes to {found['energy_error']:.0e}, {kept} to {found[error]:.0e}; "
        f"{found['steps']:.0f} steps, {found['iterations']:.1f} iterations each, {found['halved']:.0f} halved, "
        f"{found['seconds']:.0f} s."
    )


def square_millimetres(area: Probe) -> Probe:
    """The probe of an area [m²] in mm²."""
    return lambda run: 1e6 * area(run)


def keep(figure: Figure, title: str, path: Path) -> None:
    """Write a figure of curves with a title."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure.suptitle(title)
    path.parent.mkdir(parents=True, exist_ok=True)
    FigureCanvasAgg(figure).print_png(str(path))
