"""Moments in messages can be told apart, whatever the clock counts from."""

from inertiax.data.moments import moment


def test_a_clock_of_the_log_is_quoted_and_an_epochs_is_counted_from_the_first_row():
    assert moment(97.501, 0.0) == "97.501 s"
    assert moment(12400.25, 12361.5) == "12400.2 s"  # a phone's time since it was switched on
    assert moment(1535630287.916, 1535630275.416) == "12.5 s after the first row"
