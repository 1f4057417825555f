"""Run the command line as ``python -m percuss``."""

from percuss.cli.main import main

main()
