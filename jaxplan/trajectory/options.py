"""Numbers that the spline fit is tuned by, each with its unit, its meaning and what it does.

The code reads them where it uses them, as ``options.SQP.ftol``, so a test may set another value there. They
were chosen by trials on random scenes. Guards against division by zero stay where they are used.
"""

from types import SimpleNamespace

import numpy as np

# How fine a spline and the places on it are, and how fast it goes along the path.
MESH = SimpleNamespace(
    intervals=32,  # of a spline, or a multiple of it; more follow zones closer, but cost time
    intervals_per_node=1.5,  # for a node that is passed exactly; fewer leave no freedom between nodes
    intervals_per_tube=2 / 3,  # for a node in a tube, which asks for less
    points=8,  # places on each interval; more leave less unseen between them
    few_points=4,  # the same on each of many intervals
    many=128,  # intervals from which on there are few points on each
    tube_nodes=8,  # least padded number of nodes in tubes; a larger one makes more fits alike
    smoothing=1e-9,  # weight of the third derivative beside the distance from the path, at the start
    calm_flank=1 / 3,  # of the duration, where there is time; near the least acceleration energy
    steep_flank=0.1,  # of the duration, where there is not; the least flank
    steep_rises=2.0,  # times the quickest rise; the least flank, too
    flank_breaks=9,  # intervals that cover a flank and a little more
    flank_step=0.25,  # of the flank, the length of one such interval
)


# Which paths one chart can hold.
CHART = SimpleNamespace(
    reach=4.0,  # rad off the steady rotation, short of the whole turn at which a chart is singular
    near=1.0,  # rad; a chart whose nodes stay within is not compared with the other way round
)


# What rows ask for, and which of them are looked at.
ROWS = SimpleNamespace(
    tube_radius=float(np.deg2rad(1.0)),  # rad about nodes, unless the settings of a fit have one
    clearance=float(np.deg2rad(0.3)),  # rad beyond zones, so that nothing happens between the places
    share_of_ends=0.5,  # of the margin at start or goal, the most that is wanted elsewhere
    near_share=0.15,  # of a limit or tube; rows with less slack are in a program from the start
    near_angle=float(np.deg2rad(1.0)),  # rad; the same for angles
    far_share=0.5,  # of a limit; with more slack at every place no step is taken to reach it
    stride=4,  # of places next to each other one in so many is held, and those that are extreme
    broken=1e-6,  # of a row, beyond which its violation counts
)


# How the quadratic program of a step takes rows in and leaves them out.
PROGRAM = SimpleNamespace(
    rounds=6,  # of solving again with rows that were missed
    all_at_once=2,  # rounds after which all broken rows are added, not only the worst ones
    broken=1e-3,  # of a row's tolerance; a row that a step breaks by more is added
    kept=0.1,  # of a row's tolerance; a row that a step leaves more slack is taken out again
    binding=1e-6,  # of the largest multiplier; smaller ones count as zero
    most_rows=512,  # of a dual; no more can bind in the usual number of intervals
    shortest_step=-0.5,  # of the duration, the most that is taken off at once: it stays positive
    no_slope=1e-9,  # rows with smaller derivatives are beyond what a program may change
)


# Where the interior-point iteration of the dual begins and ends.
BOX_QP = SimpleNamespace(
    most_iterations=60,  # after which the answer is taken if it is usable
    tolerance=1e-9,  # of the scaled residual, relative to the size of the linear term
    usable=1e-4,  # such a residual is still an answer, where rounding or the iterations end it
    interior=0.995,  # share of the way to the boundary that a step may take
    inside=0.5,  # of the size of the linear term: how far inside the box it begins
    regularisation=1e-14,  # added to the diagonal, which is of order one
    together=16,  # programs; their matrices are then still in the processor's cache
)


# When steps are damped, when it becomes dearer to break rows, and when the search ends.
SQP = SimpleNamespace(
    together=16,  # problems of a stack; with more, memory is what takes the time
    enough_steps=16,  # after which only searches go on whose duration still falls
    most_steps=64,  # after which every search ends
    falling=0.05,  # of the duration, in a step: it still falls
    penalty_updates=1,  # how often penalties grow where something stays broken
    penalty_growth=30.0,  # by what factor
    energy_weight=1e-3,  # of the energy beside the duration, where that is looked for
    duration_hessian=12.0,  # in the logarithm of the duration: alone it falls by 1 / 12 in a step
    settled=1e-4,  # of the merit: a smaller change between steps ends the search, as `ftol` does
    ftol=1e-3,  # of the energy: the least decrease for which another step is made
    damping=8.0,  # factor by which damping grows after a failed step, and falls after a good one
    first_damping=1e-2,  # of the energy's form: the damping after the first failed step
    no_damping=1e-6,  # below which it is dropped
    most_failed=2,  # failed steps in a row, once penalties have grown: nothing better is near
)


# When an attempt is good enough, and when there is no hope for more intervals.
ACCEPTANCE = SimpleNamespace(
    tube_broken=1e-6,  # rad beyond the tube, up to which nodes count as passed
    deep=float(np.deg2rad(0.3)),  # rad; a zone broken by more is not so for want of intervals
    rounding=1e-9,  # rad of a margin that is rounding alone
    kept_margin=0.3,  # of the wanted margins, which a sound curve has
    mended=1e-3,  # of a limit; a first curve that breaks it by more is not improved in a given time
    nearly=1.01,  # on time; a curve that keeps limits with so much more of it is nearly there
    hopeless=1.05,  # on time; a curve that needs more of it is not mended by more intervals
    rate_rounding=1e-9,  # of a limit, by which rates at start and end may be beyond it
)


# Which attempts are made, one after the other.
STRATEGY = SimpleNamespace(
    begin=1.01,  # times the duration of a trapezoid, whose accelerations jump: the first guess
    tighter=(1e-3, 1e-2),  # shares of the limits left for between places, first and then
    wider=3.0,  # times the tube's radius, before there is none
    longer=1.02,  # from one duration to the next, when one is looked for that is long enough
    most_longer=1.1,  # the same for motions with rates at the ends, in one step
    looks=8,  # at most so many durations are tried
    slow=2.0,  # times the bound; beyond, a stretched motion is tried without a tube as well
    detour=1.1,  # times the bound; beyond, a shortest motion is compared with a stretched one
    hurry=0.97,  # of the time along the nodes; with less of it they are only a first guess
    leisure=1.15,  # of the time along the nodes; with less of it breaks lie close about the flanks
)


# How the optimum near a fit is found, and the rows that bind there.
ACTIVE_SET = SimpleNamespace(
    padding=(64, 16, 16),  # least padded numbers of linear rows, loads and margins
    ftol=1e-9,  # of the energy: nearer the optimum than the plan, it shows which rows bind
    steps=40,  # from there to the optimum, at most
    settled=1e-8,  # rad, a step that changes less is the last
    broken=1e-8,  # of a limit, or rad; a row that is broken by more is near
    squares=tuple(10.0**power for power in range(-2, 7)),  # of rows, over the size of the form
    flattest=1e-6,  # of the largest curvature, where the form stays without a minimum
    refit_steps=5,  # of Newton's method when inputs have changed, before the last one
    refit_residual=1e-9,  # at which these end earlier
    flank_step=1e-4,  # of the pace's flank, to either side, for differences by it
    regularisation=1e-13,  # of the matrix, where rows that bind depend on each other
)
