/* Navigation in C: strapdown, corrected with fixed gains by GPS fixes and star fixes.
 *
 *     cc -O2 -o PROGRAM FILE -lm
 *     shefex-nav run shefex2_andoya --set 'navigation.software={command: PROGRAM}' --trust
 *
 * Axes: i inertial, e Earth-fixed, b body, c star camera; C_ab turns components in b into those in a, row by
 * row; quaternions are Hamilton, scalar first.
 */
#include <math.h>

#include "shefex_fsw.h"

#define KEPT 128           /* ticks that are remembered, for measurements that come late */
#define GAIN_POSITION 0.5  /* shares of what a measurement differs by that are believed */
#define GAIN_VELOCITY 0.5
#define GAIN_ATTITUDE 0.2

static const double MU = 3.986004418e14, J2 = 1.08263e-3, RADIUS = 6378137.0;

struct state { double t, r[3], v[3], q[4], omega[3]; };

static struct state now, past[KEPT];
static int ticks, star_aided;
static double C_iq[9], C_re[9], angle_0, earth_rate, C_bc[9], l_ba_b[3];

static void cross(const double *a, const double *b, double *out)
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static void multiply(const double *A, const double *B, double *out)  /* 3 x 3 */
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            out[3 * i + j] = A[3 * i] * B[j] + A[3 * i + 1] * B[3 + j] + A[3 * i + 2] * B[6 + j];
}

static void turn(const double *C, const double *v, double *out)
{
    for (int i = 0; i < 3; i++) out[i] = C[3 * i] * v[0] + C[3 * i + 1] * v[1] + C[3 * i + 2] * v[2];
}

static void product(const double *p, const double *q, double *out)
{
    out[0] = p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3];
    out[1] = p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2];
    out[2] = p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1];
    out[3] = p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0];
}

static void rotvec_quaternion(const double *phi, double *q)
{
    double angle = sqrt(phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2]);
    double s = angle > 1e-9 ? sin(0.5 * angle) / angle : 0.5;
    q[0] = cos(0.5 * angle);
    for (int i = 0; i < 3; i++) q[i + 1] = s * phi[i];
}

static void matrix_of(const double *q, double *C)
{
    double w = q[0], x = q[1], y = q[2], z = q[3];
    double rows[9] = {1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
                      2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
                      2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)};
    memcpy(C, rows, sizeof rows);
}

static void gravity(const double *r, double *g)
{
    double d = sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2]);
    double flat = 1.5 * J2 * pow(RADIUS / d, 2), z2 = pow(r[2] / d, 2);
    for (int i = 0; i < 3; i++) g[i] = -MU / pow(d, 3) * r[i] * (1.0 + flat * ((i == 2 ? 3.0 : 1.0) - 5.0 * z2));
}

/* Earth-fixed to inertial axes: C_ie = C_iq R3(-angle) C_re. */
static void earth_axes(double t, double *C_ie)
{
    double a = angle_0 + earth_rate * t, R[9] = {cos(a), -sin(a), 0, sin(a), cos(a), 0, 0, 0, 1}, C[9];
    multiply(C_iq, R, C);
    multiply(C, C_re, C_ie);
}

static void start(const struct shefex_message *in)
{
    if (shefex_int(in, SHEFEX_START_FORMAT) != SHEFEX_FORMAT) exit(1);
    shefex_doubles(in, SHEFEX_START_C_IQ, C_iq, 9);
    shefex_doubles(in, SHEFEX_START_C_RE, C_re, 9);
    shefex_doubles(in, SHEFEX_START_C_BC, C_bc, 9);
    shefex_doubles(in, SHEFEX_START_L_BA_B, l_ba_b, 3);
    angle_0 = shefex_double(in, SHEFEX_START_EARTH_ANGLE_0);
    earth_rate = shefex_double(in, SHEFEX_START_EARTH_RATE);
}

static void align(const struct shefex_message *in)
{
    now.t = shefex_double(in, SHEFEX_ALIGNMENT_T_VALID_S);
    shefex_doubles(in, SHEFEX_ALIGNMENT_R_I, now.r, 3);
    shefex_doubles(in, SHEFEX_ALIGNMENT_V_I, now.v, 3);
    shefex_doubles(in, SHEFEX_ALIGNMENT_Q_IB, now.q, 4);
}

static void predict(const struct shefex_message *in)
{
    double dtheta[36], dv[36], dt = shefex_double(in, SHEFEX_IMU_DT_S), C[9], g[3], a[3], dq[4], q[4];
    int n = shefex_doubles(in, SHEFEX_IMU_DTHETA_B, dtheta, 36) / 3, valid = shefex_int(in, SHEFEX_IMU_VALID);
    shefex_doubles(in, SHEFEX_IMU_DV_B, dv, 36);
    for (int k = 0; k < n; k++) {
        double *phi = dtheta + 3 * k, half[3];
        if (!valid) memset(phi, 0, 24), memset(dv + 3 * k, 0, 24);
        for (int i = 0; i < 3; i++) half[i] = 0.5 * phi[i], now.omega[i] = phi[i] / dt;
        rotvec_quaternion(half, dq);
        product(now.q, dq, q);
        matrix_of(q, C);  /* in the middle of the sample */
        turn(C, dv + 3 * k, a);
        gravity(now.r, g);
        for (int i = 0; i < 3; i++) {
            double push = a[i] + g[i] * dt;
            now.r[i] += (now.v[i] + 0.5 * push) * dt;
            now.v[i] += push;
        }
        product(q, dq, now.q);
    }
    now.t = shefex_double(in, SHEFEX_IMU_T_VALID_S);
    past[ticks++ % KEPT] = now;
}

