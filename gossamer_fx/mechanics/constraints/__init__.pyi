from .fixed import Driven as Driven
from .joint import BallJoint as BallJoint
from .joint import CylindricalJoint as CylindricalJoint
from .joint import FixedJoint as FixedJoint
from .joint import Link as Link
from .joint import PrismaticJoint as PrismaticJoint
from .joint import RevoluteJoint as RevoluteJoint
