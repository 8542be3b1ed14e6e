"""Work ahead of its consumer."""

from __future__ import annotations

import gc
import threading

import pytest

from lookonce.video import open_video, prefetch
from video.clips import numbers_in, write_clip


@pytest.fixture(autouse=True)
def no_thread_is_left():
    before = set(threading.enumerate())
    yield
    gc.collect()
    assert set(threading.enumerate()) <= before


def test_items_come_in_order():
    assert list(prefetch(range(100), depth=3)) == list(range(100))
    assert list(prefetch([])) == []


def test_frames_of_a_video_come_in_order(tmp_path):
    with open_video(write_clip(tmp_path / "clip.mp4", 20)) as source:
        assert numbers_in(prefetch(source)) == list(range(20))


def test_producer_works_ahead_no_further_than_its_depth():
    made, third = [], threading.Event()

    def items():
        for i in range(10):
            made.append(i)
            if i == 2:
                third.set()
            yield i

    with prefetch(items(), depth=2) as ahead:
        assert third.wait(5)  # two wait, the third is made and has no room
        assert made == [0, 1, 2]
        assert list(ahead) == list(range(10))


def test_error_comes_after_the_items_before_it_and_once():
    def items():
        yield 1
        yield 2
        raise KeyError("broken")

    ahead = prefetch(items())
    assert (next(ahead), next(ahead)) == (1, 2)
    with pytest.raises(KeyError, match="broken"):
        next(ahead)
    assert list(ahead) == []


def test_generator_is_closed_in_the_thread_that_ran_it():
    closed_in = []

    def items():
        try:
            while True:
                yield threading.current_thread()
        finally:
            closed_in.append(threading.current_thread())

    with prefetch(items()) as ahead:
        producer = next(ahead)
    assert closed_in == [producer]
    assert producer is not threading.current_thread()
    assert not producer.is_alive()
    ahead.close()
    assert list(ahead) == []


def test_leaving_the_loop_early_stops_the_thread():
    closed = threading.Event()

    def items():
        try:
            yield from range(1000)
        finally:
            closed.set()

    for item in prefetch(items()):
        if item == 5:
            break
    gc.collect()
    assert closed.is_set()


def test_interrupt_in_the_consumer_leaves_no_thread():
    def consume():
        with prefetch(iter(range(1000))) as ahead:
            next(ahead)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        consume()


def test_depth_below_one_is_refused():
    with pytest.raises(ValueError, match="depth"):
        prefetch([], depth=0)
