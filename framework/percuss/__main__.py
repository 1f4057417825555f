"""Run the command line as ``python -m percuss``, or as the script ``percuss``."""

import os


def main() -> None:
    """Run the command line; this process is prepared before the rest of percuss is imported."""
    try:
        from percuss.process import begin

        begin()
    except KeyboardInterrupt:
        os.write(2, b"interrupted\n")
        os._exit(130)
    from percuss.cli.main import main as run

    run()


if __name__ == "__main__":
    main()
