"""The C text of the header that `c_header` fills."""

CHEBYSHEV = """\
/* Chebyshev coefficients: bias 3, matrix 9 (by rows), {rest}. */
static inline void {prefix}_parameters({real} temperature, {real} out[{count}])
{{
    static const {real} c[{count}][{terms}] = {table};
    const {real} x = (temperature - {middle}) / {half};
    for (int i = 0; i < {count}; i++) {{
        {real} b1 = 0, b2 = 0; /* Clenshaw's recurrence */
        for (int k = {terms} - 1; k > 0; k--) {{
            const {real} b0 = c[i][k] + 2 * x * b1 - b2;
            b2 = b1;
            b1 = b0;
        }}
        out[i] = c[i][0] + x * b1 - b2;
    }}
}}
"""

SPLINE = """\
/* Cubic pieces: bias 3, matrix 9 (by rows), {rest} in each. */
static inline void {prefix}_parameters({real} temperature, {real} out[{count}])
{{
    static const {real} knot[{edge_count}] = {{{edges}}};
    static const {real} c[{pieces} * {count}][4] = {table};
    int piece = 0;
    while (piece < {edge_count} && temperature >= knot[piece])
        piece++;
    const {real} d = temperature - knot[piece > 0 ? piece - 1 : 0];
    for (int i = 0; i < {count}; i++) {{
        const {real} *p = c[{count} * piece + i];
        out[i] = p[0] + d * (p[1] + d * (p[2] + d * p[3]));
    }}
}}
"""

BODY = """\
/* Calibration of device: {device}. Written by inertiax; change nothing by hand.
 *
 *   {name}_compensate(accel, gyro, temperature, force, rate);
 *
 * accel   outputs of the accelerometers, m/s^2       force   specific force, m/s^2
 * gyro    outputs of the gyros, rad/s                rate    angular rate, rad/s
 * temperature of the device's probe, degrees Celsius
 *
 * force = (E + G)^-1 (accel - a0),  rate = (E + Q)^-1 (gyro - w0 - D force / g)
 *
 * Temperatures are not clamped: outside of {upper}_LOW to {upper}_HIGH the curves go on, and may go far. To hold the
 * values of the nearer end there, as PX4 and ArduPilot do, clamp the temperature to these two before the call.
 */
#ifndef {guard}
#define {guard}

#define {upper}_LOW {low}   /* calibrated range, degrees Celsius */
#define {upper}_HIGH {high}
#define {upper}_GRAVITY {gravity} /* m/s^2, unit of the g-sensitivity's force */

{curves}
/* Solve (E + m) x = v by Cramer's rule; m by rows. */
static inline void {name}_solve(const {real} m[9], const {real} v[3], {real} x[3])
{{
    const {real} a = 1 + m[0], b = m[1], c = m[2];
    const {real} d = m[3], e = 1 + m[4], f = m[5];
    const {real} g = m[6], h = m[7], i = 1 + m[8];
    const {real} det = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g);
    x[0] = (v[0] * (e * i - f * h) - v[1] * (b * i - c * h) + v[2] * (b * f - c * e)) / det;
    x[1] = (-v[0] * (d * i - f * g) + v[1] * (a * i - c * g) - v[2] * (a * f - c * d)) / det;
    x[2] = (v[0] * (d * h - e * g) - v[1] * (a * h - b * g) + v[2] * (a * e - b * d)) / det;
}}

static inline void {name}_compensate(const {real} accel[3], const {real} gyro[3], {real} temperature,
                              {real} force[3], {real} rate[3])
{{
    {real} p[21], left[3];
    {name}_accel_parameters(temperature, p);
    for (int k = 0; k < 3; k++)
        left[k] = accel[k] - p[k];
    {name}_solve(p + 3, left, force);
    {name}_gyro_parameters(temperature, p);
    for (int k = 0; k < 3; k++) {{
        const {real} *d = p + 12 + 3 * k;
        left[k] = gyro[k] - p[k]
            - (d[0] * force[0] + d[1] * force[1] + d[2] * force[2]) / {upper}_GRAVITY;
    }}
    {name}_solve(p + 3, left, rate);
}}
{magnetometers}
#endif
"""

MAGNETOMETERS = """
/* mag     outputs of the magnetometers, T          field   magnetic field, T
 * current in the wires that move with the device, A; 0 where it is not measured
 *
 * field = (E + S)^-1 (mag - b - c current)
 */
static inline void {name}_compensate_mag(const {real} mag[3], {real} temperature, {real} current,
                                  {real} field[3])
{{
    {real} p[15], left[3];
    {name}_mag_parameters(temperature, p);
    for (int k = 0; k < 3; k++)
        left[k] = mag[k] - p[k] - p[12 + k] * current;
    {name}_solve(p + 3, left, field);
}}
"""
