"""The package's only geodetic constants: WGS 84.

**Reference:** NGA.STND.0036_1.0.0 (2014), tables 3.1, 3.5 and 3.6.
"""

SEMI_MAJOR_AXIS = 6378137.0  # a, m
FLATTENING = 1.0 / 298.257223563  # f
EARTH_RATE = 7.292115e-5  # rad/s
EQUATOR_GRAVITY = 9.7803253359  # γ_e, m/s²
POLE_GRAVITY = 9.8321849378  # γ_p, m/s²
GRAVITY_RATIO = 0.00344978650684  # m = Ω² a² b / GM
