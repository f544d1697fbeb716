from .factorial import Factorial as Factorial
