"""All constants of the sampler, with their meaning and the reason for their values.

None of them is a setting of a study. The estimate of every batch is unbiased for any values of the constants,
but they determine the number of simulations. A change of one constant changes every result of the sampler.

Rarity means -log P(|Z| > |z|) for a point z and a standard normal Z. The wide distribution has uniform
directions and a uniform rarity (`wide_laws.draw_wide`).
"""

import numpy as np

# ---- how a run of the sampler proceeds

# Number of simulations drawn from the wide distribution before a surrogate is fitted. A few flags would not
# determine a surrogate.
START = 20

# Number of first simulations, and their largest rarity, if the event may be frequent and may have several
# separate parts, as in scenarios with joint laws. The probability beyond this rarity is 5e-5. The runs
# exclude half-spaces of probability 5e-3.
FREQUENT_START, FREQUENT_REACH = 2 * START, 10.0

# Number of points of the wide distribution from which the runs of a batch of the search are chosen.
CANDIDATES = 1000

# The search ends when there is on average one run in every step of this size on the scale of rarity, up to
# `BEYOND` above the rarity of the most probable known event. In a step the probability changes by the factor
# exp(STEP).
STEP = 1 / 2.75

# Largest number of runs in a batch of the search. Larger batches would take more runs, because every batch of
# the search follows what the one before it has shown.
SEARCHED = 10

# If the search has no event after this number of runs per unit of rarity, half of its further runs follow the
# surrogate of the flags.
PATIENCE = 1.0

# If the search has no event after this number of runs per unit of rarity, a third of its further runs are
# draws of the law, and if there are scores another third are chosen among draws of the law.
IN_VAIN = 4.0

# The search and the defensive runs extend to the rarity of the event plus this value. Points farther out have
# less than 5 % of the probability, exp(-BEYOND).
BEYOND = 3.0

# Axes, lengths and amplitude are learnt again when the number of runs has grown by this factor. Learning
# takes as long as several batches without it, and a few more runs hardly change its result.
RELEARN = 1.15

# A surrogate is usable if it predicts a coefficient of variation of a single run below this value.
USABLE = 2.5

# Lower bound of the predicted coefficient of variation in the weights of the batches, so that a batch does
# not get a large weight because the surrogate is overconfident.
BEST = 1.5

# Two consecutive predictions of the probability of the event agree if their ratio is within this factor. If
# they do not agree, the surrogate still changes too much for an estimate.
AGREEMENT = 2.0

# ---- at most two inputs

# With at most this number of inputs, few runs of a cover exclude all parts of the event of a moderate size.
# If the system is deterministic, the cover begins as soon as there is an estimate. The search, which would
# find the same parts, begins with `SHORT_START` runs and ends with one run in every `SHORT_STEP` of rarity.
# With more inputs, many parts are too small for the cover, and the search has to find them.
COVERED = 2
SHORT_START, SHORT_STEP = 10, 1.0

# `BEST` with at most `COVERED` inputs, where surrogates are seldom overconfident.
SURE = 0.5

# The cover may find a part of the event after most batches, which have missed it. So an estimate with at most
# `COVERED` inputs must not be lower than the last prediction divided by this factor. In 108 other
# estimates of nine problems the ratio of the two has a standard deviation of 0.11; three are allowed.
REACHED = 4 / 3

# ---- the pool of the first phase

# Smallest number of points of a pool, and smallest number for each run of its batch. The points need no
# simulation, and there are so many that the pool contributes little to the variance of a batch.
POOL, POOL_PER_RUN = 2000, 20

# With more than three coordinates a pool has `POOL` points for each one beyond two, up to this number. With
# 2,000 points in eight inputs, the predicted probability of three half-spaces changed by a factor of two from
# pool to pool, and the estimate began again each time: it took 670 runs instead of 240.
MOST_POOL = 8000

# Number of Student-t kernels from which a pool is drawn. Their centres are important points of the previous
# pool.
KERNELS = 200

