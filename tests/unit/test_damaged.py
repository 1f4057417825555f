"""A damaged result is one clear message, never other numbers without a word."""

import json

import netCDF4
import numpy as np
import pytest
import xarray as xr

import percuss
from bad_input import contents
from percuss.results.netcdf import CHECKSUM_SIZE, FORMAT
from strategies import hunek


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("damaged")
    case = {**hunek(4, end=0.3), "record": {"fields": 3}}
    percuss.run(percuss.load(case), compiled=False).save(folder / "whole.nc")
    return folder / "whole.nc"


def refusal(file):
    with pytest.raises(percuss.InputError) as caught:
        percuss.open_result(file)
    assert len(caught.value.problems) == 1
    return str(caught.value)


@pytest.mark.parametrize("kind", ["another byte", "a lost block", "a missing end", "a longer end"])
def test_no_damaged_file_gives_other_numbers(whole, tmp_path, kind):
    """Not even where HDF5 itself would break down, as it does of some: it is not asked."""
    expected, content, bad = contents(percuss.open_result(whole)), whole.read_bytes(), tmp_path / "bad.nc"
    for seed in range(40):
        draw = np.random.default_rng(seed)
        at = int(draw.integers(len(content)))
        damaged = {
            "another byte": content[:at] + bytes([content[at] ^ int(draw.integers(1, 256))]) + content[at + 1 :],
            "a lost block": content[:at] + bytes(len(content[at : at + 64])) + content[at + 64 :],
            "a missing end": content[:at],
            "a longer end": content + draw.bytes(20),
        }[kind]
        bad.write_bytes(damaged)
        if damaged == content:  # the lost block held zeros
            assert contents(percuss.open_result(bad)) == expected
        else:
            assert "bad.nc: " in refusal(bad)


@pytest.mark.parametrize("what", ["value", "summary", "provenance", "name", "field"])
@pytest.mark.parametrize("sealed", [True, False], ids=["with the old checksum", "without"])
def test_whatever_is_another_than_was_written_is_told(whole, tmp_path, what, sealed):
    """Changes that leave the file a valid one."""
    file, content = tmp_path / "changed.nc", whole.read_bytes()
    file.write_bytes(content[:-CHECKSUM_SIZE])
    with netCDF4.Dataset(file, "a") as data:
        if what == "value":
            data["gap"][3, 0] = np.nextafter(data["gap"][3, 0], 1.0)
        elif what == "field":
            data["fields"]["stress"][1, 2] += 1e-12
        elif what == "name":
            data["contact"][0] = "top"
        else:
            told = json.loads(data.getncattr(what))
            data.setncattr(what, json.dumps({**told, "steps": 7}))
    if sealed:
        file.write_bytes(file.read_bytes() + content[-CHECKSUM_SIZE:])
    reason = "it does not have the checksum" if sealed else "its end, a checksum, is missing, or another program"
    assert f"the file is damaged: {reason}" in refusal(file)


def test_another_file_is_told_from_a_damaged_one(whole, tmp_path):
    file = tmp_path / "other.nc"
    assert "expected a result file, found nothing" in refusal(file)
    file.write_text("no result")
    assert "expected a NetCDF-4 file, found something else" in refusal(file)
    with netCDF4.Dataset(file, "w") as data:
        data.setncattr("format", "something")
    assert f"expected a percuss result ({FORMAT}), found another NetCDF file" in refusal(file)
    with netCDF4.Dataset(file, "a") as data:
        data.setncattr("format", "percuss-result-2")
    assert "found the format percuss-result-2\n  Make the run again" in refusal(file)


def test_other_programs_read_a_result(whole):
    result = percuss.open_result(whole)
    with xr.open_dataset(whole) as histories, xr.open_dataset(whole, group="fields") as fields:
        assert histories.identical(result.histories)
        assert fields.identical(result.fields)
    with netCDF4.Dataset(whole) as data:
        assert data["contact_force"].units == "force"


@pytest.mark.parametrize("case", [hunek(4, end=0.3), {k: v for k, v in hunek(4, end=0.1).items() if k != "contacts"}])
def test_a_whole_file_is_opened_and_saved_again(case, tmp_path):
    result = percuss.run(percuss.load(case), compiled=False)
    result.save(tmp_path / "a.nc")
    percuss.open_result(tmp_path / "a.nc").save(tmp_path / "b.nc")
    again = percuss.open_result(tmp_path / "b.nc")
    assert again.summary == result.summary
    assert again.provenance == result.provenance
    for name, values in result.arrays.items():
        assert np.array_equal(again.arrays[name], values, equal_nan=True), name
