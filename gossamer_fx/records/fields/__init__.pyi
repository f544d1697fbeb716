from .lines import LineValues as LineValues
from .lines import line_values as line_values
from .values import field_values as field_values
from .values import positions as positions
