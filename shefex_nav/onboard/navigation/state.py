"""The states of the filter: what is estimated, in which order the errors stand, and what is assumed of them.

Nominal states are carried by the strapdown; the covariance belongs to their errors,

    truth = estimate (+) error:   r = r^ + dr,   q_ib = q_ib^ * exp(dtheta_b),   b = b^ + db, ...

Fifteen errors are always there (the slices below); further blocks are switched on by name. `layout` is the
only place where the order of the errors is settled, `NOMINAL` where that of the packed nominal values is;
both follow the table of `blocks`. Blocks of instruments and plug-ins (`blocks.Block`) are not known here:
their errors and values stand behind all others.

What the sensors of the IMU measure, with the blocks of their errors::

    dv_m     = (I + diag(accel_scale) + accel_misalignment) dv + (accel_bias + accel_rectification V^2) T
    dtheta_m = (I + diag(gyro_scale) + gyro_misalignment + gyro_roll_column e_x^T) dtheta
               + gyro_bias T + gyro_g_sensitivity dv

V is the level of vibration, by that of the strongest motor.
"""

from collections import namedtuple
from typing import Any, NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry import rotation
from shefex_nav.onboard.navigation.blocks import DEFAULT_STATES, OPTIONAL, checked
from shefex_nav.onboard.navigation.settings import Releases

POS = slice(0, 3)  # dr_i [m]
VEL = slice(3, 6)  # dv_i [m/s]
ATT = slice(6, 9)  # dtheta_b [rad]
BG = slice(9, 12)  # gyro bias [rad/s]
BA = slice(12, 15)  # accelerometer bias [m/s^2]
N_CORE = 15
WITH_BIASES = slice(ATT.start, BA.stop)  # errors of Alignment.P_with_biases
PVA = slice(0, 9)  # position, velocity, attitude
CORE = {"position": POS, "velocity": VEL, "attitude": ATT, "gyro_bias": BG, "accel_bias": BA}

# index of a block in `Layout.at`
ROLL_COLUMN, GRAVITY, MOUNTING, LEVER, CLOCK, LATENCY, RANGE_BIAS = map(
    list(OPTIONAL).index,
    ("gyro_roll_column", "gravity", "mounting", "lever_arm", "clock", "gps_latency", "range_bias"),
)

NOMINAL = {}  # place of every value in the packed nominal state, whether its error is estimated or not
for _name, _size in {
    "r_i": 3, "v_i": 3, "q_ib": 4, "gyro_bias": 3, "accel_bias": 3, **OPTIONAL
}.items():  # fmt: skip
    _start = max((place.stop for place in NOMINAL.values()), default=0)
    NOMINAL[_name] = slice(_start, _start + _size)
N_NOMINAL = max(place.stop for place in NOMINAL.values())  # with those of instruments X, in shapes
# the same as constants, for kernels
X_R, X_V, X_Q = NOMINAL["r_i"], NOMINAL["v_i"], NOMINAL["q_ib"]
X_BG, X_BA = NOMINAL["gyro_bias"].start, NOMINAL["accel_bias"].start
X_ROLL, X_GS = NOMINAL["gyro_roll_column"].start, NOMINAL["gyro_scale"].start
X_GM, X_GG = NOMINAL["gyro_misalignment"].start, NOMINAL["gyro_g_sensitivity"].start
X_AS, X_AM = NOMINAL["accel_scale"].start, NOMINAL["accel_misalignment"].start
X_CLOCK = NOMINAL["clock"].start
X_RECTIFIED, X_GRAVITY = NOMINAL["accel_rectification"].start, NOMINAL["gravity"].start
X_MOUNTING, X_LEVER, X_LATENCY = NOMINAL["mounting"], NOMINAL["lever_arm"], NOMINAL["gps_latency"].start


class Layout(NamedTuple):
    """Which errors are estimated, and where each stands."""

    names: tuple[str, ...]  # optional blocks that are on, in the order of their errors
    n: int  # number of errors
    places: dict  # name of a block, core and optional -> slice, or None if it is off
    at: np.ndarray  # (13,) the same for kernels: first error of each block of OPTIONAL, -1 if it is off
    nominal: np.ndarray  # (n - 9,) place in the packed nominal state of each error behind the attitude
    values: dict  # name of a block with a nominal value -> slice of it in the packed nominal state