# Largest rarity of the wide distribution. A standard normal vector exceeds the corresponding radius with
# probability exp(-REACH) = 9e-27.
REACH = 60.0

# Lower bound, in normal scores, of the standard deviation of the centres, which determines the width of the
# kernels. Without it, kernels with equal centres would have the width 0.
SMALLEST_SPREAD = 0.1

# ---- the sample of the second phase

# Defensive share of the runs, as protection against errors of the surrogate; and this share if the interval
# is narrow enough and only the certificate is not yet met. The first one is also the share of a pool that is
# drawn from the wide distribution, so that no part of the space is left out.
DEFENCE, DEFENCE_ALONE = 0.2, 0.9

# Share of the defensive runs that is spread evenly over the pool, most of which surrounds the event. The
# other defensive runs follow the wide distribution.
EVEN = 0.25

# The core: points with at least this predicted probability are sampled preferentially, whatever their weight.
CORE = 0.1

# The fringe: points with at least this predicted probability are also sampled preferentially, if their weight
# is within a limit. The limit is this multiple of the mean weight of the points of the core. It is needed
# because the predicted probability is never far below one over the number of runs, even at safe points.
# Without the limit, the bulk of the normal distribution, which has the largest weights, would attract all
# runs.
FRINGE = 0.001
FRINGE_WEIGHT = 10.0

# The control variate is the predicted probability if this is at least CONTROLLED, and 0 otherwise. Smaller
# probabilities would reduce the variance only a little, but multiplied by the large weights of the bulk of
# the normal distribution they would increase it.
CONTROLLED = 0.3

# This share of the predicted probability is added to the expected squared error when the runs are allocated.
# Where the surrogate predicts a probability near 1, it expects almost no error, but may be wrong.
FLOOR = 0.1

# Number of points of the pool of a batch that are kept, so that the estimate can be reweighted for another
# law. They represent equal parts of the integral of the control variate.
KEPT = 100

# ---- the calibration of the surrogates

# Prior standard deviation of the logarithm of a slope. The logarithm is at least -4 and at most 5 of them.
SLOPE_SPREAD = 0.3

# Largest weight of the second surrogate in the mixture of the two predictions. If there is a predecessor,
# this is also the largest weight of the first surrogate.
MOST_TRUST = 0.95

# Predicted probabilities are kept at least this far from 0 and 1, so that a single unexpected outcome does
# not reduce the likelihood to zero.
SUREST = 1e-6

# ---- the certificate

# The bounds on the probability of unobserved parts of the event have the confidence 1 - UNSEEN_ALPHA.
UNSEEN_ALPHA = 0.05

# The default certificate excludes unobserved modes with more than COVER_SHARE of the estimated probability.
# An estimate that is 20 % too high then still finds a part as large as the known one. Their curvature is at
# most ROUNDNESS / d^2.5 in d dimensions, because 20 to 60 further runs then exclude them if d is at most 10.
# With flags alone, only the cover can find a part, and the factor is ROUNDNESS_OF_FLAGS. With scores, the
# curvature is at most ROUNDEST, because the scores exclude smaller parts.
COVER_SHARE, ROUNDNESS, ROUNDNESS_OF_FLAGS, ROUNDEST = 0.5, 6.4, 9.6, 0.8

# Number of random modes that are checked, their largest distance from the origin in normal scores, and the
# share of them that need not be excluded.
MODES, FARTHEST, COVER_MISSED = 10_000, 11.0, 0.005

# Number of runs that are sampled in a batch after the interval has become narrow, if none are needed to
# exclude other parts of the event.
CERTIFIED = 5

# After its interval has become narrow, an estimate takes at most this share of its runs in addition, or
# LONGEST runs if these are more, to follow the scores. With more than three inputs, it may take LONGEST runs
# for each input in total: all runs count for the certificate, so that an interval that is narrow early leaves
# more to do. With scores that jump, it would take thousands. Then the cover of flags alone is completed.
LONGEST_SHARE, LONGEST = 0.5, 80

