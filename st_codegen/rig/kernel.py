"""The axis between two PLC cycles, compiled by numba: fixed step, no allocation, the same bits on every run.

Mechanics: two masses on the coupling. The reducer ties the output to its fast shaft,

    theta_out = theta_in / ratio + TE(theta_out),    g = d theta_out / d theta_in = 1 / (ratio * (1 - TE')),

so that what stands at the output acts on the fast shaft as the inertia J_in + J_out g^2, with the term -J_out g g'
w_in^2 of Lagrange's equation. Integrated by velocity Verlet. TE = Re sum c_k exp(i k theta_out), with one set of c_k in
each direction; at a reversal the output stands still until the difference of their means is travelled (a play).
"""

from __future__ import annotations

import math

from numba import njit

from st_codegen.ir.arrays import FloatArray, IntArray

#: Places in the state vector: angles in rad, speeds in rad/s, torques in N m.
(
    TH_MOT,
    W_MOT,
    TH_IN,
    W_IN,
    TORQUE,
    INTEGRAL,
    SETPOINT,
    SEEN,
    REF_FROM,
    REF_TO,
    REF_SLOPE,
    REF_ACC,
    SIDE,
    TE,
    TE1,
    TE2,
) = range(16)
STATES = 16
#: Places in the parameter vector, SI units, all at the shaft they belong to.
(
    J_MOT,
    J_IN,
    J_OUT,
    RATIO,
    STIFFNESS,
    DAMPING,
    HALF_PLAY,
    MOT_VISCOUS,
    MOT_COULOMB,
    RED_VISCOUS,
    RED_COULOMB,
    LOAD_FRICTION,
    FRICTION_SPEED,
    TORQUE_LIMIT,
    KV,
    KP,
    KI,
    CURRENT_GAIN,
    SPEED_FF,
    ACC_FF,
    STEP,
    ENCODER_STEP,
) = range(22)
PARAMETERS = 22
_DEG = math.pi / 180.0
#: Narrowest play at a reversal, deg: keeps its rate finite where both directions have the same mean.
_NARROWEST = 3e-4


@njit(cache=True)
def transmission(x: FloatArray, p: FloatArray, orders: FloatArray, c: FloatArray) -> None:
    """TE at the present angle and its first two derivatives with respect to theta_out, into the state.

    `c` has rows forward cosine, forward sine, backward cosine, backward sine part (deg): TE = a cos - b sin. theta_out
    is implicit; TE' is a few thousandths, so that the last TE and one correction leave less than 1e-5 of its change in
    a step.
    """
    forward, backward = 0.5 * (1.0 + x[SIDE]), 0.5 * (1.0 - x[SIDE])
    theta = x[TH_IN] / p[RATIO] + x[TE]
    te, te1, te2 = 0.0, 0.0, 0.0
    for i in range(orders.shape[0]):
        k = orders[i]
        a = forward * c[0, i] + backward * c[2, i]
        b = forward * c[1, i] + backward * c[3, i]
        cosine, sine = math.cos(k * theta), math.sin(k * theta)
        value, slope = a * cosine - b * sine, -(a * sine + b * cosine)
        te += value
        te1 += k * slope
        te2 -= k * k * value
    # Newton: the angle that was used lies off by the change of TE
    error = te * _DEG - x[TE]
    x[TE1] = te1 * _DEG
    x[TE2] = te2 * _DEG
    x[TE] += error / (1.0 - x[TE1])


