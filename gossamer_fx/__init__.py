"""gossamer_fx: films that wrinkle, inflatables and what holds them, moved with exact conservation.

The public names are listed in `__init__.pyi`: core names, e.g. `gx.Scene`, and namespaces, e.g.
`gx.gas`, each with a list of its own.  A name is imported when it is used.
"""

from gossamer_fx.checks.lazy_names import lazy_names
from gossamer_fx.checks.lone_errors import watch_uncaught_errors
from gossamer_fx.version import VERSION

__version__ = VERSION
__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)

from gossamer_fx.checks.lone_errors import watch_uncaught_errors as _watch_uncaught_errors
from gossamer_fx.version import VERSION as __version__

if TYPE_CHECKING:
    from gossamer_fx import fold as fold
    from gossamer_fx.analysis.crease_identification import HangingStrip as HangingStrip
    from gossamer_fx.analysis.crease_identification import IdentifiedCrease as IdentifiedCrease
    from gossamer_fx.analysis.crease_identification import identify_crease as identify_crease
    from gossamer_fx.analysis.equilibrium import Continuation as Continuation
    from gossamer_fx.analysis.equilibrium import Equilibrium as Equilibrium
    from gossamer_fx.analysis.equilibrium import EquilibriumResult as EquilibriumResult
    from gossamer_fx.analysis.form_finding import EdgeCable as EdgeCable
    from gossamer_fx.analysis.form_finding import Prestress as Prestress
    from gossamer_fx.analysis.form_finding import find_form as find_form
    from gossamer_fx.analysis.mode_shapes import ModeShapes as ModeShapes
    from gossamer_fx.analysis.modes import Mode as Mode
    from gossamer_fx.analysis.modes import modes as modes
    from gossamer_fx.assemblies.inflatable_tube import InflatableTube as InflatableTube
    from gossamer_fx.assemblies.lidded_box import LiddedBox as LiddedBox
    from gossamer_fx.assemblies.rotation_guides import RotationGuides as RotationGuides
    from gossamer_fx.bodies.beam import Beam as Beam
    from gossamer_fx.bodies.cable import Cable as Cable
    from gossamer_fx.bodies.cable import CableLaw as CableLaw
    from gossamer_fx.bodies.cable import TensionOnly as TensionOnly
    from gossamer_fx.bodies.frames import Frame as Frame
    from gossamer_fx.bodies.frames import ground_frame as ground_frame
    from gossamer_fx.bodies.membrane import Membrane as Membrane
    from gossamer_fx.bodies.plate import Plate as Plate
    from gossamer_fx.bodies.point_mass import PointMass as PointMass
    from gossamer_fx.bodies.rigid_body import RigidBody as RigidBody
    from gossamer_fx.bodies.sections import Section as Section
    from gossamer_fx.bodies.sections import rectangle as rectangle
    from gossamer_fx.bodies.sections import solid_circle as solid_circle
    from gossamer_fx.bodies.sections import tube as tube
    from gossamer_fx.checks.errors import InputError as InputError
    from gossamer_fx.checks.errors import NoEquilibrium as NoEquilibrium
    from gossamer_fx.checks.errors import OutputFailure as OutputFailure
    from gossamer_fx.checks.errors import StepFailure as StepFailure
    from gossamer_fx.cli.case import Case as Case
    from gossamer_fx.connectors.attached_mass import AttachedMass as AttachedMass
    from gossamer_fx.connectors.crease import Crease as Crease
    from gossamer_fx.connectors.rope_bundle import RopeBundle as RopeBundle
    from gossamer_fx.connectors.spring import AxialSpring as AxialSpring
    from gossamer_fx.connectors.spring import Damper as Damper
    from gossamer_fx.connectors.spring import Rope as Rope
    from gossamer_fx.connectors.spring import Spring as Spring
    from gossamer_fx.connectors.spring import Stop as Stop
    from gossamer_fx.connectors.tape import Tape as Tape
    from gossamer_fx.connectors.tether import Tether as Tether
    from gossamer_fx.connectors.torsion import TorsionDamper as TorsionDamper
    from gossamer_fx.connectors.torsion import TorsionSpring as TorsionSpring
    from gossamer_fx.constraints.clamped import Clamped as Clamped
    from gossamer_fx.constraints.clamped_edge import ClampedEdge as ClampedEdge
    from gossamer_fx.constraints.driven import Driven as Driven
    from gossamer_fx.constraints.fixed import Fixed as Fixed
    from gossamer_fx.constraints.fixed import Prescribed as Prescribed
    from gossamer_fx.constraints.joint import BallJoint as BallJoint
    from gossamer_fx.constraints.joint import CylindricalJoint as CylindricalJoint
    from gossamer_fx.constraints.joint import FixedJoint as FixedJoint
    from gossamer_fx.constraints.joint import Link as Link
    from gossamer_fx.constraints.joint import PrismaticJoint as PrismaticJoint
    from gossamer_fx.constraints.joint import RevoluteJoint as RevoluteJoint
    from gossamer_fx.constraints.rigid_region import RigidRegion as RigidRegion
    from gossamer_fx.constraints.tie import Tie as Tie
    from gossamer_fx.contact.contact import Contact as Contact
    from gossamer_fx.contact.obstacles import Box as Box
    from gossamer_fx.contact.obstacles import Cylinder as Cylinder
    from gossamer_fx.contact.obstacles import Plane as Plane
    from gossamer_fx.contact.obstacles import Sphere as Sphere
    from gossamer_fx.control.attitude import AttitudeControl as AttitudeControl
    from gossamer_fx.control.attitude import patch as patch
    from gossamer_fx.fields.values import field_values as field_values
    from gossamer_fx.fields.values import positions as positions
    from gossamer_fx.gas.enclosure import Piston as Piston
    from gossamer_fx.gas.ideal_gas import IdealGas as IdealGas
    from gossamer_fx.gas.orifice import Orifice as Orifice
    from gossamer_fx.gas.orifice import WallHeat as WallHeat
    from gossamer_fx.gas.ring import Ring as Ring
    from gossamer_fx.gas.volumes import Ambient as Ambient
    from gossamer_fx.gas.volumes import Chamber as Chamber
    from gossamer_fx.gas.volumes import Reservoir as Reservoir
    from gossamer_fx.gas.volumes import Tank as Tank
    from gossamer_fx.loads.air_drag import AirDrag as AirDrag
    from gossamer_fx.loads.centrifugal import Centrifugal as Centrifugal
    from gossamer_fx.loads.damping import Damping as Damping
    from gossamer_fx.loads.edge_load import EdgeLoad as EdgeLoad
    from gossamer_fx.loads.edge_moment import EdgeMoment as EdgeMoment
    from gossamer_fx.loads.force import Force as Force
    from gossamer_fx.loads.force import Torque as Torque
    from gossamer_fx.loads.gravity import Gravity as Gravity
    from gossamer_fx.loads.pressure import Pressure as Pressure
    from gossamer_fx.materials.elastica import Elastica as Elastica
    from gossamer_fx.materials.film import Linear as Linear
    from gossamer_fx.materials.film import Miyazaki as Miyazaki
    from gossamer_fx.materials.film import TensionField as TensionField
    from gossamer_fx.mesh.mesh import Mesh as Mesh
    from gossamer_fx.mesh.mesh import gmsh_mesh as gmsh_mesh
    from gossamer_fx.mesh.mesh import read_mesh as read_mesh
    from gossamer_fx.model.terms import Ground as Ground
    from gossamer_fx.model.terms import Port as Port
    from gossamer_fx.orbit.drag import Drag as Drag
    from gossamer_fx.orbit.drag import ExponentialAtmosphere as ExponentialAtmosphere
    from gossamer_fx.orbit.elements import Elements as Elements
    from gossamer_fx.orbit.free_molecular import Accommodation as Accommodation
    from gossamer_fx.orbit.free_molecular import Air as Air
    from gossamer_fx.orbit.magnetic_dipole import MagneticDipole as MagneticDipole
    from gossamer_fx.orbit.optics import Optics as Optics
    from gossamer_fx.orbit.orbit import Orbit as Orbit
    from gossamer_fx.orbit.solar_pressure import SolarPressure as SolarPressure
    from gossamer_fx.orbit.surface_forces import Surface as Surface
    from gossamer_fx.outputs.ledger import Ledger as Ledger
    from gossamer_fx.outputs.progress import Progress as Progress
    from gossamer_fx.outputs.recording import Recording as Recording
    from gossamer_fx.outputs.series import Series as Series
    from gossamer_fx.outputs.vtx import VTX as VTX
    from gossamer_fx.outputs.vtx import Probes as Probes
    from gossamer_fx.plot.flight_picture import FlightPicture as FlightPicture
    from gossamer_fx.plot.picture import Picture as Picture
    from gossamer_fx.plot.plot import animate as animate
    from gossamer_fx.plot.plot import plot_curves as plot_curves
    from gossamer_fx.plot.plot import plot_field as plot_field
    from gossamer_fx.plot.plot import plot_strip as plot_strip
    from gossamer_fx.plot.report import write_report as write_report
    from gossamer_fx.plot.run_reader import RunReader as RunReader
    from gossamer_fx.plot.viewpoint import View as View
    from gossamer_fx.probes.contact import ContactForce as ContactForce
    from gossamer_fx.probes.contact import ContactGap as ContactGap
    from gossamer_fx.probes.contact import Penetrations as Penetrations
    from gossamer_fx.probes.crease_angle import FoldAngle as FoldAngle
    from gossamer_fx.probes.crossings import Crossings as Crossings
    from gossamer_fx.probes.flight import Attitude as Attitude
    from gossamer_fx.probes.flight import LoadResultant as LoadResultant
    from gossamer_fx.probes.flight import OrbitState as OrbitState
    from gossamer_fx.probes.flight import SunAngle as SunAngle
    from gossamer_fx.probes.points import AngularVelocity as AngularVelocity
    from gossamer_fx.probes.points import AreaFraction as AreaFraction
    from gossamer_fx.probes.points import Displacement as Displacement
    from gossamer_fx.probes.points import GasState as GasState
    from gossamer_fx.probes.points import JointForce as JointForce
    from gossamer_fx.probes.points import Position as Position
    from gossamer_fx.probes.points import RingArea as RingArea
    from gossamer_fx.probes.points import Velocity as Velocity
    from gossamer_fx.probes.spin import MeanSpin as MeanSpin
    from gossamer_fx.probes.spin import PolarPosition as PolarPosition
    from gossamer_fx.reduction.outside_basis import OutsideBasis as OutsideBasis
    from gossamer_fx.reduction.recorded_shapes import RecordedShapes as RecordedShapes
    from gossamer_fx.reduction.reduce import reduce as reduce
    from gossamer_fx.reduction.snapshots import Snapshots as Snapshots
    from gossamer_fx.run.checkpoint import Checkpoints as Checkpoints
    from gossamer_fx.run.checkpoint import latest as latest
    from gossamer_fx.run.events import At as At
    from gossamer_fx.run.events import When as When
    from gossamer_fx.run.interruption import Interrupted as Interrupted
    from gossamer_fx.run.log import log_to as log_to
    from gossamer_fx.run.simulation import Simulation as Simulation
    from gossamer_fx.scene.initial import RigidMotion as RigidMotion
    from gossamer_fx.scene.initial import StartFrom as StartFrom
    from gossamer_fx.scene.scene import Scene as Scene
    from gossamer_fx.solvers.tolerances import Tolerances as Tolerances
    from gossamer_fx.steppers.generalized_alpha import GeneralizedAlpha as GeneralizedAlpha
    from gossamer_fx.steppers.midpoint import Midpoint as Midpoint
    from gossamer_fx.steppers.step_control import StepControl as StepControl
    from gossamer_fx.sweep.robust_design import RobustDesign as RobustDesign
    from gossamer_fx.terms.discrete_gradient import EndPoint as EndPoint
    from gossamer_fx.terms.discrete_gradient import PathAverage as PathAverage

