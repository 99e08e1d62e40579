"""The numbers that decide in reconcile, each with its unit, and its reason or the cases that it was chosen on.

A *noise* is the standard deviation of one measured number (real or imaginary part of a coefficient) in its own data.
*Loss* is twice Huber's loss: for small residuals it behaves like a chi-square. Units: a *share* is a part of one, a
*factor* how many times, a *count* how many. Beside these numbers stand grids that are searched, limits of work, steps
and tolerances of solvers, how many parts or levels a computation takes, what statistics give, and what pictures show.
Those of joints are in `joint/settings.py`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeVar

_Number = TypeVar("_Number")

#: The simulated cases that were looked at when a number was settled that neither a chance nor physics gives: machines
#: unlike those may want another.
CATALOGUE = "development cases of the catalogue's effects and of other physics (make blind, make blind-form)"
OTHERS = "campaigns of other generators (filters, gaps, sensors that drift, zeros of the angle, laws of no catalogue)"
COUNTED = "all counted cases of other physics, development and held out"
OVER_TIME = "75 simulated recordings over time (ramps, reversals, steps, rounding, other units)"
#: No record says which cases were looked at.
UNRECORDED = "no record"


def chosen(value: _Number, on: str) -> _Number:
    """A number that was chosen on cases."""
    return field(default=value, metadata={"chosen_on": on})


@dataclass(frozen=True)
class Settings:
    """The decision numbers. Those of probability follow from how many questions are put to one data set."""

    # --- reading ---
    #: share by which the turns of curves may be off those of the fast shaft in one turn of the output
    near_the_ratio: float = chosen(0.02, OTHERS)
    #: turns that nobody measures in one curve; a gear of a smaller ratio may be measured over as many
    fast_shaft: float = chosen(20.0, OTHERS)
    #: count; fewer curves cannot tell an effect from a single odd run
    least_curves: int = 8
    #: count; nor can fewer different operating points
    least_points: int = 5
    #: factor; a curve is cut off where it stays at its extreme for more than so many times the samples in a row that it
    #: stays at the value beside it: the rounded top of an even wave stays 4.8 times as long at most, one that is as
    #: flat as a fourth power 10.6 times; a curve of fewer values than that is a coarse one
    flat_top: float = 12.0
    #: count; samples of a recording that the common core is given at most: what more tell is in their mean already
    most_samples: int = 6000
    #: count; and samples that a recording must have
    least_samples: int = 200
    #: share of the samples of a rounded angle that come one step early or late at least
    least_wobbles: float = chosen(0.02, OVER_TIME)
    #: share of a step by which a bend of the angle may differ from it and be one sample that is early or late
    wobble_of_a_step: float = chosen(0.1, UNRECORDED)
    #: share of a step by which rounded angles may lie off its multiples
    off_steps: float = chosen(1e-3, UNRECORDED)
    #: share of a step that this, with what arithmetic leaves, must stay below: else the angle has no digits to tell it
    told_step: float = chosen(0.01, UNRECORDED)
    #: steps between samples by which they may seem to miss a whole turn: they end one step before it does, and where it
    #: does they tell to half a step
    steps_of_turn: float = 1.5
    #: share of the largest speed below which a sample counts as standstill
    standstill: float = chosen(0.02, UNRECORDED)
    #: share of the largest speed up to which the sign of a speed says nothing of the direction
    no_direction: float = chosen(1e-3, UNRECORDED)
    #: share of the samples on either side of the others that may be far off, as spikes are: the rest is what TE ranges
    #: over, where each direction has more samples than that
    far_off: float = 0.005
    #: share of the variance of a condition that must be scatter from sample to sample for it to be nothing else: half
    mostly_scatter: float = 0.5
    #: share of the largest speed from which on a sample is held against the rate of its angle
    fast_enough: float = chosen(0.2, UNRECORDED)
    #: share of the floor that what angles are rounded by must have to be named: half of its power
    least_of_rounding: float = chosen(0.7, OVER_TIME)
    #: samples that have each value of TE, in the mean, where it is rounded to steps: twice those of a bare wave, which
    #: passes each value twice
    least_of_a_step: float = chosen(4.0, OTHERS)
    #: share of the samples over time that hold half of the power of what is left: so few are no normal noise, of which
    #: an eighth hold half
    few_samples: float = chosen(0.04, OVER_TIME)
    #: count; samples of each recording by which readings in other units are compared
    samples_that_tell: int = 500
    #: s; by how much a column of a recording may be late: between one sample and what nobody fails to see
    delays_s: tuple[float, float] = (0.004, 4.0)
    #: samples over which a speed is read from an angle with noise, or from a clock that jitters
    samples_of_rate: int = chosen(15, UNRECORDED)
    #: factor; a step of an angle, or a wait between samples, that is so many times the others is a jump, or a gap
    jump: float = 3.0
    #: turns by which steps beside each other may differ where an angle begins anew: what it speeds up by
    near_a_turn: float = chosen(1 / 16, UNRECORDED)
    #: share by which a given speed may differ from the rate of its angle and be in the same unit
    one_rate: float = 0.1
    #: share of the factor of a unit by which one angle over another may differ from it: no transmission error is so
    #: large a part of it
    exact_factor: float = chosen(0.01, OVER_TIME)
    #: degC; no oil of a gear is hotter
    hottest_oil_C: float = 200.0
    #: factor; waves of noise agree over n runs by 1/n; over both directions by so many times that in one of a thousand
    #: orders
    shared_sure: float = 9.0
    #: share of a run's power: a wave that is less than half of what a run shows is below its noise
    shared_least: float = 0.25
    #: count; of 400 orders so many are shared by no chance
    shared_orders: int = 8
    #: deg; widths of bumps that are looked for in the mean curves
    place_widths_deg: tuple[float, ...] = (0.7, 1.5, 3.0)
    #: standard errors from which on a bump is one: at some 200,000 places, those of mesh orders included, noise reaches
    #: as many once in 100,000 campaigns
    place_sure: float = 7.0
    #: rad; orders times the width of a bump up to which its waves tell it: beyond they are below a hundredth of its
    #: largest
    told_of_bump: float = 3.0
    #: count; waves of a frequency of their own that are looked for
    most_hums: int = 3
    #: periods a turn; how far a hum may be from its order, of which whole numbers have a quarter in the median, and how
    #: far from a whole number a wave is one between orders
    near_an_order: float = chosen(0.1, UNRECORDED)
    #: share of its size near an order that a wave has over the measured angle as well, beside the orders of the rig
    stays_over_angle: float = 0.5
    #: count; steps to each side in which the frequency of a hum that is known to an order is looked for
    steps_of_frequency: int = 200
    #: share of the largest evidence from which on frequencies are as likely; their median is the hum's
    as_likely: float = chosen(0.99, UNRECORDED)
    #: count; loud orders that are tried for a wave of no whole number of periods
    most_tried_between: int = 12
    #: share of such a wave's power that orders which the rig lacks must show: right between two of the rig's it is a
    #: tenth
    least_between: float = chosen(0.05, OTHERS)
    #: count; curves that are asked first
    curves_that_tell: int = 8
    #: orders around a wave that must hold nothing else: what lies farther off is small
    orders_beside_wave: float = 2.6
    #: share of the power beside its order by which what leaks from a wave may be another: of sidebands a fifth is left
    left_beside_wave: float = chosen(0.05, OTHERS)
    #: standard deviations of the noise that a wave must explain beside its order: one in 3 million
    sure_beside_wave: float = 5.0
    #: orders to each side that tell this noise
    noise_beside_wave: int = 40
    #: factor; power over noise of a line of one curve, which noise (exponential) reaches once in 1e13 orders
    loud_line: float = 30.0
    #: order up to which lines are that show as lower ones in curves of few samples: four a line of fine encoders
    highest_line: int = 100_000
    #: share of the runs that have a loud line from which on an order is looked at: fewer are single odd runs
    runs_with_a_line: float = chosen(0.01, UNRECORDED)
    #: count; runs with a loud line beyond this: three at least
    more_runs_with_a_line: float = chosen(2.5, UNRECORDED)
    #: orders to each side by which the size of a line is told
    orders_of_line: int = 8
    #: -log of a chance: of what the slow curves, and the fast ones, say by themselves of a hum that none of them shows
    half_of_hum: float = 5.0

    # --- mistakes of measuring ---
    #: count; rows from which an angle that all have in common is fitted: more tell it better than the vote that follows
    #: asks
    rows_that_tell: int = 100
    #: standard deviations of the slopes of single orders that a ramp over the turn must be
    ramp: float = 4.0
    #: share of it by which a ramp of another ratio differs between slow and fast runs at most
    same_ramp: float = chosen(0.5, OTHERS)
    #: orders of curves, from and to, at which a ramp is looked for: above those of shafts, where there are samples
    #: enough
    ramp_orders: tuple[int, int] = (5, 60)
    #: count; orders that must tell a slope
    least_orders_of_slope: int = 12
    #: count; of these the lowest ones tell the slope of the others
    lowest_of_slope: int = 4
    #: share by which the two slopes may differ
    one_slope: float = chosen(0.2, OTHERS)
    #: count; orders that tell what dies away behind the start of curves
    orders_of_start: int = 100
    #: share of the highest order up to which the phases that a decay turns tell it: a bump has them, too, beyond
    told_decay: float = chosen(0.5, OTHERS)
    #: factor; it rings where its wave is so many times its decay
    rings: float = chosen(2.0, OTHERS)
    #: share of the torques by which a sensor of them may be off anyway; derivatives are taken by as much
    torque_step: float = 1e-3
    #: count; knots over the frequency between which the response of a filter is a straight line: ten orders and more
    #: tell each
    knots_of_filter: int = 12
    #: share by which a filter makes some order larger or smaller: one that only turns them is another angle
    of_a_filter: float = chosen(0.1, OTHERS)
    #: factors on the highest measured frequency between which a mode that may look like a filter is looked for: below,
    #: it shows in orders that are slow and hardly lifted; above, its flank is that of one at the end of the range
    modes_over_highest: tuple[float, float] = (0.05, 2.0)
    #: share of a size that sensors are wrong by, within which each order must want it: numbers of a rig that are wrong
    #: by a tenth want any
    of_a_size: float = 0.25
    #: factor; power over noise from which on a coefficient of a run tells a factor
    loud_order: float = 4.0
    #: count; fewer orders say nothing
    least_votes: int = 4
    #: share of the orders of single runs that must gain
    most_orders: float = chosen(0.75, CATALOGUE)
    #: count; as few orders as this can be turned alike by chance, since as many angles are tried as there are eighths
    #: of the highest order's wave
    least_orders_of_zero: int = 8
    #: rad; error of the turn of an order up to which it is told: beyond, the mean of runs is smaller by a tenth
    told_turn: float = 0.5
    #: rad; up to which turn one that noise may hide is not worth a sentence: its sidebands have a twentieth of the
    #: order
    hidden_turn: float = chosen(0.1, CATALOGUE)
    #: factor; of an angle read wrong once and twice a turn the smaller one is said where the larger is no more than so
    #: many times it
    said_of_axis: float = 5.0
    #: share of what is measured that noise is at most, where too few runs tell it
    most_noise: float = 0.02
    #: factor; the mean power of n runs of noise scatters by 1/sqrt(n): a gap below so many of these is not told
    told: float = chosen(3.0, CATALOGUE)
    #: logarithm of the factor by which its gap falls where an order votes for a mistake: to half
    vote: float = chosen(0.7, CATALOGUE)
    #: count; loads of different sizes from which on leaving one out is no question of how many numbers follow them
    many_levels: int = 12
    #: deg; an angle of home below this is nearer than one is set
    least_home_deg: float = 0.05
    #: deg; zeros of runs are taken for those of one start where most lie together so near
    one_zero_deg: float = chosen(0.01, OTHERS)
    #: share by which others may be farther off and be the same: what is missing may do as much to single runs
    one_zero: float = chosen(0.2, OTHERS)
    #: factor; one of columns below this may be the rig's own
    column_factor: float = chosen(1.1, CATALOGUE)
    #: logarithm of the ratio by which a factor may miss that of a unit which it is asked about
    near_a_unit: float = chosen(0.9, UNRECORDED)
    #: share of the orders that have one factor, each in both directions, from which on it is one of all TE
    nearly_all: float = 0.75
    #: factor; a size that differs by less is told as readings that are too high or too low
    other_size: float = 1.25
    #: share of an order's power that such a factor leaves at most: of runs that differ in sign it leaves most
    left_of_factor: float = 0.5
    #: share of the power of an order that another unit of a column may leave
    left_of_unit: float = chosen(0.04, CATALOGUE)
    #: share of the measured power that the most changed order may keep under that unit
    part_of_measured: float = chosen(0.5, CATALOGUE)
    #: factor; change of an order by a unit, over what the runs tell, from which on the order is asked
    acts_of_unit: float = chosen(50.0, CATALOGUE)
    #: share of the rig's size (RMS), noise apart, below which an order was taken off
    taken_off: float = chosen(0.02, CATALOGUE)
    #: share of the power of an order over the runs that follows the rig, where the order tells the unit of the data: of
    #: noise about one over the number of runs does, of an order that is all the rig's all of it
    along_the_rig: float = 0.5
    #: count; of teeth, pins or a shaft fewer waves than this say nothing of a gear
    least_waves_of_gear: int = 2
    #: count; smaller numbers are no teeth
    least_teeth: int = 5
    #: count; more numbers are no gear's
    most_numbers_of_gear: int = 4
    #: share of the rig's amplitude below which an order is missing
    missing_wave: float = chosen(0.2, UNRECORDED)
    #: factor; a run has one of its own from here on
    block_factor: float = chosen(1.3, CATALOGUE)
    #: count; so many runs make a block
    least_block: int = 3
    #: share of the runs: more than that is no block
    most_of_block: float = 0.45
    #: factor; runs from the first to the last of a block, over those that have its factor: with more between them they
    #: do not follow each other
    runs_of_block: float = chosen(1.5, UNRECORDED)
    #: factors; one on most orders beyond these is that of a unit or of a sign, whatever share of the runs has it
    like_an_effect: tuple[float, float] = (0.1, 10.0)
    #: noises; in the median of runs an order that judges labels is larger than that
    shown_order: float = 3.0
    #: noises; an order judges labels where the rig is right for most runs to so many
    sure_order: float = 3.0
    #: factor; a run is wrong in its label when its loss is so many times the usual
    label_loss: float = chosen(8.0, CATALOGUE)
    #: share of that loss that another label must leave
    label_gain: float = chosen(0.2, CATALOGUE)
    #: share of the runs: more wrong labels than that are something else
    most_labels: float = 0.2
    #: chance; of as many runs that agree with the labels of others whose own are doubted, if they agree with any: a
    #: wrong torque alone is rare already
    labels_chance: float = 1e-3
    #: count; product of places among the labels, beyond which nothing is told of several runs together
    most_places: int = 10_000

    # --- noise ---
    #: count; runs that predict each other by a local plane: four unknowns, and enough left over for a median
    neighbours: int = 10
    #: count; rows that have neighbours from which these tell a noise at all
    least_planes: int = 8
    #: count; rows of a direction, or of one of its speeds, that tell their noise alone: a median scatters by a third
    rows_of_noise: int = 12
    #: noises of one run; what is predicted by its neighbours with a larger error is extrapolated, and says little
    most_extrapolated: float = chosen(2.5, UNRECORDED)
    #: count; contrasts along one axis from which a noise is estimated
    least_contrasts: int = 24
    #: standard errors (a median's is about 1/sqrt(n)) by which it must lie below another estimate to replace it
    clearly_smaller: float = 2.0
    #: count; runs beyond the numbers of a law of the directions from which they tell their noise, to a quarter
    least_beside_a_law: int = 8
    #: chance of the law below which it is no noise
    p_law: float = 1e-4
    #: count; runs at any place of one direction that tell a noise: fewer say nothing
    least_scattered: int = 24
    #: count; of more than these their neighbours say as much at less cost
    most_scattered: int = 200
    #: factor; noise of a speed, or of a curve, that is so many times that of the others counts by itself
    louder_speed: float = 1.6
    #: factor; a run is suspected when its distance from its neighbours is this many times what is usual
    suspect_distance: float = chosen(6.0, CATALOGUE)
    #: deg; a noise of zero would make every difference infinite
    least_noise_deg: float = 1e-9

    # --- fit ---
    #: noises; from here on a residual pulls with its sign only (Huber); one in 90 of normal noise lies beyond it
    huber: float = 3.0
    #: share by which a value of the rig is believed before the data speak: what they do not see stays in place
    prior: float = 1.0
    #: factor; damping of a step from which on no step is left that could gain
    most_damping: float = 1e6
    #: count; rows by which the kernel of a discrepancy is approximated: it is smooth, and far fewer would do
    most_of_kernel: int = 200
    #: factor; a parameter moves with the levels that are left out when its moves are so many times the variance that
    #: noise gives them: of three folds, the fewest, noise does that once in 1000
    moved: float = 5.0

    #: count; speeds and torques at which a run is tried before its label is called wrong: a quarter of a percent of the
    #: range apart
    places_tried: int = 401
    #: count; runs whose labels are exchanged in thought, two by two: so many tell a share within some percent
    labels_tried: int = 100
    #: factor; how many times its lowest frequency the highest of one resonance may be over the measured conditions:
    #: nine times the stiffness, which a contact of curved faces has between loads of one and of 700
    most_shift: float = 3.0
    #: share of the least and of the largest value of a condition by which a run may lie beyond it
    beyond_labels: float = chosen(0.2, OTHERS)

    # --- search ---
    #: count; effects that may be added
    most_effects: int = 40
    #: count; candidates that are fitted in full in a round
    tries: int = 4
    #: count; rounds before the search ends
    rounds: int = 4
    #: loss that a candidate must save in a linear step to be looked at
    least_candidate_gain: float = chosen(20.0, UNRECORDED)
    #: loss; gains that differ by less are equal
    tie: float = 1e-3
    #: share of the best net gain below which a candidate is not tried beside the best one
    clear: float = chosen(0.5, CATALOGUE)
    #: share of what an effect saves, or the best linear step if that is less, below which no other name is tried
    clear_beside: float = chosen(0.3, UNRECORDED)
    #: factor; a candidate that failed is tried again when its gain has changed by it
    changed_gain: float = chosen(1.25, CATALOGUE)
    #: count; steps of a fit that only compares candidates
    quick_steps: int = 6
    #: loss; how exact such a fit is
    quick_tolerance: float = 0.5
    #: count; steps of a fit that others are compared with: what it has not reached yet would count as theirs
    long_steps: int = 50
    #: loss that an order must save to be taken into a resonance: four parameters do so once in 20,000 by chance
    order_gain: float = 25.0
    #: count; frequencies at which a resonance is started
    resonance_starts: int = 3
    #: logarithm of the ratio by which two of these must differ
    other_start: float = chosen(0.02, UNRECORDED)
    #: share of the lowest and the highest speed by which a resonance may be met beyond them in the search
    beyond_speeds: float = chosen(0.1, UNRECORDED)
    #: share by which a resonance must reach into the measured frequencies
    inside_speeds: float = chosen(0.02, UNRECORDED)
    #: share of the frequency by which two resonances of the same orders must lie apart
    same_resonance: float = 0.1
    #: count; parts of the runs between which the temperature is looked for at which a structure may change its state
    most_states: int = 8
    #: count; rows that each state has at least
    least_rows_of_state: int = 12
    #: orders; to both sides of its own a bell of 10 deg half width at one angle of the turn reaches as far
    reach_of_bell: int = 6
    #: count; with fewer orders near each other a bell at some angle has any sizes and phases of theirs
    least_in_bell: int = 3
    #: share of the frequency of a state by which others are tried
    state_step: float = 0.02
    #: share of the frequency of the other state up to which they are
    state_reach: float = chosen(0.16, CATALOGUE)
    #: loss that a resonance must save at two frequencies at least, each: one loud point can be anything
    point_gain: float = 12.0
    #: damping ratio above which there is no peak that could be told from any other dependence on speed
    broadest: float = 0.15
    #: share of the range of a parameter within which it lies at its bound
    edge: float = 1e-3
    #: share of what a candidate saves that it may cost on any one order: what bends other parameters is not the cause
    expense: float = chosen(0.02, CATALOGUE)
    #: share of all that an effect saves from which on an order is one of its own, which it must fit
    own_order: float = chosen(0.05, UNRECORDED)
    #: bytes of responses that are kept from search to search
    most_kept_bytes: int = 400_000_000
    #: count; and pieces that are
    most_cached: int = 300
    #: bytes that fits may take which are computed at the same time
    most_shared_bytes: int = 4_000_000_000
    #: count; coefficients from which on some fits take far longer than copies of the process
    large: int = 5_000

    # --- evidence ---
    #: chance of a false addition that each test of one candidate is allowed: about a hundred candidates are tried on a
    #: data set, and the tests must all pass, so that well under 1 % of data sets without a missing effect see a name
    p_chance: float = 1e-6
    #: chance; the same where runs of about the same speed and temperature may have noise in common
    p_clusters: float = 1e-4
    #: noises of one coefficient that an effect must stand as high as: noise that lasts over runs can look like less
    least_size: float = 1.0
    #: share of the power that an effect has on its largest order from which on another order counts for its size
    touched: float = chosen(0.1, UNRECORDED)
    #: share of what all runs know of a combination of parameters that the others must keep when a fold is left out:
    #: below it their error grows more than fivefold, and what they say of the fold is no prediction
    kept_knowledge: float = 0.04
    #: count; operating points from which on some are kept from the search: the reported held-out gap comes from there;
    #: fewer are needed for the search itself, and levels are left out of the fit in turn
    least_points_apart: int = 60
    #: count; one in so many is kept from it
    one_apart_in: int = 8
    #: factor; a held-out gap that rises by more than its own scatter from run to run: the rig stays as it is
    worse: float = chosen(1.02, CATALOGUE)
    #: factor; the gap of levels that were left out counts in place of that of unseen runs from so many times on, and so
    #: many times the floor are more than noise: these gaps scatter
    clearly_larger: float = chosen(1.25, CATALOGUE)
    #: factor; power above the orders that are looked at is told where it is so many times that of noise as below: noise
    #: that rises with the order, as of encoders whose errors repeat, may have twice as much there
    beyond_band: float = 4.0
    #: count; a power that is normal in eight runs of two curves has fewer carriers than one in so many of these once in
    #: 80 times
    carried_by_one_in: float = 5.0
    #: count; from one operating point that meets what was added nobody learns how much others differ from it
    least_testers: float = 2.0
    #: count; resampled data sets
    resamplings: int = 60
    #: share of them in which an effect must keep its size
    stable: float = chosen(0.9, CATALOGUE)
    #: count; parts of recordings, one after the other, in which what a link of the axis does must take something off
    parts_of_link: int = 5
    #: share of these parts in which it must: four of five
    stable_link: float = chosen(0.7, UNRECORDED)
    #: standard errors by which a number of a link must be off the rig's to have changed: normal errors are so large
    #: once in 2 million, and those of five parts, which have four degrees of freedom, once in 130
    sure_of_link: float = 5.0
    #: share (RMS) of a column of a fit to a link that no sum of the fit's other columns makes, from which on the data
    #: tell its size: of less, small errors of the others make as much as its size does
    told_of_column: float = 1e-3
    #: share of what is left on a link (RMS) that what is said to make it may leave, where that is no noise: a hundredth
    #: of the power
    rest_of_link: float = 0.1
    #: noises of one sample that the effect of a link must stand as high as: many samples tell it
    least_size_of_link: float = chosen(0.3, UNRECORDED)
    #: noises of one sample from which on what is left on a link is said
    left_on_link: float = chosen(1.5, UNRECORDED)

    # --- what the order of the runs tells ---
    #: share of a step that must lie between the means of a sixteenth of the runs on both sides: of a trend it is an
    #: eighth, of a step all
    at_once: float = chosen(0.5, OTHERS)
    #: count; runs at which a trend may begin or end
    bends: int = chosen(24, OTHERS)
    #: count; steps that are compared beside a condition: of more runs as many, evenly
    most_cuts: int = 512

    # --- what lies around ---
    #: factor; power of one of many random waves over their mean: exponential, so that one in 8,000 is so large, and one
    #: in 420 over the mean of eight others
    stands_out: float = 9.0
    #: count; orders on a side of one whose median says what most have there
    least_on_a_side: int = 3
    #: orders to each side that are alike where structure is broad: a bump of 6 deg fades within ten
    around_order: int = 20
    #: orders to each side of a line of samples over time, from and to: those beside it hold what leaks of it where the
    #: turns are not whole, those far away another part of a spectrum that falls
    around_line: tuple[int, int] = (2, 6)
    #: share of the most that an order holds of a change below which it does not speak for it
    part_of_change: float = chosen(0.05, CATALOGUE)
    #: widths to each side that a bump is seen in
    reach_of_place: float = 3.0
    #: share of its power by which another bump (a trapezoid) differs in form
    left_of_place: float = chosen(0.15, CATALOGUE)
    #: noises over the root of the runs; mean power beyond the noise that an order of curves may hold unseen
    quiet_order: float = 6.0
    #: share by which a burst of a mesh order must leave less of its form than one of any other order, where nothing
    #: else stands beside its name
    told_order: float = chosen(0.2, OTHERS)
    #: factors of the width that was fitted, at which both bursts are compared
    widths_of_burst: tuple[float, ...] = (0.6, 0.8, 1.0, 1.25, 1.6)
    #: deg; how near to where curves begin and end a place may be what happens there
    reach_of_start_deg: float = chosen(10.0, OTHERS)
    #: deg; how far on both sides of an angle what many orders hold together may reach
    reaches_of_place_deg: tuple[float, ...] = (2.0, 4.0, 8.0, 16.0)
    #: count; unexplained orders beside those of the rig of which is said that they lie so
    least_beside: int = 3

    # --- conclusions ---
    #: share of what an effect saves that its orders may keep of loss, beyond noise: with more it is not named; that of
    #: a link of the axis too (power)
    misfit: float = chosen(0.3, CATALOGUE)
    #: share; the same for a change of the rig in curves, which tell their noise: what bends a parameter leaves more
    misfit_in_curves: float = 0.1
    #: share; the same for a resonance, never quite that of one oscillator: it must explain more than it leaves
    misfit_of_peaks: float = chosen(1.0, CATALOGUE)
    #: chance by which the peaks of its orders may agree on a frequency, each at its own speed: then it may leave more
    p_agree: float = 0.02
    #: share of its size in each run to which the form of an effect is believed: what else takes off no more than that
    #: on the same orders may be what the form lacks
    form: float = chosen(0.1, CATALOGUE)
    #: share of its largest contribution from which on an effect acts
    acts: float = chosen(0.3, CATALOGUE)
    #: count; changes of the rig that may stay beside a reading (with more it explains little)
    beside_reading: int = chosen(2, OTHERS)
    #: count; changes that are tried for it
    changes_tried: int = chosen(4, OTHERS)
    #: count; changes from which on two readings at once are tried, where none stands for most of them alone
    changes_of_two: int = chosen(6, OTHERS)
    #: count; pairs of readings that are tried
    pairs_tried: int = chosen(3, OTHERS)
    #: share by which a factor of all torques may be off that of a unit which is named beside it
    near_a_torque: float = chosen(0.02, OTHERS)
    #: count; how often data are read anew
    rereadings: int = 3
    #: share of the power of what is unexplained that may be left where a reading does it
    left_of_rest: float = chosen(0.1, OTHERS)
    #: share that may be left at its first step: one that takes off a tenth is tried on
    begins_to_do: float = chosen(0.9, OTHERS)
    #: share of its error below which a size of a reading would move where it is found
    of_an_error: float = 0.25
    #: factor; loss of a run by noise with heavy tails, which a robust estimate of the noise takes for one
    tails: float = chosen(1.4, CATALOGUE)
    #: share of what one height of all loads leaves that a height of a resonance which follows the load may leave
    left_of_height: float = chosen(0.5, OTHERS)
    #: share of what one resonance leaves of its orders that two beside each other may leave
    left_of_one: float = chosen(0.05, CATALOGUE)
    #: loss by which another name may be worse and still be as good a name: 1 in 1000 by chance for one parameter
    as_good: float = 11.0
    #: count; other names that are fitted in full
    other_names: int = 3
    #: counts; names that were true, of how many, where an order alone or few runs give them: so often is such a name
    #: true
    names_by_order: tuple[int, int] = chosen((167, 192), COUNTED)
    #: counts; the same where more gives them; of 1,501 cases of the suite of other physics (make blind-form)
    names_by_more: tuple[int, int] = chosen((415, 418), COUNTED)
    #: damping ratio whose peak fits between two speeds of a campaign
    narrow: float = 0.006
    #: share of its size in the rig below which an effect may be one that the machine does not have
    nothing_left: float = chosen(0.3, OTHERS)
    #: chance that a parameter of the rig is called changed although it is not
    p_changed: float = 1e-7
    #: noises; a change that is the same in all runs counts from this size on: noise that lasts looks like less
    least_constant: float = chosen(0.63, CATALOGUE)
    #: share of its power by which a change may vary and still be the same in all runs
    varies: float = chosen(0.1, CATALOGUE)

    # --- what is unexplained ---
    #: false discovery rate of the orders that are called significant
    discovery_rate: float = 1e-4
    #: noises; for the decision (not for the size) residuals are cut here, so that single wild runs make no structure
    cut: float = 5.0
    #: share of the noise (power) below which structure is an error of its estimate
    least_excess: float = chosen(0.4, CATALOGUE)
    #: count; orders of which the middle one tells the noise of each of them, where few runs do not
    orders_beside: int = 9
    #: factor; a residual so many times the noise between the orders of its curves is more than that noise
    beyond_spectral: float = chosen(2.0, CATALOGUE)
    #: orders that tell how strong a slow wander within one turn is, which makes the low ones louder
    wander_orders: int = 5
    #: count; a twist of two slopes with a knee has four numbers: so many torques refuse it where the play is taken up
    torques_of_a_knee: int = 5
    #: count; knees that are tried, by quantiles of the torques
    knees_tried: int = 12
    #: powers of the load that a twist may follow: contact is between a half and one
    powers_of_a_load: tuple[float, ...] = chosen((0.5, 2 / 3, 0.75, 0.9), OTHERS)
    #: powers of the speed that drag may follow: a film of oil below one, oil that is churned up to two
    powers_of_a_drag: tuple[float, ...] = (0.5, 2 / 3, 1.25, 1.5, 1.75, 2.0)
    #: logarithm; what it may lose a kelvin of oil temperature: gear oils lose 0.03 to 0.05
    decays_of_a_drag: tuple[float, ...] = (0.0, 0.01, 0.02, 0.025, 0.03, 0.035, 0.04, 0.045, 0.05, 0.06, 0.08)
    #: powers of the load that else a mesh order may follow: contact of lines and points, and what grows faster
    powers_of_a_mesh: tuple[float, ...] = (0.5, 2 / 3, 1.0, 1.5, 2.0)
    #: powers of which none may leave clearly less than the one that is said
    any_power: tuple[float, ...] = tuple(n / 20 for n in range(6, 61))
    #: share by which a number that says a form may be off and say the same one: 2/3 is written as 0.667
    one_form: float = 0.01
    #: factor; a law that is nothing at one end of a condition and grows in proportion to it is a constant, and what
    #: differs from it by a third of its power
    constant_of_a_law: float = 3.0
    #: count; so many quiet orders tell the noise of an order of a curve, half of those whose median it is
    quiet_beside: int = 12
    #: standard deviations; of tables, whose orders may differ: so many of their usual distances above those beside it,
    #: one of 15,000 of normal ones
    beyond_usual: float = 4.0
    #: factor; and at most so many times as loud, or where there are too few orders to tell
    beyond_beside: float = chosen(10.0, CATALOGUE)
    #: count; orders of tables that tell their usual distances
    least_orders_beside: int = 8
    #: count; orders that tell what the noise of one between them is
    near_floors: int = 4
    #: count; multiples of the lines of an encoder that its steps show, the first ones
    multiples_of_lines: int = 12
    #: count; how many of them must be there: by chance two of some 30 orders are among them
    least_multiples: int = 4
    #: count; lines a turn that encoders have
    encoder_lines: tuple[int, ...] = (512, 1024, 2048, 2500, 3600, 4096, 5000, 8192, 9000, 16384, 18000, 32768, 65536)
    #: orders that sidebands of these lines reach
    sidebands_of_lines: int = 2
    #: share of the power of the mean that the middle run has at least where all runs have a wave: of noise 0.69
    in_most_runs: float = chosen(0.25, OTHERS)
    #: count; runs in a known order that are needed to look for steps and trends
    least_in_time: int = 24
    #: factor; how much of what it leaves a step or a trend must explain: a wander as large as the noise passes for
    #: noise that lasts
    least_excess_in_time: float = chosen(1.5, CATALOGUE)
    #: count; a condition that changes in every so many runs at most has levels that look like a wander over the runs:
    #: three levels in any order change in two of three
    runs_of_a_level: float = 3.0
    #: count; the lowest waves over the runs of noise that wanders tell how its power falls, by the median: of five two
    #: may be loud or faint by chance
    waves_of_a_wander: int = 5
    #: share of the noise of runs; no wave counts as fainter: its logarithm would say how small what is left of it is by
    #: chance
    faintest_wave: float = 1e-3
    #: chance of a step below which an order wanders over the runs
    p_wander: float = 0.01
    #: share of the other orders that may: of 40 campaigns of ten orders and no step three at most had one, in walks of
    #: 0.25 to 5 noises, 1/f and other noise
    most_wandering: float = 0.25
    #: correlation of runs that follow each other, beyond what is chance, below which a mean that wanders is not said
    least_alike: float = chosen(0.25, UNRECORDED)
    #: count; other orders of the runs in none of which a step or a trend may gain as much: 1 in 100 by chance
    other_orders_of_runs: int = 99
    #: count; so few are enough where none of them gains half as much
    few_orders_of_runs: int = 9
    #: factor; a condition that gains so many times what it does in each of these few gains twice what it does in any
    beyond_few_orders: float = 4.0
    #: share by which the size of a formula may change over the runs of which is said that it keeps its size
    keeps_its_size: float = chosen(0.2, OTHERS)
    #: rad; by what its phase turns at least then
    least_turn_rad: float = chosen(0.3, OTHERS)
    #: share of the power of runs that they have in common from which on they are not called different
    same_in_runs: float = chosen(0.5, OTHERS)
    #: factor; power of one direction over that of the other from which on it is the only one, or has most of it: three
    #: times the size
    one_sided: float = 9.0
    #: share of the power of a residual that both directions must have with opposite signs for that to be said
    opposed: float = 0.9
    #: share of an unexplained part from which on a condition is called what it depends on
    cause: float = 0.1
    #: factor; how many times the share of the next condition it must have
    clear_cause: float = chosen(2.0, OTHERS)
    #: factor; how many times the logarithm of the runs a term of a formula must save
    term_price: float = chosen(2.0, CATALOGUE)
    #: share of what is left to save that it must
    term_share: float = chosen(0.02, CATALOGUE)
    #: count; terms of a formula
    most_terms: int = 3
    #: count; parts of the levels of a condition that are left out of a formula in turn at most
    formula_blocks: int = 10
    #: share of them that it must explain
    formula_explains: float = chosen(0.8, CATALOGUE)
    #: share from where on that is all of it
    formula_whole: float = chosen(0.97, CATALOGUE)
    #: share of the variance of a condition that another one tells, from which on the two go together: the error of what
    #: each does alone is three times as large
    together: float = 0.9
    #: count; waves that are told of samples over time
    most_lines: int = 8
    #: standard errors of its noise that a wave of samples must be: autocorrelation may double them, and what has no
    #: line is noise to it
    sure_line: float = 10.0
    #: count; waves of which a mean that wanders is made: noise makes the root of so many standard errors (8) of them,
    #: less than the 10 that are asked of what is told
    most_waves_of_mean: int = 64
    #: share of a wave that a recording must hold to tell that it is one: the steps of samples may take a little off it
    least_of_wave: float = chosen(0.9, OVER_TIME)
    #: turns; a wave that changes over samples is told anew in pieces of at least so much of one: a piece of a resonance
    #: that is passed is hardly shorter
    piece_of_turn: float = chosen(0.125, OVER_TIME)
    #: periods that such a piece has at least
    waves_of_piece: float = chosen(4.0, OVER_TIME)
    #: count; samples of it: two numbers are told of it
    least_of_piece: int = chosen(8, OVER_TIME)
    #: share of what a piece whose waves are even tells of both numbers at once, from which on both are told
    both_of_piece: float = chosen(0.1, UNRECORDED)
    #: orders to each side that such a wave may hold as well, since its phase turns
    beside_changing: int = chosen(3, OVER_TIME)
    #: share of what it leaves that one of its own tells there (parts of a resonance tell up to 7 %)
    own_beside_changing: float = chosen(0.1, OVER_TIME)
    #: factor; up to so many times what the best order leaves above the noise, others leave about as little
    as_little: float = chosen(2.0, OVER_TIME)
    #: share of its wave by which they may leave more
    as_little_of_wave: float = chosen(0.15, OVER_TIME)
    #: turns of a recording from which on a wave between two orders is told from these (one over the turns tells orders
    #: apart)
    least_turns_between: float = 3.0
    #: orders; how far from a whole one it lies at least
    off_order: float = chosen(0.05, OTHERS)
    #: share of the RMS of all that is left that it has: a quarter of the power in one of some thousand lines is no
    #: chance, and no noise that is some lines wide
    part_of_rest: float = chosen(0.5, OTHERS)

    #: share of the range of a condition from which on a gap parts two levels of it, whose values scatter
    clear_gap: float = chosen(0.15, OTHERS)
    #: N m; torque below which a run tells backlash from dry friction: the least that seats the flanks
    near_no_load_Nm: float = 30.0

    # --- suspects ---
    #: noises; an order of a run is off from here on. One of 2200 good runs is above it in both directions at once; bad
    #: runs that show at all begin at 4.8
    off: float = chosen(5.0, CATALOGUE)
    #: count; orders that must be off in a run of one direction only
    orders_alone: int = 3
    #: count; a residual is shared where so many of the nearest runs along an axis have it as well
    alike: int = 2
    #: count; the nearest runs that are asked
    near: int = 4
    #: share of a residual by which those that have it as well differ from it at most
    similar: float = chosen(0.5, CATALOGUE)
    #: coherence; a deviation that a run at another temperature has as well, so coherent, is no bad run
    coherent: float = chosen(0.7, CATALOGUE)
    #: share of its size that it must have there
    comparable: float = chosen(0.5, CATALOGUE)
    #: steps along an axis that one across it counts as
    across: float = chosen(4.0, CATALOGUE)
    #: share of the runs: more suspects than that are no bad runs, but something else
    most_suspects: float = 0.1
    #: share of the power of what has no pattern; curves that hold it are named where they are few
    held_by_few: float = 0.8
    #: count; curves that are named for that: both of two runs
    few_named: int = 4

    #: chance of as many wrong runs so close together along a condition: of rarer ones nobody knows whether they are
    #: wrong or the machine does something of its own there
    p_beside: float = 0.01

    # --- order spectra ---
    #: count; orders of a direction that tell a floor
    spectrum_orders: int = 8
    #: share of the orders that is taken for noise
    spectrum_quiet: float = 0.25
    #: factor; an order is there when it stands so many times above the median of these
    spectrum_clear: float = 3.0
    #: share of all spectra in which noise that scatters as these do reaches as much, in any order
    spectrum_chance: float = 0.01
    #: share of the names of one effect that may be expected to be coincidences of orders
    coincidence: float = 0.1
    #: factor; a sideband is at most this large against its mesh order (the bound of the effect)
    largest_ratio: float = 5.0
    #: orders; an unnamed one is described by mesh orders that are no farther away
    near_orders: int = 8

    # --- the next measurement ---
    #: count; runs that are proposed at once
    most_next_runs: int = 12
    #: count; numbers that are held of all points which are weighed: 160 MB
    most_numbers_of_points: float = 2e7
    #: nats that one must add beside those before it: a volume of errors that is a twentieth smaller
    least_gain: float = 0.05
    #: count; runs that are proposed again where runs differ without a pattern: a spread of four is told to a third
    repeats: int = 4
    #: share of a size below which its error says that it is known: until then runs are proposed whatever they add
    well_known: float = 0.05
    #: share of the most that a run can add from which on another one adds about as much: the expectation is linear, and
    #: no better known than that
    about_as_much: float = 0.8
    #: percent by which an error falls that are worth a number
    least_fall: float = 1.0
    #: count; parts of the range of speeds: runs inside one have about the same speed (as where measured speeds do not
    #: repeat)
    speeds_apart: int = 12
    #: logarithm of the odds, expected, at which two explanations count as told apart: a chance of one in a million
    told_apart: float = 14.0
    #: steps that the correlation of a residual reaches along conditions on which it does not depend
    far_along: float = chosen(4.0, UNRECORDED)
    #: steps along conditions on which it depends: between two levels it may do much
    near_along: float = chosen(0.5, UNRECORDED)
    #: steps of the speed inside a peak that is narrower than these
    inside_peak: float = chosen(0.125, UNRECORDED)
    #: share of a residual that a run leaves open where it was made
    left_open: float = chosen(0.01, UNRECORDED)
    #: count; points between two measured speeds that are considered
    between: int = 3
    #: count; levels of torque at most
    most_torques: int = 7
    #: count; levels of temperature at most
    most_temperatures: int = 3
    #: half widths of a peak at which speeds around it are: the flanks tell the frequency, top and feet height and
    #: damping
    around_peak: tuple[float, ...] = (-4.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 4.0)
    #: factors of the torque at which flanks seat, at which torques about it are
    around_seating: tuple[float, ...] = (0.25, 0.5, 1.0, 2.0, 4.0)
    #: count; refused candidates that are considered as rival explanations of what is unexplained
    most_rivals: int = 3
    #: count; unexplained orders that runs are proposed for, the largest first
    most_open_orders: int = 8

    # --- models and words ---
    #: count; measured rows inside the ranges of a bundle that are needed to judge it
    least_rows: int = 8
    #: standard errors by which a term must take off power to become a part of a model
    sure_term: float = 3.0
    #: share of the whole gap from which on it says more than the gap of an effect's own orders
    much: float = 0.05
    #: factor; a held-out gap of so many floors is one to give the reason of
    above_floor: float = 1.3
    #: share of its power that the orders make which are said to make it
    most_of_gap: float = 0.75
    #: share of a gap below which an order is not listed among those that make it
    least_listed: float = 0.01
    #: standard errors by which a parameter must differ to be shown as changed, or as not zero
    clearly: float = 2.0
    #: factor; how many times as high a resonance must be in one direction for that to be said
    times_of_one_side: float = 3.0
    #: factor; more than that nobody needs to know
    most_times: float = 100.0
    #: factor by which an order must be larger with a resonance to be called lifted
    lifted: float = 1.5
    #: factor from which on one is written without a digit behind the point
    whole_times: float = 100.0
    #: deg; what few samples lie around so close together stands at one place of the turn
    one_place_deg: float = 15.0


SETTINGS = Settings()
