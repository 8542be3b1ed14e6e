"""Preset ``default``: motion and appearance together, objects kept through gaps, time in seconds.

Every pair of an object and a detection has a gain: the logarithm of how much likelier it is that the detection is this
object than that it is another one. Its terms are those of multiple hypothesis tracking (Blackman, "Multiple hypothesis
tracking for multiple target tracking", 2004): a place under the object's Kalman filter against objects anywhere at a
stated density, the size, the class, and the descriptor's distance. After a short time the place says nearly everything;
after a gap, or with few frames a second, the filter is wide and the descriptor decides. Only pairs of positive gain can
be taken, and of each frame the choice with the largest sum is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lookonce.distances import quantize
from lookonce.stories import Ended
from lookonce.structures import NO_ID, Detections, GivenBack, Tracks
from lookonce.tracking.candidates import Frame, Pairs, find_pairs
from lookonce.tracking.components import assign_best
from lookonce.tracking.default_config import DefaultConfig
from lookonce.tracking.explaining import Notes, tell
from lookonce.tracking.looks import Looks
from lookonce.tracking.motion import box_states
from lookonce.tracking.objects import MovingScores, Objects
from lookonce.tracking.overlapping import Overlaps, keep_best, overlaps_of, thinned
from lookonce.tracking.pairs import TooManyPairsError
from lookonce.tracking.waiting import Waiting, WaitingRow

__all__ = ["DefaultRule"]

_LEAST_STEP_S = 1e-3
_BORDERS = 10  # objects: where so many have been says where the picture ends
_MOST_PAIRS = 4_000_000  # of boxes near each other in a frame; crowds of 10,000 have a twentieth
_TOUCHING = 0.1  # overlap from which a second candidate makes a pair ambiguous


class DefaultRule:
    """The association of the presets ``default`` and ``iou``; one stream, ids from 1."""

    def __init__(self, config: DefaultConfig, explains: bool = False) -> None:
        self.config = config
        self.objects = _nobody(config)
        self.looks = Looks(config.views, config.view_apart, config.view_interval_s)
        self.waiting = Waiting(config.given_back_rows)
        self.next_id = 1
        self.next_serial = 0
        self.frame = -1
        self.now_s = 0.0
        self.given_s = 0.0  # the last time as it was given,
        self.offset_s = 0.0  # and how far the clock here is ahead of those given
        self.extent = np.array([np.inf, np.inf, -np.inf, -np.inf])
        self.moving = MovingScores()
        self.clock_faults = 0
        self.explains = explains
        self._numbers: NDArray[np.int64] | None = None
        self._frame_number = 0
        self._recent = np.zeros(0, np.bool_)  # objects that were seen lately
        self._ended: list[Ended] = []

    def update(
        self,
        detections: Detections,
        time_s: float | None = None,
        camera: NDArray[np.float64] | None = None,
        size: tuple[int, int] | None = None,
        numbers: NDArray[np.int64] | None = None,
        frame_number: int | None = None,
    ) -> Tracks:
        """Identities for the rows of one frame.

        Args:
            detections: N rows.
            time_s: on any clock that goes forward; a time that does not counts as a millisecond later. None: as if
                the frames came at the configured rate.
            camera: (2, 3) affine, how the picture moved since the frame before, px; None: it did not.
            size: (height, width) of the picture, px; None: its border is where boxes were, after ten objects.
            numbers: (N,) what rows that are given back later are called; by default their places.
            frame_number: and their frame; by default the number of this update, from 0.

        Raises:
            ValueError: descriptors of another length than before.
        """
        self._ended.clear()
        step_s = self._advance(time_s)
        self._numbers, self._frame_number = numbers, self.frame if frame_number is None else frame_number
        self._predict(step_s, camera)
        frame = self._look_at(detections)
        pairs = find_pairs(self.objects, frame, self.now_s, self.config)
        is_known = self.objects.ids != NO_ID
        is_recent = self._recent = self.now_s - self.objects.seen_s <= 1.01 * step_s + self.config.recent_s
        self._match(frame, pairs, is_known, frame.is_high, np.zeros(len(pairs.rows), np.bool_))
        is_weak_far = pairs.overlap < self.config.low_overlap
        self._match(frame, pairs, is_known & is_recent, frame.is_usable, is_weak_far)
        is_weak_far &= ~frame.is_high[pairs.rows]
        self._match(frame, pairs, ~is_known, frame.is_usable, is_weak_far)
        is_clean = self._clean_rows(frame, pairs)
        notes = self._note(frame, pairs, step_s) if self.explains else None
        given_back = self._see(frame, is_clean, detections)
        ids, labels = self._answer(frame)
        self._end(step_s, size)
        is_new = self._begin(frame, is_clean, detections)
        unseen = np.flatnonzero((self.objects.ids != NO_ID) & (self.objects.seen_s < self.now_s))
        unseen_boxes = self.objects.motions.boxes(unseen).astype(np.float32)
        return Tracks(
            ids,
            detections.xyxy,
            detections.scores,
            labels,
            self.objects.ids[unseen],
            unseen_boxes,
            given_back=given_back,
            story=None if notes is None else tell(notes, ids, is_new, tuple(self._ended), self.config),
        )

    def _note(self, frame: Frame, pairs: Pairs, step_s: float) -> Notes:
        """What the story of the frame needs, before anything changes."""
        gains = pairs.gains.copy()
        if frame.looks is not None:
            unknown = np.flatnonzero(np.isnan(pairs.distance))
            slots = self.objects.slots[pairs.objects[unknown]]
            pairs.distance[unknown] = self.looks.distances(slots, frame.looks, pairs.rows[unknown])
            gains += self._likeness(pairs.distance)
        objects = self.objects
        return Notes(frame, pairs, gains, objects.ids.copy(), objects.serials, self.now_s - objects.seen_s, step_s)

    def _likeness(self, distance: NDArray[np.float64]) -> NDArray[np.float64]:
        """What distances of descriptors add to the gains; nothing where there is none."""
        limit = self.config.appearance_limit
        likeness = np.clip(self.config.appearance_weight * (self.config.match_threshold - distance), -limit, limit)
        return np.where(np.isinf(distance), 0.0, likeness)

    def _advance(self, time_s: float | None) -> float:
        """Seconds since the frame before."""
        self.frame += 1
        if self.frame == 0:
            self.now_s = self.given_s = 0.0 if time_s is None else time_s
            return 0.0
        step_s = 1.0 / self.config.frame_rate if time_s is None else time_s + self.offset_s - self.now_s
        if step_s < _LEAST_STEP_S:
            self.clock_faults += 1
            # Twice in a row on an earlier clock that goes forward: it was set back, and goes on from there.
            step_s = _LEAST_STEP_S
            if time_s is not None and time_s - self.given_s >= _LEAST_STEP_S:
                step_s = time_s - self.given_s
                self.offset_s = self.now_s - self.given_s
        self.now_s += step_s
        self.given_s = self.now_s if time_s is None else time_s
        return step_s

    def _predict(self, step_s: float, camera: NDArray[np.float64] | None) -> None:
        """Where the objects are now; those that a gap outlived are gone."""
        unseen_s = self.now_s - self.objects.seen_s
        gone = unseen_s > self.config.memory_s
        if gone.any():
            nothing = f"nothing came for {step_s:.1f} s"
            reasons = [
                nothing if step_s > self.config.memory_s else f"not seen for {unseen:.1f} s" for unseen in unseen_s
            ]
            self._note_ends(gone, reasons)
            self._forget(gone)
        objects = self.objects
        is_unseen = objects.seen_s < self.now_s - step_s - _LEAST_STEP_S / 2
        objects.motions.predict_(step_s, is_unseen, self.config.motion)
        if camera is not None:
            objects.motions.move_camera_(camera)
            objects.anchor = objects.anchor @ camera[:, :2].T + camera[:, 2]

    def _look_at(self, detections: Detections) -> Frame:
        config = self.config
        scores, xyxy = detections.scores.astype(np.float64), detections.xyxy.astype(np.float64)
        looks = None
        if config.appearance and detections.descriptors is not None and detections.descriptors.shape[1]:
            self.looks.check_size(detections.descriptors.shape[1])
            looks = quantize(detections.descriptors)
        nobody = np.zeros(len(scores), np.bool_)
        has_no_look = nobody if looks is None else looks.squared_lengths == 0
        order = np.lexsort((has_no_look, -scores))  # best first; of equal ones those with a descriptor
        overlaps, is_usable = self._overlaps(xyxy, order, scores >= config.low_score)
        if is_usable.any():
            usable = xyxy[is_usable]
            np.minimum(self.extent[:2], usable[:, :2].min(axis=0), out=self.extent[:2])
            np.maximum(self.extent[2:], usable[:, 2:].max(axis=0), out=self.extent[2:])
        return Frame(
            xyxy,
            box_states(detections.xyxy),
            scores,
            detections.labels,
            looks,
            is_usable,
            is_usable & (scores >= config.high_score),
            overlaps,
            np.full(len(scores), -1),
            nobody,
            order,
        )

    def _overlaps(
        self, xyxy: NDArray[np.float64], order: NDArray[np.int64], is_wanted: NDArray[np.bool_]
    ) -> tuple[Overlaps, NDArray[np.bool_]]:
        """The boxes that overlap, and which wanted rows are no second boxes of one object (N,)."""
        config = self.config
        least = min(config.same_overlap, config.duplicate_overlap, config.clean_overlap)
        try:
            overlaps = overlaps_of(xyxy, least, _MOST_PAIRS)
        except TooManyPairsError:  # then only those that stay are looked at
            is_usable = thinned(xyxy, order, is_wanted, config.same_overlap)
            rows = np.flatnonzero(is_usable)
            among = overlaps_of(xyxy[rows], least)
            return Overlaps(rows[among.a], rows[among.b], among.overlap), is_usable
        nobody = np.zeros(len(xyxy), np.bool_)
        return overlaps, keep_best(overlaps.above(config.same_overlap), order, is_wanted, nobody)

    def _match(
        self,
        frame: Frame,
        pairs: Pairs,
        may_objects: NDArray[np.bool_],
        may_rows: NDArray[np.bool_],
        is_left_out: NDArray[np.bool_],
    ) -> None:
        """Give rows that have no object yet the best of the objects that may take them."""
        may_rows = may_rows & (frame.object_of < 0)
        if not may_rows.any():
            return
        is_taken = np.zeros(len(self.objects), np.bool_)
        is_taken[frame.object_of[frame.object_of >= 0]] = True
        is_open = (may_objects & ~is_taken)[pairs.objects] & may_rows[pairs.rows]
        chosen = np.flatnonzero(is_open & ~is_left_out)
        if not len(chosen):
            return
        safe = chosen[self._are_safe(frame, pairs, chosen)]
        self._take(frame, pairs, safe)
        is_taken[pairs.objects[safe]] = True
        chosen = chosen[~is_taken[pairs.objects[chosen]] & (frame.object_of[pairs.rows[chosen]] < 0)]
        if not len(chosen):
            return
        gains = self._gains(frame, pairs, chosen)
        positive = np.flatnonzero(gains > 0)
        chosen = chosen[positive]
        self._take(frame, pairs, chosen[assign_best(pairs.objects[chosen], pairs.rows[chosen], gains[positive])])

    def _take(self, frame: Frame, pairs: Pairs, taken: NDArray[np.intp]) -> None:
        frame.object_of[pairs.rows[taken]] = pairs.objects[taken]
        frame.has_jumped[pairs.rows[taken]] = pairs.is_jump[taken]

    def _are_safe(self, frame: Frame, pairs: Pairs, chosen: NDArray[np.intp]) -> NDArray[np.bool_]:
        """(C,) bool: pairs that are taken whatever the others are: boxes that overlap, and nobody else near."""
        objects, rows, overlap = pairs.objects[chosen], pairs.rows[chosen], pairs.overlap[chosen]
        is_touching = overlap > _TOUCHING
        rivals = np.bincount(objects[is_touching], minlength=len(self.objects))[objects]
        rivals += np.bincount(rows[is_touching], minlength=len(frame.scores))[rows]
        is_safe: NDArray[np.bool_] = (overlap >= self.config.safe_overlap) & (rivals == 2)
        is_safe &= self._recent[objects] & (self.objects.labels[objects] == frame.labels[rows])
        return is_safe

    def _gains(self, frame: Frame, pairs: Pairs, chosen: NDArray[np.intp]) -> NDArray[np.float64]:
        """(C,) gains of the chosen pairs, none of them safe, with appearance."""
        config = self.config
        gains = pairs.gains[chosen]
        if frame.looks is None:
            return gains
        objects, rows = pairs.objects[chosen], pairs.rows[chosen]
        is_possible = gains > -config.appearance_limit
        rivals = np.bincount(objects[is_possible], minlength=len(self.objects))[objects]
        rivals += np.bincount(rows[is_possible], minlength=len(frame.scores))[rows]
        is_certain = (rivals == 2) & (gains > config.appearance_limit)  # whatever the look
        asked = np.flatnonzero(is_possible & ~is_certain)
        pair = chosen[asked]
        unknown = pair[np.isnan(pairs.distance[pair])]
        slots = self.objects.slots[pairs.objects[unknown]]
        pairs.distance[unknown] = self.looks.distances(slots, frame.looks, pairs.rows[unknown])
        gains[asked] += self._likeness(pairs.distance[pair])
        return gains

    def _clean_rows(self, frame: Frame, pairs: Pairs) -> NDArray[np.bool_]:
        """(N,) bool: rows whose descriptor may be kept: sure of itself, and nothing else in the box."""
        is_clean = frame.is_high.copy()
        crowded = frame.overlaps.above(self.config.clean_overlap)
        both_high = frame.is_high[crowded.a] & frame.is_high[crowded.b]
        is_clean[crowded.a[both_high]] = False
        is_clean[crowded.b[both_high]] = False
        is_hidden = self.objects.ids != NO_ID
        is_hidden &= self.now_s - self.objects.seen_s < self.config.hidden_s
        is_hidden[frame.object_of[frame.object_of >= 0]] = False
        covers = is_hidden[pairs.objects] & (pairs.overlap > self.config.hidden_overlap)
        is_clean[pairs.rows[covers]] = False
        return is_clean

    def _see(self, frame: Frame, is_clean: NDArray[np.bool_], detections: Detections) -> GivenBack:
        """What the matched rows say about their objects; rows of objects that are confirmed now are given back."""
        rows = np.flatnonzero(frame.object_of >= 0)
        if not len(rows):
            return GivenBack.nothing()
        objects = self.objects
        seen = frame.object_of[rows]
        jumped = frame.has_jumped[rows]
        if jumped.any():
            fast = seen[jumped]
            objects.motions.widen_(fast, self.now_s - objects.seen_s[fast], self.config.motion)
        objects.motions.correct_(seen, frame.states[rows], self.config.motion)
        objects.see_(seen, frame.labels[rows], frame.scores[rows], self.now_s, self.config.evidence, self.moving)
        if frame.looks is not None:
            self.looks.remember(objects.slots[seen], frame.looks, rows, is_clean, self.now_s)
        confirmed = np.flatnonzero(objects.is_real & (objects.ids == NO_ID))
        objects.ids[confirmed] = np.arange(self.next_id, self.next_id + len(confirmed))
        self.next_id += len(confirmed)
        is_waiting = ~objects.is_real[seen]
        for row, place in zip(rows[is_waiting].tolist(), seen[is_waiting].tolist(), strict=True):
            self._wait(int(objects.serials[place]), row, detections)
        real = seen[~is_waiting]
        return self.waiting.give_back(objects.serials[real], objects.ids[real], objects.labels[real])

    def _wait(self, serial: int, row: int, detections: Detections) -> None:
        number = row if self._numbers is None else int(self._numbers[row])
        score, label = float(detections.scores[row]), int(detections.labels[row])
        box = detections.xyxy[row].copy()
        self.waiting.add(serial, WaitingRow(self._frame_number, number, box, score, label))

    def _answer(self, frame: Frame) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Ids and labels (N,) of all rows."""
        ids, labels = np.full(len(frame.scores), NO_ID), frame.labels
        rows = np.flatnonzero(frame.object_of >= 0)
        rows = rows[self.objects.is_real[frame.object_of[rows]]]
        if len(rows):
            ids[rows] = self.objects.ids[frame.object_of[rows]]
            labels = labels.copy()
            labels[rows] = self.objects.labels[frame.object_of[rows]]
        return ids, labels

    def _end(self, step_s: float, size: tuple[int, int] | None) -> None:
        """Forget whom nobody has seen for too long, or who has left the picture."""
        objects, config = self.objects, self.config
        unseen_s = self.now_s - objects.seen_s
        tentative_s = max(config.tentative_s, 1.01 * step_s)
        is_over = unseen_s > np.where(objects.is_real, config.memory_s, tentative_s)
        is_outside = self._are_outside(size)
        is_over |= is_outside & (unseen_s > config.leave_s)
        if not is_over.any():
            return
        if self.explains:
            left = "left the picture"
            unseen = [f"not seen for {one:.1f} s" for one in unseen_s.tolist()]
            self._note_ends(is_over, [left if one else then for one, then in zip(is_outside, unseen, strict=True)])
        self._forget(is_over)

    def _are_outside(self, size: tuple[int, int] | None) -> NDArray[np.bool_]:
        """(P,) bool: objects that are believed to be beyond the border of the picture."""
        place = self.objects.motions.place
        low, high = self.extent[:2], self.extent[2:]
        if size is not None:
            low, high = np.zeros(2), np.array(size[::-1], np.float64)
        elif self.next_id <= _BORDERS:
            return np.zeros(len(place), np.bool_)
        is_beyond = (place < low) | (place > high)
        return is_beyond[:, 0] | is_beyond[:, 1]

    def _note_ends(self, is_over: NDArray[np.bool_], reasons: list[str]) -> None:
        """Remember, for the story, which identities end and why; ``reasons`` (P,)."""
        for place in np.flatnonzero(is_over & (self.objects.ids != NO_ID)).tolist():
            self._ended.append(Ended(int(self.objects.ids[place]), reasons[place]))

    def _forget(self, is_over: NDArray[np.bool_]) -> None:
        self.waiting.drop(self.objects.serials[is_over])
        self.looks.release(self.objects.slots[is_over])
        self.objects = self.objects.part(~is_over)

    def _begin(self, frame: Frame, is_clean: NDArray[np.bool_], detections: Detections) -> NDArray[np.bool_]:
        """New objects from what is left, not from second boxes of what is there; (N,) which rows."""
        config = self.config
        is_wanted = frame.is_usable & (frame.scores >= config.birth_score)
        twins = frame.overlaps.above(config.duplicate_overlap)
        is_new = keep_best(twins, frame.order, is_wanted, frame.object_of >= 0)
        rows = np.flatnonzero(is_new)
        rows = rows[np.argsort(-frame.scores[rows], kind="stable")]  # ids do not depend on the order of rows
        if not len(rows):
            return is_new
        serials = np.arange(self.next_serial, self.next_serial + len(rows))
        self.next_serial += len(rows)
        slots = self.looks.take(len(rows))
        new = Objects.begin(
            serials, slots, frame.labels[rows], frame.scores[rows], frame.states[rows], self.now_s, config.motion
        )
        self.objects = self.objects.joined(new)
        if frame.looks is not None:
            self.looks.remember(slots, frame.looks, rows, is_clean, self.now_s)
        for serial, row in zip(serials.tolist(), rows.tolist(), strict=True):
            self._wait(serial, row, detections)
        return is_new


def _nobody(config: DefaultConfig) -> Objects:
    none, numbers = np.zeros(0, np.int64), np.zeros(0)
    return Objects.begin(none, none, none, numbers, np.zeros((0, 4)), 0.0, config.motion)
