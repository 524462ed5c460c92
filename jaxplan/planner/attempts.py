"""The attempts at one scenario: its goals, a *ladder* of attempts at each, and the best plan so far.

For each goal, nearest first, a ladder is climbed. Its *rungs* are attempts: along the path as found, along a
new path with more clearance, and along both with more nodes, so that the trajectory keeps closer to them. A
search that finds no path with the wanted clearance is repeated without any, and before that in steps short
enough for the narrowest keep-in zone, if those asked for are longer. If a device's own joints cannot
get to a goal, goals at other whole turns of these joints are tried next, then goals within the part of their
ranges that they can reach; a device without a target may also stop on its way. If zones separate a device
from the direction that it prefers, goals without that wish are tried last. If a motion to a goal on the edge
of a zone swings over it, goals a little off the edge are looked for. The first certified plan is OK and ends
the attempts; else the answer is the attempt that got furthest (`_STATUS_ORDER`).

Where targets or zones move, a goal is for one end time, and fits and goals are iterated until both agree
(`moving.Meeting`). The search sees what zones sweep; fit and certificate see them move.

`Attempts` is a state machine: `need` says what is needed next, and an `accept_...` method takes it. Goals,
paths, trajectories and certificates are made by `jaxplan.planner.rounds`.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from jaxplan.certificate import MARGIN_ALLOWANCE, Certificate
from jaxplan.model.goals import LEAST_TIME, GivenState
from jaxplan.model.path import Goal, halve
from jaxplan.model.scenario import MINIMUM, Scenario, SearchSettings, moves
from jaxplan.model.status import Status
from jaxplan.planner import messages
from jaxplan.planner.clock import Clock
from jaxplan.planner.ladder import BARE_LADDER, LADDER, Ladder
from jaxplan.planner.moving import Meeting, always, duration_guesses, swept
from jaxplan.planner.proving import ProofQuery
from jaxplan.planner.record import Plan
from jaxplan.planner.shorter import Shorter, is_improvable
from jaxplan.planner.steps import (
    GoalQuery,
    SearchQuery,
    fitted_plan,
    goals_unwished,
    goals_within,
    judged,
    other_ends,
    other_turns,
    wanted_fit,
)
from jaxplan.planner.validity import start_breaches
from jaxplan.search import (
    SearchResult,
    derived_seed,
    find_barrier,
    find_joint_barrier,
    in_narrow_zones,
    make_scene,
    short_of,
)
from jaxplan.trajectory import Fit, FitQuery

# rad, how far goals are kept off the edges of zones once a motion to a goal on an edge has crossed it.
EDGE = 1e-6

# Outcomes from the least to the most informative: the most informative one is reported.
_STATUS_ORDER = (
    Status.NO_PATH,  # to one goal
    Status.TIME_LIMIT,
    Status.NODE_LIMIT,
    Status.INFEASIBLE,
    Status.UNCERTIFIED,
    Status.GOAL_MISSED,
    Status.LIMITS_TOO_TIGHT,
    Status.OK,
)
# Outcomes after which no other path to the same goal is tried.
_FINAL_STATUSES = (Status.LIMITS_TOO_TIGHT, Status.GOAL_MISSED)


class Attempts:
    """The state of planning one scenario: attempts still to be made, the next need, the best plan so far.

    Args:
        scenario: the problem and its settings.
        clock: counts the computation time of the steps, and says what is left.
        enough: s, a duration that is short enough: no shorter plan is sought than one that takes no longer.

    Attributes:
        need: the request for goals, a path, a fit or a certificate to answer next; None once all is settled.
        plan: the attempt that got furthest, without its timings; None before the first.
        enough: s, see above.
    """

    def __init__(self, scenario: Scenario, clock: Clock, *, enough: float = 0.0) -> None:
        self.scenario, self.clock, self.enough = scenario, clock, enough
        self._goal_scenario = scenario  # with the clearance that goals are to have
        self.need: GoalQuery | SearchQuery | FitQuery | ProofQuery | None = None
        self.plan: Plan | None = None
        self._end_times: list[float | None] = []  # s, when the manoeuvre may end, still to be tried
        self._goals_left: list[tuple[Goal, float]] = []  # goals still to be tried, with the share of `swept`
        self._substitutes_tried: set[bytes] = set()  # goals tried where devices cannot reach one
        self._reach: dict[int, np.ndarray] = {}  # rad, joint ranges that devices can reach where barriers are
        self._fitted_paths: set[bytes] = set()  # along which fits were asked for
        self._dropped_wishes = False  # whether goals without the wish of a device were looked for
        self._failed_nearest: Plan | None = None  # the failed plan to it, once others are tried
        self._ladder: Ladder | None = None
        self._meeting: Meeting | None = None  # of a fit to a goal that moves, under way
        self._shorter: Shorter | None = None  # than the plan that was found, under way
        self._is_done = False  # whether no other attempt is of use
        broken = start_breaches(scenario)
        if broken:
            message = "; ".join(broken)
            self.plan = Plan(scenario=scenario, status=Status.INVALID_START, message=message)
            return
        with clock.step("decompose"):
            self._end_times = list(duration_guesses(scenario))
        self._request_goals()

    def go_along(self, plan: Plan) -> None:
        """Replace all attempts by a single fit, along the path of `plan` to its goal."""
        if plan.path is None or plan.goal is None:
            raise RuntimeError("a plan to go along has a path")
        self._end_times, ladder = [], Ladder(plan.goal, make_scene(self.scenario, plan.goal), ())
        ladder.so_far = replace(plan, scenario=self.scenario, message="", trajectory=None, certificate=None)
        self._ladder, self.need = ladder, wanted_fit(self.scenario, plan.path, plan.goal)

    def result(self) -> Plan:
        """Return the plan with its computation times; RuntimeError before any attempt has been made."""
        plan = self.plan
        if plan is None:
            raise RuntimeError("no attempt has been made")
        if plan.ok and self._failed_nearest is not None:
            plan = replace(plan, message=messages.farther(self._failed_nearest, plan))
        return replace(plan, timings=self.clock.timings())

    def accept_goals(self, found: tuple[Goal, ...] | Plan) -> None:
        """Take the goals that were needed, or a failed plan that says why there are none, and set `need`."""
        if self._meeting is not None:
            self._meeting.accept_goals(None if isinstance(found, Plan) else found)
            self._sync_with_meeting(self._meeting)
        elif isinstance(found, Plan):
            self.plan = self.plan or found
            self._request_goals()
        else:
            if self.plan is not None and self.plan.status not in _FINAL_STATUSES:
                self.plan = None  # that there was no goal at another time no longer matters
            self._fitted_paths.clear()
            # Where no path avoids all that moving zones sweep, one may still avoid them at each instant.
            shares = (1.0, 0.0) if moves(self.scenario) else (1.0,)
            self._goals_left = [(goal, share) for goal in found for share in shares]
            self._begin_next_goal()

    def accept_path(self, result: SearchResult) -> None:
        """Take the result of the search that `need` asked for, and set the next `need`."""
        if self._shorter is not None:
            self._shorter.accept_path(result)
            self._sync_with_shorter(self._shorter)
            return
        ladder = self._current_ladder
        if result.status is Status.NODE_LIMIT and self._search_in_shorter_steps(ladder):
            return
        first = not ladder.found
        ladder.found[ladder.factor] = result
        if first and result.path is None and result.status is not Status.TIME_LIMIT:
            ladder.rungs = list(BARE_LADDER)
            self._climb_next_rung(ladder)
        else:
            self._fit_along(ladder, result)

    def _search_in_shorter_steps(self, ladder: Ladder) -> bool:
        """Set `need` to the same search in steps for narrow zones; False if its steps are short enough."""
        scene = in_narrow_zones(self.scenario, ladder.scene)
        if scene is None:
            return False
        ladder.scene = scene
        self.need = SearchQuery(scene, self._search_settings(ladder.factor, len(ladder.found)))
        return True

    def accept_fit(self, fitted: Fit) -> None:
        """Take the fit that `need` asked for, and set the next `need`."""
        if self._shorter is not None:
            self._shorter.accept_fit(fitted)
            self._sync_with_shorter(self._shorter)
        elif self._meeting is None:
            self._request_certificate(fitted)
        else:
            self._meeting.accept_fit(fitted)
            self._sync_with_meeting(self._meeting)

    def accept_certificate(self, certificate: Certificate) -> None:
        """Take the certificate that `need` asked for, and set the next `need`."""
        if self._shorter is not None:
            self._shorter.accept_certificate(certificate)
            self._sync_with_shorter(self._shorter)
            return
        ladder = self._current_ladder
        if not certificate.certified and ladder.spare is not None:
            self._request_certificate(ladder.spare)
        else:
            if not certificate.certified and ladder.uncertified is None:
                ladder.uncertified = ladder.so_far
            self._record_attempt(ladder, judged(ladder.so_far, certificate))

    @property
    def _current_ladder(self) -> Ladder:
        """The ladder under way; RuntimeError before the first goal."""
        if self._ladder is None:
            raise RuntimeError("no goal has been found yet")
        return self._ladder

    def _request_goals(self) -> None:
        """Set `need` to the goals at the next possible end time of the manoeuvre, or to None without one."""
        self.need = GoalQuery(self._goal_scenario, self._end_times.pop(0)) if self._end_times else None

    def _begin_next_goal(self) -> None:
        """Begin with the next goal, or with the same one and other cones for moving zones.

        At the end, when goals just off the edges of zones have been asked for, too, `need` is None.
        """
        self.need = None
        if not self._goals_left or self._is_done:
            again = self._scenario_off_edges()
            if again is not None:
                self._goal_scenario, self._is_done = again, False
                self._end_times = list(duration_guesses(again))
            elif self._should_try_other_times():
                self._ladder = self._failed_nearest = None  # goals at another time are no worse ones
            else:
                return
            self._request_goals()
            return
        goal, share = self._goals_left.pop(0)
        if self._ladder is not None and goal is not self._ladder.goal and self._failed_nearest is None:
            self._failed_nearest = self.plan
        self._ladder = self._make_ladder(goal, share)
        self._climb_next_rung(self._ladder)

    def _should_try_other_times(self) -> bool:
        """Whether to try other end times for moving targets, as goals at those tried ask for too much."""
        failed = self.plan is not None and self.plan.status in _FINAL_STATUSES
        return failed and bool(self._end_times) and not self._is_done and self.scenario.goal.moves

    def _scenario_off_edges(self) -> Scenario | None:
        """The scenario with goals kept `EDGE` off zones, if a motion to a goal on an edge swung over it.

        None if it did not, or if the goal is a given state or has a clearance of `EDGE` already.
        """
        asked, plan = self._goal_scenario.goal, self.plan
        if plan is None or plan.status is not Status.UNCERTIFIED or isinstance(asked, GivenState):
            return None
        margin = None if plan.certificate is None else plan.certificate.min_margin
        if asked.clearance >= EDGE or margin is None or not -EDGE < margin < -MARGIN_ALLOWANCE:
            return None
        return replace(self.scenario, goal=replace(asked, clearance=EDGE))

    def _make_ladder(self, goal: Goal, share: float) -> Ladder:
        """Return a ladder for a goal; it has no rungs if a barrier is in the way, and other goals are queued.

        `share` is the fraction of what moving zones sweep that the search avoids, as of `swept`.
        """
        scenario = self.scenario
        seen, proved = swept(scenario, goal, share), always(scenario, goal)
        scene = make_scene(scenario, goal, seen)
        with self.clock.step("search"):
            forbidden = scene if proved is seen else make_scene(scenario, goal, proved)
            barrier = find_barrier(forbidden)
            settled = self._devices_fixed_by_goal()
            closed = None if barrier else find_joint_barrier(scene, settled)
            free = set(range(scene.gimbals.count)).difference(settled)
            parted = None if barrier or closed else find_joint_barrier(scene, sorted(free))
        if barrier is not None:
            message = messages.parted(scenario, forbidden, barrier)
            if not self._dropped_wishes:
                self._dropped_wishes = True
                with self.clock.step("decompose"):
                    found = goals_unwished(scenario, barrier.device)
                self._goals_left += self._select_untried(found, share)
        elif closed is not None:
            message = messages.closed(scenario, closed, goal.time)
            with self.clock.step("decompose"):
                others = other_turns(scenario, goal, closed.device)
                if closed.device not in self._reach:
                    self._reach[closed.device] = closed.reach
                    others += goals_within(scenario, self._reach)
            self._goals_left[:0] = self._select_untried(others, share)
        elif parted is not None:
            # No proof, as the device may end elsewhere: before the barrier, where no other goal is better.
            turned = self._select_untried(other_turns(scenario, goal, parted.device), share)
            nearer = other_ends(scenario, goal, parted.device, short_of(scene, parted.device))
            ended = self._select_untried(nearer, share)
            if not turned and not ended:
                return Ladder(goal, scene, LADDER)
            self._goals_left = [*turned, *self._goals_left, *ended]
            message = messages.closed(scenario, parted, goal.time)
            failed = Plan(scenario=scenario, status=Status.NO_PATH, message=message, goal=goal)
            self._failed_nearest = self._failed_nearest or failed
            return Ladder(goal, scene, ())
        else:
            return Ladder(goal, scene, LADDER)
        self._keep_if_better(Plan(scenario=scenario, status=Status.NO_PATH, message=message, goal=goal))
        return Ladder(goal, scene, ())

    def _select_untried(self, goals: Sequence[Goal], share: float) -> list[tuple[Goal, float]]:
        """Return the goals that were not tried yet, each with `share` (see `swept`); mark them as tried."""
        return [(goal, share) for goal in goals if self._mark_if_new(goal)]

    def _devices_fixed_by_goal(self) -> list[int]:
        """Indices of the gimbals whose joints the goal fixes, which alone may prove that there is no path."""
        craft, asked = self.scenario.spacecraft, self.scenario.goal
        every = range(craft.gimbals.count)
        if isinstance(asked, GivenState):
            return list(every)
        kept = (*asked.names(craft), *asked.hold)
        return [number for number in every if craft.device_names[number] in kept]

    def _mark_if_new(self, goal: Goal) -> bool:
        """Mark a goal as tried in place of another one; False if it was tried before."""
        own = np.round([*goal.attitude.ravel(), *goal.joints], 6).tobytes()
        new = own not in self._substitutes_tried
        self._substitutes_tried.add(own)
        return new

    def _climb_next_rung(self, ladder: Ladder) -> None:
        """Begin with the next attempt of a ladder; after the last one go on to the next goal."""
        if self._is_done or not ladder.rungs:
            if self._is_done or not self._request_unbent_fit(ladder):
                self._begin_next_goal()
            return
        ladder.factor, ladder.halvings = ladder.rungs.pop(0)
        if ladder.factor in ladder.found:
            self._fit_along(ladder, ladder.found[ladder.factor])
        else:
            self.need = SearchQuery(ladder.scene, self._search_settings(ladder.factor, len(ladder.found)))

    def _request_unbent_fit(self, ladder: Ladder) -> bool:
        """Ask for the shortest motion without bent curves, if none from bent ones was certified.

        Bent curves give shorter motions, which may swing from the path over the edge of a zone. Returns
        False, with `need` unchanged, where this was tried before or no curve was bent.
        """
        failed, settings = ladder.uncertified, self.scenario.trajectory
        bends = settings.duration == MINIMUM and settings.node_tube is None and settings.first_guesses > 0
        if ladder.unbent or failed is None or failed.path is None or failed.goal is None:
            return False
        ladder.unbent = True
        if not bends or moves(self.scenario):
            return False
        ladder.so_far = replace(failed, certificate=None)
        query = wanted_fit(self.scenario, failed.path, failed.goal)
        self.need = replace(query, settings=replace(query.settings, first_guesses=0))
        return True

    def _search_settings(self, factor: float, earlier: int) -> SearchSettings:
        """Search settings with the clearance times `factor`, seeded by the number of `earlier` searches."""
        settings = self.scenario.search
        return replace(
            settings,
            clearance=factor * settings.clearance,
            seed=derived_seed(settings.seed, earlier) if earlier else settings.seed,
            time_limit=self.clock.left(),
        )

    def _fit_along(self, ladder: Ladder, result: SearchResult) -> None:
        """Set `need` to a fit along the path that a search found; if it found none, end this ladder."""
        so_far = Plan(scenario=self.scenario, status=result.status, goal=ladder.goal, search=result)
        if result.path is None:
            ladder.rungs = []
            message = messages.no_path(self.scenario, ladder.scene, result)
            self._record_attempt(ladder, replace(so_far, message=message))
            return
        path = result.path
        for _ in range(ladder.halvings):
            path = halve(path)
        own = np.concatenate([path.attitudes.ravel(), path.joints.ravel()]).tobytes()
        if own in self._fitted_paths:  # the fit would be the same
            self._climb_next_rung(ladder)
            return
        self._fitted_paths.add(own)
        ladder.so_far = replace(so_far, path=path)
        if moves(self.scenario):
            self._meeting = Meeting(self._goal_scenario, ladder.goal, path)
            self._sync_with_meeting(self._meeting)
        else:
            self.need = wanted_fit(self.scenario, path, ladder.goal)

    def _sync_with_meeting(self, meeting: Meeting) -> None:
        """Set `need` to that of a `Meeting`, in which fit and goal settle in turn; then take its fit."""
        self.need = meeting.need
        if meeting.need is None:
            self._meeting, ladder = None, self._current_ladder
            ladder.so_far = replace(ladder.so_far, goal=meeting.goal, path=meeting.path)
            self._request_certificate(meeting.fit)

    def _request_certificate(self, fitted: Fit) -> None:
        """Set `need` to the certificate of a fit; if it has no trajectory, count a failed attempt."""
        ladder = self._current_ladder
        plan = ladder.so_far = fitted_plan(ladder.so_far, fitted)
        ladder.spare = fitted.spare
        if plan.trajectory is None or plan.goal is None:
            self._record_attempt(ladder, plan)
        else:
            self.need = ProofQuery(scenario=self.scenario, goal=plan.goal, trajectory=plan.trajectory)

    def _record_attempt(self, ladder: Ladder, attempt: Plan) -> None:
        """Keep an attempt if it is the best so far; begin with the next one, or look for a shorter plan."""
        self._keep_if_better(attempt)
        # The global method looks for the shortest motion before it says that a duration is too short.
        if attempt.status in _FINAL_STATUSES and self.scenario.trajectory.method == "global":
            ladder.rungs = []
        if self._scenario_off_edges() is not None:  # which no other path to goals on them changes
            self._is_done = True
        others, longer = self._equally_good_goals(), self.clock.improve_for
        if is_improvable(attempt, longer, others, self.enough):
            self._sync_with_shorter(Shorter(attempt, ladder.scene, self.clock.left(), longer, others))
        else:
            self._climb_next_rung(ladder)

    def _equally_good_goals(self) -> list[Goal]:
        """Goals left that are as good as the one reached.

        Empty if criterion or wishes rank them otherwise.
        """
        asked = self.scenario.asked
        if isinstance(asked, GivenState) or asked.criterion != LEAST_TIME or asked.prefer:
            return []
        return [goal for goal, _ in self._goals_left]

    def _sync_with_shorter(self, shorter: Shorter) -> None:
        """Take plan and `need` over from the search for a shorter plan; at its end `need` is None."""
        self._shorter, self.plan, self.need = shorter, shorter.plan, shorter.need
        if self.plan.trajectory is not None:
            self.clock.shortest = min(self.clock.shortest, self.plan.trajectory.duration)

    def _keep_if_better(self, attempt: Plan) -> None:
        """Keep an attempt if its status is more informative than that of the best one so far."""
        if self.plan is None or _STATUS_ORDER.index(attempt.status) > _STATUS_ORDER.index(self.plan.status):
            self.plan = attempt
        self._is_done = attempt.status in (Status.OK, Status.TIME_LIMIT)
