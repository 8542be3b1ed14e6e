"""The filters of many objects at once, against the textbook's matrices for one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lookonce.errors import ConfigError
from lookonce.tracking import MotionConfig, Tracker
from lookonce.tracking.motion import Motions, box_states
from tracking.moving import seen

CONFIG = MotionConfig()
UNBOUND = replace(CONFIG, new_speed=1e5, jump_speed=1e5)  # speeds that no bound touches
STILL = np.zeros(1, np.bool_)
ONE = np.zeros(1, np.intp)
EVEN = np.full(1, 0.5)  # the score of which noise is as stated


def _begin(x=100.0, y=50.0, height=40.0, config=CONFIG):
    return Motions.begin(_states(x, y, height), config)


def _states(x, y, height=40.0):
    return np.array([[x, y, np.log(height / 2), np.log(height)]])


def _matrix(motions, one=0):
    """(2, 2) covariance of place and velocity of one object."""
    place, both, velocity = (
        array[one] for array in (motions.place_variance, motions.covariance, motions.velocity_variance)
    )
    return np.array([[place, both], [both, velocity]])


def _least_eigenvalue(motions, one=0):
    """The smaller eigenvalue of the covariance, scaled to variances of 1: above 0 for a positive definite one."""
    matrix = _matrix(motions, one)
    scale = np.sqrt(np.abs(np.diag(matrix)))
    return np.linalg.eigvalsh(matrix / np.outer(scale, scale))[0] if (np.diag(matrix) > 0).all() else -1.0


class PlainFilter:
    """One coordinate after the textbook: state (place, velocity), matrices F, Q, H, R."""

    def __init__(self, place, height, config):
        self.config, self.height = config, height
        self.state = np.array([place, 0.0])
        self.covariance = np.diag([(config.place_noise * height) ** 2, (config.new_speed * height) ** 2])

    def predict(self, step_s, speed):
        """``speed`` is that of both coordinates together, on which the noise depends."""
        transition = np.array([[1.0, step_s], [0.0, 1.0]])
        density = (self.config.acceleration * self.height) ** 2 + (self.config.acceleration_share * speed) ** 2
        noise = density * np.array([[step_s**3 / 3, step_s**2 / 2], [step_s**2 / 2, step_s]])
        self.state = transition @ self.state
        self.covariance = transition @ self.covariance @ transition.T + noise

    def correct(self, place):
        looks_at = np.array([[1.0, 0.0]])
        error = np.array([[(self.config.place_noise * self.height) ** 2]])
        gain = self.covariance @ looks_at.T @ np.linalg.inv(looks_at @ self.covariance @ looks_at.T + error)
        self.state = self.state + gain @ (np.array([place]) - looks_at @ self.state)
        self.covariance = (np.eye(2) - gain @ looks_at) @ self.covariance


@pytest.mark.parametrize("seed", range(5))
def test_filter_is_the_textbooks(seed):
    rng = np.random.default_rng(seed)
    config = replace(UNBOUND, new_speed=20.0)
    motions = _begin(config=config)
    plain = [PlainFilter(100.0, 40.0, config), PlainFilter(50.0, 40.0, config)]
    for _ in range(40):
        step_s = float(rng.choice([0.04, 0.1, 1.0]))
        speed = float(np.hypot(*motions.velocity[0]))
        motions.predict_(step_s, STILL, replace(config, new_speed=1e5))
        for each in plain:
            each.predict(step_s, speed)
        if rng.random() < 0.7:
            x, y = motions.place[0] + rng.normal(0, 8, 2)
            motions.correct_(ONE, _states(x, y), EVEN, config)
            plain[0].correct(x)
            plain[1].correct(y)
        np.testing.assert_allclose(motions.place[0], [each.state[0] for each in plain], rtol=1e-7, atol=1e-7)
        np.testing.assert_allclose(motions.velocity[0], [each.state[1] for each in plain], rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(_matrix(motions), plain[0].covariance, rtol=1e-6)
        np.testing.assert_allclose(_matrix(motions), plain[1].covariance, rtol=1e-6)


def test_size_is_a_random_walk_of_its_logarithm():
    motions, config = _begin(), CONFIG
    motions.predict_(0.5, STILL, config)
    variance = min(config.size_noise**2 + config.size_drift**2 * 0.5, 0.25)
    assert motions.size_variance[0] == pytest.approx(variance)
    motions.correct_(ONE, _states(100, 50, 60), EVEN, config)
    gain = variance / (variance + config.size_noise**2)
    expected = np.log(40) + gain * (np.log(60) - np.log(40))
    assert motions.log_size[0, 1] == pytest.approx(expected)
    assert motions.size_variance[0] == pytest.approx(variance * (1 - gain))


@pytest.mark.parametrize("step_s", [0.04, 0.3, 2.0])
def test_two_steps_are_one_twice_as_long(step_s):
    """Of an object whose speed is believed to be 0, so that the noise stays the same."""
    once, twice = _begin(config=CONFIG), _begin(config=CONFIG)
    once.predict_(2 * step_s, STILL, UNBOUND)
    twice.predict_(step_s, STILL, UNBOUND)
    twice.predict_(step_s, STILL, UNBOUND)
    np.testing.assert_allclose(_matrix(once), _matrix(twice), rtol=1e-12)
    np.testing.assert_array_equal(once.place, twice.place)


def test_place_follows_the_velocity_and_what_is_unseen_slows_down():
    motions = _begin()
    motions.velocity[:] = [30.0, -10.0]
    motions.predict_(0.5, STILL, CONFIG)
    np.testing.assert_allclose(motions.place, [[115.0, 45.0]])
    np.testing.assert_array_equal(motions.velocity, [[30.0, -10.0]])
    for _ in range(400):
        motions.predict_(0.1, ~STILL, CONFIG)
    assert np.abs(motions.velocity).max() < 1e-3
    # Steps of a tenth of a second overestimate the way until it stands, velocity * slow_down_s, by little.
    assert motions.place[0, 0] == pytest.approx(115.0 + 30.0 * CONFIG.slow_down_s, rel=0.02)


def _random_life(motions, rng, steps, check):
    """Predictions, corrections and jumps of one object in any order; ``check`` after each."""
    for _ in range(steps):
        motions.predict_(float(rng.choice([0.001, 0.04, 0.1, 0.5, 1.0, 3.0])), rng.random(1) < 0.5, CONFIG)
        check(motions)
        if rng.random() < 0.2:
            motions.widen_(ONE, np.array([0.2]), motions.more_speed(rng.random(1) < 0.5, CONFIG))
            check(motions)
        if rng.random() < 0.5:
            x, y = motions.place[0] + rng.normal(0, 20, 2)
            before = rng.normal(0, 0.5, (2, 1))
            motions.correct_(ONE, _states(x, y, 40 * np.exp(rng.normal(0, 0.3))), EVEN, CONFIG, None, before)
            check(motions)


def test_covariances_stay_positive_definite():
    """The speed's variance was bounded and its covariance with the place was not: variances fell below 0."""
    rng = np.random.default_rng(0)

    def check(motions):
        assert _least_eigenvalue(motions) > 0
        assert 0 < motions.size_variance[0] <= 0.25 + 1e-12

    for _ in range(100):
        _random_life(_begin(), rng, 50, check)


