"""All constants of the sampler, with their meaning and the reason for their values.

None of them is a setting of a study. Every batch is unbiased for any of their values, but they determine the
number of simulations. A change of one of them changes every number that the sampler gives.
"""

import numpy as np

# ---- how a run of the sampler proceeds

# Simulations of the wide law before a surrogate is fitted, because a handful of flags does not determine one.
START = 20

# The same where the event may be frequent and in several parts, as in scenarios with joint laws: more runs,
# up to a rarity beyond which lies 5e-5 of the probability. They exclude half-spaces of probability 5e-3.
FREQUENT_START, FREQUENT_REACH = 40, 10.0

# Points of the wide law among which the runs of the search are chosen.
CANDIDATES = 1000

# The search ends when it has had on average a run in every such step of rarity, for which the probability
# changes by the factor exp(STEP), up to `BEYOND` the most probable event that it knows.
STEP = 1 / 2.75

# Runs of the search for each unit of rarity, without an event, after which half of it follows the flags.
PATIENCE = 1.0

# The search and the defence reach as far out as this beyond the rarity of the event: all that lies farther
# out has less than 5 % of the probability.
BEYOND = 3.0

# Growth of the number of runs after which axes, lengths and amplitude are learnt again. Learning takes as
# long as several batches without it, and a few more runs hardly move its result.
RELEARN = 1.15

# A surrogate is usable once it predicts a coefficient of variation per run below this.
USABLE = 2.5

# Predicted coefficients of variation below this make no difference between batches.
BEST = 1.5

# A usable surrogate must also give a probability within this factor of what it gave a batch before. One that
# still changes its mind is sure of something that it does not know.
AGREEMENT = 2.0

# ---- the pool of the first phase

# A pool has at least so many points, and at least so many for each run of its batch. They cost no
# simulations, and are so many that the pool adds little to the variance of a batch.
POOL, POOL_PER_RUN = 2000, 20

# Number of Student kernels that a pool is drawn from. Their centres mattered in the pool before.
KERNELS = 200

# Share of a pool that is drawn from the wide law, so that every place can be reached.
WIDE_SHARE = 0.2

# The wide law reaches to the radius that a standard normal vector exceeds with probability exp(-REACH) =
# 9e-27.
REACH = 60.0

# Least standard deviation, in normal scores, of the centres from which the width of the kernels follows.
# Without it kernels about equal centres would have no width at all.
SMALLEST_SPREAD = 0.1

# ---- the sample of the second phase

# Defensive share of the runs, as protection against errors of the surrogate; and the share when only the
# certificate is not yet sufficient.
DEFENCE, DEFENCE_ALONE = 0.2, 0.9

# Share of the defence that is spread evenly over the pool, which surrounds the event; the rest follows the
# wide law.
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

# The surrogate's probability is the control variate where it is at least this, and 0 elsewhere. Below, it
# takes off little variance, and times the weights of the bulk it would add much.
CONTROLLED = 0.3

# Share of the probability that is added to the expected squared error when runs are allotted: the surrogate
# may be wrong where it is sure, and there it expects no error.
FLOOR = 0.1

# Squared coefficient of variation of a run where the surrogate expects no event; JSON has no infinity.
WORTHLESS = 1e100

# Points of a batch's pool that are kept after the batch, spread over the control variate, so that the
# estimate can be reweighted for another law. They integrate the ratio of two laws over the control variate.
KEPT = 100

# ---- the calibration of the surrogates

# Prior standard deviation of the logarithm of a slope, and where the logarithm is sought: at least four such
# deviations to each side.
SLOPE_SPREAD = 0.3
LOG_SLOPE_BOUNDS = (-1.2, 1.5)

# Largest share of the second opinion in what is believed; the rest is kept by the first. Where a predecessor
# is known, this is the largest share of either.
MOST_TRUST = 0.95

# Where the share of the scores would be below this, it is 0, which saves the time of their regression. Such a
# share cannot bring a point into the fringe, whatever the scores say there.
LEAST_TRUST = FRINGE

# Predicted probabilities are kept at least this far from 0 and 1, so that a single unexpected outcome does
# not reduce the likelihood to zero.
SUREST = 1e-6

# ---- the certificate

# The bound on what was not seen holds with confidence 1 - UNSEEN_ALPHA.
UNSEEN_ALPHA = 0.05

# ---- the Gaussian process

# Log-normal priors of the lengths, in normal scores, and of the amplitude, in units of the probit: median and
# standard deviation of the logarithm. The median of the lengths is for one dimension; in d dimensions it is
# sqrt(d) times as large, as distances are. The amplitude is large because the flags of a deterministic system
# have no noise, for which the probit stands.
LENGTH, LENGTH_SPREAD = 1.5, 0.7
AMPLITUDE, AMPLITUDE_SPREAD = 20.0, 0.8

# ---- many normal scores

# Up to so many normal scores all of them are coordinates of the surrogates. Where there are more, a few
# directions are learnt, and the search begins after as many draws of the wide law as there are scores.
FEW = 10

