from .inflatable_tube import InflatableTube as InflatableTube
from .lidded_box import LiddedBox as LiddedBox
from .rotation_guides import RotationGuides as RotationGuides