@pytest.mark.parametrize(("step_s", "speed_px"), [(0.04, 25), (0.04, 50), (2.0, 5)])
def test_fast_object_and_slow_frames_leave_no_impossible_variance(step_s, speed_px):
    """A box of 40 px that moves 25 px a frame at 25 frames/s had a variance below 0, NaN gains, and was lost."""
    tracker, ids = Tracker(), []
    for number in range(30):
        looks = [[1, 0], [0, 1]]
        tracks = tracker.update(seen((50 + speed_px * number, 50), (2000, 50), looks=looks), number * step_s)
        ids.append(tracks.ids.tolist())
        motions = tracker._rule.objects.motions
        for one in range(len(motions.place)):
            assert _least_eigenvalue(motions, one) > 0
    assert ids[1:] == [[1, 2]] * 29


def test_speed_has_a_bound():
    """However long unseen: the speed's variance stays that of an object seen once."""
    motions = _begin()
    for _ in range(100):
        motions.predict_(1.0, ~STILL, CONFIG)
    assert motions.velocity_variance[0] == pytest.approx((CONFIG.new_speed * 40) ** 2)


def test_widened_is_what_a_fast_object_would_have_had_from_the_start():
    """Widening after the time since it was seen is the same as having begun with the larger speed."""
    fast, late = _begin(config=replace(CONFIG, new_speed=CONFIG.jump_speed)), _begin()
    plain = replace(UNBOUND, acceleration=0.0, acceleration_share=0.0)
    for motions in (fast, late):
        motions.predict_(0.2, STILL, plain)
    elapsed_s = np.array([0.2])
    more = late.more_speed(np.array([True]), CONFIG)
    assert (late.place_variance + more * elapsed_s**2)[0] == pytest.approx(fast.place_variance[0])
    late.widen_(ONE, elapsed_s, more)
    np.testing.assert_allclose(_matrix(late), _matrix(fast))


