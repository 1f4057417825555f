"""A result with damaged numbers, or without its end, is one clear message."""

import json

import netCDF4
import numpy as np
import pytest
import xarray as xr

import percuss
from percuss.results.netcdf import FORMAT
from strategies import hunek


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("damaged")
    case = {**hunek(4, end=0.3), "record": {"fields": 3}}
    percuss.run(percuss.load(case), compiled=False).save(folder / "whole.nc")
    return folder / "whole.nc"


def contents(result):
    told = [json.dumps(part) for part in (result.summary, result.provenance, result.coordinates)]
    arrays = {**result.arrays, **{"field " + name: values for name, values in result.field_arrays.items()}}
    return told + [(name, np.asarray(values).astype(str).tolist()) for name, values in sorted(arrays.items())]


def refusal(file):
    with pytest.raises(percuss.InputError) as caught:
        percuss.open_result(file)
    assert len(caught.value.problems) == 1
    return str(caught.value)


def test_another_byte_in_the_numbers_of_any_array_is_refused(whole, tmp_path):
    """In what HDF5 says of its own blocks a byte is not guarded."""
    result, content, bad = percuss.open_result(whole), whole.read_bytes(), tmp_path / "bad.nc"
    arrays = [values.tobytes() for values in result.arrays.values()]
    numbers = [stored for stored in arrays if content.count(stored) == 1]  # zeros stand in many places
    assert len(numbers) >= len(arrays) - 1 > 10
    for seed, stored in enumerate(numbers):
        draw = np.random.default_rng(seed)
        at = content.index(stored) + int(draw.integers(len(stored)))
        bad.write_bytes(content[:at] + bytes([content[at] ^ int(draw.integers(1, 256))]) + content[at + 1 :])
        assert "bad.nc: cannot be read as a percuss result: " in refusal(bad)


def test_another_file_is_told_from_a_damaged_one(whole, tmp_path):
    file = tmp_path / "other.nc"
    assert "expected a result file, found nothing" in refusal(file)
    file.write_text("no result")
    assert "cannot be read as a percuss result: " in refusal(file)
    with netCDF4.Dataset(file, "w") as data:
        data.setncattr("format", "something")
    assert f"expected a percuss result ({FORMAT}), found something\n  Make the run again" in refusal(file)


def test_a_result_of_an_earlier_version_opens(whole, tmp_path):
    """Format 3 is the same with one checksum behind the end, which HDF5 does not see."""
    file, expected = tmp_path / "earlier.nc", contents(percuss.open_result(whole))
    file.write_bytes(whole.read_bytes())
    with netCDF4.Dataset(file, "a") as data:
        data.setncattr("format", "percuss-result-3")
    file.write_bytes(file.read_bytes() + b"\npercuss sha256 %s\n" % (b"0" * 64))
    assert contents(percuss.open_result(file)) == expected


def test_other_programs_read_a_result(whole):
    result = percuss.open_result(whole)
    with xr.open_dataset(whole) as histories, xr.open_dataset(whole, group="fields") as fields:
        assert histories.identical(result.histories)
        assert fields.identical(result.fields)
    with netCDF4.Dataset(whole) as data:
        assert data["contact_force"].units == "force"
