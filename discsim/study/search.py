"""The search for the least CPU time at an error: from a cheap coarse setting, by the powers that its knobs have there.

A place is a rung for each knob: 0 as the scene has it; RUNG up is one step finer of a number, and of a choice its
next value. At the centre every knob is probed one rung each way (`look`), which gives

    dE_k = ln(error / error of the centre),   dC_k = ln(CPU time / that of the centre)

Between and beyond probes both are taken for power laws of the knob (dE a little bent, as errors of several knobs add
up), and knobs are taken to act by themselves: so the place that minimises sum dC_k + lambda sum dE_k is found knob by
knob, with the least lambda for which

    sum dE_k <= ln(goal / error of the centre)                                                     (1)

Where nothing in reach meets (1), lambda is the price of an error here: 1 / (what the best knob gains of ln error for
ln CPU). That place is run. If it is better than all others it is the next centre; if not, the reach is halved. The end
is where no move is worth GAIN. Last the finalists are run with several seeds in turn, and the means decide.

What a gain is has to be above twice the scatter between seeds, so that a knob that does nothing is left where it is,
and one that only costs is turned down. It knows nothing of runs: tests give it synthetic ones.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from statistics import stdev
from typing import NamedTuple

from discsim.study.trials import RUNG, Bench, Knob, Place, Trial

REACH = 2 * RUNG  # of a move
GAIN = 0.05  # of ln CPU: less is not worth a move
STEADY = 0.07  # change of ln CPU that is the machine's, at least
CHEAPER_FINER = 4.0  # times that: what is finer, and no better, is not cheaper either unless by so much
LEAST_MARGIN = 0.01  # of ln error, where seeds do not matter
CURVED = 1.3  # power of the distance that dE goes with where it rises, and 1 over it where it falls: errors add up
SEEDS = 5  # of the coarse place, whose scatter tells what is noise
HOPELESS = math.log(2.0)  # ln price above which another choice is not looked at again
USUAL_GAIN = 0.5  # of ln error for ln CPU, where nothing is known of it
TRIES, ROUNDS = 4, 40
DEAREST = 1e3  # lambda
RAISED, SHARPER = 20, 0.95  # times that the means over seeds may ask for a smaller error of single runs, and by what
CAP, SPARE = 10.0, 0.5  # a run is given up after so many times the centre's CPU time, and so many seconds
NEAR, MOST_FINALISTS = 1.3, 3  # finalists take at most so many times the CPU time of the cheapest


class Option(NamedTuple):
    """A rung of a knob, with what it changes at the centre."""

    rung: int
    error: float  # dE
    cost: float  # dC


class Search:
    """`goal`: the error wanted; `start`: the coarse place to begin at. `centre`: the best place so far."""

    def __init__(
        self,
        knobs: Sequence[Knob],
        bench: Bench,
        goal: float,
        start: Place,
        say: Callable[[str], None],
        repeat: int = 3,
    ) -> None:
        self.knobs, self.bench, self.goal, self.say, self.repeat = knobs, bench, goal, say, repeat
        self.aim = goal  # for single runs; below the goal where the mean over seeds turned out worse
        self.centre = start
        self.noise = 0.0  # twice the scatter of ln error between seeds, of the coarse place
        self.steady = STEADY  # twice the scatter of ln CPU
        self.seeds = 1  # of each probe
        self.rate = USUAL_GAIN
        self.been: set[Place] = set()  # earlier centres
        self.hopeless: set[tuple[int, int]] = set()

    def at(self, place: Place) -> Trial | None:
        trial = self.bench.trials.get(place)
        return trial if trial and trial.runs else None

    @property
    def here(self) -> Trial:
        return self.bench.trials[self.centre]

    @property
    def margin(self) -> float:
        """Of ln error: what is less is noise."""
        return max(LEAST_MARGIN, self.noise / math.sqrt(self.seeds))

    def done(self) -> list[Trial]:
        return [trial for trial in self.bench.trials.values() if trial.runs]

    def run(self) -> Trial | None:
        """The cheapest place that reaches the goal; None where the search found none. Raises Spent."""
        if not self._begin():
            return None
        if self.here.scatter > 0.0:
            self.bench.run([self.centre], SEEDS)
        self.noise = 2.0 * self.here.scatter / max(self.here.error, 1e-300)
        times = [_ln(run.cpu) for run in self.here.runs]
        self.steady = max(STEADY, 2.0 * stdev(times) if len(times) > 1 else 0.0)
        for _ in range(RAISED):
            self._descend()
            if self.here.error > self.aim:
                break
            self._plain()
            found = self._finals([self.centre, *self._good()])
            if found is not None:
                return found
            self.aim *= SHARPER
        self.aim = self.goal
        groups = [[place] for place in self._good()[:TRIES]]  # what one seed or another had good
        return next((found for found in map(self._finals, groups) if found), None)

    def _begin(self) -> bool:
        """Run the start; where it gives no result, what is half as far from the scene. False: nor does the scene."""
        while True:
            if self.bench.allowed(self.centre):
                self.bench.run([self.centre], self.repeat)
                if self.at(self.centre):
                    return True
            if not any(self.centre):
                return False
            self.centre = tuple(int(rung / 2) for rung in self.centre)

    def _good(self) -> list[Place]:
        """Places that reach the aim, the cheapest first."""
        return [t.place for t in sorted(self.done(), key=lambda t: t.cpu) if t.error <= self.aim]

    # Moves

    def _descend(self) -> None:
        """Move the centre until no move is worth it."""
        for _ in range(ROUNDS):
            self.look()
            if self._step():
                self.seeds = 1
            elif self.here.error <= self.aim:
                return
            elif self._further():
                self.seeds = 1
            elif self.noise > LEAST_MARGIN and self.seeds < self.repeat:
                self.seeds += 1  # what gains may hide in the noise
            elif not self._all_finer():
                return

    def look(self) -> None:
        """Probe every knob one rung each way."""
        near = list(self._near(self.centre))
        self._measure_noise()
        self.bench.run(near, self.seeds, CAP * self.here.cpu + SPARE)
        rates = []
        for place in near:
            change = self._change(place)
            if change and change.error < 0.0 < change.cost:
                rates.append(-change.error / change.cost)
        self.rate = min(max(rates, default=USUAL_GAIN), 4.0)
        for place in near:
            (knob, rung), change = self._moved(place), self._change(place)
            if self.knobs[knob].choice and (change is None or change.cost + change.error / self.rate > HOPELESS):
                self.hopeless.add((knob, rung))

    def _measure_noise(self) -> None:
        """The scatter between seeds at this centre, two parts of three; it falls as settings get finer."""
        if self.noise > 0.0:
            self.bench.run([self.centre], self.repeat)
            own = 2.0 * self.here.scatter / max(self.here.error, 1e-300)
            self.noise = math.sqrt((2.0 * own**2 + self.noise**2) / 3.0)

    def _near(self, place: Place) -> Iterator[Place]:
        for k, knob in enumerate(self.knobs):
            if knob.choice:
                rungs = [r for r in range(knob.lowest, knob.highest + 1) if (k, r) not in self.hopeless]
            else:
                rungs = [r for r in (place[k] - RUNG, place[k] + RUNG) if knob.lowest <= r <= knob.highest]
            for rung in rungs:
                there = (*place[:k], rung, *place[k + 1 :])
                if rung != place[k] and self.bench.allowed(there):
                    yield there

    def _moved(self, place: Place) -> tuple[int, int]:
        k = next(k for k, rung in enumerate(place) if rung != self.centre[k])
        return k, place[k]

    def _change(self, place: Place) -> Option | None:
        """What a place has against the centre, without what is noise."""
        there, here = self.at(place), self.here
        if there is None:
            return None
        error, cost = _ln(there.error / here.error), _ln(there.cpu / here.cpu)
        error = 0.0 if -self.margin < error < 0.0 else error
        finer = any(r > own and not k.choice for r, own, k in zip(place, self.centre, self.knobs, strict=True))
        least = self.steady * (CHEAPER_FINER if finer and error >= 0.0 and cost < 0.0 else 1.0)
        return Option(0, error, 0.0 if abs(cost) < least else cost)

    def _step(self) -> bool:
        """Run the places that the probes promise most of, at most TRIES; True if one, or a probe, is the new centre."""
        options, reach, missed = self._options(), REACH, 0.0
        for _ in range(TRIES):
            target, change = self._target(options, reach, missed)
            if target == self.centre:
                break
            if self.at(target) is None:
                self.bench.run([target], most=3.0 * self.here.cpu * math.exp(change.cost) + SPARE)
            if self._better(target):
                self._go(target)
                return True
            found = self.at(target)
            if found is not None:
                missed = max(missed, _ln(found.error / self.here.error) - change.error)
            reach = max(1, reach // 2)
        better = [place for place in self._near(self.centre) if self._better(place)]
        if better:
            self._go(min(better, key=self._merit))
        return bool(better)

    def _options(self) -> list[list[Option]]:
        """Rungs of each knob within REACH, each with what it is to change."""
        out = []
        for k, knob in enumerate(self.knobs):
            options = [Option(self.centre[k], 0.0, 0.0)]
            for place in self._near(self.centre):
                rung, change = place[k], self._change(place)
                if rung == self.centre[k] or change is None:
                    continue
                if knob.choice:
                    options.append(Option(rung, change.error, change.cost))
                    continue
                way = 1 if rung > self.centre[k] else -1
                for half in range(knob.stride, REACH + 1, knob.stride):
                    there = self.centre[k] + way * half
                    if knob.lowest <= there <= knob.highest:
                        share = half / RUNG
                        bent = share ** (CURVED if change.error > 0.0 else 1.0 / CURVED)
                        options.append(Option(there, change.error * bent, change.cost * share))
            out.append(options)
        return out

    def _target(self, options: list[list[Option]], reach: int, missed: float) -> tuple[Place, Option]:
        """The place that eq. (1) gives within `reach`, `missed` below what the probes say, and its change."""
        slack = math.log(self.aim) - _ln(self.here.error) - missed
        most = math.inf if slack >= 0.0 else 1.0 / (0.8 * self.rate)  # a little more than what the best knob takes
        price = 0.02
        while True:
            chosen = [
                min(
                    (o for o in each if knob.choice or abs(o.rung - each[0].rung) <= reach),
                    key=lambda o: o.cost + price * o.error + (1e-3 if o is not each[0] else 0.0),
                )
                for knob, each in zip(self.knobs, options, strict=True)
            ]
            change = Option(0, sum(o.error for o in chosen), sum(o.cost for o in chosen))
            if change.error <= slack or (price >= most and change.error < 0.0) or price >= DEAREST:
                break
            price *= 1.2
        if slack >= 0.0:
            chosen = _filled(chosen, options, slack, reach, self.knobs)
            change = Option(0, sum(o.error for o in chosen), sum(o.cost for o in chosen))
        place = tuple(o.rung for o in chosen)
        # Nearer to the scene and to the probes is surer: a move has to promise something.
        worth = -change.cost if slack >= 0.0 else -change.cost - change.error * max(most, price)
        return (place, change) if worth > GAIN and self.bench.allowed(place) else (self.centre, Option(0, 0.0, 0.0))

    def _further(self) -> bool:
        """Where every gain hides in the noise, the likeliest a rung further than its probe; True if that is better."""
        likely: list[tuple[float, Place]] = []
        for place in self._near(self.centre):
            found, (k, rung) = self.at(place), self._moved(place)
            there = (*place[:k], 2 * rung - self.centre[k], *place[k + 1 :])
            if found and not self.knobs[k].choice and self.knobs[k].lowest <= there[k] <= self.knobs[k].highest:
                gain, cost = -_ln(found.error / self.here.error), _ln(found.cpu / self.here.cpu)
                if gain > 0.0 and self.bench.allowed(there):
                    likely.append((gain / max(cost, self.steady), there))
        if not likely:
            return False
        best = max(likely)[1]
        self.bench.run([best], most=4.0 * CAP * self.here.cpu + SPARE)
        change = self._change(best)
        if change is None or change.error >= 0.0 or best in self.been:
            return False
        self._go(best)
        return True

    def _all_finer(self) -> bool:
        """Where no knob gains by itself, all a rung finer at once; True if that is better."""
        finer = tuple(
            rung if knob.choice else min(knob.highest, rung + RUNG)
            for rung, knob in zip(self.centre, self.knobs, strict=True)
        )
        if finer == self.centre or not self.bench.allowed(finer):
            return False
        self.bench.run([finer], most=4.0 * CAP * self.here.cpu + SPARE)
        found = self.at(finer)
        if found is None or _ln(found.error / self.here.error) > -self.margin:
            return False
        self._go(finer)
        return True

    def _plain(self) -> None:
        """Put back, one by one, what differs from the scene and buys nothing."""
        for k in range(len(self.knobs)):
            if self.here.error > self.aim or self.centre[k] == 0:
                continue
            back = (*self.centre[:k], 0, *self.centre[k + 1 :])
            if not self.bench.allowed(back) or self._dear(k):
                continue
            more = max(2.0 * GAIN, self.steady)
            self.bench.run([back], most=(1.0 + more) * self.here.cpu + SPARE)
            found = self.at(back)
            if found and found.error <= self.aim and _ln(found.cpu / self.here.cpu) < more:
                self._go(back)

    def _dear(self, k: int) -> bool:
        """Whether a rung towards the scene is known to cost more."""
        way = RUNG if self.centre[k] < 0 else -RUNG
        change = self._change((*self.centre[:k], self.centre[k] + way, *self.centre[k + 1 :]))
        return not self.knobs[k].choice and change is not None and change.cost > max(2.0 * GAIN, self.steady)

    # Who is better

    def _merit(self, place: Place) -> tuple[int, float]:
        """What to be least in: CPU time where the goal is reached, else the CPU time to get there."""
        found = self.at(place)
        if found is None:
            return 2, math.inf
        if found.error <= self.aim:
            return 0, _ln(found.cpu)
        return 1, _ln(found.cpu) + _ln(found.error / self.aim) / (0.8 * self.rate)

    def _better(self, place: Place) -> bool:
        """Whether a place is worth to move to. Errors within the noise are no better."""
        if place == self.centre or self.at(place) is None:
            return False
        (level, now), (other, then) = self._merit(self.centre), self._merit(place)
        if other != level:
            return other < level
        change = self._change(place)
        assert change is not None
        if level == 0:
            return then < now - GAIN and change.cost < 0.0
        # Never back to a larger error, or it would go round in circles as the price of an error changes.
        return (
            place not in self.been
            and change.error <= LEAST_MARGIN
            and change.cost + change.error / (0.8 * self.rate) < -GAIN
        )

    def _go(self, place: Place) -> None:
        self.been.add(self.centre)
        self.centre = place
        here = self.here
        self.say(f"  centre: error {here.error:.2g} in {here.cpu:.3g} s of CPU")

    def _finals(self, good: list[Place]) -> Trial | None:
        """The cheapest by the means over seeds of the first of these, if any reaches the goal."""
        most = NEAR * self.bench.trials[good[0]].cpu
        places = [place for place in dict.fromkeys(good) if self.bench.trials[place].cpu <= most][:MOST_FINALISTS]
        scene = tuple(0 for _ in self.knobs)  # every finalist is held against the scene as it stands
        self.bench.run(list(dict.fromkeys([*places, scene])), self.repeat)
        held = [t for t in map(self.at, places) if t and t.error <= self.goal]
        if not held:
            return None
        least = min(t.cpu for t in held)
        best = min(
            (t for t in held if t.cpu <= (1.0 + GAIN) * least), key=lambda t: (_moved_from(scene, t.place), t.cpu)
        )
        self.centre = best.place
        return best


def _filled(
    chosen: list[Option], options: list[list[Option]], slack: float, reach: int, knobs: Sequence[Knob]
) -> list[Option]:
    """What a single price leaves of the slack, knob by knob: two alike turn at the same price."""
    chosen = list(chosen)
    for k, each in enumerate(options):
        left = slack - sum(o.error for o in chosen) + chosen[k].error
        within = (o for o in each if knobs[k].choice or abs(o.rung - each[0].rung) <= reach)
        best = min((o for o in within if o.error <= left), key=lambda o: o.cost, default=chosen[k])
        chosen[k] = best if best.cost < chosen[k].cost - GAIN else chosen[k]
    return chosen


def _moved_from(scene: Place, place: Place) -> int:
    return sum(rung != own for rung, own in zip(place, scene, strict=True))


def _ln(value: float) -> float:
    return math.log(max(value, 1e-300))
