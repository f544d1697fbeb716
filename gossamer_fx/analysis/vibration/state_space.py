"""A structure about an equilibrium as a linear system, for programs of attitude and control.

With the modal coordinates q of the n modes, inputs u and outputs y,

    z = (q, dq/dt),    dz/dt = A z + B u,    y = y_rest + C z + D u                              (1)

    A = [[0, 1], [-Ω², -Δ]],    B = [[0], [Φᵀ F]],    C = [∂y/∂x Φ, ∂y/∂v Φ]                     (2)

F are the forces of a unit of each input.  Δ has the dampers of the scene and 2 ζ ω of each mode; a
loss factor η counts as ζ = η/2, with which it agrees at the resonance of each mode.  D is the
static response of what is beyond the modes, so that slow inputs act exactly.

The step of a linear system with an input that is constant during it is exact for every length,

    z(t + h) = exp(A h) z(t) + ∫ exp(A s) ds B u,                                                (3)

both by one exponential of a matrix with the rows A and B.  `StateSpace.write_fmu` writes a unit for
co-simulation (FMI 2.0) that makes this step, as C code without other libraries.

Source of the interface: Functional Mock-up Interface for Model Exchange and Co-Simulation, version
2.0.2 (Modelica Association, 2020).
"""

from __future__ import annotations

import hashlib
import re
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any
from xml.sax.saxutils import quoteattr

import numpy as np
from scipy.linalg import expm

from gossamer_fx.analysis.statics.equilibrium import Equilibrium
from gossamer_fx.analysis.vibration.modal_model import ModalModel
from gossamer_fx.analysis.vibration.natural_modes import Mode
from gossamer_fx.core.checks.arguments import (
    at_least,
    check_arguments,
    collective,
    ends_in,
    not_negative,
    positive,
)
from gossamer_fx.core.checks.errors import check, output_failures
from gossamer_fx.core.checks.lookups import check_once
from gossamer_fx.core.checks.relations import some
from gossamer_fx.core.checks.short_repr import short_repr
from gossamer_fx.core.laws.law import build_library
from gossamer_fx.core.model.body import Array, Vector
from gossamer_fx.records.probes.objective import Objective
from gossamer_fx.version import VERSION

# The C code of a unit, before which its numbers are defined.
SOURCE = Path(__file__).parent / "fmu.c"


