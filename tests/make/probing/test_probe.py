import json
import math
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from evaluation.described import random_objects
from lookonce.datasets import open_sequences
from lookonce.errors import ConfigError
from lookonce.evaluation import mean_average_precision, pair_distances, rank_one
from lookonce.make.probing import (
    PROBE_FILES,
    Gap,
    GapLimits,
    ProbeSettings,
    choose_classes,
    measure,
    open_reader,
    probe,
    report_json,
    write_report,
)
from make.probing.labelled_squares import truth_lines, write_squares, write_truth
from squares import COLOURS


def _frames(least, most, rank):
    return GapLimits(Gap(least, True), Gap(most, True), Gap(rank, True))


@pytest.fixture
def squares(tmp_path):
    return open_sequences(write_squares(tmp_path / "squares"))


@pytest.fixture
def result(squares, square_model):
    return probe(square_model, squares, ProbeSettings(limits=_frames(1, 8, 3)))


def test_measures_are_those_of_the_evaluation():
    objects = random_objects(4)
    one = objects[objects.sequences == objects.sequences[0]]
    found = measure(one, _frames(1, 8, 2), 0.8)
    assert found.rank_one == rank_one(one, 2)
    assert found.retrieval == mean_average_precision(one, 1, 8)
    assert found.pairs.genuine.tolist() == pair_distances(one, 1, 8).genuine.tolist()
    assert found.identities == len(np.unique(one.identities))


def test_rank_one_of_several_sequences_is_the_mean_over_all_queries():
    objects = random_objects(4)
    expected, found = rank_one(objects, 2), measure(objects, _frames(1, 8, 2), 0.8).rank_one
    assert found.queries == expected.queries
    assert (found.rate, found.chance) == pytest.approx((expected.rate, expected.chance))


def test_no_objects_have_no_rates():
    found = measure(random_objects(0)[:0], GapLimits(), None)
    assert (found.objects, found.identities, found.rank_one.queries) == (0, 0, 0)
    assert math.isnan(found.equal_error_rate)
    assert math.isnan(found.false_accept_rate)


def test_squares_of_three_colours_are_told_apart(result):
    overall = result.overall
    assert (overall.objects, overall.identities) == (36, 3)
    assert overall.pairs.genuine_count == 3 * sum(12 - gap for gap in range(1, 9))
    assert overall.pairs.impostor_count == 2 * overall.pairs.genuine_count
    assert overall.rank_one.rate == overall.retrieval.mean_average_precision == overall.roc_auc == 1
    assert overall.rank_one.chance == pytest.approx(1 / 3)
    assert overall.equal_error_rate == 0
    assert result.by_sequence == (overall,)
    assert result.advice.startswith("Too few pairs")
    assert {by: sum(part.genuine for part in parts) for by, parts in result.parts.items()} == dict.fromkeys(
        ("time_gap", "size_change", "height", "grid_change"), overall.pairs.genuine_count
    )


def test_threshold_is_the_settings_then_the_files_then_that_of_the_equal_error_rate(result, squares, square_model):
    assert (result.match_threshold, result.threshold_source) == (
        result.overall.equal_error_threshold,
        "equal error rate",
    )
    settings = ProbeSettings(limits=_frames(1, 8, 3), match_threshold=0.01)
    given = probe(square_model, squares, settings)
    assert (given.match_threshold, given.threshold_source) == (0.01, "setting")
    assert given.overall.false_accept_rate == 0


def test_sequences_are_pooled_and_told_apart(tmp_path, squares, square_model):
    other = open_sequences(write_squares(tmp_path / "other", 6))
    both = probe(open_reader(square_model), (*squares, *other), ProbeSettings(limits=_frames(1, 5, 2)))
    assert [tally.name for tally in both.tallies] == ["squares", "other"]
    assert both.overall.identities == 6
    assert [measures.objects for measures in both.by_sequence] == [36, 18]
    assert both.overall.pairs.genuine_count == sum(part.pairs.genuine_count for part in both.by_sequence)


def test_files_are_written_and_equal_in_every_run(result, squares, square_model, tmp_path):
    again = probe(square_model, squares, result.settings)
    for name, one in (("a", result), ("b", again)):
        files = write_report(tmp_path / name, one, squares)
        assert tuple(file.name for file in files) == PROBE_FILES
    for name in PROBE_FILES:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def _has_colours(path: Path) -> set[str]:
    with Image.open(path) as sheet:
        pixels = np.asarray(sheet.convert("RGB")).astype(int)
    return {name for name, colour in COLOURS.items() if (np.abs(pixels - colour).max(axis=2) < 40).sum() > 2000}


def test_the_sheet_shows_the_boxes_of_a_folder_and_of_a_video(result, squares, square_clip, square_model, tmp_path):
    write_report(tmp_path / "folder", result, squares)
    assert _has_colours(tmp_path / "folder" / "neighbours.png") == set(COLOURS)
    sequences = open_sequences(write_truth(tmp_path / "truth", truth_lines()), pictures=square_clip)
    done = []
    settings = ProbeSettings(limits=_frames(1, 8, 3), every=2)
    found = probe(square_model, sequences, settings)
    write_report(tmp_path / "video", found, sequences, on_frame=lambda *progress: done.append(progress))
    assert _has_colours(tmp_path / "video" / "neighbours.png") == set(COLOURS)
    assert done[-1][0] == "truth, pictures for the sheet"
    assert done[-1][1] == done[-1][2]