# With more inputs than this, scores do not show that there are no other parts, because the number of runs
# that exclude parts of the size of one normal score grows exponentially with the inputs. Flags alone do not
# show it with more than `COVERED` inputs.
MOST_INPUTS = 6

# Scores are assumed to decrease towards an unknown part of the event at most this many times as steeply as
# towards a known one.
STEEPER = 1.5

# Number of balls that are tried in one round, number of rounds, and number of radii.
TRIED_BALLS, ROUNDS, RADII = 2000, 3, 50

# Ratio of the smallest to the largest of these radii.
SMALLEST_BALL = 1e-3

# ---- the Gaussian process

# Log-normal priors of the lengths, in normal scores, and of the amplitude, in units of the probit: median,
# and standard deviation of the logarithm. The median of the lengths is for one dimension; in d dimensions it
# is multiplied by sqrt(d), because distances grow like this. The amplitude is large, because the probit link
# represents noise, and the flags of a deterministic system have none.
LENGTH, LENGTH_SPREAD = 1.5, 0.7
AMPLITUDE, AMPLITUDE_SPREAD = 20.0, 0.8

# Length along the distance from the origin, a further coordinate of the surrogates, if it does not matter.
# Otherwise it has the prior of OUTWARD, and must increase the log posterior density by COST.
UNUSED = 2e4

# ---- many normal scores

# With at most this number of normal scores, all of them are coordinates of the surrogates. With more, a few
# directions are learnt, and the search begins after as many draws of the wide distribution as there are
# normal scores.
FEW = 10

# Largest number of directions. A surrogate of these coordinates and the distance across them still needs few
# runs.
MOST_DIRECTIONS = 4

# A direction is left out if its singular value is below this share of the largest one, because its length is
# then so long that it hardly matters.
LEAST_SINGULAR = 0.02

# Amount by which an additional parameter of the directions must increase the log posterior density. An input
# that is chosen among d inputs costs log(d) in addition.
COST = 1.5

# Prior of the inverse length along the distance from the origin, in normal scores: median, and standard
# deviation of the logarithm. Then the bounds of the logarithms of this inverse length, of the amplitude and
# of the noise.
OUTWARD, OUTWARD_SPREAD = 1 / 3, 1.0
LOG_DIRECTION_BOUNDS = ((-4.0, 1.0), (-1.0, 1.5), (-4.0, 0.5))

# Starting points of the optimisation of the directions: the noise, and sizes of a new column, of which the
# best is used.
FIRST_NOISE, STARTS = 0.3, (0.05, 0.2, 0.5)

# Share of a pool that is drawn from the wide distribution of all normal scores.
WHOLE_SHARE = 0.15

# Share of the default defensive runs that follow the wide distribution of the few coordinates.
ALONG = 0.5

# Prior median of the length along the coordinate of the systems, which is 0 for the system under test and 1
# for its predecessor. With the median amplitude, the boundaries of the events of the two systems then differ
# by about half a normal score.
SYSTEM_LENGTH = 10.0

# Bounds of the logarithms of the lengths and of the amplitude, and largest number of iterations of their
# optimisation. Few iterations are enough, because the optimisation is repeated when there are more runs.
LOG_LENGTH_BOUNDS, LOG_AMPLITUDE_BOUNDS = (-2.0, 3.0), (-1.0, 4.0)
LEARNING_STEPS = 5

# Largest number of runs to which a surrogate is fitted. Memory grows with its square, time with its cube.
MOST_RUNS = 600

# The regression of the scores: log-normal prior of the standard deviation of its noise, which represents
# everything that is too fine to be learnt, as median and standard deviation of the logarithm; bounds of the
# logarithm of the noise; and largest number of iterations of the optimisation of lengths, amplitude and
# noise. The prior median of the amplitude is 1, which is the standard deviation of the graded outcomes.
NOISE = 0.1, 1.0
LOG_NOISE_BOUNDS = (-4.0, 0.0)
GRADED_STEPS = 15

# Share of the variance that is added to the diagonal of the covariance, so that repeated points do not make
# it singular.
JITTER = 1e-6