def test_surprises_the_same_way_widen_the_filter_and_others_do_not():
    """Half a box to the right twice: the velocity follows as in a filter whose covariances are that much larger."""

    def corrected(before, lag=1.0, widened=1.0, shares=None):
        motions, config = _begin(), replace(CONFIG, lag=lag, doubt=0.0)
        motions.predict_(0.1, STILL, config)
        for row in (6, 8, 10):
            motions.values[row] *= widened
        was = motions.values[6, 0]
        motions.correct_(ONE, _states(100 + 20, 50, 40.0), EVEN, config, shares, before)
        return motions.values, was

    plain, variance = corrected(None)
    for before in ([[-0.5], [0.0]], [[0.0], [0.5]], [[0.05], [0.0]], [[np.inf], [np.inf]]):
        np.testing.assert_array_equal(corrected(np.array(before))[0], plain)
    same_way = np.array([[0.5], [0.0]])
    np.testing.assert_array_equal(corrected(same_way, lag=1e6)[0], plain)
    total = variance + (CONFIG.place_noise * 40) ** 2
    excess = 0.5 * 20.0 * 20.0 - total
    assert excess > 0
    expected, _ = corrected(None, widened=1 + excess / variance)
    np.testing.assert_allclose(corrected(same_way)[0], expected, rtol=1e-12)
    expected, _ = corrected(None, widened=1 + 0.25 * excess / variance)
    np.testing.assert_allclose(corrected(same_way, shares=np.full(1, 0.25))[0], expected, rtol=1e-12)


def test_camera_moves_places_speeds_and_sizes():
    motions = _begin()
    motions.velocity[:] = [10.0, 0.0]
    turn = np.array([[0.0, -2.0, 5.0], [2.0, 0.0, -3.0]])  # a quarter turn, twice as large, then 5 right and 3 up
    motions.move_camera_(turn)
    np.testing.assert_allclose(motions.place, [[-2 * 50 + 5, 2 * 100 - 3]])
    np.testing.assert_allclose(motions.velocity, [[0.0, 20.0]])
    np.testing.assert_allclose(np.exp(motions.log_size), [[40.0, 80.0]])


def test_a_zoom_of_the_camera_is_a_life_in_a_larger_picture():
    """Variances kept the size that they had before the zoom: a box twice as large was believed twice as precisely."""
    zoom = np.array([[1.2, -0.9, 30.0], [0.9, 1.2, -20.0]])  # lengths 1.5 times as large
    zoomed, large = _begin(), _begin(1.2 * 100 - 0.9 * 50 + 30, 0.9 * 100 + 1.2 * 50 - 20, 60.0)
    zoomed.predict_(0.2, STILL, CONFIG)
    zoomed.move_camera_(zoom)
    large.predict_(0.2, STILL, CONFIG)
    for _ in range(3):
        np.testing.assert_allclose(_matrix(zoomed), _matrix(large), rtol=1e-12)
        np.testing.assert_allclose(zoomed.place, large.place, rtol=1e-12)
        for motions in (zoomed, large):
            motions.correct_(ONE, _states(140, 131, 63.0), EVEN, CONFIG)
            motions.predict_(0.1, STILL, CONFIG)


