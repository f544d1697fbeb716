from .inflatable_tube import InflatableTube as InflatableTube