@njit(cache=True)
def accelerations(x: FloatArray, p: FloatArray, load: float) -> tuple[float, float]:
    """The accelerations of motor and fast shaft, rad/s2; `load` is the torque at the output against positive motion."""
    twist, rate = x[TH_MOT] - x[TH_IN], x[W_MOT] - x[W_IN]
    carried = 0.0
    if twist > p[HALF_PLAY]:
        carried = p[STIFFNESS] * (twist - p[HALF_PLAY]) + p[DAMPING] * rate
        if p[HALF_PLAY] > 0.0 and carried < 0.0:
            carried = 0.0  # flanks push, they do not pull
    elif twist < -p[HALF_PLAY]:
        carried = p[STIFFNESS] * (twist + p[HALF_PLAY]) + p[DAMPING] * rate
        if p[HALF_PLAY] > 0.0 and carried > 0.0:
            carried = 0.0
    elif p[HALF_PLAY] == 0.0:
        carried = p[DAMPING] * rate
    g = 1.0 / (p[RATIO] * (1.0 - x[TE1]))
    bend = x[TE2] * g * g * g * p[RATIO]  # dg/d theta_in
    w, turning = x[W_IN], math.tanh(x[W_IN] / p[FRICTION_SPEED])
    drag = (p[RED_COULOMB] + p[LOAD_FRICTION] * abs(load) * g) * turning + p[RED_VISCOUS] * w
    own = p[MOT_COULOMB] * math.tanh(x[W_MOT] / p[FRICTION_SPEED]) + p[MOT_VISCOUS] * x[W_MOT]
    motor = (x[TORQUE] - carried - own) / p[J_MOT]
    inner = (carried - drag - load * g - p[J_OUT] * g * bend * w * w) / (p[J_IN] + p[J_OUT] * g * g)
    return motor, inner


@njit(cache=True)
def drive(x: FloatArray, p: FloatArray, reference: float, cycle: float) -> None:
    """Position and speed loop: a new set-point of the torque from what the motor's encoder shows."""
    seen = math.floor(x[TH_MOT] / p[ENCODER_STEP]) * p[ENCODER_STEP] if p[ENCODER_STEP] > 0.0 else x[TH_MOT]
    speed = (seen - x[SEEN]) / cycle
    x[SEEN] = seen
    error = p[KV] * (reference - seen) + p[SPEED_FF] * x[REF_SLOPE] - speed
    torque = p[KP] * error + x[INTEGRAL] + p[ACC_FF] * x[REF_ACC]
    limited = min(max(torque, -p[TORQUE_LIMIT]), p[TORQUE_LIMIT])
    if torque == limited:
        x[INTEGRAL] += p[KI] * error * cycle
    x[SETPOINT] = limited


@njit(cache=True)
def advance(
    x: FloatArray,
    p: FloatArray,
    orders: FloatArray,
    c: FloatArray,
    load: FloatArray,
    reference: float,
    counts: IntArray,
) -> None:
    """One PLC cycle, which changes the state in place.

    `counts`: steps in it, steps between two runs of the drive's loops, step at which `reference` (rad) arrives.
    `load` (2,) is the output torque at the begin and end of the cycle.
    """
    steps, every, arrival = counts[0], counts[1], counts[2]
    h = p[STEP]
    period = steps * h
    for i in range(steps):
        if i == arrival:
            slope = (reference - x[REF_TO]) / period
            x[REF_ACC] = (slope - x[REF_SLOPE]) / period
            x[REF_SLOPE] = slope
            x[REF_FROM] = x[REF_TO]
            x[REF_TO] = reference
        if i % every == 0:
            since = (i - arrival) * h if i >= arrival else (i - arrival + steps) * h
            drive(x, p, x[REF_FROM] + (x[REF_TO] - x[REF_FROM]) * (since / period), every * h)
        x[TORQUE] += (x[SETPOINT] - x[TORQUE]) * p[CURRENT_GAIN]
        torque = load[0] + (load[1] - load[0]) * (i / steps)
        motor, inner = accelerations(x, p, torque)
        x[W_MOT] += 0.5 * h * motor
        x[W_IN] += 0.5 * h * inner
        travel = h * x[W_IN]
        x[TH_MOT] += h * x[W_MOT]
        x[TH_IN] += travel
        width = _NARROWEST
        if orders.shape[0] > 0 and orders[0] == 0.0:
            width = max(abs(c[0, 0] - c[2, 0]), _NARROWEST)
        x[SIDE] = min(max(x[SIDE] + 2.0 * travel / p[RATIO] / (width * _DEG), -1.0), 1.0)
        x[TE] += x[TE1] * travel / (p[RATIO] * (1.0 - x[TE1]))  # a first guess, right to the second order
        transmission(x, p, orders, c)
        # forces that depend on the speed want the speed at the end of the step: once with half of it, then with all
        half_mot, half_in = x[W_MOT], x[W_IN]
        for _ in range(2):
            motor, inner = accelerations(x, p, torque)
            x[W_MOT] = half_mot + 0.5 * h * motor
            x[W_IN] = half_in + 0.5 * h * inner