# Most directions. With the distance across them they are as many coordinates as the surrogates know well.
MOST_DIRECTIONS = 4

# Directions whose length is more than one over this times the shortest hardly matter, and are left out.
LEAST_SINGULAR = 0.02

# What a parameter of the directions must add to the log posterior density. A single input costs the logarithm
# of the number of inputs besides, because it is chosen among them.
COST = 1.5

# Prior of one over the length along the distance from the origin, in normal scores: median, and standard
# deviation of the logarithm. Bounds of the logarithms of this, of the amplitude and of the noise.
OUTWARD, OUTWARD_SPREAD = 1 / 3, 1.0
LOG_DIRECTION_BOUNDS = ((-4.0, 1.0), (-1.0, 1.5), (-4.0, 0.5))

# Noise from which the directions are sought, and lengths from which a new one is: the best of these.
FIRST_NOISE, STARTS = 0.3, (0.05, 0.2, 0.5)

# Numbers of inputs, those that matter most, to which directions are restricted on trial.
INPUTS = (2, 3, 5, 8)

# Most steps of the search for directions, and most runs that it is conditioned on.
DIRECTION_STEPS, DIRECTION_RUNS = 40, 400

# Share of a pool that is drawn by the wide law of all normal scores.
WHOLE_SHARE = 0.15

# Share of the usual defence that follows the wide law of the coordinates.
ALONG = 0.5

# Prior median of the length along the axis of the vehicles, on which the vehicle under test is at 0 and its
# predecessor at 1. With the median amplitude, the boundaries of the two then differ by about half a normal
# score.
VEHICLE_LENGTH = 10.0

# Where the logarithms of the lengths and of the amplitude are sought, and most iterations of the search,
# which is repeated when there are more runs.
LOG_LENGTH_BOUNDS, LOG_AMPLITUDE_BOUNDS = (-2.0, 3.0), (-1.0, 4.0)
LEARNING_STEPS = 5

# Most runs that the surrogate is conditioned on: memory grows with their square, time with their cube.
MOST_RUNS = 600

# The regression of the scores: log-normal prior of the standard deviation of its noise, which stands for all
# that is too fine to be learnt, bounds of its logarithm, and most iterations of the search for lengths,
# amplitude and noise. The prior median of the amplitude is 1, which is the variance of what is regressed.
NOISE, NOISE_SPREAD = 0.1, 1.0
LOG_NOISE_BOUNDS = (-4.0, 0.0)
GRADED_STEPS = 15

# Most runs that this regression is conditioned on.
GRADED_RUNS = 300

# Share of the variance that is added to the diagonal of the covariance, so that repeated points do no harm.
JITTER = 1e-6

# Share of the new value in each step of expectation propagation. All sites move at once, and with their full
# steps they could overshoot together.
DAMPING = 0.6

# Most steps of expectation propagation.
SWEEPS = 40

# Expectation propagation stops when a step changes the log evidence by less than this. The second value holds
# while lengths and amplitude are sought: it is of no consequence for the choice between two of them.
SETTLED, ROUGHLY_SETTLED = 1e-3, 0.03

# Precision of a site that is new, and bounds that rounding must not cross while sites are updated.
FIRST_PRECISION = 1e-3
LEAST_PRECISION, LEAST_VARIANCE = 1e-10, 1e-13

# ---- vehicles that do not repeat themselves

# Two scores are the same if they differ by no more than this, relative to one of them or to 1: rounding may
# depend on the batch.
SAME_SCORE = 1e-5

# A score that is not finite is replaced by this, because JSON has no infinity.
LARGEST_SCORE = float(np.finfo(float).max)

# Repeats that a sampler makes at the beginning of the second phase, unless the vehicle is known to repeat
# itself. They find out whether chance has a part in most runs, as noise has.
FIRST_REPEATS = 5

# Repeats without a difference after which a vehicle counts as one that repeats itself. A vehicle that lapses
# in 1 % of its runs then shows a difference with probability 1 - 0.98^350 = 99.9 %.
ENOUGH_REPEATS = 350

# Unexpected events of a vehicle that may lapse after which its runs end. A count of five is known to a factor
# of about three, and none of the usual numbers of runs would improve much on that.
ENOUGH_UNEXPECTED = 5

# Share of repeats that differ from which on chance has a part in most runs.
OFTEN = 0.5

# Prior median of the amplitude of the surrogate of the flags where these have noise.
NOISY_AMPLITUDE = 3.0

# As `FRINGE_WEIGHT`, where an outcome is one draw of a probability: with noise a large part of the events
# happen where the probability is small and the normal law is large.
NOISY_FRINGE_WEIGHT = 100.0

# As `FRINGE`, where an outcome is one draw of a probability.
NOISY_FRINGE = 0.002

# As `USABLE`, where an outcome is one draw of a probability: no surrogate foretells it exactly then.
NOISY_USABLE = 10.0

# Logarithm of the odds, before any run of the second phase, that the regression of the scores foretells
# better than the surrogate of the flags, where noise is in most runs.
NOISY_LOG_ODDS = 4.0
