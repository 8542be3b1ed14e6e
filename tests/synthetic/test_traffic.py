from __future__ import annotations

import numpy as np
import pytest

from lookonce.synthetic.fleet import Fleet
from lookonce.synthetic.footprints import corners_of, overlapping
from lookonce.synthetic.highway import make_highway
from lookonce.synthetic.junction import make_junction
from lookonce.synthetic.site import Phase, Site
from lookonce.synthetic.stage import Streams
from lookonce.synthetic.traffic import Signals, Traffic

SITES = {
    "junction": lambda rng: make_junction(rng, arms=4),
    "tee": lambda rng: make_junction(rng, arms=3),
    "highway": make_highway,
}


def make_traffic(place: str, seed: int, density: float = 1.5) -> tuple[Site, Traffic]:
    streams = Streams.of(seed)
    site = SITES[place](streams.site)
    return site, Traffic(site, Fleet(streams.fleet, 0.3), streams.traffic, density)


def vehicle_overlaps(traffic: Traffic) -> int:
    vehicles = [agent for agent in traffic.agents if agent.member.person is None]
    if not vehicles:
        return 0
    rows = np.array([(one.x, one.y, one.yaw, one.member.length, one.member.width) for one in vehicles])
    return len(overlapping(corners_of(rows[:, :2], rows[:, 2], rows[:, 3], rows[:, 4]))[0])


@pytest.mark.parametrize("place", SITES)
@pytest.mark.parametrize("seed", [0, 1])
def test_vehicles_never_interpenetrate_and_nobody_is_stuck_for_ever(place, seed):
    _, traffic = make_traffic(place, seed)
    longest_s = 0.0
    for _ in range(400):
        traffic.advance(0.1)
        assert vehicle_overlaps(traffic) == 0
        longest_s = max([longest_s, *(one.stuck_s for one in traffic.agents if one.member.person is None)])
    assert longest_s < (45 if place == "highway" else 110)  # a round of the signals


def test_one_that_changes_lanes_is_let_out():
    """A lorry beside a car that had stopped behind its nose once blocked two lanes for ever."""
    _, traffic = make_traffic("highway", 1, density=1.0)
    traffic.advance(70)
    for _ in range(300):
        traffic.advance(0.1)
    assert max(agent.stuck_s for agent in traffic.agents) < 20


@pytest.mark.parametrize("place", SITES)
def test_steps_are_no_longer_than_speed_allows_and_identities_are_new(place):
    _, traffic = make_traffic(place, 3)
    known: set[int] = set()
    alive: dict[int, tuple[float, float, float]] = {}
    for _ in range(100):
        traffic.advance(0.1)
        now = {agent.identity: (agent.x, agent.y, agent.speed) for agent in traffic.agents}
        assert len(now) == len(traffic.agents)
        assert not (now.keys() - alive.keys()) & known
        for identity in now.keys() & alive.keys():
            x, y, speed = alive[identity]
            moved = np.hypot(now[identity][0] - x, now[identity][1] - y)
            assert moved < 0.1 * max(speed, now[identity][2]) * 1.3 + 0.25
        known |= now.keys()
        alive = now


def test_vehicles_queue_at_red():
    site, traffic = make_traffic("junction", 1, density=2.0)
    traffic.advance(30)
    queued = 0
    for agent in traffic.agents:
        path = site.paths[agent.path]
        is_red = path.signal >= 0 and traffic.signals.state(path.signal, traffic.time_s) == "red"
        if agent.member.person is None and is_red and agent.speed < 0.3:
            queued += agent.along + agent.member.length / 2 < path.stop_m + 1.3
    assert queued > 3


def test_signals_turn_through_green_and_amber_to_red():
    signals = Signals((Phase(10.0, (0,)), Phase(2.0, ()), Phase(8.0, (1,))))
    assert [signals.state(0, time) for time in (0.0, 6.9, 7.1, 9.9, 10.1, 15.0, 20.0)] == [
        "green",
        "green",
        "amber",
        "amber",
        "red",
        "red",
        "green",
    ]
    assert signals.state(1, 13.0) == "green"
    assert Signals(()).state(5, 3.0) == "green"
