"""Preset ``default``: motion and appearance together, objects kept through gaps, time in seconds.

Every pair of an object and a detection has a gain: the logarithm of how much likelier it is that the detection is this
object than that it is another one. Its terms are those of multiple hypothesis tracking (Blackman, "Multiple hypothesis
tracking for multiple target tracking", 2004): a place under the object's Kalman filter against objects anywhere at a
density, the size, the class, and the descriptor's distance. After a short time the place says nearly everything;
after a gap, or with few frames a second, the filter is wide and the descriptor decides. Only pairs of positive gain can
be taken, and of each frame the choice with the largest sum is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lookonce.distances import COARSE, quantize
from lookonce.stories import Ended
from lookonce.structures import NO_ID, Detections, Filled, GivenBack, Tracks
from lookonce.tracking.alone import pairs_alone
from lookonce.tracking.border import Border
from lookonce.tracking.candidates import TOUCHING, Frame, Pairs, find_pairs
from lookonce.tracking.clock import Clock
from lookonce.tracking.components import assign_best
from lookonce.tracking.default_config import DefaultConfig
from lookonce.tracking.doubt import clean_rows, own_shares
from lookonce.tracking.explaining import Notes, tell
from lookonce.tracking.jolts import Jolt, find_jolt, is_again
from lookonce.tracking.looks import Looks
from lookonce.tracking.motion import box_states
from lookonce.tracking.objects import MovingScores, Objects
from lookonce.tracking.overlapping import best_first, keep_best, usable_rows
from lookonce.tracking.own_boxes import OwnBoxes, Sightings
from lookonce.tracking.waiting import Waiting, WaitingRow

__all__ = ["DefaultRule"]

_FAR = 4.0  # distance, more than two descriptors can have


class DefaultRule:
    """The association of the presets ``default`` and ``iou``; one stream, ids from 1."""

    def __init__(self, config: DefaultConfig, explains: bool = False) -> None:
        self.config = config
        self.objects = Objects.nobody(config.motion)
        self.looks = Looks(config.views, config.view_apart, config.view_interval_s)
        self.waiting = Waiting(config.given_back_rows)
        self.next_id = 1
        self.next_serial = 0
        self.clock = Clock()
        self.border = Border()
        self.moving = MovingScores()
        self.own_boxes = OwnBoxes(config)
        self.jolt_speed = np.zeros(2)  # px / s of the picture, if it jumped in the frame before
        self.explains = explains
        self._numbers: NDArray[np.int64] | None = None
        self._frame_number = 0
        self._was_seen = self._is_recent = np.zeros(0, np.bool_)  # objects seen in the frame before, and lately
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
        descriptors = self._descriptors_of(detections)  # refuses before anything changes
        self._ended.clear()
        before_s = self.clock.now_s
        step_s = self.clock.advance(time_s, self.config.frame_rate)
        self._numbers, self._frame_number = numbers, self.clock.frame if frame_number is None else frame_number
        self._predict(step_s, before_s, camera)
        frame = self._look_at(detections, descriptors, size)
        unseen_s = self.clock.now_s - self.objects.seen_s
        self._was_seen = self.objects.seen_s >= before_s
        pairs = self._find_pairs(frame, unseen_s, step_s)
        self._is_recent = unseen_s <= 1.01 * step_s + self.config.recent_s
        is_known = self.objects.ids != NO_ID
        self._match_all(frame, pairs, is_known)
        self._match_alone(frame, pairs, unseen_s, step_s)
        is_clean = clean_rows(frame, pairs, is_known & (unseen_s < self.config.hidden_s), self.config)
        rows = (frame.object_of >= 0).nonzero()[0]
        seen = frame.object_of[rows]
        slots = self.objects.slots[seen]
        if self.config.motion.doubt > 0:
            frame.shares = own_shares(frame, pairs, is_known & self._is_recent)
        notes = self._note(frame, pairs, unseen_s) if self.explains else None
        filled = self._see(frame, rows, seen, unseen_s)
        if size is None:
            self.border.widen(frame.xyxy, rows)
        self.own_boxes.end_frame(self._frame_number, self.clock.now_s)
        ids, labels, given_back = self._answer(frame, rows, seen)
        unseen_ids, unseen_boxes = self._end(pairs, unseen_s, step_s, size)
        new = self._begin(frame)
        if frame.looks is not None:
            if len(new):
                slots, rows = np.concatenate([slots, self.objects.slots[-len(new) :]]), np.concatenate([rows, new])
            self.looks.remember(slots, frame.looks, rows, is_clean, self.clock.now_s)
        return Tracks(
            ids,
            frame.reported,
            detections.scores,
            labels,
            unseen_ids,
            unseen_boxes,
            given_back=given_back,
            filled=filled,
            story=None if notes is None else tell(notes, ids, new, tuple(self._ended), self.config),
        )

    def _note(self, frame: Frame, pairs: Pairs, unseen_s: NDArray[np.float64]) -> Notes:
        """What the story of the frame needs, before anything changes."""
        objects, gains, distances = self.objects, pairs.gains, np.full(len(pairs.gains), np.nan)
        if frame.looks is not None:
            distances = self.looks.distances(objects.slots[pairs.objects], frame.looks, pairs.rows)
            gains = gains + self._likeness(distances)
        else:
            gains = gains + self.config.appearance_absent
        lately = self._was_seen, self._is_recent
        return Notes(frame, pairs, distances, gains, objects.ids.copy(), unseen_s, *lately)

    def _likeness(self, distance: NDArray[np.float64]) -> NDArray[np.float64]:
        """What distances of descriptors add to the gains."""
        limit = self.config.appearance_limit
        likeness = self.config.appearance_weight * (self.config.match_threshold - np.minimum(distance, _FAR))
        likeness = np.minimum(np.maximum(likeness, -limit), limit)
        likeness[distance == np.inf] = self.config.appearance_absent
        return likeness

    def _predict(self, step_s: float, before_s: float, camera: NDArray[np.float64] | None) -> None:
        """Where the objects are now, after the frame at ``before_s``; those that a gap outlived are gone."""
        unseen_s = self.clock.now_s - self.objects.seen_s
        gone = unseen_s > self.config.memory_s
        if np.count_nonzero(gone):
            if self.explains:
                nothing = f"nothing came for {step_s:.1f} s" if step_s > self.config.memory_s else ""
                self._note_ends(gone, [nothing or f"not seen for {unseen:.1f} s" for unseen in unseen_s])
            self._forget(gone)
        objects = self.objects
        objects.motions.predict_(step_s, objects.seen_s < before_s, self.config.motion)
        if camera is not None:
            objects.move_camera_(camera)

    def _descriptors_of(self, detections: Detections) -> NDArray[np.float32] | None:
        """Those that are used, if any; raises for another length than before."""
        descriptors = detections.descriptors
        if not self.config.appearance or descriptors is None or not descriptors.shape[1]:
            return None
        self.looks.check_size(descriptors.shape[1])
        return descriptors

    def _look_at(
        self, detections: Detections, descriptors: NDArray[np.float32] | None, size: tuple[int, int] | None
    ) -> Frame:
        config = self.config
        scores, columns = detections.scores.astype(np.float64), np.array(detections.xyxy.T, np.float64, order="C")
        looks = None if descriptors is None else quantize(descriptors, COARSE)
        overlaps, is_usable = usable_rows(columns.T, scores, looks, config)
        is_high = is_usable & (scores >= config.high_score)
        if size is None:
            self.border.widen(columns.T, is_high.nonzero()[0])
        return Frame(
            columns.T,
            box_states(columns.T),
            scores,
            detections.labels,
            looks,
            is_usable,
            is_high,
            overlaps,
            self.border.xyxy(size),
            np.full(len(scores), -1),
            np.zeros(len(scores), np.bool_),
            np.zeros(len(scores), np.bool_),
            detections.xyxy,
        )

    def _find_pairs(self, frame: Frame, unseen_s: NDArray[np.float64], step_s: float) -> Pairs:
        """Objects and rows that are near each other, after the picture has jumped if it did."""
        pairs = find_pairs(self.objects, unseen_s, self._was_seen, frame, self.config)
        jolt = find_jolt(self.objects, self._was_seen, frame, pairs) if self.config.jolts else None
        if jolt is None or not self._looks_true(jolt, frame):
            self.jolt_speed = np.zeros(2)
            return pairs
        frame.jolt, speed = jolt.shift, jolt.shift / step_s
        self.objects.move_camera_(np.column_stack([np.eye(2), jolt.shift]))
        if is_again(speed, self.jolt_speed, jolt.cell / step_s):
            self.objects.motions.velocity[:] += speed
        self.jolt_speed = speed
        return find_pairs(self.objects, unseen_s, self._was_seen, frame, self.config)

    def _looks_true(self, jolt: Jolt, frame: Frame) -> bool:
        """Whether those who agree look as they did; one object alone has to."""
        if frame.looks is None:
            return len(jolt.objects) > 1
        distances = self.looks.distances(self.objects.slots[jolt.objects], frame.looks, jolt.rows)
        known = distances[distances < np.inf]
        return bool(np.median(known) <= self.config.match_threshold) if len(known) else len(jolt.objects) > 1

    def _match_all(self, frame: Frame, pairs: Pairs, is_known: NDArray[np.bool_]) -> None:
        """First the rows of high score and the confirmed objects (P,), then the weaker rows, then the other objects."""
        is_high = frame.is_high[pairs.rows]
        self._match(frame, pairs, (is_known[pairs.objects] & is_high).nonzero()[0])
        left = pairs.are_left(frame).nonzero()[0]
        if not len(left):
            return
        objects, is_near = pairs.objects[left], pairs.overlap[left] >= self.config.low_overlap
        self._match(frame, pairs, left[is_near & (is_known & self._is_recent)[objects]])
        left = left[~is_known[objects] & (is_near | is_high[left])]
        self._match(frame, pairs, left[pairs.are_left(frame)[left]])

    def _match_alone(self, frame: Frame, pairs: Pairs, unseen_s: NDArray[np.float64], step_s: float) -> None:
        """Rows for objects that are alone, unless they look different."""
        objects, rows = pairs_alone(self.objects, unseen_s, self._was_seen, frame, pairs, step_s, self.config)
        if frame.looks is not None and len(rows):
            distances = self.looks.distances(self.objects.slots[objects], frame.looks, rows)
            alike = (self._likeness(distances) + self.config.appearance_absent > 0).nonzero()[0]
            objects, rows = objects[alike], rows[alike]
        frame.object_of[rows], frame.has_jumped[rows], frame.is_alone[rows] = objects, True, True
        pairs.is_taken[objects] = True

    def _match(self, frame: Frame, pairs: Pairs, chosen: NDArray[np.intp]) -> None:
        """Give rows the best of the objects that may take them; of the chosen pairs neither side is taken."""
        if not len(chosen):
            return
        safe = self._safe(frame, pairs, chosen)
        if len(safe):
            self._take(frame, pairs, safe)
            chosen = chosen[pairs.are_left(frame)[chosen]]
        chosen, gains = self._likely(frame, pairs, chosen)
        if len(chosen):
            self._take(frame, pairs, chosen[assign_best(pairs.objects[chosen], pairs.rows[chosen], gains)])

    def _take(self, frame: Frame, pairs: Pairs, taken: NDArray[np.intp]) -> None:
        objects, rows = pairs.objects[taken], pairs.rows[taken]
        frame.object_of[rows] = objects
        frame.has_jumped[rows] = pairs.is_jump[taken]
        pairs.is_taken[objects] = True

    def _safe(self, frame: Frame, pairs: Pairs, chosen: NDArray[np.intp]) -> NDArray[np.intp]:
        """Of the chosen pairs those to take whatever the others are: boxes that overlap, and nobody else near."""
        overlap = pairs.overlap[chosen]
        is_near = overlap >= self.config.safe_overlap
        safe = chosen[is_near]
        if not len(safe):
            return safe
        touching = chosen[is_near | (overlap > TOUCHING)]
        objects, rows = pairs.objects[safe], pairs.rows[safe]
        rivals = np.bincount(pairs.objects[touching], minlength=len(self.objects))[objects]
        rivals += np.bincount(pairs.rows[touching], minlength=len(frame.scores))[rows]
        is_safe: NDArray[np.bool_] = self._is_recent[objects] & (rivals == 2)
        is_safe &= self.objects.labels[objects] == frame.labels[rows]
        return safe[is_safe]

    def _likely(
        self, frame: Frame, pairs: Pairs, chosen: NDArray[np.intp]
    ) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
        """Of the chosen pairs, none of them safe, those of positive gain with appearance, and what they gain."""
        gains = pairs.gains[chosen]
        if frame.looks is None:
            gains += self.config.appearance_absent
            positive = (gains > 0).nonzero()[0]
            return chosen[positive], gains[positive]
        possible = (gains > -self.config.best_look).nonzero()[0]
        chosen, gains = chosen[possible], gains[possible]
        if not len(chosen):
            return chosen, gains
        objects, rows = pairs.objects[chosen], pairs.rows[chosen]
        rivals = np.bincount(objects)[objects] + np.bincount(rows)[rows]
        # Without rivals and with such a gain a pair is certain, whatever the look.
        asked = ((rivals > 2) | (gains <= self.config.appearance_limit)).nonzero()[0]
        distances = self.looks.distances(self.objects.slots[objects[asked]], frame.looks, rows[asked])
        gains[asked] += self._likeness(distances)
        positive = (gains > 0).nonzero()[0]
        return chosen[positive], gains[positive]

    def _see(
        self, frame: Frame, rows: NDArray[np.intp], seen: NDArray[np.int64], unseen_s: NDArray[np.float64]
    ) -> Filled:
        """What the matched rows (M,) say about their objects ``seen`` (M,), of all (P,) that were not for so long."""
        if not len(rows):
            return Filled.nothing()
        objects = self.objects
        jumped = frame.has_jumped[rows].nonzero()[0]
        if len(jumped):
            fast, more = seen[jumped], objects.motions.more_speed(objects.hits == 1, self.config.motion)
            objects.motions.widen_(fast, unseen_s[fast], more[fast])
        states = frame.states.T.take(rows, axis=1).T
        sightings = Sightings(rows, seen, states, objects.seen_s[seen], objects.last.take(seen, axis=1))
        labels, scores = frame.labels[rows], frame.scores[rows]
        shares = None if frame.shares is None else frame.shares[rows]
        correction = objects.motions.correct_(seen, states, scores, self.config.motion, shares, sightings.before[:2])
        boxes = self.own_boxes.give_out(frame, objects, sightings, correction, self.clock.now_s)
        objects.see_(seen, labels, scores, self.clock.now_s, self.config.evidence, self.moving)
        confirmed = (objects.is_real & (objects.ids == NO_ID)).nonzero()[0]
        objects.ids[confirmed] = np.arange(self.next_id, self.next_id + len(confirmed))
        self.next_id += len(confirmed)
        return self.own_boxes.fill(objects, sightings, boxes, self.clock.now_s)

    def _answer(
        self, frame: Frame, rows: NDArray[np.intp], seen: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], GivenBack]:
        """Ids and labels (N,) of all rows, and the earlier rows of objects that are confirmed now.

        The matched rows (M,) are of the objects ``seen`` (M,); those of objects that are not confirmed wait.
        """
        is_real = self.objects.is_real[seen]
        for place in (~is_real).nonzero()[0].tolist():
            self._wait(int(self.objects.serials[seen[place]]), int(rows[place]), frame)
        rows, seen = rows[is_real], seen[is_real]
        ids, labels = np.full(len(frame.scores), NO_ID), frame.labels.copy()
        ids[rows] = known = self.objects.ids[seen]
        labels[rows] = voted = self.objects.labels[seen]
        return ids, labels, self.waiting.give_back(self.objects.serials[seen], known, voted)

    def _wait(self, serial: int, row: int, frame: Frame) -> None:
        number = row if self._numbers is None else int(self._numbers[row])
        score, label = float(frame.scores[row]), int(frame.labels[row])
        box = frame.reported[row].copy()
        self.waiting.add(serial, WaitingRow(self._frame_number, number, box, score, label))

    def _end(
        self, pairs: Pairs, unseen_s: NDArray[np.float64], step_s: float, size: tuple[int, int] | None
    ) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
        """Forget whom nobody has seen for too long, or who has left the picture; ids (U,) and boxes of others unseen.

        None of ``unseen_s`` (P,) is above the memory: those are gone already.
        """
        objects, config = self.objects, self.config
        is_over = ~objects.is_real & (unseen_s > max(config.tentative_s, 1.01 * step_s))
        is_outside = self.border.are_outside(self.objects, size, self.next_id)
        is_over |= is_outside & (unseen_s > config.leave_s)
        is_over &= ~pairs.is_taken
        stay = ((objects.ids != NO_ID) & ~(pairs.is_taken | is_over)).nonzero()[0]
        unseen = objects.ids[stay], pairs.boxes.take(stay, axis=1).T.astype(np.float32, order="C")
        if not np.count_nonzero(is_over):
            return unseen
        if self.explains:
            left = "left the picture"
            times = [f"not seen for {one:.1f} s" for one in unseen_s.tolist()]
            self._note_ends(is_over, [left if one else then for one, then in zip(is_outside, times, strict=True)])
        self._forget(is_over)
        return unseen

    def _note_ends(self, is_over: NDArray[np.bool_], reasons: list[str]) -> None:
        """Remember, for the story, which identities end and why; ``reasons`` (P,)."""
        for place in np.flatnonzero(is_over & (self.objects.ids != NO_ID)).tolist():
            self._ended.append(Ended(int(self.objects.ids[place]), reasons[place]))

    def _forget(self, is_over: NDArray[np.bool_]) -> None:
        self.waiting.drop(self.objects.serials[is_over])
        self.looks.release(self.objects.slots[is_over])
        self.objects = self.objects.part(~is_over)

    def _begin(self, frame: Frame) -> NDArray[np.intp]:
        """New objects from what is left, not from second boxes of what is there; (B,) their rows, in their order."""
        is_free = frame.object_of < 0
        is_wanted = is_free & frame.is_usable & (frame.scores >= self.config.birth_score)
        if not np.count_nonzero(is_wanted):
            return np.zeros(0, np.intp)
        twins = frame.overlaps.above(self.config.duplicate_overlap)
        key = best_first(frame.xyxy, frame.scores, frame.looks)
        rows = keep_best(twins, key, is_wanted, ~is_free).nonzero()[0]
        rows = rows[np.argsort(-frame.scores[rows], kind="stable")]  # ids by score; of equal ones in the order of rows
        serials = np.arange(self.next_serial, self.next_serial + len(rows))
        self.next_serial += len(rows)
        rest = frame.labels[rows], frame.scores[rows], frame.states[rows], self.clock.now_s, self.config.motion
        self.objects = self.objects.joined(Objects.begin(serials, self.looks.take(len(rows)), *rest))
        for serial, row in zip(serials.tolist(), rows.tolist(), strict=True):
            self._wait(serial, row, frame)
        return rows