/* What was believed at an instant, carried on from the nearest tick. */
static struct state at(double t)
{
    struct state best = now;
    for (int k = 0; k < KEPT && k < ticks; k++)
        if (fabs(past[k].t - t) < fabs(best.t - t)) best = past[k];
    double phi[3], dq[4], q[4], after = t - best.t;
    for (int i = 0; i < 3; i++) phi[i] = best.omega[i] * after, best.r[i] += best.v[i] * after;
    rotvec_quaternion(phi, dq);
    product(best.q, dq, q);
    memcpy(best.q, q, sizeof q);
    return best;
}

static void correct_by_gps(const struct shefex_message *in)
{
    double t = shefex_double(in, SHEFEX_GPS_T_VALID_S);
    if (!shefex_int(in, SHEFEX_GPS_VALID) || shefex_int(in, SHEFEX_GPS_HORIZONTAL) || now.t - t > 1.0) return;
    double r_e[3], v_e[3], C_ie[9], C[9];
    double r[3], v[3], turned[3], arm[3], arm_v[3], spin[3], axis[3] = {C_iq[2], C_iq[5], C_iq[8]};
    struct state then = at(t);
    shefex_doubles(in, SHEFEX_GPS_R_EA_E, r_e, 3);
    shefex_doubles(in, SHEFEX_GPS_V_EA_E, v_e, 3);
    if (isnan(v_e[0])) return;  /* a receiver that gives positions alone */
    earth_axes(t, C_ie);
    turn(C_ie, r_e, r);
    turn(C_ie, v_e, v);
    for (int i = 0; i < 3; i++) axis[i] *= earth_rate;
    cross(axis, r, turned);
    matrix_of(then.q, C);
    turn(C, l_ba_b, arm);
    cross(then.omega, l_ba_b, spin);
    turn(C, spin, arm_v);
    for (int i = 0; i < 3; i++) {
        double dr = GAIN_POSITION * (r[i] - arm[i] - then.r[i]);
        double dv = GAIN_VELOCITY * (v[i] + turned[i] - arm_v[i] - then.v[i]);
        now.r[i] += dr + dv * (now.t - t);
        now.v[i] += dv;
        for (int k = 0; k < KEPT; k++) past[k].r[i] += dr + dv * (past[k].t - t), past[k].v[i] += dv;
    }
}

static void correct_by_stars(const struct shefex_message *in)
{
    if (shefex_int(in, SHEFEX_STAR_REASON) != 0) return;
    double q_ic[4], C_ic[9], C_cb[9], seen[9], C[9], phi[3], dq[4], q[4];
    struct state then = at(shefex_double(in, SHEFEX_STAR_T_VALID_S));
    shefex_doubles(in, SHEFEX_STAR_Q_IC, q_ic, 4);
    matrix_of(q_ic, C_ic);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) C_cb[3 * i + j] = C_bc[3 * j + i];
    multiply(C_ic, C_cb, seen);
    matrix_of(then.q, C);
    /* the rotation seen C^T, in inertial axes */
    double D[9], Ct[9];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) Ct[3 * i + j] = C[3 * j + i];
    multiply(seen, Ct, D);
    double axis[3] = {0.5 * (D[7] - D[5]), 0.5 * (D[2] - D[6]), 0.5 * (D[3] - D[1])};
    double sine = sqrt(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2]);
    double angle = atan2(sine, 0.5 * (D[0] + D[4] + D[8] - 1.0));
    double gain = star_aided ? GAIN_ATTITUDE : 1.0;  /* the first one is believed */
    for (int i = 0; i < 3; i++) phi[i] = sine > 1e-9 ? gain * angle / sine * axis[i] : gain * axis[i];
    rotvec_quaternion(phi, dq);
    product(dq, now.q, q);
    memcpy(now.q, q, sizeof q);
    for (int k = 0; k < KEPT; k++) {
        product(dq, past[k].q, q);
        memcpy(past[k].q, q, sizeof q);
    }
    star_aided = 1;
}

static int answer(const struct shefex_message *in)
{
    double norm = 0.0;
    for (int i = 0; i < 4; i++) norm += now.q[i] * now.q[i];
    for (int i = 0; i < 4; i++) now.q[i] /= sqrt(norm);
    shefex_begin("Estimate");
    shefex_put(SHEFEX_ESTIMATE_R_I, now.r, 3);
    shefex_put(SHEFEX_ESTIMATE_V_I, now.v, 3);
    shefex_put(SHEFEX_ESTIMATE_Q_IB, now.q, 4);
    shefex_put_int(SHEFEX_ESTIMATE_STAR_AIDED, star_aided);
    shefex_end();
    shefex_begin("Done");
    shefex_put_double(SHEFEX_DONE_T_S, shefex_double(in, SHEFEX_TICK_T_S));
    shefex_end();
    return shefex_send();
}

int main(void)
{
    struct shefex_message in = {{0}, NULL, 0, 0};
    while (shefex_receive(&in)) {
        if (shefex_is(&in, "Start")) start(&in);
        if (shefex_is(&in, "Alignment")) align(&in);
        if (shefex_is(&in, "ImuBlock")) predict(&in);
        if (shefex_is(&in, "GpsFix")) correct_by_gps(&in);
        if (shefex_is(&in, "StarFix")) correct_by_stars(&in);
        if (shefex_is(&in, "Begin")) {
            shefex_begin("Ready");
            shefex_end();
            if (!shefex_send()) return 1;
        }
        if (shefex_is(&in, "Tick") && !answer(&in)) return 1;
        if (shefex_is(&in, "End")) return 0;
    }
    return 0;
}
