from .fields import field_values as field_values
from .fields import positions as positions