@check_arguments
@dataclass(frozen=True, eq=False)
class StateSpace:
    """A linear system dz/dt = A z + B u, y = y_rest + C z + D u.

    Attributes:
        A: (2n, 2n), B: (2n, m), C: (k, 2n), D: (k, m) of n modes, m inputs, k outputs; in the units
            of inputs, outputs and seconds, and of modes of unit modal mass.
        at_rest: y_rest (k,), the outputs in the equilibrium.
        inputs: names (m,).
        outputs: names (k,).

    Example:
        >>> A = np.array([[0.0, 1.0], [-4.0, 0.0]])
        >>> B, C, D = np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]]), np.zeros((1, 1))
        >>> system = gx.analysis.StateSpace(A, B, C, D, np.zeros(1), ("force",), ("z",))
        >>> y = system.simulate(np.full((4, 1), 4.0), dt=np.pi / 4)
        >>> y[:, 0].round(6).tolist()
        [0.0, 1.0, 2.0, 1.0]
    """

    A: Array
    B: Array
    C: Array
    D: Array
    at_rest: Array
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    __repr__ = short_repr

    @check_arguments
    def simulate(
        self, u: Array, *, dt: Annotated[float, positive("s")], start: Array | None = None
    ) -> Array:
        """Outputs (s, k) at the starts of s steps with the inputs u (s, m), each constant during
        its step, exactly; `start` is z (2n,), by default the equilibrium.

        Args:
            u: inputs of the steps.
            dt: their length [s].
            start: state at the start of the first step.

        Raises:
            InputError: another number of inputs, or of states.
        """
        n, m = self.B.shape
        check(
            u.ndim == 2 and u.shape[1] == m,
            f"StateSpace: u has the shape {u.shape}; give a row of {m} numbers for each step.",
        )
        z = np.zeros(n) if start is None else start.astype(float)
        check(z.shape == (n,), f"StateSpace: start has the shape {z.shape}; give {n} numbers.")
        step = expm(dt * np.block([[self.A, self.B], [np.zeros((m, n + m))]]))
        found = np.zeros((len(u), len(self.outputs)))
        for k, now in enumerate(u):
            found[k] = self.at_rest + self.C @ z + self.D @ now
            z = step[:n, :n] @ z + step[:n, n:] @ now
        return found

    @check_arguments
    def save(self, path: str | Path) -> None:
        """Write all arrays and names to a file of NumPy (`.npz`), for other programs; on several
        ranks call it on one.

        Args:
            path: of the file.

        Raises:
            OutputFailure: the file cannot be written.
        """
        path = Path(path)
        with output_failures(path):
            np.savez(path, **vars(self))

    @check_arguments
    def write_fmu(self, path: Annotated[str | Path, ends_in(".fmu")]) -> None:
        """Write a unit for co-simulation, FMI 2.0, for the machine that this runs on; on several
        ranks call it on one.

        Its inputs are held during a step of the master, whose length is free; its outputs are those
        at the end of the step.

        Args:
            path: of the file, ending in `.fmu`.

        Raises:
            InputError: the path does not end in `.fmu`, or there is no C compiler.
            OutputFailure: the file cannot be written.
        """
        path = Path(path)
        identifier = "gossamer_" + (re.sub(r"\W", "_", path.stem) or "unit")
        text = self._c_text()
        with tempfile.TemporaryDirectory() as folder:
            library = Path(folder) / f"{identifier}.so"
            build_library(text, library, ("-fPIC", "-O2"))
            with output_failures(path), zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as unit:
                unit.writestr("modelDescription.xml", self._description(identifier))
                unit.writestr(f"sources/{identifier}.c", text)
                unit.write(library, f"binaries/linux64/{identifier}.so")

    def _guid(self) -> str:
        """A name of the numbers, which the description and the library have in common."""
        arrays = (self.A, self.B, self.C, self.D, self.at_rest)
        numbers = b"".join(np.ascontiguousarray(array, dtype=float).tobytes() for array in arrays)
        return hashlib.sha256(numbers + repr((self.inputs, self.outputs)).encode()).hexdigest()[:32]

    def _c_text(self) -> str:
        """The C code of the unit."""

        def numbers(array: Array) -> str:
            # C has no empty arrays.
            values = [repr(float(value)) for value in np.ravel(array)] or ["0.0"]
            return "{" + ", ".join(values) + "}"

        defined = {
            "STATES": len(self.A),
            "INPUTS": len(self.inputs),
            "OUTPUTS": len(self.outputs),
            "A_VALUES": numbers(self.A),
            "B_VALUES": numbers(self.B),
            "C_VALUES": numbers(self.C),
            "D_VALUES": numbers(self.D),
            "REST_VALUES": numbers(self.at_rest),
            "GUID": f'"{self._guid()}"',
        }
        lines = [f"#define {name} {value}" for name, value in defined.items()]
        return "\n".join([*lines, SOURCE.read_text()])

    def _description(self, identifier: str) -> str:
        """The file modelDescription.xml of the unit; inputs come first in its variables."""
        lines = [
            '<?xml version="1.0" encoding="UTF-8"?>',
            f'<fmiModelDescription fmiVersion="2.0" modelName="{identifier}" guid="{self._guid()}" '
            f'generationTool="gossamer_fx {VERSION}" numberOfEventIndicators="0">',
            f'<CoSimulation modelIdentifier="{identifier}" '
            'canHandleVariableCommunicationStepSize="true"/>',
            "<ModelVariables>",
        ]
        named = [(name, "input") for name in self.inputs]
        named += [(name, "output") for name in self.outputs]
        for number, (name, causality) in enumerate(named):
            start = ' start="0.0"' if causality == "input" else ""
            lines.append(
                f'<ScalarVariable name={quoteattr(name)} valueReference="{number}" '
                f'causality="{causality}" variability="continuous"><Real{start}/></ScalarVariable>'
            )
        first = len(self.inputs) + 1
        unknowns = [f'<Unknown index="{first + k}"/>' for k in range(len(self.outputs))]
        lines += [
            "</ModelVariables>",
            "<ModelStructure>",
            f"<Outputs>{''.join(unknowns)}</Outputs>",
            f"<InitialUnknowns>{''.join(unknowns)}</InitialUnknowns>",
            "</ModelStructure>",
            "</fmiModelDescription>",
        ]
        return "\n".join(lines)


