"""LAPACK loaded without the rest of SciPy."""

import numpy as np

from percuss import lapack


def test_lapack_alone_computes_the_same_bits_as_scipys(monkeypatch):
    random = np.random.default_rng(5)
    diagonal, beside = random.uniform(3.0, 4.0, 60), random.uniform(-1.0, 1.0, 59)
    alone = lapack._loaded_alone()
    assert alone is not None, "SciPy is built otherwise: every run imports scipy.linalg now, which takes longer"
    from scipy.linalg import eigvalsh_tridiagonal
    from scipy.linalg.lapack import dpttrf

    _, values, *_ = alone.dstebz(diagonal, beside, 2, 0.0, 1.0, 60, 60, 0.0, "E")
    assert values[0] == eigvalsh_tridiagonal(diagonal, beside, select="i", select_range=(59, 59))[0]
    for mine, theirs in zip(alone.dpttrf(diagonal, beside), dpttrf(diagonal, beside), strict=True):
        assert np.array_equal(mine, theirs)


def test_without_its_compiled_module_lapack_is_that_of_scipy(monkeypatch):
    from scipy.linalg import lapack as whole

    monkeypatch.setattr(lapack, "MODULE", "a_name_of_another_version")
    assert lapack._loaded_alone() is None
    assert lapack.lapack.__wrapped__() is whole