# Weight of the new value in each step of expectation propagation. All sites are updated at once, and full
# steps could overshoot.
DAMPING = 0.6

# Largest number of steps of expectation propagation, and of the optimisation of the directions.
MOST_STEPS = 40

# Expectation propagation ends when a step changes the log evidence by less than this value. The second value
# is used while lengths and amplitude are optimised, where a larger error has no consequence.
SETTLED, ROUGHLY_SETTLED = 1e-3, 0.03

# Initial precision of a site; and lower bounds that protect the updates of the sites against rounding.
FIRST_PRECISION = 1e-3
LEAST_PRECISION, LEAST_VARIANCE = 1e-10, 1e-13

# ---- systems whose outcomes are random

# Two scores are equal if their difference is at most this value, absolute or relative. They may differ by
# rounding, which can depend on the batch.
SAME_SCORE = 1e-5

# A score that is infinite, and the predicted variation of a run if no event is predicted at all, are replaced
# by this value, because JSON cannot represent infinity.
LARGEST = float(np.finfo(float).max)

# Number of runs that are repeated at the beginning of the second phase, unless the system is stated to be
# deterministic. They show whether the outcomes of most runs are random, as with noise.
FIRST_REPEATS = 5

# If this number of repetitions has shown no difference, the system is treated as deterministic. They exclude,
# with 95 % confidence, that more than 1 - 0.05^(1/350) = 0.9 % of the repeated runs end differently
# when they are repeated. With 200, a third of the cars whose brakes fail in 0.5 to 2 % of the runs passed.
ENOUGH_REPEATS = 350

# Share of the repetitions that are of runs without the event, so frequent that lapses there could matter.
# Repetitions next to the event do not show lapses in other conditions, such as at high speeds only.
FREQUENT_SHARE = 0.3

# If this number of draws of the law itself agrees with the estimate, the system is treated as one without
# events in thin stripes. Without an event they exclude stripes of more than 1 %, with 95 % confidence.
ENOUGH_DRAWS = 300

# Number of pairs of repetitions of the same run, an early and a late one, that show whether a noisy system
# drifts. If it does not, each pair rises or falls with probability 1/2. It drifts if the numbers of the two
# are as unequal as 9 and 1 of 10, whose probability is at most DRIFT.
DRIFT_PAIRS, DRIFT = 10, 0.022

# Late repetitions are due before convergence, and as soon as there are this many times as many runs as at the
# early ones.
DRIFT_LAG = 4

# Events among these draws contradict the estimate if so many of them would have a probability below this.
CONTRADICTION = 0.01

# After this number of unexpected events, a system that may lapse is only drawn from the law itself, because
# a surrogate does not learn where lapses happen.
ENOUGH_UNEXPECTED = 5

# Surrogates do not learn the event if there is no estimate after this number of runs of the second phase, and
# after this number of batches.
ENOUGH_UNLEARNT, ENOUGH_BATCHES = 300, 20

# If at least this share of the repetitions differ from their runs, the outcomes of most runs are random.
OFTEN = 0.5

# Prior median of the amplitude of the surrogate of the flags if outcomes are random.
NOISY_AMPLITUDE = 3.0

# `FRINGE_WEIGHT` if the outcomes of most runs are random. Many events then happen where the probability of
# the event is small, but the normal density is large.
NOISY_FRINGE_WEIGHT = 100.0

# `USABLE` if the outcomes of most runs are random. No surrogate can then predict them exactly.
NOISY_USABLE = 10.0

# If the outcomes of most runs are random: logarithm of the prior odds that the regression of the scores
# predicts better than the surrogate of the flags.
NOISY_LOG_ODDS = 4.0

# ---- what the runs say against statements about a problem

# Scores point the wrong way if this share of the events has larger scores than this share of the other runs.
WRONG_WAY = 0.75

# Largest slope of the boundary of an upper set that the runs are compared with, in normal scores: the input
# in which it is one against all others. Half-planes at 84 degrees to this input have this slope.
STEEPEST = 10.0
