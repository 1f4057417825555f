"""Run the command line as ``python -m percuss``."""

from percuss.cli import main

main()
