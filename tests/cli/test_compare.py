"""`lookonce compare` as a person runs it: real files, run inside this process; trackers in processes of their own."""

from __future__ import annotations

import csv
import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest

from cli.running import Command
from compare.panning import PAN_PX, write_pan
from lookonce.cli import compare_scenes
from lookonce.cli.compare_detrac import THRESHOLDS
from lookonce.cli.compare_scenes import look_at_pictures
from lookonce.compare.cameras import camera_motions
from lookonce.compare.contenders.registry import contenders
from lookonce.compare.detection_store import read_detections
from lookonce.make.darknet.importer import import_darknet
from make.probing.labelled_squares import truth_lines, write_squares
from squares import SIZE, write_darknet
from test_ua_detrac_recipe import HEIGHT, TEST, WIDTH, write_detrac

FRAMES = 12
OWN = "iou,kiou,lookonce-paper,oracle"
COMMAND = Command("compare", columns=200)
run, done, refusal = COMMAND.run, COMMAND.done, COMMAND.refusal


def figures(path: Path, tracker: str, every: int = 1) -> dict[str, float]:
    (row,) = (one for one in json.loads(path.read_text())["rows"] if (one["tracker"], one["every"]) == (tracker, every))
    return row["figures"]


@pytest.fixture
def squares(tmp_path: Path) -> Path:
    return write_squares(tmp_path / "squares", FRAMES)


@pytest.fixture
def det_file(tmp_path: Path) -> Path:
    """The truth as others' detections, one of them missed and one of low score."""
    lines = [line.split(",") for line in truth_lines(FRAMES)]
    del lines[10]
    rows = [
        [frame, "-1", *box, "0.15" if number == 20 else "0.9"]
        for number, (frame, _, *box, _, _, _, _) in enumerate(lines)
    ]
    path = tmp_path / "det.txt"
    path.write_text("".join(",".join(row) + "\n" for row in rows))
    return path


