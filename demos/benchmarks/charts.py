"""Cost and memory over the unknowns."""

from __future__ import annotations

from pathlib import Path

import numpy as np


def draw(rows: list[dict[str, object]], unit: str, path: Path) -> None:
    """Double logarithmic, with exponents, which are printed as well."""
    import matplotlib.pyplot as plt

    dofs, cost, newton, memory = (
        np.array([float(str(row[key])) for row in rows])
        for key in ("dofs", "cost", "Newton/step", "MB")
    )
    figure, (left, right) = plt.subplots(
        1,
        2,
        figsize=(9, 4),
        layout="constrained",
    )
    for axes, values, label in (
        (left, cost, "step"),
        (left, cost / newton, "Newton iteration"),
        (right, memory, "process"),
    ):
        # Slope of the straight line in double logarithmic axes.
        exponent = np.polyfit(np.log(dofs), np.log(values), 1)[0]
        axes.loglog(
            dofs,
            values,
            "o-",
            label=f"{label}, exponent {exponent:.2f}",
        )
        print(f"exponent of a {label}: {exponent:.3f}")
    print(
        f"memory: {(memory[-1] - memory[0]) * 2**20 / (dofs[-1] - dofs[0]):.0f} bytes per unknown"
    )
    for axes, label in ((left, unit), (right, "memory [MB]")):
        axes.set(xlabel="unknowns", ylabel=label)
        axes.grid(which="both", alpha=0.3)
        axes.legend()
    figure.savefig(path)
