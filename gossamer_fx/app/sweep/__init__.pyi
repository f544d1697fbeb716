from .factorial import Factorial as Factorial
from .robust_design import RobustDesign as RobustDesign