def test_objects_do_not_meet():
    """Each of many objects has the numbers that it has alone."""
    rng = np.random.default_rng(3)
    boxes = rng.uniform(0, 500, (9, 2))
    states = box_states(np.concatenate([boxes, boxes + rng.uniform(10, 60, (9, 2))], axis=1).astype(np.float32))
    moved = states + rng.normal(0, 0.1, states.shape)
    together = Motions.begin(states, CONFIG)
    together.predict_(0.1, np.zeros(9, np.bool_), CONFIG)
    together.correct_(np.arange(9), moved, np.full(9, 0.5), CONFIG)
    for one in range(9):
        alone = Motions.begin(states[one : one + 1], CONFIG)
        alone.predict_(0.1, STILL, CONFIG)
        alone.correct_(ONE, moved[one : one + 1], EVEN, CONFIG)
        np.testing.assert_allclose(together.place[one], alone.place[0], rtol=1e-14)
        np.testing.assert_allclose(together.boxes()[one], alone.boxes()[0], rtol=1e-14)
        np.testing.assert_allclose(_matrix(together, one), _matrix(alone), rtol=1e-14)


def test_no_objects():
    motions = Motions.begin(np.zeros((0, 4)), CONFIG)
    motions.predict_(1.0, np.zeros(0, np.bool_), CONFIG)
    motions.correct_(np.zeros(0, np.intp), np.zeros((0, 4)), np.zeros(0), CONFIG)
    motions.move_camera_(np.eye(2, 3))
    assert motions.boxes().shape == (0, 4)


def test_boxes_are_those_of_the_states():
    xyxy = np.array([[10, 20, 30, 60], [-5, -5, 5, 100.5]], np.float32)
    np.testing.assert_allclose(Motions.begin(box_states(xyxy), CONFIG).boxes(), xyxy, atol=1e-12)


def test_impossible_settings_are_refused():
    bad = [("place_noise", 0.0), ("slow_down_s", 0.0), ("new_speed", -1.0), ("jump_speed", float("nan"))]
    for name, value in [*bad, ("jump_share", 1.5), ("turn_share", 2.0)]:
        with pytest.raises(ConfigError, match=name):
            MotionConfig(**{name: value})


def _watch(growth, config=CONFIG, frames=25, step_s=0.1, noise=0.0, speed=1.2):
    """The filter of an object that comes nearer at a steady speed: depth 10 m at first, ``growth`` of it a second."""
    rng = np.random.default_rng(2)

    def box(number):
        depth = 10.0 * (1 - growth * step_s * number)
        place = 1000 * np.array([0.5 + speed * step_s * number, 1.0]) / depth
        return (*place, 400 / depth * np.exp(rng.normal(0, noise)))

    motions = Motions.begin(_states(*box(0)), config)
    for number in range(1, frames):
        motions.predict_(step_s, STILL, config)
        motions.correct_(ONE, _states(*box(number)), EVEN, config)
    motions.predict_(step_s, STILL, config)
    return motions, np.array(box(frames))


@pytest.mark.parametrize("growth", [0.2, 0.3])
def test_what_comes_nearer_speeds_up(growth):
    """A constant speed in space; without growth the expected place lags behind."""
    grown, true = _watch(growth)
    plain, _ = _watch(growth, replace(CONFIG, growth=0.0, growth_drift=0.0))
    off, plainly_off = (np.linalg.norm(one.place[0] - true[:2]) for one in (grown, plain))
    assert off < 0.6 * plainly_off
    assert abs(grown.log_size[0, 1] - np.log(true[2])) < abs(plain.log_size[0, 1] - np.log(true[2]))
    depth_left = 1 - growth * 0.1 * 25
    assert growth < grown.growth[0] < growth / depth_left  # it rises all the time, and the filter follows


def test_growth_that_may_be_noise_is_not_believed():
    """Boxes of a trembling detector: places are as if there were no growth at all."""
    trembling, _ = _watch(0.0, noise=0.2)
    still, _ = _watch(0.0)
    np.testing.assert_allclose(trembling.place, still.place, atol=0.01)
    assert trembling.growth[0] != 0


