"""Version of percuss, and version of the contract that plug-ins rely on."""

__version__ = "0.1.0"
CONTRACT = 2
