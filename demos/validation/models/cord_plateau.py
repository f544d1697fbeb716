"""The plateau of the load of a braided tube in four-point bending, when the cords on the pressed
side are slack.

The wall of a tube braided near the angle at which it resists no axial force bears nothing along the
axis; axial cords bear the force of the pressure.  When those on the pressed side are slack, the
others bear all of it, 3 F_c for three cords of force F_c after inflation.  The moment is that of
this force about the axis of the tube,

    M = 3 F_c r/2      one cord on the loaded side, two pulling r/2 below the axis
    M = 3 F_c r        two cords on the loaded side, one pulling r below the axis

and the load of both points is 2 M/a, with a the distance between load and support.
"""

from __future__ import annotations

from collections.abc import Mapping

from mpi4py import MPI

from demos.validation.engine.case import Inputs
from demos.validation.engine.comparison import Predicted, Prediction

# Distance of the pulling cords from the axis over the radius, by the number of cords on the loaded
# side.
LEVER_RATIOS = {"1": 0.5, "2": 1.0}


def predict(inputs: Inputs, comm: MPI.Intracomm, quick: bool) -> Prediction:
    """The total load [N] of the plateau; the quick form is the same."""
    diameter = inputs.number("diameter", "m", above=0)
    radius = diameter / 2
    cords_up = inputs.word(
        "cords_up",
        choices=tuple(LEVER_RATIOS),
    )
    lever_ratio = LEVER_RATIOS[cords_up]
    cord_force = inputs.number("cord_force", "N", above=0)
    arm = inputs.number("arm", "m", above=0)
    moment = 3 * cord_force * radius * lever_ratio
    load = 2 * moment / arm
    quantities = {"plateau load": Predicted(load)}
    return Prediction(quantities)


def gradients(inputs: Inputs, prediction: Prediction) -> Mapping[str, Mapping[str, Predicted]]:
    """Exact derivatives of the load by the inputs, of which it is a product of powers."""
    load = float(prediction.quantities["plateau load"].y)
    powers = {"diameter": ("m", 1), "cord_force": ("N", 1), "arm": ("m", -1)}
    return {
        "plateau load": {
            name: Predicted(power * load / inputs.number(name, unit))
            for name, (unit, power) in powers.items()
        }
    }
