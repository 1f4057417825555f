"""The sizes by which the event loop of `bars-in-a-row` knows round-off, at a cost that grows linearly."""

import numpy as np
import pytest

from percuss_methods.solutions import _fronts as fronts


def chain(count, rng):
    """Return the junctions of a row of unlike bars in contact: first the contacts, then both ends."""
    bars = count - 1
    impedance = rng.choice([0.1, 1.0, 7.0], bars)
    side = np.full((count, 2, 5), -1)
    side[:, :, fronts.KIND] = fronts.ABSENT
    number = np.ones((count, 2, 3))
    contact = np.ones(count, dtype=np.int64)
    place = [count - 2, *range(count - 2), count - 1]  # number of the junction at each end of a bar along the row
    contact[count - 2 :] = 0
    for b in range(bars):
        left, right = place[b], place[b + 1]
        side[left, 1, [fronts.KIND, fronts.NEIGHBOUR]] = fronts.FREE, right
        side[right, 0, [fronts.KIND, fronts.NEIGHBOUR]] = fronts.FREE, left
        number[left, 1, fronts.IMPEDANCE] = number[right, 0, fronts.IMPEDANCE] = impedance[b]
    size = rng.choice([0.0, 1e-9, 1.0, 30.0], (count, 2))
    return fronts.Junctions(side, number, contact, contact, 0 * impedance, np.zeros(count), np.zeros((count, 4)), size)


@pytest.mark.parametrize("seed", range(8))
def test_sizes_spread_over_a_row_as_by_a_sweep_for_each_of_its_junctions(seed):
    rng = np.random.default_rng(seed)
    junctions = chain(3 + 3 * seed, rng)
    by_sweeps = junctions._replace(size=junctions.size.copy())
    c = np.zeros((fronts.SPARE + 1, 2))
    for _ in range(junctions.clock.size):
        for j in range(junctions.clock.size):
            fronts.measure_sizes(by_sweeps, j, c)
    fronts.spread_sizes(junctions, c)
    np.testing.assert_array_equal(junctions.size, by_sweeps.size)


def test_sizes_of_a_long_row_take_few_sweeps(monkeypatch):
    calls = []
    measure = fronts.measure_sizes
    monkeypatch.setattr(fronts, "measure_sizes", lambda *arguments: (calls.append(1), measure(*arguments)))
    junctions = chain(400, np.random.default_rng(0))
    junctions.size[:] = 0.0
    junctions.size[-1] = 1.0  # the velocity at the right end, which reaches the contacts from the last to the first
    fronts.spread_sizes(junctions, np.zeros((fronts.SPARE + 1, 2)))
    assert len(calls) <= 8 * 400
