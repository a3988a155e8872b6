"""Every limit of the plausibility checks, with its unit and where it comes from."""

import dataclasses


@dataclasses.dataclass(frozen=True)
class Thresholds:
    """Limits. Errors have to be certain: their limits lie where no working sensor is."""

    # Accelerometers against gravity (or the reference): MEMS zero offsets are below 0.1 g, scale factors
    # below 5 % (data sheets of MPU-6050, BMI160, LSM6DS3, ADXL345: 3 % and 80 mg at most).
    accel_ratio_error: float = 1.6  # |a| over gravity, or gravity over |a|
    accel_ratio_warning: float = 1.2
    # The same where all rests are in one pose and no fit will tell: 80 mg and 3 %, by which no sheet's part is off.
    accel_one_pose_warning: float = 1.12
    # Gravity turned by the gyros against gravity seen: scale 3 % of half a turn 0.1 rad, zero offsets 0.05 rad.
    turn_agrees: float = 0.16  # rad, mean misfit of motions that agree
    turn_disagrees: float = 0.3  # rad, of motions that do not
    turn_gain: float = 2.5  # the disagreement over the best alternative's
    fewest_motions: int = (
        3  # by luck, 48 exchanges and 40 units match three with a chance below 1e-5
    )
    least_tilt: float = 0.17  # rad, 10 degrees; smaller tilts tell nothing
    rate_off: float = (
        0.04  # relative, of all axes alike; MEMS scale factors are within 3 % (L3G4200D, MPU-6050)
    )
    resting_rate: float = 10.0  # rad/s; no gyro has a zero offset of 570 deg/s
    # Against a reference
    reference_agrees: float = 0.15  # of gravity or of the rate
    reference_disagrees: float = 0.35
    reference_gravity: float = (
        3e-4  # relative, 0.3 cm/s²: rounding of 9.81 against the place's value
    )
    # Heading of the Earth's rate (conventions)
    earth_rate: float = 7e-6  # rad/s, horizontal, below which its heading does not matter
    idle_rate: float = 0.35  # rad/s, 20 deg/s: no gyro's bias
    idle_noise: float = 20.0  # times the noise of successive rows
    # Of a recording; knocks and a carry to the table are less.
    idle_share: float = 0.1
    azimuth_by_chance: float = 1e-6
    azimuth_sigmas: float = 5.0  # of its own standard deviation
    azimuth_share: float = 0.5  # of the Earth's rate that gyros must read at least; twice at most
    azimuth_rests: int = 24  # from one knot of a bias' course in time to the next
    azimuth_spare: int = 12  # equations beyond the unknowns
    # Its vertical part (conventions)
    latitude_by_chance: float = 1e-6
    # A chance below it speaks for a g-sensitivity that is not alike on all axes. A true error of the latitude is
    # passed over in one of a hundred.
    latitude_by_others: float = 1e-2
    # Of the change of the vertical rate, what each of the nine g-sensitivities is known to at most: else rests in few
    # attitudes cannot show whether it is alike on all axes.
    latitude_across: float = 0.35
    latitude_off: float = (
        0.02  # Earth rates, 0.3 °/h: a degree of latitude; gyros' own D may be alike to less
    )
    # A table's clock
    table_delay: float = 0.01  # s; at 100 °/s 1° of gravity's direction
    table_delay_sigmas: float = 5.0
    # Temperature, °C
    one_temperature: float = 1.0  # up to which biases do not move
    absolute_zero: float = -273.15
    coldest: float = -100.0  # no part is specified below
    kelvin: float = 215.0  # no part is specified above; 215 K is -58 °C
    hottest_on_a_desk: float = 62.0  # devices at 62 °C cannot be turned by hand
    hottest_part: float = 130.0  # above the automotive range (125 °C)
    temperature_rate: float = 2.0  # °C/s over a second; chambers change by 0.3 °C/s at most
    # Samples
    repeated: float = 0.2  # share of rows that repeat the row before
    frozen: float = 1.0  # s that all channels hold
    duplicate: int = 24  # rows in a row that occur twice
    # Share of rows at rest that a gyro holds one value, above 0.5; noise of half a step has 0.7.
    held_at_rest: float = 0.9
    one_length: float = 0.1  # spread of |a| over the axes' noise; three independent sensors have 1
    spectrum_falls: float = (
        1.7  # ratio; one pole at half the sampling rate's half has 1.8, chance 1.3
    )
    # A line at rest against the noise: from there on it, not the sensor, decides how rests scatter.
    line_over_noise: float = 1.0  # ratio of their rms
    # Of its power to that of the bins beside it: of 30 spectra chance makes 1.6, and a resonance that a filter or a
    # bench has is wider.
    line_over_floor: float = 20.0
    spike: float = 8.0  # robust standard deviations from the rest's median
    tilt_in_rest: float = 2.0e-3  # rad (0.11 degrees) that a rest turns from end to end
    labels_off: float = 0.3  # share of rests that begin (end) with motion
    same_face: float = 0.35  # rad, 20 degrees
    remounted: float = 0.01  # rad, 0.6 degrees between runs
    # rad, 0.06 degrees from one rest on; axes of MEMS move by less over temperature and time (1e-5 rad/°C)
    turned_mount: float = 1e-3
    turned_frame: float = 0.026  # rad, 1.5 degrees of one triad against the other within a log
    turned_by_chance: float = (
        1e-4  # of that, over all moments; of 22 logs without it none below 0.2
    )
    # Clock
    longest_step: float = 0.5  # s; slower logs of IMUs are not heard of, except hourly soaks
    shortest_step: float = 1e-5  # s; faster IMUs are not heard of


DEFAULT = Thresholds()
