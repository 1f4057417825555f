"""Profiles of hypothesis (HYPOTHESIS_PROFILE): a repeatable quick one, a larger one, and a long one that draws anew.

Marks: `deep` and `nightly` tests are left out unless asked for (``-m deep``), `slow` ones take more than some seconds.
"""

import gc
import os
import shutil

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # the matrices are small: threads cost more than they bring

import pytest
from hypothesis import HealthCheck, find, settings
from hypothesis.internal.conjecture import providers
from hypothesis.strategies import booleans

# Tests, types and compiled functions are many objects that stay: the search for garbage among them takes long.
gc.set_threshold(50_000)

for name, count in {"quick": 8, "ci": 80, "deep": 1000}.items():
    settings.register_profile(
        name, max_examples=count, derandomize=name != "deep", deadline=None, print_blob=True,
        suppress_health_check=[HealthCheck.too_slow],
    )  # fmt: skip
PROFILE = os.environ.get("HYPOTHESIS_PROFILE", "quick")
settings.load_profile(PROFILE)


@pytest.fixture(autouse=True, scope="session")
def repeatable_draws():
    """Draw the same wherever percuss is installed and whatever is loaded, but in the profile that draws anew.

    Hypothesis draws constants that it finds in the modules that are loaded; versions below 6.131 draw none.
    """
    with pytest.MonkeyPatch.context() as patch:
        if PROFILE != "deep":
            patch.setattr(providers.HypothesisProvider, "_maybe_draw_constant", lambda *_, **__: None, raising=False)
        yield


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Mark deep and nightly tests as slow ones too, so that ``-m "not slow"`` is the quick subset."""
    for item in items:
        if item.get_closest_marker("deep") or item.get_closest_marker("nightly"):
            item.add_marker("slow")


def pytest_collection_finish():
    """Leave out of every later search for garbage what is there before the first test.

    Hypothesis makes its source of random numbers in its first draw, and some versions ask the search who refers to it:
    a module that is left out would be missed.
    """
    find(booleans(), bool, settings=settings(database=None))
    gc.collect()
    gc.freeze()


def pytest_xdist_auto_num_workers(config):
    """Return the number of processors: a worker more waits less for other processes, but compiles all once more."""
    return os.cpu_count() or 1


CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


@pytest.fixture(scope="module")
def browser():
    sync_api = pytest.importorskip("playwright.sync_api", reason="the page is opened by playwright")
    if CHROMIUM is None:
        pytest.skip("the page is opened in Chromium, which is not installed")
    with sync_api.sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield opened
        opened.close()


@pytest.fixture
def loop_anew():
    """Forget bound kernels before and after a test that plants a defect in the loop; yield what forgets them."""
    from percuss.step import build

    def forget():
        for bound in (build._plain, build._entrance, build._loop):
            bound.cache_clear()

    forget()
    yield forget
    forget()
