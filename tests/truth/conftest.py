"""A scheme that does not come with percuss: the one of the page of integrators."""

import pytest

import places
from percuss.methods.registry import Registry


@pytest.fixture(scope="session")
def registry(tmp_path_factory):
    """The methods that come with percuss, and the scheme that stands in the page of integrators."""
    text = (places.ROOT / "plugins" / "INTEGRATOR.md").read_text(encoding="utf-8").split("`force_gradient.py`:")[1]
    file = tmp_path_factory.mktemp("scheme") / "force_gradient.py"
    file.write_text(text.split("```python\n")[1].split("```")[0], encoding="utf-8")
    return Registry.load([file])
