from .factorial import Factorial as Factorial
from .factorial import run_factorial as run_factorial