def test_numbers_are_json_without_nan(result):
    content = json.loads(report_json(result), parse_constant=pytest.fail)
    assert content["model"]["sha256"] == result.sha256
    assert content["model"]["descriptor"]["kind"] == "native"
    assert content["settings"]["max_gap"] == "8 frames"
    assert content["sequences"][0]["name"] == "squares"
    assert content["overall"]["rank_one"]["rate"] == 1
    assert content["parts"]["height"][-1]["upper"] is None
    assert content["parts"]["height"][-1]["equal_error_rate"] is None
    assert {"lookonce", "python", "numpy", "onnxruntime", "av"} <= content["versions"].keys()


def _with_classes(folder):
    write_squares(folder)
    (folder / "gt" / "labels.txt").write_text("car\nbus\n")
    lines = [line.replace(",1,-1,-1,-1", f",1,{1 + (line.split(',')[1] == '3')},1") for line in truth_lines()]
    return open_sequences(write_truth(folder, lines))


def test_objects_of_chosen_classes_only_are_compared(tmp_path, square_model):
    sequences = _with_classes(tmp_path / "classes")
    settings = ProbeSettings(limits=_frames(1, 8, 3), classes=("car",))
    assert probe(square_model, sequences, settings).overall.identities == 2
    assert choose_classes(sequences, ()) == sequences


@pytest.mark.parametrize(
    ("classes", "message"),
    [
        pytest.param(("tram",), "class 'tram' is not in the data; it has bus, car", id="unknown-class"),
        pytest.param(("bus",), "classes: one identity of class bus; .* needs two", id="one-identity-of-a-class"),
    ],
)
def test_classes_that_leave_nothing_to_tell_apart_are_refused(classes, message, tmp_path):
    with pytest.raises(ConfigError, match=message):
        choose_classes(_with_classes(tmp_path / "classes"), classes)


def test_fewer_than_two_identities_are_refused(tmp_path):
    folder = write_squares(tmp_path / "lonely")
    write_truth(folder, truth_lines(names=("red",)))
    with pytest.raises(ConfigError, match="lonely: one identity; telling objects apart needs two"):
        choose_classes(open_sequences(folder), ())
    with pytest.raises(ConfigError, match="no sequence: no identity"):
        choose_classes((), ())


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        pytest.param(ProbeSettings(), "one and the same object lie 2 to 30 s apart", id="gaps-too-long"),
        pytest.param(ProbeSettings(limits=_frames(0, 0, 1)), "one and the same object lie", id="one-moment"),
    ],
)
def test_nothing_to_compare_is_refused(settings, message, squares, square_model):
    if settings.limits == GapLimits():
        settings = ProbeSettings(limits=GapLimits(Gap(2.0)))
    with pytest.raises(ConfigError, match=message):
        probe(square_model, squares, settings)


def test_objects_that_never_meet_others_are_refused(tmp_path, square_model):
    lines = [line for line in truth_lines() if line.split(",")[1] == ("1" if int(line.split(",")[0]) <= 6 else "2")]
    folder = write_squares(tmp_path / "squares")
    write_truth(folder, lines)
    sequences = open_sequences(folder)
    with pytest.raises(ConfigError, match="no boxes of two different objects lie 1 to 1 frame apart"):
        probe(square_model, [*_cut_apart(sequences)], ProbeSettings(limits=_frames(1, 1, 1)))


def _cut_apart(sequences):
    """The sequence without the frame in which the second object comes."""
    import dataclasses

    for sequence in sequences:
        yield dataclasses.replace(sequence, frames=tuple(frame for frame in sequence.frames if frame.index != 6))


def test_a_detector_that_finds_nothing_is_refused(tmp_path, square_model):
    folder = write_squares(tmp_path / "squares")
    elsewhere = [line.replace(",8,8,1", ",2,2,1") for line in truth_lines()]
    sequences = open_sequences(write_truth(folder, elsewhere))
    with pytest.raises(ConfigError, match=r"finds none of 36 truth boxes at score 0\.1; lower the score"):
        probe(square_model, sequences, ProbeSettings(boxes="detections"))


def test_boxes_without_any_feature_are_refused(tmp_path, square_model):
    folder = write_squares(tmp_path / "squares")
    black = [f"{frame},{number},{8 * number},16,8,8,1,-1,-1,-1" for frame in range(1, 13) for number in (1, 2)]
    sequences = open_sequences(write_truth(folder, black))
    with pytest.raises(ConfigError, match="none of 24 boxes has a descriptor"):
        probe(square_model, sequences)


@pytest.mark.parametrize(
    "settings",
    [
        pytest.param({"every": 0}, id="every"),
        pytest.param({"match_threshold": 0.0}, id="threshold-zero"),
        pytest.param({"match_threshold": math.nan}, id="threshold-nan"),
    ],
)
def test_settings_out_of_range_are_refused(settings):
    with pytest.raises(ConfigError, match=f"{next(iter(settings))}: expected"):
        ProbeSettings(**settings)
