"""Traffic: everybody follows a path, keeps behind whoever is ahead on it, and heeds the signals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lookonce.synthetic.fleet import Fleet, Member
from lookonce.synthetic.footprints import corners_of, overlapping
from lookonce.synthetic.paths import PathTable
from lookonce.synthetic.site import Phase, Site

__all__ = ["Agent", "Signals", "Traffic"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

_STEP_S = 0.1  # longest step of the simulation
_WARM_UP_S, _WARM_UP_STEP_S = 60.0, 0.25
_AMBER_S = 3.0
_MOST_AGENTS = 220
_SIDE_GAP_M = 0.35  # between vehicles that pass each other
_LEAST_GAP_M, _HEADWAY_S = 1.6, 1.2
_BRAKING, _HARDEST_BRAKING = 2.5, 9.0  # m/s^2
_CYCLEWAY_GAP_M, _YIELD_M = 1.9, 16.0
_BACKS_AFTER_S, _BACKING_SPEED, _WAITS_S = 4.0, 0.5, 5.0  # who stands in somebody's way backs, m/s, and waits
_PATIENCE_S = 2.0  # after which, of two that stand in each other's way, the one who came first goes on
_RATES = {"car": 0.055, "bicycle": 0.03, "foot": 0.016}  # entering a path of weight 1 in a second
_HIGHWAY_RATE = 0.46
_SLOWEST_WALK = 1.15
_USUAL_SPEED = {"car": 13.0, "bicycle": 5.0, "foot": 1.35}


@dataclass(slots=True)
class Agent:
    """Somebody on the way.

    Attributes:
        identity: never given twice in a scene.
        member: what it is.
        path: number of its path.
        along: m, of its middle along the path.
        speed: m/s.
        wish: m/s, on a free road.
        pull: m/s^2, how it speeds up.
        stride: phase of the walk in rad.
        stuck_s: how long it has been standing.
        waits_s: how long it goes on letting somebody else out.
        x: m.
        y: m.
        yaw: rad.
        is_braking: whether its brake lights are on.
    """

    identity: int
    member: Member
    path: int
    along: float
    speed: float
    wish: float
    pull: float
    stride: float = 0.0
    stuck_s: float = 0.0
    waits_s: float = 0.0
    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0
    is_braking: bool = False


class Signals:
    """Which signal groups have green, by time; ``share`` of a round is over at time 0."""

    def __init__(self, phases: tuple[Phase, ...], share: float = 0.0) -> None:
        self._phases = phases
        self._round_s = sum(phase.seconds for phase in phases)
        self._offset_s = share * self._round_s

    def state(self, group: int, time_s: float) -> str:
        """Either "red", "amber" or "green"."""
        if not self._phases:
            return "green"
        rest = (time_s + self._offset_s) % self._round_s
        for phase in self._phases:
            if rest < phase.seconds:
                if group not in phase.groups:
                    return "red"
                return "green" if rest < phase.seconds - _AMBER_S else "amber"
            rest -= phase.seconds
        return "red"


class Traffic:
    """Everybody on the way in a site; the state at ``time_s``.

    Args:
        site: the paths and signals.
        fleet: draws those who come.
        rng: draws when and where they come.
        density: of the traffic, 1 = busy.
    """

    def __init__(self, site: Site, fleet: Fleet, rng: np.random.Generator, density: float) -> None:
        self.signals = Signals(site.phases, float(rng.random()))
        self.agents: list[Agent] = []
        self.time_s = -_WARM_UP_S - float(rng.uniform(0, 40))
        self._table = PathTable(site.paths)
        self._fleet, self._rng = fleet, rng
        self._count = 0
        self._crossings = _crossings(self._table)
        self._blocking: set[int] = set()  # identities of those who kept somebody from moving in the last step
        is_highway = not site.phases
        self._rates = np.array(
            [path.weight * density * (_HIGHWAY_RATE if is_highway else _RATES[path.users]) for path in site.paths]
        )
        self._haste = float(rng.uniform(1.4, 2.2)) if is_highway else float(rng.uniform(0.85, 1.1))
        if is_highway and rng.random() < 0.35:
            self._haste = 0.55  # a jam
        while self.time_s < -1e-9:
            self._step(min(_WARM_UP_STEP_S, -self.time_s))
        self.time_s = 0.0

    def advance(self, seconds: float) -> None:
        """Go on for a time."""
        steps = max(1, int(np.ceil(seconds / _STEP_S - 1e-9)))
        for _ in range(steps):
            self._step(seconds / steps)

    def _step(self, step_s: float) -> None:
        self._let_in(step_s)
        if self.agents:
            self._move(step_s)
        self.time_s += step_s
        lengths = [self._table.paths[agent.path].length for agent in self.agents]
        self.agents = [agent for agent, length in zip(self.agents, lengths, strict=True) if agent.along < length - 0.5]

    def _let_in(self, step_s: float) -> None:
        arriving = np.flatnonzero(self._rng.random(len(self._rates)) < self._rates * step_s)
        for path in self._rng.permutation(arriving).tolist():
            if len(self.agents) < _MOST_AGENTS:
                self._enter(path)

    def _enter(self, path: int) -> None:
        users = self._table.paths[path].users
        member = self._fleet.draw(users)
        wish = _USUAL_SPEED[users] * float(np.clip(self._rng.normal(1, 0.12), 0.7, 1.4))
        if users == "foot":
            wish = max(wish, _SLOWEST_WALK)
        if users == "car":
            wish *= self._haste * (0.85 if member.kind not in ("motorcycle",) and member.length > 6.5 else 1.0)
        along = member.length / 2
        gap = self._room_at_entry(path, along + member.length / 2)
        if gap < (0.8 if users == "foot" else 5.0 + member.length * 0.2):
            return
        speed = min(wish, 0.75 * float(np.sqrt(2 * _BRAKING * gap)))
        self._count += 1
        pull = 1.0 if member.length > 6.5 else float(self._rng.uniform(1.5, 2.4))
        stride = float(self._rng.uniform(0, 6.28))
        agent = Agent(self._count, member, path, along, speed, wish, pull, stride)
        self._set_poses([agent])
        if users == "foot" or not self._touches(agent):
            self.agents.append(agent)

    def _room_at_entry(self, path: int, front: float) -> float:
        """How far the nearest one ahead on a path is."""
        rooms = [50.0]
        for other in self.agents:
            rear = max(0, round(other.along - other.member.length / 2))
            rear = min(rear, self._table.nearest_m.shape[2] - 1)
            if self._table.apart_m[path, other.path, rear] < 1.5:
                rooms.append(float(self._table.nearest_m[path, other.path, rear]) - front)
        return min(rooms)

    def _touches(self, agent: Agent) -> bool:
        others = [other for other in self.agents if other.member.person is None]
        first, _ = overlapping(_footprints([agent, *others], 0.3))
        return 0 in first.tolist()

    def _move(self, step_s: float) -> None:
        agents = self.agents
        pull = self._accelerations()
        before = [(agent.along, agent.x, agent.y, agent.yaw) for agent in agents]
        for agent, change in zip(agents, pull.tolist(), strict=True):
            agent.waits_s = max(0.0, agent.waits_s - step_s)
            speed = max(0.0, agent.speed + change * step_s) if not agent.waits_s else 0.0
            agent.along += (agent.speed + speed) / 2 * step_s
            if agent.identity in self._blocking and (agent.waits_s or agent.stuck_s > _BACKS_AFTER_S):
                agent.along -= _BACKING_SPEED * step_s
                agent.waits_s = _WAITS_S
            agent.is_braking = change < -0.6 or (speed < 0.3 and agent.member.person is None)
            agent.speed = speed
            agent.stuck_s = agent.stuck_s + step_s if speed < 0.3 else 0.0
            agent.stride += 4.6 * (speed * step_s) / max(0.6, 0.43 * agent.member.body.size[2])
        self._set_poses(agents)
        self._undo_collisions(before)

    def _undo_collisions(self, before: list[tuple[float, float, float, float]]) -> None:
        """Puts back whoever would touch a vehicle; so no two vehicles ever overlap, since they did not before."""
        agents = self.agents
        is_person = np.array([agent.member.person is not None for agent in agents])
        moved = [True] * len(agents)
        self._blocking = set()
        while True:
            first, second = overlapping(_footprints(agents, 0.1))
            counts = ~(is_person[first] & is_person[second])
            rows = zip(first[counts].tolist(), second[counts].tolist(), strict=True)
            pairs = [(i, j) for i, j in rows if moved[i] or moved[j]]
            to_stop = sorted({self._who_stops(i, j, moved) for i, j in pairs})
            self._blocking |= {agents[i if j in to_stop else j].identity for i, j in pairs}
            if not to_stop:
                return
            for number in to_stop:
                agent = agents[number]
                agent.along, agent.x, agent.y, agent.yaw = before[number]
                agent.speed = 0.0
                moved[number] = False

    def _who_stops(self, i: int, j: int, moved: list[bool]) -> int:
        """Of two that touch: whoever moved; of two that did, the one behind, or who walks into a vehicle's side."""
        if not (moved[i] and moved[j]):
            return i if moved[i] else j
        one, other = self.agents[i], self.agents[j]
        if (one.member.person is None) != (other.member.person is None):
            car, walker = (one, other) if one.member.person is None else (other, one)
            across = (walker.y - car.y) * np.cos(car.yaw) - (walker.x - car.x) * np.sin(car.yaw)
            is_before_it = abs(across) < car.member.width / 2 + 0.15
            return i if (car is one) == is_before_it else j
        x, y = other.x - one.x, other.y - one.y
        ahead_of_one = x * np.cos(one.yaw) + y * np.sin(one.yaw)
        ahead_of_other = -x * np.cos(other.yaw) - y * np.sin(other.yaw)
        return i if ahead_of_one >= ahead_of_other else j

    def _accelerations(self) -> Floats:
        """What each does about those ahead, bends and signals, (N,) m/s^2; the intelligent driver model."""
        agents = self.agents
        speeds = np.array([agent.speed for agent in agents])
        paths = np.array([agent.path for agent in agents])
        along = np.array([agent.along for agent in agents])
        fronts = along + np.array([agent.member.length for agent in agents]) / 2
        wishes = np.minimum(np.array([agent.wish for agent in agents]), self._table.limits(paths, along + speeds * 0.5))
        pulls = np.array([agent.pull for agent in agents])
        on_foot = np.array([agent.member.person is not None for agent in agents])
        least, headway = np.where(on_foot, 0.5, _LEAST_GAP_M), np.where(on_foot, 0.4, _HEADWAY_S)

        def pressure(rows: NDArray[np.int64], gaps: Floats, closing: Floats) -> Floats:
            own = speeds[rows, None]
            brakes = 2 * np.sqrt(pulls[rows, None] * _BRAKING)
            wanted = least[rows, None] + np.maximum(0, own * headway[rows, None] + own * closing / brakes)
            strongest: Floats = ((wanted / np.maximum(gaps, 0.05)) ** 2).max(axis=1, initial=0.0)
            return strongest

        stops = np.minimum(self._gaps_to_stop_lines(fronts, speeds), self._gaps_to_cycleways(fronts))
        most = pressure(np.arange(len(agents)), stops[:, None], speeds[:, None])
        drivers, walkers = np.flatnonzero(~on_foot), np.flatnonzero(on_foot)
        if len(drivers):
            most[drivers] = np.maximum(most[drivers], pressure(drivers, *self._leaders(drivers, paths, along, fronts)))
        if len(walkers):
            ahead = along[walkers][None] - along[walkers][:, None]
            counts = (paths[walkers][:, None] == paths[walkers][None]) & (ahead > 1e-6)
            gaps = np.where(counts, ahead - 0.45, np.inf)
            closing = speeds[walkers][:, None] - speeds[walkers][None]
            most[walkers] = np.maximum(most[walkers], pressure(walkers, gaps, closing))
        ease = 1 - (speeds / np.maximum(wishes, 0.1)) ** 4
        limited: Floats = np.clip(pulls * (ease - most), -_HARDEST_BRAKING, pulls)
        return limited

    def _leaders(
        self, drivers: NDArray[np.int64], all_paths: NDArray[np.int64], all_along: Floats, all_fronts: Floats
    ) -> tuple[Floats, Floats]:
        """Gaps (D, D) from each driver to those in its way, and how fast they close."""
        agents = [self.agents[number] for number in drivers.tolist()]
        paths, along, fronts = all_paths[drivers], all_along[drivers], all_fronts[drivers]
        count = len(agents)
        lengths, widths = np.array([(agent.member.length, agent.member.width) for agent in agents]).T
        yaws, speeds, stuck_s = np.array([(agent.yaw, agent.speed, agent.stuck_s) for agent in agents]).T
        spots = along[:, None] + lengths[:, None] * np.array([-0.5, -0.17, 0.17, 0.5])
        index = np.clip(np.round(spots), 0, self._table.nearest_m.shape[2] - 1).astype(np.int64)
        mine, theirs = paths[:, None, None], paths[None, :, None]
        near = self._table.nearest_m[mine, theirs, index[None]] + np.where(mine == theirs, (spots - index)[None], 0.0)
        apart = self._table.apart_m[mine, theirs, index[None]]
        reach = (widths[:, None] + widths[None]) / 2 + _SIDE_GAP_M
        counts = (apart < reach[..., None]) & (near > fronts[:, None, None] - 0.2)
        gaps = np.where(counts, near, np.inf).min(axis=2) - fronts[:, None]
        turned = np.cos(yaws[:, None] - yaws[None])
        numbers = np.arange(count)
        is_ahead = np.isfinite(gaps)
        creeps = (stuck_s > _PATIENCE_S)[:, None] & is_ahead & is_ahead.T & (numbers[:, None] < numbers[None])
        gaps = np.where(creeps | np.eye(count, dtype=bool), np.inf, gaps)
        return gaps, speeds[:, None] - speeds[None] * np.maximum(turned, 0)

    def _gaps_to_stop_lines(self, fronts: Floats, speeds: Floats) -> Floats:
        states = {}
        gaps = np.full(len(fronts), np.inf)
        for number, agent in enumerate(self.agents):
            path = self._table.paths[agent.path]
            if path.signal < 0 or fronts[number] > path.stop_m + 0.3:
                continue
            if path.signal not in states:
                states[path.signal] = self.signals.state(path.signal, self.time_s)
            gap = path.stop_m + (0.3 if path.users == "foot" else 1.2) - float(fronts[number])
            can_stop = speeds[number] ** 2 / (2 * 3.5) < gap
            if (states[path.signal] == "red" and (can_stop or gap > 2)) or (
                states[path.signal] == "amber" and can_stop
            ):
                gaps[number] = max(gap, 0.05)
        return gaps

    def _gaps_to_cycleways(self, fronts: Floats) -> Floats:
        """For those about to turn across a cycleway on which somebody comes."""
        gaps = np.full(len(fronts), np.inf)
        riders = [
            (agent.path, agent.along) for agent in self.agents if self._table.paths[agent.path].users == "bicycle"
        ]
        for number, agent in enumerate(self.agents):
            for crossing in self._crossings.get(agent.path, ()):
                gap = crossing.begin_m - float(fronts[number])
                if gap > -0.5 and any(
                    path == crossing.cycleway and crossing.first_m - _YIELD_M < along < crossing.last_m + 1.5
                    for path, along in riders
                ):
                    gaps[number] = min(gaps[number], max(gap, 0.05))
        return gaps

    def _set_poses(self, agents: list[Agent]) -> None:
        """Middle and direction of each from its path under its two axles."""
        paths = np.array([agent.path for agent in agents])
        along = np.array([agent.along for agent in agents])
        base = np.array([max(0.4, 0.29 * agent.member.length) for agent in agents])
        ahead, behind = self._table.place(paths, along + base), self._table.place(paths, along - base)
        middles = (ahead + behind) / 2
        yaws = np.arctan2(ahead[:, 1] - behind[:, 1], ahead[:, 0] - behind[:, 0])
        for agent, (x, y), yaw in zip(agents, middles.tolist(), yaws.tolist(), strict=True):
            agent.x, agent.y, agent.yaw = x, y, yaw