def layout(names=DEFAULT_STATES, blocks=()):
    """Layout of the core and the named blocks; LayoutError if they do not exist or do not go together.

    names : of OPTIONAL and of `blocks`
    blocks : blocks.Block of instruments and plug-ins, of which those that are not named are off
    """
    names = checked(names, [block.name for block in blocks])
    sizes = OPTIONAL | {block.name: block.size for block in blocks}
    places, values, at, n = dict(CORE), dict(NOMINAL), np.full(len(OPTIONAL), -1), N_CORE
    end = N_NOMINAL
    for k, (name, size) in enumerate(sizes.items()):
        places[name] = slice(n, n + size) if name in names else None
        if name not in names:
            continue
        if name in OPTIONAL:
            at[k] = n
        else:
            values[name] = slice(end, end + size)
            end += size
        n += size
    ordered = tuple(name for name in sizes if name in names)
    of_errors = [values[name] for name in ("gyro_bias", "accel_bias", *ordered)]
    nominal = np.concatenate([np.arange(place.start, place.stop) for place in of_errors])
    return Layout(ordered, n, places, at, nominal, values)


def rearranged(values, own, other, alone):
    """A number of each error of a Layout, (own.n,), in the order of another one: (other.n,).

    alone : of the errors that the other one has and this one has not
    """
    found = np.full(other.n, alone)
    for name, place in other.places.items():
        if place is not None and own.places.get(name) is not None:
            found[place] = values[own.places[name]]
    return found


NavState = namedtuple(
    "NavState",
    ("t_s", *NOMINAL, "others"),
    defaults=(*(np.zeros(size) for size in OPTIONAL.values()), np.empty(0)),
)
NavState.__doc__ = """Nominal state at one instant; what is not estimated keeps its value.

t_s : mission time [s];  r_i, v_i : (3,) m, m/s;  q_ib : (4,);  gyro_bias, accel_bias : (3,) rad/s, m/s^2
the blocks of `blocks.STATES`, each (size,) in its unit, zero unless given. To be added to nominal values:
    lever_arm, gravity (to that of the on-board field); C_bc = exp(skew(mounting)) C_bc(nominal)
others : of the blocks of instruments and plug-ins that are on, one after the other
"""
for _zeros in NavState._field_defaults.values():
    _zeros.setflags(write=False)


def pack(state):
    """The nominal values of a NavState as one array for kernels, in the order of NOMINAL: (X,)."""
    return np.concatenate(state[1:])


_SLICES = [*NOMINAL.values(), slice(N_NOMINAL, None)]


def unpack(t_s, x):
    """NavState of packed values (X,), as views of them."""
    return NavState(t_s, *[x[place] for place in _SLICES])


class ImuModel(NamedTuple):
    """What the filter assumes of the inertial sensors beyond its states; all are numbers.

    Errors that are no states enter as noise (`process_noise.densities` says how). An error whose block is
    estimated must not be counted here as well: `blocks.left_as_noise` leaves it out.
    """

    gyro_random_walk: float  # rad/sqrt(s)
    gyro_bias_walk: float  # rad/s/sqrt(s), wander of the bias
    gyro_cross: float  # scale factor and misalignment met by rates across the roll axis, rms of three axes
    spun_along: float  # share of its variance that acts while the vehicle spins: about the roll axis,
    spun_across: float  # and about each of the others
    manoeuvre_angle: float  # rad, angle through which the roll axis is typically turned at a time
    gyro_g_sensitivity: float  # rad/s per m/s^2
    gyro_rectification: float  # rad/s, bias while the strongest motor burns
    gyro_vibration: float  # rad rms, swinging of the sensors while the strongest motor burns
    gyro_quantum: float  # rad, smallest increment
    accel_random_walk: float  # m/s/sqrt(s)
    accel_bias_walk: float  # m/s^2/sqrt(s), wander of the bias
    accel_scale: float  # scale factor, as met by thrust along the roll axis
    accel_misalignment: float  # of the axes across it
    accel_rectification: float  # m/s^2, bias while the strongest motor burns
    accel_vibration: float  # m/s rms, swinging of the sensors while the strongest motor burns
    thrust_threshold: float  # m/s^2, specific force towards the nose above which a motor burns
    shake_threshold: float  # m/s, noise of its increments above which it burns, too
    thrust_time_s: float  # correlation time of errors that go with specific force: half a burn
    gravity: float  # m/s^2, what the on-board gravity model leaves out, where it is no state
    gravity_time_s: float  # for how long it acts before GPS corrects for it, while the body turns
    saturated_rate: float  # rad/s, error while a sensor is at its range
    accel_quantum: float = 0.0  # m/s, smallest increment


