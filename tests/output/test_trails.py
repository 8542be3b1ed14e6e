import numpy as np
import pytest

from lookonce.output import NO_TRAILS, TrailMemory, Trails
from lookonce.output.colours import track_colour
from lookonce.output.trails import TrailBrush
from output.scenes import grey, make_tracks


def _box(left: float, top: float = 10) -> list[float]:
    return [left, top, left + 10, top + 20]


def _line(*points, identity: int = 1) -> Trails:
    freshness = np.linspace(0, 1, len(points), dtype=np.float32)
    return Trails(np.full(len(points), identity), np.array(points, np.float32), freshness)


def test_trail_is_the_path_of_the_bottom_centre():
    memory = TrailMemory(2.0)
    memory.update(make_tracks([3], [_box(0)]), 0.0)
    trails = memory.update(make_tracks([3], [_box(4)]), 1.0)
    assert trails.ids.tolist() == [3, 3]
    assert trails.points.tolist() == [[5, 30], [9, 30]]
    assert trails.freshness.tolist() == [0.5, 1]


def test_points_older_than_the_duration_are_dropped():
    memory = TrailMemory(1.5)
    for time_s in (0.0, 1.0, 2.0):
        trails = memory.update(make_tracks([1], [_box(time_s)]), time_s)
    assert trails.points[:, 0].tolist() == [6, 7]


@pytest.mark.parametrize(
    "tracks",
    [
        pytest.param(make_tracks([-1], [_box(0)]), id="no identity"),
        pytest.param(make_tracks([1], [[0, np.nan, 5, 5]]), id="not finite"),
        pytest.param(make_tracks(), id="no rows"),
    ],
)
def test_rows_without_a_place_leave_no_trail(tracks):
    assert len(TrailMemory(1.0).update(tracks, 0.0).ids) == 0


@pytest.mark.parametrize("step_s", [pytest.param(0.04, id="clock runs"), pytest.param(0.0, id="clock stands still")])
def test_memory_is_bounded_over_10000_frames_with_ever_new_ids(step_s):
    memory = TrailMemory(1.5)
    for index in range(10_000):
        trails = memory.update(make_tracks([2 * index + 1, 2 * index + 2], [_box(0), _box(9)]), index * step_s)
    assert len(memory) == len(trails.ids) <= 2 * 66


def test_trail_length_does_not_depend_on_the_frame_rate():
    memory = TrailMemory(1.5)
    for index in range(1000):
        trails = memory.update(make_tracks([1], [_box(index)]), index / 240)
    assert trails.points[-1, 0] == 999 + 5
    assert trails.points[0, 0] == pytest.approx(999 + 5 - 1.5 * 240, abs=8)


def test_source_that_begins_again_begins_new_trails():
    memory = TrailMemory(1.5)
    memory.update(make_tracks([1], [_box(50)]), 9.0)
    assert len(memory.update(make_tracks([1], [_box(0)]), 0.0).ids) == 1


@pytest.mark.parametrize("duration_s", [0, -1, float("nan")])
def test_duration_must_be_above_zero(duration_s):
    with pytest.raises(ValueError, match="duration_s"):
        TrailMemory(duration_s)


def test_trail_fades_and_thins_towards_its_end():
    image = grey(40, 100)
    TrailBrush().paint_(image, _line((10, 20), (90, 20)), width_px=5)
    changed = (image != 100).any(axis=2).sum(axis=0)
    assert changed[85] > changed[30] > 0
    colour = np.array(track_colour(1))
    strength = np.abs(image[20].astype(int) - 100).sum(axis=1)
    assert strength[85] > 1.5 * strength[40]
    assert np.abs(image[20, 88].astype(int) - colour).max() < 30
    assert (image[:15] == 100).all()


def test_trails_of_two_ids_are_not_joined():
    image = grey()
    two = Trails(np.array([1, 2]), np.array([[5, 30], [70, 30]], np.float32), np.ones(2, np.float32))
    TrailBrush().paint_(image, two, width_px=3)
    assert (image == 100).all()


@pytest.mark.parametrize(
    "trails",
    [
        pytest.param(NO_TRAILS, id="none"),
        pytest.param(_line((5, 5), (5, 5), (5, 5)), id="standing"),
        pytest.param(_line((-500, -500), (-400, -600)), id="outside"),
        pytest.param(_line((-1e30, 1e30), (3e38, -3e38)), id="far away"),
        pytest.param(_line((-20, 30), (100, 30)), id="through the picture"),
        pytest.param(_line((0, 0), (80, 60)), id="corner to corner"),
    ],
)
def test_any_path_can_be_painted(trails):
    TrailBrush().paint_(grey(), trails, width_px=3)


def test_trail_that_leaves_the_picture_does_not_enter_on_the_other_side():
    image = grey()
    TrailBrush().paint_(image, _line((70, 30), (90, 30)), width_px=3)
    assert (image[:, :60] == 100).all()
    assert (image[29:31, 79] != 100).any()


def test_brush_keeps_nothing_of_the_picture_before():
    brush = TrailBrush()
    brush.paint_(grey(), _line((5, 30), (70, 30)), width_px=5)
    again, fresh = grey(), grey()
    brush.paint_(again, _line((5, 20), (70, 40), identity=2), width_px=3)
    TrailBrush().paint_(fresh, _line((5, 20), (70, 40), identity=2), width_px=3)
    assert np.array_equal(again, fresh)


def test_crossing_trails_take_the_fresher_one_whatever_their_order():
    old, new = _line((5, 30), (75, 30)), _line((40, 58), (40, 20), identity=2)
    pictures = []
    for parts in ((old, new), (new, old)):
        both = Trails(*(np.concatenate([getattr(part, name) for part in parts]) for name in Trails.__slots__))
        pictures.append(grey())
        TrailBrush().paint_(pictures[-1], both, width_px=3)
    assert np.array_equal(*pictures)
