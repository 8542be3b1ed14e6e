"""Work done ahead of its consumer, in one background thread."""

from __future__ import annotations

import threading
import weakref
from collections import deque
from collections.abc import Iterable, Iterator
from types import TracebackType
from typing import Generic, Self, TypeVar

__all__ = ["Prefetcher", "prefetch"]

T = TypeVar("T")


def prefetch(items: Iterable[T], depth: int = 4) -> Prefetcher[T]:
    """Runs ``items`` in a background thread, at most ``depth`` items ahead of the consumer.

    >>> with prefetch(n * n for n in range(4)) as squares:
    ...     list(squares)
    [0, 1, 4, 9]

    Args:
        items: iterated, and closed if it is a generator, in the background thread.
        depth: how many finished items may wait, >= 1.
    """
    if depth < 1:
        raise ValueError(f"depth: expected >= 1, got {depth}")
    return Prefetcher(items, depth)


class Prefetcher(Generic[T]):
    """The consumer's end: an iterator that gives the items in order, then raises what stopped them, if anything did.

    The thread ends, and is waited for, when the items end, at ``close``, when a ``with`` block is left, or when nobody
    refers to this object any more (a loop that was left early).
    """

    def __init__(self, items: Iterable[T], depth: int) -> None:
        self._belt: _Belt[T] = _Belt(depth)
        # The thread knows the belt only: were it to know this object, that would never be collected.
        thread = threading.Thread(target=_produce, args=(items, self._belt), name="prefetch", daemon=True)
        self._stop = weakref.finalize(self, _stop, self._belt, thread)
        thread.start()

    def __iter__(self) -> Iterator[T]:
        return self

    def __next__(self) -> T:
        return self._belt.take()

    def close(self) -> None:
        """Stops the thread after the item that it is making and waits for it; closing twice is harmless."""
        self._stop()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class _Belt(Generic[T]):
    """A bounded queue that either end can shut down; all waiting is done on its condition."""

    def __init__(self, depth: int) -> None:
        self._depth = depth
        self._ready: deque[T] = deque()
        self._changed = threading.Condition()
        self._finished = self._abandoned = False
        self._error: BaseException | None = None

    def put(self, item: T) -> bool:
        """Waits for room and adds ``item``; False if the consumer has gone."""
        with self._changed:
            self._changed.wait_for(lambda: self._abandoned or len(self._ready) < self._depth)
            if not self._abandoned:
                self._ready.append(item)
                self._changed.notify_all()
            return not self._abandoned

    def finish(self, error: BaseException | None) -> None:
        """Says that no more items come, and why."""
        with self._changed:
            self._finished, self._error = True, error
            self._changed.notify_all()

    def take(self) -> T:
        """Waits for the next item; raises the producer's error once, ``StopIteration`` from then on."""
        with self._changed:
            self._changed.wait_for(lambda: self._ready or self._finished or self._abandoned)
            if self._ready:
                self._changed.notify_all()
                return self._ready.popleft()
            error, self._error = self._error, None
        if error is not None:
            raise error
        raise StopIteration

    def abandon(self) -> None:
        """Says that nobody will take items any more."""
        with self._changed:
            self._abandoned = True
            self._ready.clear()
            self._error = None
            self._changed.notify_all()


def _produce(items: Iterable[T], belt: _Belt[T]) -> None:
    try:
        _feed(items, belt)
    except BaseException as exc:  # noqa: BLE001 - not swallowed: the consumer raises it
        belt.finish(exc)
    else:
        belt.finish(None)


def _feed(items: Iterable[T], belt: _Belt[T]) -> None:
    iterator = iter(items)
    try:
        for item in iterator:
            if not belt.put(item):
                return
    finally:
        close = getattr(iterator, "close", None)
        if close is not None:
            close()


def _stop(belt: _Belt[T], thread: threading.Thread) -> None:
    belt.abandon()
    if thread is not threading.current_thread():  # collected by chance in the thread itself: it cannot wait for itself
        thread.join()
