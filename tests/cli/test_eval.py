"""`lookonce eval` as a person runs it: real files, run inside this process, which is faster."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cli.evaluated import (
    BUS,
    CAR,
    FRAMES,
    detrac_xml,
    done,
    refusal,
    result_lines,
    run,
    table_row,
    truth_lines,
    write_truth,
)
from datasets.making import annotation, frame, target, write, write_detrac, write_kitti
from lookonce import __version__
from lookonce.datasets import open_sequences, read_detrac_results, read_mot_results
from lookonce.evaluation import (
    TrackingResult,
    TrackingTruth,
    combine,
    evaluate_tracking,
    pr_scores,
    read_detrac_truth,
    read_motchallenge_truth,
)
from make.probing.labelled_squares import write_squares


@pytest.fixture
def truth(tmp_path: Path) -> Path:
    return write_truth(tmp_path / "truth")


@pytest.fixture
def results(tmp_path: Path) -> Path:
    write(tmp_path / "results" / "a.txt", result_lines(switch=4))
    write(tmp_path / "results" / "b.txt", result_lines(missing=6))
    return tmp_path / "results"


def expected(truth: Path, results: Path, protocol: str = "trackeval") -> list:
    scores = []
    for sequence in open_sequences(truth):
        result = TrackingResult.of_rows(read_mot_results(results / f"{sequence.name}.txt"))
        scores.append(evaluate_tracking(TrackingTruth.of_sequence(sequence, FRAMES), result, protocol))
    return [*scores, combine(scores)]


def test_printed_and_written_figures_are_those_of_evaluate_tracking(truth, results, tmp_path):
    result = done("--truth", truth, "--results", results, "--json", tmp_path / "o.json")
    content = json.loads((tmp_path / "o.json").read_text())
    (written,) = content["runs"]
    parts = [*(one["figures"] for one in written["sequences"]), written["combined"]["figures"]]
    for name, ours, figures in zip(("a", "b", "combined"), expected(truth, results), parts, strict=True):
        clear, hota = ours.clear, ours.hota
        assert figures["hota"] == hota.hota
        assert figures["idf1"] == ours.identity.idf1
        assert figures["mota"] == clear.mota
        assert figures["truth_boxes"] == ours.counts.truth_boxes
        shares = (hota.hota, hota.det_a, hota.ass_a, ours.identity.idf1, clear.mota, clear.motp)
        counts = (clear.id_switches, clear.fragmentations, clear.false_positives, clear.misses)
        objects = (clear.mostly_tracked, clear.mostly_lost, ours.counts.truth_boxes)
        assert table_row(result.stdout, name) == [*(f"{100 * one:.1f}" for one in shares), *map(str, counts + objects)]
    assert "2 sequences, 20 frames evaluated by protocol trackeval in" in result.stdout.splitlines()[-1]
    assert result.stderr == "evaluate: 2 of 2, sequences\n"
    assert written["combined"]["figures"]["id_switches"] == 1


def test_files_say_what_the_figures_depend_on(truth, results, tmp_path):
    done("--truth", truth, "--results", f"mine={results}", "--json", tmp_path / "o.json", "--csv", tmp_path / "o.csv")
    content = json.loads((tmp_path / "o.json").read_text())
    assert (content["format"], content["format_version"]) == ("lookonce-evaluation", 1)
    assert (content["version"], content["protocol"], content["benchmark"]) == (__version__, "trackeval", None)
    assert [one["name"] for one in content["truth"]] == ["a", "b"]
    assert content["truth"][0]["file"].endswith("gt.txt")
    (one,) = content["runs"]
    assert one["name"] == "mine"
    assert {len(part["sha256"]) for part in (*content["truth"], *one["sequences"])} == {64}
    with (tmp_path / "o.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["run"], row["sequence"], row["class"]) for row in rows] == [
        ("mine", "a", "ALL"),
        ("mine", "b", "ALL"),
        ("mine", "COMBINED", "ALL"),
    ]
    assert rows[0]["truth_sha256"] == content["truth"][0]["sha256"]
    figures = one["combined"]["figures"]
    assert {name: float(rows[2][name]) for name in figures} == figures


def test_the_same_input_gives_the_same_bytes(truth, results, tmp_path):
    for name in ("1", "2"):
        files = ("--json", tmp_path / f"{name}.json", "--csv", tmp_path / f"{name}.csv")
        done("--truth", truth, "--results", results, *files)
    for suffix in ("json", "csv"):
        assert (tmp_path / f"1.{suffix}").read_bytes() == (tmp_path / f"2.{suffix}").read_bytes()


def test_earlier_files_are_kept_unless_told_otherwise(truth, results, tmp_path):
    kept = write(tmp_path / "o.json", "earlier")
    assert "--overwrite" in refusal("--truth", truth, "--results", results, "--json", kept)
    assert kept.read_text() == "earlier"
    done("--truth", truth, "--results", results, "--json", kept, "--overwrite")
    assert kept.read_text() != "earlier"
    assert "not there" in refusal("--truth", truth, "--results", results, "--csv", tmp_path / "no" / "o.csv")


@pytest.mark.parametrize(
    ("limits", "said"),
    [
        pytest.param(
            ["--min-hota", "0.5", "--min-mota", "0.8", "--min-idf1", "0.8", "--max-switches", "1"], [], id="met"
        ),
        pytest.param(["--min-hota", "0.99"], ["HOTA 0.", "is below 0.99"], id="hota"),
        pytest.param(
            ["--min-mota", "0.9", "--max-switches", "0"], ["MOTA 0.875 is below 0.9", "IDSW 1 is above 0"], id="two"
        ),
        pytest.param(["--min-idf1", "1"], ["IDF1 0."], id="idf1"),
    ],
)
def test_limits_decide_the_exit_status_after_the_table(limits, said, truth, results):
    result = run("--truth", truth, "--results", results, *limits)
    assert result.exit_code == bool(said)
    assert table_row(result.stdout, "combined")
    lines = [line for line in result.stderr.splitlines() if line.startswith("lookonce: ")]
    assert len(lines) == bool(said)
    assert all(part in lines[0] for part in said)


def test_a_limit_that_is_missed_is_one_line_of_the_real_process(truth, results):
    command = [sys.executable, "-c", "from lookonce.cli.app import main; main()", "eval", "--truth", str(truth / "a")]
    for options, said in (["--min-mota", "0.99"], "lookonce: MOTA 0.95 is below 0.99"), (["--benchmark", "M"], "MOT15"):
        options += ["--results", str(results / "a.txt")]
        process = subprocess.run([*command, *options], capture_output=True, text=True, timeout=60)
        assert process.returncode == 1
        assert said in process.stderr
        assert len(process.stderr.splitlines()) == 1


def test_several_results_stand_side_by_side(truth, results, tmp_path):
    perfect = tmp_path / "perfect"
    for name in ("a", "b"):
        write(perfect / name / "tracks.txt", result_lines())
    limits = ("--max-switches", 0)
    result = run("--truth", truth, "--results", results, "--results", f"best={perfect}", *limits)
    assert table_row(result.stdout, "best")[-1] == table_row(result.stdout, "results")[-1] == "40"
    assert result.exit_code == 1
    assert result.stderr.splitlines()[-1] == "lookonce: results: IDSW 1 is above 0"
    assert "2 sequences x 2 runs" in result.stdout
    assert "NAME=PATH" in refusal("--truth", truth, "--results", perfect / "a", "--results", results / "a.txt")


def test_columns_are_chosen_by_heading_or_name(truth, results):
    result = done("--truth", truth, "--results", results, "--columns", "id_switches,mota,tracks")
    assert table_row(result.stdout, "combined") == ["1", "87.5", "5"]
    assert "did you mean MOTA" in refusal("--truth", truth, "--results", results, "--columns", "MOTTA")
    wrong = ("--truth", truth, "--results", results, "--protocol", "detrac")
    assert "has no HOTA" in refusal(*wrong, "--columns", "HOTA")
    assert "has no HOTA" in refusal(*wrong, "--min-hota", "0.5")


def test_results_are_matched_by_name(truth, results, tmp_path):
    write(results / "c.txt", result_lines())
    assert "unknown sequences: c" in refusal("--truth", truth, "--results", results)
    (results / "c.txt").unlink()
    write(results / "a" / "tracks.txt", result_lines())
    assert "sequence a has two results" in refusal("--truth", truth, "--results", results)
    (results / "a" / "tracks.txt").unlink()
    (results / "b.txt").rename(results / "b.text")
    message = refusal("--truth", truth, "--results", results)
    assert "no result for 1 of 2 sequences: b" in message
    assert "--missing-as-empty" in message
    result = done("--truth", truth, "--results", results, "--missing-as-empty")
    assert table_row(result.stdout, "b")[9] == "20"  # all missed
    assert "no boxes in the results of: b" in result.stdout
    assert "none is x" in refusal("--truth", truth, "--results", write(tmp_path / "x.txt", result_lines()))
    assert "no results are recognised" in refusal("--truth", truth, "--results", truth)
    assert "no such results" in refusal("--truth", truth, "--results", tmp_path / "nowhere")
    assert "nothing to evaluate" in refusal("--truth", truth)


def test_one_file_or_run_fits_one_sequence_whatever_it_is_called(truth, tmp_path):
    figures = []
    for path in (
        write(tmp_path / "x.txt", result_lines()),
        write(tmp_path / "run" / "tracks.txt", result_lines()).parent,
    ):
        result = done("--truth", truth / "a", "--results", path)
        figures.append(table_row(result.stdout, "a"))
        assert result.stderr == ""
    assert figures[0] == figures[1]


def test_figures_that_are_not_the_benchmarks_say_so(tmp_path):
    write_truth(tmp_path / "truth")
    folder = (tmp_path / "truth" / "a").rename(tmp_path / "MOT17-02")
    results = write(tmp_path / "x.txt", result_lines())
    assert "--benchmark MOT17 for its rules" in done("--truth", folder, "--results", results).stdout


def test_results_in_ignored_regions_are_left_out_and_counted(truth, results, tmp_path):
    """The car of the first frames lies in the region too, but is found."""
    write(results / "a.txt", result_lines() + "2,77,2,2,6,6,0.9,-1,-1,-1\n")
    arguments = ("--truth", truth, "--results", results, "--columns", "FP,FN,boxes", "--json", tmp_path / "o.json")
    without = done(*arguments)
    assert "ignored region" not in without.stdout
    assert table_row(without.stdout, "a") == ["1", "0", "20"]
    write(truth / "a" / "ignore.txt", "0,0,20,16\n")
    shown = done(*arguments, "--overwrite").stdout
    assert "left out: 1 box of the result: in an ignored region" in shown
    assert table_row(shown, "a") == ["0", "0", "20"]
    (run,) = json.loads((tmp_path / "o.json").read_text())["runs"]
    assert [one["left_out"] for one in run["sequences"]] == [{"result: in an ignored region": 1}, {}]


def test_ignored_regions_of_ua_detracs_layout_count_under_both_protocols(tmp_path):
    xml = annotation(frame(1, target()), ignored=['left="40" top="0" width="24" height="48"'])
    write_detrac(tmp_path / "truth", xml, pictures=1)
    results = write(tmp_path / "MVI_1.txt", "1,1,2,30,9,9,0.9,-1,-1,-1\n1,2,45,10,9,9,0.9,-1,-1,-1\n")
    for protocol in ("trackeval", "detrac"):
        arguments = ("--truth", tmp_path / "truth", "--results", results, "--protocol", protocol, "--columns", "FP")
        shown = done(*arguments).stdout
        assert table_row(shown, "MVI_1") == ["1"]
        assert "left out: 1 box of the result: in an ignored region" in shown


def test_what_is_left_out_is_named(truth, results):
    write(results / "a.txt", result_lines() + f"{FRAMES + 5},1,5,5,12,10,1,-1,-1,-1\n")
    assert (
        "left out: 1 box of the result: in a frame without truth" in done("--truth", truth, "--results", results).stdout
    )


def test_classes_are_told_apart_by_name(truth, results, tmp_path):
    write(results / "a.txt", result_lines(switch=4, classes=True))
    write(results / "b.txt", result_lines(missing=6, classes=True))
    arguments = ("--truth", truth, "--results", results)
    result = done(*arguments, "--per-class", "--json", tmp_path / "o.json")
    assert table_row(result.stdout, "car")[6:10] == ["1", "0", "0", "0"]
    assert table_row(result.stdout, "bus")[6:10] == ["0", "0", "0", "4"]
    only = done(*arguments, "--classes", "Bus")
    assert table_row(only.stdout, "combined") == table_row(result.stdout, "bus")
    assert "left out: 20 boxes of the result: of another class" in only.stdout
    per_class = json.loads((tmp_path / "o.json").read_text())["runs"][0]["per_class"]
    assert per_class["bus"]["figures"]["misses"] == 4
    assert "class 'unicorn' is not in the truth; it has car, bus" in refusal(*arguments, "--classes", "unicorn")
    write(results / "a.txt", result_lines())
    assert "has boxes without class" in refusal(*arguments, "--classes", "bus")


def jsonl(name: str) -> str:
    header = {"format": "lookonce-tracks", "format_version": 1}
    lines = [header]
    for number in range(FRAMES):
        boxes = [
            {"id": identity, "label": 0, "name": name, "xyxy": [left + number, top, left + number + 12, top + 10]}
            for identity, left, top, _ in (CAR,)
        ]
        lines.append({"frame": number, "tracks": [*boxes, {"id": None, "name": name, "xyxy": [0, 0, 9, 9]}]})
    return "\n".join(map(json.dumps, lines)) + "\n"


def test_a_run_names_its_classes_itself(truth, tmp_path):
    write(tmp_path / "run" / "tracks.jsonl", jsonl("car"))
    result = done("--truth", truth / "a", "--results", tmp_path / "run", "--per-class")
    assert table_row(result.stdout, "car")[3:5] == ["100.0", "100.0"]
    assert "left out: 10 boxes of the result: no identity (yet)" in result.stdout
    write(tmp_path / "run" / "tracks.jsonl", jsonl("dog"))
    message = refusal("--truth", truth / "a", "--results", tmp_path / "run", "--per-class")
    assert "no box is of a class that the truth has (results: dog; truth: car, bus)" in message


def test_benchmarks_have_their_own_rules_and_need_no_pictures(tmp_path):
    gt = truth_lines(tail="1,{cls},1").replace(",2,1\n", ",8,1\n")  # the second object is a distractor
    folder = tmp_path / "MOT17-02"
    write(folder / "gt" / "gt.txt", gt)
    write(folder / "seqinfo.ini", "[Sequence]\nseqLength=12\n")
    results = write(tmp_path / "MOT17-02.txt", result_lines())
    result = done("--truth", folder, "--results", results, "--benchmark", "MOT17", "--columns", "HOTA,boxes,frames")
    truth = read_motchallenge_truth(folder / "gt" / "gt.txt", "MOT17", 12)
    ours = evaluate_tracking(truth, TrackingResult.of_rows(read_mot_results(results)))
    assert table_row(result.stdout, "MOT17-02") == [f"{100 * ours.hota.hota:.1f}", "10", "12"]
    assert "left out: 10 boxes of the result: on a distractor" in result.stdout
    assert "rules of MOT17" in result.stdout
    write(folder / "seqinfo.ini", "[Sequence]\nseqLength=3\n")
    assert "3 frames" in refusal("--truth", folder, "--results", results, "--benchmark", "MOT17")
    assert "goes with the protocol trackeval" in refusal(
        "--truth", folder, "--results", results, "--benchmark", "MOT17", "--protocol", "detrac"
    )


def write_tables(folder: Path, name: str = "MVI_1", missing: int = FRAMES) -> None:
    lefts = [f"{21 + n if n < missing else 0},300" for n in range(FRAMES)]
    columns = {"LX": lefts}
    for part, value in (("LY", 50), ("W", 40), ("H", 30)):
        columns[part] = [f"{value if n < missing else 0},{value}" for n in range(FRAMES)]
    for part, lines in columns.items():
        write(folder / f"{name}_{part}.txt", "\n".join(lines) + "\n")
    write(folder / f"{name}_speed.txt", "25\n")


def test_ua_detracs_files_and_protocol(tmp_path):
    write(tmp_path / "xml" / "MVI_1.xml", detrac_xml())
    write_tables(tmp_path / "results", missing=7)
    result = done("--truth", tmp_path / "xml", "--results", tmp_path / "results", "--protocol", "detrac")
    truth = read_detrac_truth(tmp_path / "xml" / "MVI_1.xml")
    ours = evaluate_tracking(
        truth, TrackingResult.of_rows(read_detrac_results(tmp_path / "results", "MVI_1")), "detrac"
    )
    row = table_row(result.stdout, "MVI_1")
    assert row[:2] == [f"{100 * ours.mota:.1f}", f"{100 * ours.motp:.1f}"]
    assert row[-1] == "10"  # the bus is in the ignored region
    for why, count in ours.left_out.items():
        assert f"left out: {count} boxes of the {why}" in result.stdout
    (tmp_path / "results" / "MVI_1_W.txt").unlink()
    assert "MVI_1_W.txt: no such file" in refusal(
        "--truth", tmp_path / "xml", "--results", tmp_path / "results", "--protocol", "detrac"
    )


def test_kitti_and_ua_detrac_have_the_usual_figures_too(tmp_path):
    objects = [(identity, left, top) for identity, left, top, _ in (CAR, BUS)]
    rows = [f"{n} {one} Car 0 0 0 {x + n} {y} {x + n + 12} {y + 10}" for n in range(FRAMES) for one, x, y in objects]
    kitti = write_kitti(tmp_path / "kitti", "\n".join(rows), pictures=FRAMES)
    write_kitti(kitti, "0 1 Car 0 0 0 5 5 17 15", name="0001", pictures=1)
    detrac = tmp_path / "detrac"
    boxes = [target(one, f'left="{x}" top="{y}" width="12" height="10"') for one, x, y in objects]
    write_detrac(detrac, annotation(*(frame(n + 1, *boxes) for n in range(FRAMES))), pictures=FRAMES)
    for root, names in ((kitti, ("0000", "0001")), (detrac, ("MVI_1",))):
        for name in names:
            write(tmp_path / root.name / "results" / f"{name}.txt", result_lines())
        result = done("--truth", root, "--results", root / "results", "--json", tmp_path / f"{root.name}.json")
        assert table_row(result.stdout, names[0])[-1] == "20"
        truth = json.loads((tmp_path / f"{root.name}.json").read_text())["truth"]
        assert [Path(one["file"]).stem for one in truth] == list(names)


def test_a_folder_for_each_threshold_gives_pr_figures(tmp_path):
    write(tmp_path / "xml" / "MVI_1.xml", detrac_xml())
    for number in range(3):
        write_tables(tmp_path / "results" / f"{number / 10:.1f}", missing=FRAMES - 2 * number)
    for part in ("LX", "LY", "W", "H"):
        write(tmp_path / "results" / "0.3" / f"MVI_1_{part}.txt", "")  # no detection has such a score
    curve = write(tmp_path / "pr.txt", "0.9 0.5\n0.7 0.8\n0.2 0.95\n0 1\n")
    arguments = ("--truth", tmp_path / "xml", "--results", tmp_path / "results", "--protocol", "detrac")
    result = done(*arguments, "--detector-pr", curve, "--json", tmp_path / "o.json")
    truth = read_detrac_truth(tmp_path / "xml" / "MVI_1.xml")
    rows = [read_detrac_results(tmp_path / "results" / name, "MVI_1") for name in ("0.0", "0.1", "0.2", "0.3")]
    scores = [evaluate_tracking(truth, TrackingResult.of_rows(one), "detrac") for one in rows]
    pr = pr_scores(scores, np.array([0.5, 0.8, 0.95, 1]), np.array([0.9, 0.7, 0.2, 0]))
    assert table_row(result.stdout, "trapezoid")[0] == f"{100 * pr.mota:.1f}"
    assert json.loads((tmp_path / "o.json").read_text())["pr"]["figures"]["mota"] == pr.mota
    assert table_row(result.stdout, "0.2")[0] == f"{100 * scores[2].mota:.1f}"
    assert "2 lines for 4 folders" in refusal(*arguments, "--detector-pr", write(tmp_path / "s", "1 0\n0 1\n"))
    assert "share from 0 to 1" in refusal(*arguments, "--detector-pr", write(tmp_path / "s", "1 0\n0 1\n2 0\n0 0\n"))
    assert "name the folder of one threshold" in refusal(*arguments, "--min-mota", "0")


@pytest.mark.parametrize("options", [["--min-hota", "2"], ["--max-switches", "-1"], ["--frobnicate"]])
def test_wrong_usage_is_exit_code_2(options, truth, results):
    assert run("--truth", truth, "--results", results, *options).exit_code == 2


def test_a_sweep_tracks_on_fewer_frames_and_thins_the_truth(square_model, tmp_path):
    folder = write_squares(tmp_path / "squares")
    arguments = (
        "--truth",
        folder,
        "--sweep",
        "every=1,2",
        "--model",
        square_model,
        "--tracker",
        "paper",
        "--threads",
        1,
    )
    result = done(*arguments, "--columns", "mota,idf1,boxes,frames", "--json", tmp_path / "o.json")
    rows = [line.split() for line in result.stdout.splitlines() if line.startswith(" every")]
    assert rows == [["every", "1", "100.0", "100.0", "36", "12"], ["every", "2", "100.0", "100.0", "18", "6"]]
    assert [line for line in result.stderr.splitlines() if "every 2" in line] == ["every 2: squares: 6 of 6, frames"]
    content = json.loads((tmp_path / "o.json").read_text())
    assert content["sweep"]["every"] == [1, 2]
    assert len(content["sweep"]["model"]["sha256"]) == 64
    assert "such as every=1,2,4,8" in refusal("--truth", folder, "--sweep", "every=0", "--model", square_model)
    assert "tracks by itself" in refusal("--truth", folder, "--sweep", "every=2", "--results", folder)


def test_a_sweep_over_a_video(square_clip, square_model, tmp_path):
    folder = write_squares(tmp_path / "squares")
    result = done(
        *(
            "--truth",
            folder,
            "--frames",
            square_clip,
            "--sweep",
            "every=3",
            "--model",
            square_model,
            "--tracker",
            "paper",
        ),
        *("--columns", "mota,boxes"),
    )
    assert table_row(result.stdout, "squares") == ["100.0", "12"]


@pytest.mark.data
def test_real_sequences_are_scored_as_by_the_function(data_folder, tmp_path):
    folder, clip = data_folder / "sequences", data_folder / "videos" / "haarcascades_video2.avi"
    for name, extra in (("PETS09-S2L1", ()), ("highway2", ("--frames", clip))):
        lines = (folder / name / "gt" / "gt.txt").read_text().split()
        results = write(tmp_path / f"{name}.txt", "\n".join(line for n, line in enumerate(lines) if n % 7) + "\n")
        for protocol in ("trackeval", "detrac"):
            out = tmp_path / f"{name}-{protocol}.json"
            done("--truth", folder / name, *extra, "--results", results, "--protocol", protocol, "--json", out)
            (sequence,) = open_sequences(folder / name, pictures=clip if extra else None)
            truth = TrackingTruth.of_sequence(sequence)
            ours = evaluate_tracking(truth, TrackingResult.of_rows(read_mot_results(results)), protocol)
            figures = json.loads(out.read_text())["runs"][0]["combined"]["figures"]
            assert figures["mota"] == (ours.clear.mota if protocol == "trackeval" else ours.mota)
            assert figures["truth_boxes"] > 2000
