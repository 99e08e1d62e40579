"""The numbers that decide in recordings of joints; see `reconcile/settings.py`."""

from __future__ import annotations

from dataclasses import dataclass

from st_codegen.reconcile.settings import UNRECORDED, chosen

#: The simulated joints that were looked at.
SEEDS = "simulated joints of seeds below 500 (tests/reconcile/joint)"
STRIBECK = "a joint with Stribeck's friction (seed 2018 of tests/reconcile/joint)"
CONTROLLED = "simulated joints under control, of some 20 motions, with ripples, Stribeck's friction, play and springs"


@dataclass(frozen=True)
class JointSettings:
    """The decision numbers of joints."""

    # --- reading ---
    #: count; samples of a file at least
    samples: int = 500
    #: steps; how far a sample may be off even ones
    jitter: float = 0.5
    #: steps, of time or between frequencies; a wider one is a gap
    gap: float = chosen(1.5, UNRECORDED)
    #: samples of a piece between lost ones at least: of a shorter one a kernel leaves little
    piece: int = 100
    #: share of a file's samples that such pieces must hold: where they hold less, it is the clock that jitters
    kept_samples: float = 0.5
    #: factor; a file that spans so many times the time of its samples is mostly pauses, over which nothing keeps time
    span: float = 4.0
    #: share by which steps of the angle side by side, or a step and a whole number of them, may differ and be alike
    alike_steps: float = 0.2
    #: noises of the angle that steps must be for this, so that noise makes none twice as long
    sure_step: float = 20.0
    #: turns of a joint from which on an angle without a unit in its name is asked about
    turns: float = 5.0
    #: correlation with the rate of the angle that a given speed must have
    alike: float = 0.9
    #: share by which a given speed may differ from that rate before it is said
    other_rate: float = chosen(0.02, UNRECORDED)
    #: s; a step from which on a time without a unit in its name is asked about: no joint is recorded so slowly, and in
    #: ms every step below 2 kHz is longer
    step: float = 0.5
    #: rad; travel below which a joint stands: ten arcminutes, which simple gears give without sliding (those of robots:
    #: one to three)
    travel: float = 0.003
    #: share of the torque's changes that motion and friction predict below which it may be another joint's
    unrelated: float = 0.5
    #: units of the column; no time, angle, speed or torque is larger
    largest: float = 1e9

    # --- rows ---
    #: share of the power of the acceleration that noise of the angle may make at most: it would make the inertia
    #: smaller by as much
    dilution: float = 1e-3
    #: samples (standard deviations) of the kernel that smooths the angle, least and most
    kernel: tuple[int, int] = (2, 64)
    #: share of the largest speed below which a joint counts as standing
    standing: float = 0.005
    #: noises of the speed up to which a joint counts as standing as well
    sure_speed: float = 5.0
    #: standard deviations of what a rich model leaves from which on a row is far off
    far_off: float = chosen(12.0, UNRECORDED)
    #: share of the rows below which those are left out: more are no single ones
    most_far_off: float = chosen(0.01, UNRECORDED)

    # --- delays ---
    #: s; shifts of the torque that are tried
    most_shift_s: float = chosen(0.03, UNRECORDED)
    #: samples; and no more of them
    most_shift: int = 30
    #: factor; so many times as far is looked where the best shift is the last one
    farthest: int = 10
    #: share of the rows that a shift must leave to be compared
    kept_rows: float = chosen(0.9, UNRECORDED)

    # --- parts ---
    #: factor; ratio of fast to slow speeds (a tenth lies beyond each) below which dry and viscous friction are one
    #: number
    speeds: float = chosen(1.5, SEEDS)
    #: count; stretches of time that are left out in turn; fewer have no scatter to judge by
    blocks: int = 12
    #: standard errors by which a part must predict left-out stretches better (another one in its place that is worse by
    #: less could be the cause as well)
    better: float = chosen(3.0, SEEDS)
    #: share of the stretches that it must predict better
    most: float = chosen(0.7, SEEDS)
    #: standard errors that its size must be (Student's t with 11 degrees: beyond 6 once in 10,000)
    errors: float = 6.0
    #: share of what the others leave that it must explain, so that no form error of a large part counts
    share: float = chosen(0.01, SEEDS)
    #: factor; the square of the speed must be so many times what else is left could make of it: it is the bend that
    #: every other curve over speed has in common with it
    bend: float = chosen(2.0, STRIBECK)
    #: share of the left-out loss above which another round of the load it depends on takes off nothing more
    settled: float = 0.999
    #: share of a part that another one would do in place of, which may be the other's: that one of them is there stays
    #: said
    of_another: float = 0.95
    #: share of their power to which all angles come back where a motion repeats: left-out stretches then are parts of a
    #: round, in every round
    repeats: float = 1e-3
    #: count; columns of the other joints' motion that are taken at most: a robot of six joints has some 20 inertias
    acting: int = 40
    #: share of the largest variation of these columns together below which a smaller one tells nothing of its own
    least_acting: float = chosen(0.01, UNRECORDED)
    #: share; a part whose column is told by the others to all but this cannot be told from them
    told: float = chosen(0.01, SEEDS)
    #: factor; what is left is noise up to so many times the noise of the torque at its highest frequencies
    noise: float = chosen(1.25, SEEDS)
    #: shares of the recording that the time constant of what warms up may be: of a longer one it changes evenly
    warming: tuple[float, float] = (0.15, 1.0)
    #: factor; a travel, or a time, of what comes back after a reversal that is no longer than so many times the
    #: shortest that was tried is none
    shortest: float = 1.001

    # --- waves ---
    #: count; waves over the angle that are looked for
    waves: int = 6
    #: resolutions; how far their order may differ between two halves: each half is every other stretch
    agree: float = 1.0
    #: count; waves that the angle must hold at least to be told from a slow bend
    least_waves: float = chosen(3.0, SEEDS)
    #: factor; how many times the power of their surroundings they have
    stands_out: float = 9.0
    #: resolutions; how far these reach to each side, over the angle and over time. A wave in the pieces of a half
    #: spreads to both sides, and is hidden where the surroundings are no wider than that. Over time they are narrower,
    #: since the harmonics of the motion stand side by side
    around: tuple[float, float] = chosen((20.0, 10.0), CONTROLLED)
    #: factor; torque of the inertia at a frequency, over that of a wave there, from which on the wave is the motion's
    #: own
    own: float = chosen(3.0, SEEDS)
    #: share of the order; a weaker wave so near to a louder one is a part of it: its size or phase changes
    beside: float = chosen(0.15, SEEDS)

    # --- modes ---
    #: share of the torque's power that the motion must explain at a frequency (coherence)
    coherence: float = chosen(0.8, SEEDS)
    #: count; frequencies at which it does
    frequencies: int = chosen(12, SEEDS)
    #: share of half the rate of the samples up to which a response is read: there the double central difference is a
    #: quarter of the second derivative
    told_band: float = 0.6
    #: share of a response that its error is at least
    least_error: float = chosen(0.01, UNRECORDED)
    #: cost that one more number of a form must save
    price: float = chosen(3.0, UNRECORDED)
    #: share of a response by which held-out ones are off at most: a few wild frequencies are no misfit of all
    most_off: float = chosen(3.0, UNRECORDED)
    #: factor; a response is a rigid joint's where it leaves no more than so many times what its errors do
    rigid: float = chosen(1.5, UNRECORDED)
    #: share of rigid joints of which chance may put so much side by side in a response that it is not called rigid
    by_chance: float = 1e-4
    #: factor; cost of a fit that is a mode, over that of the best one, up to which it counts: what is none may fit a
    #: little better
    as_good: float = chosen(1.5, UNRECORDED)
    #: damping ratio; one broader than this is a filter, or none
    broadest: float = chosen(0.3, SEEDS)
    #: damping ratio by which frequencies near a mode are meant where it is narrower
    narrowest: float = chosen(0.05, UNRECORDED)
    #: mean sine of the phase by which the torque leads the acceleration below a mode (without what the mode's own
    #: damping adds), from which on what friction shakes is braked by the drive: a joint has none, but for what is left
    #: of delays
    lead: float = chosen(0.3, CONTROLLED)
    #: share of the mode's frequency up to which this is read
    lead_below: float = chosen(0.8, UNRECORDED)
    #: rad at its frequency; width of the kernel under which a mode is no part of what friction is read from
    below_mode: float = chosen(3.0, SEEDS)
    #: share by which the inertia may change when the kernel is twice as wide: a rigid joint's is the same
    one_inertia: float = chosen(0.03, SEEDS)
    #: share of the misfit that a mode must take off held-out stretches
    mode: float = chosen(0.5, SEEDS)

    # --- words ---
    #: numbers, from and to, that are written without a power of ten
    plain: tuple[float, float] = (1e-6, 1e6)


JOINT = JointSettings()
