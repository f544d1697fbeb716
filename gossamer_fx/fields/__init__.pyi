from .values import field_values as field_values
from .values import positions as positions
