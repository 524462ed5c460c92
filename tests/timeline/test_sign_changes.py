"""Changes of sign and extrema of many functions at once, beside closed forms."""

import numpy as np

from jaxplan.timeline.sign_changes import _find_lowest_dips, changes, least

PERIODS = np.array([7.0, 13.0, 100.0])


def _waves(times, columns):
    return np.sin(2 * np.pi * times / PERIODS[columns])


def _table(times):
    return np.stack([_waves(times, np.full(len(times), column)) for column in range(3)], axis=1)


def test_every_change_of_sign_is_found_where_it_is():
    times = np.linspace(0.5, 99.5, 120)
    found = changes(_table(times), times, _waves)
    for column, period in enumerate(PERIODS):
        own = found.columns == column
        wanted = np.arange(1, int(99.5 / (period / 2)) + 1) * period / 2
        np.testing.assert_allclose(found.times[own], wanted, atol=1e-7)
        np.testing.assert_array_equal(found.rising[own], np.arange(len(wanted)) % 2 == 1)


def test_a_dip_between_two_samples_is_found():
    def dip(times, _columns):
        return (times - 10.3) ** 2 - 0.01

    times = np.arange(0.0, 21.0)
    found = changes(dip(times, 0)[:, None], times, dip)
    np.testing.assert_allclose(found.times, [10.2, 10.4], atol=1e-7)
    assert found.rising.tolist() == [False, True]
    over = changes(-dip(times, 0)[:, None], times, lambda t, c: -dip(t, c))
    np.testing.assert_allclose(over.times, [10.2, 10.4], atol=1e-7)
    assert over.rising.tolist() == [True, False]


def test_a_dip_that_stays_above_zero_and_what_is_no_number_are_no_changes():
    def dip(times, _columns):
        return np.where(times < 3, np.nan, (times - 10.3) ** 2 + 1e-3)

    times = np.arange(0.0, 21.0)
    assert len(changes(dip(times, 0)[:, None], times, dip).times) == 0


def test_the_least_value_is_found_inside_at_an_end_and_at_a_kink():
    def curves(times, columns):
        return np.choose(columns, [(times - 4.321) ** 2 + 2, times, np.abs(times - 7.77) - 1])

    times = np.arange(0.0, 11.0)
    table = np.stack([curves(times, np.full(11, column)) for column in range(3)], axis=1)
    when, value = least(table, times, curves)
    np.testing.assert_allclose(when, [4.321, 0.0, 7.77], atol=1e-4)
    np.testing.assert_allclose(value, [2.0, 0.0, -1.0], atol=1e-5)


def test_of_near_equal_minima_the_lower_one_is_found_though_a_sample_is_nearer_to_the_other():
    def curves(times, columns):
        return np.minimum((times - 5.0) ** 2 + 1e-3, (times - 14.5) ** 2) + 0.0 * columns

    times = np.arange(0.0, 21.0)
    when, value = least(curves(times, 0)[:, None], times, curves)
    np.testing.assert_allclose(when, [14.5], atol=1e-4)
    np.testing.assert_allclose(value, [0.0], atol=1e-8)


def test_only_dips_that_may_be_the_least_are_looked_at():
    still = np.full(1000, 2.0) + 1e-12 * np.cos(np.arange(1000))
    ripples = 0.1 * np.cos(np.arange(1000.0)) + 0.01 * np.arange(1000)
    place, column = _find_lowest_dips(np.stack([still, ripples], axis=1))
    assert np.sum(column == 0) == 1
    assert np.sum(column == 1) <= 10
    assert np.argmin(ripples) in place[column == 1]


def test_a_sample_that_is_infinitely_low_stays_the_least():
    table = np.array([[1.0], [-np.inf], [1.0], [0.5]])
    _, value = least(table, np.arange(4.0), lambda times, columns: np.full(len(times), 0.75))
    assert value.tolist() == [-np.inf]


def test_a_column_that_is_nowhere_a_number_is_infinite():
    _, value = least(
        np.full((5, 1), np.nan), np.arange(5.0), lambda times, columns: np.full(len(times), np.nan)
    )
    assert value.tolist() == [np.inf]
