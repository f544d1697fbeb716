from .fields import field_values as field_values
from .fields import positions as positions
from .lines import LineValues as LineValues
from .lines import line_values as line_values
