"""The same case gives the same bits: whatever ran before it, beside it, or around it."""

import threading

import numpy as np
import pytest
import scipy.linalg  # noqa: F401 - a library of BLAS of its own
from threadpoolctl import ThreadpoolController, threadpool_limits

import percuss
import places
from percuss import blas
from strategies import hunek

LONG = {"refine": 150, "time.end": None, "time.steps": 5}  # sums of more than ten thousand terms
DAMPED = """\
from dataclasses import dataclass
from percuss import ContactLaw, LinearLaw


@dataclass(frozen=True)
class Damped(ContactLaw):
    '''A penalty spring with a dashpot, which is certified from the step itself.'''

    name = "damped"
    summary = "Penalty spring and dashpot"

    def bind(self, points, dt):
        return LinearLaw("explicit", 1 / (1.3 * points.stiffness), rate=1e-4)
"""


def threads_of_blas():
    return [library.get_num_threads() for library in ThreadpoolController().select(user_api="blas").lib_controllers]


@pytest.mark.skipif(threads_of_blas() == [], reason="no library of BLAS whose threads can be counted")
def test_bits_do_not_depend_on_the_threads_of_blas():
    """Sums of more than ten thousand terms are split among threads, and their order changes the last digits."""
    case = percuss.load(places.CASES / "doyen-impact.yaml", LONG)
    errors = []
    for threads in (1, 2, 4):
        with threadpool_limits(threads, user_api="blas"):
            errors.append(percuss.run(case).summary["exact"]["displacement_error"])
    assert len(set(errors)) == 1


def test_eigenvalues_that_choose_the_step_are_found_by_one_thread(tmp_path, monkeypatch):
    """The step that `courant: auto` takes hangs on their last digits, and all histories on the step."""
    law = tmp_path / "damped.py"
    law.write_text(DAMPED, encoding="utf-8")
    case = hunek(5, contact="damped", integrator="central-difference") | {"plugins": [str(law)]}
    case["time"] = {"courant": "auto", "steps": 3}
    found, eigenvalues = [], np.linalg.eigvals

    def counted(matrix):
        found.append(threads_of_blas())
        return eigenvalues(matrix)

    monkeypatch.setattr(np.linalg, "eigvals", counted)
    with threadpool_limits(2, user_api="blas"):
        result = percuss.run(percuss.load(case))
        after = threads_of_blas()
    assert result.summary["certificate"]["by"] == "black-box"
    assert found
    assert {threads for counts in found for threads in counts} == {1}
    assert set(after) == {2}


def test_threads_that_compute_at_once_share_the_limit():
    """The one that computes longest sets BLAS free, whichever thread that is."""
    with threadpool_limits(2, user_api="blas"):
        inside, leave = threading.Event(), threading.Event()

        def compute():
            with blas.one_blas_thread():
                inside.set()
                leave.wait(10)

        other = threading.Thread(target=compute)
        with blas.one_blas_thread():
            other.start()
            inside.wait(10)
        while_other_computes = threads_of_blas()
        leave.set()
        other.join()
        assert set(while_other_computes) == {1}
        assert set(threads_of_blas()) == {2}