@dataclass(frozen=True, slots=True)
class _Crossing:
    """Where a turning path crosses a cycleway: from where on the path on, and between which places of the cycleway."""

    cycleway: int
    begin_m: float
    first_m: float
    last_m: float


def _crossings(table: PathTable) -> dict[int, list[_Crossing]]:
    """By the turning path's number."""
    found: dict[int, list[_Crossing]] = {}
    for number, path in enumerate(table.paths):
        if path.users != "car" or path.turn != -1:
            continue
        for cycleway, other in enumerate(table.paths):
            if other.users != "bicycle" or other.signal != path.signal:
                continue
            places = np.arange(len(path.points))
            close = (table.apart_m[cycleway, number, : len(places)] < _CYCLEWAY_GAP_M) & (places > path.stop_m)
            if close.any():
                along = table.nearest_m[cycleway, number, : len(places)][close]
                begin = float(places[close][0]) - 0.5
                found.setdefault(number, []).append(_Crossing(cycleway, begin, float(along.min()), float(along.max())))
    return found


def _footprints(agents: list[Agent], margin_m: float) -> Floats:
    middles = np.array([(agent.x, agent.y) for agent in agents])
    lengths = np.array([agent.member.length for agent in agents]) + margin_m
    widths = np.array([agent.member.width for agent in agents]) + margin_m
    return corners_of(middles, np.array([agent.yaw for agent in agents]), lengths, widths)
