"""Which rows of a test are deep."""

import pytest


def deep(*row, **more):
    """Return a row of a parametrised test that only the deep run takes."""
    return pytest.param(*row, marks=pytest.mark.deep, **more)
