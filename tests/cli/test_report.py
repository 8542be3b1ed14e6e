"""`lookonce report` as a person runs it: real files, run inside this process, which is faster."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import time
from pathlib import Path

import pytest
from typer.testing import Result

from cli.evaluated import detrac_xml, result_lines, truth_lines, write_truth
from cli.evaluated import done as evaluated
from cli.running import Command
from datasets.making import write, write_detrac
from make.probing.labelled_squares import write_squares
from report.scenes import HEADER, TRACKS_HEADER, write_lines
from report.test_page import Reading

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
COMMAND = Command("report")
run, refusal = COMMAND.run, COMMAND.refusal


def done(page: Path, *arguments: object) -> tuple[str, Result]:
    """The page, and what was said about it."""
    result = run("-o", page, "--overwrite", *arguments)
    assert result.exit_code == 0, (result.stderr, result.exception)
    return page.read_text(encoding="utf-8"), result


def shown(text: str) -> str:
    return " ".join(" ".join(Reading(text).texts).split())


@pytest.fixture
def truth(tmp_path: Path) -> Path:
    return write_truth(tmp_path / "truth")


@pytest.fixture
def results(tmp_path: Path) -> Path:
    write(tmp_path / "results" / "a.txt", result_lines(switch=4, classes=True))
    write(tmp_path / "results" / "b.txt", result_lines(switch=7, missing=6, classes=True))
    return tmp_path / "results"


def track(frame: int, identity: int | None, left: float, name: str = "car") -> dict[str, object]:
    return {"id": identity, "label": 0, "name": name, "xyxy": [left, 5, left + 12, 15], "score": 0.9 - frame / 100}


def write_run(folder: Path, source: object = "", ids: tuple[int, ...] = (1, 1, 1, 4, 4, 4)) -> Path:
    """A run of a car that changes its identity, with its header."""
    settings = {"source": str(source), "tracker": "paper"}
    frames = [
        {"frame": n, "time_s": n / 10, "size": [48, 64], "tracks": [track(n, one, 6 + n)]} for n, one in enumerate(ids)
    ]
    write_lines(folder / "tracks.jsonl", {**TRACKS_HEADER, "settings": settings}, *frames)
    return folder


def explain(folder: Path, *records: object) -> None:
    write_lines(folder / "explain.jsonl", HEADER, *records)


@pytest.mark.parametrize("protocol", ["trackeval", "detrac"])
@pytest.mark.parametrize("options", [(), ("--classes", "car")], ids=["all", "car"])
def test_figures_are_those_of_eval(protocol, options, truth, results, tmp_path):
    other = tmp_path / "other"
    for name in ("a", "b"):
        write(other / name / "tracks.txt", result_lines(classes=True))
    options = ("--truth", truth, "--protocol", protocol, *options)
    evaluated(*options, "--results", results, "--results", f"best={other}", "--json", tmp_path / "o.json")
    runs = json.loads((tmp_path / "o.json").read_text())["runs"]
    text, _ = done(tmp_path / "o.html", results, f"best={other}", *options)
    headings = list(dict.fromkeys(re.findall(r'<abbr title="[^"]*">(\w+)</abbr>', text)))
    rows = re.findall(
        r'<tr(?: data-sequence="\w+")?><th scope="row">(\w+)</th><td class="t">(\w+)</td>(.*?)</tr>', text
    )
    written = {row[:2]: re.findall(r'data-v="([^"]*)"', row[2]) for row in rows}
    assert len(written) == 6
    names = {"MOTA": "mota", "IDSW": "id_switches", "FP": "false_positives", "FN": "misses", "boxes": "truth_boxes"}
    names |= {"HOTA": "hota", "IDF1": "idf1"} if protocol == "trackeval" else {"Rcll": "recall"}
    for one in runs:
        parts = {part["name"]: part for part in one["sequences"]} | {"combined": one["combined"]}
        for sequence, part in parts.items():
            values = dict(zip(headings, written[sequence, one["name"]], strict=True))
            assert {name: values[name] for name in names} == {
                name: f"{part['figures'][figure]:.6g}" for name, figure in names.items()
            }
    counted = [part["figures"]["id_switches"] for one in runs for part in one["sequences"]]
    assert sorted(map(int, re.findall(r"Identity switches \((\d+)\)", text))) == sorted(counted)
    assert sum(counted) == 2
    expected = {(one["name"], why): f"{n:,}" for one in runs for why, n in one["combined"]["left_out"].items()}
    table = text[text.index("<h3>Left out</h3>") : text.index("<article")]
    told = re.findall(r'<th scope="row">(\w+)</th><td class="t">([^<]*)</td><td>([\d,]+)</td>', table)
    assert {(name, why): count for name, why, count in told} == expected
    assert ("of another class" in text) == ("car" in options)


def test_what_is_said_while_it_works_and_at_its_end(truth, results, tmp_path):
    _, result = done(tmp_path / "o.html", results, "--truth", truth)
    assert result.stderr.splitlines() == [
        "read results: 2 of 2, results",
        "judge results: 2 of 2, sequences",
        "pictures of a: 3 of 3",
        "pictures of b: 3 of 3",
    ]
    (line,) = result.stdout.splitlines()
    assert re.fullmatch(
        rf"written {tmp_path}/o.html: 0\.\d MB, 2 sequences, 1 run, 2 identity switches, 2 in pictures, in \d+\.\d s",
        line,
    )


def test_switches_have_pictures_up_to_a_number(truth, results, tmp_path):
    text, _ = done(tmp_path / "o.html", results, "--truth", truth)
    assert text.count("<figcaption>before, frame 3</figcaption>") == 1
    assert text.count("<figcaption>now, frame 7</figcaption>") == 1
    text, _ = done(tmp_path / "o.html", results, "--truth", truth, "--max-switches", 1)
    assert text.count("<figcaption>now") == 1
    assert "1 of 2 switches are shown in pictures" in text
    text, _ = done(tmp_path / "o.html", results, "--truth", truth, "--no-pictures")
    assert "image/jpeg" not in text
    assert "as asked for" in text


def test_truth_without_pictures_makes_a_page_that_says_so(results, tmp_path):
    xml = write(tmp_path / "MVI_1.xml", detrac_xml())
    text, _ = done(tmp_path / "o.html", results / "a.txt", "--truth", xml, "--protocol", "detrac")
    assert "No pictures were found for MVI_1; name them with --frames" in text
    assert "image/jpeg" not in text
    assert "Protocol detrac" in text
    assert "in an ignored region" in text
    write_detrac(tmp_path / "d", detrac_xml(), pictures=10)
    text, _ = done(tmp_path / "o.html", results / "a.txt", "--truth", tmp_path / "d", "--protocol", "detrac")
    assert "No pictures" not in text
    assert "image/jpeg" in text


def test_without_truth_pictures_come_from_where_the_run_had_them(truth, tmp_path):
    text, result = done(tmp_path / "o.html", write_run(tmp_path / "mine", truth / "a"))
    words = shown(text)
    assert "Tracking report: 1 sequence, without truth. Run: mine." in words
    assert "6 frames; 2 identities with 6 boxes" in words
    assert "Doubtful places (1)" in words
    assert text.count("<figcaption>") == 2
    assert "Frame 3 (0.30 s)" in words
    assert "1 doubt, 1 in pictures" in result.stdout
    for source in ("http://example.org/a.mp4", "0", tmp_path / "gone.mp4", "/dev/null"):
        text, _ = done(tmp_path / "o.html", write_run(tmp_path / "mine", source))
        assert "No pictures were found for mine" in text
    text, _ = done(tmp_path / "o.html", tmp_path / "mine", "--frames", truth / "a")
    assert text.count("<figcaption>") == 2


def test_many_runs_without_truth_stand_side_by_side(tmp_path):
    for run_name in ("x", "y"):
        for name in ("s1", "s10", "s2"):
            write_run(tmp_path / run_name / name)
    write(tmp_path / "y" / "s3.txt", result_lines())
    text, _ = done(tmp_path / "o.html", tmp_path / "x", f"second={tmp_path / 'y'}")
    assert re.findall(r'<h2 id="s\d">(\w+)</h2>', text) == ["s1", "s2", "s3", "s10"]
    assert re.findall(r"<h3>Run (\w+)</h3>", text) == ["x", "second"] * 2 + ["second"] + ["x", "second"]
    assert "--frames fits one sequence" in refusal(tmp_path / "x", "--frames", tmp_path)
    assert "check --frames" in refusal(tmp_path / "x" / "s1", "--frames", tmp_path / "no")


def test_an_explained_run_says_why(truth, tmp_path):
    folder = write_run(tmp_path / "a", ids=(1, 1, 1, 4, 4, 4))
    candidate = {"id": 1, "cost": 0.8, "refused": "<b>too far</b>"}
    explain(
        folder,
        {"frame": 2, "rows": [{"id": 1, "decision": "kept"}], "ended": []},
        {"frame": 3, "rows": [{"id": 4, "decision": "new", "reason": "nobody near", "candidates": [candidate]}]},
    )
    text, _ = done(tmp_path / "o.html", folder, "--truth", truth / "a")
    assert "new: nobody near" in text
    assert "Identity 1 was considered (cost 0.8) and refused: &lt;b&gt;too far&lt;/b&gt;." in text
    assert "What the tracker decided" in text
    text, _ = done(tmp_path / "o.html", folder)
    assert "nobody near; identity 1 (cost 0.8), refused: &lt;b&gt;too far&lt;/b&gt;" in text
    explain(folder, {"frame": "x"})
    assert "explain.jsonl:2: frame: expected" in refusal(folder, "-o", tmp_path / "p.html")
    assert not (tmp_path / "p.html").exists()


def test_the_curve_holds_all_detections_of_the_json_lines(truth, tmp_path):
    folder = write_run(tmp_path / "a", ids=(1, 1, None, 4, 4, 4))  # type: ignore[arg-type]
    write(folder / "tracks.txt", "1,1,6,5,12,10,0.9,-1,-1,-1\n")
    text, _ = done(tmp_path / "o.html", folder, "--truth", truth / "a")
    (row,) = re.findall(r"</svg> a</th>(.*?)</tr>", text)
    assert re.findall("<td>(.*?)</td>", row)[0] == "6"
    assert "1 detections without identity" in text
    write(tmp_path / "c.txt", "1,1,6,5,12,10,1,-1,-1,-1\n")
    text, _ = done(tmp_path / "o.html", tmp_path / "c.txt", "--truth", truth / "a")
    assert "No precision-recall curve for c" in text


def test_descriptors_of_a_model(square_model, tmp_path):
    folder = write_squares(tmp_path / "squares")
    run_folder = write_lines(
        tmp_path / "run" / "tracks.jsonl", TRACKS_HEADER, {"frame": 0, "tracks": [track(0, 1, 3)]}
    ).parent
    text, result = done(tmp_path / "o.html", run_folder, "--truth", folder, "--model", square_model, "--threads", 1)
    assert "36 of 3 objects in 12 frames" in text
    assert "describe squares: 12 of 12" in result.stderr
    text, _ = done(tmp_path / "o.html", run_folder, "--truth", folder)
    assert "Give the model file (--model)" in text
    assert "no such model" in refusal(run_folder, "--truth", folder, "--model", tmp_path / "no.onnx").lower()


def test_the_same_input_gives_the_same_bytes(truth, results, tmp_path):
    pages = [done(tmp_path / name, results, "--truth", truth)[0] for name in ("1.html", "2.html")]
    assert pages[0] == pages[1]
    assert str(time.localtime().tm_year) not in shown(pages[0])


def test_hostile_files_make_a_tame_page(truth, tmp_path):
    name = "<img src=x onerror=alert(1)>"
    folder = write_run(tmp_path / name, source="<script>alert(1)</script>")
    lines = (folder / "tracks.jsonl").read_text().replace('"name": "car"', '"name": "<script>alert(2)</script>"')
    (folder / "tracks.jsonl").write_text(lines)
    for arguments in ((), ("--truth", truth / "a")):
        text, _ = done(tmp_path / "o.html", folder, *arguments)
        page = Reading(text)
        assert len(page.all("script")) == 1
        assert page.all("img") == []
        assert name in shown(text)


def test_earlier_pages_are_kept_unless_told_otherwise(results, truth, tmp_path):
    kept = write(tmp_path / "o.html", "earlier")
    assert "--overwrite" in refusal(results, "--truth", truth, "-o", kept)
    assert kept.read_text() == "earlier"
    done(kept, results, "--truth", truth)
    assert kept.read_text() != "earlier"
    assert "not there" in refusal(results, "--truth", truth, "-o", tmp_path / "no" / "o.html")


def test_wrong_input_gets_one_line(truth, results, tmp_path):
    page = ("-o", tmp_path / "o.html")
    for options in (("--classes", "car"), ("--model", "street"), ("--benchmark", "MOT17"), ("--missing-as-empty",)):
        assert "name it with --truth" in refusal(results, *options, *page)
    assert "expected one of trackeval" in refusal(results, "--truth", truth, "--protocol", "mine", *page)
    assert "no such rules" in refusal(results, "--truth", truth, "--protocol", "detrac", "--benchmark", "MOT17", *page)
    assert "no such results" in refusal(tmp_path / "nowhere", "--truth", truth, *page)
    twice = refusal(results / "a.txt", tmp_path / "results" / "a.txt", *page)
    assert "name them: NAME=PATH" in twice
    assert "no results are recognised" in refusal(truth, "--truth", truth, *page)
    assert "class 'tram' is not in the truth" in refusal(results, "--truth", truth, "--classes", "tram", *page)
    write(tmp_path / "empty.txt", "")
    assert "hold no box" in refusal(tmp_path / "empty.txt", "--truth", truth / "a", *page)
    done(tmp_path / "o.html", tmp_path / "empty.txt", "--truth", truth / "a", "--missing-as-empty")
    assert run("--max-switches", "-1", results).exit_code == 2


def test_what_does_not_count_is_said(truth, results, tmp_path):
    write(truth / "a" / "ignore.txt", "0,0,64,48\n")
    write(results / "a.txt", result_lines() + "2,77,2,2,6,6,0.9,-1,-1,-1\n")
    (results / "b.txt").unlink()
    text, _ = done(tmp_path / "o.html", results, "--truth", truth, "--missing-as-empty")
    assert "result: in an ignored region" in text
    assert "No boxes in the results of run results for: b." in text


def a_browser() -> str:
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        pytest.skip("no Chromium here; install the package chromium")
    return browser


def test_the_script_runs_under_the_pages_own_policy(truth, results, tmp_path):
    page = tmp_path / "o.html"
    text, _ = done(page, results, "--truth", truth)
    assert "<label hidden>" in text
    command = [a_browser(), "--headless=new", "--no-sandbox", "--disable-gpu", "--dump-dom", page.as_uri()]
    shown = subprocess.run(command, capture_output=True, timeout=60, check=True, text=True).stdout
    assert "<label hidden" not in shown  # the choice of a sequence appears
    assert shown.count("<button>") == text.count('<th scope="col"', 0, text.index("</thead>"))


@pytest.mark.slow
def test_a_large_report_opens_at_once_in_a_browser(tmp_path):
    """Ten sequences of 300 frames in which everything changes its identity all the time."""
    browser = a_browser()
    names = [f"s{number}" for number in range(10)]
    for name in names:
        lines = truth_lines().splitlines()
        made = [re.sub(r"^\d+,\d+,\d+", f"{frame},{one},{20 * one + frame % 9}", lines[0]) for frame in range(1, 301)
                for one in range(1, 20)]  # fmt: skip
        write(tmp_path / "truth" / name / "gt" / "gt.txt", "\n".join(made) + "\n")
        shutil.copytree(_noise(tmp_path / "noise"), tmp_path / "truth" / name / "img1")
        changed = [
            re.sub(r"^(\d+),(\d+)", lambda m: f"{m[1]},{int(m[2]) + 100 * (int(m[1]) // 7)}", line) for line in made
        ]
        write(tmp_path / "runs" / f"{name}.txt", "\n".join(changed) + "\n")
    page = tmp_path / "o.html"
    text, _ = done(page, tmp_path / "runs", "--truth", tmp_path / "truth")
    assert text.count("<figcaption>now") == 200
    assert 1_000_000 < page.stat().st_size < 15_000_000
    shot = tmp_path / "shot.png"
    seconds = min(_opened(browser, page.as_uri(), shot) - _opened(browser, "about:blank", shot) for _ in range(3))
    assert seconds < 2.0


def _noise(folder: Path) -> Path:
    """Pictures that compress as badly as pictures can."""
    import numpy as np
    from PIL import Image

    if not folder.is_dir():
        folder.mkdir()
        for number in range(1, 301):
            noise = np.random.default_rng(number).integers(0, 256, (270, 480, 3), dtype=np.uint8)
            Image.fromarray(noise).save(folder / f"{number:06d}.jpg", quality=50)
    return folder


def _opened(browser: str, address: str, picture: Path) -> float:
    """Seconds from the start of the browser to a picture of the page."""
    start = time.perf_counter()
    options = ["--headless=new", "--no-sandbox", "--disable-gpu", "--window-size=1280,900", f"--screenshot={picture}"]
    subprocess.run([browser, *options, address], capture_output=True, timeout=60, check=True)
    assert picture.is_file()
    return time.perf_counter() - start


@pytest.mark.data
def test_real_sequences_make_pages_with_the_switches_of_the_figures(data_folder, tmp_path):
    folder, clip = data_folder / "sequences", data_folder / "videos" / "haarcascades_video2.avi"
    for name, extra in (("PETS09-S2L1", ()), ("highway2", ("--frames", clip))):
        lines = [line.split(",") for line in (folder / name / "gt" / "gt.txt").read_text().split()]
        for line in lines:
            line[1] = str(int(line[1]) + 1000 * (int(line[0]) // 40))  # all change every 40 frames
        rows = [",".join([*line[:6], "1,-1,-1,-1"]) for number, line in enumerate(lines) if number % 7]
        results = write(tmp_path / f"{name}.txt", "\n".join(rows) + "\n")
        for protocol in ("trackeval", "detrac"):
            options = ("--truth", folder / name, *extra, "--protocol", protocol)
            evaluated(*options, "--results", results, "--json", tmp_path / f"{name}-{protocol}.json")
            figures = json.loads((tmp_path / f"{name}-{protocol}.json").read_text())["runs"][0]["combined"]["figures"]
            text, _ = done(tmp_path / "o.html", results, *options, "--max-switches", 10)
            assert f"Identity switches ({figures['id_switches']:,})" in text
            assert figures["id_switches"] > 50
            assert text.count("<figcaption>now") == 10