def test_a_step_of_growth():
    """Way v dt / (1 - g dt), size 1 / (1 - g dt), speed its square."""
    motions = _begin()
    motions.velocity[:], motions.growth[:], motions.growth_variance[:] = [10.0, 0.0], 0.2, 0.0
    motions.predict_(1.0, STILL, replace(CONFIG, growth_drift=0.0))
    np.testing.assert_allclose(motions.place, [[100 + 10 / 0.8, 50]])
    np.testing.assert_allclose(motions.velocity, [[10 / 0.8**2, 0]])
    np.testing.assert_allclose(np.exp(motions.log_size), [[20 / 0.8, 40 / 0.8]])


@pytest.mark.parametrize("growth", [3.0, -3.0])
def test_growth_is_bounded_in_a_step(growth):
    motions = _begin()
    motions.velocity[:], motions.growth[:], motions.growth_variance[:] = [10.0, 0.0], growth, 0.0
    motions.predict_(5.0, STILL, replace(CONFIG, growth_drift=0.0))
    factor = 2.0 if growth > 0 else 1 / 1.5
    np.testing.assert_allclose(motions.place, [[100 + 50 * factor, 50]])


@pytest.mark.parametrize(("score", "factor"), [(0.0, 1.3), (0.5, 1.0), (1.0, 0.7), (80.0, 0.7)])
def test_weak_boxes_err_more(score, factor):
    """As with noise that is as much larger; a score above 1 is one of 1."""
    config = replace(CONFIG, score_noise=0.6)
    scored, stated = _begin(), _begin()
    larger = {name: factor * getattr(CONFIG, name) for name in ("place_noise", "size_noise", "growth_noise")}
    for motions in (scored, stated):
        motions.predict_(0.1, STILL, config)
    scored.correct_(ONE, _states(110, 40, 50), np.full(1, score), config)
    stated.correct_(ONE, _states(110, 40, 50), EVEN, replace(config, **larger))
    np.testing.assert_allclose(scored.values, stated.values, rtol=1e-12)


def test_a_wide_box_moves_as_a_tall_one():
    """Noise goes by the longer side, whichever it is."""
    tall, wide = (Motions.begin(np.array([[0, 0, *np.log(size)]]), CONFIG) for size in ((20, 40), (40, 20)))
    for motions, size in ((tall, (20, 40)), (wide, (40, 20))):
        motions.predict_(0.3, STILL, CONFIG)
        motions.correct_(ONE, np.array([[5, 3, *np.log(size)]]), EVEN, CONFIG)
        motions.predict_(2.0, ~STILL, CONFIG)
        motions.widen_(ONE, np.full(1, 0.5), motions.more_speed(np.array([True]), CONFIG))
    places = [0, 1, *range(4, 15)]
    np.testing.assert_array_equal(tall.values[places], wide.values[places])
    for is_new in (np.array([True]), np.array([False])):
        np.testing.assert_array_equal(tall.more_speed(is_new, CONFIG), wide.more_speed(is_new, CONFIG))


@pytest.mark.parametrize(("share", "factor"), [(1.0, 1.0), (0.5, 4.0), (0.25, 16.0)])
def test_boxes_that_may_be_of_others_are_trusted_less(share, factor):
    """As with noise that is as much larger."""
    doubtful, stated = _begin(), _begin()
    larger = {name: factor * getattr(CONFIG, name) for name in ("place_noise", "size_noise", "growth_noise")}
    for motions in (doubtful, stated):
        motions.predict_(0.1, STILL, CONFIG)
    doubtful.correct_(ONE, _states(110, 40, 50), EVEN, replace(CONFIG, doubt=2.0), np.array([share]))
    stated.correct_(ONE, _states(110, 40, 50), EVEN, replace(CONFIG, **larger))
    np.testing.assert_allclose(doubtful.values, stated.values, rtol=1e-12)


def test_doubt_has_a_bound():
    with pytest.raises(ConfigError, match="doubt=21: expected at most 20"):
        MotionConfig(doubt=21)


@pytest.mark.parametrize("name", ["place_noise", "size_noise", "growth_noise"])
def test_noise_that_is_lost_in_rounding_is_refused(name):
    with pytest.raises(ConfigError, match=f"{name}=1e-170: expected at least 1e-06"):
        MotionConfig(**{name: 1e-170})


def test_noise_of_scores_has_a_bound():
    with pytest.raises(ConfigError, match="score_noise=2: expected below 2"):
        MotionConfig(score_noise=2)