@check_arguments(some("loads", "base_acceleration"))
@collective
def state_space(
    equilibrium: Equilibrium,
    modes: Annotated[Sequence[Mode], at_least(1)],
    *,
    of: Annotated[Mapping[str, Objective], at_least(1)],
    loads: Mapping[str, Sequence[Any]] = {},
    base_acceleration: Mapping[str, Vector] = {},
    loss_factor: Annotated[float, not_negative()] = 0.0,
    damping_ratio: Annotated[float, not_negative()] | Sequence[float] = 0.0,
) -> StateSpace:
    """An equilibrium as a linear system in the coordinates of its modes, for programs of attitude
    and control.

    Args:
        equilibrium: as in `harmonic_response`.
        modes: as in `harmonic_response`.
        of: outputs by name, probes with derivatives as in `harmonic_response`.
        loads: inputs by name, each with the loads of its unit, e.g. {"thrust [N]":
            [gx.loads.Force(port, (0, 0, 1))]}.
        base_acceleration: more inputs by name, each with an acceleration of the ground [m/s²] of
            its unit, (3,); outputs are then seen from the ground.
        loss_factor: η, as damping ratios η/2.
        damping_ratio: ζ of all modes, or of each.

    Raises:
        InputError: no input, one name twice, or as in `harmonic_response`.

    Example:
        >>> weight = gx.Gravity(mass, (0.0, 0.0, -10.0))
        >>> top = gx.Ground((0.0, 0.0, 0.0))
        >>> spring = gx.connectors.Spring(mass.port(), top, stiffness=100.0, length=1.0)
        >>> equilibrium = gx.Equilibrium(gx.Scene(weight, spring))
        >>> result = equilibrium.find()
        >>> system = gx.analysis.state_space(
        ...     equilibrium,
        ...     gx.analysis.modes(equilibrium, 3),
        ...     of={"z [m]": gx.probes.Position(mass.port(), "z")},
        ...     loads={"force [N]": [gx.loads.Force(mass.port(), (0.0, 0.0, 1.0))]},
        ... )
        >>> slow = system.D - system.C @ np.linalg.solve(system.A, system.B)
        >>> system.A.shape, slow.round(6).tolist()
        ((6, 6), [[0.01]])
    """
    what = "state_space"
    model = ModalModel(
        equilibrium, modes, loss_factor=loss_factor, damping_ratio=damping_ratio, what=what
    )
    inputs = (*loads, *base_acceleration)
    names = [*inputs, *of]
    check_once(f"{what}: the name", names)
    forces = [model.forces_of(given) for given in loads.values()]
    forces += [model.inertia_of(model.translation(given)) for given in base_acceleration.values()]
    linear = model.linear(np.array(forces).T, list(of.values()))
    n = len(modes)
    zero = np.zeros((n, n))
    return StateSpace(
        A=np.block([[zero, np.eye(n)], [-np.diag(linear.squares), -linear.damping]]),
        B=np.vstack([np.zeros((n, len(inputs))), linear.forces]),
        C=np.hstack([linear.by_position, linear.by_velocity]),
        D=linear.beyond,
        at_rest=np.array([float(probe(equilibrium)) for probe in of.values()]),
        inputs=inputs,
        outputs=tuple(of),
    )