class GpsTold(NamedTuple):
    """What the computer was told of its GPS receiver; the defaults change nothing."""

    position_factor: float = 1.0  # on the standard deviations of positions and ranges that are reported
    velocity_factor: float = 1.0  # on those of velocities and range rates
    clock_offset_s: float = 0.0  # stamps are later than the instants that are measured by so much
    latency_s: float = np.nan  # from the instant that is measured to the arrival; NaN: the stamp says it
    lasting_factor: float = 1.0  # on those of errors of ranges that last
    fix_factor: float = 1.0  # besides, on those of positions, in which noise and what lasts are one


NOTHING_TOLD = GpsTold()


class NavParams(NamedTuple):
    """Parameters of the navigation filter."""

    imu: ImuModel
    sigma_gyro_bias: float  # rad/s, at the start, each axis
    sigma_accel_bias: float  # m/s^2
    sigma_blocks: dict  # name of each optional block that is on -> (size,) sigma at the start
    l_ba_b: np.ndarray  # (3,) m, IMU to GPS antenna
    C_bc: np.ndarray  # (3, 3) nominal mounting of the star camera
    gate_probability: float  # of rejecting a good measurement
    star_fix_floor: float  # rad, each axis: errors of a star fix that its covariance does not know
    release: Releases  # when sensors that contradict the filter are believed after all
    gps_agreement: float  # m per second between two fixes, for the check of fixes against each other
    history_s: float  # how far back a measurement may lie
    motors: np.ndarray  # (n, 2) in order of burning: s from when it may burn, vibration by the strongest's
    swing_at_rest: np.ndarray = np.zeros(2)  # rad, m/s rms, of gyros and accelerometers while no motor burns
    vibration_period_s: float = 0.05  # the longest of the vibration
    states: tuple[str, ...] = DEFAULT_STATES  # optional blocks
    clock_white: float = 0.0  # m/sqrt(s), of the receiver's clock: white frequency noise
    clock_walk: float = 0.0  # m/s/sqrt(s), random walk of its frequency
    range_bias_sigma: float = 0.0  # m, of the block range_bias in the long run
    range_bias_time_s: float = np.inf  # its correlation time
    gravity_error: float = 0.0  # m/s^2, each axis, of the block gravity in the long run
    gps: str = "loose"  # GPS by its fixes; "tight": by the ranges of its channels
    lasting_share: float = 0.0  # of the variance of a position fix: errors that last range_bias_time_s
    starts_at_fix: bool = False  # the place at the start is that of a position fix, with its errors that last
    integrity: Any = None  # integrity_watch.IntegrityParams; None: nothing is expected of IMU and solution
    stars: str = "attitude"  # stars by the attitude of each frame; "vectors": each star by itself
    gps_told: GpsTold = NOTHING_TOLD  # of the receiver, beyond what its messages say themselves
    aids: tuple = ()  # of aid.Aid, instruments that the filter uses besides GPS and stars
    own_blocks: tuple = ()  # of blocks.Block, those that plug-ins bring without an instrument

    @property
    def blocks(self):
        """Blocks of all aids and of plug-ins: tuple of blocks.Block."""
        return (*(block for aid in self.aids for block in aid.blocks), *self.own_blocks)


