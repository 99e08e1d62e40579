"""Every number that decides something in reconcile, once, with its reason.

A *noise* is the standard deviation of one measured number (real or imaginary part of a coefficient) in its own data.
*Loss* is twice Huber's loss: for small residuals it behaves like a chi-square.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """The decision numbers. Those of probability follow from how many questions are put to one data set."""

    # --- reading ---
    #: fewer curves, or fewer different operating points, cannot tell an effect from a single odd run
    least_curves: int = 8
    least_points: int = 5
    #: a curve is cut off where it stays at its extreme for more than so many times the samples in a row that it stays
    #: at the value beside it: the rounded top of an even wave stays 4.8 times as long at most, one that is as flat as
    #: a fourth power 10.6 times; a curve of fewer values than that is a coarse one
    flat_top: float = 12.0
    #: samples of a recording that the common core is given at most: the information of more is in their mean already
    most_samples: int = 6000
    least_samples: int = 200
    #: share of the samples of a rounded angle that come one step early or late at least
    least_wobbles: float = 0.02
    #: share of the floor that what angles are rounded by must have to be named: half of its power
    least_of_rounding: float = 0.7
    #: half of the power of what is left over time is in so few of the samples that it is no normal noise, of which an
    #: eighth hold half
    few_samples: float = 0.04
    #: samples of each recording by which readings in other units are compared
    samples_that_tell: int = 500
    #: by how much (s) a column of a recording may be late: between one sample and what nobody fails to see
    delays_s: tuple[float, float] = (0.004, 4.0)
    #: how near one angle over another is to the factor of a unit: no transmission error is so large a part of it
    exact_factor: float = 0.01
    #: no oil of a gear is hotter
    hottest_oil_C: float = 200.0
    #: waves of noise agree over n runs by 1/n; over both directions by so many times that in one of a thousand orders,
    #: so that of 400 so many are no chance; a wave that is less than half of what a run shows is below its noise
    shared_sure: float = 9.0
    shared_least: float = 0.25
    shared_orders: int = 8
    #: widths of bumps that are looked for in the mean curves, and from how many standard errors on: at some 200,000
    #: places, those of mesh orders included, noise reaches as many once in 100,000 campaigns
    place_widths_deg: tuple[float, ...] = (0.7, 1.5, 3.0)
    place_sure: float = 7.0
    #: waves of a frequency of their own that are looked for; power over noise of a line of one curve, which noise
    #: (exponential) reaches once in 1e13 orders; orders to each side by which its size is told
    most_hums: int = 3
    #: loud orders that are tried for a wave of no whole number of periods; part of its power that orders which the rig
    #: lacks must show: right between two of the rig's it is a tenth
    most_tried_between: int = 12
    least_between: float = 0.05
    #: curves that are asked first, and orders around a wave that must hold nothing else: what lies farther off is small
    curves_that_tell: int = 8
    orders_beside_wave: float = 2.6
    #: part of the power beside its order by which what leaks from a wave may be another (of sidebands a fifth is left),
    #: standard deviations of the noise that it must explain there (one in 3 million), and orders to each side that tell
    #: this noise
    left_beside_wave: float = 0.05
    sure_beside_wave: float = 5.0
    noise_beside_wave: int = 40
    loud_line: float = 30.0
    orders_of_line: int = 8
    #: -log of the chance of what the slow curves, and the fast ones, say by themselves of a hum that none of them shows
    half_of_hum: float = 5.0

    # --- mistakes of measuring ---
    #: rows from which an angle that all have in common is fitted: more tell it better than the vote that follows asks
    rows_that_tell: int = 100
    #: a ramp over the turn must be so many standard deviations of the slopes of single orders
    ramp: float = 4.0
    #: and one of another ratio differs between slow and fast runs by no more than this share of it
    same_ramp: float = 0.5
    #: orders of curves at which it is looked for: above those of shafts, where there are samples enough
    ramp_orders: tuple[int, int] = (5, 60)
    #: of so many of them the lowest ones tell the slope of the others, to this part of it
    least_orders_of_slope: int = 12
    lowest_of_slope: int = 4
    one_slope: float = 0.2
    #: what dies away behind the start of curves is told by so many orders; by the phases that its decay turns, up to a
    #: share of the highest order (a bump has them, too, beyond); and it rings where its wave is so many times its decay
    orders_of_start: int = 100
    told_decay: float = 0.5
    rings: float = 2.0
    #: share of the torques by which a sensor of them may be off anyway; derivatives are taken by as much
    torque_step: float = 1e-3
    #: knots over the frequency between which the response of a filter is a straight line: ten orders and more tell each
    knots_of_filter: int = 12
    #: a filter makes some order larger or smaller by this part: one that only turns them is another angle
    of_a_filter: float = 0.1
    #: share of a size that sensors are wrong by, within which each order must want it: numbers of a rig that are wrong
    #: by a tenth want any
    of_a_size: float = 0.25
    #: a coefficient of a run tells a factor where its power is so many times the noise's; fewer orders say nothing
    loud_order: float = 4.0
    least_votes: int = 4
    #: share of the orders of single runs that must gain; as few orders as this can be turned alike by chance, since as
    #: many angles are tried as there are eighths of the highest order's wave
    most_orders: float = 0.75
    least_orders_of_zero: int = 8
    #: error (rad) of the turn of an order up to which it is told: beyond, the mean of runs is smaller by a tenth
    told_turn: float = 0.5
    #: and up to which one that noise may hide is not worth a sentence: its sidebands have a twentieth of the order
    hidden_turn: float = 0.1
    #: noise is at most this share of what is measured, where too few runs tell it
    most_noise: float = 0.02
    #: the mean power of n runs of noise scatters by 1/sqrt(n): a gap below so many of these is not told
    told: float = 3.0
    #: an order votes for a mistake when its gap falls to half (a logarithm)
    vote: float = 0.7
    #: loads of different sizes from which on leaving one out is no question of how many numbers follow them
    many_levels: int = 12
    #: an angle of home below this is nearer than one is set; a factor of columns below this may be the rig's own
    least_home_deg: float = 0.05
    #: zeros of runs are taken for those of one start where most lie together so near (deg), and others for the same
    #: where they are no farther off than by this share, which what is missing may do to single runs
    one_zero_deg: float = 0.01
    one_zero: float = 0.2
    column_factor: float = 1.1
    #: a factor that so large a share of the orders has, each in both directions, is one of all TE, from such a size on:
    #: smaller ones are told as readings that are too high or too low
    nearly_all: float = 0.75
    other_size: float = 1.25
    #: and that leaves less than this share of an order's power: of runs that differ in sign it leaves most
    left_of_factor: float = 0.5
    #: another unit of a column must take all but this part (power) off every order that it changes by so many times
    #: what the runs tell; an order of which this part (RMS) of the rig's is left, noise apart, was taken off
    left_of_unit: float = 0.04
    part_of_measured: float = 0.5
    acts_of_unit: float = 50.0
    taken_off: float = 0.02
    #: a run has a factor of its own from here on; so many runs make a block, and more than that share is none
    block_factor: float = 1.3
    least_block: int = 3
    most_of_block: float = 0.45
    #: a factor on most orders beyond these is that of a unit or of a sign, whatever share of the runs has it
    like_an_effect: tuple[float, float] = (0.1, 10.0)
    #: an order judges labels where the rig is right for most runs (noises); a run is wrong there when its loss is so
    #: many times the usual, and another label must leave this share of it; more runs than that are something else
    sure_order: float = 3.0
    label_loss: float = 8.0
    label_gain: float = 0.2
    most_labels: float = 0.2

    # --- noise ---
    #: runs that predict each other by a local plane: four unknowns, and enough left over for a median
    neighbours: int = 10
    #: contrasts along one axis from which a noise is estimated, and by how many standard errors (a median's is about
    #: 1/sqrt(n)) it must lie below another estimate to replace it
    least_contrasts: int = 24
    clearly_smaller: float = 2.0
    #: runs beyond the numbers of a law of the directions from which they tell their noise, to a quarter, and the chance
    #: of the law below which it is no noise
    least_beside_a_law: int = 8
    p_law: float = 1e-4
    #: noise of a speed, or of a curve, that is so many times that of the others counts by itself
    louder_speed: float = 1.6
    #: a run is suspected when its distance from its neighbours is this many times what is usual
    suspect_distance: float = 6.0
    #: a noise of zero would make every difference infinite; deg
    least_noise_deg: float = 1e-9

    # --- fit ---
    #: from here on a residual pulls with its sign only (Huber); one in 90 of normal noise lies beyond it
    huber: float = 3.0
    #: a value of the rig is believed this far (relative) before the data speak: what they do not see stays in place
    prior: float = 1.0
    #: rows by which the kernel of a discrepancy is approximated: it is smooth, and far fewer would do
    most_of_kernel: int = 200
    #: a parameter moves with the levels that are left out when its moves are so many times the variance that noise
    #: gives them: of three folds, the fewest, noise does that once in 1000
    moved: float = 5.0

    #: speeds and torques at which a run is tried before its label is called wrong: a quarter of a percent of the range
    #: apart
    places_tried: int = 401
    #: runs whose labels are exchanged in thought, two by two: so many tell a share within some percent
    labels_tried: int = 100
    #: how many times its lowest frequency the highest of one resonance may be over the measured conditions: nine times
    #: the stiffness, which a contact of curved faces has between loads of one and of 700
    most_shift: float = 3.0
    #: part of the least and of the largest value of a condition by which a run may lie beyond it
    beyond_labels: float = 0.2

    # --- search ---
    #: effects that may be added, candidates fitted in full in a round, and rounds, before the search ends
    most_effects: int = 40
    tries: int = 4
    rounds: int = 4
    #: share of the best net gain below which a candidate is not tried beside the best one
    clear: float = 0.5
    #: a candidate that failed is tried again when its gain has changed by this factor
    changed_gain: float = 1.25
    #: steps of a fit that only compares candidates, and how exact it is (loss)
    quick_steps: int = 6
    quick_tolerance: float = 0.5
    #: steps of a fit that others are compared with: what it has not reached yet would count as theirs
    long_steps: int = 50
    #: loss that an order must save to be taken into a resonance: four parameters do so once in 20,000 by chance
    order_gain: float = 25.0
    #: frequencies at which a resonance is started, and how far apart (relative) two of the same orders must lie
    resonance_starts: int = 3
    same_resonance: float = 0.1
    #: temperatures at which a structure may change its state are looked for between so many parts of the runs at most,
    #: each state with so many rows at least; its frequency by such steps, and so far from that of the other state
    most_states: int = 8
    least_rows_of_state: int = 12
    state_step: float = 0.02
    state_reach: float = 0.16
    #: loss that a resonance must save at two frequencies at least, each: one loud point can be anything
    point_gain: float = 12.0
    #: damping ratio above which there is no peak that could be told from any other dependence on speed
    broadest: float = 0.15
    #: share of the range of a parameter within which it lies at its bound
    edge: float = 1e-3
    #: share of what a candidate saves that it may cost on any one order: what bends other parameters is not the cause
    expense: float = 0.02
    #: bytes of responses, and number of pieces, that are kept from search to search
    most_kept_bytes: int = 400_000_000
    most_cached: int = 300

    # --- evidence ---
    #: chance of a false addition that each test of one candidate is allowed: about a hundred candidates are tried on a
    #: data set, and the tests must all pass, so that well under 1 % of data sets without a missing effect see a name
    p_chance: float = 1e-6
    p_clusters: float = 1e-4
    #: an effect must stand as high as the noise of one coefficient: noise that lasts over runs can look like less
    least_size: float = 1.0
    #: share of what all runs know of a combination of parameters that the others must keep when a fold is left out:
    #: below it their error grows more than fivefold, and what they say of the fold is no prediction
    kept_knowledge: float = 0.04
    #: from so many operating points on one in so many is kept from the search: the reported held-out gap comes from
    #: there; fewer points are needed for the search itself, and levels are left out of the fit in turn
    least_points_apart: int = 60
    one_apart_in: int = 8
    #: a held-out gap that rises by more than its own scatter from run to run: the rig stays as it is
    worse: float = 1.02
    #: the gap of levels that were left out counts in place of that of unseen runs from so many times on, and so many
    #: times the floor are more than noise: these gaps scatter
    clearly_larger: float = 1.25
    #: power above the orders that are looked at is told where it is so many times that of noise as below: noise that
    #: rises with the order, as of encoders whose errors repeat, may have twice as much there
    beyond_band: float = 4.0
    #: a power that is normal in eight runs of two curves has fewer carriers than one in five of these once in 80 times
    carried_by_one_in: float = 5.0
    #: from one operating point that meets what was added nobody learns how much others differ from it
    least_testers: float = 2.0
    #: resampled data sets, and the share of them in which an effect must keep its size
    resamplings: int = 60
    stable: float = 0.9

    # --- what the order of the runs tells ---
    #: share of a step that must lie between the means of a sixteenth of the runs on both sides: of a trend it is an
    #: eighth, of a step all
    at_once: float = 0.5
    #: runs at which a trend may begin or end
    bends: int = 24
    #: steps that are compared beside a condition: of more runs as many, evenly
    most_cuts: int = 512

    # --- what lies around ---
    #: power of one of many random waves over their mean: exponential, so that one in 8,000 is so large
    stands_out: float = 9.0
    #: orders to each side that are alike where structure is broad: a bump of 6 deg fades within ten
    around_order: int = 20
    #: orders to each side of a line of samples over time, from and to: those beside it hold what leaks of it where the
    #: turns are not whole, those far away another part of a spectrum that falls
    around_line: tuple[int, int] = (2, 6)
    #: orders that hold less of a change than this share of the most do not speak for it
    part_of_change: float = 0.05
    #: widths to each side that a bump is seen in; the share of its power by which another bump (a trapezoid)
    #: differs in form
    reach_of_place: float = 3.0
    left_of_place: float = 0.15
    #: mean power beyond the noise, in noises over the root of the runs, that an order of curves may hold unseen
    quiet_order: float = 6.0
    #: a burst of a mesh order must leave less of its form than one of any other order, by this share where nothing else
    #: stands beside its name; both at widths of so many times the one that was fitted
    told_order: float = 0.2
    widths_of_burst: tuple[float, ...] = (0.6, 0.8, 1.0, 1.25, 1.6)
    #: how near to where curves begin and end (deg) a place may be what happens there
    reach_of_start_deg: float = 10.0
    #: how far on both sides of an angle what many orders hold together may reach, deg
    reaches_of_place_deg: tuple[float, ...] = (2.0, 4.0, 8.0, 16.0)
    #: unexplained orders beside those of the rig of which is said that they lie so
    least_beside: int = 3

    # --- conclusions ---
    #: an effect is not named when its orders keep more loss, beyond noise, than this share of what it saves
    misfit: float = 0.3
    #: the same for a change of the rig in curves, which tell their noise: what bends a parameter leaves more
    misfit_in_curves: float = 0.1
    #: the same for a resonance, never quite that of one oscillator: it must explain more than it leaves
    misfit_of_peaks: float = 1.0
    #: unless the peaks of its orders agree on a frequency, each at its own speed, as by chance no more than so often
    p_agree: float = 0.02
    #: the form of an effect is believed to this share of its size in each run: what else takes off no more than that on
    #: the same orders may be what the form lacks
    form: float = 0.1
    #: an effect acts where its contribution is more than this part of its largest
    acts: float = 0.3
    #: changes of the rig that may stay beside a reading (with more it explains little), and those that are tried for
    #: it; how often data are read anew
    beside_reading: int = 2
    changes_tried: int = 4
    rereadings: int = 3
    #: a reading does what is unexplained where this share of its power is left, and is tried on where it takes off a
    #: tenth at its first step
    left_of_rest: float = 0.1
    begins_to_do: float = 0.9
    #: a size of a reading is found where it would move by less than this part of its error
    of_an_error: float = 0.25
    #: loss of a run by noise with heavy tails, which a robust estimate of the noise takes for one
    tails: float = 1.4
    #: what a height of a resonance that follows the load may leave of what one height of all loads does
    left_of_height: float = 0.5
    #: loss by which another name may be worse and still be as good a name: 1 in 1000 by chance for one parameter
    as_good: float = 11.0
    #: other names that are fitted in full
    other_names: int = 3
    #: names that were true, of how many, where an order alone or few runs give them and where more does: so often is
    #: such a name true. Counted on 501 cases of the suite of other physics (make blind-form)
    names_by_order: tuple[int, int] = (50, 60)
    names_by_more: tuple[int, int] = (153, 155)
    #: damping ratio whose peak fits between two speeds of a campaign
    narrow: float = 0.006
    #: part of its size in the rig below which an effect may be one that the machine does not have
    nothing_left: float = 0.3
    #: chance that a parameter of the rig is called changed although it is not
    p_changed: float = 1e-7
    #: a change that is the same in all runs counts from this size on (noises): noise that lasts looks like less.
    #: Chosen on development seeds of the blind suite
    least_constant: float = 0.63
    #: share of its power by which a change may vary and still be the same in all runs
    varies: float = 0.1

    # --- what is unexplained ---
    #: false discovery rate of the orders that are called significant
    discovery_rate: float = 1e-4
    #: for the decision (not for the size) residuals are cut here (noises), so that single wild runs make no structure
    cut: float = 5.0
    #: structure is an error of the estimate of the noise below this part of it (power)
    least_excess: float = 0.4
    #: orders of which the middle one tells the noise of each of them, where few runs do not
    orders_beside: int = 9
    #: a residual so many times the noise between the orders of its curves is more than that noise; the orders that tell
    #: how strong a slow wander within one turn is, which makes the low ones louder
    beyond_spectral: float = 2.0
    wander_orders: int = 5
    #: a twist of two slopes with a knee has four numbers: so many torques refuse it where the play is taken up
    torques_of_a_knee: int = 5
    #: knees that are tried, by quantiles of the torques, and powers of the load: contact is between a half and one
    knees_tried: int = 12
    powers_of_a_load: tuple[float, ...] = (0.5, 2 / 3, 0.75, 0.9)
    #: what else a mesh order may follow: contact of lines and points, and what grows faster than the load
    powers_of_a_mesh: tuple[float, ...] = (0.5, 2 / 3, 1.5, 2.0)
    #: a law that is nothing at one end of a condition and grows in proportion to it is a constant, and what differs
    #: from it by a third of its power
    constant_of_a_law: float = 3.0
    #: so many quiet orders tell the noise of an order of a curve, half of those whose median it is
    quiet_beside: int = 12
    #: of tables, whose orders may differ: so many of their usual distances (standard deviations) above those beside it,
    #: one of 15,000 of normal ones; and at most so many times as loud, or where there are too few orders to tell
    beyond_usual: float = 4.0
    beyond_beside: float = 10.0
    least_orders_beside: int = 8
    #: orders that tell what the noise of one between them is
    near_floors: int = 4
    #: multiples of the lines of an encoder that its steps show, the first ones, and how many must be there: by chance
    #: two of some 30 orders are among them
    multiples_of_lines: int = 12
    least_multiples: int = 4
    #: lines a turn that encoders have, and how far sidebands of them reach
    encoder_lines: tuple[int, ...] = (512, 1024, 2048, 2500, 3600, 4096, 5000, 8192, 9000, 16384, 18000, 32768, 65536)
    sidebands_of_lines: int = 2
    #: the middle run has so much of the power of the mean at least where all runs have a wave: of noise 0.69
    in_most_runs: float = 0.25
    #: runs in a known order that are needed to look for steps and trends, and how much of what it
    #: leaves it must explain: a wander as large as the noise passes for noise that lasts
    least_in_time: int = 24
    least_excess_in_time: float = 1.5
    #: a condition that changes in every third run at most has levels that look like a wander over the runs: three
    #: levels in any order change in two of three
    runs_of_a_level: float = 3.0
    #: the lowest waves over the runs of noise that wanders tell how its power falls, by the median: of five two may be
    #: loud or faint by chance; none counts as fainter than this share of the noise of runs, whose logarithm would say
    #: how small what is left of it is by chance
    waves_of_a_wander: int = 5
    faintest_wave: float = 1e-3
    #: chance of a step below which an order wanders over the runs, and share of the other orders that may: of 40
    #: campaigns of ten orders and no step three at most had one, in walks of 0.25 to 5 noises, 1/f and other noise
    p_wander: float = 0.01
    most_wandering: float = 0.25
    #: other orders of the runs in none of which a step or a trend may gain as much: 1 in 100 by chance; so few are
    #: enough where none of them gains half as much
    other_orders_of_runs: int = 99
    few_orders_of_runs: int = 9
    #: share by which the size of a formula may change over the runs of which is said that it keeps its size, and by
    #: what its phase turns at least then
    keeps_its_size: float = 0.2
    least_turn_rad: float = 0.3
    #: share of the power of runs that they have in common from which on they are not called different
    same_in_runs: float = 0.5
    #: share of an unexplained part from which on a condition is called what it depends on
    cause: float = 0.1
    #: and how many times the share of the next condition it must have
    clear_cause: float = 2.0
    #: a term of a formula must save this many times the logarithm of the runs, and this share of what is left to save
    term_price: float = 2.0
    term_share: float = 0.02
    most_terms: int = 3
    #: parts of the levels of a condition that are left out of a formula in turn at most; what it must explain of them,
    #: and from where on that is all of it
    formula_blocks: int = 10
    formula_explains: float = 0.8
    formula_whole: float = 0.97
    #: share of the variance of a condition that another one tells, from which on the two go together: the error of what
    #: each does alone is three times as large
    together: float = 0.9
    #: waves that are told of samples over time, and those of which a mean that wanders is made: noise makes the root of
    #: so many standard errors (8) of them, less than the 10 that are asked of what is told
    most_lines: int = 8
    most_waves_of_mean: int = 64
    #: part of a wave that a recording must hold to tell that it is one: the steps of samples may take a little off it
    least_of_wave: float = 0.9
    #: a wave that changes over samples is told anew in pieces of at least so much of a turn, so many of its periods and
    #: so many samples: two numbers are told of it, and a piece of a resonance that is passed is hardly shorter
    piece_of_turn: float = 0.125
    waves_of_piece: float = 4.0
    least_of_piece: int = 8
    #: orders to each side that such a wave may hold as well, since its phase turns; the part of what it leaves that one
    #: of its own tells there (parts of a resonance tell up to 7 %); up to so many times what the best order leaves
    #: above the noise, and more by this part of its wave, others leave about as little
    beside_changing: int = 3
    own_beside_changing: float = 0.1
    as_little: float = 2.0
    as_little_of_wave: float = 0.15
    #: turns of a recording from which on a wave between two orders is told from these (one over the turns tells orders
    #: apart), how far from a whole order it lies at least, and the part of the RMS of all that is left that it has:
    #: a quarter of the power in one of some thousand lines is no chance, and no noise that is some lines wide
    least_turns_between: float = 3.0
    off_order: float = 0.05
    part_of_rest: float = 0.5

    #: part of the range of a condition from which on a gap parts two levels of it, whose values scatter
    clear_gap: float = 0.15
    #: torque (N m) below which a run tells backlash from dry friction: the least that seats the flanks
    near_no_load_Nm: float = 30.0

    # --- suspects ---
    #: an order of a run is off from here on (noises). On development seeds of the blind suite one of 2200 good runs is
    #: above it in both directions at once; bad runs that show at all begin at 4.8
    off: float = 5.0
    #: orders that must be off in a run of one direction only
    orders_alone: int = 3
    #: a residual is shared where `alike` of the `near` nearest runs along an axis differ by less than `similar` of it
    alike: int = 2
    near: int = 4
    similar: float = 0.5
    #: a deviation that a run at another temperature has as well, so coherent and so large, is no bad run
    coherent: float = 0.7
    comparable: float = 0.5
    #: a step across an axis counts as so many along it
    across: float = 4.0
    #: more suspects than this share are no bad runs, but something else
    most_suspects: float = 0.1

    # --- order spectra ---
    #: share of the orders that is taken for noise; an order is there when it stands so many times above the median of
    #: these, and noise that scatters as they do reaches as much, in any order, in so many of all spectra
    spectrum_quiet: float = 0.25
    spectrum_clear: float = 3.0
    spectrum_chance: float = 0.01
    #: share of the names of one effect that may be expected to be coincidences of orders
    coincidence: float = 0.1
    #: a sideband is at most this large against its mesh order (the bound of the effect)
    largest_ratio: float = 5.0
    #: an unnamed order is described by mesh orders that are no farther away
    near_orders: int = 8

    # --- the next measurement ---
    #: runs that are proposed at once, and what one must add beside those before it (nats: 0.05 is a volume of errors
    #: that is a twentieth smaller)
    most_next_runs: int = 12
    least_gain: float = 0.05
    #: runs that are proposed again where runs differ without a pattern: a spread of four is told to a third
    repeats: int = 4
    #: share of a size below which its error says that it is known: until then runs are proposed whatever they add
    well_known: float = 0.05
    #: share of the most that a run can add from which on another one adds about as much: the expectation is linear, and
    #: no better known than that
    about_as_much: float = 0.8
    #: parts of the range of speeds: runs inside one have about the same speed (as where measured speeds do not repeat)
    speeds_apart: int = 12
    #: expected logarithm of the odds at which two explanations count as told apart: a chance of one in a million
    told_apart: float = 14.0
    #: points between two measured speeds that are considered, levels of torque and of temperature at most
    between: int = 3
    most_torques: int = 7
    most_temperatures: int = 3
    #: speeds around a peak, in half widths of it: the flanks tell the frequency, top and feet height and damping
    around_peak: tuple[float, ...] = (-4.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 4.0)
    #: torques about the one at which flanks seat, in multiples of it
    around_seating: tuple[float, ...] = (0.25, 0.5, 1.0, 2.0, 4.0)
    #: refused candidates that are considered as rival explanations of what is unexplained
    most_rivals: int = 3
    #: unexplained orders that runs are proposed for, the largest first
    most_open_orders: int = 8

    # --- models and words ---
    #: measured rows inside the ranges of a bundle that are needed to judge it
    least_rows: int = 8
    #: share of the whole gap from which on it says more than the gap of an effect's own orders
    much: float = 0.05
    #: a held-out gap of so many floors is one to give the reason of: the orders that make so much of its power
    above_floor: float = 1.3
    most_of_gap: float = 0.75

    # --- recordings of joints ---
    #: samples of a file at least; how far one may be off even steps (steps); turns of a joint from which on an angle
    #: without a unit in its name is asked about; how well a given speed must agree with that of the angle; steps of the
    #: angle over the largest of all others from which on it jumps; no time, angle, speed or torque is larger
    joint_samples: int = 500
    joint_jitter: float = 0.5
    joint_turns: float = 5.0
    joint_alike: float = 0.9
    joint_factor: float = 0.1
    joint_jump: float = 3.0
    #: a step (s) from which on a time without a unit in its name is asked about: no joint is recorded so slowly, and in
    #: ms every step below 2 kHz is longer; travel (rad) below which a joint stands: ten arcminutes, which simple gears
    #: give without sliding (those of robots: one to three)
    joint_step: float = 0.5
    joint_travel: float = 0.003
    #: share of the torque's changes that motion and friction predict below which it may be another joint's
    joint_unrelated: float = 0.5
    joint_largest: float = 1e9
    #: noise of the angle may make this share of the power of the acceleration at most: it would make the inertia
    #: smaller by as much; the kernel that smooths it has so many samples at least and at most (standard deviations)
    joint_dilution: float = 1e-3
    joint_kernel: tuple[int, int] = (2, 64)
    #: share of the largest speed below which a joint counts as standing
    joint_standing: float = 0.005
    #: ratio of fast to slow speeds (a tenth lies beyond each) below which dry and viscous friction are one number
    joint_speeds: float = 1.5
    #: stretches of time that are left out in turn; fewer have no scatter to judge by
    joint_blocks: int = 12
    #: a part must predict left-out stretches better by so many standard errors (another one in its place that is worse
    #: by less could be the cause as well), in this share of them; its size must be so many errors (Student's t with 11
    #: degrees: beyond 6 once in 10,000), and it must explain this share of what the others leave, so that no form error
    #: of a large part counts
    joint_better: float = 3.0
    joint_most: float = 0.7
    joint_errors: float = 6.0
    joint_share: float = 0.01
    #: the square of the speed must be so many times what else is left could make of it: it is the bend that every other
    #: curve over speed has in common with it
    joint_bend: float = 2.0
    #: of a part that another one would do in place of, so much may be the other's: that one of them is there stays said
    joint_of_another: float = 0.95
    #: a motion repeats where all angles come back to this share of their power: left-out stretches then are parts of a
    #: round, in every round
    joint_repeats: float = 1e-3
    #: columns of the other joints' motion that are taken at most: a robot of six joints has some 20 inertias
    joint_acting: int = 40
    #: a part whose column is told by the others to all but this share cannot be told from them
    joint_told: float = 0.01
    #: what is left is noise up to so many times the noise of the torque at its highest frequencies
    joint_noise: float = 1.25
    #: waves over the angle that are looked for; how far their order may differ between two halves (resolutions); waves
    #: that the angle must hold at least to be told from a slow bend; how many times the power of their surroundings
    #: they have; how far these reach to each side, over the angle and over time (resolutions). Each half is every other
    #: stretch: a wave in such pieces spreads to both sides, and is hidden where the surroundings are no wider than
    #: that. Over time they are narrower, since the harmonics of the motion stand side by side
    joint_waves: int = 6
    joint_agree: float = 1.0
    joint_least_waves: float = 3.0
    joint_stands_out: float = 9.0
    joint_around: tuple[float, float] = (20.0, 10.0)
    #: torque of the inertia at a frequency, over that of a wave there, from which on the wave is the motion's own; a
    #: weaker wave so near (share of the order) to a louder one is a part of it: its size or phase changes
    joint_own: float = 3.0
    joint_beside: float = 0.15
    #: share of the torque's power that the motion must explain at a frequency (coherence), and frequencies that do
    joint_coherence: float = 0.8
    joint_frequencies: int = 12
    #: a mode broader than this is a filter, or none; the share of the misfit that it must take off held-out stretches
    joint_broadest: float = 0.3
    #: lead of the torque before the acceleration below a mode (mean sine of its phase, without what the mode's own
    #: damping adds) from which on what friction shakes is braked by the drive: a joint has none, but for what is left
    #: of delays
    joint_lead: float = 0.3
    #: width of the kernel under which a mode is no part of what friction is read from (radians at its frequency)
    joint_below_mode: float = 3.0
    #: share by which the inertia may change when the kernel is twice as wide: a rigid joint's is the same
    joint_one_inertia: float = 0.03
    joint_mode: float = 0.5


SETTINGS = Settings()

#: Numbers that neither a chance nor physics gives, and the simulated cases that were looked at when they were settled:
#: machines unlike those may want others. The comments above say what each decides.
CHOSEN_ON: dict[str, tuple[str, ...]] = {
    "development cases of the suites of the catalogue's effects and of other physics (make blind, make blind-form)": (
        "least_constant", "off", "suspect_distance", "similar", "coherent", "comparable", "across", "misfit", "stable",
        "worse", "expense", "block_factor", "label_loss", "label_gain", "form", "acts", "tails", "varies", "vote",
        "clearly_larger", "misfit_of_peaks", "least_excess", "least_excess_in_time", "beyond_spectral", "told",
        "left_of_unit", "part_of_measured", "acts_of_unit", "taken_off",
        "beyond_beside", "left_of_place", "part_of_change", "most_orders", "column_factor", "changed_gain", "clear",
        "state_reach", "formula_explains", "formula_whole", "term_price", "term_share", "hidden_turn",
    ),
    "campaigns of other generators (filters, gaps, sensors that drift, zeros of the angle, laws of no catalogue)": (
        "one_zero", "one_zero_deg", "bends", "at_once", "beside_reading", "changes_tried", "of_a_filter",
        "least_between", "left_beside_wave", "powers_of_a_load", "one_slope", "beyond_labels", "nothing_left",
        "keeps_its_size", "least_turn_rad", "same_in_runs", "same_ramp", "told_order", "told_decay", "rings",
        "reach_of_start_deg", "left_of_rest", "off_order", "part_of_rest", "begins_to_do", "clear_cause",
        "left_of_height", "clear_gap",
    ),
    "all counted cases of other physics, development and held out": (
        "names_by_order", "names_by_more",
    ),
    "75 simulated recordings over time (ramps, reversals, steps, rounding, other units)": (
        "exact_factor", "piece_of_turn", "waves_of_piece", "least_of_piece", "few_samples", "least_of_rounding",
        "least_wobbles", "least_of_wave", "beside_changing", "own_beside_changing", "as_little",
        "as_little_of_wave",
    ),
    "simulated joints of seeds below 500 (tests/reconcile/joint)": (
        "joint_speeds", "joint_better", "joint_most", "joint_share", "joint_told", "joint_noise", "joint_least_waves",
        "joint_own", "joint_beside", "joint_coherence", "joint_frequencies", "joint_broadest", "joint_below_mode",
        "joint_one_inertia", "joint_mode",
    ),
    "a joint with Stribeck's friction (seed 2018 of tests/reconcile/joint)": ("joint_bend",),
    "simulated joints under control, of some 20 motions, with ripples, Stribeck's friction, play and springs": (
        "joint_around", "joint_lead",
    ),
}  # fmt: skip
