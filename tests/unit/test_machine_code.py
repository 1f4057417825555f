"""Machine code on disk: it is loaded without numba, but not if it refers to what is missing."""

import ctypes

import numpy as np
import pytest
from llvmlite import binding, ir

from percuss import cache, lapack
from percuss.compiler import machine_code
from percuss.compiler.machine_code import MachineCode, address_of_stored, key_of, refers_to_c_alone, store
from percuss.step.linking import Block, call_at


def compiled(library_function="sqrt", status=0):
    """Return the machine code of a function that returns the root of a number, made without numba."""
    number, whole = ir.DoubleType(), ir.IntType(64)
    module = ir.Module()
    places = [whole.as_pointer(), ir.IntType(8).as_pointer(), number.as_pointer()]
    function = ir.Function(module, ir.FunctionType(ir.IntType(32), places), "root")
    root = ir.Function(module, ir.FunctionType(number, [number]), library_function)
    builder = ir.IRBuilder(function.append_basic_block())
    value = builder.call(root, [builder.load(function.args[2])])
    builder.store(builder.fptosi(value, whole), function.args[0])
    builder.ret(ir.Constant(ir.IntType(32), status))
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    machine = binding.Target.from_default_triple().create_target_machine(reloc="pic", codemodel="large", jit=True)
    return MachineCode("root", "=d", machine.emit_object(binding.parse_assembly(str(module))))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(cache, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(machine_code, "_LOADED", {})
    return tmp_path


def test_what_is_stored_is_loaded_and_called(folder):
    key = key_of("test", str(folder))
    assert address_of_stored(key) is None
    store(key, compiled())
    address, form = address_of_stored(key)
    assert call_at(address, Block(49.5, form)) == 7
    assert address_of_stored(key)[0] == address


def test_code_that_refers_to_what_no_library_has_is_not_loaded(folder):
    key = key_of("test", str(folder))
    store(key, compiled("no_library_has_this"))
    assert address_of_stored(key) is None


def test_an_exception_is_raised_where_its_class_is_not_known(folder):
    key = key_of("test", str(folder))
    store(key, compiled(status=1))
    address, form = address_of_stored(key)
    with pytest.raises(RuntimeError, match="compiled code"):
        call_at(address, Block(1.0, form))


@pytest.mark.parametrize("status", [-1, -3])
def test_any_other_status_than_that_of_a_result_is_an_error(folder, status):
    key = key_of("test", str(folder), str(status))
    store(key, compiled(status=status))
    address, form = address_of_stored(key)
    with pytest.raises(RuntimeError, match="compiled code"):
        call_at(address, Block(1.0, form))


def test_a_folder_that_cannot_be_written_to_is_left_alone(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setattr(cache, "cache_folder", lambda: tmp_path / "file")
    store("key", compiled())
    assert address_of_stored("key") is None


def test_what_python_or_numba_provide_is_not_there_without_them():
    assert refers_to_c_alone(["llvm.memset.p0.i64", "memcpy", "sin"])
    for name in ("NRT_Allocate", "PyErr_Clear", "numba_gil_ensure", "no_library_has_this"):
        assert hasattr(ctypes.pythonapi, name) or not refers_to_c_alone([name])
        assert not refers_to_c_alone(["sin", name])


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
