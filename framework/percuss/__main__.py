"""Run the command line as ``python -m percuss``, or as the script ``percuss``."""

import os
import sys


def main() -> None:
    """Run the command line; this process is prepared before the rest of percuss is imported."""
    # Python puts the folder of the script first on the path: nothing in it is to be imported, pathlib neither.
    folder = os.path.dirname(os.path.realpath(sys.argv[0]))  # noqa: PTH120
    if not sys.flags.safe_path and os.path.realpath(sys.path[0]) == folder:
        del sys.path[0]
    from percuss.process import INTERRUPTED, begin

    begin()
    try:
        from percuss.cli.main import main as run

        run()
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main()