def initial(params, order, alignment):
    """State and covariance at the start.

    Where the velocity is known against the Earth, one that stands on it at another place moves otherwise:
    v = omega_i x r and an error of sigma_v.

    NavParams, Layout, Alignment -> NavState, (n, n)
    """
    is_found = len(alignment.gyro_bias) > 0
    state = NavState(
        float(alignment.t_valid_s),
        np.array(alignment.r_i, dtype=float),
        np.array(alignment.v_i, dtype=float),
        rotation.quat_normalise(np.array(alignment.q_ib, dtype=float)),
        np.array(alignment.gyro_bias, dtype=float) if is_found else np.zeros(3),
        np.zeros(3),
        others=np.zeros(max(place.stop for place in order.values.values()) - N_NOMINAL),
    )
    P = np.zeros((order.n, order.n))
    P[POS, POS] = alignment.sigma_r**2 * np.eye(3)
    turn = np.cross(alignment.omega_i, np.eye(3)).T  # omega_i x; once, so not worth a kernel
    P[VEL, POS] = alignment.sigma_r**2 * turn
    P[POS, VEL] = P[VEL, POS].T
    P[VEL, VEL] = alignment.sigma_v**2 * np.eye(3) + alignment.sigma_r**2 * turn @ turn.T
    P[ATT, ATT] = alignment.P_theta_b
    P[BG, BG] = (alignment.sigma_gyro_bias if is_found else params.sigma_gyro_bias) ** 2 * np.eye(3)
    P[BA, BA] = params.sigma_accel_bias**2 * np.eye(3)
    if len(alignment.P_with_biases):
        P[WITH_BIASES, WITH_BIASES] = alignment.P_with_biases
    for name in order.names:
        place = order.places[name]
        P[place, place] = initial_covariance(params, name)
    return state, P


def used_at_start(params, t_s):
    """`History.used_s` at the start, t_s: what lasts of the errors of a fix that made it comes again."""
    return {"gps_position": t_s} if params.starts_at_fix else {}


def initial_covariance(params, name):
    """What is known of an optional block at the start: (size, size), in its units."""
    for block in params.blocks:
        if block.name == name:
            return block.P.copy()
    sigma = np.asarray(params.sigma_blocks[name], dtype=float)
    if sigma.shape != (OPTIONAL[name],):
        raise ValueError(f"sigma of '{name}': {OPTIONAL[name]} values are needed, shape is {sigma.shape}")
    return np.diag(sigma**2)


@inner
def corrected(x, dx, nominal):
    """Take an estimated error into packed values: truth = estimate (+) error.

    (X,), (n,), Layout.nominal -> (X,)
    """
    out = x.copy()
    for i in range(3):
        out[X_R.start + i] += dx[POS.start + i]
        out[X_V.start + i] += dx[VEL.start + i]
    turned = rotation.quat_multiply(x[X_Q], rotation.quat_from_rotvec(dx[ATT]))
    out[X_Q] = rotation.quat_normalise(turned)
    for k in range(nominal.shape[0]):
        out[nominal[k]] += dx[ATT.stop + k]
    return out


@kernel
def right_jacobian(phi):
    """Jr of the rotation group: exp(phi + d) = exp(phi) exp(Jr d) for small d. (3,) rad -> (3, 3).

    Jr = I - (1 - cos a)/a^2 X + (a - sin a)/a^3 X^2,   X = skew(phi), a = |phi|
    (Sola, arXiv:1711.02508, eq. 183).
    """
    a2 = phi[0] ** 2 + phi[1] ** 2 + phi[2] ** 2
    if a2 < 1e-4:  # series; the next terms are below 1e-12
        first, second = 0.5 - a2 / 24.0 + a2 * a2 / 720.0, 1.0 / 6.0 - a2 / 120.0
    else:
        a = np.sqrt(a2)
        first, second = (1.0 - np.cos(a)) / a2, (a - np.sin(a)) / (a2 * a)
    X = rotation.skew(phi)
    return np.eye(3) - first * X + second * (X @ X)