_HOME = {
    "bodies.beam": ["Beam"],
    "bodies.cable": ["Cable", "CableLaw", "TensionOnly"],
    "bodies.membrane": ["Membrane"],
    "bodies.plate": ["Plate"],
    "bodies.point_mass": ["PointMass"],
    "bodies.rigid_body": ["RigidBody"],
    "bodies.sections": ["Section", "rectangle", "solid_circle", "tube"],
    "assemblies.inflatable_tube": ["InflatableTube"],
    "assemblies.lidded_box": ["LiddedBox"],
    "assemblies.rotation_guides": ["RotationGuides"],
    "cli.case": ["Case"],
    "control.attitude": ["AttitudeControl", "patch"],
    "terms.discrete_gradient": ["EndPoint", "PathAverage"],
    "materials.elastica": ["Elastica"],
    "checks.errors": ["InputError", "NoEquilibrium", "OutputFailure", "StepFailure"],
    "analysis.form_finding": ["EdgeCable", "Prestress", "find_form"],
    "bodies.frames": ["Frame", "ground_frame"],
    "gas.enclosure": ["Piston"],
    "gas.ideal_gas": ["IdealGas"],
    "gas.orifice": ["Orifice", "WallHeat"],
    "gas.ring": ["Ring"],
    "gas.volumes": ["Ambient", "Chamber", "Reservoir", "Tank"],
    "steppers.generalized_alpha": ["GeneralizedAlpha"],
    "scene.initial": ["RigidMotion", "StartFrom"],
    "contact.contact": ["Contact"],
    "probes.contact": ["ContactForce", "ContactGap", "Penetrations"],
    "contact.obstacles": ["Box", "Cylinder", "Plane", "Sphere"],
    "connectors.attached_mass": ["AttachedMass"],
    "constraints.clamped": ["Clamped"],
    "constraints.clamped_edge": ["ClampedEdge"],
    "connectors.crease": ["Crease"],
    "constraints.driven": ["Driven"],
    "constraints.fixed": ["Fixed", "Prescribed"],
    "constraints.joint": [
        "BallJoint",
        "CylindricalJoint",
        "FixedJoint",
        "Link",
        "PrismaticJoint",
        "RevoluteJoint",
    ],
    "constraints.rigid_region": ["RigidRegion"],
    "connectors.rope_bundle": ["RopeBundle"],
    "connectors.spring": ["AxialSpring", "Damper", "Rope", "Spring", "Stop"],
    "connectors.tape": ["Tape"],
    "connectors.tether": ["Tether"],
    "constraints.tie": ["Tie"],
    "connectors.torsion": ["TorsionDamper", "TorsionSpring"],
    "loads.air_drag": ["AirDrag"],
    "loads.centrifugal": ["Centrifugal"],
    "loads.damping": ["Damping"],
    "loads.edge_load": ["EdgeLoad"],
    "loads.edge_moment": ["EdgeMoment"],
    "loads.force": ["Force", "Torque"],
    "loads.gravity": ["Gravity"],
    "loads.pressure": ["Pressure"],
    "materials.film": ["Linear", "Miyazaki", "TensionField"],
    "mesh.mesh": ["Mesh", "gmsh_mesh", "read_mesh"],
    "steppers.midpoint": ["Midpoint"],
    "solvers.tolerances": ["Tolerances"],
    "model.terms": ["Ground", "Port"],
    "plot.picture": ["Picture"],
    "plot.run_reader": ["RunReader"],
    "plot.plot": ["animate", "plot_curves", "plot_field", "plot_strip"],
    "plot.viewpoint": ["View"],
    "plot.report": ["write_report"],
    "orbit.elements": ["Elements"],
    "orbit.drag": ["Drag", "ExponentialAtmosphere"],
    "orbit.free_molecular": ["Accommodation", "Air"],
    "orbit.magnetic_dipole": ["MagneticDipole"],
    "orbit.optics": ["Optics"],
    "orbit.solar_pressure": ["SolarPressure"],
    "orbit.surface_forces": ["Surface"],
    "orbit.orbit": ["Orbit"],
    "probes.crossings": ["Crossings"],
    "probes.flight": ["Attitude", "LoadResultant", "OrbitState", "SunAngle"],
    "plot.flight_picture": ["FlightPicture"],
    "outputs.ledger": ["Ledger"],
    "probes.crease_angle": ["FoldAngle"],
    "probes.points": [
        "AngularVelocity",
        "AreaFraction",
        "Displacement",
        "GasState",
        "JointForce",
        "Position",
        "RingArea",
        "Velocity",
    ],
    "probes.spin": ["MeanSpin", "PolarPosition"],
    "fields.values": ["field_values", "positions"],
    "outputs.progress": ["Progress"],
    "outputs.vtx": ["VTX", "Probes"],
    "outputs.recording": ["Recording"],
    "outputs.series": ["Series"],
    "reduction.outside_basis": ["OutsideBasis"],
    "reduction.recorded_shapes": ["RecordedShapes"],
    "reduction.snapshots": ["Snapshots"],
    "reduction.reduce": ["reduce"],
    "run.checkpoint": ["Checkpoints", "latest"],
    "sweep.robust_design": ["RobustDesign"],
    "run.events": ["At", "When"],
    "run.interruption": ["Interrupted"],
    "run.log": ["log_to"],
    "steppers.step_control": ["StepControl"],
    "scene.scene": ["Scene"],
    "run.simulation": ["Simulation"],
    "analysis.crease_identification": ["HangingStrip", "IdentifiedCrease", "identify_crease"],
    "analysis.equilibrium": ["Continuation", "Equilibrium", "EquilibriumResult"],
    "analysis.mode_shapes": ["ModeShapes"],
    "analysis.modes": ["Mode", "modes"],
}
_MODULE = {name: module for module, names in _HOME.items() for name in names}
_ROOMS = ["fold"]  # whose names are asked of them: gx.fold.zigzag
__all__ = sorted([*_MODULE, *_ROOMS])
_FOUND = {
    "dolfinx",
    "basix",
    "ufl",
    "petsc4py",
    "mpi4py",
}  # not installed with this package, but found

_watch_uncaught_errors()


def __getattr__(name: str) -> Any:
    if name in _ROOMS:
        return import_module(f"gossamer_fx.{name}")
    if name not in _MODULE:
        raise AttributeError(f"gossamer_fx has no '{name}'; its names are: {', '.join(__all__)}")
    from gossamer_fx.checks.arguments import guarded

    try:
        home = import_module(f"gossamer_fx.{_MODULE[name]}")
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] not in _FOUND:
            raise
        raise ImportError(
            f"gossamer_fx {__version__} needs {error.name}, which this Python has not: use one with dolfinx, petsc4py, "
            "mpi4py and gmsh, or pip install 'gossamer_fx[light]'."
        ) from error
    thing = globals()[name] = guarded(getattr(home, name), _MODULE)
    return thing


def __dir__() -> list[str]:
    return __all__
