"""`lookonce demo`: nothing given, everything there afterwards."""

from __future__ import annotations

from dataclasses import replace

import pytest
from PIL import Image

import lookonce.demo as demo
from cli.processes import lookonce
from lookonce import Model, open_video
from lookonce.demo import run_demo
from lookonce.errors import OutputError
from lookonce.synthetic import SceneConfig, SyntheticScene

FILES = ["annotated.mp4", "scene.mp4", "tracks.jsonl", "tracks.txt", "trails.png"]
SMALL = SceneConfig(seconds=1, fps=5, height=180, width=320, seed=1, place="highway", ignored_regions=False)


@pytest.fixture(scope="module")
def model() -> Model:
    return Model("street", threads=1)


def test_files_are_whole_and_scores_plausible(model, tmp_path):
    calls = []
    result = run_demo(tmp_path, model, SMALL, report=lambda done, total: calls.append((done, total)))
    assert calls == [(n, 5) for n in range(1, 6)]
    assert sorted(path.name for path in tmp_path.iterdir()) == FILES == sorted(path.name for path in result.files)
    for name in ("scene.mp4", "annotated.mp4"):
        with open_video(tmp_path / name) as video:
            assert [frame.image.shape for frame in video] == [(180, 320, 3)] * 5
    with Image.open(tmp_path / "trails.png") as picture:
        assert picture.size == (320, 180)
    assert result.frames == 5
    assert result.objects > 0
    assert 0 <= result.scores.identity.idf1 <= 1
    assert result.scores.counts.frames == 5


def test_the_same_scene_gives_the_same_bytes(model, tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        run_demo(tmp_path / name, model, SMALL)
    for name in ("tracks.txt", "trails.png"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_objects_that_can_hardly_be_seen_do_not_count(model, tmp_path):
    tiny = SceneConfig(seconds=0.4, fps=5, height=64, width=64, seed=1, place="highway", ignored_regions=False)
    result = run_demo(tmp_path, model, tiny)
    assert result.objects == result.scores.counts.objects


def test_regions_without_truth_are_told_to_the_figures(model, tmp_path, monkeypatch):
    scene, asked = replace(SMALL, ignored_regions=True), []

    def evaluate(truth, result):
        asked.append(truth)
        return demo.TrackingScores

    monkeypatch.setattr(demo, "evaluate_tracking", evaluate)
    run_demo(tmp_path, model, scene)
    (truth,) = asked
    assert truth.ignored.tolist() == SyntheticScene(scene).ignored.tolist() != []


def test_a_folder_that_is_not_there_is_one_line(model, tmp_path):
    with pytest.raises(OutputError, match=r"scene\.mp4"):
        run_demo(tmp_path / "missing" / "deep", model, SMALL)


def test_the_command_needs_no_arguments_but_takes_some(tmp_path):
    arguments = ["demo", "-o", "out", "--seconds", "1", "--place", "highway"]
    for _ in range(2):  # a second run replaces the first
        done = lookonce(*arguments, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == FILES
    assert "IDF1" in done.stdout
    assert "annotated.mp4" in done.stdout
    assert "lookonce track" in done.stdout
    wrong = lookonce("demo", "--place", "moon", cwd=tmp_path)
    assert wrong.returncode == 1
    assert "moon" in wrong.stderr
    assert len(wrong.stderr.strip().splitlines()) == 1
