"""The slots a compiled step may call."""
from typing import Any
def stress(parameters: Any, strain: float) -> float:
    raise NotImplementedError
def energy_density(parameters: Any, before: float, after: float) -> float:
    raise NotImplementedError