def test_trackers_stand_side_by_side_at_every_frame_rate(tmp_path: Path, squares: Path, square_model: Path) -> None:
    out = tmp_path / "out"
    arguments = ("--truth", squares, "-m", square_model, "--trackers", OWN, "--every", "1,3", "-o", out)
    shown = done(*arguments, "--json", tmp_path / "all.json", "--csv", tmp_path / "all.csv").stdout
    assert "protocol trackeval" in shown
    assert "in detect" in shown  # the descriptors of one look
    content = json.loads((tmp_path / "all.json").read_text())
    assert [(row["every"], row["tracker"]) for row in content["rows"]] == [
        (every, name) for every in (1, 3) for name in OWN.split(",")
    ]
    assert {"command", "machine", "versions", "model_sha256", "protocol"} <= content.keys()
    assert figures(tmp_path / "all.json", "lookonce-paper")["idf1"] == 1  # colours do not change
    assert figures(tmp_path / "all.json", "oracle", 3)["idf1"] == 1
    assert figures(tmp_path / "all.json", "iou")["true_positives"] == 0  # squares jump by their own size
    with (tmp_path / "all.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 8
    assert float(rows[2]["detect_s"]) > 0
    assert float(rows[2]["associate_s"]) > 0


@pytest.mark.parametrize("protocol", ["trackeval", "detrac"])
def test_eval_says_the_same_of_the_files(tmp_path: Path, squares: Path, square_model: Path, protocol: str) -> None:
    out = tmp_path / "out"
    done("--truth", squares, "-m", square_model, "--trackers", OWN, "-o", out, "--protocol", protocol)
    for name in OWN.split(","):
        results = out / "every-1" / name
        again = tmp_path / f"{name}.json"
        Command("eval").done(
            "--truth",
            squares,
            "--results",
            results,
            "--missing-as-empty",
            "--protocol",
            protocol,
            "--json",
            again,
        )
        expected = json.loads(again.read_text())["runs"][0]["combined"]["figures"]
        assert figures(out / "results.json", name) == expected


def test_detections_are_found_once_and_kept(tmp_path: Path, squares: Path, square_model: Path) -> None:
    arguments = ("--truth", squares, "-m", square_model, "--trackers", "lookonce-paper", "-o", tmp_path / "out")
    done(*arguments)
    (kept,) = (tmp_path / "out" / "detections").iterdir()
    before = kept.stat().st_mtime_ns
    done(*arguments, "--overwrite")
    assert kept.stat().st_mtime_ns == before
    done(*arguments, "--overwrite", "--score", "0.3")  # other detections
    assert len(list(kept.parent.iterdir())) == 2


def test_detections_of_others_leave_out_who_needs_descriptors(tmp_path: Path, squares: Path, det_file: Path) -> None:
    out = tmp_path / "out"
    shown = done("--truth", squares, "--detections", det_file, "--trackers", OWN, "-o", out).stdout
    assert "lookonce paper: left out: the detections have no descriptors" in shown
    content = {row["tracker"]: row for row in json.loads((out / "results.json").read_text())["rows"]}
    assert content["lookonce-paper"]["figures"] is None
    assert content["oracle"]["figures"]["misses"] == 1
    assert content["oracle"]["figures"]["false_positives"] == 0
    assert content["kiou"]["seconds_a_frame"]["detect_s"] == 0


def test_detections_of_others_come_with_the_size_of_the_pictures(tmp_path: Path, squares: Path, det_file: Path) -> None:
    kept, out = tmp_path / "kept", tmp_path / "out"
    done("--truth", squares, "--detections", det_file, "--trackers", "iou", "--cache", kept, "-o", out)
    (stored,) = kept.glob("*.npz")
    assert read_detections(stored).sequence.size == (SIZE, SIZE)


def test_the_camera_is_followed_at_each_frame_rate_and_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Speckles that shift by 3 px a frame, and a box that shifts with them."""
    folder, frames = write_pan(tmp_path / "pan" / "img1", 9, PAN_PX).parent, range(9)
    (folder / "gt").mkdir()
    boxes = [f"{100 - PAN_PX * frame},100,30,60" for frame in frames]
    (folder / "gt" / "gt.txt").write_text("".join(f"{n + 1},1,{box},1,1,1\n" for n, box in enumerate(boxes)))
    found = tmp_path / "det.txt"
    found.write_text("".join(f"{n + 1},-1,{box},0.9\n" for n, box in enumerate(boxes)))
    arguments = ("--truth", folder, "--detections", found, "--cache", tmp_path / "kept", "-o", tmp_path / "out")

    def cameras(trackers: str, *more: str) -> dict[int, dict[int, np.ndarray]]:
        done(*arguments, "--trackers", trackers, *more)
        (stored,) = (tmp_path / "kept").glob("*.npz")
        return read_detections(stored).sequence.cameras

    assert cameras("iou") == {}  # it does not ask
    two = cameras("lookonce-iou", "--every", "2", "--overwrite")
    assert {step: sorted(maps) for step, maps in two.items()} == {2: [2, 4, 6, 8]}
    np.testing.assert_allclose(two[2][4], [[1, 0, -2 * PAN_PX], [0, 1, 0]], atol=0.6)
    looked: list[int] = []

    def noted(pictures: Path, fps: float | None, every: int, *rest: object) -> object:
        looked.append(every)
        return camera_motions(pictures, fps, every, *rest)

    monkeypatch.setattr(compare_scenes, "camera_motions", noted)
    both = cameras("lookonce-iou", "--every", "1,2", "--overwrite")
    assert (looked, sorted(both)) == ([1], [1, 2])
    cameras("lookonce-iou", "--every", "2", "--score", "0.3", "--overwrite")
    assert looked == [1, 2]  # other boxes hide the ground


def test_detections_of_others_do_without_pictures_that_cannot_be_read(tmp_path: Path, squares: Path) -> None:
    (tmp_path / "empty").mkdir()
    assert look_at_pictures(tmp_path / "none") == (None, "")
    assert look_at_pictures(tmp_path / "empty") == (None, "")
    (squares / "img1" / "zz.png").symlink_to(tmp_path / "none")
    assert look_at_pictures(squares / "img1") == (None, "")


def test_results_in_ignored_regions_are_left_out_for_every_tracker(tmp_path: Path, squares: Path) -> None:
    """The same false detection in every frame, where truth is not told; the oracle gives it no identity at all."""
    lines = [line.split(",") for line in truth_lines(FRAMES)]
    rows = [[frame, "-1", *box, "0.9"] for frame, _, *box, _, _, _, _ in lines]
    rows += [[str(frame + 1), "-1", "50", "50", "12", "12", "0.9"] for frame in range(FRAMES)]
    (tmp_path / "det.txt").write_text("".join(",".join(row) + "\n" for row in rows))
    arguments = ("--truth", squares, "--detections", tmp_path / "det.txt", "--trackers", "iou,kiou,oracle")
    done(*arguments, "-o", tmp_path / "before")
    (squares / "ignore.txt").write_text("48,48,16,16\n")
    done(*arguments, "-o", tmp_path / "after")
    contents = [json.loads((tmp_path / name / "results.json").read_text()) for name in ("before", "after")]
    for before, after, count in zip(*(one["rows"] for one in contents), (FRAMES, FRAMES, 0), strict=True):
        assert before["left_out"] == {}
        assert after["left_out"] == ({"result: in an ignored region": count} if count else {})
        assert before["figures"]["false_positives"] - after["figures"]["false_positives"] == count
        assert before["figures"]["true_positives"] == after["figures"]["true_positives"]
        assert after["sequences"]["squares"] == after["figures"]


def test_a_model_describes_the_boxes_of_others(
    tmp_path: Path, squares: Path, det_file: Path, square_model: Path
) -> None:
    def compare(name: str, *more: object) -> tuple[str, dict[str, dict]]:
        arguments = ("--truth", squares, "--detections", det_file, "--trackers", OWN, "--cache", tmp_path / "cache")
        shown = done(*arguments, "-o", tmp_path / name, *more).stdout
        return shown, json.loads((tmp_path / name / "results.json").read_text())

    shown, content = compare("described", "-m", square_model)
    assert "descriptors of squares.onnx at their boxes" in " ".join(shown.split())
    assert {"detections", "model", "model_sha256"} <= content.keys()
    _, without = compare("plain")
    assert "model" not in without
    found, others = ({row["tracker"]: row for row in one["rows"]} for one in (content, without))
    assert found["lookonce-paper"]["figures"]["idf1"] > 0.7  # colours do not change; two boxes are missed
    assert found["lookonce-paper"]["seconds_a_frame"]["describe_s"] > 0
    assert not found["lookonce-paper"]["seconds_a_frame"]["is_one_look"]
    for name in ("iou", "kiou", "oracle"):  # who does not look at descriptors has the same detections
        assert found[name]["figures"] == others[name]["figures"]
    assert found["iou"]["seconds_a_frame"]["describe_s"] == 0


def test_descriptors_at_the_boxes_of_others_are_read_once(
    tmp_path: Path, squares: Path, det_file: Path, square_model: Path
) -> None:
    source = ("--truth", squares, "--detections", det_file, "-m", square_model)
    arguments = (*source, "--trackers", "lookonce-paper", "-o", tmp_path / "out")
    done(*arguments)
    (kept,) = (tmp_path / "out" / "detections").iterdir()
    before = kept.stat().st_mtime_ns
    done(*arguments, "--overwrite")
    assert kept.stat().st_mtime_ns == before
    det_file.write_text(det_file.read_text().replace("0.9\n", "0.8\n"))  # other detections under the same name
    done(*arguments, "--overwrite")
    done(*arguments, "--overwrite", "-m", "street")
    assert len(list(kept.parent.iterdir())) == 3


def test_descriptors_at_the_boxes_of_others_need_pictures(
    tmp_path: Path, squares: Path, det_file: Path, square_model: Path
) -> None:
    (squares / "img1").rename(tmp_path / "elsewhere")
    arguments = ("--truth", squares, "--detections", det_file, "-m", square_model, "-o", tmp_path / "out")
    assert "no such pictures" in refusal(*arguments)


def without_trackers(monkeypatch: pytest.MonkeyPatch) -> None:
    """As if the package of that name were not installed."""
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *more: None if name == "trackers" else find(name, *more)
    )


def test_missing_package_is_named_and_the_others_run(
    tmp_path: Path, squares: Path, det_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    without_trackers(monkeypatch)
    out = tmp_path / "out"
    shown = done("--truth", squares, "--detections", det_file, "--trackers", "sort,iou", "-o", out).stdout
    assert "SORT: not installed: pip install trackers" in shown
    content = {row["tracker"]: row for row in json.loads((out / "results.json").read_text())["rows"]}
    assert content["sort"]["figures"] is None
    assert content["iou"]["figures"] is not None


def test_nothing_is_detected_where_no_tracker_is_installed(
    tmp_path: Path, squares: Path, square_model: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    without_trackers(monkeypatch)
    arguments = ("--truth", squares, "-m", square_model, "-o", tmp_path / "out")
    assert "not installed: sort, bytetrack; pip install" in refusal(*arguments, "--trackers", "sort,bytetrack")
    assert not (tmp_path / "out").exists()
    assert "oracle" in done(*arguments, "--trackers", "sort,oracle").stdout


def test_tracker_that_needs_too_long_is_named(
    tmp_path: Path, squares: Path, det_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("lookonce.compare.running.TrackerProcess._ask", _too_slow)
    shown = done("--truth", squares, "--detections", det_file, "--trackers", "iou", "-o", tmp_path / "out").stdout
    assert "IOU: squares: over 300 s" in shown


def _too_slow(self: object, job: object) -> object:
    from lookonce.compare.jobs import Answer

    return Answer(error="over 300 s")


def test_markdown_names_what_made_it_and_published_rows(tmp_path: Path, squares: Path, det_file: Path) -> None:
    arguments = ("--truth", squares, "--detections", det_file, "--trackers", "iou", "-o", tmp_path / "out")
    shown = done(*arguments, "--markdown", "--published").stdout
    assert "| tracker | from score | MOTA |" in shown
    assert all(f"- {name}: `" in shown for name in ("command", "machine", "versions"))
    assert "| EB | KIOU | 62.1 | 81.9 |" in shown
    assert "| the published method | 207.6 |" in shown
    assert shown.count("as published, not made here") == 3
    assert "as published" not in done(*arguments, "--overwrite").stdout


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        pytest.param(["--score", "0.2"], "--truth", id="nothing"),
        pytest.param(["--truth", "a", "--ua-detrac", "b"], "--truth", id="both"),
        pytest.param(["--truth", "a", "--trackers", "sorrt"], "no tracker 'sorrt'", id="tracker"),
        pytest.param(["--truth", "a", "--every", "1,1"], "--every", id="every"),
        pytest.param(["--truth", "a", "--every", "0"], "--every", id="every-0"),
        pytest.param(["--truth", "a", "--protocol", "x"], "--protocol", id="protocol"),
        pytest.param(["--ua-detrac", "a", "--every", "2"], "--every", id="every-detrac"),
        pytest.param(["--ua-detrac", "nowhere"], "DETRAC-Test-Annotations-XML", id="no-annotations"),
        pytest.param(["--truth", "nowhere"], "no such folder", id="no-truth"),
        pytest.param(["--truth", "a", "--columns", "PR"], "unknown column", id="column"),
    ],
)
def test_wrong_arguments_get_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], expected: str
) -> None:
    monkeypatch.chdir(tmp_path)
    assert expected in refusal(*arguments)


def test_earlier_results_are_not_replaced_unasked(tmp_path: Path, squares: Path, det_file: Path) -> None:
    arguments = ("--truth", squares, "--detections", det_file, "--trackers", "iou", "-o", tmp_path / "out")
    done(*arguments)
    assert "--overwrite" in refusal(*arguments)
    assert "no such file" in refusal(*arguments, "--overwrite", "--detections", tmp_path / "absent.txt")
    assert "--classes go with a model" in refusal(*arguments, "--overwrite", "--classes", "red")


def test_trackers_are_all_taken_without_a_choice() -> None:
    names = list(contenders())
    assert names[:3] == ["gog", "iou", "kiou"]
    assert {"jpda", "mht", "sort", "bytetrack", "ocsort", "botsort", "cbiou", "visualsort", "crops"} < set(names)


@pytest.fixture(scope="module")
def detrac(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """UA-DETRAC's folders with drawn squares, and a detector for them."""
    folder = tmp_path_factory.mktemp("detrac")
    write_detrac(folder / "DETRAC")
    cfg, weights, names = write_darknet(folder)
    import_darknet(cfg, weights, folder / "model.onnx", names=names, size=(HEIGHT, WIDTH))
    return folder


def test_whole_experiment_of_ua_detrac(detrac: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    shown = done("--ua-detrac", detrac / "DETRAC", "-m", detrac / "model.onnx", "--trackers", OWN, "-o", out).stdout
    for text in ("PR-MOTA", "table 1", "table 2", "the published method", "as published", "made here", "EB + KIOU"):
        assert text in shown
    folders = [f"{threshold:.1f}" for threshold in THRESHOLDS]
    for name in (*OWN.split(","), "detector"):
        assert sorted(path.name for path in (out / name).iterdir()) == sorted(folders)
        assert sorted(path.name for path in (out / name / "0.0").iterdir()) == [f"{one}.txt" for one in TEST]
    curve = np.loadtxt(out / "detection_PR.txt")
    assert curve.shape == (11, 2)
    assert ((curve >= 0) & (curve <= 1)).all()
    # `lookonce eval` gives the same figures of the folders
    again = tmp_path / "again.json"
    xml = detrac / "DETRAC" / "DETRAC-Test-Annotations-XML"
    pr = ("--detector-pr", out / "detection_PR.txt", "--protocol", "detrac", "--missing-as-empty")
    Command("eval").done("--truth", xml, "--results", out / "lookonce-paper", *pr, "--json", again)
    expected = json.loads(again.read_text())
    rows = [row for row in json.loads((out / "results.json").read_text())["rows"] if row["tracker"] == "lookonce-paper"]
    (best,) = (row for row in rows if row["pr"] is not None)
    assert best["pr"] == expected["pr"]["figures"]
    by_threshold = {f"{row['threshold']:.1f}": row["figures"] for row in rows if row["pr"] is None}
    assert by_threshold == {one["name"]: one["combined"]["figures"] for one in expected["runs"]}
    assert best["figures"]["mota"] == max(one["mota"] for one in by_threshold.values())


def test_ua_detrac_with_published_detections(detrac: Path, tmp_path: Path) -> None:
    folder = tmp_path / "EB"
    folder.mkdir()
    for name in TEST:
        (folder / f"{name}_Det_EB.txt").write_text("".join(f"{n},1,{8 * n},80,8,8,0.{n % 10}5\n" for n in range(1, 21)))
    out = tmp_path / "out"
    arguments = ("--ua-detrac", detrac / "DETRAC", "--detections", folder, "--trackers", OWN, "-o", out)
    shown = done(*arguments).stdout
    assert "lookonce paper: left out: the detections have no descriptors" in shown
    assert len(np.loadtxt(out / "detection_PR.txt")) == 11
    described = done(*arguments, "--overwrite", "-m", detrac / "model.onnx").stdout
    assert "descriptors of model.onnx at their boxes" in " ".join(described.split())
    assert "left out" not in described


def test_tracker_too_slow_for_many_detections_is_ranked_by_the_rest(
    detrac: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from lookonce.compare.jobs import Answer, Job
    from lookonce.compare.running import TrackerProcess

    ask = TrackerProcess._ask

    def slow(self: TrackerProcess, job: Job) -> Answer:
        return Answer(error="over 300 s") if job.min_score < 0.2 else ask(self, job)

    monkeypatch.setattr(TrackerProcess, "_ask", slow)
    out = tmp_path / "out"
    arguments = ("-m", detrac / "model.onnx", "--trackers", "lookonce-paper", "-o", out)
    shown = done("--ua-detrac", detrac / "DETRAC", *arguments).stdout
    assert f"lookonce paper: {TEST[0]}: over 300 s (threshold 0.0, threshold 0.1)" in shown
    rows = json.loads((out / "results.json").read_text())["rows"]
    assert [row["threshold"] for row in rows if row["figures"] is None] == [0.0, 0.1]
    assert all(row["pr"] is None for row in rows)
    (line,) = (line for line in shown.splitlines() if "made here" in line and line.split()[-1] == "-")
    assert "lookonce paper" in line


@pytest.mark.slow
@pytest.mark.data
@pytest.mark.slow
def test_appearance_helps_public_detections_at_a_low_frame_rate(data_folder: Path, tmp_path: Path) -> None:
    """PETS at 0.9 frames a second: persons have moved on, and boxes alone are a guess."""
    pets = data_folder / "sequences" / "PETS09-S2L1"
    source = ("--truth", pets, "--detections", pets / "det" / "det.txt", "--fps", 7, "--every", 8)
    found = {}
    for name, more in (("boxes", ()), ("described", ("-m", "street"))):
        done(*source, *more, "--trackers", "lookonce-default", "-o", tmp_path / name)
        found[name] = figures(tmp_path / name / "results.json", "lookonce-default", 8)
    assert found["boxes"]["idf1"] > 0.45
    assert found["described"]["idf1"] > max(0.65, found["boxes"]["idf1"] + 0.1)
