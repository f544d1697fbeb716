from .robust_design import RobustDesign as RobustDesign
