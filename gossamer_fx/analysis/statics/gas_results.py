"""Results of gas for gradients; apart from the others, so that scenes without gas do not load
it."""

from gossamer_fx.analysis.sensitivity.gas_objectives import ChamberPressure as ChamberPressure
